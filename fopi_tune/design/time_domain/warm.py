"""Solves of one spec for scenarios again and again, with other limits:  a neighbour's gains start."""

from __future__ import annotations

from dataclasses import dataclass

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.exchange import MET, Counts, Exchanged, exchange, solve
from fopi_tune.design.time_domain.infeasible import relaxation_from
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.warm import Solution
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import DesignSpec, Limit
from fopi_tune.spec.scenarios import every_requirement


@dataclass(frozen=True)
class ScenarioWarm:
    """What `design.warm.Warm` is for a spec without scenarios.

    Args:
        violations: plants and frequencies at which a check refuted gains.
    """

    violations: tuple[Violation, ...] = ()

    def knowing(self, spec: DesignSpec, violations: tuple[Violation, ...]) -> ScenarioWarm:
        """The same with more of what a check found.

        Args:
            spec: with any limits.
            violations: plants and frequencies of the check.
        """
        return ScenarioWarm(self.violations + violations)

    def settle(self, spec: DesignSpec, start: FoPi) -> Solution | None:
        """The exchange from a neighbour's gains; None when it leads nowhere."""
        counts = Counts()
        return _solution(exchange(ScenarioProblem.of(spec, self.violations), start, counts), counts)

    def anew(self, spec: DesignSpec) -> Solution | None:
        """The search of the whole box, as for a design; None when it finds nothing."""
        counts = Counts()
        return _solution(solve(ScenarioProblem.of(spec, self.violations), counts), counts)

    def farthest(self, spec: DesignSpec, start: FoPi, requirement: int) -> tuple[float, FoPi] | None:
        """How near the limit of one requirement can come to what the spec asks, all others held.

        Args:
            spec: with a limit that cannot be met, or can.
            start: gains that meet all the other requirements.
            requirement: its place among all, those of scenarios last.

        Returns:
            The limit (the spec's own when it can be met), and gains there; None when the solver gave up.
        """
        problem = ScenarioProblem.of(spec, self.violations).missing(frozenset({requirement}), frozenset())
        found = exchange(problem, start, Counts())
        if found is None or found.violation > MET:
            return None
        wanted = every_requirement(spec)[requirement]
        own = wanted.limit if isinstance(wanted, Limit) else wanted.limits[0]
        moved = relaxation_from(problem, requirement, found).new_limit if found.objective > 0.0 else None
        return (own if moved is None else moved), found.gains


def _solution(found: Exchanged | None, counts: Counts) -> Solution | None:
    if found is None or found.violation > MET:
        return None
    return Solution(found.gains, found.objective, counts.steps)
