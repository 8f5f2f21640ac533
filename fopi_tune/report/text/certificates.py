"""Certificates as text:  what is proved, or why a file was refused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.core.text_tables.words import counted
from fopi_tune.proof.certificate import Verdict
from fopi_tune.report.text.formatting import (
    BAD,
    FIRST_COLUMN,
    QUIET,
    Line,
    entry,
    gains_lines,
    number,
    requirement_phrase,
    scope_phrase,
    style_of,
    to_text,
    wrapped,
)
from fopi_tune.report.text.measures import measure_phrase
from fopi_tune.spec.model import Relation

if TYPE_CHECKING:
    from fopi_tune.proof import Certificate, Recheck
    from fopi_tune.proof.certificate import RequirementProof
    from fopi_tune.proof.scenario_proofs import ScenarioProof

_USUAL_TOLERANCE = 1e-6


def recheck_text(found: Recheck) -> Text:
    """The result of checking a certificate."""
    certificate = found.certificate
    gains = certificate.case.gains
    if not found.is_sound:
        lines = [*wrapped(f"{certificate.name}: REFUSED. This certificate does not show what it says.", BAD)]
        for problem in found.problems:
            lines += wrapped(problem, "", "    ", "  - ")
        return to_text(lines)
    proved = certificate.verdict is Verdict.PROVED
    said = (
        f"What it says, that the requirements are {certificate.verdict.value}, is shown again by "
        f"{counted(found.boxes, 'box', 'boxes')}, each limit within a tolerance of {certificate.tolerance:g}."
    )
    lines = wrapped(f"{certificate.name}: sound. {said}", style_of(proved))
    for note in found.notes:
        lines += wrapped(f"Note: {note}.")
    lines += [("", ""), *gains_lines(gains), ("", "")]
    for proof in certificate.requirements:
        lines += wrapped(f"{proof.verdict.value:<{FIRST_COLUMN}}{requirement_phrase(proof.requirement)}")
        lines += wrapped(_bounds(proof), QUIET, indent=" " * (FIRST_COLUMN + 2))
    for each in certificate.scenarios:
        word = "checked" if each.proof.verdict is Verdict.UNDECIDED else each.proof.verdict.value
        lines += wrapped(f"{word:<{FIRST_COLUMN}}{measure_phrase(each.case.limit)}")
        lines += wrapped(_shown(each), QUIET, indent=" " * (FIRST_COLUMN + 2))
    lines += entry("stability", f"{certificate.stability.verdict.value}: {certificate.stability.reason}")
    lines += limits_lines(certificate)
    return to_text(lines)


def _shown(each: ScenarioProof) -> str:
    """What is shown of a measure in a scenario."""
    proof, about = each.proof, f"family, scenario {each.case.scenario.name}"
    if proof.verdict is Verdict.UNDECIDED:
        return f"{about}; not proved, left to the check by simulation"
    if proof.verdict is Verdict.REFUTED:
        return f"{about}; a plant reaches {number(proof.value or 0.0, 9)}"
    edge = "at most" if each.case.limit.relation is Relation.AT_MOST else "at least"
    return f"{about}; shown to be {edge} {number(proof.bound or 0.0, 9)}"


def _bounds(proof: RequirementProof) -> str:
    """The proved range of a requirement's value: "family; proved to be at least 82.906"."""
    low, high = proof.bounds
    worst = ", ".join(dict.fromkeys(side.worst.member for side in proof.sides if side.worst.member))
    where = scope_phrase(proof.requirement) + (f", worst for {worst}" if worst else "")
    if low is None and high is None:
        return f"{where}; {proof.reason}"
    if low is None or high is None:
        edge = f"at least {number(low, 9)}" if low is not None else f"at most {number(high or 0.0, 9)}"
        return f"{where}; shown to be {edge}"
    return f"{where}; shown to lie from {number(low, 12)} to {number(high, 12)}"


def proof_lines(certificate: Certificate | None) -> Iterator[Line]:
    """The certificate in a sentence; nothing without one."""
    if certificate is None:
        return
    verdict = certificate.verdict
    words = f"{verdict.value}: {counted(certificate.boxes, 'box', 'boxes')} in ball arithmetic"
    gaps = [proof.gap for proof in certificate.requirements if proof.gap is not None]
    if certificate.tolerance != _USUAL_TOLERANCE:
        words += f", each limit within a tolerance of {certificate.tolerance:g}"
    if verdict is Verdict.PROVED and gaps:
        words += f"; each bound within {max(gaps):.1e} (relative) of a value that a plant reaches"
    open_ones = [proof for proof in certificate.requirements if proof.verdict is Verdict.UNDECIDED]
    for proof in open_ones:
        words += f"; {requirement_phrase(proof.requirement)} is undecided: {proof.explanation}"
    if certificate.stability.verdict is Verdict.UNDECIDED:
        words += f"; stability is undecided: {certificate.stability.explanation}"
    yield from entry("proof", words, "" if verdict is Verdict.PROVED else BAD)
    yield from limits_lines(certificate)


def limits_lines(certificate: Certificate) -> Iterator[Line]:
    """Whether the loop is stable with the limits of its control; nothing where the spec has none."""
    if certificate.limited is not None:
        yield from entry("limits", certificate.limited.statement, "" if certificate.limited.proof else QUIET)
