"""SystemSpec -> SystemProblem:  the merit of gains of the tuned modes, on the simulation of the switched system."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.starts import gains_between
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.systems import hybrid_scenario, modes_of
from fopi_tune.simulation.measures import horizon_of, measure_values
from fopi_tune.simulation.sampled.simulate import measure
from fopi_tune.simulation.scenario import Horizon, Scenario, Sensor
from fopi_tune.spec.model import DesignSpec, Limit, ModeSpec, Relation, ScenarioSpec, SystemSpec
from fopi_tune.spec.scenarios import frequency_part

#: limits are designed this much tighter, in their units
TIGHTENING = 1e-6
#: the modes' own requirements are met where they are missed by less, neper or radian
MET = 5e-7
#: pairs of plants of the joint box that are simulated to find the worst
_SCATTERED = 2048
#: what a violation costs, in objectives; gains without a loop cost as much as can be
PENALTY, NO_LOOP = 20.0, 1e9
_MOST_CORNERS = 32


@dataclass(frozen=True)
class Judged:
    """What gains do with some pairs of plants.

    Args:
        objective: of the worst pair, in the measure's unit.
        missed: of each requirement by how much its worst pair misses it, in units of the limit; negative inside.
        loops: the largest miss of the tuned modes' own requirements, neper or radian.
        worst: index of the worst pair of the objective, then of each requirement.
    """

    objective: float
    missed: tuple[float, ...]
    loops: float
    worst: tuple[int, ...]

    def holds_without(self, left_out: frozenset[int] = frozenset()) -> bool:
        """Whether the other requirements and those of the modes' loops hold, as they are and no tighter."""
        held = (each <= 0.0 for index, each in enumerate(self.missed) if index not in left_out)
        return self.loops <= MET and all(held)

    def violation_without(self, left_out: frozenset[int]) -> float:
        """The sum of what the other requirements, tightened, and the modes' loops miss; 0 where they hold.

        A sum: of a limit that no gains move the tightening is always missed, and a maximum would hide that of others.
        """
        held = (each + TIGHTENING for index, each in enumerate(self.missed) if index not in left_out)
        return max(0.0, self.loops) + sum(max(0.0, each) for each in held)


@dataclass(frozen=True)
class SystemProblem:
    """A system in the search's numbers.

    Args:
        system: the system.
        fixed: gains of the modes that are not tuned.
    """

    system: SystemSpec
    fixed: Mapping[str, FoPi]

    @property
    def tuned(self) -> tuple[ModeSpec, ...]:
        """The modes whose gains are designed."""
        return tuple(mode for mode in self.system.modes if mode.name in self.system.tuned)

    @cached_property
    def loops(self) -> dict[str, LoopCuts]:
        """The frequency requirements of each tuned mode, on samples."""
        return {mode.name: LoopCuts(_loop_problem(mode.spec)) for mode in self.tuned}

    @cached_property
    def corners(self) -> Array:
        """The nominal pair and the vertices of the joint box, shape (m, p)."""
        family = self.system.family
        return np.unique(np.vstack([family.nominal_point[None, :], family.corners()[:_MOST_CORNERS]]), axis=0)

    @cached_property
    def family(self) -> Array:
        """Pairs of the whole joint box, shape (m, p)."""
        low, high = self.system.family.low, self.system.family.high
        if not len(low):
            return self.corners
        from scipy.stats import qmc

        share = qmc.Sobol(len(low), scramble=False).random(_SCATTERED)
        return np.vstack([self.corners, low + share * (high - low)])

    @cached_property
    def count(self) -> int:
        """n of `gains`."""
        return sum(cuts.numbers.count for cuts in self.loops.values())

    def gains(self, x: Array) -> dict[str, FoPi]:
        """The gains of all modes at a point of the unit cube, shape (n,), of the tuned modes' numbers in turn."""
        found, place = dict(self.fixed), 0
        for name, cuts in self.loops.items():
            count = cuts.numbers.count
            found[name] = gains_between(cuts.numbers, x[place : place + count])
            place += count
        return found

    def judge(self, gains: Mapping[str, FoPi], points: Array) -> Judged | None:
        """What gains do with pairs of plants; None where there is no controller, or a tuned loop is unstable.

        Args:
            gains: of every mode.
            points: pairs of the joint box, shape (m, p).
        """
        loops = 0.0
        for name, cuts in self.loops.items():
            found = cuts.look(gains[name])
            if found is None:
                return None
            loops = max(loops, cuts.violation(found))
        try:
            implementations = [implementation_of(mode.spec, gains[mode.name]) for mode in self.system.modes]
        except DomainError:
            return None
        modes = modes_of(self.system, implementations, lambda first, end: points[first:end])
        values: dict[tuple[str, str], Array] = {}
        aim = self.system.objective
        assert aim is not None
        for scenario in self.system.scenarios:
            wanted = {limit.measure for limit in self.system.requirements if limit.scenario in (None, scenario.name)}
            wanted |= {aim.quantity} if aim.scenario == scenario.name else set()
            if wanted:
                run, horizon = self._run(scenario, implementations[0])
                numbers = measure(modes, run, horizon, len(points), threads=1)
                for name in wanted:
                    values[scenario.name, name] = measure_values(numbers, name, self.system.measurement_unit)
        objective = _finite(values[aim.scenario or "", aim.quantity])
        missed, worst = [], [int(objective.argmax())]
        for limit in self.system.requirements:
            about = [(name, limit.measure) for name, _ in values if limit.scenario in (None, name)]
            every = [values[key] for key in dict.fromkeys(about) if key in values]
            away = np.max([_missed(limit, _finite(v)) for v in every], axis=0)
            missed.append(float(away.max()))
            worst.append(int(away.argmax()))
        return Judged(float(objective.max()), tuple(missed), loops, tuple(worst))

    def _run(self, scenario: ScenarioSpec, implementation: Implementation) -> tuple[Scenario, Horizon]:
        run = replace(hybrid_scenario(self.system, scenario, implementation, 0), sensor=Sensor())
        return run, horizon_of(scenario, run)


def _finite(values: Array) -> Array:
    return np.where(np.isnan(values), np.inf, values)


def unit_of(limit: Limit) -> float:
    """What the miss of a requirement is counted in, in the measure's unit."""
    return abs(limit.limit) or 1.0


def _missed(limit: Limit, values: Array) -> Array:
    side = 1.0 if limit.relation is Relation.AT_MOST else -1.0
    return np.asarray(side * (values - limit.limit) / unit_of(limit))


def _loop_problem(spec: DesignSpec) -> Problem:
    """The mode's own requirements, all of which must hold, on the loop on samples."""
    assert spec.digital is not None
    sampled = replace(frequency_part(spec), objective=None, digital=replace(spec.digital, design="sampled"))
    return Problem.of(sampled).missing(frozenset(), frozenset())


@dataclass(frozen=True)
class Question:
    """What gains are searched for.

    Args:
        scale: of the objective.
        missed: requirements that may be missed, the largest miss of which is made small instead of the objective.
        ignored: requirements that count for nothing.
    """

    scale: float = 1.0
    missed: frozenset[int] = frozenset()
    ignored: frozenset[int] = frozenset()

    def violation(self, judged: Judged) -> float:
        """By how much what has to hold is missed."""
        return judged.violation_without(self.missed | self.ignored)

    def aim(self, judged: Judged) -> float:
        """What is made small, where everything else holds."""
        if not self.missed:
            return judged.objective / self.scale
        return max(0.0, *(judged.missed[index] + TIGHTENING for index in self.missed))

    def merit(self, judged: Judged | None) -> float:
        """Aim and violation as one number; of gains without a loop as large as can be."""
        if judged is None or not (self.missed or math.isfinite(judged.objective)):
            return NO_LOOP
        return min(self.aim(judged), NO_LOOP) + PENALTY * min(self.violation(judged), 1e6)
