"""Systems of two modes that take turns:  simulation of one pair of plants, and Monte Carlo over many pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.simulate import continuous_result, plant_point, run_scenario, select_scenarios
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.validate import override_validation
from fopi_tune.results.simulation import ScenarioResult
from fopi_tune.results.stamp import stamp
from fopi_tune.results.status import Status
from fopi_tune.results.system import SimulatedSystem
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
        exact: simulate the hybrid inclusion in continuous time, with located jumps.

    Raises:
        SpecError: the file, or a spec it names, cannot be read, or has mistakes.
        DomainError: as for `simulate`, or a mode's spec that has no solution.
    """
    from fopi_tune.montecarlo.systems import hybrid_scenario, modes_of

    system = load_system(source)
    validation = override_validation(system.validation, samples, seed)
    system = replace(system, validation=validation)
    mode_gains = _mode_gains(system, gains)
    implementations = _implementations(system, mode_gains)
    point = plant_point(system.family, validation, plant, replay)
    scenarios = select_scenarios(system.scenarios, scenario)
    if exact:
        results = [_inclusion_result(system, each, mode_gains, implementations, point) for each in scenarios]
    else:
        modes = modes_of(system, implementations, lambda first, end: point[None, :])
        runs = [hybrid_scenario(system, each, implementations[0], validation.seed) for each in scenarios]
        results = [
            run_scenario(each, modes, run, system.limits, replay or 0)
            for each, run in zip(scenarios, runs, strict=True)
        ]
    described = system.family.describe(point)
    made = stamp(system.sha256, None)
    return SimulatedSystem(system, mode_gains, described, replay, tuple(results), made, exact=exact)


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
    mode_gains = _mode_gains(system, gains)
    evidence = system_evidence(system, _implementations(system, mode_gains), progress)
    made = replace(stamp(system.sha256, None), seed=evidence.validation.seed)
    return ValidatedSystem(system, mode_gains, evidence, made)


def _mode_gains(system: SystemSpec, gains: Mapping[str, FoPi] | None) -> dict[str, FoPi]:
    """The gains of a system's modes: those given, else those of the file, else tuned ones.

    Raises:
        DomainError: a mode that does not exist, or a spec that has no solution.
    """
    given = dict(gains or {})
    names = [mode.name for mode in system.modes]
    if unknown := [name for name in given if name not in names]:
        raise DomainError(f"there is no mode {unknown[0]!r}; there is {' and '.join(names)}")
    found = {}
    for mode in system.modes:
        wanted = given.get(mode.name, mode.gains)
        if wanted is None:
            design = tune(mode.spec, proof=False)
            if design.status is not Status.SOLVED or design.gains is None:
                raise DomainError(f"{mode.name}: its spec is {design.status.value}, give the system its gains")
            wanted = design.gains
        found[mode.name] = wanted
    return found


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
) -> ScenarioResult:
    """One scenario of the hybrid inclusion; `point` holds the numbers of the first mode's plant, then the second's."""
    from fopi_tune.montecarlo.montecarlo import controller_of
    from fopi_tune.simulation.hybrid.scenario import simulate_inclusion

    split = len(system.modes[0].spec.plant.uncertain_names)
    plants = [m.spec.plant.member(part) for m, part in zip(system.modes, (point[:split], point[split:]), strict=True)]
    controllers = [controller_of(m.spec, i) for m, i in zip(system.modes, implementations, strict=True)]
    each = [gains[mode.name] for mode in system.modes]
    step = implementations[0].sample_time_s
    found = simulate_inclusion(system, scenario, each, plants, controllers, step)
    return continuous_result(scenario, found, system.limits)
