"""From a checked candidate to a Design:  the status and message that search, verification and certificate amount to."""

from __future__ import annotations

import math

from fopi_tune.core.controller import FoPi
from fopi_tune.core.steady_state import largest_steady_state_error
from fopi_tune.proof import Certificate, Verdict, Verification
from fopi_tune.results.candidate import CheckedCandidate, Solver, Violation
from fopi_tune.results.design import Design, RequirementReport
from fopi_tune.results.stamp import stamp
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.model import DesignSpec


def assemble_design(spec: DesignSpec, checked: CheckedCandidate, proof: bool, solver: Solver = Solver.IPOPT) -> Design:
    """The design of a checked candidate: `solved` only if every requirement is verified, and proved where wanted."""
    candidate, found, certificate = checked.candidate, checked.verification, checked.certificate
    status, message, clash = candidate.status, candidate.message, candidate.clash
    if status is Status.SOLVED and (found is None or not found.all_met):
        status, message = Status.FAILED, _refuted_message(found)
        box = spec.controller
        if found is not None and all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
            status, clash = Status.INFEASIBLE, _missed_limits(found)
            message = f"the spec fixes kp, ki and alpha, and {_fixed_gains_problem(found)}"
    if status is Status.SOLVED and certificate is not None and certificate.verdict is not Verdict.PROVED:
        status, message = Status.FAILED, _unproved_message(certificate)
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
        stamp=stamp(spec.sha256, solver.value, digests_of(spec)),
        solves=candidate.solves,
        steady_state_error=_steady_state_error(spec, candidate.gains, found),
    )


def _steady_state_error(spec: DesignSpec, gains: FoPi | None, found: Verification | None) -> float | None:
    """Of a stable design; None without one."""
    if gains is None or found is None or not found.stability.stable:
        return None
    return largest_steady_state_error(spec.plant, gains)


def new_violations(checked: CheckedCandidate, known: tuple[Violation, ...]) -> tuple[Violation, ...]:
    """Where verification or certificate refute a candidate that the search found to be right; without known ones."""
    if checked.candidate.status is not Status.SOLVED or checked.verification is None:
        return ()
    places = [(i, result.worst) for i, result in enumerate(checked.verification.requirements) if not result.is_met]
    if checked.certificate is not None:
        places += [
            (i, side.worst)
            for i, proved in enumerate(checked.certificate.requirements)
            for side in proved.sides
            if side.verdict is Verdict.REFUTED
        ]
    violations = (
        Violation(i, place.point, place.omega_rad_s if place.omega_rad_s is not None else math.nan)
        for i, place in places
    )
    return tuple(v for v in violations if v not in known)


def _missed_limits(found: Verification) -> tuple[Relaxation, ...]:
    """The requirements that fixed gains miss, with the limits they would meet; none if the loop is unstable."""
    if not found.stability.stable:
        return ()
    relaxations = []
    for i, result in enumerate(found.requirements):
        if result.is_met:
            continue
        value = result.achieved
        amount = None
        if value is not None and math.isfinite(value):
            amount = min(abs(value - limit) for limit in result.requirement.limits)
        relaxations.append(Relaxation(i, amount, value if amount is not None else None))
    return tuple(relaxations)


def _fixed_gains_problem(found: Verification) -> str:
    """Why fixed gains do not meet the spec."""
    if not found.stability.stable:
        return f"these gains leave an unstable loop, whatever the limits are: {found.stability.reason}"
    missed = sum(not result.is_met for result in found.requirements)
    return "they do not meet it" if missed == 1 else f"they miss {missed} requirements at once"


def _refuted_message(found: Verification | None) -> str:
    """Why the verification refutes what the search found."""
    if found is None:
        return "the best gains found are kp = ki = 0: switched off; add a requirement that needs a controller"
    if not found.stability.stable:
        return f"the check refuted the best gains found: {found.stability.reason}"
    names = ", ".join(r.requirement.quantity for r in found.requirements if not r.is_met)
    return f"the check refuted the best gains found: {names}"


def _unproved_message(certificate: Certificate) -> str:
    """What the certificate leaves unproved."""
    parts = []
    if certificate.stability.verdict is not Verdict.PROVED:
        parts.append(f"stability is {certificate.stability.verdict.value}: {certificate.stability.explanation}")
    for proof in certificate.requirements:
        if proof.verdict is not Verdict.PROVED:
            parts.append(f"{proof.requirement.quantity} is {proof.verdict.value}: {proof.explanation}")
    return "the gains pass the check in floating point, but the proof is missing: " + "; ".join(parts)
