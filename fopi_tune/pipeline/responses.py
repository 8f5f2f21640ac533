"""The loop as it runs, for many plants:  spec or system, gains, points of the family -> FamilyResponse, one a scenario.

Each plant is driven as `fopi simulate` drives one: on samples, with the filter, the computing delay, the control's
limits and rate, anti-windup, and the scenario's noise and quantisation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.fractional_plants.family import refuse_fractional_family
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.pipeline.scenario_results import refuse_start
from fopi_tune.simulation.scenario import Measures, Mode, Scenario, Traces
from fopi_tune.spec.lists.members import refuse_measured
from fopi_tune.spec.model import DesignSpec, ScenarioSpec, SystemSpec, ValidationSpec

#: numbers kept of a signal, over all plants; longer scenarios are driven with fewer plants
_MOST_NUMBERS = 400_000


@dataclass(frozen=True, eq=False)
class FamilyResponse:
    """One scenario, driven with m plants.

    Args:
        scenario: as the spec states it, or the default one.
        run: the same with its signals at the controller's samples.
        points: of the family, shape (m, p).
        traces: signals at the samples, shape (m, steps) each.
        measures: of each plant, shape (m,) each.
    """

    scenario: ScenarioSpec
    run: Scenario
    points: Array
    traces: Traces
    measures: Measures


def default_of(spec: DesignSpec, implementation: Implementation) -> ScenarioSpec:
    """The default scenario, of the nominal plant so that all plants are driven alike."""
    from fopi_tune.digital.implementation import runtime_of
    from fopi_tune.simulation.default_scenario import default_scenario

    nominal, controller = spec.plant.member(spec.plant.nominal_point), runtime_of(implementation.sections, spec)
    return default_scenario(nominal, controller, implementation.sample_time_s, implementation.delay_samples)


def family_responses(spec: DesignSpec, gains: FoPi, points: Array) -> tuple[FamilyResponse, ...]:
    """Drive plants of a family through every scenario of the spec, through the default one if it has none.

    Args:
        spec: with a section `digital`.
        gains: the controller.
        points: of the family, shape (m, p), the ones that matter first: a long scenario is driven with fewer.

    Returns:
        One response a scenario.

    Raises:
        DomainError: fractional or measured plants, no section `digital`, a controller that cannot be made, or a
            start that some plant does not have.
    """
    from fopi_tune.digital.implementation import implementation_of, runtime_of
    from fopi_tune.simulation.measures import scenario_of

    refuse_fractional_family(spec.plant, "a simulation", "its state is all of its past")
    refuse_measured(spec, "a simulation")
    implementation = implementation_of(spec, gains)
    controller = runtime_of(implementation.sections, spec)
    seed = (spec.validation or ValidationSpec()).seed

    def drive(scenario: ScenarioSpec) -> FamilyResponse:
        run = scenario_of(scenario, implementation, seed)
        driven = _as_many_as_fit(points, run)
        plants = Plants.members(spec.plant, driven)
        refuse_start(scenario, plants, implementation.sample_time_s)
        return _driven(scenario, run, driven, [Mode(controller, plants)])

    return tuple(drive(scenario) for scenario in spec.scenarios or (default_of(spec, implementation),))


def system_responses(system: SystemSpec, gains: Mapping[str, FoPi], points: Array) -> tuple[FamilyResponse, ...]:
    """Drive pairs of plants of a system through every scenario.

    Args:
        system: the system.
        gains: of each mode.
        points: of the family of pairs, shape (m, p), the ones that matter first.

    Raises:
        DomainError: a controller that cannot be made, or a start that some plant does not have.
    """
    from fopi_tune.digital.implementation import implementation_of
    from fopi_tune.montecarlo.systems import hybrid_scenario, modes_of

    implementations = [implementation_of(mode.spec, gains[mode.name]) for mode in system.modes]
    seed = (system.validation or ValidationSpec()).seed

    def drive(scenario: ScenarioSpec) -> FamilyResponse:
        run = hybrid_scenario(system, scenario, implementations[0], seed)
        driven = _as_many_as_fit(points, run)
        for mode in system.modes:
            plants = Plants.members(mode.spec.plant, driven[:, system.family.columns(mode.name)])
            refuse_start(scenario, plants, system.sample_time_s)
        return _driven(scenario, run, driven, modes_of(system, implementations, lambda first, end: driven[first:end]))

    return tuple(drive(scenario) for scenario in system.scenarios)


def _as_many_as_fit(points: Array, run: Scenario) -> Array:
    return np.asarray(points[: max(1, _MOST_NUMBERS // len(run.signals))], dtype=float)


def _driven(scenario: ScenarioSpec, run: Scenario, points: Array, modes: Sequence[Mode]) -> FamilyResponse:
    from fopi_tune.simulation.measures import horizon_of, measures_of
    from fopi_tune.simulation.sampled.simulate import simulate

    traces = simulate(modes, run, len(points))
    measures = measures_of(traces, [mode.controller for mode in modes], run, horizon_of(scenario, run))
    return FamilyResponse(scenario, run, points, traces, measures)
