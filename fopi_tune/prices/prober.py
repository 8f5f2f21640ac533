"""One limit at a time:  limit, a neighbour's gains -> the best gains there, checked by `fopi_tune.proof`.

The solver's answer counts only when the check finds every requirement met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from fopi_tune.core.controller import FoPi
from fopi_tune.design import Warm
from fopi_tune.design.time_domain.warm import ScenarioWarm
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.errors import DomainError
from fopi_tune.prices.limit import MovableLimit
from fopi_tune.prices.result import PointStatus, TradeoffPoint
from fopi_tune.proof import Verification, reassess, verify
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import DesignSpec, Objective, Sense

#: a limit that the gains keep by more than this (neper or radian) holds nothing back
_CLEAR = 1e-5
#: how often an answer of the exchange that the check refuses is made again
_MOST_REFUTATIONS = 3


@dataclass(frozen=True)
class Probe:
    """What became of a limit.

    Args:
        limit: public unit.
        status: met only with a verification in which all is met.
        found: of the gains; None when infeasible.
    """

    limit: float
    status: PointStatus
    found: Verification | None

    @property
    def is_met(self) -> bool:
        """Whether there are gains that the check has passed."""
        return self.status is PointStatus.MET

    @property
    def gains(self) -> FoPi:
        """Those of a limit that is met."""
        assert self.found is not None
        return self.found.gains

    @property
    def objective(self) -> float | None:
        """Its value, public unit; None unless the limit is met."""
        return self.found.objective if self.found is not None and self.is_met else None


@dataclass
class Prober:
    """Solves and checks a spec with one limit turned; keeps what is compiled, and which limits are infeasible."""

    knob: MovableLimit
    base: Probe
    warm: Warm | ScenarioWarm
    #: limits that no start met
    infeasible: list[float] = field(default_factory=list)

    @classmethod
    def of(cls, knob: MovableLimit, gains: FoPi) -> Prober:
        """Start from the design of the knob's spec.

        Raises:
            DomainError: the check refuses the design.
        """
        found = verify(knob.spec, gains, implementation=designed_implementation(knob.spec, gains))
        if not found.all_met:
            raise DomainError(
                "the design at the spec's own limit does not pass the check; there is no point to start from"
            )
        warm = ScenarioWarm() if knob.spec.designs_scenarios else Warm.of(knob.spec)
        return cls(knob, Probe(knob.limit, PointStatus.MET, found), warm)

    def probe(self, limit: float, near: Probe) -> Probe:
        """The best gains with the limit there.

        Args:
            limit: public unit.
            near: a limit that is met, as near as there is one.
        """
        same = self.unmoved(limit, near)
        if same is not None:
            return same
        if self.is_known_infeasible(limit):
            return Probe(limit, PointStatus.INFEASIBLE, None)
        warm = self.from_neighbour(limit, near)
        return warm if warm is not None and warm.is_met else self.from_all_starts(limit, warm)

    def unmoved(self, limit: float, near: Probe) -> Probe | None:
        """The neighbour itself where the limit binds neither there nor here: its optimum is also this one's."""
        if near.found is None or not near.is_met:
            return None
        found = reassess(self.knob.at(limit), near.found)
        return None if self._binds(found) or self._binds(near.found) else Probe(limit, PointStatus.MET, found)

    def kept(self, limit: float, near: Probe) -> Probe:
        """The neighbour's gains with the limit there, met or not: no other are looked for."""
        assert near.found is not None
        return _judged(limit, reassess(self.knob.at(limit), near.found))

    def from_neighbour(self, limit: float, near: Probe) -> Probe | None:
        """Solve from the neighbour's gains; None when that leads nowhere.

        Where the check refuses the answer, once more with the plants and frequencies that it saw.
        """
        spec, start = self.knob.at(limit), near.gains
        probe = None
        for _ in range(_MOST_REFUTATIONS):
            solution = self.warm.settle(spec, start)
            found = _checked(spec, solution.gains) if solution is not None else None
            if found is None:
                break
            probe = _judged(limit, found)
            if probe.is_met:
                break
            start, self.warm = found.gains, self.warm.knowing(spec, missed_in(found))
        return probe

    def from_all_starts(self, limit: float, refused: Probe | None = None) -> Probe:
        """Solve as for a design; infeasible when no start leads anywhere."""
        spec = self.knob.at(limit)
        solution = self.warm.anew(spec)
        found = _checked(spec, solution.gains) if solution is not None else None
        anew = _judged(limit, found) if found is not None else refused
        if anew is not None:
            return anew
        self.infeasible.append(limit)
        return Probe(limit, PointStatus.INFEASIBLE, None)

    def is_known_infeasible(self, limit: float) -> bool:
        """Whether a limit that asks for no more was infeasible."""
        return any((limit - known) * self.knob.tightens >= 0.0 for known in self.infeasible if self.knob.tightens)

    def point(self, probe: Probe) -> TradeoffPoint:
        """As the result has it."""
        found = probe.found
        every = (*found.requirements, *found.measures) if found else ()
        scores = [r.score for r in every if r.score is not None]
        binds = found is not None and self._binds(found)
        gains = found.gains if found is not None else None
        return TradeoffPoint(probe.limit, probe.status, probe.objective, gains, max(scores, default=None), binds)

    def _binds(self, found: Verification) -> bool:
        """Whether the limit holds gains back; where the smallest slack is the objective, by being the smallest."""
        slack = self.knob.slack_in(found)
        depth = found.objective or 0.0 if self.knob.spec.objective is None else 0.0
        return self.knob.tightens == 0 or slack is None or slack < _CLEAR + depth


def is_maximised(objective: Objective | None) -> bool:
    """Whether more is better, as of `ki` and of the depth that stands in for an objective."""
    return objective is None or objective.sense is Sense.MAXIMIZE


def is_no_worse(prober: Prober, one: Probe, other: Probe) -> bool:
    """Whether the first has gains at least as good as the second's."""
    if one.objective is None or other.objective is None:
        return other.objective is None
    if is_maximised(prober.knob.spec.objective):
        return one.objective >= other.objective
    return one.objective <= other.objective


def missed_in(found: Verification) -> tuple[Violation, ...]:
    """Where a check found requirements missed, for the next solve."""
    of_loop = tuple(
        Violation(i, extreme.worst.point, _frequency(extreme.worst.omega_rad_s))
        for i, result in enumerate(found.requirements)
        if not result.is_met
        for extreme in result.extremes
    )
    of_scenarios = (
        Violation(i, result.worst.point, math.nan, result.scenario)
        for i, result in enumerate(found.measures)
        if not result.is_met
    )
    return (*of_loop, *of_scenarios)


def _frequency(omega_rad_s: float | None) -> float:
    return math.nan if omega_rad_s is None else omega_rad_s


def _checked(spec: DesignSpec, gains: FoPi) -> Verification | None:
    try:
        return verify(spec, gains, implementation=designed_implementation(spec, gains))
    except DomainError:
        # Both gains ran to 0: there is no loop.
        return None


def _judged(limit: float, found: Verification) -> Probe:
    return Probe(limit, PointStatus.MET if found.all_met else PointStatus.REFUSED, found)
