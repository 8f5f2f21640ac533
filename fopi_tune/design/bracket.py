"""How much better than gains that were found anything in the box can be, by branch and bound in floating point."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.design.bound.branch import branch
from fopi_tune.design.bound.columns import KAPPA, PSI_HIGH, PSI_LOW, QUADRANT, SHAPE_HIGH, SHAPE_LOW
from fopi_tune.design.constraints import Bound
from fopi_tune.design.global_search.basins import Basin
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CROSSOVER_SPREAD,
    CS,
    CS_PEAK,
    DEPTH,
    END,
    IAE,
    KI,
    LOOP_GAIN,
    MARGIN_SPREAD,
    PHASE_MARGIN,
    PS,
    PS_PEAK,
    S_PEAK,
    Rows,
    S,
    Table,
    work_for,
)
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.samples import log_omega_of
from fopi_tune.design.global_search.structures import quadrants_of
from fopi_tune.design.global_search.tables import table_of, vertices
from fopi_tune.design.global_search.worst_case import FIELDS, ROW, SLACK, V

#: relative to the objective (of peaks, spreads and depths to at least this many neper or radian)
GAPS = (0.001, 0.01, 0.1)
_LEAST_SIZE = 0.1
#: cells that are looked at for each gap
BUDGET = 1200
#: plants times frequencies of a table, from which on fewer cells are looked at, and the least part of them
_LARGE_TABLE, _LEAST_PART = 400, 0.3
#: natural units; worst cases with less slack join the bound's table
_ACTIVE = 0.02
#: parts of the budget, between which the table grows
_PARTS = (0.4, 0.2, 0.2, 0.2)
#: worst cases that join the table for one start
_MOST_WORST, _MOST_OF_OBJECTIVE = 8, 3
_BESIDE = (-0.02, -0.005, 0.0, 0.005, 0.02)
_MOST_STARTS = 4


@dataclass(frozen=True)
class Bracket:
    """What is left of the box.

    Args:
        gap: nothing better by this part was found to be possible; inf where not even the largest of `GAPS` was closed.
        left: share of the box that a target of the smallest gap leaves.
        cells: that were looked at.
        starts: gains in cells that the smallest gap leaves.
        remaining: the cells that are left at last, their columns as in `bound.cells`.
    """

    gap: float
    left: float
    cells: int
    starts: tuple[Basin, ...]
    remaining: Array


def bracket_of(
    polish: Polish, cost: float, x: Array, budget: int = BUDGET, gaps: tuple[float, ...] = GAPS
) -> Bracket | None:  # fmt: skip
    """The bracket around gains x of this cost; None where the objective's target has no bound.

    Args:
        polish: of the problem.
        cost, x: the gains and their cost.
        budget: cells that are looked at for each gap, of a table of three plants at a hundred frequencies.
        gaps: that are tried, in ascending order, until one is closed.
    """
    problem, quadrants = polish.problem, quadrants_of(polish.problem.box)
    known, cells = [_worst(polish, x, _ACTIVE)], _whole_box(problem)
    area, looked, share, closed = _area(cells), 0, 0.0, math.inf
    wanted: tuple[Basin, ...] = ()
    for gap in gaps:
        # cells without anything better by a smaller gap hold nothing better by a larger one
        starts: tuple[Basin, ...] = ()
        for part in _PARTS:
            table = _table(problem, cost, known)
            asked = _beating(problem, table, cost, gap)
            if asked is None:
                return None
            size = min(1.0, max(_LEAST_PART, _LARGE_TABLE / table.gain.size))
            cells, count = _left(problem, *asked, table, cells, int(part * size * budget))
            looked += count
            starts = _starts(cells, quadrants, cost, problem.spec.controller.has_derivative) if len(cells) else ()
            if not starts:
                break
            # what gains in the cells that are left violate between the table's plants and frequencies joins it
            beaten = -cost if problem.code == DEPTH else 0.0
            known += [_worst(polish, start.gains, beaten) for start in starts]
        if gap == gaps[0]:
            share, wanted = _area(cells) / area, starts
        if not len(cells):
            closed = gap
            break
    return Bracket(closed, share, looked, wanted, cells)


def _worst(polish: Polish, x: Array, slack: float) -> Array:
    """The worst cases at gains: rows of requirements with less slack, and some of the objective; none when unstable."""
    found = polish.look(x)
    if found is None:
        return np.zeros((0, FIELDS + polish.width))
    found = found[np.argsort(found[:, SLACK])]
    asked = found[:, ROW] < polish.real_rows
    return np.vstack([found[asked & (found[:, SLACK] <= slack)][:_MOST_WORST], found[~asked][:_MOST_OF_OBJECTIVE]])


def excluded_share(problem: Problem, budget: int = BUDGET) -> float:
    """The share of the box in which no gains can meet the requirements, whatever the objective."""
    table, cells = problem.scan_table, _whole_box(problem)
    left, _ = _left(replace(problem, code=DEPTH), problem.rows(table, tightening=0.0), 0.0, table, cells, budget)
    return 1.0 - _area(left) / _area(cells)


def _whole_box(problem: Problem) -> Array:
    """A cell for each quadrant."""
    box, cells = problem.box, []
    for z in range(len(quadrants_of(problem.box))):
        low = 0.5 * math.pi if box.kp_low == box.kp_high == 0.0 else 0.0
        high = 0.0 if box.ki_low == box.ki_high == 0.0 else 0.5 * math.pi
        shape = (box.alpha_low, box.alpha_high)
        if problem.spec.controller.has_derivative:
            # theta, as psi, of kd beside kp
            shape = (
                0.5 * math.pi if box.kp_low == box.kp_high == 0.0 else 0.0,
                0.0 if box.kd_low == box.kd_high == 0.0 else 0.5 * math.pi,
            )
        cells.append((*shape, low, high, float(z), 0.0))
    return np.array(cells)


def _area(cells: Array) -> float:
    width = np.maximum(cells[:, SHAPE_HIGH] - cells[:, SHAPE_LOW], 1e-9)
    return float(np.sum(width * np.maximum(cells[:, PSI_HIGH] - cells[:, PSI_LOW], 1e-9)))


def _left(
    problem: Problem, rows: Rows, target: float, table: Table, cells: Array, budget: int
) -> tuple[Array, int]:  # fmt: skip
    """Cells that are left of some, and how many were looked at."""
    if _contradicts_itself(problem, rows, target, table):
        return cells[:0], 0
    box, proper = problem.box, problem.scaled.samples is None and bool(np.all(table.high_slope < 0.0))
    proper = proper and not problem.spec.controller.has_derivative and problem.scale.measurement_filter is None
    for q in np.flatnonzero((rows.kind == CS) & (rows.side > 0) & (rows.last == len(table.v) - 1) & proper):
        # |C S| -> |kp| as omega -> inf
        largest = math.exp(rows.limit[q])
        box = box._replace(kp_low=max(box.kp_low, -largest), kp_high=min(box.kp_high, largest))
    room = np.zeros((len(cells) + 2 * budget + 2, cells.shape[1]))
    room[: len(cells)] = cells
    first, last, looked = branch(
        problem.code, target, quadrants_of(problem.box), room, len(cells), budget, table, rows, box, work_for(table),
    )  # fmt: skip
    return room[first:last], looked


def _contradicts_itself(problem: Problem, rows: Rows, target: float, table: Table) -> bool:
    """Whether no value of a quantity meets its lower and its upper limit, or no spread the target."""
    if problem.code in (MARGIN_SPREAD, CROSSOVER_SPREAD) and target < 0.0:
        return True
    if problem.code == CROSSOVER_SPREAD:
        # ln|L_i| at the nominal crossover is ln|P_i/P_0| there
        first, last = 1, len(table.v) - 2
        for q in np.flatnonzero(rows.kind == CROSSOVER):
            first = max(first, int(rows.first[q])) if rows.side[q] <= 0 else first
            last = min(last, int(rows.first[q])) if rows.side[q] >= 0 else last
        gain = table.gain[:, first : last + 1]
        least = np.abs(gain - gain[0]).max(axis=0)[np.abs(gain).max(axis=0) < END]
        if not len(least) or least.min() > target:
            return True
    for q in np.flatnonzero(rows.side < 0):
        both = (rows.kind == rows.kind[q]) & (rows.side > 0) & (rows.limit < rows.limit[q] - 1e-12)
        # of lines over ln omega nothing is said here
        both &= (rows.tilt == 0.0) & (rows.tilt[q] == 0.0)
        both &= (rows.first <= rows.last[q]) & (rows.last >= rows.first[q])
        if np.any(both):
            return True
    return False


def _table(problem: Problem, cost: float, known: list[Array]) -> Table:
    """Vertices and worst plants, at the scan's frequencies, around the worst ones and at limits of crossovers."""
    points, scaled, scan = vertices(problem.spec.plant), problem.scaled, problem.scan_table
    near, log_omega_s, half = np.vstack(known), math.log(problem.scale.omega_rad_s), scan.sampling.half
    v = np.concatenate([scan.v[1:-1], np.add.outer(known[0][:, V], _BESIDE).ravel(), near[:, V]])
    if points.shape[1] and len(near):
        points = np.unique(np.vstack([points[1:], near[:, FIELDS:]]), axis=0)
        points = np.vstack([problem.spec.plant.nominal_point, points])
    if problem.code == DEPTH:
        rows = problem.rows(scan, tightening=0.0)
        for gap in GAPS:
            limits = _deeper(rows, _step(cost, gap) - cost)[rows.kind == CROSSOVER]
            v = np.append(v, [scaled.v_of(limit + log_omega_s) for limit in limits])
    v = np.unique(v[(v >= scan.v[1]) & (v <= scan.v[-2])])
    v = v[np.concatenate([[True], np.diff(v) > 1e-9])]
    omega = np.exp([log_omega_of(x, half) + log_omega_s for x in v])
    return table_of(scaled, points, omega, problem.horizon_s)


def _beating(problem: Problem, table: Table, cost: float, gap: float) -> tuple[Rows, float] | None:
    """Rows and target of costing less by the gap; None where no row says so."""
    rows = problem.rows(table, tightening=0.0)
    last, step = len(table.v) - 1, _step(cost, gap)
    if problem.code == KI:
        return (rows, cost * (1.0 + gap)) if cost < 0.0 else None
    if problem.code == IAE:
        return rows, cost + math.log(1.0 - gap)
    if problem.code == DEPTH:
        limit = _deeper(rows, step - cost)
        at = np.array([np.argmin(np.abs(table.log_omega - log_omega)) for log_omega in limit])
        return rows._replace(limit=limit, first=np.where(rows.kind == CROSSOVER, at, rows.first)), 0.0
    peaks = {S_PEAK: S, CS_PEAK: CS, PS_PEAK: PS}
    if problem.code in peaks:
        return _joined(rows, peaks[problem.code], 1, cost - step, 0, last), 0.0
    kind = PHASE_MARGIN if problem.code == MARGIN_SPREAD else CROSSOVER
    fixed = [k for k, c in enumerate(problem.constraints) if c.bound is Bound.EQUAL and rows.kind[k] == kind]
    if not fixed:
        return rows, cost - step
    if problem.code == CROSSOVER_SPREAD:
        at = int(rows.first[fixed[0]])
        upper = _joined(rows, LOOP_GAIN, 1, cost - step, at, at)
        return _joined(upper, LOOP_GAIN, -1, step - cost, at, at), cost - step
    lower = _joined(rows, PHASE_MARGIN, -1, float(rows.limit[fixed[0]]) - cost + step, 0, last)
    return _joined(lower, PHASE_MARGIN, 1, float(rows.limit[fixed[0]]) + cost - step, 0, last), cost - step


def _step(cost: float, gap: float) -> float:
    return gap * max(abs(cost), _LEAST_SIZE)


def _deeper(rows: Rows, slack: float) -> Array:
    """Limits that leave the requirements which count in the depth this slack."""
    return rows.limit - np.where(rows.in_depth, rows.side * slack / rows.scale, 0.0)


def _joined(rows: Rows, kind: int, side: int, limit: float, first: int, last: int) -> Rows:
    more = (kind, side, limit, False, first, last, 1.0, False, -math.inf, math.inf, False, 0.0)
    return Rows(*(np.append(old, np.array([new], dtype=old.dtype)) for old, new in zip(rows, more, strict=True)))


def _starts(cells: Array, quadrants: Array, cost: float, with_derivative: bool) -> tuple[Basin, ...]:
    """Gains in some of the cells, far apart."""
    middle = np.column_stack(
        [cells[:, SHAPE_LOW] + cells[:, SHAPE_HIGH], cells[:, PSI_LOW] + cells[:, PSI_HIGH], 9.0 * cells[:, QUADRANT]]
    )
    chosen = [0]
    distance = np.abs(middle - middle[0]).max(axis=1)
    while len(chosen) < min(_MOST_STARTS, len(cells)) and distance.max() > 0.05:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.abs(middle - middle[chosen[-1]]).max(axis=1))
    starts = []
    for r in chosen:
        k, psi, signs = math.exp(cells[r, KAPPA]), 0.5 * middle[r, 1], quadrants[int(cells[r, QUADRANT])]
        c, s, shape = k * math.cos(psi), k * math.sin(psi) * signs[1], 0.5 * middle[r, 0]
        gains = (c * signs[0], s, shape)
        if with_derivative:
            gains = (c * math.cos(shape) * signs[0], s, c * math.sin(shape) * signs[2])
        starts.append(Basin(cost, np.array(gains)))
    return tuple(starts)
