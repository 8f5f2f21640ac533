"""Proofs about a system of two loops that take turns:  SystemSpec, gains -> SystemCertificate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError
from fopi_tune.proof.switched.bounded_search import prove_bounded
from fopi_tune.proof.switched.certificate import SystemCertificate
from fopi_tune.proof.switched.cycle_search import prove_cycles
from fopi_tune.proof.switched.model import Memory, SwitchedModel, loop_obstacle
from fopi_tune.proof.switched.saturated_loop import SaturatedLoopProof, prove_saturated_loop
from fopi_tune.proof.switched.settling_search import SettlingSearch, prove_settling
from fopi_tune.spec.model import SystemSpec


def prove_system(
    system: SystemSpec,
    gains: Mapping[str, FoPi],
    *,
    setpoints: tuple[float, float] | None = None,
    versions: Mapping[str, str] | None = None,
) -> SystemCertificate:
    """Prove that a system settles, or a cycle it ends in, or what else can be proved.

    Args:
        system: gives plants, digital controllers, hysteresis and memory.
        gains: of both modes, by name.
        setpoints: least and largest setpoint to settle on, in the output's unit; None: as many as can be proved.
        versions: of the programs, by name, for the certificate.

    Raises:
        DomainError: gains or setpoints cannot be used, or no digital controller can be made.
    """
    asked = _checked(setpoints)
    model = SwitchedModel.of(system, gains)
    raising, lowering = (_loop(model, index) for index in (0, 1))
    obstacle, bounded = model.obstacle, prove_bounded(model, asked)
    search = SettlingSearch(None, obstacle) if obstacle else prove_settling(model, asked)
    reason = search.reason
    if not reason and model.memory is Memory.RESET and raising is None:
        reason = f"with its limits the {model.loops[0].name} alone is not shown to settle from every state"
    found = SystemCertificate(
        name=system.name,
        system_sha256=system.sha256,
        model=model,
        setpoints=asked,
        loops=(raising, lowering),
        settling=search.proof,
        reason=reason,
        cycles=(),
        bounded=bounded.proof,
        unbounded=bounded.reason,
        versions=dict(versions or {}),
    )
    if obstacle or not reason:
        return found
    cycles = prove_cycles(model, asked)
    return replace(found, cycles=cycles)


def _loop(model: SwitchedModel, index: int) -> SaturatedLoopProof | None:
    loop = model.loops[index]
    return None if loop_obstacle(loop) else prove_saturated_loop(loop, model.sample_time_s)


def _checked(setpoints: tuple[float, float] | None) -> tuple[float, float] | None:
    if setpoints is None:
        return None
    low, high = setpoints
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise DomainError(f"setpoints {low!r} to {high!r}: give two finite numbers, the smaller one first")
    return float(low), float(high)
