"""A start -> the local optimum:  Ipopt on the worst plants and frequencies, exchanged until nothing is violated.

A round looks for the worst cases at the present gains, adds them to those that are known, and solves.  The step is
bounded to a region around the gains in which the known cases are trusted; a start that meets everything is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.design.global_search.compiled import (
    CROSSOVER_SPREAD,
    CS,
    CS_PEAK,
    DEPTH,
    DISCOUNTED_ERROR,
    ENDLESS,
    GAIN_AT_REFERENCE,
    IAE,
    KI,
    MARGIN_SPREAD,
    NOTHING,
    PHASE_MARGIN,
    S_PEAK,
    Rows,
    S,
    work_for,
)
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.program import ERRORS, INDEX, SIZES, Kind, raising_interrupts, solver_of
from fopi_tune.design.global_search.rays import fill_ray
from fopi_tune.design.global_search.samples import controller_of
from fopi_tune.design.global_search.slots import (
    Slot,
    error_rows,
    has_vanished,
    idle_slot,
    merged,
    order_of,
    reference_slot,
    slots_of,
)
from fopi_tune.design.global_search.worst_case import (
    FIELDS,
    ROW,
    SLACK,
    highest_crossover,
    smallest_margin,
    worst_cases,
)
from fopi_tune.errors import DomainError

#: natural units; requirements that are missed by less are met, an objective that is this exact is known
MEETS = 2e-7
#: scaled gains; smaller ones are no controller
_NO_CONTROLLER = 1e-9
#: natural units; findings of requirements with more slack are not looked at
_WITHIN = 0.25
_MOST_FINDINGS = 96
_ROUNDS = 16
FIRST_RADIUS = 0.5
_SMALLEST_RADIUS = 0.005
#: numbers of a controller: more equalities contradict or repeat each other
_UNKNOWN = 3
#: radii of steps up to gains with a new crossing: the first, the smallest; most of them
_WALK, _SMALLEST_STEP, _MOST_STEPS = 0.01, 1e-5, 40
#: natural units; a step that violates by more was too long
_TOO_FAR = 0.5
_FREQUENCY_REACH = 1.5

_OBJECTIVE_ROWS = {
    S_PEAK: ((S, 1),),
    CS_PEAK: ((CS, 1),),
    MARGIN_SPREAD: ((PHASE_MARGIN, 1), (PHASE_MARGIN, -1)),
    CROSSOVER_SPREAD: ((GAIN_AT_REFERENCE, 1),),
    IAE: ((DISCOUNTED_ERROR, 1),),
}


@dataclass(frozen=True)
class Solved:
    """What Ipopt returned: scaled gains, the value of t, multipliers of limits (d cost/d limit), one a row."""

    ok: bool
    x: Array
    t: float
    on_boundary: bool
    prices: Array


@dataclass(frozen=True)
class Polished:
    """Gains at which nothing is violated.

    Args:
        cost: exact, smaller is better.
        x: scaled numbers of the controller.
        prices: d cost/d limit of each row.
        rounds: of exchange.
        cuts: plants and frequencies in the last solve.
        settled: whether the last solve ended inside its region.
    """

    cost: float
    x: Array
    prices: Array
    rounds: int = 0
    cuts: int = 0
    settled: bool = False


@dataclass
class Counts:
    """Work done, for reports."""

    solves: int = 0
    looks: int = 0


@dataclass
class Polish:
    """The exchange of one problem.

    Args:
        problem: the problem.
        counts: the work done.
    """

    problem: Problem
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        problem = self.problem
        self.code = problem.code
        self.table = problem.fine_table
        own = problem.rows(self.table)
        self.real_rows = len(own.kind)
        self.rows = _with_objective(own, _OBJECTIVE_ROWS.get(self.code, ()), self.table)
        self.in_t = np.concatenate(
            [
                own.in_depth * 1.0 if self.code == DEPTH else np.zeros(self.real_rows),
                -np.ones(len(self.rows.kind) - self.real_rows),
            ]
        )
        self.spread = self.real_rows if self.code == MARGIN_SPREAD else len(self.rows.kind)
        self.work = work_for(self.table)
        points, self.spacing = problem.fine_points
        self.out = np.empty((_MOST_FINDINGS, FIELDS + points.shape[1]))
        self.low, self.high = problem.spec.plant.low, problem.spec.plant.high

    def look(self, x: Array, within: float = _WITHIN) -> Array | None:
        """The worst cases at gains; None where a plant is unstable or a quantity has no value."""
        self.counts.looks += 1
        if self.problem.structure.size(x) < _NO_CONTROLLER:
            return None
        rows = self.rows
        if self.code == MARGIN_SPREAD:
            fill_ray(x[2], x[0], x[1], self.table, self.work)
            nominal = smallest_margin(x, self.table, self.work)[0]
            if nominal < 0.0:
                return None
            rows = rows._replace(limit=np.concatenate([rows.limit[: self.real_rows], [nominal, nominal]]))
        if self.code == DEPTH:
            within = NOTHING
        count = worst_cases(
            x, self.table, rows, self.problem.scaled.plants, self.low, self.high, self.spacing,
            self.problem.box.log_horizon, within, self.real_rows, self.work, self.out,
        )  # fmt: skip
        return None if count < 0 else self.out[:count].copy()

    def violation(self, findings: Array) -> float:
        """The largest violation of the requirements that must hold."""
        must = self.in_t[findings[:, ROW].astype(int)] == 0.0
        return max(0.0, float(np.max(-findings[must, SLACK], initial=0.0)))

    def misses(self, x: Array) -> Array:
        """By how much each requirement's row is missed at gains, natural units, 0 where it is met; shape (rows,)."""
        found, missed = self.look(x), np.zeros(self.real_rows)
        for finding in [] if found is None else found:
            q = int(finding[ROW])
            if q < self.real_rows:
                missed[q] = max(missed[q], -finding[SLACK])
        return missed

    def is_closer(self, x: Array, row: int, side: float) -> bool:
        """Whether an equality's limit moved to a side (1 up, -1 down) would be missed by less."""
        before = self.misses(x)[row]
        rows = self.rows
        step = side * min(1e-3, 0.5 * before) / float(rows.scale[row])
        limit = rows.limit.copy()
        limit[row] += step
        self.rows = rows._replace(limit=limit)
        after = self.misses(x)[row]
        self.rows = rows
        return bool(after < before)

    def cost(self, findings: Array, x: Array) -> float:
        """The exact cost of gains from their worst cases."""
        if self.code == KI:
            return -self.problem.scale.controller(x).ki
        rows = findings[:, ROW].astype(int)
        if self.code == DEPTH:
            return -float(np.min(findings[self.in_t[rows] > 0.0, SLACK], initial=ENDLESS))
        return float(np.max(-findings[self.in_t[rows] < 0.0, SLACK], initial=-NOTHING))

    def run(self, x: Array, radius: float = FIRST_RADIUS, hopeless: float = math.inf) -> Polished | None:
        """Exchange from scaled gains; None when nothing that meets everything was found.

        Args:
            x: the start.
            radius: of the first step, relative to the gains.
            hopeless: a cost; a result on the edge of its region with more is not improved further.
        """
        found = self.look(x)
        if found is None:
            return None
        t, known, pool = self._t_of(self.cost(found, x)), None, []
        if self.violation(found) <= MEETS:
            known = Polished(self.cost(found, x), x, np.full(self.real_rows, np.nan))
        for count in range(1, _ROUNDS + 1):
            pool = merged(pool, found)
            solved, cuts = self._solve(pool, x, t, radius)
            after = self.look(solved.x) if solved.ok else None
            if after is None:
                radius, pool = 0.3 * radius, merged([], found)
                if radius < _SMALLEST_RADIUS:
                    break
                continue
            violation, cost = self.violation(after), self.cost(after, solved.x)
            if violation <= MEETS and self._gap(cost, solved) <= MEETS:
                if known is None or cost <= known.cost + 1e-9 * max(1.0, abs(cost)):
                    known = Polished(cost, solved.x, solved.prices, count, cuts, not solved.on_boundary)
                x, found, t = solved.x, after, solved.t
                if cost > hopeless:
                    break
                if not solved.on_boundary:
                    held = known.x is x and has_vanished(pool, found) and len(self.problem.fine_points[0]) == 1
                    return self._walked(known, found, t) if held else known
                radius = min(2.0 * radius, FIRST_RADIUS)
                continue
            if violation > _TOO_FAR:
                radius, pool = 0.4 * radius, merged(pool, after)
                continue
            x, found, t = solved.x, after, self._t_of(cost)
        return known

    def _walked(self, known: Polished, found: Array, t: float) -> Polished:
        """Better gains, up to those where a crossing appears at once, as where |L| touches 1 at another frequency.

        A program that knows it keeps its quantities also where it does not exist, and ends too early; one that does not
        steps over the border.  So steps without it are taken, and halved when it appears.  Of a single plant only:
        where it first appears in a box is not known exactly, and a look's grid sees it too late.
        """
        radius, crossings = _WALK, self._count_crossings(known.x)
        for count in range(known.rounds + 1, known.rounds + _MOST_STEPS if crossings else 0):
            solved, cuts = self._solve(merged([], found), known.x, t, radius)
            after = self.look(solved.x) if solved.ok else None
            cost = math.inf if after is None else self.cost(after, solved.x)
            met = after is not None and max(self.violation(after), self._gap(cost, solved)) <= MEETS
            met = met and self._count_crossings(solved.x) == crossings
            if after is not None and met and cost < known.cost:
                known = Polished(cost, solved.x, solved.prices, count, cuts, True)
                found, t = after, solved.t
            else:
                radius *= 0.5
            if (met and not solved.on_boundary) or radius < _SMALLEST_STEP:
                break
        return known

    def _count_crossings(self, x: Array) -> tuple[int, int] | None:
        """How many gain and phase crossovers the loops have, by core/; None where it cannot list them."""
        try:
            loops = self.problem.loops(self.problem.gains(x), self.problem.fine_points[0])
            return len(gain_crossovers(loops).row), len(phase_crossovers(loops).row)
        except DomainError:
            return None

    def _gap(self, cost: float, solved: Solved) -> float:
        """By how much the exact cost is worse than that of the program."""
        return 0.0 if self.code == KI else solved.t + cost if self.code == DEPTH else cost - solved.t

    def _t_of(self, cost: float) -> float:
        return -cost if self.code == DEPTH else (0.0 if self.code == KI else cost)

    def _solve(self, pool: list[Array], x: Array, t: float, radius: float) -> tuple[Solved, int]:
        slots = [self._first_slot(x), *slots_of(
            order_of(pool, self.rows, self.real_rows), x, self.rows, self.problem.scaled, self.in_t, self.spread
        )]  # fmt: skip
        surplus = [slot for slot in slots if slot.is_equal][_UNKNOWN:]
        slots = [slot for slot in slots if not any(slot is other for other in surplus)][: SIZES[-1]]
        size = next(s for s in SIZES if s >= len(slots))
        self.counts.solves += 1
        return solve(self.problem, self.code, slots, self._errors(pool), x, t, radius, size, self.real_rows), len(slots)

    def _errors(self, pool: list[Array]) -> Array:
        return error_rows(pool, self.rows, self.problem.scaled, self.problem.box.log_horizon)

    def _first_slot(self, x: Array) -> Slot:
        """The nominal plant's crossover where a spread needs it, else an idle slot."""
        nominal = self.table.members[0]
        if self.code not in (MARGIN_SPREAD, CROSSOVER_SPREAD):
            return idle_slot(nominal)
        fill_ray(x[2], x[0], x[1], self.table, self.work)
        if self.code == MARGIN_SPREAD:
            _, v, near = smallest_margin(x, self.table, self.work)
        else:
            v, near, _ = highest_crossover(x, self.table, self.work)
        return reference_slot(nominal, controller_of(x, self.table.sampling), v, near)


def _with_objective(own: Rows, more: tuple[tuple[int, int], ...], table: Any) -> Rows:
    """The rows of requirements, then those of the objective."""
    if not more:
        return own
    count, last = len(more), len(table.v) - 1

    def joined(a: Any, b: Any) -> Any:
        return np.concatenate([a, np.array(b, dtype=np.asarray(a).dtype)])

    return Rows(
        joined(own.kind, [kind for kind, _ in more]), joined(own.side, [side for _, side in more]),
        joined(own.limit, [0.0] * count), joined(own.nominal, [False] * count), joined(own.first, [0] * count),
        joined(own.last, [last] * count), joined(own.scale, [1.0] * count), joined(own.in_depth, [False] * count),
        joined(own.low_v, [-math.inf] * count), joined(own.high_v, [math.inf] * count),
        joined(own.soft, [False] * count),
    )  # fmt: skip


def solve(
    problem: Problem, code: int, slots: list[Slot], errors: Array, x: Array, t: float, radius: float, size: int,
    real_rows: int,
) -> Solved:  # fmt: skip
    """One solve of the program with these slots, within a region around x."""
    box, structure = problem.box, problem.structure
    units = structure.units(x)
    z = x / units
    idle = idle_slot(problem.fine_table.members[0])
    padded = slots + [idle] * (size - len(slots))
    low, high = np.full(4 + size, -np.inf), np.full(4 + size, np.inf)
    low[0], high[0] = box.kp_low / units[0], box.kp_high / units[0]
    if box.ki_low == 0.0:
        low[1] = 0.0
    if box.ki_high == 0.0 or x[1] == 0.0:
        # with ki = 0 the limits omega -> 0 are others: a start there stays
        high[1] = 0.0
    if x[1] == 0.0:
        low[1] = 0.0
    third = (box.kd_low, box.kd_high) if 2 in structure.gains else (box.alpha_low, box.alpha_high)
    low[2], high[2] = third[0] / units[2], third[1] / units[2]
    reach = radius * structure.reach(z)
    low[:3], high[:3] = np.maximum(low[:3], z - reach), np.minimum(high[:3], z + reach)
    high[:3] = np.maximum(high[:3], low[:3])
    if code == KI:
        low[3] = high[3] = t = 0.0
    v = np.array([slot.v for slot in padded])
    low[4:], high[4:] = v - _FREQUENCY_REACH, v + _FREQUENCY_REACH
    log_ki = -box.log_gain
    scale_ki = max(abs(float(x[1])) * math.exp(log_ki + structure.order(x) * box.log_omega), 1e-12)
    rows_low = np.concatenate([[box.ki_low / scale_ki], np.zeros(size + ERRORS), np.zeros(size)])
    rows_high = np.concatenate([[box.ki_high / scale_ki], np.full(size + ERRORS, np.inf), np.zeros(size)])
    rows_high[1 : 1 + size][[slot.is_equal for slot in padded]] = 0.0
    if problem.spec.controller.has_derivative:
        # rows that are off are 0 whatever the gains are: at a limit of 0 there is no interior point, which costs many
        # steps; with kp + ki s^-alpha specs are known that are solved with it alone
        rows_low[1 + size : 1 + size + ERRORS][errors[:, 2] == 0.0] = -1.0
    weight_t = -1.0 if code == DEPTH else 1.0
    whole = [1.0, 0.0] if code == KI else [0.0, weight_t]
    whole += [log_ki - math.log(scale_ki), box.log_omega, *units.tolist()]
    kind, numbers = Kind.of(problem.scaled.sampling)
    parameters = np.concatenate([np.ravel([slot.p for slot in padded]), errors.ravel(), whole, numbers])
    start = np.clip(np.concatenate([z, [t], v]), low, high)
    solver = solver_of(size, kind)
    with raising_interrupts():
        result = solver(x0=start, p=parameters, lbx=low, ubx=high, lbg=rows_low, ubg=rows_high)
    found = np.array(result["x"]).ravel()
    ok = bool(solver.stats()["success"]) and bool(np.all(np.isfinite(found)))
    gains = found[:3] * units if ok else x
    lam = np.array(result["lam_g"]).ravel()
    unit_of_cost = scale_ki if code == KI else 1.0
    prices = _prices(padded, lam, size, real_rows) * unit_of_cost
    boundary = bool(np.any(np.abs(found[:3] - z) > 0.999 * reach))
    return Solved(ok, gains, float(found[3]), boundary, prices)


def _prices(slots: list[Slot], lam: Array, size: int, real_rows: int) -> Array:
    """d cost/d limit of each requirement's row, from the multipliers of rows and of equations that hold a limit."""
    prices = np.zeros(real_rows)
    for k, slot in enumerate(slots):
        if 0 <= slot.row < real_rows:
            if slot.by_level:
                prices[slot.row] += lam[1 + size + ERRORS + k]
            else:
                prices[slot.row] += lam[1 + k] * slot.p[INDEX["sign"]]
    return prices
