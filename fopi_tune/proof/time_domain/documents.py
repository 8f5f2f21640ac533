"""Time-domain proofs as JSON:  TimeDomainProof <-> dictionary, which a certificate can carry.

Reading checks types and ranges only; `recheck` tests whether the statements are true.
"""

from __future__ import annotations

from typing import Any

from fopi_tune.errors import CertificateError
from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.proof import TimeDomainProof
from fopi_tune.proof.verdict import LARGEST_TOLERANCE, Verdict
from fopi_tune.spec.model import Relation

#: of a proof that is read
_MOST_BOXES = 1_000_000


def to_document(case: TimeDomainCase, proof: TimeDomainProof) -> dict[str, Any]:
    """The proof's JSON, with the limit it is about.

    Args:
        case: of the proof.
        proof: of the case's limit.
    """
    limit, names = case.limit, case.family.uncertain_names
    proved = proof.verdict is Verdict.PROVED
    return {
        "measure": limit.measure,
        "relation": limit.relation.value,
        "limit": limit.limit,
        "scenario": case.scenario.name,
        "verdict": proof.verdict.value,
        "tolerance": proof.tolerance,
        # what was not decided could not be tested
        "bound": proof.bound if proved else None,
        "plant": None if proof.theta is None else dict(zip(names, proof.theta, strict=True)),
        "time_s": proof.time_s,
        "value": proof.value,
        # all lower and upper ends, axis after axis, box after box
        "boxes": [[end for interval in box for end in interval] for box in proof.boxes],
    }


def from_document(case: TimeDomainCase, document: object, place: str = "") -> TimeDomainProof:
    """Read a proof's JSON.

    Args:
        case: the proof must be about its limit, its scenario and its uncertain numbers.
        document: parsed JSON.
        place: its path in the file, for error messages.

    Raises:
        CertificateError: an entry is missing or has the wrong type, or the proof is about something else.
    """
    entry, limit = JsonObject(document, place), case.limit
    told = (entry.text("measure"), entry.word("relation", Relation), entry.number("limit"), entry.text("scenario"))
    asked = (limit.measure, limit.relation, limit.limit, case.scenario.name)
    if told != asked:
        raise CertificateError(f"{place or 'the proof'} is about {told[0]} in {told[3]}, not about this limit")
    tolerance = entry.number("tolerance")
    if not 0.0 <= tolerance <= LARGEST_TOLERANCE:
        raise CertificateError(f"{entry.at('tolerance')} must be at least 0 and at most {LARGEST_TOLERANCE:g}")
    found = TimeDomainProof(
        verdict=entry.word("verdict", Verdict),
        method="",
        tolerance=tolerance,
        bound=entry.number_or_none("bound"),
        theta=_plant(entry, case),
        time_s=entry.number_or_none("time_s"),
        value=entry.number_or_none("value"),
        boxes=_boxes(entry, len(case.family.uncertain_names)),
    )
    bounds = found.bound is not None or bool(found.boxes)
    witness = any(each is not None for each in (found.theta, found.time_s, found.value))
    if (bounds and found.verdict is not Verdict.PROVED) or (witness and found.verdict is not Verdict.REFUTED):
        raise CertificateError(f"{place or 'the proof'} states bounds or a plant that do not belong to its verdict")
    return found


def _plant(entry: JsonObject, case: TimeDomainCase) -> tuple[float, ...] | None:
    if entry.get("plant") is None:
        return None
    plant, names = entry.child("plant"), case.family.uncertain_names
    if tuple(plant.value) != names and sorted(plant.value) != sorted(names):
        raise CertificateError(f"{plant.place} has other numbers than {', '.join(names)}")
    return tuple(plant.number(name) for name in names)


def _boxes(entry: JsonObject, axes: int) -> tuple[Box, ...]:
    rows = entry.get("boxes")
    if not isinstance(rows, list) or len(rows) > _MOST_BOXES:
        raise CertificateError(f"{entry.at('boxes')} is no list of at most {_MOST_BOXES} boxes")
    found = []
    for number, row in enumerate(rows):
        ends = JsonObject({"box": row}, f"{entry.at('boxes')}[{number}]").numbers("box")
        box = tuple(zip(ends[0::2], ends[1::2], strict=False))
        if len(ends) != 2 * axes or not all(low <= high for low, high in box):
            raise CertificateError(f"{entry.at('boxes')}[{number}] is no box of {axes} uncertain numbers")
        found.append(box)
    return tuple(found)
