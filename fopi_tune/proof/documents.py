"""Certificates as JSON:  Certificate <-> dictionary, with a digest of the content.

Reading checks types and ranges only; `fopi_tune.proof.recheck` checks whether the statements are true.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fopi_tune.core.controller import numbers_of
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.balls.box import ball_of
from fopi_tune.proof.certificate import (
    LARGEST_TOLERANCE,
    Certificate,
    MemberCertificate,
    Record,
    RequirementProof,
    SideProof,
    StabilityProof,
    Verdict,
)
from fopi_tune.proof.lists.combine import mismatched_members, of_certificates
from fopi_tune.proof.obligations import Case
from fopi_tune.proof.output_limits import limits_entry, read_limits
from fopi_tune.proof.plant_entries import plant_entry, read_family
from fopi_tune.proof.scenario_proofs import read_scenario_proofs, scenario_entries
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.proof.verification.results import Place
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Relation, Requirement, Scope

#: version of the file; it may only grow
CERTIFICATE_SCHEMA = 2
#: of the files before it: another meaning of the margins
_UNWRAPPED_SCHEMA = 1
KIND = "fopi_tune certificate"
#: the entry of a list of plants
PLANTS = "plants"
#: of a digital controller; the cost of its polynomials grows with the third power
_MOST_SECTIONS = 200


def to_document(certificate: Certificate) -> dict[str, Any]:
    """The certificate's JSON; of a list of plants those of its members, and in short what they say together."""
    document: dict[str, Any] = {
        "schema": CERTIFICATE_SCHEMA,
        "kind": KIND,
        "name": certificate.name,
        "verdict": certificate.verdict.value,
        "spec_sha256": certificate.spec_sha256,
        "tolerance": certificate.tolerance,
        "gains": numbers_of(certificate.case.gains),
        **(_said_of_list(certificate) if certificate.members else _said_of_family(certificate)),
        "versions": dict(certificate.versions),
    }
    return {**document, "digest": digest(document)}


def _said_of_family(certificate: Certificate) -> dict[str, Any]:
    case = certificate.case
    return {
        "plant": plant_entry(case.family),
        "origin_log_rad_s": case.origin,
        **_implementation_entry(case),
        "stability": _stability(certificate.stability, case),
        "requirements": [_requirement(proof, case) for proof in certificate.requirements],
        **({"scenarios": scenario_entries(certificate.scenarios)} if certificate.scenarios else {}),
        **({"with_limits": limits_entry(certificate.limited)} if certificate.limited else {}),
    }


def _said_of_list(certificate: Certificate) -> dict[str, Any]:
    first, decides = certificate.case, int(certificate.stability.point[0])
    own = replace(certificate.stability, point=certificate.stability.point[1:])
    stability = _stability(own, certificate.members[decides].certificate.case)
    requirements = [_requirement(proof, first) for proof in certificate.requirements]
    for entry, proof in zip(requirements, certificate.requirements, strict=True):
        sides = zip(entry["sides"], proof.sides, strict=True)
        entry["sides"] = [{**_without_records(side), "member": said.worst.member} for side, said in sides]
    return {
        **_implementation_entry(first),
        "stability": {**_without_records(stability), "point": list(certificate.stability.point), "member": own.member},
        "requirements": requirements,
        PLANTS: [
            {"name": member.name, "certificate": to_document(member.certificate)} for member in certificate.members
        ],
    }


def _implementation_entry(case: Case) -> dict[str, Any]:
    return {"implementation": _implementation(case.implementation)} if case.implementation else {}


def _without_records(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry whose records are those of the members' certificates."""
    return {key: value for key, value in entry.items() if key not in ("records", "witness_records")}


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of everything but the digest itself, in one canonical form.

    Raises:
        CertificateError: a number is not finite, which JSON does not have.
    """
    content = {key: value for key, value in document.items() if key != "digest"}
    try:
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except ValueError:
        raise CertificateError("a number of the file is not finite: it is no JSON") from None
    return hashlib.sha256(text.encode()).hexdigest()


def _implementation(implementation: Implementation) -> dict[str, Any]:
    sections = implementation.sections
    return {
        "sample_time_s": sections.sample_time_s,
        "delay_samples": implementation.delay_samples,
        "direct": sections.direct,
        "poles": list(sections.poles),
        "residues": list(sections.residues),
    }


def _stability(proof: StabilityProof, case: Case) -> dict[str, Any]:
    return {
        "verdict": proof.verdict.value,
        "sensitivity_at_most_neper": proof.level,
        "plant": case.family.describe(np.array(proof.point, dtype=float)),
        "point": list(proof.point),
        "unstable_poles": proof.poles,
        "records": _records(proof.records),
        "reason": proof.reason,
    }


def _requirement(proof: RequirementProof, case: Case) -> dict[str, Any]:
    requirement = proof.requirement
    return {
        "name": requirement.quantity,
        "relation": requirement.relation.value,
        "limits": list(requirement.limits),
        **({} if requirement.end_limit is None else {"limit_at_to_rad_s": requirement.end_limit}),
        "on": requirement.scope.value,
        "from_rad_s": requirement.from_rad_s,
        "to_rad_s": _finite(requirement.to_rad_s),
        "verdict": proof.verdict.value,
        "proved_from": _finite(proof.bounds[0]),
        "proved_to": _finite(proof.bounds[1]),
        "relative_gap": proof.gap,
        "reason": proof.reason,
        "sides": [_side(side, requirement) for side in proof.sides],
    }


def _side(side: SideProof, requirement: Requirement) -> dict[str, Any]:
    from_natural = QUANTITIES[requirement.quantity].from_natural
    omega = side.worst.omega_rad_s
    return {
        "side": "at_most" if side.upper else "at_least",
        "verdict": side.verdict.value,
        "level_natural": side.level,
        "witness_natural": side.witness,
        "witness": None if side.witness is None else _finite(from_natural(side.witness)),
        "omega_rad_s": _finite(omega) if omega is not None else None,
        "omega_tends_to_infinity": omega == math.inf,
        "plant": dict(side.worst.plant),
        "point": list(side.worst.point),
        "records": _records(side.records),
        "witness_records": _records(side.witness_records),
    }


def _records(records: Sequence[Record]) -> list[dict[str, Any]]:
    return [{"tokens": " ".join(record.tokens), "boxes": record.boxes} for record in records]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


# -- reading --------------------------------------------------------------------------------------------------------


def from_document(document: object) -> Certificate:
    """Read a certificate's JSON.

    Raises:
        CertificateError: not a certificate, or an entry is missing or has the wrong type.
    """
    top = JsonObject(document, "")
    if top.get("kind") != KIND:
        raise CertificateError("this is not a certificate of this tool: its kind is another")
    if top.number("schema") == _UNWRAPPED_SCHEMA:
        raise CertificateError(
            "schema 1: this certificate was made when phase and delay margins were read from the unwrapped phase; they "
            "are distances to -1 now, so that it has to be made again by `fopi prove`"
        )
    if top.number("schema") != CERTIFICATE_SCHEMA:
        raise CertificateError(f"schema {top.number('schema'):g} is not known; this version reads {CERTIFICATE_SCHEMA}")
    if PLANTS in top.value:
        return _read_list(top)
    gains = top.child("gains")
    try:
        controller = gains.controller()
        family = read_family(top.child("plant"))
        implementation = _read_implementation(top.child("implementation")) if "implementation" in top.value else None
        case = Case(controller, family, top.number("origin_log_rad_s"), None, implementation)
        case.loop.plant([ball_of(side) for side in case.plants])
    except DomainError as error:
        raise CertificateError(str(error)) from None
    if controller.is_zero:
        raise CertificateError("gains: all are 0, which is no controller")
    tolerance = top.number("tolerance")
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        raise CertificateError(f"tolerance must be greater than 0 and at most {LARGEST_TOLERANCE:g}")
    return Certificate(
        name=top.text("name"),
        spec_sha256=top.text("spec_sha256"),
        case=case,
        tolerance=tolerance,
        stability=_read_stability(top.child("stability"), case),
        requirements=tuple(_read_requirement(child, case) for child in top.children("requirements")),
        versions=top.texts("versions"),
        scenarios=read_scenario_proofs(
            top.children("scenarios") if "scenarios" in top.value else (), family, implementation
        ),
        limited=(
            read_limits(top.child("with_limits"), top.text("name"), family, implementation, controller)
            if "with_limits" in top.value
            else None
        ),
    )


def _read_list(top: JsonObject) -> Certificate:
    """The certificate of a list, made again from those of its members: what is said of all of them is not read."""
    members = []
    for entry in top.children(PLANTS):
        own = entry.get("certificate")
        if isinstance(own, dict) and PLANTS in own:
            raise CertificateError(f"{entry.place}.certificate is about a list of plants itself")
        try:
            members.append(MemberCertificate(entry.text("name"), from_document(own)))
        except CertificateError as error:
            raise CertificateError(f"{entry.place}: {error}") from None
    if not members:
        raise CertificateError(f"{PLANTS} has no plant")
    if (wrong := mismatched_members(members)) is not None:
        raise CertificateError(wrong)
    return of_certificates(members)


def _read_implementation(entry: JsonObject) -> Implementation:
    poles, residues = entry.numbers("poles"), entry.numbers("residues")
    sample_time_s, delay_samples = entry.number("sample_time_s"), entry.number("delay_samples")
    inside = all(abs(pole) < 1.0 for pole in poles[1:]) and all(-1.0 < pole <= 1.0 for pole in poles[:1])
    if len(poles) > _MOST_SECTIONS:
        raise CertificateError(f"{entry.place}: {len(poles)} sections are more than the {_MOST_SECTIONS} that are read")
    if len(poles) != len(residues) or len(set(poles)) < len(poles) or not inside:
        raise CertificateError(f"{entry.place}: poles and residues are no stable sum of first-order sections")
    if not sample_time_s > 0.0 or not delay_samples >= 0.0:
        raise CertificateError(f"{entry.place}: the sample time must be greater than 0 and the delay at least 0")
    return Implementation(Sections(sample_time_s, entry.number("direct"), poles, residues), delay_samples)


def _read_requirement(entry: JsonObject, case: Case) -> RequirementProof:
    name = entry.text("name")
    if name not in QUANTITIES:
        raise CertificateError(f"{entry.place}.name: {name[:40]!r} is no quantity that this version knows")
    relation = entry.word("relation", Relation)
    limits = entry.numbers("limits")
    if len(limits) != (2 if relation is Relation.BETWEEN else 1):
        raise CertificateError(f"{entry.place}.limits has the wrong length for {relation.value}")
    for limit in limits:
        if (wrong := QUANTITIES[name].check_limit(limit)) is not None:
            raise CertificateError(f"{entry.place}.limits: {limit!r} {wrong}")
    low, high = entry.number("from_rad_s"), entry.number_or_none("to_rad_s")
    high = math.inf if high is None else high
    if not 0.0 <= low <= high or high == 0.0:
        raise CertificateError(f"{entry.place}: from_rad_s and to_rad_s are no band")
    end_limit = entry.number("limit_at_to_rad_s") if "limit_at_to_rad_s" in entry.value else None
    if end_limit is not None and not _is_line(name, relation, low, high):
        raise CertificateError(f"{entry.place}: limit_at_to_rad_s belongs to at_least or at_most over a band")
    requirement = Requirement(name, relation, limits, entry.word("on", Scope), low, high, end_limit=end_limit)
    return RequirementProof(requirement, tuple(_read_side(side, case) for side in entry.children("sides")))


def _is_line(name: str, relation: Relation, low: float, high: float) -> bool:
    """Whether a limit may be a line over log omega."""
    of_one_side = relation in (Relation.AT_LEAST, Relation.AT_MOST)
    return of_one_side and QUANTITIES[name].takes_band and 0.0 < low < high < math.inf


def _read_side(entry: JsonObject, case: Case) -> SideProof:
    side = entry.text("side")
    if side not in ("at_most", "at_least"):
        raise CertificateError(f"{entry.place}.side is neither at_most nor at_least")
    omega = math.inf if entry.flag("omega_tends_to_infinity") else entry.number_or_none("omega_rad_s")
    if omega is not None and omega < 0.0:
        raise CertificateError(f"{entry.place}.omega_rad_s is negative")
    point = _read_point(entry, case)
    return SideProof(
        upper=side == "at_most",
        verdict=entry.word("verdict", Verdict),
        level=entry.number_or_none("level_natural"),
        witness=entry.number_or_none("witness_natural"),
        worst=Place(omega, case.family.describe(np.array(point, dtype=float)), point),
        records=_read_records(entry, "records"),
        witness_records=_read_records(entry, "witness_records"),
    )


def _read_stability(entry: JsonObject, case: Case) -> StabilityProof:
    return StabilityProof(
        verdict=entry.word("verdict", Verdict),
        level=entry.number_or_none("sensitivity_at_most_neper"),
        point=_read_point(entry, case),
        poles=entry.count_or_none("unstable_poles"),
        records=_read_records(entry, "records"),
    )


def _read_point(entry: JsonObject, case: Case) -> tuple[float, ...]:
    point = entry.numbers("point")
    box = case.plants
    if len(point) != len(box) or not all(low <= value <= high for value, (low, high) in zip(point, box, strict=True)):
        raise CertificateError(f"{entry.place}.point is no plant of the family")
    return point


def _read_records(entry: JsonObject, key: str) -> tuple[Record, ...]:
    return tuple(Record(tuple(record.text("tokens").split())) for record in entry.children(key))
