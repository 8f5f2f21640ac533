"""Check a certificate without searching:  every claim is rebuilt, and every box of its record is tested again.

Only the gains, the plants, the requirements, and the levels with their records are read from the file.  Everything else
is derived from them again and compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from flint import ctx

from fopi_tune.errors import CertificateError
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.proof.certificate import Certificate, Record, RequirementProof, SideProof, Verdict, relaxed_limit
from fopi_tune.proof.claims.branch_and_bound import check_record
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.poles import count_unstable_poles, is_structurally_unstable
from fopi_tune.proof.documents import digest, from_document, to_document
from fopi_tune.proof.obligations import (
    CROSSING_QUANTITIES,
    level_claims,
    no_crossover_claims,
    stability_claims,
    violation_claims,
)
from fopi_tune.spec.model import DesignSpec, Requirement, Scope


@dataclass(frozen=True)
class Recheck:
    """Result of checking a certificate.

    Args:
        certificate: as read.
        problems: errors found, each with its place; empty when the certificate is sound.
        boxes: number of boxes tested.
    """

    certificate: Certificate
    problems: tuple[str, ...]
    boxes: int

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
    if spec is not None:
        problems += _spec_mismatches(certificate, spec)
    with ctx.workprec(PRECISION):
        problems += _stability(certificate)
        for index, proof in enumerate(certificate.requirements):
            problems += [f"requirements[{index}]: {problem}" for problem in _requirement(certificate, proof)]
    return Recheck(certificate, tuple(problems), _boxes(certificate))


def _integrity(certificate: Certificate, document: dict[str, Any]) -> list[str]:
    """Check the digest, and that every entry follows from the levels and records."""
    problems: list[str] = []
    if document.get("digest") != digest(document):
        problems.append("the content does not have the digest that it states: it was changed after it was made")
    again = to_document(certificate)
    problems += [f"{key[:40]!r} is no entry of a certificate" for key in document if key not in again]
    for key in again:
        if key == "digest":
            continue
        difference = _difference(document.get(key), again.get(key), key)
        if difference is not None:
            problems.append(f"{difference} does not follow from the rest of the certificate")
    return problems


def _difference(stated: object, derived: object, place: str) -> str | None:
    """Path of the first difference of two documents beyond rounding; None when they agree."""
    if isinstance(stated, dict) and isinstance(derived, dict):
        for key in stated.keys() | derived.keys():
            if key not in stated or key not in derived:
                return f"{place}.{key}"
            if (found := _difference(stated[key], derived[key], f"{place}.{key}")) is not None:
                return found
        return None
    if isinstance(stated, list) and isinstance(derived, list):
        if len(stated) != len(derived):
            return place
        pairs = zip(stated, derived, strict=True)
        return next((d for k, (a, b) in enumerate(pairs) if (d := _difference(a, b, f"{place}[{k}]"))), None)
    if isinstance(stated, bool) or isinstance(derived, bool):
        return None if stated is derived else place
    if isinstance(stated, int | float) and isinstance(derived, int | float):
        return None if math.isclose(stated, derived, rel_tol=1e-12, abs_tol=1e-300) else place
    return None if stated == derived else place


def _spec_mismatches(certificate: Certificate, spec: DesignSpec) -> list[str]:
    """Differences between the certificate's plant and requirements and the spec's."""
    problems = []
    case = certificate.case
    if (certificate.name, certificate.spec_sha256) != (spec.name, spec.sha256):
        problems.append("the name or the digest of the spec's file is another")
    if case.family.model != spec.plant.model or dict(case.family.parameters) != dict(spec.plant.parameters):
        problems.append("the plants are not those of the spec")
    stated = [_meaning(proof.requirement) for proof in certificate.requirements]
    if stated != [_meaning(requirement) for requirement in spec.requirements]:
        problems.append("the requirements are not those of the spec")
    return problems


def _meaning(requirement: Requirement) -> tuple[object, ...]:
    r = requirement
    return r.quantity, r.relation, r.limits, r.scope, r.from_rad_s, r.to_rad_s


def _stability(certificate: Certificate) -> list[str]:
    proof, case = certificate.stability, certificate.case
    if proof.verdict is Verdict.UNDECIDED and (proof.level is not None or proof.records):
        return ["stability: a bound of |S| is stated beside a verdict that has none"]
    poles = count_unstable_poles(case.loop, proof.point, case.origin)
    if poles != proof.poles:
        return [f"stability: the plant stated has {poles} unstable poles"]
    if proof.verdict is Verdict.UNDECIDED:
        return [] if not poles else ["stability: the plant stated refutes it"]
    if proof.verdict is Verdict.REFUTED:
        structural = poles is None and is_structurally_unstable(case.loop, proof.point)
        return [] if poles or structural else ["stability: the plant stated does not refute it"]
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
    case, point, omega = certificate.case, side.worst.point, side.worst.omega_rad_s
    limit = relaxed_limit(requirement, side.upper, certificate.tolerance)
    problems: list[str] = []
    if requirement.scope is Scope.NOMINAL and point != case.nominal:
        return ["the plant stated is not the nominal one"]
    if side.verdict is Verdict.PROVED and (side.level is None or _is_beyond(side, side.level, limit)):
        return ["the level that is stated does not meet the limit"]
    if side.level is not None and (side.records or side.verdict is Verdict.PROVED):
        problems += _records(level_claims(case, requirement, side.upper, side.level), side.records)
    if side.verdict is Verdict.REFUTED:
        if side.witness is None:
            if requirement.quantity not in CROSSING_QUANTITIES:
                return [*problems, "no witness is stated"]
            return problems + _records(no_crossover_claims(case, point), side.witness_records)
        if not _is_beyond(side, side.witness, limit):
            return [*problems, "the witness does not break the limit"]
    if side.witness is not None:
        problems += _records(
            violation_claims(case, requirement, side.upper, side.witness, point, omega), side.witness_records
        )
    return problems


def _is_beyond(side: SideProof, value: float, limit: float) -> bool:
    return value > limit if side.upper else value < limit


def _records(claims: list[Claim], records: tuple[Record, ...]) -> list[str]:
    """Errors in the records of these claims."""
    if not claims or len(claims) != len(records):
        return [f"{len(records)} records are stated where {len(claims)} claims have to be shown"]
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
    return sum(len(record.tokens) for record in every)


__all__ = ["CertificateError", "Recheck", "recheck"]
