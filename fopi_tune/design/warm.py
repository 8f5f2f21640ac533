"""Solves of one spec again and again, with other limits:  tables and program are kept, a neighbour's gains start."""

from __future__ import annotations

from dataclasses import dataclass

from fopi_tune.core.controller import FoPi
from fopi_tune.design.global_search.compiled import DEPTH
from fopi_tune.design.global_search.polish import FIRST_RADIUS, MEETS, Polish, Polished
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.infeasible import moved_limit
from fopi_tune.design.measured.polish import polish_of
from fopi_tune.design.measured.problem import problem_of
from fopi_tune.design.reasons import reason_without_solving
from fopi_tune.design.search import at_own_crossover, best_from, grown_without_end, inside, public_objective
from fopi_tune.digital.implementation import nominal_crossover
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import DesignSpec

#: of the steps when larger ones lead nowhere
_NEARER = 0.1


@dataclass(frozen=True)
class Solution:
    """An answer of the solver; nothing has checked it yet.

    Args:
        gains: the controller.
        objective: in its public unit, as the solver sees it.
        solves: how many it took.
    """

    gains: FoPi
    objective: float
    solves: int = 1


@dataclass(frozen=True)
class Warm:
    """A spec's tables; the program belongs to the process.

    Args:
        problem: the problem, with any limits.
    """

    problem: Problem

    @classmethod
    def of(cls, spec: DesignSpec, violations: tuple[Violation, ...] = ()) -> Warm:
        """Make the tables once.

        Args:
            spec: with any limits.
            violations: plants and frequencies that a check found.
        """
        return cls(problem_of(spec, violations))

    def knowing(self, spec: DesignSpec, violations: tuple[Violation, ...]) -> Warm:
        """The same with more of what a check found.

        Args:
            spec: with any limits.
            violations: plants and frequencies of the check.
        """
        return Warm.of(spec, self.problem.violations + violations)

    def settle(self, spec: DesignSpec, start: FoPi) -> Solution | None:
        """The exchange from a neighbour's gains; None when it leads nowhere."""
        problem = self._problem(spec, start)
        polish, x = polish_of(problem), inside(problem, problem.scale.scaled(start))
        best: Polished | None = None
        for radius in (FIRST_RADIUS, _NEARER):
            found = polish.run(x, radius)
            if found is not None and (best is None or found.cost < best.cost):
                best = found
            if best is not None and best.settled:
                break
        polish, best = at_own_crossover(polish, best)
        return None if best is None else _solution(polish, best)

    def _problem(self, spec: DesignSpec, start: FoPi) -> Problem:
        """With the limits of a spec and, on samples, the filter that is exact at the crossover of a start."""
        problem = self.problem.with_limits_of(spec)
        return problem.exact_at(nominal_crossover(spec, start)) if problem.needs_crossover else problem

    def anew(self, spec: DesignSpec) -> Solution | None:
        """The search of the whole box, as for a design; None when it finds nothing."""
        if not spec.is_measured and reason_without_solving(spec) is not None:
            return None
        polish, found = at_own_crossover(*best_from(self.problem.with_limits_of(spec)))
        return None if found is None else _solution(polish, found)

    def farthest(self, spec: DesignSpec, start: FoPi, requirement: int) -> tuple[float, FoPi] | None:
        """How near the limit of one requirement can come to what the spec asks, all others held.

        Args:
            spec: with a limit that cannot be met, or can.
            start: gains that meet all the other requirements.
            requirement: index of the one that gives; it has one limit.

        Returns:
            The limit (the spec's own when it can be met), and gains there; None when the solver gave up.
        """
        problem = self._problem(spec, start)
        polish = polish_of(problem.missing(frozenset({requirement}), frozenset()))
        found = polish.run(inside(problem, problem.scale.scaled(start)))
        if found is None:
            return None
        moved = moved_limit(polish, found, requirement)
        limit = spec.requirements[requirement].limits[0] if moved is None else moved[0]
        return limit, problem.gains(found.x)


def _solution(polish: Polish, found: Polished) -> Solution | None:
    problem = polish.problem
    if grown_without_end(problem, found) or (problem.code == DEPTH and found.cost > MEETS):
        return None
    return Solution(problem.gains(found.x), public_objective(problem, found.cost), polish.counts.solves)
