"""From attempts to a Design:  what a candidate, its verification and its certificate together amount to."""

from __future__ import annotations

import math

from fopi_tune.proof import Certificate, Verdict, Verification
from fopi_tune.results.candidate import Attempt, Solver, Violation
from fopi_tune.results.design import Design, RequirementReport
from fopi_tune.results.stamp import stamp
from fopi_tune.results.status import Give, Status
from fopi_tune.spec.model import DesignSpec


def refutations(attempt: Attempt, known: tuple[Violation, ...]) -> tuple[Violation, ...]:
    """Where a candidate that the search took for right was found wrong, beyond what is known already."""
    if attempt.candidate.status is not Status.SOLVED or attempt.found is None:
        return ()
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


def assembled(spec: DesignSpec, attempt: Attempt, proof: bool, solver: Solver = Solver.IPOPT) -> Design:
    """The design that an attempt amounts to: `solved` only with a verification that is met and a proof, if wanted."""
    candidate, found, certificate = attempt.candidate, attempt.found, attempt.certificate
    status, message, clash = candidate.status, candidate.message, candidate.clash
    if status is Status.SOLVED and (found is None or not found.all_met):
        status, message = Status.FAILED, _refusal(found)
        box = spec.controller
        if found is not None and all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
            status, clash = Status.INFEASIBLE, _unmet(found)
            message = f"the spec fixes kp, ki and alpha, and {_missed(found)}"
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
        stamp=stamp(spec.sha256, solver.value),
        solves=candidate.solves,
    )


def _unmet(found: Verification) -> tuple[Give, ...]:
    """The requirements that fixed gains miss, and how far each is missed; none where no limit is to blame."""
    if not found.stability.stable:
        return ()
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


def _missed(found: Verification) -> str:
    """What is wrong with fixed gains."""
    if not found.stability.stable:
        return f"these gains leave an unstable loop, whatever the limits are: {found.stability.reason}"
    missed = sum(not result.is_met for result in found.requirements)
    return "they do not meet it" if missed == 1 else f"they miss {missed} requirements at once"


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
