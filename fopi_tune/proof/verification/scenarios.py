"""Requirements on measures of scenarios, checked by simulation:  gains -> the worst plant of each, over the family.

A dense sample of the box is simulated with the digital controller's own arithmetic, and about its worst plant a
pattern that shrinks is searched.  This is a check, no proof: a plant between those that were simulated may be worse.
Noise and quantisation are left out: a requirement is about the loop without them.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.implementation import runtime_of
from fopi_tune.digital.runtime import Runtime
from fopi_tune.proof.verification.results import MeasureResult, Place
from fopi_tune.simulation.measures import horizon_of, measure_values, scenario_of
from fopi_tune.simulation.sampled.simulate import measure, simulate
from fopi_tune.simulation.scenario import Horizon, Mode, Scenario, Sensor, Traces
from fopi_tune.spec.measures import JERK
from fopi_tune.spec.model import DesignSpec, Limit, Relation, ScenarioSpec

#: plants of the sample, beside the vertices: of one uncertain number, of more
_LINE, _SCATTERED = 1025, 4096
#: of the box to either side, about the worst plant: where the pattern begins, how it shrinks, how often
_REACH, _SHRINK, _ROUNDS = 0.1, 0.5, 16
_MOST_VERTICES = 64
#: s; settling times are whole samples, which this tells apart
_SAME_TIME = 1e-9


def check_scenarios(spec: DesignSpec, implementation: Implementation, tolerance: float) -> tuple[MeasureResult, ...]:
    """Each requirement on a scenario, in the order of the spec; of one about all scenarios the worst.

    Args:
        spec: with its scenarios, family and limits of the control.
        implementation: the digital controller.
        tolerance: by how much a limit may be missed, relative (of overshoots to the step).

    Raises:
        DomainError: a plant cannot be simulated.
    """
    loop = ScenarioLoop.of(spec, implementation)
    found = []
    for limit in spec.scenario_requirements:
        about = [each for each in spec.scenarios if limit.scenario in (None, each.name)]
        every = [_result(loop, limit, scenario, tolerance) for scenario in about]
        found.append(max(every, key=lambda result: result.score))
    return tuple(found)


def scenario_objective(spec: DesignSpec, implementation: Implementation) -> tuple[float, Place]:
    """The largest value over the family of the measure that is minimised, and the plant.

    Args:
        spec: whose objective is about a scenario.
        implementation: the digital controller.

    Raises:
        DomainError: a plant cannot be simulated.
    """
    assert spec.objective is not None
    loop, scenario = ScenarioLoop.of(spec, implementation), spec.objective.scenario
    about = next(each for each in spec.scenarios if each.name == scenario)
    value, point, _ = loop.worst(about, spec.objective.quantity, 1.0)
    return value, Place(None, spec.plant.describe(np.array(point)), point)


@dataclass(frozen=True)
class ScenarioLoop:
    """The loop as it runs.

    Args:
        family: the plants.
        controller: the digital controller.
        implementation: its sample time and delay.
        unit: of the measurement.
    """

    family: PlantFamily
    controller: Runtime
    implementation: Implementation
    unit: str

    @classmethod
    def of(cls, spec: DesignSpec, implementation: Implementation) -> ScenarioLoop:
        """Of a spec and its digital controller."""
        assert spec.digital is not None
        controller = runtime_of(implementation.sections, spec)
        return cls(spec.plant, controller, implementation, spec.digital.measurement_unit)

    def run_of(self, scenario: ScenarioSpec) -> tuple[Scenario, Horizon]:
        """The scenario on samples, without noise and quantisation."""
        run = replace(scenario_of(scenario, self.implementation, 0), sensor=Sensor())
        return run, horizon_of(scenario, run)

    def worst(self, scenario: ScenarioSpec, name: str, side: float) -> tuple[float, tuple[float, ...], int]:
        """The largest value of side measure over the family, the plant, and how many were simulated."""
        run, horizon = self.run_of(scenario)
        points = _sample(self.family)
        count = len(points)
        values = self._values(run, horizon, name, side, points)
        best = int((side * values).argmax())
        value, point = float(values[best]), points[best]
        low, high = self.family.low, self.family.high
        pattern, reach = _pattern(len(low)), _REACH * (high - low)
        for _ in range(_ROUNDS if len(low) and math.isfinite(value) else 0):
            near = np.clip(point + pattern * reach, low, high)
            values = self._values(run, horizon, name, side, near)
            count += len(near)
            best = int((side * values).argmax())
            if side * values[best] > side * value:
                value, point = float(values[best]), near[best]
            reach = _SHRINK * reach
        return value, tuple(float(number) for number in point), count

    def _values(self, run: Scenario, horizon: Horizon, name: str, side: float, points: Array) -> Array:
        plants = Plants.members(self.family, points)
        found = measure_values(measure([Mode(self.controller, plants)], run, horizon), name, self.unit)
        # an output that does not stay finite has no measure: the worst there is
        return np.where(np.isnan(found), side * np.inf, found)

    def traces(self, scenario: ScenarioSpec, point: tuple[float, ...]) -> tuple[Traces, Scenario, Horizon]:
        """Signals of one plant."""
        run, horizon = self.run_of(scenario)
        plants = Plants.members(self.family, np.array(point)[None, :])
        return simulate([Mode(self.controller, plants)], run), run, horizon


def with_limit(found: MeasureResult, limit: Limit, tolerance: float) -> MeasureResult:
    """The result of the same measure against another limit; its unit is that of the first.

    Args:
        found: with the limit before.
        limit: of the same measure.
        tolerance: as for `check_scenarios`.
    """
    side = 1.0 if limit.relation is Relation.AT_MOST else -1.0
    missed = found.score - 1.0
    before = side * (found.achieved - found.requirement.limit)
    unit = before / missed if missed != 0.0 and math.isfinite(before) else abs(limit.limit) or 1.0
    now = side * (found.achieved - limit.limit) / unit
    allowed = _SAME_TIME if limit.measure == "settling_time_s" else tolerance
    return replace(found, requirement=limit, score=1.0 + now, is_met=now <= allowed)


def limit_unit(limit: Limit, horizon: Horizon, run: Scenario) -> float:
    """What a limit's misses are counted in, public unit: of overshoots the largest step, else the limit itself."""
    if limit.measure in ("overshoot", "undershoot"):
        step = max(abs(each.value - each.before) for each in horizon.steps_of(run))
        if step > 0.0:
            return step
    return abs(limit.limit) or 1.0


def _result(loop: ScenarioLoop, limit: Limit, scenario: ScenarioSpec, tolerance: float) -> MeasureResult:
    side = 1.0 if limit.relation is Relation.AT_MOST else -1.0
    value, point, count = loop.worst(scenario, limit.measure, side)
    traces, run, horizon = loop.traces(scenario, point)
    missed = side * (value - limit.limit) / limit_unit(limit, horizon, run)
    allowed = _SAME_TIME if limit.measure == "settling_time_s" else tolerance
    place = Place(None, loop.family.describe(np.array(point)), point)
    return MeasureResult(
        limit, scenario.name, value, 1.0 + missed, place, _time_of(limit.measure, traces, run, horizon),
        missed <= allowed, count,
    )  # fmt: skip


def _time_of(name: str, traces: Traces, run: Scenario, horizon: Horizon) -> float | None:
    """When a measure that is the largest of many numbers takes it, s; None of others."""
    first = horizon.first
    with np.errstate(invalid="ignore"):
        if name in ("acceleration_m_s2", "peak_rate_per_s"):
            both = np.maximum(np.abs(traces.rate[0]), np.abs(traces.rate_after[0]))
            # the rate after the last sample lies beyond the end
            both[-1] = abs(traces.rate[0, -1])
        elif name == JERK:
            both = np.zeros(len(traces.time_s))
            both[first + 2 :] = np.abs(np.diff(traces.output[0, first:], 2))
        elif name == "peak_control":
            both = np.abs(traces.applied[0])
        elif name in ("overshoot", "undershoot"):
            both = np.full(len(traces.time_s), -np.inf)
            steps = horizon.steps_of(run)
            for step, after in itertools.zip_longest(steps, steps[1:]):
                own = slice(step.first, None if after is None else after.first)
                beyond = traces.output[0, own] - step.value
                if name == "undershoot":
                    both[own] = step.direction * (step.before - traces.output[0, own])
                else:
                    both[own] = step.direction * beyond if step.direction else np.abs(beyond)
        else:
            return None
    if not np.isfinite(both[first:]).any():
        return None
    return float(traces.time_s[first + int(np.nanargmax(both[first:]))])


def _sample(family: PlantFamily) -> Array:
    """The nominal plant, vertices and a dense sample of the box, shape (m, p)."""
    low, high = family.low, family.high
    p = len(low)
    if not p:
        return np.zeros((1, 0))
    known = np.vstack([family.nominal_point[None, :], family.corners()[:_MOST_VERTICES]])
    if p == 1:
        return np.vstack([known, np.linspace(low, high, _LINE)])
    from scipy.stats import qmc

    return np.vstack([known, low + qmc.Halton(p, scramble=False).random(_SCATTERED) * (high - low)])


def _pattern(p: int) -> Array:
    """Points of [-1, 1]^p, shape (k, p)."""
    if p <= 2:
        return np.array(list(itertools.product(np.linspace(-1.0, 1.0, 9), repeat=p)))
    if p <= 4:
        ends = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=p)))
        return np.concatenate([ends, 0.3 * ends])
    ends = np.array(list(itertools.product((-1.0, 1.0), repeat=p)))
    return np.concatenate([np.eye(p), -np.eye(p), 0.3 * np.eye(p), -0.3 * np.eye(p), ends, 0.3 * ends])
