"""The stages of a system's cell:  gains of both modes -> proof, controllers, simulation and evidence, as documents."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from fopi_tune.core.controller import FoPi
from fopi_tune.pipeline.discretize import discretize_system
from fopi_tune.pipeline.prove_system import prove_system
from fopi_tune.pipeline.systems import simulate_system, validate_system
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.tune_system import mode_gains, tune_system
from fopi_tune.results.status import Status
from fopi_tune.results.system_design import DesignedSystem
from fopi_tune.spec.digests import content_digest
from fopi_tune.spec.model import DesignSpec, SystemSpec
from fopi_tune.study.cells.systems import system_from_text
from fopi_tune.study.model import Cell, Stage
from fopi_tune.study.overrides import Files

#: sizes of a worker's caches: systems and their gains, and gains of modes' own specs
_MAX_SYSTEMS, _MAX_MODES = 16, 64

_STAGES: Mapping[Stage, Callable[[SystemSpec, Mapping[str, FoPi]], Any]] = {
    Stage.PROVE: prove_system,
    Stage.DISCRETIZE: discretize_system,
    Stage.SIMULATE: simulate_system,
    Stage.VALIDATE: validate_system,
}


def run_system(cell: Cell, document: dict[str, Any]) -> bool:
    """Run a system's stages into a document; returns whether its gains were found, so that there is an outcome to set.

    Raises:
        FopiError: a stage that cannot be run.
    """
    checked = _system(cell.check or cell.text, cell.name, cell.files)
    if Stage.TUNE in cell.stages:
        design = _designed(cell.text, cell.name, cell.files)
        document[Stage.TUNE] = design.to_dict()
        document["outcome"] = design.status.value
        if design.status is not Status.SOLVED or design.gains is None:
            document["reason"] = design.message
            return False
        gains = dict(design.gains)
    else:
        gains = _gains(cell.text, cell.name, cell.files)
    for stage, run in _STAGES.items():
        if stage in cell.stages:
            document[stage] = run(checked, gains).to_dict()
    return True


@lru_cache(_MAX_SYSTEMS)
def _system(text: str, name: str, files: Files) -> SystemSpec:
    """The system of a cell, read once for all of its stages."""
    return system_from_text(text, name, files)


@lru_cache(_MAX_SYSTEMS)
def _designed(text: str, name: str, files: Files) -> DesignedSystem:
    """The design of a system; cells that differ only in what they are checked against share it."""
    system = _system(text, name, files)
    return tune_system(system, _own_gains(system))


@lru_cache(_MAX_SYSTEMS)
def _gains(text: str, name: str, files: Files) -> dict[str, FoPi]:
    """The gains of a system without a stage tune: those that it gives, and those of its modes' own specs."""
    system = _system(text, name, files)
    return mode_gains(system, _own_gains(system))


@dataclass(frozen=True)
class _ModeSpec:
    """A mode's spec; equal to another one of the same content."""

    digest: str
    spec: DesignSpec = field(compare=False)


def _own_gains(system: SystemSpec) -> dict[str, FoPi]:
    """The gains of modes that have none and are not tuned with the system, where their specs have a solution."""
    wanted = [mode for mode in system.modes if mode.gains is None and mode.name not in system.tuned]
    found = {mode.name: _tuned(_ModeSpec(content_digest(mode.spec), mode.spec)) for mode in wanted}
    return {name: gains for name, gains in found.items() if isinstance(gains, FoPi)}


@lru_cache(_MAX_MODES)
def _tuned(mode: _ModeSpec) -> FoPi | None:
    """The gains of a spec; cells that differ in other parts of their system share them."""
    design = tune(mode.spec, proof=False, bracket=False)
    return design.gains if design.status is Status.SOLVED else None
