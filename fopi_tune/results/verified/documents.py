"""The JSON that a check of given gains and that of their digital controller share, and its status."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fopi_tune.core.controller import numbers_of
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.verification.results import Outcome, Verification
from fopi_tune.results.documents import (
    finite,
    loop_name,
    margins_dict,
    objective_name,
    proof_dict,
    stability_dict,
)
from fopi_tune.results.equalities import equality_notes
from fopi_tune.results.measured import measured_notes
from fopi_tune.results.measures import measure_reports, measures_dict
from fopi_tune.results.requirement_reports import requirement_reports
from fopi_tune.results.stamp import Stamp
from fopi_tune.spec.model import DesignSpec

#: version of the result's JSON; it may only grow
RESULT_SCHEMA = 1


def verification_dict(
    spec: DesignSpec, found: Verification, certificate: Certificate | None, stamp: Stamp
) -> dict[str, Any]:
    """The JSON that a check of given gains and that of their digital controller share."""
    return {
        "schema": RESULT_SCHEMA,
        "status": verification_status(found, certificate),
        "gains": numbers_of(found.gains),
        "objective": finite(found.objective),
        "requirements": [report.to_dict() for report in requirement_reports(found, certificate, spec.is_measured)],
        "stamp": asdict(stamp),
        "name": spec.name,
        "loop": loop_name(spec),
        "objective_quantity": objective_name(spec),
        "tolerance": found.tolerance,
        "notes": [*equality_notes(found.requirements), *measured_notes(spec, found.gains)],
        "stability": stability_dict(found.stability),
        "nominal": margins_dict(found.nominal),
        "proof": proof_dict(certificate, certificate is not None, spec.is_measured),
        **measures_dict(measure_reports(spec.scenario_requirements, found.measures, certificate=certificate)),
    }


def verification_status(found: Verification, certificate: Certificate | None) -> str:
    """`met`, `violated`, or `undecided` when the verification passed but the proof is missing, or stability is open."""
    if found.stability.undecided:
        missed = any(not each.is_met and each.outcome is not Outcome.UNDECIDED for each in found.requirements)
        return "violated" if missed else "undecided"
    verdict = certificate.verdict if certificate else Verdict.PROVED
    if verdict is Verdict.REFUTED or not all(result.is_met for result in (*found.requirements, *found.measures)):
        return "violated"
    if not found.stability.stable and certificate is None:
        return "violated"
    return "met" if verdict is Verdict.PROVED and found.all_met else "undecided"
