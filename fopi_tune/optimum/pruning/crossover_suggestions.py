"""Suggestions from crossovers:  reasons to discard a box, from the exact crossovers of the loop at its centre.

As in `fopi_tune.optimum.pruning.screen`, these are suggestions, not proofs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

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
#: crossovers of one loop that are looked at
_MOST_OF_ONE = 3
_TINY = 1e-300


def suggestions(problem: Problem, boxes: Boxes, points: list[tuple[float, ...]]) -> Iterator[Suggestion]:
    """Everything that the crossovers of these plants suggest.

    Args:
        problem: what the search is about.
        boxes: n boxes.
        points: plants, the nominal one first.
    """
    if problem.is_on_samples and len(boxes) != 1:
        # each controller has a filter of its own
        for row in range(len(boxes)):
            for found in suggestions(problem, boxes.take(np.array([row])), points):
                yield replace(found, row=row)
        return
    try:
        at = CentralLoops.of(problem, boxes, points)
        found = gain_crossovers(at.loops)
    except DomainError:
        return  # the exported filter cannot be made, or the crossovers are too many to list: nothing is suggested
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
        elif condition.test is Test.GAIN_SPREAD and not known:
            yield from _gain_spreads(at, moves, k, float(condition.level.mid()))
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
        ends = _ends(at.problem, float(u[i]), float(width[i]))
        if ends is None:
            continue
        reason = Reason(k, at.points[moves.plant[i]], ends)
        slopes = tuple(varies[i].tolist())
        yield Suggestion(
            int(box[i]), float(ratio[i]), int(axes[i]), reason, float(excess[i]), slopes, float(moves.rest[i])
        )


def _ends(problem: Problem, u: float, width: float) -> tuple[float, float] | None:
    """A bracket around u, rad/s; None where the end of the axis is too near."""
    low, high = problem.frequencies_rad_s(np.array([u - width, u + width])).tolist()
    return (low, high) if high < problem.highest_rad_s else None


def _low_crossovers(at: CentralLoops, moves: Movements, k: int, condition: Condition) -> Iterator[Suggestion]:
    m, level = len(at.points), float(condition.level.mid())
    # rows are sorted by frequency: the last one of a loop is its highest
    last = np.searchsorted(moves.found.row, np.arange(len(at.loops)), side="right") - 1
    for row in range(0, len(at.loops), m if condition.nominal else 1):
        i, reason = int(last[row]), Reason(k, at.points[row % m])
        if i < 0 or moves.found.row[i] != row:
            yield Suggestion(row // m, 1.5, -1, reason)
            continue
        lowest = at.problem.u_interval((math.exp(level), math.exp(level)))[0]
        below = float(lowest - moves.found.u[i])
        ratio = below / float(moves.of_gain_crossovers[i])
        if ratio > -1.0:
            # 1 - |L|^2 at the level, where |L| falls from the crossover on
            slopes = tuple((-2.0 * moves.slopes[i].real).tolist())
            excess, rest = 2.0 * abs(float(moves.steep[i])) * below, 4.0 * float(moves.rest[i])
            axis = int(np.argmax(np.abs(slopes)))
            yield Suggestion(row // m, ratio, axis, reason, excess, slopes, rest)


def _spreads(at: CentralLoops, moves: Movements, k: int, level: float) -> Iterator[Suggestion]:
    """Differences to the nominal plant's margin, at the crossovers where both are smallest."""
    found, move, m = moves.found, moves.of_gain_crossovers, len(at.points)
    b = found.angle_from_minus_one_rad
    side = np.where(b >= 0.0, 1.0, -1.0)
    margin, angle = side * b, side[:, None] * moves.angle()
    # rows are sorted by frequency, so that those of one loop are next to each other
    first, last = (np.searchsorted(found.row, np.arange(len(at.loops)), side=side) for side in ("left", "right"))
    count = last - first
    for row in range(len(at.boxes)):
        for plant in range(1, m):
            loops = row * m, row * m + plant
            if not all(1 <= count[loop] <= _MOST_OF_ONE for loop in loops):
                continue
            zero, i = (int(first[loop] + np.argmin(margin[first[loop] : last[loop]])) for loop in loops)
            apart = margin[i] - margin[zero]
            above = bool(apart > 0)
            varies = (angle[i] - angle[zero]) * (1.0 if above else -1.0)
            excess = abs(apart) - level
            ratio = float(excess / (np.abs(varies).sum() + _TINY))
            small, large = (zero, loops[1]) if above else (i, loops[0])
            others = range(first[large], last[large])
            wide = np.maximum(_WIDE * move[others], _LEAST_COVER)
            u = found.u[others]
            if not ratio > -1.0 or np.any(u[1:] - wide[1:] <= u[:-1] + wide[:-1]):
                continue
            own = _NARROW * move[small]
            ends = [found.u[small] - own, found.u[small] + own, *np.stack([u - wide, u + wide], axis=1).ravel()]
            omega = tuple(at.problem.frequencies_rad_s(np.array(ends)).tolist())
            reason, axis = Reason(k, at.points[plant], omega, above), int(np.argmax(np.abs(varies)))
            rest = float(moves.rest[i] + moves.rest[zero])
            slopes = tuple(varies.tolist()) if len(others) == 1 else ()
            yield Suggestion(row, ratio, axis, reason, float(excess), slopes, rest)


def _gain_spreads(at: CentralLoops, moves: Movements, k: int, level: float) -> Iterator[Suggestion]:
    """|L| of the other plants at the nominal plant's highest crossover."""
    m = len(at.points)
    nominal = np.flatnonzero(moves.plant == 0)
    # rows are sorted by frequency
    highest = nominal[np.append(np.diff(moves.box[nominal]) != 0, True)] if len(nominal) else nominal
    if not len(highest) or m == 1:
        return
    box, u = moves.box[highest], moves.found.u[highest]
    rows = (box[:, None] * m + np.arange(1, m)).ravel()
    response, along = at.loops.log_response_and_slope(rows, np.repeat(u, m - 1))
    apart = response.real.reshape(-1, m - 1)
    steeper = along.real.reshape(-1, m - 1) - moves.along[highest].real[:, None]
    shift = -moves.slopes[highest].real / moves.steep[highest][:, None]
    width = np.maximum(_NARROW * moves.of_gain_crossovers[highest], _LEAST_COVER)
    excess = np.abs(apart) - level
    varies = (np.sign(apart) * steeper)[:, :, None] * shift[:, None, :]
    ratio = excess / (np.abs(varies).sum(axis=2) + _TINY)
    best = np.argmax(np.where(np.isfinite(ratio), ratio, -np.inf), axis=1)
    for i, plant in enumerate(best.tolist()):
        if not ratio[i, plant] > -1.0 or not width[i] < 3.0:
            continue
        ends = _ends(at.problem, float(u[i]), float(width[i]))
        if ends is None:
            continue
        slopes = varies[i, plant]
        rest = float(moves.rest[highest[i]] * abs(steeper[i, plant]) / abs(moves.steep[highest[i]]))
        yield Suggestion(
            int(box[i]), float(ratio[i, plant]), int(np.argmax(np.abs(slopes))), Reason(k, at.points[plant + 1], ends),
            float(excess[i, plant]), tuple(slopes.tolist()), rest,
        )  # fmt: skip


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
