"""The stages of a system:  two specs that take turns -> gains -> simulations and evidence."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.core.sections import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.outcome import Status
from fopi_tune.pipeline import tune
from fopi_tune.pipeline_time import wanted_validation
from fopi_tune.spec import load_system
from fopi_tune.spec.model import SystemSpec
from fopi_tune.stamp import stamp

if TYPE_CHECKING:
    from fopi_tune.systems import SimulatedSystem, ValidatedSystem
    from fopi_tune.validation.drawn import Progress

SystemSource = str | os.PathLike[str] | SystemSpec


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
    from fopi_tune.systems import drive_system

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
    from fopi_tune.systems import ValidatedSystem
    from fopi_tune.validation.joint import system_evidence

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
    from fopi_tune.implement import implementation_of

    return [implementation_of(mode.spec, gains[mode.name]) for mode in system.modes]
