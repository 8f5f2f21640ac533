"""How much better than gains that were found anything in the box can be, by branch and bound in floating point."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.design.bound.branch import branch
from fopi_tune.design.bound.discs import ALPHA_HIGH, ALPHA_LOW, KAPPA, PSI_HIGH, PSI_LOW, QUADRANT
from fopi_tune.design.constraints import Bound
from fopi_tune.design.global_search.basins import Basin, quadrants_of
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CROSSOVER_SPREAD,
    CS,
    CS_PEAK,
    DEPTH,
    IAE,
    KI,
    LOOP_GAIN,
    MARGIN_SPREAD,
    PHASE_MARGIN,
    S_PEAK,
    Rows,
    S,
    Table,
    work_for,
)
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.tables import table_of, vertices
from fopi_tune.design.global_search.worst_case import FIELDS, SLACK, V

#: relative to the objective (of peaks, spreads and depths to at least this many neper or radian)
GAPS = (0.001, 0.01, 0.1)
_LEAST_SIZE = 0.1
#: cells that are looked at for each gap
BUDGET = 1500
#: natural units; worst cases with less slack join the bound's table
_ACTIVE = 0.02
_BESIDE = (-0.02, -0.005, 0.0, 0.005, 0.02)
_MOST_STARTS = 4


@dataclass(frozen=True)
class Bracket:
    """What is left of the box.

    Args:
        gap: nothing better by this part was found to be possible; inf where not even the largest of `GAPS` was closed.
        left: share of the box that a target of the next smaller gap leaves.
        cells: that were looked at.
        starts: gains in cells that are left.
    """

    gap: float
    left: float
    cells: int
    starts: tuple[Basin, ...]


def bracket_of(polish: Polish, cost: float, x: Array, budget: int = BUDGET) -> Bracket | None:
    """The bracket around gains x of this cost; None where the objective's target has no bound."""
    problem = polish.problem
    table = _table(polish, x)
    quadrants, cells = quadrants_of(problem), _whole_box(problem)
    area, looked, starts = _area(cells), 0, ()
    share = 0.0
    for gap in GAPS:
        # cells without anything better by a smaller gap hold nothing better by a larger one
        asked = _beating(problem, table, cost, gap)
        if asked is None:
            return None
        cells, count = _left(problem, *asked, table, cells, budget)
        looked += count
        if gap == GAPS[0]:
            share = _area(cells) / area
            starts = _starts(cells, quadrants, cost) if len(cells) else ()
        if not len(cells):
            return Bracket(gap, share, looked, starts)
    return Bracket(math.inf, share, looked, starts)


def excluded_share(problem: Problem, budget: int = BUDGET) -> float:
    """The share of the box in which no gains can meet the requirements, whatever the objective."""
    table, cells = problem.scan_table, _whole_box(problem)
    left, _ = _left(replace(problem, code=DEPTH), problem.rows(table, tightening=0.0), 0.0, table, cells, budget)
    return 1.0 - _area(left) / _area(cells)


def _whole_box(problem: Problem) -> Array:
    """A cell for each quadrant."""
    box, cells = problem.box, []
    for z in range(len(quadrants_of(problem))):
        low = 0.5 * math.pi if box.kp_low == box.kp_high == 0.0 else 0.0
        high = 0.0 if box.ki_low == box.ki_high == 0.0 else 0.5 * math.pi
        cells.append((box.alpha_low, box.alpha_high, low, high, float(z), 0.0))
    return np.array(cells)


def _area(cells: Array) -> float:
    width = np.maximum(cells[:, ALPHA_HIGH] - cells[:, ALPHA_LOW], 1e-9)
    return float(np.sum(width * np.maximum(cells[:, PSI_HIGH] - cells[:, PSI_LOW], 1e-9)))


def _left(
    problem: Problem, rows: Rows, target: float, table: Table, cells: Array, budget: int
) -> tuple[Array, int]:  # fmt: skip
    """Cells that are left of some, and how many were looked at."""
    room = np.zeros((len(cells) + 2 * budget + 2, cells.shape[1]))
    room[: len(cells)] = cells
    first, last, looked = branch(
        problem.code, target, quadrants_of(problem), room, len(cells), budget, table, rows, problem.box,
        work_for(table),
    )  # fmt: skip
    return room[first:last], looked


def _table(polish: Polish, x: Array) -> Table:
    """Vertices and the worst plants at x, at the scan's frequencies and around the worst ones."""
    problem, found = polish.problem, polish.look(x)
    points, omega = vertices(problem.spec.plant), problem.scan_table.omega[1:-1] * problem.scale.omega_rad_s
    if found is not None and len(found):
        near = found[found[:, SLACK] < _ACTIVE]
        v = np.add.outer(near[:, V], _BESIDE).ravel()
        inner = v[(v > polish.table.v[1]) & (v < polish.table.v[-2])]
        omega = np.union1d(omega, np.exp(inner) * problem.scale.omega_rad_s)
        if points.shape[1]:
            points = np.unique(np.vstack([points[1:], near[:, FIELDS:]]), axis=0)
            points = np.vstack([problem.spec.plant.nominal_point, points])
    apart = np.concatenate([[True], np.diff(np.log(omega)) > 1e-9])
    return table_of(problem.scaled, points, omega[apart], problem.horizon_s)


def _beating(problem: Problem, table: Table, cost: float, gap: float) -> tuple[Rows, float] | None:
    """Rows and target of costing less by the gap; None where no row says so."""
    rows = problem.rows(table, tightening=0.0)
    last, step = len(table.v) - 1, gap * max(abs(cost), _LEAST_SIZE)
    if problem.code == KI:
        return (rows, cost * (1.0 + gap)) if cost < 0.0 else None
    if problem.code == IAE:
        return rows, cost + math.log(1.0 - gap)
    if problem.code == DEPTH:
        slack = np.where(rows.in_depth, -cost + step, 0.0)
        return rows._replace(limit=rows.limit - rows.side * slack / rows.scale), 0.0
    if problem.code in (S_PEAK, CS_PEAK):
        return _joined(rows, S if problem.code == S_PEAK else CS, 1, cost - step, 0, last), 0.0
    kind = PHASE_MARGIN if problem.code == MARGIN_SPREAD else CROSSOVER
    fixed = [k for k, c in enumerate(problem.constraints) if c.bound is Bound.EQUAL and rows.kind[k] == kind]
    if not fixed:
        return rows, cost - step
    if problem.code == CROSSOVER_SPREAD:
        at = int(rows.first[fixed[0]])
        upper = _joined(rows, LOOP_GAIN, 1, cost - step, at, at)
        return _joined(upper, LOOP_GAIN, -1, step - cost, at, at), cost - step
    return _joined(rows, PHASE_MARGIN, -1, float(rows.limit[fixed[0]]) - cost + step, 0, last), cost - step


def _joined(rows: Rows, kind: int, side: int, limit: float, first: int, last: int) -> Rows:
    more = (kind, side, limit, False, first, last, 1.0, False, -math.inf, math.inf, False)
    return Rows(*(np.append(old, np.array([new], dtype=old.dtype)) for old, new in zip(rows, more, strict=True)))


def _starts(cells: Array, quadrants: Array, cost: float) -> tuple[Basin, ...]:
    """Gains in some of the cells, far apart."""
    middle = np.column_stack(
        [cells[:, ALPHA_LOW] + cells[:, ALPHA_HIGH], cells[:, PSI_LOW] + cells[:, PSI_HIGH], 9.0 * cells[:, QUADRANT]]
    )
    chosen = [0]
    distance = np.abs(middle - middle[0]).max(axis=1)
    while len(chosen) < min(_MOST_STARTS, len(cells)) and distance.max() > 0.05:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.abs(middle - middle[chosen[-1]]).max(axis=1))
    starts = []
    for r in chosen:
        k, psi, signs = math.exp(cells[r, KAPPA]), 0.5 * middle[r, 1], quadrants[int(cells[r, QUADRANT])]
        gains = np.array([k * math.cos(psi) * signs[0], k * math.sin(psi) * signs[1], 0.5 * middle[r, 0]])
        starts.append(Basin(cost, gains))
    return tuple(starts)
