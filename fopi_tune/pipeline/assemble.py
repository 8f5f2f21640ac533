"""From a checked candidate to a Design:  the status and message that search, verification and certificate amount to."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.families.plant_list import named_place
from fopi_tune.core.stability import largest_steady_state_error
from fopi_tune.proof import Certificate, Place, Verdict, Verification
from fopi_tune.proof.verification.results import MeasureResult
from fopi_tune.quantities import QUANTITIES
from fopi_tune.results.candidate import CheckedCandidate, Solver, Violation
from fopi_tune.results.design import Design
from fopi_tune.results.measures import measure_reports
from fopi_tune.results.requirement_reports import RequirementReport
from fopi_tune.results.stamp import CONVEX_STEPS, stamp
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.model import DesignSpec, Requirement


def assemble_design(
    spec: DesignSpec,
    checked: CheckedCandidate,
    proof: bool,
    solver: Solver = Solver.IPOPT,
    refuted: CheckedCandidate | None = None,
) -> Design:
    """The design of a checked candidate: `solved` only if every requirement is verified, and proved where wanted.

    Args:
        spec: that was designed.
        checked: the last candidate.
        proof: whether a certificate was wanted.
        solver: which search found it.
        refuted: the one before it, which verification or certificate refuted.
    """
    candidate, found, certificate = checked.candidate, checked.verification, checked.certificate
    status, message, clash = candidate.status, candidate.message, candidate.clash
    if status is Status.SOLVED and (found is None or not found.all_met):
        status, message = Status.FAILED, _refuted_message(found)
        if found is not None and spec.controller.fixed is not None:
            status, clash = Status.INFEASIBLE, _missed_limits(found)
            message = f"the spec fixes {spec.controller.names}, and {_fixed_gains_problem(found)}"
    if status is Status.SOLVED and certificate is not None and certificate.verdict is not Verdict.PROVED:
        status, message = Status.FAILED, _unproved_message(spec, certificate)
    if candidate.status is not Status.SOLVED and refuted is not None:
        message = f"{message}; {_objection(spec, refuted)}, and with that known the search found no others"
    results = found.requirements if found else (None,) * len(spec.requirements)
    proofs = certificate.requirements if certificate else (None,) * len(spec.requirements)
    reports = tuple(
        RequirementReport(requirement, result, multiplier, proved, is_checked=spec.is_measured)
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
        stamp=stamp(spec.text_sha256, CONVEX_STEPS if spec.designs_scenarios else solver.value, digests_of(spec)),
        solves=candidate.solves,
        steady_state_error=_steady_state_error(spec, candidate.gains, found),
        gap=candidate.gap if status is Status.SOLVED else None,
        measures=measure_reports(
            spec.scenario_requirements,
            found.measures if found else (),
            candidate.scenario_multipliers,
            checked.drawn,
            certificate,
        ),
    )


def _steady_state_error(spec: DesignSpec, gains: FoPi | None, found: Verification | None) -> float | None:
    """Of a stable design; None without one, and of measured responses, which do not tell P(0)."""
    if spec.is_measured or gains is None or found is None or not found.stability.stable:
        return None
    return largest_steady_state_error(spec.plant, gains)


def new_violations(checked: CheckedCandidate, known: tuple[Violation, ...]) -> tuple[Violation, ...]:
    """Where verification or certificate refute a candidate that the search found to be right; without known ones."""
    found, certificate = checked.verification, checked.certificate
    if checked.candidate.status is not Status.SOLVED or found is None:
        return ()
    violations = [] if found.stability.stable else [_violation(None, found.stability.worst)]
    violations += [_violation(i, result.worst) for i, result in enumerate(found.requirements) if not result.is_met]
    violations += [
        Violation(i, result.worst.point, math.nan, result.scenario)
        for i, result in enumerate(found.measures)
        if not result.is_met
    ]
    if certificate is not None:
        if certificate.stability.verdict is Verdict.REFUTED:
            violations.append(Violation(None, certificate.stability.point, math.nan))
        violations += [
            _violation(i, side.worst)
            for i, proved in enumerate(certificate.requirements)
            for side in proved.sides
            if side.verdict is Verdict.REFUTED
        ]
        violations += [
            Violation(each.index, each.proof.theta, math.nan, each.case.scenario.name)
            for each in certificate.scenarios
            if each.proof.verdict is Verdict.REFUTED and each.proof.theta is not None
        ]
    return tuple(v for v in dict.fromkeys(violations) if v not in known)


def _violation(requirement: int | None, place: Place) -> Violation:
    return Violation(requirement, place.point, math.nan if place.omega_rad_s is None else place.omega_rad_s)


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
    for i, measured in enumerate(found.measures, len(found.requirements)):
        if not measured.is_met:
            value = measured.achieved if math.isfinite(measured.achieved) else None
            amount = None if value is None else abs(value - measured.requirement.limit)
            relaxations.append(Relaxation(i, amount, value))
    return tuple(relaxations)


def _fixed_gains_problem(found: Verification) -> str:
    """Why fixed gains do not meet the spec."""
    if not found.stability.stable:
        return f"these gains leave an unstable loop, whatever the limits are: {found.stability.reason}"
    missed = sum(not result.is_met for result in (*found.requirements, *found.measures))
    return "they do not meet it" if missed == 1 else f"they miss {missed} requirements at once"


def _objection(spec: DesignSpec, refuted: CheckedCandidate) -> str:
    """Why a candidate is no design."""
    found, certificate = refuted.verification, refuted.certificate
    if certificate is None or found is None or not found.all_met:
        return _refuted_message(found)
    return _unproved_message(spec, certificate)


def _refuted_message(found: Verification | None) -> str:
    """Why the verification refutes what the search found, and with which plant."""
    if found is None:
        return "the best gains found are kp = ki = 0: switched off; add a requirement that needs a controller"
    if not found.stability.stable:
        where = _place_in_words(replace(found.stability.worst, omega_rad_s=None))
        return f"the check refuted the best gains found: {found.stability.reason}{where}"
    missed = [_missed_in_words(r.requirement, r.achieved, r.worst) for r in found.requirements if not r.is_met]
    missed += [_missed_measure(result) for result in found.measures if not result.is_met]
    return f"the check refuted the best gains found: {'; '.join(missed)}"


def _unproved_message(spec: DesignSpec, certificate: Certificate) -> str:
    """What the certificate leaves unproved, and what refutes it."""
    parts, stability = [], certificate.stability
    if stability.verdict is not Verdict.PROVED:
        where = ""
        if stability.verdict is Verdict.REFUTED:
            where = _place_in_words(_place_at(spec, stability.point))
        parts.append(f"stability is {stability.verdict.value}: {stability.explanation}{where}")
    for proof in certificate.requirements:
        refuted = [side for side in proof.sides if side.verdict is Verdict.REFUTED]
        if refuted:
            from_natural = QUANTITIES[proof.requirement.quantity].from_natural
            reached = [None if side.witness is None else from_natural(side.witness) for side in refuted]
            pairs = zip(refuted, reached, strict=True)
            counterexamples = (_missed_in_words(proof.requirement, value, side.worst) for side, value in pairs)
            parts.append(f"refuted: {'; '.join(counterexamples)}")
        elif proof.verdict is not Verdict.PROVED:
            parts.append(f"{proof.requirement.quantity} is {proof.verdict.value}: {proof.explanation}")
    for each in certificate.scenarios:
        limit, shown = each.case.limit, each.proof
        if shown.verdict is Verdict.REFUTED and shown.theta is not None:
            where = _place_in_words(_place_at(spec, shown.theta))
            asked = f"({limit.relation.value} {limit.limit:g})"
            parts.append(f"refuted: {limit.measure} is {shown.value:.9g} {asked} in {each.case.scenario.name}{where}")
    return "the gains pass the check in floating point, but the proof is missing: " + "; ".join(parts)


def _missed_in_words(requirement: Requirement, value: float | None, place: Place) -> str:
    """A counterexample: what is reached, what was asked, the frequency and the plant."""
    limits = " .. ".join(f"{limit:g}" for limit in requirement.every_limit)
    reached = "has no value" if value is None else f"is {value:.9g}"
    where = _place_in_words(place)
    return f"{requirement.quantity} {reached} ({requirement.relation.value} {limits}){where}"


def _missed_measure(result: MeasureResult) -> str:
    """A counterexample of a requirement on a scenario."""
    limit = result.requirement
    asked = f"({limit.relation.value} {limit.limit:g})"
    where = _place_in_words(replace(result.worst, omega_rad_s=None))
    return f"{limit.measure} is {result.achieved:.9g} {asked} in scenario {result.scenario}{where}"


def _place_at(spec: DesignSpec, point: tuple[float, ...]) -> Place:
    """A plant that no frequency belongs to."""
    found = np.array(point)
    return Place(None, spec.plant.describe(found), point, named_place(spec.plant, found))


def _place_in_words(place: Place) -> str:
    omega_rad_s = place.omega_rad_s
    if omega_rad_s is None:
        at = ""
    elif 0.0 < omega_rad_s < math.inf:
        at = f" at {omega_rad_s:.6g} rad/s"
    else:
        at = f" as omega tends to {'0' if omega_rad_s == 0.0 else 'infinity'}"
    numbers = ", ".join(f"{name} = {value:.9g}" for name, value in place.plant.items())
    member = f" for {place.member}" if place.member else ""
    return f"{at}{member}{f' with {numbers}' if numbers else ''}"
