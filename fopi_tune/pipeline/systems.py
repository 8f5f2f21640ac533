"""The stages of a system:  two specs that take turns -> gains -> simulations and evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.validate import wanted_validation
from fopi_tune.results.stamp import stamp
from fopi_tune.results.status import Status
from fopi_tune.spec import load_system
from fopi_tune.spec.load import SystemSource
from fopi_tune.spec.model import SystemSpec

if TYPE_CHECKING:
    from fopi_tune.montecarlo.outcomes import Progress
    from fopi_tune.results.system import ValidatedSystem

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.pipeline.simulate import chosen, continuous_of, driven_of, place_of
from fopi_tune.results.simulation import Driven
from fopi_tune.results.stamp import Stamp
from fopi_tune.results.system import SimulatedSystem
from fopi_tune.spec.model import ScenarioSpec, ValidationSpec

if TYPE_CHECKING:
    pass


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
    """Drive one pair of plants through a system's scenarios with both digital controllers.

    Args:
        source: a system file, or a system.
        gains: by mode's name; those of the file where left out, and tuned where the file has none.
        scenario: name of the only one.
        plant: uncertain numbers by name ("brake.time_constant_s"), in the specs' units; nominal where left out.
        replay: index of a pair that `validate_system` drew, to make it and its noise again.
        samples: what was given to `validate_system`.
        seed: what was given to `validate_system`.
        exact: the hybrid inclusion in continuous time instead, with located jumps.

    Raises:
        SpecError: the file, or a spec it names, cannot be read, or has mistakes.
        DomainError: as for `simulate`, or a mode's spec that has no solution.
    """

    system = load_system(source)
    system = replace(system, validation=wanted_validation(system.validation, samples, seed))
    found = gains_of_system(system, gains)
    made = stamp(system.sha256, None)
    runs = _implementations(system, found)
    return drive_system(system, found, runs, made, only=scenario, plant=plant, index=replay, exact=exact)


def validate_system(
    source: SystemSource,
    gains: Mapping[str, FoPi] | None = None,
    *,
    samples: int | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
) -> ValidatedSystem:
    """Draw pairs of plants and say how often a system keeps its limits in its scenarios.

    Args:
        source: a system file, or a system.
        gains: by mode's name; those of the file where left out, and tuned where the file has none.
        samples: pairs to draw, in place of the file's.
        seed: in place of the file's.
        progress: told how many pairs are done, of how many.

    Raises:
        SpecError, DomainError: as for `simulate_system`, or a number of samples that is not positive.
    """
    from fopi_tune.montecarlo.systems import system_evidence
    from fopi_tune.results.system import ValidatedSystem

    system = load_system(source)
    system = replace(system, validation=wanted_validation(system.validation, samples, seed))
    found = gains_of_system(system, gains)
    evidence = system_evidence(system, _implementations(system, found), progress)
    made = replace(stamp(system.sha256, None), seed=evidence.validation.seed)
    return ValidatedSystem(system, found, evidence, made)


def gains_of_system(system: SystemSpec, gains: Mapping[str, FoPi] | None = None) -> dict[str, FoPi]:
    """The gains of a system's modes: those given, those of the file, and tuned ones for the rest.

    Raises:
        DomainError: a mode that there is not, or a spec that has no solution.
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
    from fopi_tune.digital.implementation import implementation_of

    return [implementation_of(mode.spec, gains[mode.name]) for mode in system.modes]


def drive_system(
    system: SystemSpec,
    gains: Mapping[str, FoPi],
    implementations: Sequence[Implementation],
    stamp: Stamp,
    *,
    only: str | None = None,
    plant: Mapping[str, float] | None = None,
    index: int | None = None,
    exact: bool = False,
) -> SimulatedSystem:
    """Simulate the scenarios of a system for one pair of plants.

    Args:
        system: the system.
        gains: of each mode.
        implementations: the controllers that run, throttle first.
        stamp: where the result comes from.
        only: name of the only scenario.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a Monte-Carlo draw to make again, its noise included; instead of plants.
        exact: the hybrid inclusion in continuous time instead.

    Raises:
        DomainError: an unknown scenario or number, or an index that was not drawn.
    """
    from fopi_tune.montecarlo.systems import hybrid_scenario, modes_of

    drawn = system.validation or ValidationSpec()
    family = system.family
    place = place_of(family, drawn, plant, index)
    scenarios = chosen(system.scenarios, only)
    if exact:
        driven = tuple(_inclusion(system, scenario, gains, implementations, place) for scenario in scenarios)
        return SimulatedSystem(system, dict(gains), family.describe(place), index, driven, stamp, exact=True)
    modes = modes_of(system, implementations, lambda first, end: place[None, :])
    found = []
    for scenario in scenarios:
        run = hybrid_scenario(system, scenario, implementations[0], drawn.seed)
        found.append(driven_of(scenario, modes, run, system.limits, index or 0))
    return SimulatedSystem(system, dict(gains), family.describe(place), index, tuple(found), stamp)


def _inclusion(
    system: SystemSpec,
    scenario: ScenarioSpec,
    gains: Mapping[str, FoPi],
    implementations: Sequence[Implementation],
    place: np.ndarray,
) -> Driven:
    from fopi_tune.montecarlo.montecarlo import controller_of
    from fopi_tune.simulation.hybrid.scenario import simulate_inclusion

    split = len(system.modes[0].spec.plant.uncertain_names)
    plants = [m.spec.plant.member(part) for m, part in zip(system.modes, (place[:split], place[split:]), strict=True)]
    controllers = [controller_of(m.spec, i) for m, i in zip(system.modes, implementations, strict=True)]
    each = [gains[mode.name] for mode in system.modes]
    step = implementations[0].sample_time_s
    return continuous_of(scenario, simulate_inclusion(system, scenario, each, plants, controllers, step), system.limits)
