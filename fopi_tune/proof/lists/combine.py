"""Certificates of the members of a list of plants -> one certificate about all of them.

A requirement holds for the list where it is proved for every member that it is about; its bound is the loosest of
theirs and its witness the worst.  One refuted member refutes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fopi_tune.proof.certificate import (
    Certificate,
    MemberCertificate,
    RequirementProof,
    SideProof,
    StabilityProof,
    Verdict,
    overall,
)
from fopi_tune.proof.output_limits import LimitedLoop
from fopi_tune.proof.verification.results import Place
from fopi_tune.spec.lists.members import requirements_of


def of_certificates(members: Sequence[MemberCertificate]) -> Certificate:
    """The certificate of a list.

    Args:
        members: in the order of the list; the first has every requirement, the others those over the family.
    """
    first = members[0].certificate
    requirements = [proof.requirement for proof in first.requirements]
    proofs = []
    for index, proof in enumerate(first.requirements):
        about = [k for k in range(len(members)) if index in requirements_of(requirements, k)]
        sides = [
            _placed(members, k, members[k].certificate.requirements[requirements_of(requirements, k).index(index)])
            for k in about
        ]
        combined = tuple(_side(together) for together in zip(*sides, strict=True))
        proofs.append(RequirementProof(proof.requirement, combined))
    return replace(
        first,
        stability=_stability(members),
        requirements=tuple(proofs),
        limited=_limited(members),
        members=tuple(members),
    )


def mismatched_members(members: Sequence[MemberCertificate]) -> str | None:
    """Why certificates are not about the members of one list with one controller; None where they are."""
    names, first = [member.name for member in members], members[0].certificate
    requirements = [proof.requirement for proof in first.requirements]
    if len(set(names)) < len(names):
        return "plants: two of them have the same name"
    for k, member in enumerate(members):
        own = member.certificate
        same = (
            (own.name, own.spec_sha256, own.tolerance) == (first.name, first.spec_sha256, first.tolerance)
            and own.case.gains == first.case.gains
            and own.case.implementation == first.case.implementation
        )
        if not same:
            return f"plants[{k}] is not of the spec, the gains and the tolerance of the first"
        asked = [requirements[i] for i in requirements_of(requirements, k)]
        if [proof.requirement for proof in own.requirements] != asked:
            return f"plants[{k}] has other requirements than the first has for all plants"
    return None


def place_of_member(members: Sequence[MemberCertificate], k: int, place: Place) -> Place:
    """A place of a member's box as one of the list."""
    return replace(place, point=(float(k), *place.point), member=members[k].name)


def _placed(members: Sequence[MemberCertificate], k: int, proof: RequirementProof) -> list[SideProof]:
    return [replace(side, worst=place_of_member(members, k, side.worst)) for side in proof.sides]


def _side(sides: Sequence[SideProof]) -> SideProof:
    """One side of a requirement from those of its members."""
    verdict = overall(tuple(side.verdict for side in sides))
    upper = sides[0].upper
    sign = 1.0 if upper else -1.0
    levels = [side.level for side in sides if side.level is not None]
    level = max(levels, key=lambda value: sign * value) if len(levels) == len(sides) else None
    deciding = [side for side in sides if side.verdict is verdict]
    # a member without a value, then the worst one that is shown, then any
    shown = [side for side in deciding if side.witness is not None]
    missing = [side for side in deciding if side.witness is None]
    worst = max(shown, key=lambda side: sign * (side.witness or 0.0)) if shown else deciding[0]
    if verdict is Verdict.REFUTED:
        worst, level = (missing[0] if missing else worst), None
    return replace(
        worst,
        verdict=verdict,
        level=level,
        records=() if level is None else tuple(record for side in sides for record in side.records),
        budget_spent=any(side.budget_spent for side in sides),
    )


def _stability(members: Sequence[MemberCertificate]) -> StabilityProof:
    """Of the first member that is refuted, or undecided; of a stable list with the largest bound of |S|."""
    proofs = [member.certificate.stability for member in members]
    verdict = overall(tuple(proof.verdict for proof in proofs))
    decides = next(k for k, proof in enumerate(proofs) if proof.verdict is verdict)
    found = proofs[decides]
    levels = [proof.level for proof in proofs if proof.level is not None]
    proved = verdict is Verdict.PROVED
    return replace(
        found,
        level=max(levels) if proved and levels else None,
        point=(float(decides), *found.point),
        records=tuple(record for proof in proofs for record in proof.records) if proved else (),
        budget_spent=any(proof.budget_spent for proof in proofs),
        member=members[decides].name,
    )


def _limited(members: Sequence[MemberCertificate]) -> LimitedLoop | None:
    """Of the loops with the limits of their control one without a proof, else the slowest; None without limits."""
    found = [member.certificate.limited for member in members]
    known = [each for each in found if each is not None]
    if not known:
        return None
    open_ones = [each for each in known if each.proof is None]
    return open_ones[0] if open_ones else max(known, key=lambda each: each.half_life_s or 0.0)
