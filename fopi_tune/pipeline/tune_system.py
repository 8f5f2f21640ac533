"""Tuning of a system:  gains of one or both modes for the scenarios of the switched loops -> DesignedSystem."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.tune import tune
from fopi_tune.proof import Verification, verify
from fopi_tune.results.stamp import stamp
from fopi_tune.results.status import Status
from fopi_tune.results.system_design import DesignedSystem, DrawnRequirement
from fopi_tune.spec import load_system
from fopi_tune.spec.load import SystemSource
from fopi_tune.spec.model import Limit, Relation, SystemSpec, ValidationSpec
from fopi_tune.spec.scenarios import frequency_part

if TYPE_CHECKING:
    from fopi_tune.montecarlo.systems import SystemEvidence

#: pairs of plants that are drawn for the check
CHECKED_PAIRS = 10_000


_log = logging.getLogger(__name__)


def tune_system(source: SystemSource, gains: Mapping[str, FoPi] | None = None) -> DesignedSystem:
    """Find gains of the modes under `tune:` that meet a system's requirements with every pair of plants.

    The design is checked by simulation of drawn pairs, and each tuned mode's own requirements by a verification of its
    loop; nothing is proved.

    Args:
        source: a system file, or a system, with `tune:` and an objective.
        gains: of modes that are not tuned, by name; where left out those of the file, or those of the mode's own spec.

    Raises:
        SpecError: the file, or a spec it names, cannot be read, or has mistakes.
        DomainError: nothing is to be tuned, a mode's controller cannot be made, or its spec has no solution.
    """
    from fopi_tune.design.systems import design_system

    system = load_system(source)
    if not system.tuned or system.objective is None:
        raise DomainError(
            f"the system says not what to tune; add tune: [{system.modes[1].name}], requirements and objective: "
            "{minimize: iae, scenario: ...}, or tune the modes' own specs"
        )
    fixed = mode_gains(system, gains, system.tuned)
    _log.info("%s: search for gains of %s by simulation", system.name, ", ".join(system.tuned))
    found = design_system(system, fixed)
    _log.info("%s: search ended after %d simulated gains", system.name, found.evaluations)
    stamped = stamp(system.sha256, "simplex")
    reasons = "; ".join(found.reasons)
    if found.gains is None or found.judged is None:
        message = reasons or "no gains within their ranges were found that give every plant a stable loop"
        return DesignedSystem(
            system, Status.INFEASIBLE, None, None, (), {}, (), message, (), found.evaluations, stamped
        )  # fmt: skip
    loops = {name: _verified(system, name, found.gains[name]) for name in system.tuned}
    checked = _checked(system, found.gains)
    met = found.is_met and all(each.is_met for each in checked) and all(loop.all_met for loop in loops.values())
    message = "" if met else reasons or "no gains were found that meet every requirement with every pair of plants"
    clash = () if met else found.clash
    return DesignedSystem(
        system,
        Status.SOLVED if met else Status.INFEASIBLE,
        found.gains,
        found.judged.objective,
        checked,
        loops,
        clash,
        message,
        _notes(system),
        found.evaluations,
        stamped,
    )


def mode_gains(system: SystemSpec, gains: Mapping[str, FoPi] | None, left_out: Sequence[str] = ()) -> dict[str, FoPi]:
    """The gains of a system's modes: those given, else those of the file, else tuned ones.

    Modes under `tune:` are tuned together, for the system's scenarios.

    Args:
        system: the system.
        gains: by mode's name.
        left_out: modes whose gains are not wanted.

    Raises:
        DomainError: a mode that does not exist, or a spec or system that has no solution.
    """
    refuse_unknown_modes(system, gains or {})
    given, found = dict(gains or {}), {}
    if not left_out and any(m.name not in given and m.gains is None for m in system.modes if m.name in system.tuned):
        designed = tune_system(system, given)
        if designed.status is not Status.SOLVED or designed.gains is None:
            raise DomainError(f"the system is {designed.status.value}: {designed.message}; give its modes their gains")
        return dict(designed.gains)
    for mode in system.modes:
        if mode.name in left_out:
            continue
        wanted = given.get(mode.name, mode.gains)
        if wanted is None:
            design = tune(mode.spec, proof=False, bracket=False)
            if design.status is not Status.SOLVED or design.gains is None:
                raise DomainError(f"{mode.name}: its spec is {design.status.value}, give the system its gains")
            wanted = design.gains
        found[mode.name] = wanted
    return found


def refuse_unknown_modes(system: SystemSpec, gains: Mapping[str, FoPi]) -> None:
    """Refuse gains of a mode that does not exist, and what are no gains.

    Raises:
        DomainError: there is no such mode, or its gains are None, no controller, or of another structure.
    """
    names = [mode.name for mode in system.modes]
    if not isinstance(gains, Mapping):
        raise DomainError(
            f"{gains!r:.100} is no mapping of gains by mode; give {{{names[0]!r}: ..., {names[1]!r}: ...}}"
        )
    if unknown := [name for name in gains if name not in names]:
        raise DomainError(f"there is no mode {unknown[0]!r}; there is {' and '.join(names)}")
    for mode in system.modes:
        if mode.name not in gains:
            continue
        refuse_no_gains(gains[mode.name])
        # gains that are all 0 are of every structure; stages that need a controller say so
        if gains[mode.name].is_zero:
            continue
        try:
            mode.spec.controller.refuse_other_structure(gains[mode.name])
        except DomainError as error:
            raise DomainError(f"{mode.name}: {error}") from None


def _verified(system: SystemSpec, name: str, gains: FoPi) -> Verification:
    """The requirements of a mode's own spec on its loop on samples."""
    mode = next(mode for mode in system.modes if mode.name == name)
    assert mode.spec.digital is not None
    spec = replace(frequency_part(mode.spec), digital=replace(mode.spec.digital, design="sampled"))
    return verify(spec, gains, implementation=implementation_of(spec, gains))


def _checked(system: SystemSpec, gains: Mapping[str, FoPi]) -> tuple[DrawnRequirement, ...]:
    """Each requirement over drawn pairs, uniform over both boxes, without noise."""
    from fopi_tune.montecarlo.systems import system_evidence

    drawn = ValidationSpec(samples=CHECKED_PAIRS, seed=(system.validation or ValidationSpec()).seed)
    quiet = tuple(replace(scenario, noise_std=0.0) for scenario in system.scenarios)
    asked = replace(system, limits=(), validation=drawn, scenarios=quiet)
    implementations = [implementation_of(mode.spec, gains[mode.name]) for mode in system.modes]
    evidence = system_evidence(asked, implementations)
    return tuple(_worst(limit, evidence) for limit in system.requirements)


def _worst(requirement: Limit, evidence: SystemEvidence) -> DrawnRequirement:
    found = [
        (scenario.scenario, outcome)
        for scenario in evidence.scenarios
        for outcome in scenario.limits
        if outcome.limit == requirement
    ]
    limit = found[0][1].limit
    assert limit is not None
    side = 1.0 if limit.relation is Relation.AT_MOST else -1.0
    name, outcome = min(found, key=lambda each: (each[1].fraction.met, -side * each[1].worst[0].value))
    return DrawnRequirement(limit, name, outcome.worst[0].value, outcome.worst[0].plant, outcome.fraction)


def _notes(system: SystemSpec) -> tuple[str, ...]:
    noisy = [scenario.name for scenario in system.scenarios if scenario.noise_std]
    return (f"noise is left out of the design: {', '.join(noisy)}",) if noisy else ()
