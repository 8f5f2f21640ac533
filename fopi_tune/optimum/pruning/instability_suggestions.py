"""Suggestions of instability, from the exact crossovers of the loops at the boxes' centres.

The loop stays unstable while L stays away from -1, or while every b = 180 deg + arg L stays within its turn.  As in
`fopi_tune.optimum.pruning.screen`, these are suggestions, not proofs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.stability import unstable_poles_from
from fopi_tune.optimum.pruning.central_loops import CentralLoops, Movements, Suggestion
from fopi_tune.optimum.pruning.exclusion import Reason

#: width of a bracket relative to the crossover's movement
_WIDTH = 1.3
_LEAST_COVER, _WIDEST = 1e-4, 3.0
_MOST_BRACKETS = 3
#: distance of L from -1 at the crossovers, as a multiple of its change, from which a bound of |S| is tried
_APART = 3.0
#: part of the first order's room for b that is counted on
_PART = 0.6
_TINY = 1e-300


def unstable(at: CentralLoops, moves: Movements, k: int, delay_s: float) -> Iterator[Suggestion]:
    """Suggest that a plant behind more dead time is unstable for every controller of a box.

    Args:
        at: the loops.
        moves: of all of their gain crossovers.
        k: place of the condition in question.
        delay_s: the additional dead time, s.
    """
    found, rows = moves.found, len(at.loops)
    plants = replace(at.loops.plants, dead_time_s=at.loops.plants.dead_time_s + delay_s)
    crossings = replace(found, phase_rad=found.phase_rad - delay_s * found.omega_rad_s)
    poles = unstable_poles_from(replace(at.loops, plants=plants), crossings)
    is_unstable = (poles > 0.5) & np.isfinite(poles)
    count = np.bincount(found.row, minlength=rows)

    b, angle = crossings.angle_from_minus_one_rad, moves.angle(delay_s)
    # to the next turn: b rises to it where |L| falls, and falls to it where |L| rises; a pair of poles leaves at each
    room = np.mod(np.where(moves.along.real < 0.0, -b, b), 2.0 * np.pi)
    more = np.where(count == 1, np.ceil(0.5 * np.clip(poles, 1.0, 100.0)) - 1.0, 0.0)
    room = _PART * (room + 2.0 * np.pi * more[found.row])
    turns = _least(found.row, room / (np.abs(angle).sum(axis=1) + _TINY), rows)
    turns = np.where(is_unstable & (count > 0) & (count <= _MOST_BRACKETS), turns, -np.inf)
    yield from _by_crossovers(at, moves, k, turns, angle)

    apart = _least(found.row, 2.0 * np.abs(np.sin(0.5 * b)) / (moves.size + _TINY), rows)
    apart = np.where(is_unstable, apart, 0.0).reshape(-1, len(at.points))
    for row in np.flatnonzero(apart.max(axis=1) > _APART):
        yield Suggestion(int(row), 0.0, -1, Reason(k, at.points[int(np.argmax(apart[row]))]))


def _by_crossovers(at: CentralLoops, moves: Movements, k: int, ratio: Array, angle: Array) -> Iterator[Suggestion]:
    found, m = moves.found, len(at.points)
    width = np.maximum(_WIDTH * moves.of_gain_crossovers, _LEAST_COVER)
    best = np.argmax(ratio.reshape(-1, m), axis=1) + m * np.arange(len(at.boxes))
    first, last = np.searchsorted(found.row, best), np.searchsorted(found.row, best, side="right")
    for box, (row, start, stop) in enumerate(zip(best.tolist(), first.tolist(), last.tolist(), strict=True)):
        u, reach = found.u[start:stop], width[start:stop]
        if not ratio[row] > 0.0 or not reach.max() < _WIDEST:
            continue
        # brackets that overlap are one
        apart = np.flatnonzero(u[1:] - reach[1:] > np.maximum.accumulate(u + reach)[:-1])
        ends = np.stack([(u - reach)[[0, *(apart + 1)]], np.maximum.accumulate(u + reach)[[*apart, -1]]], axis=1)
        axis = int(np.argmax(np.abs(angle[start:stop]).max(axis=0)))
        omega = tuple(at.problem.frequencies_rad_s(ends.ravel()).tolist())
        yield Suggestion(box, float(ratio[row]), axis, Reason(k, at.points[row % m], omega))


def _least(row: Rows, values: Array, rows: int) -> Array:
    """The smallest value of each row, inf without any."""
    least = np.full(rows, np.inf)
    np.minimum.at(least, row, values)
    return least
