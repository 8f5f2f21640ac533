"""Check a certificate without searching:  every claim is rebuilt, and every box of its record is tested again.

Only the gains, the plants, the requirements, and the levels with their places and records are read from the file.
Everything else is derived from them again and compared.  `undecided` is accepted where the file decides nothing: where
no record, and not the plant and the frequency that are named, show the opposite.  `versions` is not tested: it says
what made the file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from flint import ctx

from fopi_tune.core.controller import derivative_of
from fopi_tune.core.families.plant_list import PlantList, members_of
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import CertificateError
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.proof.certificate import Certificate, Record, RequirementProof, SideProof, Verdict, relaxed_limit
from fopi_tune.proof.claims.branch_and_bound import check_record
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.poles import count_unstable_poles
from fopi_tune.proof.documents import PLANTS, digest, from_document, to_document
from fopi_tune.proof.obligations import (
    is_unstable,
    level_claims,
    no_crossover_claims,
    stability_claims,
    violation_claims,
)
from fopi_tune.proof.output_limits import limits_mismatches, limits_problems
from fopi_tune.proof.places import place_problem, reaches
from fopi_tune.proof.plant_entries import same_plants
from fopi_tune.proof.scenario_proofs import mismatches, scenario_problems
from fopi_tune.proof.strict_json import first_difference
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.default_objective import with_default_objective
from fopi_tune.spec.lists.members import member_specs
from fopi_tune.spec.model import DesignSpec, Objective, Requirement, Scope, Sense

#: natural units; an undecided side's place may be this much beyond the limit: a proof of less may have failed
_CLEARLY = 1e-3
_OTHER_PLANTS = "the plants are not those of the spec"
_OTHER_REQUIREMENTS = "the requirements are not those of the spec"


@dataclass(frozen=True)
class Recheck:
    """Result of checking a certificate.

    Args:
        certificate: as read.
        problems: errors found, each with its place; empty when the certificate is sound.
        boxes: number of boxes tested.
        notes: what is not confirmed and need not be for the statements to be true.
    """

    certificate: Certificate
    problems: tuple[str, ...]
    boxes: int
    notes: tuple[str, ...] = ()

    @property
    def is_sound(self) -> bool:
        """Whether every statement of the certificate was confirmed."""
        return not self.problems


def recheck(document: object, spec: DesignSpec | None = None) -> Recheck:
    """Check a certificate's JSON.

    Args:
        document: as `json.load` gives it.
        spec: if given, the certificate must belong to this spec's plant and requirements.

    Raises:
        CertificateError: not a certificate, or an entry has the wrong type.
    """
    try:
        certificate = from_document(document)
        assert isinstance(document, dict)
        problems = _integrity(certificate, document)
    except (OverflowError, RecursionError) as error:
        raise CertificateError("a number or the nesting is beyond what a certificate of this tool holds") from error
    if certificate.members:
        return _recheck_list(certificate, document, spec, problems)
    if spec is not None and isinstance(spec.plant, PlantList):
        return Recheck(certificate, (*problems, _OTHER_PLANTS), 0)
    if spec is not None:
        problems += _spec_mismatches(certificate, spec)
    with ctx.workprec(PRECISION):
        problems += _stability(certificate)
        for index, proof in enumerate(certificate.requirements):
            problems += [f"requirements[{index}]: {problem}" for problem in _requirement(certificate, proof)]
    problems += _beyond_the_models(certificate)
    problems += scenario_problems(certificate.scenarios, certificate.tolerance) + limits_problems(certificate.limited)
    return Recheck(certificate, tuple(problems), _boxes(certificate))


def _recheck_list(
    certificate: Certificate, document: dict[str, Any], spec: DesignSpec | None, problems: list[str]
) -> Recheck:
    """Check the certificate of every member of a list, against that member's part of the spec.

    What is said of all of them was derived again from what is said of each (`_integrity`).
    """
    specs: Sequence[DesignSpec | None] = [None] * len(certificate.members)
    if spec is not None:
        named = [member.name for member in members_of(spec.plant)]
        if [member.name for member in certificate.members] != named:
            return Recheck(certificate, (*problems, _OTHER_PLANTS), 0)
        specs = _member_specs(certificate, spec)
        if not specs:
            return Recheck(certificate, (*problems, _OTHER_REQUIREMENTS), 0)
    boxes = 0
    for k, (member, own) in enumerate(zip(certificate.members, specs, strict=True)):
        found = recheck(document["plants"][k]["certificate"], own)
        boxes += found.boxes
        problems += [f"plants[{k}] ({member.name[:40]}): {problem}" for problem in found.problems]
    return Recheck(certificate, tuple(problems), boxes)


def _member_specs(certificate: Certificate, spec: DesignSpec) -> tuple[DesignSpec, ...]:
    """The members' specs with the requirements that the certificate states; none where these are others."""
    stated = [_meaning(proof.requirement) for proof in certificate.requirements]
    for each in (spec, with_default_objective(spec)):
        if [_meaning(r) for r in each.requirements] == stated:
            # with an objective nothing more is added to a member's requirements
            objective = each.objective or Objective(Sense.MAXIMIZE, "ki")
            return member_specs(replace(each, objective=objective))
    return ()


def _integrity(certificate: Certificate, document: dict[str, Any]) -> list[str]:
    """Check the digest, and that every entry follows from the levels and records."""
    problems: list[str] = []
    if document.get("digest") != digest(document):
        problems.append("the content does not have the digest that it states: it was changed after it was made")
    again = to_document(certificate)
    problems += [f"{key[:40]!r} is no entry of a certificate" for key in document if key not in again]
    for key in again:
        # the members' certificates are tested on their own
        if key == "digest" or (key == PLANTS and certificate.members):
            continue
        difference = first_difference(document.get(key), again.get(key), key)
        if difference is not None:
            problems.append(f"{difference} does not follow from the rest of the certificate")
    return problems


def _beyond_the_models(certificate: Certificate) -> list[str]:
    """Parts that are stated of a controller with a derivative or a filter, and whose proofs have no model of it."""
    gains = certificate.case.gains
    if derivative_of(gains).kd == 0.0 and gains.measurement_filter is None:
        return []
    what = "a measurement filter" if derivative_of(gains).kd == 0.0 else "a derivative"
    limited = certificate.limited is not None and certificate.limited.proof is not None
    parts = {"scenarios": any(each.case.acts_on_error for each in certificate.scenarios), "with_limits": limited}
    return [f"{name}: nothing is shown of a controller with {what}" for name, stated in parts.items() if stated]


def _spec_mismatches(certificate: Certificate, spec: DesignSpec) -> list[str]:
    """Differences between the certificate's plant and requirements and the spec's."""
    problems = []
    case = certificate.case
    if (certificate.name, certificate.spec_sha256) != (spec.name, spec.text_sha256):
        problems.append("the name or the digest of the spec's file is another")
    if not same_plants(case.family, spec.plant):
        problems.append(_OTHER_PLANTS)
    if not spec.controller.has_structure_of(case.gains):
        of_filter = case.gains.measurement_filter != spec.controller.measurement_filter
        what = "the controller's measurement_filter is not that of the spec"
        problems.append(what if of_filter else "the controller is not of the structure that the spec asks for")
    stated = [_meaning(proof.requirement) for proof in certificate.requirements]
    # a design of a spec without an objective may have a limit of |S| added to it
    asked = [[_meaning(r) for r in each.requirements] for each in (spec, with_default_objective(spec))]
    if stated not in asked:
        problems.append(_OTHER_REQUIREMENTS)
    problems += mismatches(certificate.scenarios, spec, case.implementation)
    problems += limits_mismatches(certificate.limited, spec)
    if spec.sampled_design is not None and case.implementation is None:
        problems.append("the spec is about the loop on samples (design: sampled), the certificate is not")
    return problems


def _meaning(requirement: Requirement) -> tuple[object, ...]:
    r = requirement
    return r.quantity, r.relation, r.limits, r.scope, r.from_rad_s, r.to_rad_s, r.end_limit


def _stability(certificate: Certificate) -> list[str]:
    proof, case = certificate.stability, certificate.case
    if proof.verdict is not Verdict.PROVED and (proof.level is not None or proof.records):
        return ["stability: a bound of |S| is stated beside a verdict that has none"]
    if proof.verdict is not Verdict.REFUTED and proof.point != case.nominal:
        return ["stability: the plant stated is not the nominal one"]
    poles = count_unstable_poles(case.loop, proof.point, case.origin)
    if poles != proof.poles:
        return [f"stability: the plant stated has {poles} unstable poles"]
    refuted = is_unstable(case, proof.point)
    if proof.verdict is Verdict.UNDECIDED:
        return ["stability: the plant stated refutes it"] if refuted else []
    if proof.verdict is Verdict.REFUTED:
        return [] if refuted else ["stability: the plant stated does not refute it"]
    if poles != 0:
        return ["stability: the plant stated is not stable"]
    if proof.level is None:
        return ["stability: no bound of |S| is stated"]
    claims = stability_claims(case, proof.level)
    return [f"stability: {problem}" for problem in _records(claims, proof.records)]


def _requirement(certificate: Certificate, proof: RequirementProof) -> list[str]:
    requirement = proof.requirement
    expected = [upper for upper in (False, True) if _has_side(requirement, upper)]
    if [side.upper for side in proof.sides] != expected:
        return ["its sides are not those of its relation"]
    problems: list[str] = []
    for side in proof.sides:
        problems += [f"{'at_most' if side.upper else 'at_least'}: {p}" for p in _side(certificate, requirement, side)]
    return problems


def _has_side(requirement: Requirement, upper: bool) -> bool:
    return math.isfinite(requirement.upper if upper else requirement.lower)


def _side(certificate: Certificate, requirement: Requirement, side: SideProof) -> list[str]:
    case, point = certificate.case, side.worst.point
    if requirement.scope is Scope.NOMINAL and point != case.nominal:
        return ["the plant stated is not the nominal one"]
    contradiction = _contradiction(requirement, side, relaxed_limit(requirement, side.upper, certificate.tolerance))
    if contradiction is not None:
        return [contradiction]
    problems: list[str] = []
    is_margin = QUANTITIES[requirement.quantity].is_margin
    if is_margin and side.level is not None and not _is_stable(certificate, requirement.scope):
        problems.append("a bound of a margin is stated of a loop that is not shown to be stable")
    if side.level is not None:
        problems += _records(level_claims(case, requirement, side.upper, side.level), side.records)
    if side.witness is not None:
        claims = violation_claims(case, requirement, side.upper, side.witness, point, side.worst.omega_rad_s)
        problems += _records(claims, side.witness_records)
    elif side.verdict is Verdict.REFUTED and is_margin:
        if side.witness_records or not is_unstable(case, point):
            problems.append("the plant stated is not shown to be unstable, so that it has a margin")
    elif side.verdict is Verdict.REFUTED:
        problems += _records(no_crossover_claims(case, point), side.witness_records)
    elif side.verdict is Verdict.UNDECIDED and is_margin and is_unstable(case, point):
        problems.append("undecided is stated, but the plant stated is unstable, so that it has no margin")
    elif side.verdict is Verdict.UNDECIDED and _breaks_the_limit(certificate, requirement, side):
        problems.append("undecided is stated, but the plant and the frequency stated break the limit")
    if problems:
        return problems
    place = place_problem(case, requirement, side, certificate.tolerance)
    return [] if place is None else [place]


def _is_stable(certificate: Certificate, scope: Scope) -> bool:
    """Whether the loops in a scope are stable; of the family, by the certificate's own proof, which is tested too."""
    case = certificate.case
    if certificate.stability.verdict is Verdict.PROVED:
        return True
    return scope is Scope.NOMINAL and count_unstable_poles(case.loop, case.nominal, case.origin) == 0


def _contradiction(requirement: Requirement, side: SideProof, limit: float) -> str | None:
    """What a side's verdict, level and witness say against each other; their records are tested afterwards."""
    verdict, level, witness = side.verdict, side.level, side.witness
    if level is None and side.records:
        return "records are stated without the level that they show"
    if verdict is Verdict.PROVED and (level is None or _is_beyond(side, level, limit)):
        return "the level that is stated does not meet the limit"
    if verdict is Verdict.REFUTED and witness is None and QUANTITIES[requirement.quantity].takes_band:
        return "no witness is stated"
    if verdict is Verdict.REFUTED and witness is not None and not _is_beyond(side, witness, limit):
        return "the witness does not break the limit"
    if verdict is not Verdict.REFUTED and witness is None and side.witness_records:
        return "records are stated without the witness that they show"
    if verdict is not Verdict.PROVED and level is not None and not _is_beyond(side, level, limit):
        return f"{verdict.value} is stated, but the level that is stated meets the limit"
    if verdict is not Verdict.REFUTED and witness is not None and _is_beyond(side, witness, limit):
        return f"{verdict.value} is stated, but the witness breaks the limit"
    return None


def _breaks_the_limit(certificate: Certificate, requirement: Requirement, side: SideProof) -> bool:
    """Whether the response of the plant stated is shown to be clearly beyond the limit at the frequency stated."""
    room = _CLEARLY if side.upper else -_CLEARLY
    if not QUANTITIES[requirement.quantity].takes_band:
        return False
    level = relaxed_limit(requirement, side.upper, certificate.tolerance) + room
    return reaches(certificate.case, requirement, side, level)


def _is_beyond(side: SideProof, value: float, limit: float) -> bool:
    return value > limit if side.upper else value < limit


def _records(claims: list[Claim], records: tuple[Record, ...]) -> list[str]:
    """Errors in the records of these claims."""
    if not claims or len(claims) != len(records):
        return [f"{counted(len(claims), 'claim')} must be shown, and records are stated of {len(records)}"]
    problems = []
    for claim, record in zip(claims, records, strict=True):
        problem = check_record(claim, record.tokens)
        if problem is not None:
            problems.append(f"{claim.to_dict()['kind']}: {problem}")
    return problems


def _boxes(certificate: Certificate) -> int:
    every = list(certificate.stability.records)
    for proof in certificate.requirements:
        for side in proof.sides:
            every += [*side.records, *side.witness_records]
    return sum(len(record.tokens) for record in every) + sum(len(each.proof.boxes) for each in certificate.scenarios)


__all__ = ["CertificateError", "Recheck", "recheck"]
