"""Suggestions from crossovers:  reasons to discard a box, from the exact crossovers of the loop at its centre.

As in `fopi_tune.optimum.pruning.screen`, these are suggestions, not proofs.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.errors import DomainError
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.central_loops import CentralLoops, Movements, Suggestion
from fopi_tune.optimum.pruning.conditions import Condition, Test
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.pruning.instability_suggestions import unstable
from fopi_tune.optimum.pruning.screen import Boxes

#: width of a bracket relative to the crossover's movement: to show that a crossover exists, and that no other does
_NARROW, _WIDE = 1.3, 4.0
_LEAST_COVER = 1e-4
_TINY = 1e-300


def suggestions(problem: Problem, boxes: Boxes, points: list[tuple[float, ...]]) -> Iterator[Suggestion]:
    """Everything that the crossovers of these plants suggest.

    Args:
        problem: what the search is about.
        boxes: n boxes.
        points: plants, the nominal one first.
    """
    at = CentralLoops.of(problem, boxes, points)
    try:
        found = gain_crossovers(at.loops)
    except DomainError:
        return
    moves = at.movements(_taken(found, np.isfinite(found.u)))
    known = problem.crossover_rad_s is not None  # and then no box fails what is asked of the nominal crossover
    for k, condition in enumerate(problem.conditions.every):
        if condition.test is Test.STABILITY:
            yield from unstable(at, moves, k, 0.0 if condition.rate is None else float(condition.rate.mid()))
        elif condition.test is Test.MARGIN:
            yield from _margins(at, moves, k, condition)
        elif condition.test is Test.CROSSOVER and not (known and condition.nominal):
            yield from _low_crossovers(at, moves, k, condition)
        elif condition.test is Test.SPREAD:
            yield from _spreads(at, moves, k, float(condition.level.mid()))
        elif condition.test is Test.GAIN_MARGIN:
            yield from _at_phase_crossovers(at, k, condition)


def _taken(found: Crossings, which: NDArray[np.bool_]) -> Crossings:
    return Crossings(*(getattr(found, name)[which] for name in Crossings.__dataclass_fields__))


def _margins(at: CentralLoops, moves: Movements, k: int, condition: Condition) -> Iterator[Suggestion]:
    found, m = moves.found, len(at.points)
    count = np.bincount(found.row, minlength=len(at.loops))
    rate = None if condition.rate is None else float(condition.rate.mid())
    b = found.angle_from_minus_one_rad
    distance = np.abs(b) if rate is None else np.mod(b, 2.0 * np.pi) - rate * found.omega_rad_s
    varies = moves.angle(rate or 0.0)
    sign = 1.0 if condition.upper else -1.0
    excess = (distance - float(condition.level.mid())) * sign
    # |b| rises with b, or falls
    varies = sign * (varies if rate is not None else np.where(b >= 0.0, 1.0, -1.0)[:, None] * varies)
    chosen = (moves.plant == 0) if condition.nominal else np.ones(len(b), dtype=bool)
    if condition.upper:
        chosen &= count[found.row] == 1
        for row in range(0, len(at.loops), m if condition.nominal else 1):
            if count[row] == 0:
                yield Suggestion(row // m, 1.0, -1, Reason(k, at.points[row % m]))
    move = moves.of_gain_crossovers
    width = np.maximum(move * _WIDE, _LEAST_COVER) if condition.upper else move * _NARROW
    yield from _best(at, moves, k, excess, varies, width, chosen)


def _best(
    at: CentralLoops, moves: Movements, k: int, excess: Array, varies: Array, width: Array, chosen: Array
) -> Iterator[Suggestion]:
    """Of every box and plant the crossing with the largest ratio."""
    box, u, each = moves.box, moves.found.u, moves.box * len(at.points) + moves.plant
    ratio = excess / (np.abs(varies).sum(axis=1) + _TINY)
    index = np.flatnonzero(chosen & np.isfinite(ratio) & (ratio > -1.0) & (width < 3.0))
    order = index[np.lexsort((ratio[index], each[index]))]
    last = order[np.append(each[order][1:] != each[order][:-1], True)] if len(order) else order
    axes = np.argmax(np.abs(varies), axis=1)
    for i in last.tolist():
        ends = float(np.exp(u[i] - width[i])), float(np.exp(u[i] + width[i]))
        reason = Reason(k, at.points[moves.plant[i]], ends)
        slopes = tuple(varies[i].tolist())
        yield Suggestion(
            int(box[i]), float(ratio[i]), int(axes[i]), reason, float(excess[i]), slopes, float(moves.rest[i])
        )


def _low_crossovers(at: CentralLoops, moves: Movements, k: int, condition: Condition) -> Iterator[Suggestion]:
    m = len(at.points)
    highest = np.full(len(at.loops), -np.inf)
    reach = np.full(len(at.loops), 1.0)
    np.maximum.at(highest, moves.found.row, moves.found.u)
    reach[moves.found.row] = moves.of_gain_crossovers  # of the highest: rows are sorted by frequency
    rows = np.arange(0, len(at.loops), m if condition.nominal else 1)
    ratio = (float(condition.level.mid()) - highest[rows]) / reach[rows]
    for row, value in zip(rows.tolist(), ratio.tolist(), strict=True):
        if value > -1.0:
            # bounds on cells are of first order: they succeed only well inside
            yield Suggestion(row // m, min(value / 2.0, 1.5), -1, Reason(k, at.points[row % m]), value)


def _spreads(at: CentralLoops, moves: Movements, k: int, level: float) -> Iterator[Suggestion]:
    """Differences to the nominal plant's margin, of loops that cross once."""
    found, move, m = moves.found, moves.of_gain_crossovers, len(at.points)
    b = found.angle_from_minus_one_rad
    side = np.where(b >= 0.0, 1.0, -1.0)
    margin, angle = side * b, side[:, None] * moves.angle()
    place = np.full(len(at.loops), -1)
    place[found.row] = np.arange(len(found.row))
    place = np.where(np.bincount(found.row, minlength=len(at.loops)) == 1, place, -1).reshape(-1, m)
    for row in range(len(at.boxes)):
        zero = place[row, 0]
        for plant in range(1, m):
            i = place[row, plant]
            if zero < 0 or i < 0:
                continue
            apart = margin[i] - margin[zero]
            above = bool(apart > 0)
            varies = (angle[i] - angle[zero]) * (1.0 if above else -1.0)
            excess = abs(apart) - level
            ratio = float(excess / (np.abs(varies).sum() + _TINY))
            if not ratio > -1.0:
                continue
            wide = [max(_WIDE * move[j], _LEAST_COVER) for j in (i, zero)]
            own = wide[0] if above else _NARROW * move[i]
            other = _NARROW * move[zero] if above else wide[1]
            ends = (found.u[i] - own, found.u[i] + own)
            others = (found.u[zero] - other, found.u[zero] + other)
            omega = tuple(float(np.exp(u)) for u in (*ends, *others))
            reason, axis = Reason(k, at.points[plant], omega, above), int(np.argmax(np.abs(varies)))
            rest = float(moves.rest[i] + moves.rest[zero])
            yield Suggestion(row, ratio, axis, reason, float(excess), tuple(varies.tolist()), rest)


def _at_phase_crossovers(at: CentralLoops, k: int, condition: Condition) -> Iterator[Suggestion]:
    try:
        found = phase_crossovers(at.loops)
    except DomainError:
        return
    log_gain, level = np.log(np.maximum(found.gain, _TINY)), float(condition.level.mid())
    inside = np.isfinite(found.u) & (log_gain < 0.0) & (log_gain > -level)
    if not inside.any():
        return
    moves, log_gain = at.movements(_taken(found, inside)), log_gain[inside]
    excess = np.minimum(-log_gain, log_gain + level)
    chosen = (moves.plant == 0) if condition.nominal else np.ones(len(excess), dtype=bool)
    # either way out of -level < ln|L| < 0; below the level is where |L| falls
    varies = np.where(-log_gain < log_gain + level, -1.0, 1.0)[:, None] * moves.log_gain
    yield from _best(at, moves, k, excess, varies, moves.of_phase_crossovers * _NARROW, chosen)
