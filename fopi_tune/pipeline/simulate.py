"""Simulation:  spec, gains, one plant -> Simulated, with the digital controller or exactly in continuous time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.parameter_table import why_impossible
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.validate import override_validation
from fopi_tune.results.simulation import ScenarioResult, Simulated
from fopi_tune.results.stamp import stamp
from fopi_tune.spec import load_spec
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import MEASURES, DesignSpec, Limit, Relation, ScenarioSpec, ValidationSpec

if TYPE_CHECKING:
    from fopi_tune.simulation.fractional.continuous import ContinuousSimulation
    from fopi_tune.simulation.scenario import Measures, Mode, Scenario, Traces


def simulate(
    source: Source,
    gains: FoPi,
    *,
    scenario: str | None = None,
    plant: Mapping[str, float] | None = None,
    replay: int | None = None,
    exact: bool = False,
    samples: int | None = None,
    seed: int | None = None,
) -> Simulated:
    """Simulate the scenarios of a spec for one plant, with the digital controller.

    Args:
        source: a spec file, or a spec, with sections `digital` and `scenarios`.
        gains: the controller, usually from a design.
        scenario: name of the only one to simulate; all where left out.
        plant: uncertain numbers by name, in the spec's units; the nominal ones where left out.
        replay: index of a plant that `validate` drew; it and its noise are made again.
        exact: simulate the fractional loop in continuous time, without filter, samples and computing delay.
        samples: what was given to `validate`.
        seed: what was given to `validate`.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: as for `discretize`, or an unknown scenario, number or index.
    """
    from fopi_tune.digital.implementation import implementation_of

    spec = load_spec(source)
    validation = override_validation(spec.validation, samples, seed)
    spec = replace(spec, validation=validation)
    implementation = implementation_of(spec, gains)
    point = plant_point(spec.plant, validation, plant, replay)
    scenarios = select_scenarios(spec.scenarios, scenario)
    if exact:
        results = _continuous_results(spec, gains, implementation, scenarios, point)
    else:
        results = _sampled_results(spec, implementation, scenarios, point, replay or 0)
    return Simulated(spec, gains, spec.plant.describe(point), replay, results, stamp(spec.sha256, None), exact=exact)


def _sampled_results(
    spec: DesignSpec,
    implementation: Implementation,
    scenarios: Sequence[ScenarioSpec],
    point: np.ndarray,
    index: int,
) -> tuple[ScenarioResult, ...]:
    """The scenarios of the plant at `point` with the digital controller; the noise is that of the draw `index`."""
    from fopi_tune.montecarlo.montecarlo import controller_of
    from fopi_tune.simulation.measures import scenario_of
    from fopi_tune.simulation.scenario import Mode

    seed = (spec.validation or ValidationSpec()).seed
    plants = Plants.members(spec.plant, point[None, :])
    # a function of the index, so that the noise is that of the draw
    modes = [Mode(controller_of(spec, implementation), lambda begin, end: plants)]
    return tuple(
        run_scenario(scenario, modes, scenario_of(scenario, implementation, seed), spec.limits, index)
        for scenario in scenarios
    )


def _continuous_results(
    spec: DesignSpec,
    gains: FoPi,
    implementation: Implementation,
    scenarios: Sequence[ScenarioSpec],
    point: np.ndarray,
) -> tuple[ScenarioResult, ...]:
    """The scenarios of the plant at `point` with the fractional controller, without samples."""
    from fopi_tune.montecarlo.montecarlo import controller_of
    from fopi_tune.simulation.fractional.continuous import simulate_loop

    plant, controller = spec.plant.member(point), controller_of(spec, implementation)
    step = implementation.sample_time_s
    runs = [simulate_loop(scenario, gains, plant, controller, step) for scenario in scenarios]
    return tuple(continuous_result(s, run, spec.limits) for s, run in zip(scenarios, runs, strict=True))


def run_scenario(
    scenario: ScenarioSpec, modes: Sequence[Mode], run: Scenario, limits: Sequence[Limit], index: int
) -> ScenarioResult:
    """Simulate one scenario of one plant on samples.

    Args:
        scenario: as the spec states it.
        modes: the controllers, and the plant of each index.
        run: the same scenario with its signals at the controllers' samples.
        limits: of the spec.
        index: of the plant; its noise depends on it.
    """
    from fopi_tune.simulation.measures import horizon_of, measures_of
    from fopi_tune.simulation.sampled.simulate import simulate

    traces = simulate(modes, run, 1, index)
    numbers = measures_of(traces, [mode.controller for mode in modes], run, horizon_of(scenario, run))
    return scenario_result(scenario, run.signals.reference, traces, numbers, limits)


def scenario_result(
    scenario: ScenarioSpec, reference: np.ndarray, traces: Traces, numbers: Measures, limits: Sequence[Limit]
) -> ScenarioResult:
    """Signals of one plant, their measures by name, and whether each limit is met.

    Args:
        scenario: as the spec states it.
        reference: the setpoint at the signals' times, output unit.
        traces: the signals, one row each.
        numbers: the measures, one number each.
        limits: of the spec.
    """
    from fopi_tune.simulation.measures import MEASURE_VALUES

    measures = {name: float(MEASURE_VALUES[name](numbers)[0]) for name in MEASURES}
    met = tuple((e, _is_met(e, measures[e.measure])) for e in limits if e.scenario in (None, scenario.name))
    jumps = np.flatnonzero(np.diff(traces.mode[0])) + 1
    return ScenarioResult(
        scenario, reference, traces, measures, met, bool(numbers.chattering[0]), tuple(traces.time_s[jumps].tolist())
    )


def continuous_result(scenario: ScenarioSpec, found: ContinuousSimulation, limits: Sequence[Limit]) -> ScenarioResult:
    """The result of a run in continuous time; a run that did not stay finite meets no limit."""
    result = scenario_result(scenario, found.reference, found.traces, found.measures, limits)
    if not found.measures.finite[0]:
        result = replace(result, limits=tuple((limit, False) for limit, _ in result.limits))
    return replace(result, switch_times_s=found.switch_times_s, accuracy=found.accuracy, outcome=found.outcome)


def _is_met(limit: Limit, value: float) -> bool:
    return value <= limit.limit if limit.relation is Relation.AT_MOST else value >= limit.limit


def select_scenarios(scenarios: Sequence[ScenarioSpec], only: str | None) -> tuple[ScenarioSpec, ...]:
    """The scenarios to simulate: all, or the one that is named.

    Raises:
        DomainError: there is none, or none of this name.
    """
    if not scenarios:
        raise DomainError("the spec has no scenario; add scenarios: with a name, duration_s and reference")
    found = tuple(each for each in scenarios if only in (None, each.name))
    if not found:
        names = ", ".join(each.name for each in scenarios)
        raise DomainError(f"there is no scenario {only!r}; there is {names}")
    return found


def plant_point(
    family: PlantFamily, drawn: ValidationSpec, plant: Mapping[str, float] | None, index: int | None
) -> np.ndarray:
    """The point of a plant in its family's box of uncertain numbers, shape (p,), in the spec's units.

    Args:
        family: the box.
        drawn: how plants are drawn.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a Monte Carlo draw to take instead of `plant`.

    Raises:
        DomainError: an unknown number, an index that was not drawn, or a point that is no plant.
    """
    point = _named_point(family, plant or {}) if index is None else _drawn_point(family, drawn, index)
    if (problem := why_impossible(point, family)) is not None:
        raise DomainError(f"{'this' if index is None else f'draw {index}'} is no plant: {problem}")
    return point


def _drawn_point(family: PlantFamily, drawn: ValidationSpec, index: int) -> np.ndarray:
    from fopi_tune.montecarlo.draws import sample_points
    from fopi_tune.montecarlo.outcomes import sampling_plan_of

    if not 0 <= index < drawn.samples:
        raise DomainError(f"plant {index} was not drawn; the spec draws {drawn.samples}, from 0 on")
    return sample_points(sampling_plan_of(drawn), family, index, 1)[0]


def _named_point(family: PlantFamily, named: Mapping[str, float]) -> np.ndarray:
    for name, value in named.items():
        if name not in family.uncertain_names:
            known = ", ".join(family.uncertain_names) or "none: every number is known"
            raise DomainError(f"{name!r} is no uncertain number of the plant; there is {known}")
        if not math.isfinite(value):
            raise DomainError(f"{name} = {value!r} is no finite number")
    nominal = dict(zip(family.uncertain_names, family.nominal_point.tolist(), strict=True))
    return np.array([named.get(name, nominal[name]) for name in family.uncertain_names])
