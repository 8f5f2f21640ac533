"""Every |L| = e^level or every arg L = -180 deg (mod 360) of many loops, by the bisection of `core/roots` (compiled).

Cells are examined as there, one loop after the other: the same cells, the same roots.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.compiled.blocks import BLOCK, FEWEST, GAIN, OF_GAIN, OF_PHASE, PHASE, SLOPE, TURN, loop_block
from fopi_tune.core.compiled.loops import entry, inner, loop_at
from fopi_tune.core.roots import (
    FIRST_CELLS,
    FLAT,
    FLAT_WIDTH,
    LAST_STEP,
    MOST_CELLS,
    ROUNDING,
    SMALLEST_WIDTH,
    TOUCH,
    WIDER,
)

#: cells of one loop that are examined together at first
_CELLS = 256
_NEWTON_STEPS = 100


@inner
def _value(is_phase, terms, direct, r, u, h, level):
    """Value, slope and bound of the curvature of ln|L| - level or of arg L + 180 deg."""
    gain, phase, slope, turn, of_gain, of_phase = loop_at(terms, direct, r, u, h)
    if is_phase:
        return phase + math.pi, turn, of_phase
    return gain - level, slope, of_gain


@inner
def _polished(is_phase, terms, direct, r, a, b, rising, level, target):
    """Newton's method safeguarded by bisection, as `roots._polish`."""
    u, before = 0.5 * (a + b), np.inf
    for _ in range(_NEWTON_STEPS):
        value, slope, _ = _value(is_phase, terms, direct, r, u, 0.0, level)
        value -= target
        if (value >= 0.0) == rising:
            b = u
        else:
            a = u
        step = 0.0 if value == 0.0 else -value / slope
        size, resolution = abs(step), 4e-16 * max(1.0, abs(u))
        if min(size, b - a) <= resolution or (size <= LAST_STEP and size > 0.25 * before):
            break
        inside = u + step > a - resolution and u + step < b + resolution
        u = u + step if inside else 0.5 * (a + b)
        before = size if inside else np.inf
    return u


@inner
def _kept(found, count, r, u, touching):
    """Write a root; returns the array, longer where it was full, and the new number."""
    if count == len(found):
        longer = np.empty((2 * count, 3))
        longer[:count] = found
        found = longer
    found[count, 0], found[count, 1], found[count, 2] = r, u, touching
    return found, count + 1


@inner
def _examine(is_phase, terms, direct, r, cells, count, level, found):
    """Write value, slope and bound of the curvature of the first cells, those of a block together."""
    for begin in range(0, count, BLOCK):
        n = min(BLOCK, count - begin)
        if n < FEWEST:
            for i in range(begin, begin + n):
                u, h = 0.5 * (cells[i, 0] + cells[i, 1]), 0.5 * (cells[i, 1] - cells[i, 0])
                found[i, 0], found[i, 1], found[i, 2] = _value(is_phase, terms, direct, r, u, h, level)
            continue
        s = loop_block(terms, direct, r, cells[begin:, 0], cells[begin:, 1], n, is_phase)
        for i in range(n):
            if is_phase:
                found[begin + i, 0] = s[PHASE, i] + math.pi
                found[begin + i, 1], found[begin + i, 2] = s[TURN, i], s[OF_PHASE, i]
            else:
                found[begin + i, 0] = s[GAIN, i] - level
                found[begin + i, 1], found[begin + i, 2] = s[SLOPE, i], s[OF_GAIN, i]


@entry
def loop_roots(is_phase, terms, direct, levels, rows, low, high):
    """Roots of ln|L| - level, or of arg L + 180 deg modulo 360 deg.

    Args:
        is_phase: which.
        terms, direct: of m loops.
        levels: shape (m,), in neper.
        rows, low, high: shape (n,), loops and the intervals of u in which roots are searched for.

    Returns:
        Whether all could be listed, and (loop, u, 1 where it only touches), shape (k, 3), not sorted.
    """
    found, count, work = np.empty((4 * len(rows) + 16, 3)), 0, 0
    cells, halves, numbers, period = (
        np.empty((_CELLS, 2)),
        np.empty((_CELLS, 2)),
        np.empty((_CELLS, 3)),
        2.0 * math.pi,
    )
    for i in range(len(rows)):
        r, level = rows[i], levels[rows[i]]
        here = FIRST_CELLS
        for k in range(here):
            cells[k, 0] = low[i] + (high[i] - low[i]) * (k / here)
            cells[k, 1] = low[i] + (high[i] - low[i]) * ((k + 1) / here) if k < here - 1 else high[i]
        while here > 0:
            work += here
            if work > MOST_CELLS:
                return False, found[:count]
            if 2 * here > len(halves):
                halves, numbers = np.empty((4 * here, 2)), np.empty((4 * here, 3))
            _examine(is_phase, terms, direct, r, cells, here, level, numbers)
            left = 0
            for k in range(here):
                a, b = cells[k, 0], cells[k, 1]
                c, h = 0.5 * (a + b), 0.5 * (b - a)
                value, slope, bound = numbers[k, 0], numbers[k, 1], numbers[k, 2]
                reach = abs(slope) * h + 0.5 * bound * h * h
                distance = abs(value - period * np.round(value / period)) if is_phase else abs(value)
                if not (distance <= reach * WIDER + ROUNDING and (distance + reach > FLAT or h < FLAT_WIDTH)):
                    continue
                if abs(slope) <= bound * h or math.isnan(bound):
                    if h >= SMALLEST_WIDTH:
                        halves[left, 0], halves[left, 1], halves[left + 1, 0], halves[left + 1, 1] = a, c, c, b
                        left += 2
                        continue
                    if distance < TOUCH:
                        found, count = _kept(found, count, r, c, 1.0)
                        continue
                at_a, _, _ = _value(is_phase, terms, direct, r, a, 0.0, level)
                at_b, _, _ = _value(is_phase, terms, direct, r, b, 0.0, level)
                if not is_phase:
                    if (at_a >= 0.0) != (at_b >= 0.0):
                        u = _polished(is_phase, terms, direct, r, a, b, at_a < at_b, level, 0.0)
                        found, count = _kept(found, count, r, u, 0.0)
                    continue
                # half-open at the upper value on both sides, so that neighbours count a root on their edge once
                below, above = np.ceil(min(at_a, at_b) / period), np.ceil(max(at_a, at_b) / period)
                if not above - below < MOST_CELLS - count:
                    return False, found[:count]
                for turn in range(int(max(above - below, 0.0))):
                    target = (below + turn) * period
                    u = _polished(is_phase, terms, direct, r, a, b, at_a < at_b, level, target)
                    found, count = _kept(found, count, r, u, 0.0)
            cells, halves, here = halves, cells, left
    return True, found[:count]
