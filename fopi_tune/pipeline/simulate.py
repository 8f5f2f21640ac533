"""Simulation:  spec, gains, one plant -> Simulated, with the digital controller or exactly in continuous time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.core.families.plant_list import named_place
from fopi_tune.core.fractional_plants.family import refuse_fractional_family
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import Plant
from fopi_tune.core.terms.numbers import refuse_no_flag, whole_number
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.responses import default_of
from fopi_tune.pipeline.scenario_results import (
    continuous_result,
    plant_point,
    refuse_accuracy,
    refuse_start,
    run_scenario,
    select_scenarios,
)
from fopi_tune.pipeline.validate import override_validation
from fopi_tune.results.simulation import ScenarioResult, Simulated
from fopi_tune.results.stamp import stamp
from fopi_tune.simulation.notes import bumpless_notes, limit_notes, rate_notes, setpoint_notes
from fopi_tune.spec import load_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.lists.members import refuse_measured
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import DesignSpec, DigitalSpec, ScenarioSpec, ValidationSpec


def simulate(
    source: Source,
    gains: FoPi,
    *,
    scenario: str | None = None,
    plant: Mapping[str, float] | None = None,
    replay: int | None = None,
    exact: bool = False,
    accuracy: float | None = None,
    samples: int | None = None,
    seed: int | None = None,
    member: str | None = None,
) -> Simulated:
    """Simulate the scenarios of a spec for one plant, with the digital controller.

    A spec without scenarios is driven through a default one, a step of the reference and then of the load; without a
    section `digital` in continuous time.

    Args:
        source: a spec file, or a spec.
        gains: the controller, usually from a design.
        scenario: name of the only one to simulate; all where left out.
        plant: uncertain numbers by name, in the spec's units; the nominal ones where left out.
        replay: index of a plant that `validate` drew; it and its noise are made again.
        exact: simulate the fractional loop in continuous time, without filter, samples and computing delay.
        accuracy: of `exact`: halve the step until the output moves by less, in its unit; what is reached is said.
        samples: what was given to `validate`.
        seed: what was given to `validate`.
        member: of a list of plants, the name of the one to simulate; the first where left out.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: as for `discretize`, or an unknown scenario, number, member or index.
    """
    from fopi_tune.digital.implementation import implementation_of

    replay = None if replay is None else whole_number("replay", replay)
    spec = load_spec(source)
    refuse_no_gains(gains)
    refuse_no_flag("exact", exact)
    spec.controller.refuse_other_weight(gains)
    refuse_measured(spec, "a simulation")
    drawn = override_validation(spec.validation, samples, seed)
    spec = replace(spec, validation=drawn)
    point = refuse_simulation(
        spec, scenario=scenario, plant=plant, replay=replay, exact=exact, accuracy=accuracy, member=member
    )
    driven, notes = spec, list(limit_notes(spec.judged_limits))
    if spec.digital is None:
        driven, exact = replace(spec, digital=DigitalSpec(_sample_time(spec, gains))), True
        notes.append("the spec has no section digital: the loop in continuous time")
    if exact:
        box = spec.controller
        for refuse in (box.refuse_derivative, box.refuse_measurement_filter, box.refuse_setpoint_weight):
            refuse("the exact simulation in continuous time")
    implementation = implementation_of(driven, gains)
    if spec.scenarios:
        scenarios = select_scenarios(spec.scenarios, scenario)
    else:
        from fopi_tune.simulation.default_scenario import described

        scenarios = (default_of(driven, implementation),)
        notes.append(described(scenarios[0]))
    results = (_continuous_results if exact else _sampled_results)(
        driven, gains, implementation, scenarios, point, replay or 0, accuracy
    )
    delay = implementation.delay_samples * implementation.sample_time_s
    return Simulated(
        spec,
        gains,
        spec.plant.describe(point),
        replay,
        results,
        stamp(spec.text_sha256, None, digests_of(spec)),
        exact=exact,
        left_out=f"the computing delay of {delay:g} s" if exact and delay else "",
        notes=tuple(notes),
        member=named_place(spec.plant, point),
    )


def refuse_simulation(
    source: Source,
    *,
    scenario: str | None = None,
    plant: Mapping[str, float] | None = None,
    replay: int | None = None,
    exact: bool = False,
    accuracy: float | None = None,
    samples: int | None = None,
    seed: int | None = None,
    member: str | None = None,
) -> np.ndarray:
    """Refuse what `simulate` cannot, before gains are tuned and anything runs.

    Args:
        source, scenario, plant, replay, exact, accuracy, samples, seed, member: as for `simulate`.

    Returns:
        The point of the plant, shape (p,).

    Raises:
        SpecError, DomainError: as `simulate`.
    """
    spec = load_spec(source)
    refuse_fractional_family(
        spec.plant, "a simulation", "its state is all of its past; `fopi run` draws its exact unit steps"
    )
    refuse_measured(spec, "a simulation")
    refuse_accuracy(accuracy, exact or spec.digital is None)
    point = plant_point(spec.plant, override_validation(spec.validation, samples, seed), plant, replay, member)
    if not spec.scenarios:
        if scenario not in (None, "default"):
            raise DomainError(f"there is no scenario {scenario!r}; the spec has none")
        return point
    from fopi_tune.simulation.fractional.continuous import refuse_loop

    chosen = select_scenarios(spec.scenarios, scenario)
    assert spec.digital is not None
    for each in chosen:
        if exact:
            refuse_loop(each, spec.plant.member(point), spec.digital)
        else:
            refuse_start(each, Plants.members(spec.plant, point[None, :]), spec.digital.sample_time_s)
    return point


def _sample_time(spec: DesignSpec, gains: FoPi) -> float:
    """A twentieth of the inverse of the crossover, or of the plant's own fastest pole without one, s."""
    from fopi_tune.digital.implementation import nominal_crossover

    plant = spec.plant.member(spec.plant.nominal_point)
    poles = np.abs(np.roots(plant.denominator)) if len(plant.denominator) > 1 else np.zeros(0)
    fastest = nominal_crossover(spec, gains) or float(poles.max(initial=0.0)) or 1.0
    power = 10.0 ** math.floor(math.log10(0.05 / fastest))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= 0.05 / fastest)


def _sampled_results(
    spec: DesignSpec, gains: FoPi, implementation: Implementation, scenarios: Sequence[ScenarioSpec],
    point: np.ndarray, index: int, accuracy: float | None,
) -> tuple[ScenarioResult, ...]:  # fmt: skip
    """The scenarios of the plant at `point` with the digital controller; the noise is that of the draw `index`."""
    from fopi_tune.digital.implementation import runtime_of
    from fopi_tune.simulation.measures import scenario_of
    from fopi_tune.simulation.scenario import Mode

    seed = (spec.validation or ValidationSpec()).seed
    plants, controller = Plants.members(spec.plant, point[None, :]), runtime_of(implementation.sections, spec)
    # a function of the index, so that the noise is that of the draw
    modes = [Mode(controller, lambda begin, end: plants)]
    results = [
        run_scenario(each, modes, scenario_of(each, implementation, seed), spec.judged_limits, index, _unit(spec))
        for each in scenarios
    ]
    noted = (_noted(result, gains, spec.plant.member(point), controller.limits) for result in results)
    return tuple(
        replace(each, notes=(*rate_notes(each.scenario, each.traces, [spec.digital]), *each.notes)) for each in noted
    )


def _continuous_results(
    spec: DesignSpec, gains: FoPi, implementation: Implementation, scenarios: Sequence[ScenarioSpec],
    point: np.ndarray, index: int, accuracy: float | None,
) -> tuple[ScenarioResult, ...]:  # fmt: skip
    """The scenarios of the plant at `point` with the fractional controller, without samples."""
    from fopi_tune.digital.implementation import runtime_of
    from fopi_tune.simulation.fractional.continuous import simulate_loop

    plant, controller = spec.plant.member(point), runtime_of(implementation.sections, spec)
    step = implementation.sample_time_s
    runs = [simulate_loop(each, gains, plant, controller, step, accuracy) for each in scenarios]
    limits, unit = spec.judged_limits, _unit(spec)
    results = [continuous_result(s, run, limits, unit, accuracy) for s, run in zip(scenarios, runs, strict=True)]
    return tuple(_noted(result, gains, plant, controller.limits) for result in results)


def _unit(spec: DesignSpec) -> str:
    return "" if spec.digital is None else spec.digital.measurement_unit


def _noted(result: ScenarioResult, gains: FoPi, plant: Plant, limits: tuple[float, float]) -> ScenarioResult:
    scenario = result.scenario
    notes = (*setpoint_notes(scenario, plant, limits), *bumpless_notes(scenario, gains), *result.notes)
    return replace(result, notes=notes)
