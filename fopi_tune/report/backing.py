"""Whether a result on the disk is what its certificate says:  a report must not repeat a proof that is not there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fopi_tune.errors import DomainError
from fopi_tune.proof.documents import digest

#: statuses that say that every requirement is met
_GOOD = ("solved", "met")
#: relative; bounds are shown to less
_ROUNDING = 1e-5
#: relative; no gap that is stated is larger
_NEAR = 1e-2

Document = Mapping[str, Any]


def check_backed(document: Document, certificate: Document | None, names: tuple[str, str], command: str) -> None:
    """Refuse a result whose words its certificate does not bear out; one without a proof says so itself.

    Args:
        document: JSON of a design, a check or a digital controller.
        certificate: the JSON beside it; None where there is none.
        names: of the two files, for messages.
        command: what writes them.

    Raises:
        DomainError: the certificate is missing, of something else or changed, or the result was changed.
    """
    problem = _problem(document, certificate)
    if problem:
        result, proof = names
        raise DomainError(problem.format(result=result, proof=proof) + f"; run `{command}` again")


def _problem(document: Document, certificate: Document | None) -> str:
    met = [bool(each["met"]) for each in document["requirements"]]
    if document["status"] in _GOOD and not all(met):
        return "{result} contradicts itself: its status is good, and a requirement is not met"
    stated = document["proof"].get("certificate_digest")
    if stated is None:
        return ""
    if certificate is None:
        return "{proof} is not there, which {result} speaks of"
    if certificate.get("digest") != stated or digest(dict(certificate)) != stated:
        return "{proof} is not the one that {result} speaks of, or was changed"
    if certificate["gains"] != document["gains"] or certificate["verdict"] != document["proof"]["verdict"]:
        return "{result} has other gains or another verdict than {proof}: it was changed"
    for said, shown in zip(document["requirements"], certificate["requirements"], strict=True):
        proof = said["proof"]
        if any(proof[key] != shown[key] for key in ("verdict", "proved_from", "proved_to")) or not _is_inside(said):
            return "{result} says of " + str(said["name"]) + " what {proof} does not: it was changed"
    return ""


def _is_inside(said: Document) -> bool:
    """Whether the value that was reached lies between what is proved, and near it where the gap is known."""
    proof, value = said["proof"], said["achieved"]
    if value is None or proof["verdict"] != "proved":
        return True
    low, high, size = proof["proved_from"], proof["proved_to"], max(1.0, abs(value))
    slack = _ROUNDING * size
    inside = (low is None or low - slack <= value) and (high is None or value <= high + slack)
    bounds = [bound for bound in (low, high) if bound is not None]
    far = proof["relative_gap"] is not None and bounds and min(abs(value - b) for b in bounds) > _NEAR * size
    return inside and not far
