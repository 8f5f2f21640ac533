"""Systems of two modes that take turns:  simulation of one pair of plants, and Monte Carlo over many pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.terms.numbers import refuse_no_flag, whole_number
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.progress import logged_progress
from fopi_tune.pipeline.scenario_results import (
    continuous_result,
    plant_point,
    refuse_accuracy,
    refuse_start,
    run_scenario,
    select_scenarios,
)
from fopi_tune.pipeline.tune_system import mode_gains, refuse_unknown_modes
from fopi_tune.pipeline.validate import override_validation
from fopi_tune.results.simulation import ScenarioResult
from fopi_tune.results.stamp import stamp
from fopi_tune.results.system import SimulatedSystem
from fopi_tune.simulation.notes import dwell_notes, mode_notes, rate_notes
from fopi_tune.spec import load_system
from fopi_tune.spec.load import SystemSource
from fopi_tune.spec.model import ScenarioSpec, SystemSpec

if TYPE_CHECKING:
    from fopi_tune.montecarlo.outcomes import Progress
    from fopi_tune.results.system import ValidatedSystem


def simulate_system(
    source: SystemSource,
    gains: Mapping[str, FoPi] | None = None,
    *,
    scenario: str | None = None,
    plant: Mapping[str, float] | None = None,
    replay: int | None = None,
    samples: int | None = None,
    seed: int | None = None,
    exact: bool = False,
    accuracy: float | None = None,
) -> SimulatedSystem:
    """Simulate the scenarios of a system for one pair of plants, with both digital controllers.

    Args:
        source: a system file, or a system.
        gains: by mode's name; those of the file where left out, and tuned where the file has none.
        scenario: name of the only one to simulate; all where left out.
        plant: uncertain numbers by name ("brake.time_constant_s"), in the specs' units; nominal where left out.
        replay: index of a pair that `validate_system` drew; it and its noise are made again.
        samples: what was given to `validate_system`.
        seed: what was given to `validate_system`.
        exact: simulate the hybrid inclusion in continuous time, with located jumps; in equal steps where there is a
            computing delay or a load.
        accuracy: of `exact`: refine until the output moves by less, in its unit; what is reached is said.

    Raises:
        SpecError: the file, or a spec it names, cannot be read, or has mistakes.
        DomainError: as for `simulate`, or a mode's spec that has no solution.
    """
    from fopi_tune.montecarlo.systems import hybrid_scenario, modes_of

    replay = None if replay is None else whole_number("replay", replay)
    refuse_no_flag("exact", exact)
    system = load_system(source)
    validation = override_validation(system.validation, samples, seed)
    system = replace(system, validation=validation)
    point = refuse_system_simulation(
        system, gains, scenario=scenario, plant=plant, replay=replay, exact=exact, accuracy=accuracy
    )
    every_gains = mode_gains(system, gains)
    implementations = _implementations(system, every_gains)
    scenarios = select_scenarios(system.scenarios, scenario)
    if exact:
        results = [_inclusion_result(system, each, every_gains, implementations, point, accuracy) for each in scenarios]
    else:
        modes = modes_of(system, implementations, lambda first, end: point[None, :])
        runs = [hybrid_scenario(system, each, implementations[0], validation.seed) for each in scenarios]
        results = [
            run_scenario(each, modes, run, system.judged_limits, replay or 0, system.measurement_unit)
            for each, run in zip(scenarios, runs, strict=True)
        ]
        digitals = [mode.spec.digital for mode in system.modes]
        results = [
            replace(each, notes=(*rate_notes(each.scenario, each.traces, digitals), *each.notes)) for each in results
        ]
    described = system.family.describe(point)
    made, notes = stamp(system.sha256, None), _system_notes(system, on_samples=not exact)
    if exact and system.inactive == "tracking" and any(each.accuracy is None for each in results):
        notes = (*notes, "inactive: tracking is set at the jump in continuous time: without the kick of kp at a step")
    return SimulatedSystem(system, every_gains, described, replay, tuple(results), made, exact=exact, notes=notes)


def refuse_system_simulation(
    source: SystemSource,
    gains: Mapping[str, FoPi] | None = None,
    *,
    scenario: str | None = None,
    plant: Mapping[str, float] | None = None,
    replay: int | None = None,
    samples: int | None = None,
    seed: int | None = None,
    exact: bool = False,
    accuracy: float | None = None,
) -> np.ndarray:
    """Refuse what `simulate_system` cannot, before gains are tuned and anything runs.

    Args:
        source, gains, scenario, plant, replay, samples, seed, exact, accuracy: as for `simulate_system`.

    Returns:
        The point of both plants, shape (p,).

    Raises:
        SpecError, DomainError: as `simulate_system`.
    """
    from fopi_tune.simulation.fractional.continuous import refuse_samples_only
    from fopi_tune.simulation.hybrid.scenario import refuse_what_is_sampled

    system = load_system(source)
    refuse_accuracy(accuracy, exact)
    refuse_unknown_modes(system, gains or {})
    point = plant_point(system.family, override_validation(system.validation, samples, seed), plant, replay)
    for mode in system.modes if exact else ():
        mode.spec.controller.refuse_derivative(f"{mode.name}: the exact simulation of a system in continuous time")
        if mode.spec.digital is not None and mode.spec.digital.output_rate_per_s is not None:
            raise DomainError(
                f"{mode.name}: output_rate_per_s belongs to the loop on samples; leave it or `exact=True` out"
            )
    for each in select_scenarios(system.scenarios, scenario):
        if exact:
            refuse_samples_only(each, limits_rate=False)
            refuse_what_is_sampled(system, each)
        for mode, family_point in zip(system.modes, _points(system, point), strict=True):
            refuse_start(each, Plants.members(mode.spec.plant, family_point[None, :]), system.sample_time_s)
    return point


def _points(system: SystemSpec, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of each mode's plant."""
    raising, lowering = (point[system.family.columns(mode.name)] for mode in system.modes)
    return raising, lowering


def _system_notes(system: SystemSpec, on_samples: bool) -> tuple[str, ...]:
    """What the modes' limits leave no room for, by the nominal plants; what samples make of the minimum dwell."""
    notes = list(dwell_notes(system)) if on_samples else []
    for mode, raises in zip(system.modes, (True, False), strict=True):
        limits = mode.spec.digital.output_limits if mode.spec.digital is not None else None
        if limits is not None:
            nominal = mode.spec.plant.member(mode.spec.plant.nominal_point)
            notes += mode_notes(mode.name, raises, nominal, limits)
    return tuple(notes)


def validate_system(
    source: SystemSource,
    gains: Mapping[str, FoPi] | None = None,
    *,
    samples: int | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
) -> ValidatedSystem:
    """Draw pairs of plants and count how often a system meets its limits in its scenarios.

    Args:
        source: a system file, or a system.
        gains: by mode's name; those of the file where left out, and tuned where the file has none.
        samples: pairs to draw, in place of the file's.
        seed: in place of the file's.
        progress: called with the number of pairs done, and of all.

    Raises:
        SpecError, DomainError: as for `simulate_system`, or a number of samples that is not positive.
    """
    from fopi_tune.montecarlo.systems import system_evidence
    from fopi_tune.results.system import ValidatedSystem

    system = load_system(source)
    system = replace(system, validation=override_validation(system.validation, samples, seed))
    refuse_system_simulation(system, gains)
    every_gains = mode_gains(system, gains)
    told = logged_progress(f"{system.name}: pairs of plants drawn", progress)
    evidence = system_evidence(system, _implementations(system, every_gains), told)
    made = replace(stamp(system.sha256, None), seed=evidence.validation.seed)
    return ValidatedSystem(system, every_gains, evidence, made, _system_notes(system, on_samples=True))


def _implementations(system: SystemSpec, gains: Mapping[str, FoPi]) -> list[Implementation]:
    """The digital controllers of the modes, in their order."""
    from fopi_tune.digital.implementation import implementation_of

    return [implementation_of(mode.spec, gains[mode.name]) for mode in system.modes]


def _inclusion_result(
    system: SystemSpec,
    scenario: ScenarioSpec,
    gains: Mapping[str, FoPi],
    implementations: Sequence[Implementation],
    point: np.ndarray,
    accuracy: float | None,
) -> ScenarioResult:
    """One scenario of the hybrid inclusion; `point` holds the numbers of the first mode's plant, then the second's."""
    from fopi_tune.digital.implementation import runtime_of
    from fopi_tune.simulation.hybrid.scenario import simulate_inclusion

    plants = [m.spec.plant.member(part) for m, part in zip(system.modes, _points(system, point), strict=True)]
    controllers = [runtime_of(i.sections, m.spec) for m, i in zip(system.modes, implementations, strict=True)]
    each = [gains[mode.name] for mode in system.modes]
    step = implementations[0].sample_time_s
    found = simulate_inclusion(system, scenario, each, plants, controllers, step, accuracy)
    return continuous_result(scenario, found, system.judged_limits, system.measurement_unit, accuracy)
