"""What runs in time or draws plants:  spec, gains -> Validated, Simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.validate import wanted_validation
from fopi_tune.results.simulation import Driven
from fopi_tune.results.stamp import stamp
from fopi_tune.spec import load_spec
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import DesignSpec, ValidationSpec

if TYPE_CHECKING:
    pass


import math
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.loops import Plants
from fopi_tune.core.parameter_table import why_impossible
from fopi_tune.core.plant import PlantFamily
from fopi_tune.results.simulation import Simulated
from fopi_tune.results.stamp import Stamp
from fopi_tune.spec.model import MEASURES, Limit, Relation, ScenarioSpec

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
    """Drive one plant through the spec's scenarios with its digital controller.

    Args:
        source: a spec file, or a spec, with sections `digital` and `scenarios`.
        gains: the controller, usually from a design.
        scenario: name of the only one.
        plant: uncertain numbers by name, in the spec's units; the nominal ones where left out.
        replay: index of a plant that `validate` drew, to make it and its noise again.
        exact: the fractional loop in continuous time instead, without filter, samples and computing delay.
        samples: what was given to `validate`.
        seed: what was given to `validate`.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: as for `discretize`, or an unknown scenario, number or index.
    """
    from fopi_tune.digital.implementation import implementation_of

    spec = load_spec(source)
    spec = replace(spec, validation=wanted_validation(spec.validation, samples, seed))
    made = stamp(spec.sha256, None)
    implementation = implementation_of(spec, gains)
    return drive(spec, gains, implementation, made, only=scenario, plant=plant, index=replay, exact=exact)


def drive(
    spec: DesignSpec,
    gains: FoPi,
    implementation: Implementation,
    stamp: Stamp,
    *,
    only: str | None = None,
    plant: Mapping[str, float] | None = None,
    index: int | None = None,
    exact: bool = False,
) -> Simulated:
    """Simulate the scenarios of a spec for one plant.

    Args:
        spec: with scenarios.
        gains: what the controller approximates.
        implementation: the controller that runs.
        stamp: where the result comes from.
        only: name of the only scenario.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a Monte-Carlo draw to make again, its noise included; instead of a plant.
        exact: in continuous time instead, without filter, samples and computing delay.

    Raises:
        DomainError: no scenario, an unknown one, an unknown number, an index that was not drawn, or a place that is no
            plant.
    """
    from fopi_tune.montecarlo.montecarlo import controller_of
    from fopi_tune.simulation.measures import scenario_of
    from fopi_tune.simulation.scenario import Mode

    drawn = spec.validation or ValidationSpec()
    place = place_of(spec.plant, drawn, plant, index)
    scenarios = chosen(spec.scenarios, only)
    if exact:
        from fopi_tune.simulation.fractional.continuous import simulate_loop

        member, controller = spec.plant.member(place), controller_of(spec, implementation)
        step = implementation.sample_time_s
        runs = [simulate_loop(scenario, gains, member, controller, step) for scenario in scenarios]
        driven = tuple(continuous_of(s, run, spec.limits) for s, run in zip(scenarios, runs, strict=True))
        return Simulated(spec, gains, spec.plant.describe(place), index, driven, stamp, exact=True)
    plants = Plants.members(spec.plant, place[None, :])
    # a function of the index, so that the noise is that of the draw
    modes = [Mode(controller_of(spec, implementation), lambda begin, end: plants)]
    found = [
        driven_of(scenario, modes, scenario_of(scenario, implementation, drawn.seed), spec.limits, index or 0)
        for scenario in scenarios
    ]
    return Simulated(spec, gains, spec.plant.describe(place), index, tuple(found), stamp)


def driven_of(
    scenario: ScenarioSpec, modes: Sequence[Mode], run: Scenario, limits: Sequence[Limit], index: int
) -> Driven:
    """One scenario of one plant.

    Args:
        scenario: the spec's.
        modes: controllers, and the plant for its index.
        run: the scenario on the controllers' samples.
        limits: the spec's.
        index: of the plant, on which its noise depends.
    """
    from fopi_tune.simulation.measures import horizon_of
    from fopi_tune.simulation.sampled.reference import measures_of
    from fopi_tune.simulation.sampled.simulate import simulate

    traces = simulate(modes, run, 1, index)
    numbers = measures_of(traces, [mode.controller for mode in modes], run, horizon_of(scenario, run))
    return judged_of(scenario, run.signals.reference, traces, numbers, limits)


def judged_of(
    scenario: ScenarioSpec, reference: np.ndarray, traces: Traces, numbers: Measures, limits: Sequence[Limit]
) -> Driven:
    """Signals of one plant with their measures by name, and the limits that these keep.

    Args:
        scenario: the spec's.
        reference: the setpoint at the signals' times.
        traces: one row.
        numbers: one number a measure.
        limits: the spec's.
    """
    from fopi_tune.simulation.measures import MEASURE_VALUES

    measures = {name: float(MEASURE_VALUES[name](numbers)[0]) for name in MEASURES}
    kept = tuple((e, _keeps(e, measures[e.measure])) for e in limits if e.scenario in (None, scenario.name))
    jumps = np.flatnonzero(np.diff(traces.mode[0])) + 1
    return Driven(
        scenario, reference, traces, measures, kept, bool(numbers.chattering[0]), tuple(traces.time_s[jumps].tolist())
    )


def continuous_of(scenario: ScenarioSpec, found: ContinuousSimulation, limits: Sequence[Limit]) -> Driven:
    """The same of a run in continuous time."""
    driven = judged_of(scenario, found.reference, found.traces, found.measures, limits)
    if not found.measures.finite[0]:
        driven = replace(driven, limits=tuple((limit, False) for limit, _ in driven.limits))
    return replace(driven, switch_times_s=found.switch_times_s, accuracy=found.accuracy, outcome=found.outcome)


def _keeps(limit: Limit, value: float) -> bool:
    return value <= limit.limit if limit.relation is Relation.AT_MOST else value >= limit.limit


def chosen(scenarios: Sequence[ScenarioSpec], only: str | None) -> tuple[ScenarioSpec, ...]:
    """The scenarios to drive.

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


def place_of(
    family: PlantFamily, drawn: ValidationSpec, plant: Mapping[str, float] | None, index: int | None
) -> np.ndarray:
    """A plant's place in its family's box, shape (p,).

    Args:
        family: the box.
        drawn: how plants are drawn.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a draw, instead.

    Raises:
        DomainError: an unknown number, an index that was not drawn, or a place that is no plant.
    """
    place = _named_place(family, plant or {}) if index is None else _drawn_place(family, drawn, index)
    if (problem := why_impossible(place, family)) is not None:
        raise DomainError(f"{'this' if index is None else f'draw {index}'} is no plant: {problem}")
    return place


def _drawn_place(family: PlantFamily, drawn: ValidationSpec, index: int) -> np.ndarray:
    from fopi_tune.montecarlo.draws import sample_points
    from fopi_tune.montecarlo.outcomes import sampling_plan_of

    if not 0 <= index < drawn.samples:
        raise DomainError(f"plant {index} was not drawn; the spec draws {drawn.samples}, from 0 on")
    return sample_points(sampling_plan_of(drawn), family, index, 1)[0]


def _named_place(family: PlantFamily, named: Mapping[str, float]) -> np.ndarray:
    for name, value in named.items():
        if name not in family.uncertain_names:
            known = ", ".join(family.uncertain_names) or "none: every number is known"
            raise DomainError(f"{name!r} is no uncertain number of the plant; there is {known}")
        if not math.isfinite(value):
            raise DomainError(f"{name} = {value!r} is no finite number")
    nominal = dict(zip(family.uncertain_names, family.nominal_point.tolist(), strict=True))
    return np.array([named.get(name, nominal[name]) for name in family.uncertain_names])
