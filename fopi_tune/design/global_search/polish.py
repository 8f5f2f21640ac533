"""A start -> the local optimum:  Ipopt on the worst plants and frequencies, exchanged until nothing is violated.

A round looks for the worst cases at the present gains, adds them to those that are known, and solves.  The step is
bounded to a region around the gains in which the known cases are trusted; a start that meets everything is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

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
    PS,
    PS_PEAK,
    S_PEAK,
    S,
    Table,
)
from fopi_tune.design.global_search.controllers import controller_of
from fopi_tune.design.global_search.families.worst import searches_of, worst_of
from fopi_tune.design.global_search.nonlinear.program import SIZES
from fopi_tune.design.global_search.nonlinear.solve import Solved, solve
from fopi_tune.design.global_search.problem import Problem, with_objective
from fopi_tune.design.global_search.rays import fill_ray
from fopi_tune.design.global_search.responses import settle
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
    MODE,
    NEAR,
    ROW,
    SLACK,
    TARGET,
    V,
    highest_crossover,
    inner_slack,
    smallest_margin,
)
from fopi_tune.errors import DomainError

#: natural units; requirements that are missed by less are met, an objective that is this exact is known
MEETS = 2e-7
#: of a peak or spread, which `MEETS` leaves inexact: rounds go on to this part of it, not to less than (natural units)
_EXACT, _FINEST = 1e-6, 1e-9
#: natural units; of a smaller objective what is left shows, and every exchange counts
_LARGE = 2e-5
#: scaled gains; smaller ones are no controller
_NO_CONTROLLER = 1e-9
#: natural units; findings of requirements with more slack are not looked at
_WITHIN = 0.25
_ROUNDS = 16
FIRST_RADIUS = 0.5
_SMALLEST_RADIUS = 0.005
#: radius within which worst cases that contradict each other do so whatever the step
_NEAR_ENOUGH = 0.045
#: radii of steps up to gains with a new crossing: the first, the smallest; most of them
_WALK, _SMALLEST_STEP, _MOST_STEPS = 0.01, 1e-5, 40
#: natural units; a step that violates by more was too long
_TOO_FAR = 0.5
#: rounds without better gains than those that are known
_MOST_STALLED = 3
#: solves without what held the gains at the end of another one, and |v| within which it is that
_MOST_FREED, _SAME_PLACE = 4, 0.2

#: kinds and sides of the rows that an objective adds
OBJECTIVE_ROWS = {
    S_PEAK: ((S, 1),),
    CS_PEAK: ((CS, 1),),
    PS_PEAK: ((PS, 1),),
    MARGIN_SPREAD: ((PHASE_MARGIN, 1), (PHASE_MARGIN, -1)),
    CROSSOVER_SPREAD: ((GAIN_AT_REFERENCE, 1),),
    IAE: ((DISCOUNTED_ERROR, 1),),
}


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
        answers: of solves, by what they were asked.
        contradictory: starts whose worst cases leave no gains near them.
        nearest: gains whose largest miss is smallest, once these were asked for: None where all leave a plant unstable.
    """

    problem: Problem
    counts: Counts = field(default_factory=Counts)
    answers: dict[tuple[object, ...], tuple[Solved, int]] = field(default_factory=dict, repr=False)
    contradictory: set[bytes] = field(default_factory=set, repr=False)
    nearest: tuple[Polished | None, ...] = ()

    def __post_init__(self) -> None:
        problem = self.problem
        self.code = problem.code
        self.table = problem.fine_table
        own = problem.rows(self.table)
        self.real_rows = len(own.kind)
        self.rows = with_objective(own, OBJECTIVE_ROWS.get(self.code, ()), self.table)
        self.in_t = np.concatenate(
            [
                own.in_depth * 1.0 if self.code == DEPTH else np.zeros(self.real_rows),
                -np.ones(len(self.rows.kind) - self.real_rows),
            ]
        )
        self.spread = self.real_rows if self.code == MARGIN_SPREAD else len(self.rows.kind)
        self.width = self.table.points.shape[1]
        self.searches = searches_of(problem, self.table, self.rows, self.real_rows)
        # of the nominal plant, which is the first of the first
        self.work = self.searches[0].work

    @property
    def is_spread(self) -> bool:
        """Whether the objective is about differences from the nominal plant."""
        return self.code in (MARGIN_SPREAD, CROSSOVER_SPREAD)

    def at(self, x: Array) -> tuple[Array, Table]:
        """Gains, and the table of the nominal plant's family at their orders."""
        sampling, table = self.problem.structure.sampling_at(x, self.table.sampling), self.searches[0].table
        return x[:3], table._replace(sampling=sampling) if sampling is not table.sampling else table

    def look(self, x: Array, within: float = _WITHIN) -> Array | None:
        """The worst cases at gains; None where a plant is unstable or a quantity has no value."""
        self.counts.looks += 1
        if self.problem.structure.size(x) < _NO_CONTROLLER:
            return None
        rows, (x, table) = self.rows, self.at(x)
        if self.code == MARGIN_SPREAD:
            fill_ray(x[2], x[0], x[1], table, self.work)
            nominal = smallest_margin(x, table, self.work)[0]
            if nominal < 0.0:
                return None
            rows = rows._replace(limit=np.concatenate([rows.limit[: self.real_rows], [nominal, nominal]]))
        if self.code == DEPTH:
            within = NOTHING
        return worst_of(self.searches, x, table, rows, self.code, self.problem.box.log_horizon, within)

    def violation(self, findings: Array) -> float:
        """The largest violation of the requirements that must hold."""
        must = self.in_t[findings[:, ROW].astype(int)] == 0.0
        return max(0.0, float(np.max(-findings[must, SLACK], initial=0.0)))

    def cost(self, findings: Array, x: Array) -> float:
        """The exact cost of gains from their worst cases."""
        if self.code == KI:
            return -self.problem.scale.controller(x).ki
        rows = findings[:, ROW].astype(int)
        if self.code == DEPTH:
            return -float(np.min(findings[self.in_t[rows] > 0.0, SLACK], initial=ENDLESS))
        return float(np.max(-findings[self.in_t[rows] < 0.0, SLACK], initial=-NOTHING))

    def run(
        self, x: Array, radius: float = FIRST_RADIUS, hopeless: float = math.inf, rival: Polished | None = None
    ) -> Polished | None:  # fmt: skip
        """Exchange from scaled gains; None when nothing that meets everything was found.

        Args:
            x: the start.
            radius: of the first step, relative to the gains.
            hopeless: a cost; a result on the edge of its region with more is not improved further.
            rival: a local optimum; the result of an exchange that comes close to it before it ends.
        """
        start = x.tobytes()
        found = self.look(x) if start not in self.contradictory else None
        if found is None:
            return None
        t, known, pool, stalled = self._t_of(self.cost(found, x)), self._met(found, x), [], 0
        freed, dropped, gap = _MOST_FREED, list[Array](), math.inf
        if known is not None and self.problem.is_at_floor(known.cost, x):
            return replace(known, prices=np.zeros(self.real_rows), settled=True)  # no limit has a price
        for count in range(1, _ROUNDS + 1):
            pool = merged(pool, found)
            solved, cuts = self._solve(pool, x, t, radius)
            after = self.look(solved.x) if solved.ok else None
            if after is None:
                contradict = solved.is_infeasible and known is None and len(pool) <= len(found)
                if contradict and radius <= _NEAR_ENOUGH:
                    self.contradictory.add(start)
                    break
                # what has no solution in a region has seldom one in a part of it: the smallest that it takes to see
                radius, pool = min(0.3 * radius, _NEAR_ENOUGH if contradict else math.inf), merged([], found)
                if radius < _SMALLEST_RADIUS:
                    break
                continue
            violation, cost = self.violation(after), self.cost(after, solved.x)
            missed = self._violated(solved.x, dropped)
            if missed:
                # a look sees the deepest of neighbours alone
                pool, x, found, t = [*pool, *missed], solved.x, after, self._t_of(cost)
                continue
            if violation <= MEETS and self.problem.is_at_floor(cost, solved.x):
                return Polished(cost, solved.x, np.zeros(self.real_rows), count, cuts, True)
            gap, before = self._gap(cost, solved), gap
            if violation <= MEETS and gap <= MEETS:
                if known is None or cost <= known.cost + 1e-9 * max(1.0, abs(cost)):
                    known = Polished(cost, solved.x, solved.prices, count, cuts, not solved.on_boundary)
                x, found, t = solved.x, after, solved.t
                if cost > hopeless:
                    break
                is_coarse = self.code in OBJECTIVE_ROWS and _FINEST < _EXACT * abs(cost) < gap < 0.5 * before
                if is_coarse and not solved.on_boundary:
                    continue
                if solved.blocking and not solved.on_boundary and self.problem.structure.has_orders and freed > 0:
                    dropped += [f for f in [*pool, *after] if _is_of(f, solved.blocking)]
                    found = np.array([f for f in after if not _is_of(f, solved.blocking)])
                    x, t, freed, pool = solved.x, solved.t, freed - 1, []
                    continue
                if not solved.on_boundary:
                    held = known.x is x and has_vanished(pool, found) and len(self.problem.fine_points[0]) == 1
                    return self._walked(known, found, t) if held else known
                radius = min(2.0 * radius, FIRST_RADIUS)
                continue
            if violation > _TOO_FAR:
                radius, pool = 0.4 * radius, merged(pool, after)
                continue
            if rival is not None and not solved.on_boundary and self._leads_to(rival, solved.x, known, violation, cost):
                return rival
            stalled = stalled + 1 if self._stalls(known, cost, violation) else 0
            if stalled == _MOST_STALLED:
                break
            x, found, t = solved.x, after, self._t_of(cost)
        return known

    def walk(self, x: Array) -> Polished | None:
        """Better gains in short steps from some that meet everything; None where these do not."""
        found, known = self.look(x), self.unchanged(x)
        return None if found is None or known is None else self._walked(known, found, self._t_of(known.cost))

    def unchanged(self, x: Array) -> Polished | None:
        """Gains as they are; None where they do not meet everything."""
        return None if (found := self.look(x)) is None else self._met(found, x)

    def _met(self, found: Array, x: Array) -> Polished | None:
        met = self.violation(found) <= MEETS
        return Polished(self.cost(found, x), x, np.full(self.real_rows, np.nan)) if met else None

    def _violated(self, x: Array, findings: list[Array]) -> list[Array]:
        """Those of older findings that are violated at gains where their peaks or crossings are now."""
        kept = []
        for f in findings:
            (gains, table), rows, q = self.at(x), self.rows, int(f[ROW])
            ends = max(rows.low_v[q], table.v[1]), min(rows.high_v[q], table.v[-2])
            value, _ = settle(
                rows.kind[q], float(rows.side[q]), int(f[MODE]), controller_of(gains, table.sampling),
                self.problem.scaled.member(f[FIELDS:]), f[V], f[NEAR], f[TARGET], *ends, self.problem.box.log_horizon,
                rows.tilt[q],
            )  # fmt: skip
            if q < self.real_rows and inner_slack(rows.side[q], rows.limit[q], rows.scale[q], value) < -MEETS:
                kept.append(f)
        return kept

    def _leads_to(self, rival: Polished, x: Array, known: Polished | None, violation: float, cost: float) -> bool:
        """Whether gains lead to a local optimum, and nothing better is known."""
        least = min(math.inf if known is None else known.cost, cost if violation <= MEETS else math.inf)
        settled = rival.settled and abs(rival.cost) > _LARGE and least >= rival.cost
        return settled and not self.problem.structure.are_apart(x, rival.x)

    def _stalls(self, known: Polished | None, cost: float, violation: float) -> bool:
        """Whether a solve that promised better gains ended at none: at a limit that no gains change.

        That of |C S| as omega -> 0 is one, which a slow integral approaches below the table.  Asked where orders are
        free, where a solve takes longest; of other structures such rounds are known not to change the result.
        """
        if known is None or violation > MEETS or not self.problem.structure.has_orders:
            return False
        return cost >= known.cost - 1e-9 * max(1.0, abs(cost))

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
        """A solve, and how many slots it has; the same again is not solved again."""
        asked = (x.tobytes(), t, radius, *(finding.tobytes() for finding in pool))
        if asked not in self.answers:
            self.answers[asked] = self._answer(pool, x, t, radius)
        return self.answers[asked]

    def _answer(self, pool: list[Array], x: Array, t: float, radius: float) -> tuple[Solved, int]:
        gains, table = self.at(x)
        slots = [self._first_slot(gains, table), *slots_of(
            order_of(pool, self.rows, self.real_rows), controller_of(gains, table.sampling), self.rows,
            self.problem.scaled, self.in_t, self.spread,
        )]  # fmt: skip
        # more equalities than numbers of a controller contradict or repeat each other
        surplus = [slot for slot in slots if slot.is_equal][len(x) :]
        slots = [slot for slot in slots if not any(slot is other for other in surplus)][: SIZES[-1]]
        size = next(s for s in SIZES if s >= len(slots))
        self.counts.solves += 1
        errors = error_rows(pool, self.rows, self.problem.scaled, self.problem.box.log_horizon)
        return solve(self.problem, self.code, slots, errors, x, t, radius, size, self.real_rows), len(slots)

    def _first_slot(self, x: Array, table: Table) -> Slot:
        """The nominal plant's crossover where a spread needs it, else an idle slot."""
        nominal = table.members[0]
        if not self.is_spread:
            return idle_slot(nominal)
        fill_ray(x[2], x[0], x[1], table, self.work)
        if self.code == MARGIN_SPREAD:
            _, v, near = smallest_margin(x, table, self.work)
        else:
            v, near, _ = highest_crossover(x, table, self.work)
        return reference_slot(nominal, controller_of(x, table.sampling), v, near)


def _is_of(finding: Array, places: tuple[tuple[int, float], ...]) -> bool:
    """Whether a finding is of one of these rows and v."""
    return any(finding[ROW] == row and abs(finding[V] - v) < _SAME_PLACE for row, v in places)
