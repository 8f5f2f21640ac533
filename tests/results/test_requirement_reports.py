"""Reports of requirements:  one verdict where the verification and the proof saw different plants."""

from __future__ import annotations

from dataclasses import replace

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.proof.verdict import Verdict
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.results.requirement_reports import requirement_reports, with_witness

TEXT = (
    "schema: 1\nname: x\nplant: {model: lag, static_gain: {min: 1, max: 2}, time_constant_s: 3, dead_time_s: 1}\n"
    "requirements:\n  - {sensitivity_db: {at_most: %g}}\n  - {phase_margin_deg: {at_least: 10}}\n"
)


def test_what_a_proof_refutes_is_not_reported_as_met() -> None:
    check = ft.prove(ft.parse_spec(TEXT % 2.0), FoPi(1.0, 0.5, 1.0))
    true = check.verification.requirements[0]
    assert true.outcome is Outcome.VIOLATED
    assert true.achieved is not None
    # a verification that looked at the smaller gain only
    seen = replace(true, achieved=1.5, outcome=Outcome.MET, slack=0.06, score=0.94)
    seen = replace(seen, extremes=(replace(true.extremes[0], achieved=1.5),))
    found = replace(check.verification, requirements=(seen, check.verification.requirements[1]))
    report, other = requirement_reports(found, check.certificate)
    assert check.certificate.requirements[0].verdict is Verdict.REFUTED
    assert report.result is not None
    assert not report.result.is_met
    assert report.result.achieved == pytest.approx(true.achieved, rel=1e-6)
    assert report.result.worst.plant == {"static_gain": 2.0}
    assert report.to_dict()["outcome"] == "violated"
    assert other.result is check.verification.requirements[1]


def test_what_is_proved_or_missed_already_stays_as_it_was_found() -> None:
    check = ft.prove(ft.parse_spec(TEXT % 12.0), FoPi(1.0, 0.5, 1.0))
    for result, proof in zip(check.verification.requirements, check.certificate.requirements, strict=True):
        assert with_witness(result, proof, 1e-6) is result
