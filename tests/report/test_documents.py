"""A report repeats no proof that is not there: results that were changed, and a figure's limits."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from cases.plants import ROBUST_BRAKE
from cases.project import CONTINUOUS
from cases.reports import BRAKE
from matplotlib.figure import Figure

import fopi_tune as ft
from fopi_tune.errors import DomainError
from fopi_tune.report.documents import check_consistent, documents_of
from fopi_tune.report.evidence import histograms
from fopi_tune.report.figures.forbidden_regions import sensitivity_discs
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import Relation, Requirement, Scope


@pytest.fixture(scope="module")
def proved_run() -> dict[str, dict[str, Any]]:
    run = ft.run(parse_spec(BRAKE))
    documents = {"design.json": run.design.to_dict(), "certificate.json": run.design.certificate_document()}
    return json.loads(json.dumps(documents))


def check(documents: dict[str, Any]) -> None:
    names = "design.json", "certificate.json"
    check_consistent(documents[names[0]], documents[names[1]], names, "fopi run")


def test_a_result_as_it_was_written_is_backed_by_its_certificate(proved_run: dict[str, dict[str, Any]]) -> None:
    check(proved_run)


@pytest.mark.thinned(slow=["lag_gain", "second_order"])
@pytest.mark.parametrize("name", ["brake_delay", "lag_gain_and_delay", "pi_baseline", "second_order", "throttle"])
def test_checks_of_every_shipped_spec_are_backed(name: str) -> None:
    spec = ft.load_spec(CONTINUOUS / f"{name}.yaml")
    for gains in (ft.FoPi(0.7, 0.4, 0.9), ft.FoPi(5.0, 3.0, 1.3)):
        found = ft.prove(spec, gains)
        result, proof = json.loads(json.dumps([found.to_dict(), found.certificate_document()]))
        check_consistent(result, proof, ("check.json", "certificate.json"), "fopi prove")


def _without(documents: dict[str, Any]) -> None:
    documents["certificate.json"] = None


def _gains(documents: dict[str, Any]) -> None:
    documents["design.json"]["gains"]["kp"] = 5.0


def _achieved(documents: dict[str, Any]) -> None:
    documents["design.json"]["requirements"][2]["achieved"] = 120.0


def _bound(documents: dict[str, Any]) -> None:
    documents["design.json"]["requirements"][2]["proof"]["proved_from"] = 89.0


def _status(documents: dict[str, Any]) -> None:
    documents["design.json"]["requirements"][2]["met"] = False


def _certificate(documents: dict[str, Any]) -> None:
    documents["certificate.json"]["requirements"][2]["proved_from"] = 89.0


def _verdict(documents: dict[str, Any]) -> None:
    documents["design.json"]["proof"]["verdict"] = "refuted"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_without, "certificate.json is not there, which design.json speaks of; run `fopi run` again"),
        (_gains, "design.json has other gains or another verdict than certificate.json"),
        (_verdict, "design.json has other gains or another verdict than certificate.json"),
        (_achieved, "design.json says of phase_margin_deg what certificate.json does not"),
        (_bound, "design.json says of phase_margin_deg what certificate.json does not"),
        (_status, "design.json contradicts itself"),
        (_certificate, "certificate.json is not the one that design.json speaks of, or was changed"),
    ],
)
def test_a_result_that_its_certificate_does_not_bear_out_is_refused(
    proved_run: dict[str, dict[str, Any]], change: Callable[[dict[str, Any]], None], words: str
) -> None:
    documents = json.loads(json.dumps(proved_run))
    change(documents)
    with pytest.raises(DomainError, match=re.escape(words)):
        check(documents)


def test_each_side_of_a_between_has_its_own_limit_in_the_histograms() -> None:
    text = BRAKE.replace("phase_margin_deg: {at_least: 80}", "phase_margin_deg: {between: [80, 99]}")
    spec = parse_spec(text.replace("samples: 10000", "samples: 200"))
    told = histograms(json.loads(json.dumps(ft.validate(spec, ROBUST_BRAKE).to_dict())), "brake")
    assert told is not None
    figure = Figure(figsize=told.size_inches)
    told.draw(figure)
    lines = {}
    for axes in figure.axes:
        dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
        lines[axes.get_xlabel()] = [float(np.ravel(line.get_xdata())[0]) for line in dashed]
    assert lines["phase_margin_deg >= 80"] == [80.0]
    assert lines["phase_margin_deg <= 99"] == [99.0]


def test_the_nyquist_figure_hatches_the_disc_that_a_bound_of_s_forbids() -> None:
    bounds = [
        Requirement("sensitivity_db", Relation.AT_MOST, (6.0,)),
        Requirement("sensitivity_db", Relation.AT_MOST, (-20.0,), to_rad_s=0.02),
        Requirement("phase_margin_deg", Relation.AT_LEAST, (60.0,)),
    ]
    # |S| <= 2 is a distance of at least 1/2 from -1; a bound below some frequency is no disc
    assert sensitivity_discs(bounds) == [(pytest.approx(0.5, rel=3e-3), Scope.FAMILY)]


SMALL = """\
schema: 1
name: small
plant: {model: lag, static_gain: 1, time_constant_s: 1, dead_time_s: 0.2}
controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: 1}
requirements:
  - gain_margin_db: {at_least: 8}
digital: {sample_time_s: 0.02}
"""


def test_results_outlast_a_scenario_that_is_added_and_not_a_changed_part() -> None:
    # nothing bounds |S|: the design has a requirement more than the spec
    run = ft.run(parse_spec(SMALL), proof=False)
    assert run.digital is not None
    design, digital = json.loads(json.dumps([run.design.to_dict(), run.digital.to_dict()]))
    assert len(design["requirements"]) == 2
    scenarios = "scenarios: [{name: up, duration_s: 5, reference: [{at_s: 0, value: 1}]}]\n"
    for text in (SMALL, "# a comment\n" + SMALL, SMALL + scenarios):
        found = documents_of(parse_spec(text), design, digital)
        assert found.digital == digital
        assert [each.requirement.quantity for each in found.requirements] == ["gain_margin_db", "sensitivity_db"]
        assert len(found.digital_requirements) == 2
    # another filter: the design stays, its digital controller does not
    other = documents_of(parse_spec(SMALL.replace("0.02}", "0.03}")), design, digital)
    assert other.digital is None
    with pytest.raises(DomainError, match="this one's requirements changed since"):
        documents_of(parse_spec(SMALL.replace("at_least: 8", "at_least: 9")), design, digital)


def test_evidence_belongs_to_the_scenarios_it_was_drawn_with() -> None:
    spec = parse_spec(SMALL.replace("dead_time_s: 0.2", "dead_time_s: {min: 0.1, max: 0.2}"))
    run = ft.run(spec, proof=False)
    assert run.design.gains is not None
    evidence = json.loads(json.dumps(ft.validate(spec, run.design.gains, samples=20).to_dict()))
    design = json.loads(json.dumps(run.design.to_dict()))
    assert documents_of(spec, design, None, evidence).evidence == evidence
    text = spec.source.decode() + "scenarios: [{name: up, duration_s: 5, reference: [{at_s: 0, value: 1}]}]\n"
    assert documents_of(parse_spec(text), design, None, evidence).evidence is None
