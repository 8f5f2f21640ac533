"""DesignSpec with requirements or an objective of scenarios -> ScenarioProblem, on the loop as it runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.design.global_search.compiled import DEPTH
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.time_domain.measures import ScenarioRun, unit_of
from fopi_tune.design.time_domain.numbers import Numbers
from fopi_tune.digital import sections_of
from fopi_tune.results.candidate import Violation
from fopi_tune.simulation.measures import horizon_of, scenario_of
from fopi_tune.simulation.scenario import Sensor
from fopi_tune.spec.measures import PER_M_S, velocity_unit
from fopi_tune.spec.model import DesignSpec, Limit, Relation, ScenarioSpec
from fopi_tune.spec.scenarios import frequency_part

#: limits of scenarios are designed this much tighter, in their units: rounding does not undo them
TIGHTENING = 1e-6
#: plants of the box that are simulated to find the worst ones: those of a grid and, of several numbers, scattered ones
_LINE, _GRID, _SCATTERED = 601, {2: 17, 3: 9, 4: 5}, 2048
_MOST_CORNERS = 32
#: of a limit in samples
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class ScenarioRow:
    """One limit of one scenario.

    Args:
        index: of the requirement in `DesignSpec.scenario_requirements`; -1 of the objective.
        limit: what is asked.
        run: the scenario.
        in_depth: whether it is the smallest slack of such rows that is maximised, instead of a limit that must hold.
    """

    index: int
    limit: Limit
    run: ScenarioRun
    in_depth: bool = False

    @property
    def unit(self) -> float:
        """What its slack is counted in, public unit."""
        return unit_of(self.limit.measure, self.run, self.limit.limit)

    @property
    def side(self) -> float:
        """1 of an upper limit, -1 of a lower one."""
        return 1.0 if self.limit.relation is Relation.AT_MOST else -1.0

    @property
    def unsettled_samples(self) -> int:
        """Of a settling time: samples after a step whose distance from its value does not count.

        n samples or less are settled from sample n on; n or more have left the band at sample n - 1 or later.
        """
        samples = self.limit.limit / self.run.run.sample_time_s
        return math.floor(samples + _ROUNDING) if self.side > 0.0 else math.ceil(samples - _ROUNDING) - 1

    @property
    def key(self) -> tuple[int, str]:
        """Requirement and scenario."""
        return self.index, self.run.spec.name


@dataclass(frozen=True, eq=False)
class ScenarioProblem:
    """A spec in the search's numbers.

    Args:
        spec: the spec.
        loop: requirements, and objective, on the frequency response of the loop on samples.
        scanned: the same where they alone decide, for starts.
        rows: the limits of scenarios; one that names no scenario is a row for each.
        objective: the measure that is minimised; None where the objective is the loop's.
        seen: plants at which a check refuted gains.
    """

    spec: DesignSpec
    loop: Problem
    scanned: Problem
    rows: tuple[ScenarioRow, ...]
    objective: ScenarioRow | None
    seen: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of(cls, spec: DesignSpec, violations: Sequence[Violation] = ()) -> ScenarioProblem:
        """The problem of a spec.

        Args:
            spec: one that designs for scenarios.
            violations: plants and frequencies at which a check refuted gains.

        Raises:
            DomainError: the digital controller cannot be made, or a plant cannot be simulated.
        """
        assert spec.digital is not None
        scanned = Problem.of(frequency_part(spec), [v for v in violations if v.scenario is None])
        # with a measure for an objective the loop's requirements have to hold, no more
        loop = scanned.missing(frozenset(), frozenset()) if _has_measure(spec) else scanned
        runs = {each.name: _run_of(spec, each) for each in spec.scenarios}
        rows = tuple(
            ScenarioRow(index, limit, runs[name], scanned.code == DEPTH and not _has_measure(spec))
            for index, limit in enumerate(spec.scenario_requirements)
            for name in ([limit.scenario] if limit.scenario is not None else runs)
        )
        objective = None
        if spec.objective is not None and spec.objective.scenario is not None:
            aim = Limit(spec.objective.quantity, Relation.AT_MOST, 1.0, spec.objective.scenario)
            objective = ScenarioRow(-1, aim, runs[spec.objective.scenario])
        seen = tuple(v.theta for v in violations if v.scenario is not None)
        return cls(spec, loop, scanned, rows, objective, seen)

    def missing(self, free: frozenset[int], dropped: frozenset[int]) -> ScenarioProblem:
        """The problem of how little the requirements in `free` have to be missed, those in `dropped` left out.

        Requirements are counted through: those of the loop first, then those of scenarios.
        """
        first = len(self.spec.requirements)
        loop = self.loop.missing(
            frozenset(i for i in free if i < first), frozenset(i for i in dropped if i < first)
        )  # fmt: skip
        rows = tuple(
            replace(row, in_depth=first + row.index in free) for row in self.rows if first + row.index not in dropped
        )
        return replace(self, loop=loop, rows=rows, objective=None)

    @property
    def maximises_depth(self) -> bool:
        """Whether the smallest slack is the objective: requirements then need not hold where they are missed least."""
        return self.objective is None and self.loop.code == DEPTH

    @cached_property
    def corners(self) -> Array:
        """The nominal plant and the vertices of the box, shape (m, p)."""
        family = self.spec.plant
        corners = family.corners()[:_MOST_CORNERS]
        seen = np.array(self.seen, dtype=float).reshape(len(self.seen), corners.shape[1])
        points = np.vstack([family.nominal_point[None, :], corners, seen])
        return np.unique(points, axis=0)

    @cached_property
    def family(self) -> Array:
        """Plants of the whole box, shape (m, p)."""
        low, high = self.spec.plant.low, self.spec.plant.high
        p = len(low)
        if p == 0:
            return np.zeros((1, 0))
        if p == 1:
            points = np.linspace(low, high, _LINE)
        else:
            from scipy.stats import qmc

            ends = np.linspace(0.0, 1.0, _GRID.get(p, 3))
            grid = np.array(list(itertools.product(ends, repeat=p)))
            share = np.vstack([grid, qmc.Sobol(p, scramble=False).random(_SCATTERED)])
            points = low + share * (high - low)
        return np.vstack([self.corners, points])

    def plants(self, points: Array) -> Plants:
        """The plants at points of the box."""
        return Plants.members(self.spec.plant, points)

    @property
    def runs(self) -> tuple[ScenarioRun, ...]:
        """The scenarios that are needed."""
        every = [row.run for row in (*self.rows, *([] if self.objective is None else [self.objective]))]
        return tuple({run.spec.name: run for run in every}.values())

    @cached_property
    def numbers(self) -> Numbers:
        """What is searched."""
        return Numbers(self.loop)


def _has_measure(spec: DesignSpec) -> bool:
    return spec.objective is not None and spec.objective.scenario is not None


def _run_of(spec: DesignSpec, scenario: ScenarioSpec) -> ScenarioRun:
    digital = spec.digital
    assert digital is not None
    # signals and delays only: any gains will do
    any_filter = sections_of(FoPi(1.0, 0.0, 1.0), digital)
    run = scenario_of(scenario, Implementation(any_filter, digital.delay_samples), 0)
    unit = velocity_unit(digital.measurement_unit)
    return ScenarioRun(
        scenario, replace(run, sensor=Sensor()), horizon_of(scenario, run), 1.0 if unit is None else PER_M_S[unit]
    )
