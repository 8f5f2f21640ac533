"""The sequence of stages:  spec -> design -> verification -> certificate -> Design."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError
from fopi_tune.outcome import Give, Status
from fopi_tune.proof import Certificate, Recheck, Verdict, Verification, certify, verify
from fopi_tune.proof.certificate import LARGEST_TOLERANCE
from fopi_tune.result import Check, Design, Discretized, RequirementReport
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec
from fopi_tune.stamp import certificate_versions, stamp

if TYPE_CHECKING:
    from fopi_tune.design import Candidate, Violation

#: how often a refuted design is made again
_MOST_REFUTATIONS = 5
_SOLVER = "ipopt"


@dataclass(frozen=True)
class _Attempt:
    """A candidate, what the verification says of it, and the certificate; kp = ki = 0 leaves nothing to check."""

    candidate: Candidate
    found: Verification | None = None
    certificate: Certificate | None = None


def tune(source: str | os.PathLike[str] | DesignSpec, proof: bool = True) -> Design:
    """Find the gains that meet a spec over its whole family, and prove that they do.

    Args:
        source: a spec file, or a spec.
        proof: False leaves the certificate out: `solved` then means verified in floating point, and the result says so.

    Returns:
        A design; `status` says how it ended.  Infeasible, unbounded and failed are answers, not exceptions.

    Raises:
        SpecError: the file cannot be read, or has mistakes; it lists them all.
        DomainError: a dead time so long that the loop's crossings cannot be listed.
    """
    spec = load_spec(source)
    violations: tuple[Violation, ...] = ()
    attempt = _attempt(spec, violations, proof)
    for _ in range(_MOST_REFUTATIONS):
        new = _refutations(attempt, violations)
        if not new:
            break
        violations += new
        attempt = _attempt(spec, violations, proof)
    return _assembled(spec, attempt, proof)


def prove(source: str | os.PathLike[str] | DesignSpec, gains: FoPi, tolerance: float = 1e-6) -> Check:
    """Check gains from anywhere against a spec, and prove or refute what it asks.

    Args:
        source: a spec file, or a spec.
        gains: the controller.
        tolerance: by how much a requirement may be missed, in neper or radian (a delay margin: relative).

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: kp = ki = 0, a tolerance outside (0, 0.01], or a dead time so long that the loop's crossings
            cannot be listed.
    """
    spec = load_spec(source)
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        raise DomainError(
            f"tolerance = {tolerance!r} must be greater than 0 and at most {LARGEST_TOLERANCE:g}; 1e-6 is usual"
        )
    found = verify(spec, gains, tolerance)
    return Check(spec, found, certify(spec, found, certificate_versions()), stamp(spec.sha256, None))


def discretize(source: str | os.PathLike[str] | DesignSpec, gains: FoPi) -> Discretized:
    """Make the digital controller that a spec's `digital:` section asks for.

    Args:
        source: a spec file, or a spec.
        gains: the controller, usually from a design.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: the spec has no such section, or it cannot be met (band, sample time, precision).
    """
    from fopi_tune.core.margins import margins
    from fopi_tune.digital import discretize

    spec = load_spec(source)
    if spec.digital is None:
        raise DomainError(
            "the spec has no section digital; add digital: {sample_time_s: 0.2} with your sampling period"
        )
    crossover = margins(gains, spec.plant.member(spec.plant.nominal_point)).crossover_rad_s
    return Discretized(spec, discretize(gains, spec.digital, crossover), stamp(spec.sha256, None))


def recheck(document: object, source: str | os.PathLike[str] | DesignSpec | None = None) -> Recheck:
    """Check a certificate without searching.

    Args:
        document: the certificate's JSON, as `json.load` gives it.
        source: when given, the certificate must be about this spec.

    Raises:
        CertificateError: it is no certificate.
        SpecError: the spec cannot be read, or has mistakes.
    """
    from fopi_tune.proof import recheck

    return recheck(document, None if source is None else load_spec(source))


def _attempt(spec: DesignSpec, violations: tuple[Violation, ...], proof: bool) -> _Attempt:
    from fopi_tune.design import design  # loads CasADi, which a check has no need of

    candidate = design(spec, violations)
    gains = candidate.gains
    if gains is None or (gains.kp == 0.0 and gains.ki == 0.0):
        return _Attempt(candidate)
    found = verify(spec, gains)
    if not proof or candidate.status is not Status.SOLVED or not found.all_met:
        return _Attempt(candidate, found)
    return _Attempt(candidate, found, certify(spec, found, certificate_versions()))


def _refutations(attempt: _Attempt, known: tuple[Violation, ...]) -> tuple[Violation, ...]:
    """Where a candidate that the search took for right was found wrong, beyond what is known already."""
    if attempt.candidate.status is not Status.SOLVED or attempt.found is None:
        return ()
    from fopi_tune.design import Violation

    places = [(i, result.worst) for i, result in enumerate(attempt.found.requirements) if not result.is_met]
    if attempt.certificate is not None:
        places += [
            (i, side.worst)
            for i, proved in enumerate(attempt.certificate.requirements)
            for side in proved.sides
            if side.verdict is Verdict.REFUTED
        ]
    violations = (
        Violation(i, place.point, place.omega_rad_s if place.omega_rad_s is not None else math.nan)
        for i, place in places
    )
    return tuple(v for v in violations if v not in known)


def _assembled(spec: DesignSpec, attempt: _Attempt, proof: bool) -> Design:
    candidate, found, certificate = attempt.candidate, attempt.found, attempt.certificate
    status, message, clash = candidate.status, candidate.message, candidate.clash
    if status is Status.SOLVED and (found is None or not found.all_met):
        status, message = Status.FAILED, _refusal(found)
        box = spec.controller
        if found is not None and all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
            status, clash = Status.INFEASIBLE, _unmet(found)
            message = "the spec fixes kp, ki and alpha, and they do not meet it"
    if status is Status.SOLVED and certificate is not None and certificate.verdict is not Verdict.PROVED:
        status, message = Status.FAILED, _unproved(certificate)
    results = found.requirements if found else (None,) * len(spec.requirements)
    proofs = certificate.requirements if certificate else (None,) * len(spec.requirements)
    reports = tuple(
        RequirementReport(requirement, result, multiplier, proved)
        for requirement, result, multiplier, proved in zip(
            spec.requirements, results, candidate.multipliers, proofs, strict=True
        )
    )
    return Design(
        spec=spec,
        status=status,
        gains=candidate.gains,
        objective=found.objective if found else None,
        requirements=reports,
        stability=found.stability if found else None,
        nominal=found.nominal if found else None,
        certificate=certificate,
        proof_wanted=proof,
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


def _unproved(certificate: Certificate) -> str:
    """What kept the gains from being called solved."""
    parts = []
    if certificate.stability.verdict is not Verdict.PROVED:
        parts.append(f"stability is {certificate.stability.verdict.value}: {certificate.stability.reason}")
    for proof in certificate.requirements:
        if proof.verdict is not Verdict.PROVED:
            parts.append(f"{proof.requirement.quantity} is {proof.verdict.value}: {proof.reason}")
    return "the gains pass the check in floating point, but the proof is missing: " + "; ".join(parts)


__all__ = ["Check", "Design", "Discretized", "discretize", "prove", "recheck", "tune"]
