"""Suggestions from crossovers:  reasons to discard a box, from the exact crossovers of the loop at its centre.

Where |L| = 1 the angle varies with the coordinates as

    d(arg L)/dg = Im(C_g/C) - (arg L)_u/(ln|L|)_u Re(C_g/C) ,                                                      (1)

and the crossover moves by Re(C_g/C)/(ln|L|)_u.  As in `fopi_tune.optimum.pruning.screen`, these are suggestions,
not proofs.

Source: derived by the implicit function theorem from ln|L| = 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import unstable_poles_from
from fopi_tune.errors import DomainError
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Condition, Test
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.pruning.screen import Boxes, gains_at, taylor_models

#: width of a bracket relative to the crossover's movement: to show that a crossover exists, and that no other does
_NARROW, _WIDE = 1.3, 4.0
_LEAST_WIDTH, _LEAST_COVER = 1e-9, 1e-4
_TINY = 1e-300
#: relative change of C over a box above which no claim about stability is tried
_LARGEST_CHANGE = 0.4
#: of crossings: slopes, d ln L/du, box and plant
CrossingDerivatives = tuple[list[Complex], Complex, Rows, Rows]


@dataclass(frozen=True)
class Suggestion:
    """One reason for one box.

    Args:
        row: the box.
        ratio: as in `fopi_tune.optimum.pruning.screen`.
        axis: along which the condition varies most; -1 where that is not known.
        reason: to be tested.
        excess: violation of the condition at the centre, neper or radian; negative where it is met.
    """

    row: int
    ratio: float
    axis: int
    reason: Reason
    excess: float = 1.0


@dataclass(frozen=True)
class _Loops:
    """Every box's central controller with every plant; row = box * plants + plant."""

    boxes: Boxes
    points: list[tuple[float, ...]]
    loops: Loops
    problem: Problem

    @classmethod
    def of(cls, problem: Problem, boxes: Boxes, points: list[tuple[float, ...]]) -> _Loops:
        n, m = len(boxes), len(points)
        kp, ki, alpha = (np.repeat(gain, m) for gain in gains_at(problem.parametrization, boxes.middle))
        places = np.array(points, dtype=float).reshape(m, -1)
        plants = Plants.members(problem.family, places).take(np.tile(np.arange(m), n))
        return cls(boxes, points, Loops(kp, ki, alpha, plants), problem)

    def slopes(self, found: Crossings) -> CrossingDerivatives:
        """C_g/C times the half-widths at crossings, complex; d ln L/du; and the box and plant of each."""
        box, plant = np.divmod(found.row, len(self.points))
        at = taylor_models(self.problem.parametrization, self.boxes.take(box), _log_s(found.u))
        half = self.boxes.half[box]
        slopes = [s[:, 0] / at.value[:, 0] * half[:, k] for k, s in enumerate(at.slopes)]
        return slopes, self.loops.log_response_and_slope(found.row, found.u)[1], box, plant


def _log_s(u: Array) -> Complex:
    """ln(j omega), shape (n, 1)."""
    return np.asarray(u[:, None] + 0.5j * np.pi, dtype=complex)


def suggestions(problem: Problem, boxes: Boxes, points: list[tuple[float, ...]]) -> Iterator[Suggestion]:
    """Everything that the crossovers of these plants suggest.

    Args:
        problem: what the search is about.
        boxes: n boxes.
        points: plants, the nominal one first.
    """
    at = _Loops.of(problem, boxes, points)
    numbered = list(enumerate(problem.conditions.every))
    known = problem.crossover_rad_s is not None  # and then no box fails what is asked of the nominal crossover
    crossing = [
        (k, c)
        for k, c in numbered
        if c.test in (Test.MARGIN, Test.SPREAD) or (c.test is Test.CROSSOVER and not (known and c.nominal))
    ]
    try:
        found = gain_crossovers(at.loops)
    except DomainError:
        return
    finite = np.isfinite(found.u)
    found = Crossings(*(getattr(found, name)[finite] for name in Crossings.__dataclass_fields__))
    read = at.slopes(found)
    yield from _unstable(problem, at, found, read[0])
    if crossing:
        yield from _at_crossovers(at, found, read, crossing)
    for k, condition in numbered:
        if condition.test is Test.GAIN_MARGIN:
            yield from _at_phase_crossovers(at, k, condition)


def _unstable(problem: Problem, at: _Loops, found: Crossings, slopes: list[Complex]) -> Iterator[Suggestion]:
    """Suggest instability of boxes over which L hardly changes at crossovers: the claim needs |1 + L| away from 0."""
    poles = unstable_poles_from(at.loops, found)
    varies = np.zeros(len(at.loops))
    np.maximum.at(varies, found.row, np.abs(np.stack(slopes, axis=1)).sum(axis=1))
    chosen = ((poles > 0.5) & np.isfinite(poles) & (varies < _LARGEST_CHANGE)).reshape(len(at.boxes), len(at.points))
    place = next(k for k, c in enumerate(problem.conditions.every) if c.test is Test.STABILITY)
    for row in np.flatnonzero(chosen.any(axis=1)):
        yield Suggestion(int(row), 0.0, -1, Reason(place, at.points[int(np.argmax(chosen[row]))]))


def _at_crossovers(
    at: _Loops, found: Crossings, read: CrossingDerivatives, wanted: list[tuple[int, Condition]]
) -> Iterator[Suggestion]:
    slopes, along, box, plant = read
    m = len(at.points)
    steep = np.where(np.abs(along.real) > 1e-9, along.real, 1e-9)
    angle = np.stack([s.imag - along.imag / steep * s.real for s in slopes], axis=1)
    move = _moves(slopes, np.stack([s.real for s in slopes], axis=1), steep)
    count = np.bincount(found.row, minlength=len(at.loops))
    value = np.pi + found.phase_rad
    for k, condition in wanted:
        level = float(condition.level.mid())
        if condition.test is Test.CROSSOVER:
            yield from _low_crossovers(at, k, condition, found, move, count)
            continue
        if condition.test is Test.SPREAD:
            yield from _spreads(at, k, level, found, angle, move, count, value)
            continue
        rate = 0.0 if condition.rate is None else float(condition.rate.mid())
        own = angle
        if rate:
            # omega = e^u moves along |L| = 1 as well
            own = angle + rate * (found.omega_rad_s / steep)[:, None] * np.stack([s.real for s in slopes], axis=1)
        varies = np.abs(own).sum(axis=1) + _TINY
        ratio = (value - rate * found.omega_rad_s - level) / varies * (1.0 if condition.upper else -1.0)
        chosen = (plant == 0) if condition.nominal else np.ones(len(plant), dtype=bool)
        if condition.upper:
            chosen &= count[found.row] == 1
            for row in range(0, len(at.loops), 1 if not condition.nominal else m):
                if count[row] == 0:
                    yield Suggestion(row // m, 1.0, -1, Reason(k, at.points[row % m]))
        width = np.maximum(move * _WIDE, _LEAST_COVER) if condition.upper else move * _NARROW
        yield from _best(k, box, plant, ratio, own, found.u, width, chosen, at.points, ratio * varies)


def _moves(slopes: list[Complex], parts: Array, steep: Array) -> Array:
    """How far crossings move within their boxes: to first order, and something for the second."""
    size = np.abs(np.stack(slopes, axis=1)).sum(axis=1)
    return (np.abs(parts).sum(axis=1) + 0.5 * np.minimum(size, 1.0) ** 2) / np.abs(steep) + _LEAST_WIDTH


def _best(
    k: int,
    box: Rows,
    plant: Rows,
    ratio: Array,
    varies: Array,
    u: Array,
    width: Array,
    chosen: Array,
    points: list,
    excess: Array,
) -> Iterator[Suggestion]:
    """Of every box the crossing with the largest ratio."""
    index = np.flatnonzero(chosen & np.isfinite(ratio) & (ratio > -1.0) & (width < 3.0))
    order = index[np.lexsort((ratio[index], box[index]))]
    last = order[np.append(box[order][1:] != box[order][:-1], True)] if len(order) else order
    for i in last:
        ends = float(np.exp(u[i] - width[i])), float(np.exp(u[i] + width[i]))
        axis = int(np.argmax(np.abs(varies[i])))
        yield Suggestion(int(box[i]), float(ratio[i]), axis, Reason(k, points[plant[i]], ends), float(excess[i]))


def _low_crossovers(
    at: _Loops, k: int, condition: Condition, found: Crossings, move: Array, count: Rows
) -> Iterator[Suggestion]:
    m = len(at.points)
    highest = np.full(len(at.loops), -np.inf)
    reach = np.full(len(at.loops), 1.0)
    np.maximum.at(highest, found.row, found.u)
    reach[found.row] = move  # of the highest: rows are sorted by frequency
    rows = np.arange(0, len(at.loops), m if condition.nominal else 1)
    ratio = (float(condition.level.mid()) - highest[rows]) / reach[rows]
    for row, value in zip(rows.tolist(), ratio.tolist(), strict=True):
        if value > -1.0:
            # bounds on cells are of first order: they succeed only well inside
            yield Suggestion(row // m, min(value / 2.0, 1.5), -1, Reason(k, at.points[row % m]), value)


def _spreads(
    at: _Loops, k: int, level: float, found: Crossings, angle: Array, move: Array, count: Rows, value: Array
) -> Iterator[Suggestion]:
    """Differences to the nominal plant's margin, of loops that cross once."""
    m = len(at.points)
    place = np.full(len(at.loops), -1)
    place[found.row] = np.arange(len(found.row))
    place = np.where(count == 1, place, -1).reshape(-1, m)
    for row in range(len(at.boxes)):
        best: tuple[float, int, Reason] | None = None
        zero = place[row, 0]
        for plant in range(1, m):
            i = place[row, plant]
            if zero < 0 or i < 0:
                continue
            apart, varies = value[i] - value[zero], np.abs(angle[i] - angle[zero])
            ratio = (abs(apart) - level) / (varies.sum() + _TINY)
            if best is None or ratio > best[0]:
                above = bool(apart > 0)
                wide = [max(_WIDE * move[j], _LEAST_COVER) for j in (i, zero)]
                own = wide[0] if above else _NARROW * move[i]
                other = _NARROW * move[zero] if above else wide[1]
                ends = (found.u[i] - own, found.u[i] + own)
                others = (found.u[zero] - other, found.u[zero] + other)
                omega = tuple(float(np.exp(u)) for u in (*ends, *others))
                best = (float(ratio), int(np.argmax(varies)), Reason(k, at.points[plant], omega, above))
        if best is not None and best[0] > -1.0:
            yield Suggestion(row, *best, excess=best[0])


def _at_phase_crossovers(at: _Loops, k: int, condition: Condition) -> Iterator[Suggestion]:
    try:
        found = phase_crossovers(at.loops)
    except DomainError:
        return
    log_gain, level = np.log(np.maximum(found.gain, _TINY)), float(condition.level.mid())
    inside = np.isfinite(found.u) & (log_gain < 0.0) & (log_gain > -level)
    found = Crossings(*(getattr(found, name)[inside] for name in Crossings.__dataclass_fields__))
    if not len(found.row):
        return
    log_gain = log_gain[inside]
    slopes, along, box, plant = at.slopes(found)
    steep = np.where(np.abs(along.imag) > 1e-9, along.imag, 1e-9)
    gain = np.stack([s.real - along.real / steep * s.imag for s in slopes], axis=1)
    move = _moves(slopes, np.stack([s.imag for s in slopes], axis=1), steep)
    excess = np.minimum(-log_gain, log_gain + level)
    ratio = excess / (np.abs(gain).sum(axis=1) + _TINY)
    chosen = (plant == 0) if condition.nominal else np.ones(len(plant), dtype=bool)
    yield from _best(k, box, plant, ratio, gain, found.u, move * _NARROW, chosen, at.points, excess)
