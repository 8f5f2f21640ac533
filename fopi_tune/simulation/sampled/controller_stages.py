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
    CHATTER,
    DIRECT,
    EXCESS,
    HIGH,
    INTEGRATES,
    JUMPED,
    LAST,
    LONGEST,
    LOW,
    MODE,
    OTHER_LAST,
    RECENT,
    RESET,
    RUN,
    SECTIONS,
    SEEN,
    START,
    SWITCHES,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import behind, bits, lanes, load, size, spread, store, where

_BIG = float(np.finfo(np.float64).max)
_ALL = 2**WIDTH - 1
#: where no signal is beyond the first, no coefficient beyond the second and no pole beyond 1, a sum of as many samples
#: as there can be is finite
_LARGE, _LARGE_COEFFICIENT = 1e150, 1e100

_inlined: Any = njit(forceinline=True, error_model="numpy")
_apart: Any = njit(error_model="numpy")


@_inlined
def fine(x):
    """The lanes that are finite."""
    return size(x) <= spread(_BIG)


@_inlined
def keep_larger(s, row, value):
    """A row becomes the larger one of what it is and a value."""
    before = load(s, row)
    store(s, row, where(value > before, value, before))


@_inlined
def _change(s, row, some, value):
    store(s, row, where(some, value, load(s, row)))


@_inlined
def small(e, d, u, rate):
    """Whether all signals of the sample are far from overflowing (y is in e, and v in d or u)."""
    return bits(size(e) + size(d) + size(u) + size(rate) <= spread(_LARGE)) == _ALL


@_apart
def large(table, controllers, block):
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
def controllers_of(c, other, second):
    """(c, other) of `of_mode`:  where all lanes have the same mode, as most often, nothing is left to select."""
    word = bits(second)
    if word == _ALL:
        return behind(c, other), 0
    return c, other if word != 0 else 0


@_inlined
def of_mode(c, row, other, second):
    """A controller's number in every lane; `other` is where the second mode's begin, 0 where there is one mode."""
    if other == 0:
        return spread(c[row])
    return where(second, spread(c[other + row]), spread(c[row]))


@_inlined
def limited(c, other, second, value):
    """A value within the limits."""
    low, high = of_mode(c, LOW, other, second), of_mode(c, HIGH, other, second)
    value = where(value < low, low, value)
    return where(value > high, high, value)


@_inlined
def demand(s, c, other, second, states, sections, e):
    """v = direct e + x_0 + x_1 + ..."""
    v = of_mode(c, DIRECT, other, second) * e
    for i in range(sections):
        v = v + load(s, states + i * WIDTH)
    return v


@_inlined
def _followed(s, c, other, second, state, i, e, d):
    """p (x + w d) + r e."""
    row = SECTIONS + 3 * i
    x = of_mode(c, row, other, second) * (load(s, state) + of_mode(c, row + 1, other, second) * d)
    return x + of_mode(c, row + 2, other, second) * e


@_inlined
def follow(s, c, other, second, states, new, sections):
    """The states after the last sample."""
    e, d = load(s, SEEN), load(s, EXCESS)
    for i in range(sections):
        store(s, new + i * WIDTH, _followed(s, c, other, second, states + i * WIDTH, i, e, d))


@_inlined
def follow_and_demand(s, c, other, second, states, sections, e):
    """`follow` and the next sample's `demand` at once: the sum waits, section by section, for nothing else."""
    before, d = load(s, SEEN), load(s, EXCESS)
    v = of_mode(c, DIRECT, other, second) * e
    for i in range(sections):
        x = _followed(s, c, other, second, states + i * WIDTH, i, before, d)
        store(s, states + i * WIDTH, x)
        v = v + x
    return v


@_inlined
def follow_carefully(s, c, other, second, states, spare, sections, v, u):
    """`follow`, and the output; where a number is not finite the states as they were, and the last output."""
    good = fine(load(s, SEEN)) & fine(v)
    follow(s, c, other, second, states, spare, sections)
    for i in range(sections):
        good = good & fine(load(s, spare + i * WIDTH))
    for i in range(sections):
        store(s, states + i * WIDTH, where(good, load(s, spare + i * WIDTH), load(s, states + i * WIDTH)))
    return where(good, u, load(s, LAST))


@_inlined
def follow_applied(s, c, other, second, old, new, sections, e, applied):
    """One sample of the other controller."""
    v = demand(s, c, other, second, old, sections, e)
    rest, total = of_mode(c, DIRECT, other, second) * e, applied + v
    for i in range(1, sections):
        x = of_mode(c, SECTIONS + 3 * i, other, second) * load(s, old + i * WIDTH)
        store(s, new + i * WIDTH, x)
        rest, total = rest + x, total + x
    u = limited(c, other, second, applied)
    if sections > 0:
        x = of_mode(c, SECTIONS, other, second) * load(s, old)
        x = where(of_mode(c, INTEGRATES, other, second) > spread(0.5), u - rest, x)
        store(s, new, x)
        total = total + x
    if bits(fine(total)) != _ALL:
        good = fine(e) & fine(v) & fine(applied)
        for i in range(sections):
            good = good & fine(load(s, new + i * WIDTH))
        for i in range(sections):
            store(s, new + i * WIDTH, where(good, load(s, new + i * WIDTH), load(s, old + i * WIDTH)))
        u = where(good, u, load(s, OTHER_LAST))
    store(s, OTHER_LAST, u)


@_inlined
def edges(s, measured, reference, half_width):
    """The lanes that meet the edge of the hysteresis: from mode 1 to 2, and from 2 to 1."""
    mode = load(s, MODE)
    up = (mode < spread(0.5)) & (measured >= spread(reference + half_width))
    return up, (mode > spread(0.5)) & (measured <= spread(reference - half_width))


@_inlined
def forget(s, jumps, k, window):
    """The jumps that are no longer within the window."""
    jumps[k] = 0
    if k > window and jumps[k - window - 1] != 0:
        store(s, RECENT, load(s, RECENT) - where(lanes(jumps[k - window - 1]), spread(1.0), spread(0.0)))


@_inlined
def switch_and_demand(s, jumps, k, c, other, up, down, states, others, settings, behind, e):
    """`follow` where it is due, lanes change their mode, and `demand`."""
    before, jumping = load(s, MODE) > spread(0.5), up | down
    mode = where(up, spread(1.0), where(down, spread(0.0), load(s, MODE)))
    second = mode > spread(0.5)
    own, select = controllers_of(c, other, before)
    new, choose = controllers_of(c, other, second)
    start, last = of_mode(new, START, choose, second), load(s, LAST)
    entered = start if settings.inactive == RESET else load(s, OTHER_LAST)
    store(s, OTHER_LAST, where(jumping, last, load(s, OTHER_LAST)))
    store(s, LAST, where(jumping, entered, last))
    store(s, MODE, mode)
    _change(s, APPLIED, jumping, limited(new, choose, second, load(s, APPLIED)))
    seen, d = load(s, SEEN), load(s, EXCESS)
    v = of_mode(new, DIRECT, choose, second) * e
    for i in range(settings.sections):
        one, two = states + i * WIDTH, others + i * WIDTH
        x, held = load(s, one), load(s, two)
        if behind:
            x = _followed(s, own, select, before, one, i, seen, d)
        # LLVM may make this one a store under a mask, which is slow to be read; the other one is read soon
        store(s, two, where(jumping, x, held))
        if settings.inactive == RESET:
            held = start * of_mode(new, INTEGRATES, choose, second) if i == 0 else spread(0.0)
        x = where(jumping, held, x)
        store(s, one, x)
        v = v + x
    jumps[k] = bits(jumping)
    _count(s, k, jumping, settings.most_switches)
    return v


@_inlined
def _count(s, k, jumping, most):
    """Jumps, runs of them, and too many of them within the window."""
    now = spread(float(k))
    run = where(load(s, JUMPED) >= now - spread(1.0), load(s, RUN) + spread(1.0), spread(1.0))
    _change(s, RUN, jumping, run)
    keep_larger(s, LONGEST, load(s, RUN))
    _change(s, JUMPED, jumping, now)
    one = spread(1.0)
    _change(s, SWITCHES, jumping, load(s, SWITCHES) + one)
    _change(s, RECENT, jumping, load(s, RECENT) + one)
    store(s, CHATTER, where(load(s, RECENT) > spread(float(most)), one, load(s, CHATTER)))
