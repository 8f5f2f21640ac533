"""One sample of `WIDTH` plants without their controllers, in stages:  rows of the scratch array -> rows.

The formulas are those of `simulation.scenario` and `plants`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled.controller_stages import coefficient, flushed, resolve_mode, store_maximum
from fopi_tune.simulation.sampled.layout import (
    ALL_LANES,
    APPLIED,
    ARRIVED_MODE,
    BAND,
    BEFORE,
    BEGINS,
    BEGUN,
    CHANGE,
    COASTING,
    CONTROL,
    DIRECTION,
    FINAL_ERROR,
    FLOOR,
    GOES_ON,
    HIGH,
    HOLD_BELOW,
    IAE,
    ISE,
    LOAD,
    LOAD_BEGINS,
    LOW,
    MODE,
    OLD_ARRIVED_MODE,
    OLD_CONTROL,
    OLD_LOAD,
    OUTPUT,
    OUTSIDE,
    OVERSHOOT,
    PEAK_CONTROL,
    PEAK_JERK,
    PEAK_RATE,
    PREVIOUS_INPUT,
    REACHED,
    REFERENCE_BEGINS,
    RISE,
    RISEN,
    RISES_FROM,
    RISES_TO,
    RISING,
    RISING_OUTPUT,
    SATURATED,
    SENT,
    SETTLED,
    STEP_ERROR,
    UNDERSHOOT,
    VALUE,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import absolute, bits, broadcast, load, mask_from_bits, store, where

_inlined: Any = njit(forceinline=True, error_model="numpy")


@_inlined
def output(s, c, other, settings, offsets):
    """y and dy/dt just before the sample."""
    before = load(s, PREVIOUS_INPUT)
    if settings.hybrid and settings.order > 1:
        first, row = load(s, ARRIVED_MODE) < broadcast(0.5), 2 * (settings.order * settings.order + settings.order)
        rate = selected(s, settings, offsets, row + settings.order, first) * before
        for i in range(settings.order):
            rate = rate + selected(s, settings, offsets, row + i, first) * load(s, offsets.x + i * WIDTH)
        return load(s, offsets.x), rate
    if settings.hybrid:
        y, first = load(s, offsets.x), load(s, ARRIVED_MODE) < broadcast(0.5)
        p = offsets.plant
        pole = where(first, load(s, p + 4 * WIDTH), load(s, p + 10 * WIDTH))
        gain = where(first, load(s, p + 5 * WIDTH), load(s, p + 11 * WIDTH))
        rate = pole * y + gain * before
        if settings.stands:
            rate = where(stands_still(c, other, y, gain * before, first), broadcast(0.0), rate)
        return y, rate
    n = settings.order
    c = offsets.plant + (n * n + 2 * n) * WIDTH
    y, rate = broadcast(0.0), broadcast(0.0)
    for i in range(n):
        x = load(s, offsets.x + i * WIDTH)
        y, rate = y + load(s, c + i * WIDTH) * x, rate + load(s, c + (n + i) * WIDTH) * x
    return y + load(s, c + 2 * n * WIDTH) * before, rate + load(s, c + (2 * n + 1) * WIDTH) * before


@_inlined
def selected(s, settings, offsets, row, first):
    """A coefficient of the plant of mode 1 or 2; of each there are two segments' matrices and weights, then dy/dt."""
    n = settings.order
    one = offsets.plant + row * WIDTH
    return where(first, load(s, one), load(s, one + (2 * (n * n + n) + n + 1) * WIDTH))


@_inlined
def _advance_segment(s, settings, offsets, row, first, drive):
    """States of higher order over a segment of a sample with one input."""
    n = settings.order
    for i in range(n):
        x = selected(s, settings, offsets, row + n * n + i, first) * drive
        for j in range(n):
            x = x + selected(s, settings, offsets, row + i * n + j, first) * load(s, offsets.x + j * WIDTH)
        store(s, offsets.following + i * WIDTH, x)
    for i in range(n):
        store(s, offsets.x + i * WIDTH, load(s, offsets.following + i * WIDTH))


@_inlined
def _advance_derivatives(s, settings, offsets):
    """`advance_hybrid_states` of plants of which one at least is of higher order."""
    n, w = settings.order, load(s, LOAD)
    if settings.delayed:
        first = load(s, OLD_ARRIVED_MODE) < broadcast(0.5)
        _advance_segment(s, settings, offsets, 0, first, load(s, OLD_CONTROL) + w)
    first, before = load(s, ARRIVED_MODE) < broadcast(0.5), load(s, CONTROL) + w
    row = 2 * (n * n + n)
    after = selected(s, settings, offsets, row + n, first) * before
    for i in range(n):
        after = after + selected(s, settings, offsets, row + i, first) * load(s, offsets.x + i * WIDTH)
    _advance_segment(s, settings, offsets, n * n + n, first, before)
    for i in range(n):
        store(s, offsets.x + i * WIDTH, flushed(load(s, offsets.x + i * WIDTH)))
    store(s, PREVIOUS_INPUT, before)
    return after


@_inlined
def stands_still(c, other, y, drive, first):
    """The lanes whose output rests at 0, held against what drives it, output unit per s."""
    hold = where(first, broadcast(c[HOLD_BELOW]), broadcast(c[other + HOLD_BELOW]))
    return (y <= broadcast(0.0)) & (drive < hold)


@_inlined
def standing(c, other, y, following, drive, first):
    """The output after a time of one input: it stays at 0, or ends there on its way below."""
    floor = where(first, broadcast(c[FLOOR]), broadcast(c[other + FLOOR]))
    following = where(following < floor, floor, following)
    return where(stands_still(c, other, y, drive, first), broadcast(0.0), following)


@_inlined
def rate_after(s, settings, offsets, rate):
    """dy/dt just after the inputs that arrive at the sample; those that arrive between samples are left out."""
    n = settings.order
    step = offsets.plant + (n * n + 4 * n + 2) * WIDTH
    return rate + load(s, step) * (load(s, CONTROL) + load(s, LOAD) - load(s, PREVIOUS_INPUT))


@_inlined
def rate_on_arrival(s, settings, offsets, after):
    """The same where an input arrives between samples: `DiscretePlants.arrivals`; before the states advance."""
    n = settings.order
    flag = offsets.plant + (n * n + 6 * n + 3) * WIDTH
    row, found = flag + WIDTH, broadcast(0.0)
    for instant in range(1 + settings.loaded):
        value = load(s, row + n * WIDTH) * load(s, CONTROL) + load(s, row + (n + 1) * WIDTH) * load(s, OLD_CONTROL)
        if settings.loaded:
            value = value + load(s, row + (n + 2) * WIDTH) * load(s, LOAD)
            value = value + load(s, row + (n + 3) * WIDTH) * load(s, OLD_LOAD)
        for i in range(n):
            value = value + load(s, row + i * WIDTH) * load(s, offsets.x + i * WIDTH)
        found = value if instant == 0 else where(absolute(value) > absolute(found), value, found)
        row += (n + 4) * WIDTH
    return where(load(s, flag) > broadcast(0.5), after, found)


@_inlined
def rate_limited(s, u, most):
    """The control after the rate limit."""
    if most < np.inf:
        last, most = load(s, APPLIED), broadcast(most)
        change = u - last
        moved = where(change > broadcast(0.0), last + most, last - most)
        u = where(absolute(change) <= most, u, moved)
    store(s, APPLIED, u)
    return u


@_inlined
def accumulate_measures(s, k, y, rate, reference, u, applied, settings, c, other, steps):
    """Add one sample to the measures."""
    store_maximum(s, PEAK_RATE, absolute(rate))
    store_maximum(s, PEAK_CONTROL, absolute(applied))
    if k > settings.horizon:
        change = y - load(s, OUTPUT)
        if k > settings.horizon + 1:
            store_maximum(s, PEAK_JERK, absolute(change - load(s, CHANGE)))
        store(s, CHANGE, change)
    store(s, OUTPUT, y)
    error = broadcast(reference) - y
    if k >= settings.judged:
        _judge_step(s, k, y, settings, steps)
    store(s, FINAL_ERROR, error)
    store(s, IAE, load(s, IAE) + absolute(error))
    store(s, ISE, load(s, ISE) + error * error)
    if k < settings.steps - 1:
        second = load(s, MODE) > broadcast(0.5)
        own, select = resolve_mode(c, other, second)
        inside = (u > coefficient(own, LOW, select, second)) & (u < coefficient(own, HIGH, select, second))
        if settings.coasts:
            # no controller's output: it is at no limit
            inside = inside | (load(s, COASTING) > broadcast(0.5))
        store(s, SATURATED, load(s, SATURATED) + where(inside, broadcast(0.0), broadcast(1.0)))


@_inlined
def _judge_step(s, k, y, settings, steps):
    """Overshoot, undershoot, settling and rise of the step that is judged at this sample."""
    begins = steps[BEGINS * settings.steps + k]
    if k > settings.judged and begins != GOES_ON:
        _begin_step(s, k, begins == LOAD_BEGINS)
    beyond = y - broadcast(steps[VALUE * settings.steps + k])
    off, direction = absolute(beyond), steps[DIRECTION * settings.steps + k]
    store_maximum(s, OVERSHOOT, off if direction == 0.0 else broadcast(direction) * beyond)
    if direction != 0.0:
        # a comparison is all that it costs where no output is back beyond its value before the step
        before = broadcast(steps[BEFORE * settings.steps + k])
        if bits(y < before if direction > 0.0 else y > before) != 0:
            store_maximum(s, UNDERSHOOT, broadcast(direction) * (before - y))
    begun = k == settings.judged or begins == REFERENCE_BEGINS
    if begun:
        _begin_rise(s, direction)
    if s[RISING] != 0.0:
        _follow_rise(s, k, y, begun, steps[RISES_FROM * settings.steps + k], steps[RISES_TO * settings.steps + k])
    inside = off <= broadcast(steps[BAND * settings.steps + k])
    store(s, OUTSIDE, where(inside, load(s, OUTSIDE), broadcast(float(k))))


@_inlined
def _begin_rise(s, direction):
    """No lane has crossed a level of the new step; without a step there is nothing to wait for."""
    never = broadcast(np.inf if direction != 0.0 else 0.0)
    store(s, REACHED, never)
    store(s, RISEN, never)
    s[RISING] = direction
    s[RISING + 1] = s[RISING + 2] = float(ALL_LANES)


@_inlined
def _follow_rise(s, k, y, begun, low, high):
    """When the output first crosses two levels, between the last sample and this one.

    RISING holds the direction, and as whole numbers the lanes that have not crossed the first and the second level.
    """
    first, second = int(s[RISING + 1]), int(s[RISING + 2])
    if s[RISING] > 0.0:
        at_first, at_second = bits(y >= broadcast(low)) & first, bits(y >= broadcast(high)) & second
    else:
        at_first, at_second = bits(y <= broadcast(low)) & first, bits(y <= broadcast(high)) & second
    if at_first | at_second != 0:
        _store_crossing(s, REACHED, k, y, begun, low, at_first)
        _store_crossing(s, RISEN, k, y, begun, high, at_second)
        s[RISING + 1], s[RISING + 2] = float(first & ~at_first), float(second & ~at_second)
        if second == at_second:
            s[RISING] = 0.0
    store(s, RISING_OUTPUT, y)


@_inlined
def _store_crossing(s, row, k, y, begun, level, lanes):
    """Time of a crossing in samples, in some lanes; at a step's first sample the output is beyond already."""
    last = load(s, RISING_OUTPUT)
    between = broadcast(k - 1.0) + (broadcast(level) - last) / (y - last)
    store(s, row, where(mask_from_bits(lanes), broadcast(float(k)) if begun else between, load(s, row)))


@_inlined
def _begin_step(s, k, of_load):
    """End the step that was judged so far, and begin the next one at this sample.

    A step of the load begins only in the lanes that are within the band; in the others the step before goes on.
    """
    before, outside, begun = broadcast(float(k - 1)), load(s, OUTSIDE), load(s, BEGUN)
    unsettled = outside >= before
    lasted = outside + broadcast(1.0) - begun
    if of_load:
        store_maximum(s, SETTLED, where(unsettled, broadcast(0.0), lasted))
        store(s, BEGUN, where(unsettled, begun, broadcast(float(k))))
        store(s, OUTSIDE, where(unsettled, outside, before))
    else:
        store_maximum(s, SETTLED, where(unsettled, broadcast(np.inf), lasted))
        risen, never = load(s, RISEN), broadcast(np.inf)
        store_maximum(s, RISE, where(risen >= never, never, risen - load(s, REACHED)))
        store(s, BEGUN, broadcast(float(k)))
        store(s, OUTSIDE, before)
        error, worst = load(s, FINAL_ERROR), load(s, STEP_ERROR)
        store(s, STEP_ERROR, where(absolute(error) > absolute(worst), error, worst))


@_inlined
def update_inputs(s, history, modes, block, k, applied, signal, delay, settings):
    """The inputs that reach the plants in this sample: control, with its mode, and load; and the previous ones."""
    if settings.delayed:
        store(s, OLD_CONTROL, load(s, CONTROL))
        store(s, OLD_ARRIVED_MODE, load(s, ARRIVED_MODE))
    if settings.ring == 0:
        store(s, CONTROL, applied)
        store(s, ARRIVED_MODE, load(s, MODE))
    else:
        now = k % settings.ring
        store(history, now * WIDTH, applied)
        store(modes, now * WIDTH, load(s, MODE))
        if settings.own_delays:
            _arrive(s, history, modes, k, 0, settings.first_delay, settings)
            _arrive(s, history, modes, k, 1, settings.second_delay, settings)
        elif settings.same_delay:
            place = (k - delay[0]) % settings.ring * WIDTH
            store(s, CONTROL, load(history, place))
            store(s, ARRIVED_MODE, load(modes, place))
        else:
            for lane in range(WIDTH):
                row = now - delay[block * WIDTH + lane]
                place = (row if row >= 0 else row + settings.ring) * WIDTH + lane
                s[CONTROL + lane] = history[place]
                s[ARRIVED_MODE + lane] = modes[place]
    if settings.loaded:
        store(s, OLD_LOAD, load(s, LOAD))
        if settings.load_delayed:
            for lane in range(WIDTH):
                place = k - delay[settings.width + block * WIDTH + lane]
                s[LOAD + lane] = signal[place] if place >= 0 else 0.0
        else:
            store(s, LOAD, broadcast(signal[k]))


@_inlined
def _arrive(s, history, modes, k, which, delay, settings):
    """The control that arrives now in the lanes where it is of this mode and no later one acts already."""
    sent = k - delay
    if sent >= 0:
        place, mode = sent % settings.ring * WIDTH, broadcast(float(which))
        own = load(modes, place)
        arrives = (own >= mode) & (own <= mode) & (load(s, SENT) < broadcast(float(sent)))
        store(s, CONTROL, where(arrives, load(history, place), load(s, CONTROL)))
        store(s, ARRIVED_MODE, where(arrives, mode, load(s, ARRIVED_MODE)))
        store(s, SENT, where(arrives, broadcast(float(sent)), load(s, SENT)))


@_inlined
def advance_states(s, settings, offsets):
    """(1) of `plants` to the next sample."""
    n, p = settings.order, offsets.plant
    control, old, w, old_w = load(s, CONTROL), load(s, OLD_CONTROL), load(s, LOAD), load(s, OLD_LOAD)
    for i in range(n):
        x = load(s, p + i * n * WIDTH) * load(s, offsets.x)
        for j in range(1, n):
            x = x + load(s, p + (i * n + j) * WIDTH) * load(s, offsets.x + j * WIDTH)
        row = p + (n * n + i) * WIDTH
        x = x + load(s, row) * control
        if settings.delayed:
            x = x + load(s, row + n * WIDTH) * old
        if settings.loaded:
            row += (4 * n + 3) * WIDTH
            x = x + load(s, row) * w + load(s, row + n * WIDTH) * old_w
        store(s, offsets.following + i * WIDTH, flushed(x))
    for i in range(n):
        store(s, offsets.x + i * WIDTH, load(s, offsets.following + i * WIDTH))
    store(s, PREVIOUS_INPUT, control + w)


@_inlined
def advance_hybrid_states(s, c, other, settings, offsets):
    """The same for two modes: the old one until the new control arrives, the new one from there.

    Returns dy/dt just after the new control arrives.
    """
    if settings.order > 1:
        return _advance_derivatives(s, settings, offsets)
    p, x, w = offsets.plant, load(s, offsets.x), load(s, LOAD)
    if settings.delayed:
        first, late = load(s, OLD_ARRIVED_MODE) < broadcast(0.5), load(s, OLD_CONTROL) + w
        begun = x
        x = where(first, load(s, p), load(s, p + 6 * WIDTH)) * x
        weight = where(first, load(s, p + WIDTH), load(s, p + 7 * WIDTH))
        x = x + weight * late
        if settings.stands:
            drive = where(first, load(s, p + 5 * WIDTH), load(s, p + 11 * WIDTH)) * late
            x = standing(c, other, begun, x, drive, first)
    first, before = load(s, ARRIVED_MODE) < broadcast(0.5), load(s, CONTROL) + w
    pole, begun = where(first, load(s, p + 4 * WIDTH), load(s, p + 10 * WIDTH)), x
    drive = where(first, load(s, p + 5 * WIDTH), load(s, p + 11 * WIDTH)) * before
    after = pole * x + drive
    x = where(first, load(s, p + 2 * WIDTH), load(s, p + 8 * WIDTH)) * x
    x = x + where(first, load(s, p + 3 * WIDTH), load(s, p + 9 * WIDTH)) * before
    if settings.stands:
        after = where(stands_still(c, other, begun, drive, first), broadcast(0.0), after)
        x = standing(c, other, begun, x, drive, first)
    store(s, offsets.x, flushed(x))
    store(s, PREVIOUS_INPUT, before)
    return after
