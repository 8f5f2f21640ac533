"""One sample of `WIDTH` plants without their controllers, in stages:  rows of scratch -> rows.

The formulas are those of `scenario` and `plants`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled.controller_stages import controllers_of, keep_larger, of_mode
from fopi_tune.simulation.sampled.layout import (
    APPLIED,
    ARRIVED,
    BEFORE,
    CONTROL,
    ERROR,
    HIGH,
    IAE,
    ISE,
    LOAD,
    LOW,
    MODE,
    OLD_ARRIVED,
    OLD_CONTROL,
    OLD_LOAD,
    OUTSIDE,
    OVER,
    PEAK_RATE,
    PEAK_U,
    SATURATED,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import load, size, spread, store, where

_inlined: Any = njit(forceinline=True, error_model="numpy")


@_inlined
def output(s, settings, places):
    """y and dy/dt just before the sample."""
    before = load(s, BEFORE)
    if settings.hybrid:
        y, first = load(s, places.x), load(s, ARRIVED) < spread(0.5)
        p = places.plant
        pole = where(first, load(s, p + 4 * WIDTH), load(s, p + 10 * WIDTH))
        gain = where(first, load(s, p + 5 * WIDTH), load(s, p + 11 * WIDTH))
        return y, pole * y + gain * before
    n = settings.order
    c = places.plant + (n * n + 4 * n) * WIDTH
    y, rate = spread(0.0), spread(0.0)
    for i in range(n):
        x = load(s, places.x + i * WIDTH)
        y, rate = y + load(s, c + i * WIDTH) * x, rate + load(s, c + (n + i) * WIDTH) * x
    return y + load(s, c + 2 * n * WIDTH) * before, rate + load(s, c + (2 * n + 1) * WIDTH) * before


@_inlined
def rate_after(s, settings, places, rate):
    """dy/dt just after what arrives at the sample; what arrives between samples is not in it."""
    n = settings.order
    step = places.plant + (n * n + 6 * n + 2) * WIDTH
    return rate + load(s, step) * (load(s, CONTROL) + load(s, LOAD) - load(s, BEFORE))


@_inlined
def rate_on_arrival(s, places, after):
    """The same of a plant of first order on which the control acts between the samples: told from the next sample's."""
    c = places.plant + 5 * WIDTH
    later = load(s, c + WIDTH) * load(s, places.x) + load(s, c + 3 * WIDTH) * load(s, BEFORE)
    return where(size(load(s, c + 4 * WIDTH)) > spread(0.0), after, later * load(s, c + 5 * WIDTH))


@_inlined
def actuated(s, u, most):
    """The control after the rate limit."""
    if most < np.inf:
        last, most = load(s, APPLIED), spread(most)
        change = u - last
        moved = where(change > spread(0.0), last + most, last - most)
        u = where(size(change) <= most, u, moved)
    store(s, APPLIED, u)
    return u


@_inlined
def judge(s, k, y, rate, reference, u, applied, settings, c, other):
    """What one sample adds to the measures."""
    second = load(s, MODE) > spread(0.5)
    own, select = controllers_of(c, other, second)
    keep_larger(s, PEAK_RATE, size(rate))
    keep_larger(s, PEAK_U, size(applied))
    beyond = y - spread(settings.final)
    off = size(beyond)
    if settings.direction == 0.0:
        keep_larger(s, OVER, off)
    else:
        keep_larger(s, OVER, spread(settings.direction) * beyond)
    store(s, OUTSIDE, where(off <= spread(settings.band), load(s, OUTSIDE), spread(float(k))))
    error = spread(reference) - y
    store(s, ERROR, error)
    store(s, IAE, load(s, IAE) + size(error))
    store(s, ISE, load(s, ISE) + error * error)
    inside = (u > of_mode(own, LOW, select, second)) & (u < of_mode(own, HIGH, select, second))
    store(s, SATURATED, load(s, SATURATED) + where(inside, spread(0.0), spread(1.0)))


@_inlined
def arrive(s, history, modes, block, k, applied, signal, late, settings):
    """What reaches the plants in this sample: the control (and its mode) and the load, and what was there before."""
    if settings.delayed:
        store(s, OLD_CONTROL, load(s, CONTROL))
        store(s, OLD_ARRIVED, load(s, ARRIVED))
    if settings.ring == 0:
        store(s, CONTROL, applied)
        store(s, ARRIVED, load(s, MODE))
    else:
        now = k % settings.ring
        store(history, now * WIDTH, applied)
        store(modes, now * WIDTH, load(s, MODE))
        if settings.same_late:
            place = (k - late[0]) % settings.ring * WIDTH
            store(s, CONTROL, load(history, place))
            store(s, ARRIVED, load(modes, place))
        else:
            for lane in range(WIDTH):
                row = now - late[block * WIDTH + lane]
                place = (row if row >= 0 else row + settings.ring) * WIDTH + lane
                s[CONTROL + lane] = history[place]
                s[ARRIVED + lane] = modes[place]
    if settings.loaded:
        store(s, OLD_LOAD, load(s, LOAD))
        if settings.load_delayed:
            for lane in range(WIDTH):
                place = k - late[settings.width + block * WIDTH + lane]
                s[LOAD + lane] = signal[place] if place >= 0 else 0.0
        else:
            store(s, LOAD, spread(signal[k]))


@_inlined
def flow(s, settings, places):
    """(1) of `plants` to the next sample."""
    n, p = settings.order, places.plant
    control, old, w, old_w = load(s, CONTROL), load(s, OLD_CONTROL), load(s, LOAD), load(s, OLD_LOAD)
    for i in range(n):
        x = load(s, p + i * n * WIDTH) * load(s, places.x)
        for j in range(1, n):
            x = x + load(s, p + (i * n + j) * WIDTH) * load(s, places.x + j * WIDTH)
        row = p + (n * n + i) * WIDTH
        x = x + load(s, row) * control
        if settings.delayed:
            x = x + load(s, row + n * WIDTH) * old
        if settings.loaded:
            x = x + load(s, row + 2 * n * WIDTH) * w + load(s, row + 3 * n * WIDTH) * old_w
        store(s, places.following + i * WIDTH, x)
    for i in range(n):
        store(s, places.x + i * WIDTH, load(s, places.following + i * WIDTH))
    store(s, BEFORE, control + w)


@_inlined
def flow_hybrid(s, settings, places):
    """The same of two modes: the old one until its control is followed by the next, the new one from there.

    Gives dy/dt just after the new one begins.
    """
    p, x, w = places.plant, load(s, places.x), load(s, LOAD)
    if settings.delayed:
        first = load(s, OLD_ARRIVED) < spread(0.5)
        x = where(first, load(s, p), load(s, p + 6 * WIDTH)) * x
        weight = where(first, load(s, p + WIDTH), load(s, p + 7 * WIDTH))
        x = x + weight * (load(s, OLD_CONTROL) + w)
    first, before = load(s, ARRIVED) < spread(0.5), load(s, CONTROL) + w
    pole = where(first, load(s, p + 4 * WIDTH), load(s, p + 10 * WIDTH))
    after = pole * x + where(first, load(s, p + 5 * WIDTH), load(s, p + 11 * WIDTH)) * before
    x = where(first, load(s, p + 2 * WIDTH), load(s, p + 8 * WIDTH)) * x
    store(s, places.x, x + where(first, load(s, p + 3 * WIDTH), load(s, p + 9 * WIDTH)) * before)
    store(s, BEFORE, before)
    return after
