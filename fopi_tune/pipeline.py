"""The sequence of stages:  spec -> design -> proof -> Design."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.outcome import Give, Status
from fopi_tune.proof import Verification, verify
from fopi_tune.result import Check, Design, RequirementReport
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec
from fopi_tune.stamp import stamp

if TYPE_CHECKING:
    from fopi_tune.design import Candidate, Violation

#: how often a refuted design is made again
_MOST_REFUTATIONS = 5
_SOLVER = "ipopt"


def tune(source: str | os.PathLike[str] | DesignSpec) -> Design:
    """Find the gains that meet a spec over its whole family, and check them.

    Args:
        source: a spec file, or a spec.

    Returns:
        A design; `status` says how it ended.  Infeasible, unbounded and failed are answers, not exceptions.

    Raises:
        SpecError: the file cannot be read, or has mistakes; it lists them all.
        DomainError: a dead time so long that the loop's crossings cannot be listed.
    """
    spec = load_spec(source)
    violations: tuple[Violation, ...] = ()
    candidate, found = _attempt(spec, violations)
    for _ in range(_MOST_REFUTATIONS):
        new = _refutations(candidate, found, violations)
        if not new:
            break
        violations += new
        candidate, found = _attempt(spec, violations)
    return _assembled(spec, candidate, found)


def prove(source: str | os.PathLike[str] | DesignSpec, gains: FoPi, tolerance: float = 1e-6) -> Check:
    """Check gains from anywhere against a spec.

    Args:
        source: a spec file, or a spec.
        gains: the controller.
        tolerance: by how much a requirement may be missed, in neper or radian (a delay margin: relative).

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: kp = ki = 0, or a dead time so long that the loop's crossings cannot be listed.
    """
    spec = load_spec(source)
    return Check(spec, verify(spec, gains, tolerance), stamp(spec.sha256, None))


def _attempt(spec: DesignSpec, violations: tuple[Violation, ...]) -> tuple[Candidate, Verification | None]:
    """A candidate and what the check says of it; kp = ki = 0 leaves nothing to check."""
    from fopi_tune.design import design  # loads CasADi, which a check has no need of

    candidate = design(spec, violations)
    gains = candidate.gains
    if gains is None or (gains.kp == 0.0 and gains.ki == 0.0):
        return candidate, None
    return candidate, verify(spec, gains)


def _refutations(
    candidate: Candidate, found: Verification | None, known: tuple[Violation, ...]
) -> tuple[Violation, ...]:
    """Where the check found a candidate wrong that the search took for right, beyond what is known already."""
    if candidate.status is not Status.SOLVED or found is None:
        return ()
    from fopi_tune.design import Violation

    violations = (
        Violation(i, result.worst.point, result.worst.omega_rad_s if result.worst.omega_rad_s is not None else math.nan)
        for i, result in enumerate(found.requirements)
        if not result.is_met
    )
    return tuple(v for v in violations if v not in known)


def _assembled(spec: DesignSpec, candidate: Candidate, found: Verification | None) -> Design:
    status, message, clash = candidate.status, candidate.message, candidate.clash
    if status is Status.SOLVED and (found is None or not found.all_met):
        status, message = Status.FAILED, _refusal(found)
        box = spec.controller
        if found is not None and all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
            status, clash = Status.INFEASIBLE, _unmet(found)
            message = "the spec fixes kp, ki and alpha, and they do not meet it"
    results = found.requirements if found else (None,) * len(spec.requirements)
    reports = tuple(
        RequirementReport(requirement, result, multiplier)
        for requirement, result, multiplier in zip(spec.requirements, results, candidate.multipliers, strict=True)
    )
    return Design(
        spec=spec,
        status=status,
        gains=candidate.gains,
        objective=found.objective if found else None,
        requirements=reports,
        stability=found.stability if found else None,
        nominal=found.nominal if found else None,
        clash=clash,
        message=message,
        stamp=stamp(spec.sha256, _SOLVER),
        solves=candidate.solves,
    )


def _unmet(found: Verification) -> tuple[Give, ...]:
    """The requirements that fixed gains miss, and how far each would have to give."""
    gives = []
    for i, result in enumerate(found.requirements):
        if result.is_met:
            continue
        value = result.achieved
        amount = None
        if value is not None and math.isfinite(value):
            amount = min(abs(value - limit) for limit in result.requirement.limits)
        gives.append(Give(i, amount, value if amount is not None else None))
    return tuple(gives)


def _refusal(found: Verification | None) -> str:
    if found is None:
        return "the best gains found are kp = ki = 0: switched off; add a requirement that needs a controller"
    if not found.stability.stable:
        return f"the check refuted the best gains found: {found.stability.reason}"
    names = ", ".join(r.requirement.quantity for r in found.requirements if not r.is_met)
    return f"the check refuted the best gains found: {names}"


__all__ = ["Check", "Design", "prove", "tune"]
