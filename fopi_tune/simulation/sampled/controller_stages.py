"""The controllers of `WIDTH` plants in stages, switching included:  rows of scratch -> rows.

The formulas and the order of the operations are those of `fopi_tune.digital.runtime`, bit for bit.  A lane selects the
numbers of its mode; where all lanes have the same one nothing is selected.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled.layout import (
    APPLIED,
    CHATTERING,
    DIRECT,
    EXCESS,
    HIGH,
    INTEGRATES,
    LAST_ERROR,
    LAST_OUTPUT,
    LAST_SWITCH,
    LONGEST_RUN,
    LOW,
    MODE,
    OTHER_LAST_OUTPUT,
    RECENT_SWITCHES,
    RESET,
    RUN,
    SECTIONS,
    START,
    SWITCHES,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import (
    absolute,
    bits,
    broadcast,
    load,
    mask_from_bits,
    offset_pointer,
    store,
    where,
)

_BIG = float(np.finfo(np.float64).max)
_ALL = 2**WIDTH - 1
#: where no signal is beyond the first, no coefficient beyond the second and no pole beyond 1, a sum of as many samples
#: as there can be is finite
_LARGE, _LARGE_COEFFICIENT = 1e150, 1e100

_inlined: Any = njit(forceinline=True, error_model="numpy")
_compiled: Any = njit(error_model="numpy")


@_inlined
def is_finite(x):
    """The lanes that are finite."""
    return absolute(x) <= broadcast(_BIG)


@_inlined
def store_maximum(s, row, value):
    """A row becomes the larger one of what it is and a value."""
    before = load(s, row)
    store(s, row, where(value > before, value, before))


@_inlined
def _store_where(s, row, some, value):
    store(s, row, where(some, value, load(s, row)))


@_inlined
def all_small(e, d, u, rate):
    """Whether all signals of the sample are far from overflowing (y is in e, and v in d or u)."""
    return bits(absolute(e) + absolute(d) + absolute(u) + absolute(rate) <= broadcast(_LARGE)) == _ALL


@_compiled
def any_large(table, controllers, block):
    """Whether a block has to look at every number: its controllers' are large, or its first inputs."""
    found = False
    for mode in range(controllers.shape[0]):
        for row in range(controllers.shape[1]):
            most = 1.0 if row >= SECTIONS and (row - SECTIONS) % 3 == 0 else _LARGE_COEFFICIENT
            found |= row != LOW and row != HIGH and not abs(controllers[mode, row]) <= most
    for lane in range(WIDTH):
        found |= not abs(table[0, block * WIDTH + lane]) <= _LARGE
    return found


@_inlined
def resolve_mode(c, other, second):
    """(c, other) of `of_mode`:  where all lanes have the same mode, as most often, nothing is left to select."""
    word = bits(second)
    if word == _ALL:
        return offset_pointer(c, other), 0
    return c, other if word != 0 else 0


@_inlined
def coefficient(c, row, other, second):
    """A controller's number in every lane; `other` is where the second mode's begin, 0 where there is one mode."""
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
def demand(s, c, other, second, states, sections, e):
    """v = direct e + x_0 + x_1 + ..."""
    v = coefficient(c, DIRECT, other, second) * e
    for i in range(sections):
        v = v + load(s, states + i * WIDTH)
    return v


@_inlined
def _next_state(s, c, other, second, state, i, e, d):
    """p (x + w d) + r e."""
    row = SECTIONS + 3 * i
    x = coefficient(c, row, other, second) * (load(s, state) + coefficient(c, row + 1, other, second) * d)
    return x + coefficient(c, row + 2, other, second) * e


@_inlined
def update_states(s, c, other, second, states, new, sections):
    """The states after the last sample."""
    e, d = load(s, LAST_ERROR), load(s, EXCESS)
    for i in range(sections):
        store(s, new + i * WIDTH, _next_state(s, c, other, second, states + i * WIDTH, i, e, d))


@_inlined
def update_and_demand(s, c, other, second, states, sections, e):
    """`follow` and the next sample's `demand` at once: the sum waits, section by section, for nothing else."""
    before, d = load(s, LAST_ERROR), load(s, EXCESS)
    v = coefficient(c, DIRECT, other, second) * e
    for i in range(sections):
        x = _next_state(s, c, other, second, states + i * WIDTH, i, before, d)
        store(s, states + i * WIDTH, x)
        v = v + x
    return v


@_inlined
def update_checked(s, c, other, second, states, spare, sections, v, u):
    """`follow`, and the output; where a number is not finite the states as they were, and the last output."""
    good = is_finite(load(s, LAST_ERROR)) & is_finite(v)
    update_states(s, c, other, second, states, spare, sections)
    for i in range(sections):
        good = good & is_finite(load(s, spare + i * WIDTH))
    for i in range(sections):
        store(s, states + i * WIDTH, where(good, load(s, spare + i * WIDTH), load(s, states + i * WIDTH)))
    return where(good, u, load(s, LAST_OUTPUT))


@_inlined
def track_applied(s, c, other, second, old, new, sections, e, applied):
    """One sample of the other controller."""
    v = demand(s, c, other, second, old, sections, e)
    rest, total = coefficient(c, DIRECT, other, second) * e, applied + v
    for i in range(1, sections):
        x = coefficient(c, SECTIONS + 3 * i, other, second) * load(s, old + i * WIDTH)
        store(s, new + i * WIDTH, x)
        rest, total = rest + x, total + x
    u = saturate(c, other, second, applied)
    if sections > 0:
        x = coefficient(c, SECTIONS, other, second) * load(s, old)
        x = where(coefficient(c, INTEGRATES, other, second) > broadcast(0.5), u - rest, x)
        store(s, new, x)
        total = total + x
    if bits(is_finite(total)) != _ALL:
        good = is_finite(e) & is_finite(v) & is_finite(applied)
        for i in range(sections):
            good = good & is_finite(load(s, new + i * WIDTH))
        for i in range(sections):
            store(s, new + i * WIDTH, where(good, load(s, new + i * WIDTH), load(s, old + i * WIDTH)))
        u = where(good, u, load(s, OTHER_LAST_OUTPUT))
    store(s, OTHER_LAST_OUTPUT, u)


@_inlined
def hysteresis_crossings(s, measured, reference, half_width):
    """The lanes that meet the edge of the hysteresis: from mode 1 to 2, and from 2 to 1."""
    mode = load(s, MODE)
    up = (mode < broadcast(0.5)) & (measured >= broadcast(reference + half_width))
    return up, (mode > broadcast(0.5)) & (measured <= broadcast(reference - half_width))


@_inlined
def expire_switches(s, jumps, k, window):
    """The jumps that are no longer within the window."""
    jumps[k] = 0
    if k > window and jumps[k - window - 1] != 0:
        store(
            s,
            RECENT_SWITCHES,
            load(s, RECENT_SWITCHES) - where(mask_from_bits(jumps[k - window - 1]), broadcast(1.0), broadcast(0.0)),
        )


@_inlined
def switch_and_demand(s, jumps, k, c, other, up, down, states, others, settings, offset_pointer, e):
    """`follow` where it is due, lanes change their mode, and `demand`."""
    before, jumping = load(s, MODE) > broadcast(0.5), up | down
    mode = where(up, broadcast(1.0), where(down, broadcast(0.0), load(s, MODE)))
    second = mode > broadcast(0.5)
    own, select = resolve_mode(c, other, before)
    new, choose = resolve_mode(c, other, second)
    start, last = coefficient(new, START, choose, second), load(s, LAST_OUTPUT)
    entered = start if settings.inactive == RESET else load(s, OTHER_LAST_OUTPUT)
    store(s, OTHER_LAST_OUTPUT, where(jumping, last, load(s, OTHER_LAST_OUTPUT)))
    store(s, LAST_OUTPUT, where(jumping, entered, last))
    store(s, MODE, mode)
    _store_where(s, APPLIED, jumping, saturate(new, choose, second, load(s, APPLIED)))
    seen, d = load(s, LAST_ERROR), load(s, EXCESS)
    v = coefficient(new, DIRECT, choose, second) * e
    for i in range(settings.sections):
        one, two = states + i * WIDTH, others + i * WIDTH
        x, held = load(s, one), load(s, two)
        if offset_pointer:
            x = _next_state(s, own, select, before, one, i, seen, d)
        # LLVM may make this one a store under a mask, which is slow to be read; the other one is read soon
        store(s, two, where(jumping, x, held))
        if settings.inactive == RESET:
            held = start * coefficient(new, INTEGRATES, choose, second) if i == 0 else broadcast(0.0)
        x = where(jumping, held, x)
        store(s, one, x)
        v = v + x
    jumps[k] = bits(jumping)
    _count_switches(s, k, jumping, settings.most_switches)
    return v


@_inlined
def _count_switches(s, k, jumping, most):
    """Jumps, runs of them, and too many of them within the window."""
    now = broadcast(float(k))
    run = where(load(s, LAST_SWITCH) >= now - broadcast(1.0), load(s, RUN) + broadcast(1.0), broadcast(1.0))
    _store_where(s, RUN, jumping, run)
    store_maximum(s, LONGEST_RUN, load(s, RUN))
    _store_where(s, LAST_SWITCH, jumping, now)
    one = broadcast(1.0)
    _store_where(s, SWITCHES, jumping, load(s, SWITCHES) + one)
    _store_where(s, RECENT_SWITCHES, jumping, load(s, RECENT_SWITCHES) + one)
    store(s, CHATTERING, where(load(s, RECENT_SWITCHES) > broadcast(float(most)), one, load(s, CHATTERING)))
