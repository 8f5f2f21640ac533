"""What a report is made from:  a spec and the JSON documents of its results -> ResultDocuments.

The documents are those on the disk (`design.json`, `digital.json`, `evidence.json`), so that a report made together
with the results and one made from their files later are the same bytes.  `check_consistent` refuses documents that
their certificate does not confirm.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.documents import digest
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.report.document_shapes import check_design, check_digital, check_evidence
from fopi_tune.report.measure_entries import measures_met
from fopi_tune.results.design import Run
from fopi_tune.results.documents import loop_name
from fopi_tune.spec.default_objective import with_default_objective
from fopi_tune.spec.digests import DESIGN_PARTS, DIGITAL_PARTS, EVIDENCE_PARTS, digests_of, is_of_spec
from fopi_tune.spec.model import DesignSpec, Requirement

#: a result's JSON
Document = Mapping[str, Any]
T = TypeVar("T")


@dataclass(frozen=True)
class ReportedRequirement:
    """A requirement and its entry in a document.

    Args:
        requirement: as the spec states it.
        reported: the entry, with keys `achieved`, `score`, `worst`, `proof`, ...
    """

    requirement: Requirement
    reported: Document


@dataclass(frozen=True)
class ResultDocuments:
    """A spec and the documents of its results.

    Args:
        spec: the spec.
        design: the JSON of the design.
        digital: the JSON of the digital controller and its loop; None without one.
        evidence: the JSON of the plants that were drawn; None without.
        gains: those of the design; None where it has none.
    """

    spec: DesignSpec
    design: Document
    digital: Document | None
    evidence: Document | None
    gains: FoPi | None

    @property
    def requirements(self) -> tuple[ReportedRequirement, ...]:
        """Of the design, in the order of the spec."""
        return _reported(self.spec, self.design)

    @property
    def digital_requirements(self) -> tuple[ReportedRequirement, ...]:
        """Of the loop on samples; none without a digital controller."""
        return () if self.digital is None else _reported(self.spec, self.digital)

    @property
    def digital_implementation(self) -> Implementation | None:
        """The digital controller; None without one."""
        if self.digital is None or self.spec.digital is None:
            return None
        said = self.digital["controller"]
        poles = tuple(float(each["pole"]) for each in said["sections"])
        residues = tuple(float(each["residue"]) for each in said["sections"])
        sections = Sections(self.spec.digital.sample_time_s, float(said["direct"]), poles, residues)
        return Implementation(sections, self.spec.digital.delay_samples)

    @property
    def implementation(self) -> Implementation | None:
        """The digital controller where the requirements are about the loop on samples; None in continuous time."""
        return self.digital_implementation if loop_name(self.spec) == "sampled" else None


def documents_of_run(run: Run, evidence: Document | None = None) -> ResultDocuments:
    """The documents of a run.

    Args:
        run: every stage of a spec.
        evidence: the JSON of plants that were drawn; left out unless it is of the same gains.
    """
    digital = None if run.digital is None else _plain(run.digital.to_dict())
    return documents_of(run.spec, _plain(run.design.to_dict()), digital, evidence)


def documents_of(
    spec: DesignSpec,
    design: Document,
    digital: Document | None = None,
    evidence: Document | None = None,
    *,
    file: str = "design.json",
    command: str = "fopi run",
) -> ResultDocuments:
    """Put documents together, after a check that they belong to the spec.

    Args:
        spec: the spec.
        design: the JSON of `fopi tune` or `fopi run`; or of `fopi prove`, if only keys that both have are read.
        digital: the JSON of `fopi discretize`; left out unless it is of this spec and the design's gains.
        evidence: the JSON of `fopi validate`; left out likewise.
        file: name of the design's file, for messages.
        command: the command that writes it, for messages.

    Raises:
        DomainError: the design is of another spec, or one of the documents is not as this tool writes it; says where.
    """
    made = design.get("stamp")
    if not isinstance(made, Mapping) or made.get("spec_sha256") is None:
        raise DomainError(f"{file} is no result of this tool; run `{command}` again")
    if not is_of_spec(made, spec):
        raise DomainError(
            f"{file} is of another spec, or this one's {_changed_parts(made, spec)} changed since; "
            f"run `{command}` again"
        )
    spec = _as_designed(spec, design)
    gains = _checked(check_design, design, spec, file, command)
    digital = _matching(spec, design["gains"], digital, DIGITAL_PARTS)
    if digital is not None:
        _checked(check_digital, digital, _as_designed(spec, digital), "digital.json", command)
    evidence = _matching(spec, design["gains"], evidence, EVIDENCE_PARTS)
    if evidence is not None:
        _checked(check_evidence, evidence, spec, "evidence.json", "fopi validate")
    return ResultDocuments(spec, design, digital, evidence, gains)


def _changed_parts(made: Mapping[str, Any], spec: DesignSpec) -> str:
    """The parts of a spec that differ from those that a result states, in words."""
    stated, now = made.get("digests"), digests_of(spec)
    if not isinstance(stated, Mapping):
        return "text"
    return ", ".join(part for part in DESIGN_PARTS if stated.get(part) != now[part]) or "text"


def _as_designed(spec: DesignSpec, document: Document) -> DesignSpec:
    """The spec with the limit of |S| that a design without an objective may have added, where a document has it."""
    entries = document.get("requirements")
    completed = with_default_objective(spec)
    is_completed = isinstance(entries, list) and len(entries) == len(completed.requirements)
    return completed if is_completed else spec


def _checked(
    check: Callable[[Document, DesignSpec], T], document: Document, spec: DesignSpec, file: str, command: str
) -> T:
    try:
        return check(document, spec)
    except DomainError as error:
        raise DomainError(f"{file} is not as this tool writes it: {error}; run `{command}` again") from None


def _matching(spec: DesignSpec, gains: object, document: Document | None, parts: tuple[str, ...]) -> Document | None:
    """The document if it is of these gains and these parts of the spec, else None."""
    if document is None or gains is None:
        return None
    return document if is_of_spec(document.get("stamp"), spec, parts) and document.get("gains") == gains else None


def _reported(spec: DesignSpec, document: Document) -> tuple[ReportedRequirement, ...]:
    requirements = _as_designed(spec, document).requirements
    return tuple(ReportedRequirement(r, said) for r, said in zip(requirements, document["requirements"], strict=True))


def _plain(document: Document) -> Document:
    """The document as it is read back from the disk: lists in place of tuples; numbers keep every digit."""
    return json.loads(json.dumps(document, allow_nan=False))


#: statuses that mean that every requirement is met
_GOOD_STATUSES = ("solved", "met")
#: relative
_ROUNDING = 1e-5
#: relative; the largest gap that a certificate states
_LARGEST_GAP = 1e-2
#: entries of a requirement's proof that its certificate has too
_PROVED = ("verdict", "proved_from", "proved_to")


def check_consistent(document: Document, certificate: Document | None, names: tuple[str, str], command: str) -> None:
    """Refuse a result that its certificate does not confirm; a result that states no proof needs none.

    Args:
        document: JSON of a design, a check or a digital controller, with the entries that `documents_of` asks for.
        certificate: the JSON of its certificate; None where the file is missing.
        names: the names of the two files, for messages.
        command: the command that writes them.

    Raises:
        DomainError: the certificate is missing, of another result or changed, or the result was changed.
    """
    result, proof = names
    try:
        problem = _inconsistency(document, certificate)
    except CertificateError as error:
        raise DomainError(f"{proof} is not as this tool writes it: {error}; run `{command}` again") from None
    if problem:
        raise DomainError(problem.format(result=result, proof=proof) + f"; run `{command}` again")


def _inconsistency(document: Document, certificate: Document | None) -> str:
    """The message that says what does not fit, with {result} and {proof} for the files' names; empty if all does."""
    met = [*(bool(each["met"]) for each in document["requirements"]), *measures_met(document)]
    if document["status"] in _GOOD_STATUSES and not all(met):
        return "{result} contradicts itself: its status is good, and a requirement is not met"
    stated = document["proof"].get("certificate_digest")
    if stated is None:
        return ""
    if certificate is None:
        return "{proof} is not there, which {result} speaks of"
    if certificate.get("digest") != stated or digest(dict(certificate)) != stated:
        return "{proof} is not the one that {result} speaks of, or was changed"
    top = JsonObject(certificate, "")
    if top.get("gains") != document["gains"] or top.get("verdict") != document["proof"]["verdict"]:
        return "{result} has other gains or another verdict than {proof}: it was changed"
    claims = top.children("requirements")
    if len(claims) != len(document["requirements"]):
        return "{proof} has not the requirements of {result}"
    for said, claim in zip(document["requirements"], claims, strict=True):
        proof = said["proof"]
        same = proof is not None and all(proof[key] == claim.get(key) for key in _PROVED)
        if not same or not _is_within_bounds(said):
            return "{result} says of " + str(said["name"]) + " what {proof} does not: it was changed"
    return ""


def _is_within_bounds(said: Document) -> bool:
    """Whether the achieved value lies within the proved bounds, and close to one where the gap is known."""
    proof, value = said["proof"], said["achieved"]
    if value is None or proof["verdict"] != "proved":
        return True
    low, high, size = proof["proved_from"], proof["proved_to"], max(1.0, abs(value))
    slack = _ROUNDING * size
    inside = (low is None or low - slack <= value) and (high is None or value <= high + slack)
    bounds = [bound for bound in (low, high) if bound is not None]
    far = proof["relative_gap"] is not None and bounds and min(abs(value - b) for b in bounds) > _LARGEST_GAP * size
    return inside and not far
