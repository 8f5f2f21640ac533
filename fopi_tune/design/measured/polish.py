"""The exchange for measured responses:  as `global_search/polish.py`, with worst cases and slots from the curves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.measured.loops import MeasuredLoop
from fopi_tune.design.global_search.compiled import DEPTH, MARGIN_SPREAD, NOTHING
from fopi_tune.design.global_search.nonlinear.program import INDEX, SIZES
from fopi_tune.design.global_search.nonlinear.solve import Solved, solve
from fopi_tune.design.global_search.polish import (
    FIRST_RADIUS,
    MEETS,
    OBJECTIVE_ROWS,
    Counts,
    Polish,
    Polished,
)
from fopi_tune.design.global_search.problem import Problem, with_objective
from fopi_tune.design.global_search.slots import Slot, error_rows, idle_slot, order_of
from fopi_tune.design.global_search.worst_case import FIELDS, MODE, ROW, V
from fopi_tune.design.measured.problem import MeasuredProblem
from fopi_tune.design.measured.slots import at_fixed_frequency, measured_slots, reference_slot
from fopi_tune.design.measured.worst_cases import WorstCases
from fopi_tune.errors import DomainError

#: scaled gains; smaller ones are no controller
_NO_CONTROLLER = 1e-9
#: natural units; findings of requirements with more slack are not looked at
_WITHIN = 0.25
#: |v| within which a frequency is that of an older finding
_NEAR = 0.2
#: the last radius of a search that has not settled
_SMALLEST_RADIUS = 0.03
#: of the pattern search: steps relative to the gains, the first and the last, looks, and the gain of a step that counts
_FIRST_STEP, _LAST_STEP, _MOST_LOOKS, _LEAST_GAIN = 0.05, 2e-4, 150, 1e-7


def polish_of(problem: Problem, counts: Counts | None = None) -> Polish:
    """The exchange of a problem, of measured responses or not; `counts` of the work done so far."""
    kind = MeasuredPolish if isinstance(problem, MeasuredProblem) else Polish
    return kind(problem, Counts() if counts is None else counts)


class MeasuredPolish(Polish):
    """The exchange of one problem with measured responses."""

    def __post_init__(self) -> None:
        problem = self.problem
        assert isinstance(problem, MeasuredProblem)
        self.measured = problem
        self.code, self.table = problem.code, problem.fine_table
        own = problem.rows(self.table)
        self.real_rows = len(own.kind)
        self.rows = with_objective(own, OBJECTIVE_ROWS.get(self.code, ()), self.table)
        depth = own.in_depth * 1.0 if self.code == DEPTH else np.zeros(self.real_rows)
        self.in_t = np.concatenate([depth, -np.ones(len(self.rows.kind) - self.real_rows)])
        self.spread = self.real_rows if self.code == MARGIN_SPREAD else len(self.rows.kind)
        self.width = 1

    def _loops(self, x: Array) -> list[MeasuredLoop]:
        return self.measured.measured_loops(self.problem.gains(x))

    def run(
        self, x: Array, radius: float = FIRST_RADIUS, hopeless: float = math.inf, rival: Polished | None = None
    ) -> Polished | None:  # fmt: skip
        """The exchange; where that of the smallest radius does not settle, as among peaks of noise, a pattern search.

        Args:
            x: the start.
            radius: of the first step, relative to the gains.
            hopeless: a cost; a result with more is not improved further.
            rival: a local optimum, the result of an exchange that comes close to it.
        """
        found = super().run(x, radius, hopeless, rival)
        if found is None or found is rival or found.settled or found.cost > hopeless or radius > _SMALLEST_RADIUS:
            return found
        return self._searched(found)

    def _stalls(self, known: Polished | None, cost: float, violation: float) -> bool:
        """Whether a solve that promised better gains ended at none, at a peak that it did not know of."""
        return known is not None and violation <= MEETS and cost >= known.cost - 1e-9 * max(1.0, abs(cost))

    def _searched(self, known: Polished) -> Polished:
        """Better gains by steps along each number and along the last step that led down."""
        size, looks, last = _FIRST_STEP, self.counts.looks, np.zeros(len(known.x))
        while size > _LAST_STEP and self.counts.looks < looks + _MOST_LOOKS:
            units = size * np.maximum(np.abs(known.x), 1e-3 * self.problem.structure.size(known.x))
            units[known.x == 0.0] = 0.0
            ways = [last, *(sign * row for row in np.diag(units) for sign in (1.0, -1.0))]
            better = None
            for way in ways:
                better = self._better(known.x + way, known) if way.any() else None
                if better is not None:
                    last, known = 2.0 * way, better
                    break
            if better is None:
                size, last = 0.5 * size, np.zeros(len(known.x))
        return known

    def _better(self, x: Array, known: Polished) -> Polished | None:
        """Gains at which nothing is violated and whose cost is smaller; None where they are not."""
        x = self.problem.scale.scaled(self.problem.gains(x))
        found = self.look(x)
        if found is None or self.violation(found) > MEETS:
            return None
        cost = self.cost(found, x)
        is_better = cost < known.cost - _LEAST_GAIN * max(1.0, abs(known.cost))
        return replace(known, cost=cost, x=x) if is_better else None

    def look(self, x: Array, within: float = _WITHIN) -> Array | None:
        """The worst cases at gains; None where a loop is not shown to be stable, or a quantity has no value.

        Args:
            x: scaled numbers of the controller.
            within: findings of requirements with a larger slack are left out, natural units.
        """
        self.counts.looks += 1
        if self.problem.structure.size(x) < _NO_CONTROLLER:
            return None
        loops, rows = self._loops(x), self.rows
        if self.code == MARGIN_SPREAD:
            crossovers = loops[0].at(loops[0].gain_crossovers)
            if not len(crossovers.u):
                return None
            nominal = float(crossovers.phase_margin_rad.min())
            rows = rows._replace(limit=np.concatenate([rows.limit[: self.real_rows], [nominal, nominal]]))
        if self.code == DEPTH:
            within = NOTHING
        cases = WorstCases(loops, rows, self.real_rows, self.problem.scale, within)
        return cases.find(self.measured.family.unstable_poles)

    def _answer(self, pool: list[Array], x: Array, t: float, radius: float) -> tuple[Solved, int]:
        loops, scale = self._loops(x), self.problem.scale
        found = measured_slots(
            order_of(pool, self.rows, self.real_rows), loops, self.rows, scale, self.in_t, self.spread
        )  # fmt: skip
        slots = [self._reference(loops[0]), *found]
        # more equalities than numbers of a controller contradict or repeat each other
        surplus = [slot for slot in slots if slot.is_equal][len(x) :]
        slots = [slot for slot in slots if not any(slot is other for other in surplus)][: SIZES[-1]]
        size = next(s for s in SIZES if s >= len(slots))
        errors = error_rows([], self.rows, self.problem.scaled, self.problem.box.log_horizon)

        def solved(slots: list[Slot]) -> Solved:
            self.counts.solves += 1
            return solve(self.problem, self.code, slots, errors, x, t, radius, size, self.real_rows)

        answer = solved(slots)
        if not answer.ok and any(slot.p[INDEX["peak"]] for slot in slots):
            # a peak may be flat, or vanish on the way: its row is then kept at the frequency where it is now
            answer = solved([at_fixed_frequency(slot) for slot in slots])
        return answer, len(slots)

    def _reference(self, nominal: MeasuredLoop) -> Slot:
        """The nominal crossover where a spread needs it, else an idle slot."""
        if self.is_spread and len(nominal.gain_crossovers):
            return reference_slot(nominal, self.problem.scale, self.code == MARGIN_SPREAD)
        return idle_slot(self.table.members[0], True)

    def _violated(self, x: Array, findings: list[Array]) -> list[Array]:
        """Those of older findings that are violated at gains where their peaks or crossings are now."""
        if not findings:
            return []
        now = self.look(x)
        kept = []
        if now is None:
            return []
        for f in findings:
            same = (now[:, ROW] == f[ROW]) & (now[:, FIELDS] == f[FIELDS]) & (now[:, MODE] == f[MODE])
            near = now[same & (np.abs(now[:, V] - f[V]) < _NEAR)]
            if f[ROW] < self.real_rows and np.any(near[:, 1] < -MEETS):
                kept.append(f)
        return kept

    def _count_crossings(self, x: Array) -> tuple[int, int] | None:
        """How many gain and phase crossovers the loops have; None where it cannot be said."""
        try:
            loops = self._loops(x)
            return sum(len(each.gain_crossovers) for each in loops), sum(len(each.phase_crossovers) for each in loops)
        except DomainError:
            return None
