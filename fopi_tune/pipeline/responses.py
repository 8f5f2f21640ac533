"""The loop as it runs, for many plants:  spec, gains, points of the family -> FamilyResponse, one a scenario.

Each plant is driven as `fopi simulate` drives one: on samples, with the filter, the computing delay, the control's
limits and rate, anti-windup, and the scenario's noise and quantisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.fractional_plants.family import refuse_fractional_family
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.pipeline.scenario_results import refuse_start
from fopi_tune.simulation.scenario import Measures, Scenario, Traces
from fopi_tune.spec.lists.members import refuse_measured
from fopi_tune.spec.model import DesignSpec, ScenarioSpec, ValidationSpec

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
    from fopi_tune.simulation.measures import horizon_of, measures_of, scenario_of
    from fopi_tune.simulation.sampled.simulate import simulate
    from fopi_tune.simulation.scenario import Mode

    refuse_fractional_family(spec.plant, "a simulation", "its state is all of its past")
    refuse_measured(spec, "a simulation")
    implementation = implementation_of(spec, gains)
    controller = runtime_of(implementation.sections, spec)
    seed = (spec.validation or ValidationSpec()).seed
    found = []
    for scenario in spec.scenarios or (default_of(spec, implementation),):
        run = scenario_of(scenario, implementation, seed)
        driven = points[: max(1, _MOST_NUMBERS // len(run.signals))]
        plants = Plants.members(spec.plant, np.asarray(driven, dtype=float))
        refuse_start(scenario, plants, implementation.sample_time_s)
        traces = simulate([Mode(controller, plants)], run)
        measures = measures_of(traces, [controller], run, horizon_of(scenario, run))
        found.append(FamilyResponse(scenario, run, driven, traces, measures))
    return tuple(found)
