"""One sample of `WIDTH` plants, in stages that the compiled simulation puts together:  rows of scratch -> rows.

The formulas are those of `scenario`, `plants`, `noise` and `fopi_tune.digital.runtime`; the order of the operations of
a controller is that of `runtime`, bit for bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.validation import noise
from fopi_tune.validation.layout import (
    APPLIED,
    ARRIVED,
    BEFORE,
    CHATTER,
    CONTROL,
    DIRECT,
    ERROR,
    GAIN,
    HIGH,
    IAE,
    INTEGRATES,
    ISE,
    JUMPED,
    LAST,
    LOAD,
    LONGEST,
    LOW,
    MODE,
    NOISE,
    OLD_ARRIVED,
    OLD_CONTROL,
    OLD_LOAD,
    OUTSIDE,
    OVER,
    PEAK_RATE,
    PEAK_U,
    RESET,
    RUN,
    SATURATED,
    SECTIONS,
    SLOT_ROWS,
    START,
    SWITCHES,
    WIDTH,
)
from fopi_tune.validation.packs import bits, load, lowest, size, spread, store, upper_product, where

_BIG = float(np.finfo(np.float64).max)
_ALL = 2**WIDTH - 1
_M0, _M1 = (np.uint64(word) for word in noise.MULTIPLIERS)
_W0, _W1 = (np.uint64(word) for word in noise.WEYL)
_ROUNDS, _CENTRAL, _FAR = noise.ROUNDS, noise.CENTRAL, noise.FAR
_CENTRE_TOP, _CENTRE_BOTTOM = noise.CENTRE
_MIDDLE_TOP, _MIDDLE_BOTTOM = noise.MIDDLE
_OUTER_TOP, _OUTER_BOTTOM = noise.OUTER

_inlined: Any = njit(forceinline=True, error_model="numpy")
_apart: Any = njit(error_model="numpy")


@_inlined
def fine(x):
    """The lanes that are finite."""
    return size(x) <= spread(_BIG)


@_inlined
def _keep_larger(s, row, value):
    before = load(s, row)
    store(s, row, where(value > before, value, before))


@_apart
def _words(seed, plant, counter):
    """Philox4x64-10."""
    a, b, c, d = counter, np.uint64(0), np.uint64(0), np.uint64(0)
    k0, k1 = seed, plant
    for _ in range(_ROUNDS):
        upper, lower = upper_product(_M0, a), _M0 * a
        other, least = upper_product(_M1, c), _M1 * c
        a, b, c, d = other ^ b ^ k0, least, upper ^ d ^ k1, lower
        k0, k1 = k0 + _W0, k1 + _W1
    return a, b, c, d


@_apart
def _quotient(top, bottom, x):
    a, b = top[7], bottom[7]
    for i in range(1, 8):
        a, b = top[7 - i] + a * x, bottom[7 - i] + b * x
    return a / b


@_apart
def _tail(q):
    r = math.sqrt(-math.log(0.5 - abs(q)))
    if r <= _FAR:
        return math.copysign(_quotient(_MIDDLE_TOP, _MIDDLE_BOTTOM, r - 1.6), q)
    return math.copysign(_quotient(_OUTER_TOP, _OUTER_BOTTOM, r - 5.0), q)


@_apart
def make_noise(s, seed, index, k):
    """Deviates of the samples k to k + 3 of plants index, index + 1, ..."""
    for lane in range(WIDTH):
        four = _words(seed, np.uint64(index + lane), np.uint64(1 + k // 4))
        for i in range(4):
            s[NOISE + WIDTH * i + lane] = (np.float64(four[i] >> np.uint64(12)) + 0.5) * 2.0**-52 - 0.5
    # four rows of 16 lanes are the 64 bits of a word
    left = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        r = spread(_CENTRAL**2) - q * q
        top, bottom = spread(_CENTRE_TOP[7]), spread(_CENTRE_BOTTOM[7])
        for j in range(1, 8):
            top, bottom = spread(_CENTRE_TOP[7 - j]) + top * r, spread(_CENTRE_BOTTOM[7 - j]) + bottom * r
        outer = size(q) > spread(_CENTRAL)
        store(s, NOISE + WIDTH * i, where(outer, q, q * (top / bottom)))
        left |= bits(outer) << (WIDTH * i)
    while left != 0:
        place = NOISE + lowest(left)
        s[place] = _tail(s[place])
        left &= left - 1


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


@_apart
def _jump(s, jumps, lane, k, settings, places, active, inactive):
    """One lane changes its mode."""
    for i in range(SLOT_ROWS + 3 * settings.sections):
        one, two = places.slot_a + i * WIDTH + lane, places.slot_b + i * WIDTH + lane
        s[one], s[two] = s[two], s[one]
    for i in range(settings.sections):
        one, two = active + i * WIDTH + lane, inactive + i * WIDTH + lane
        s[one], s[two] = s[two], s[one]
    a = places.slot_a + lane
    s[MODE + lane] = 1.0 - s[MODE + lane]
    s[APPLIED + lane] = min(max(s[APPLIED + lane], s[a + LOW]), s[a + HIGH])
    if settings.inactive == RESET:
        s[a + LAST] = s[a + START]
        for i in range(settings.sections):
            s[active + i * WIDTH + lane] = s[a + START] * s[a + INTEGRATES] if i == 0 else 0.0
    count, most = int(s[SWITCHES + lane]), settings.most_switches
    s[RUN + lane] = s[RUN + lane] + 1.0 if count > 0 and s[JUMPED + lane] == k - 1 else 1.0
    s[LONGEST + lane] = max(s[LONGEST + lane], s[RUN + lane])
    # the jump `most` jumps ago
    place = (count % most) * WIDTH + lane
    if count >= most and k - jumps[place] <= settings.window:
        s[CHATTER + lane] = 1.0
    jumps[place] = k
    s[JUMPED + lane] = k
    s[SWITCHES + lane] += 1.0


@_inlined
def switch(s, jumps, k, measured, reference, settings, places, active, inactive):
    """Lanes that meet the edge of the hysteresis change their mode."""
    mode = load(s, MODE)
    up = (mode < spread(0.5)) & (measured >= spread(reference + settings.half_width))
    down = (mode > spread(0.5)) & (measured <= spread(reference - settings.half_width))
    jumping = bits(up | down)
    while jumping != 0:
        _jump(s, jumps, lowest(jumping), k, settings, places, active, inactive)
        jumping &= jumping - 1


@_inlined
def _limited(s, slot, value):
    low, high = load(s, slot + LOW), load(s, slot + HIGH)
    value = where(value < low, low, value)
    return where(value > high, high, value)


@_inlined
def _demand(s, slot, old, sections, e):
    v = load(s, slot + DIRECT) * e
    for i in range(sections):
        v = v + load(s, old + i * WIDTH)
    return v


@_inlined
def _follow(s, slot, old, new, sections, d, e, usable):
    """x_k <- p_k (x_k + w_k d) + r_k e; the lanes in which nothing was lost, the states of the others as they were."""
    total = spread(0.0)
    for i in range(sections):
        c = slot + SECTIONS + 3 * i * WIDTH
        x = load(s, old + i * WIDTH)
        x = load(s, c) * (x + load(s, c + WIDTH) * d) + load(s, c + 2 * WIDTH) * e
        store(s, new + i * WIDTH, x)
        total = total + x
    return _kept(s, old, new, sections, total, usable)


@_inlined
def _kept(s, old, new, sections, total, usable):
    """The lanes whose new states are numbers; in the others the states as they were."""
    # a sum of numbers is finite only if all of them are
    good = usable & fine(total)
    if bits(good) != _ALL:
        good = usable
        for i in range(sections):
            good = good & fine(load(s, new + i * WIDTH))
        for i in range(sections):
            store(s, new + i * WIDTH, where(good, load(s, new + i * WIDTH), load(s, old + i * WIDTH)))
    return good


@_inlined
def control(s, slot, old, new, sections, e):
    """One sample of the active controller; its output."""
    v = _demand(s, slot, old, sections, e)
    u = _limited(s, slot, v)
    good = _follow(s, slot, old, new, sections, load(s, slot + GAIN) * (u - v), e, fine(e) & fine(v))
    u = where(good, u, load(s, slot + LAST))
    store(s, slot + LAST, u)
    return u


@_inlined
def follow_applied(s, slot, old, new, sections, e, applied):
    """One sample of the other controller."""
    v = _demand(s, slot, old, sections, e)
    u = _limited(s, slot, applied)
    rest, total = load(s, slot + DIRECT) * e, spread(0.0)
    for i in range(1, sections):
        x = load(s, slot + SECTIONS + 3 * i * WIDTH) * load(s, old + i * WIDTH)
        store(s, new + i * WIDTH, x)
        rest, total = rest + x, total + x
    if sections > 0:
        x = load(s, slot + SECTIONS) * load(s, old)
        x = where(load(s, slot + INTEGRATES) > spread(0.5), u - rest, x)
        store(s, new, x)
        total = total + x
    usable = fine(e) & fine(v) & fine(applied)
    good = _kept(s, old, new, sections, total, usable)
    store(s, slot + LAST, where(good, u, load(s, slot + LAST)))


@_inlined
def actuated(s, u, most):
    """The control after the rate limit."""
    last, most = load(s, APPLIED), spread(most)
    change = u - last
    moved = where(change > spread(0.0), last + most, last - most)
    applied = where(size(change) <= most, u, moved)
    store(s, APPLIED, applied)
    return applied


@_inlined
def judge(s, k, y, rate, reference, u, applied, settings, slot):
    """What one sample adds to the measures."""
    _keep_larger(s, PEAK_RATE, size(rate))
    _keep_larger(s, PEAK_U, size(applied))
    beyond = y - spread(settings.final)
    off = size(beyond)
    if settings.direction == 0.0:
        _keep_larger(s, OVER, off)
    else:
        _keep_larger(s, OVER, spread(settings.direction) * beyond)
    store(s, OUTSIDE, where(off <= spread(settings.band), load(s, OUTSIDE), spread(float(k))))
    error = spread(reference) - y
    store(s, ERROR, error)
    store(s, IAE, load(s, IAE) + size(error))
    store(s, ISE, load(s, ISE) + error * error)
    inside = (u > load(s, slot + LOW)) & (u < load(s, slot + HIGH))
    store(s, SATURATED, load(s, SATURATED) + where(inside, spread(0.0), spread(1.0)))


@_inlined
def arrive(s, history, modes, block, k, applied, signal, late, settings):
    """What reaches the plants in this sample: the control (and its mode) and the load, and what was there before."""
    store(s, OLD_CONTROL, load(s, CONTROL))
    store(s, OLD_ARRIVED, load(s, ARRIVED))
    if settings.ring == 0:
        store(s, CONTROL, applied)
        store(s, ARRIVED, load(s, MODE))
    else:
        store(history, (k % settings.ring) * WIDTH, applied)
        store(modes, (k % settings.ring) * WIDTH, load(s, MODE))
        for lane in range(WIDTH):
            place = (k - late[block * WIDTH + lane]) % settings.ring * WIDTH + lane
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
    """The same of two modes: the old one until its control is followed by the next, the new one from there."""
    p, x, w = places.plant, load(s, places.x), load(s, LOAD)
    if settings.delayed:
        first = load(s, OLD_ARRIVED) < spread(0.5)
        x = where(first, load(s, p), load(s, p + 6 * WIDTH)) * x
        weight = where(first, load(s, p + WIDTH), load(s, p + 7 * WIDTH))
        x = x + weight * (load(s, OLD_CONTROL) + w)
    first, before = load(s, ARRIVED) < spread(0.5), load(s, CONTROL) + w
    x = where(first, load(s, p + 2 * WIDTH), load(s, p + 8 * WIDTH)) * x
    store(s, places.x, x + where(first, load(s, p + 3 * WIDTH), load(s, p + 9 * WIDTH)) * before)
    store(s, BEFORE, before)
