"""One sample of the controllers of `WIDTH` plants, in stages, switching included:  rows of the scratch array -> rows.

Formulas and order of operations are those of `fopi_tune.digital.runtime`, bit for bit.  A lane selects the coefficients
of its mode; where all lanes are in the same mode nothing has to be selected.

Arguments that many stages share: s is the pointer to the scratch array, c the pointer to the coefficients of mode 1,
`other` the offset of those of mode 2 (0 where there is nothing to select), `second` the mask of lanes in mode 2, e the
error, v the controller's output before the limits and u within them, `first` the part of v that has no memory.  Weights
of the setpoint and measurement filters are those of a single controller; `filtered` are the rows of measurements behind
the lags of a derivative.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled.layout import (
    ALL_LANES,
    COASTING,
    DIRECT,
    EXCESS,
    FED_CHANGE,
    FED_STATIC,
    FLOOR,
    FLUSH_BELOW,
    HIGH,
    HOLD_BELOW,
    INTEGRATES,
    IS_NEW,
    LAST_ERROR,
    LAST_OUTPUT,
    LOW,
    MOST_CHANGE,
    PREVIOUS_INPUT,
    PROPORTIONAL,
    SECTIONS,
    SETPOINT_WEIGHT,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import (
    absolute,
    bits,
    broadcast,
    load,
    offset_pointer,
    store,
    where,
)

_BIG = float(np.finfo(np.float64).max)
#: with signals below the first, coefficients below the second and poles at most 1, sums over all samples are finite
_LARGE, _LARGE_COEFFICIENT = 1e150, 1e100

_inlined: Any = njit(forceinline=True, error_model="numpy")
_compiled: Any = njit(error_model="numpy")


@_inlined
def is_finite(x):
    """The mask of the finite lanes."""
    return absolute(x) <= broadcast(_BIG)


@_inlined
def is_tiny(x):
    """The mask of the lanes below the threshold, whose states would end as subnormal numbers."""
    return absolute(x) < broadcast(FLUSH_BELOW)


@_inlined
def flushed(x):
    """0 in place of tiny states."""
    return where(is_tiny(x), broadcast(0.0), x)


@_inlined
def store_maximum(s, row, value):
    """Store the larger of a row and a value."""
    before = load(s, row)
    store(s, row, where(value > before, value, before))


@_inlined
def store_where(s, row, some, value):
    """Store a value in some lanes."""
    store(s, row, where(some, value, load(s, row)))


@_inlined
def all_small(e, d, u, rate):
    """Whether all signals of the sample are far from overflow (e contains y; d and u contain v)."""
    return bits(absolute(e) + absolute(d) + absolute(u) + absolute(rate) <= broadcast(_LARGE)) == ALL_LANES


@_compiled
def any_large_coefficient(controllers, sections):
    """Whether every number must be checked for overflow because a coefficient is large."""
    found, end = False, SECTIONS + 3 * sections
    for mode in range(controllers.shape[0]):
        for row in range(controllers.shape[1]):
            most = 1.0 if SECTIONS <= row < end and (row - SECTIONS) % 3 == 0 else _LARGE_COEFFICIENT
            # those of limits may be infinite
            limit = row in (LOW, HIGH, MOST_CHANGE, FLOOR, HOLD_BELOW)
            found |= not limit and not abs(controllers[mode, row]) <= most
    return found


@_inlined
def any_large_input(s):
    """Whether a block must check every number because the input before its first sample is large."""
    return bits(absolute(load(s, PREVIOUS_INPUT)) <= broadcast(_LARGE)) != ALL_LANES


@_inlined
def resolve_mode(c, other, second):
    """(c, other) for `coefficient`:  where all lanes have one mode, as most often, `other` is 0: nothing to select."""
    word = bits(second)
    if word == ALL_LANES:
        return offset_pointer(c, other), 0
    return c, other if word != 0 else 0


@_inlined
def coefficient(c, row, other, second):
    """A coefficient in every lane; `other` is the offset of the second mode's, 0 where there is one mode."""
    if other == 0:
        return broadcast(c[row])
    return where(second, broadcast(c[other + row]), broadcast(c[row]))


@_inlined
def saturate(c, other, second, value):
    """A value within the limits."""
    low, high = coefficient(c, LOW, other, second), coefficient(c, HIGH, other, second)
    value = where(value < low, low, value)
    return where(value > high, high, value)


@_inlined
def followed(c, other, second, value, last):
    """What the output comes to on its way from the last one to a value within the limits."""
    most, change = coefficient(c, MOST_CHANGE, other, second), value - last
    value = where(change > most, last + most, value)
    return where(change < broadcast(0.0) - most, last - most, value)


@_inlined
def start_at_rest(s, c, other, second, offsets, settings, y):
    """The states before the first sample, at rest at its measurement; a lane that holds it is new at the next one."""
    new, states = load(s, IS_NEW) > broadcast(0.5), offsets.active
    if bits(new) != 0:
        for j in range(settings.derivatives):
            store_where(s, offsets.filtered + j * WIDTH, new, y)
        for j in range(settings.filter_order):
            store_where(s, offsets.lagged + j * WIDTH, new, y if j == 0 else broadcast(0.0))
        if settings.weighted and settings.sections > 0:
            offset = coefficient(c, PROPORTIONAL, other, second) * (
                coefficient(c, SETPOINT_WEIGHT, other, second) * y - y
            )
            integrates = coefficient(c, INTEGRATES, other, second) > broadcast(0.5)
            store_where(s, states, new & integrates, load(s, LAST_OUTPUT) - offset)


@_inlined
def on_error(c, other, second, fed, e, r, change):
    """direct e, and the feed-forward of the setpoint r that changed since the last sample."""
    v = coefficient(c, DIRECT, other, second) * e
    if fed:
        static = coefficient(c, FED_STATIC, other, second) * broadcast(r)
        v = v + (static + coefficient(c, FED_CHANGE, other, second) * broadcast(change))
    return v


@_inlined
def without_memory(s, c, other, second, offsets, settings, r, change, y, e):
    """The terms of v before the sections' states."""
    v = on_error(c, other, second, settings.fed, e, r, change)
    if settings.weighted:
        weighted = coefficient(c, SETPOINT_WEIGHT, other, second) * broadcast(r) - y
        v = coefficient(c, PROPORTIONAL, other, second) * weighted + v
    return derived(s, c, other, second, offsets.filtered, settings, y, v)


@_inlined
def derived(s, c, other, second, filtered, settings, y, v):
    """The terms of a derivative, taken off v one by one."""
    row = SECTIONS + 3 * settings.sections
    for j in range(settings.derivatives):
        gain = coefficient(c, row + 2 * j, other, second)
        v = v - gain * (y - load(s, filtered + j * WIDTH))
    return v


@_inlined
def filter_measurement(s, c, other, second, filtered, new, settings, y):
    """Store the measurements behind the derivative's lags after a sample."""
    row = SECTIONS + 3 * settings.sections + 1
    for j in range(settings.derivatives):
        m = load(s, filtered + j * WIDTH)
        store(s, new + j * WIDTH, m + coefficient(c, row + 2 * j, other, second) * (y - m))


@_inlined
def settle(s, filtered, settings, y):
    """`flushed` of those measurements in lanes at rest."""
    resting = is_tiny(y)
    if bits(resting) != 0:
        for j in range(settings.derivatives):
            m = load(s, filtered + j * WIDTH)
            store(s, filtered + j * WIDTH, where(resting & is_tiny(m), broadcast(0.0), m))


@_inlined
def filtered(s, c, other, second, offsets, settings, y):
    """The measurement behind its filter; what that remembers after the sample is stored in the spare rows."""
    row = SECTIONS + 3 * settings.sections + 2 * settings.derivatives
    m, resting = load(s, offsets.lagged), is_tiny(y)
    p = coefficient(c, row, other, second) * (y - m)
    if settings.filter_order > 1:
        q = load(s, offsets.lagged + WIDTH)
        h = p - coefficient(c, row + 1, other, second) * q
        p = q + h
        store(s, offsets.spare_lagged + WIDTH, p + h)
    f = m + p
    store(s, offsets.spare_lagged, f + p)
    if bits(resting) != 0:
        for j in range(settings.filter_order):
            x = load(s, offsets.spare_lagged + j * WIDTH)
            store(s, offsets.spare_lagged + j * WIDTH, where(resting & is_tiny(x), broadcast(0.0), x))
    return f


@_inlined
def demand(s, states, sections, first):
    """v = first + x_0 + x_1 + ..."""
    v = first
    for i in range(sections):
        v = v + load(s, states + i * WIDTH)
    return v


@_inlined
def next_state(s, c, other, second, state, i, e, d, limited=True):
    """p (x + w d) + r e, flushed in lanes at rest; elsewhere the test of e is all it costs.

    Without `limited` d is 0 in every lane, and its term left out.
    """
    row, x = SECTIONS + 3 * i, load(s, state)
    if limited:
        x = x + coefficient(c, row + 1, other, second) * d
    x = coefficient(c, row, other, second) * x + coefficient(c, row + 2, other, second) * e
    resting = is_tiny(e)
    if bits(resting) != 0:
        x = where(resting & is_tiny(x), broadcast(0.0), x)
    return x


@_inlined
def update_states(s, c, other, second, states, new, sections):
    """The states after the last sample, from its error and excess u - v."""
    e, d = load(s, LAST_ERROR), load(s, EXCESS)
    for i in range(sections):
        store(s, new + i * WIDTH, next_state(s, c, other, second, states + i * WIDTH, i, e, d))


@_inlined
def update_and_demand(s, c, other, second, states, sections, first):
    """`update_states` and the next sample's `demand` in one pass over the sections."""
    before, d = load(s, LAST_ERROR), load(s, EXCESS)
    v = first
    if bits(d != broadcast(0.0)) == 0:
        for i in range(sections):
            x = next_state(s, c, other, second, states + i * WIDTH, i, before, d, False)
            store(s, states + i * WIDTH, x)
            v = v + x
    else:
        for i in range(sections):
            x = next_state(s, c, other, second, states + i * WIDTH, i, before, d)
            store(s, states + i * WIDTH, x)
            v = v + x
    return v


@_inlined
def update_checked(s, c, other, second, offsets, settings, y, v, u):
    """`update_states`, and the output; where a number is not finite, states and output are held."""
    good, states, spare = is_finite(load(s, LAST_ERROR)) & is_finite(v), offsets.active, offsets.spare
    if settings.coasts:
        good = good & (load(s, COASTING) < broadcast(0.5))
    filter_measurement(s, c, other, second, offsets.filtered, offsets.spare_filtered, settings, y)
    settle(s, offsets.spare_filtered, settings, y)
    update_states(s, c, other, second, states, spare, settings.sections)
    for i in range(settings.sections):
        good = good & is_finite(load(s, spare + i * WIDTH))
    for j in range(settings.derivatives):
        good = good & is_finite(load(s, offsets.spare_filtered + j * WIDTH))
    for j in range(settings.filter_order):
        good = good & is_finite(load(s, offsets.spare_lagged + j * WIDTH))
    for i in range(settings.sections):
        store_where(s, states + i * WIDTH, good, load(s, spare + i * WIDTH))
    for j in range(settings.derivatives):
        store_where(s, offsets.filtered + j * WIDTH, good, load(s, offsets.spare_filtered + j * WIDTH))
    for j in range(settings.filter_order):
        store_where(s, offsets.lagged + j * WIDTH, good, load(s, offsets.spare_lagged + j * WIDTH))
    if settings.starts_at_first_sample:
        store_where(s, IS_NEW, good, broadcast(0.0))
    return where(good, u, load(s, LAST_OUTPUT))


@_inlined
def update_measured(s, c, other, second, offsets, settings, y):
    """What is remembered of the measurement, where nothing can overflow."""
    filter_measurement(s, c, other, second, offsets.filtered, offsets.filtered, settings, y)
    settle(s, offsets.filtered, settings, y)
    for j in range(settings.filter_order):
        store(s, offsets.lagged + j * WIDTH, load(s, offsets.spare_lagged + j * WIDTH))
    if settings.starts_at_first_sample:
        store(s, IS_NEW, broadcast(0.0))
