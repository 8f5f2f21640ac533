"""Requirements on scenarios as rows of the page, and documents that are not as this tool writes them."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from fopi_tune.errors import CertificateError
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.report.measure_entries import check_measures, measures_met
from fopi_tune.report.measure_rows import measure_rows
from fopi_tune.report.requirement_rows import RequirementRow
from fopi_tune.report.text.formatting import TIE
from fopi_tune.spec import parse_spec

SPEC = parse_spec("""
schema: 1
name: a
plant: {model: lag, static_gain: {min: 0.8, max: 1.2, nominal: 1}, time_constant_s: 2}
digital: {sample_time_s: 0.1}
scenarios:
- {name: step, duration_s: 10, reference: [{at_s: 0, value: 1}]}
- {name: load, duration_s: 10, reference: [{at_s: 0, value: 0}], load: [{at_s: 0, value: 1}]}
requirements:
- {overshoot: {at_most: 0.1}, scenario: step}
- iae: {at_least: 3}
""")
DOCUMENT: dict[str, Any] = {
    "scenario_requirements": [
        {
            "name": "overshoot",
            "relation": "at_most",
            "limit": 0.1,
            "scenario": "step",
            "verdict": "checked",
            "achieved": 0.09,
            "met": True,
            "score": 0.99,
            "worst": {"scenario": "step", "time_s": 2.4, "plant": {"static_gain": 1.2}},
            "simulated_plants": 1029,
            "drawn": {"met": 9990, "total": 10000, "low": 0.998, "high": 0.9996, "confidence": 0.99},
            "multiplier": 3.5,
            "multiplier_checked": None,
            "proved_bound": None,
            "why_checked": "the budget of 2000 boxes is spent",
        },
        {
            "name": "iae",
            "relation": "at_least",
            "limit": 3.0,
            "scenario": None,
            "verdict": "violated",
            "achieved": 2.5,
            "met": False,
            "score": 1.2,
            "worst": {"scenario": "load", "time_s": None, "plant": {"static_gain": 0.8}},
            "simulated_plants": 1029,
            "drawn": None,
            "multiplier": None,
            "multiplier_checked": None,
            "proved_bound": None,
            "why_checked": None,
        },
    ]
}


def rows(document: dict[str, Any]) -> tuple[RequirementRow, ...]:
    return measure_rows(SPEC, document)


def changed(index: int, **entries: Any) -> dict[str, Any]:
    document = copy.deepcopy(DOCUMENT)
    document["scenario_requirements"][index] |= entries
    return document


def test_the_rows_of_a_document() -> None:
    first, second = rows(DOCUMENT)
    assert (first.verdict, first.sign, first.what) == ("checked", "✓", "overshoot <= 0.1")
    assert (first.scope, first.achieved, first.score) == ("family, scenario step", "0.09", "0.990")
    assert first.worst.replace(TIE, " ") == "at 2.4 s with static_gain = 1.2"
    assert first.proved == "9990 of 10000 drawn plants meet it (99.79 .. 99.97 %)"
    assert first.cost == "3.5"
    assert (second.verdict, second.sign, second.what) == ("violated", "✗", "iae >= 3")
    assert second.scope == "family, every scenario"
    assert second.worst.replace(TIE, " ") == "in load with static_gain = 0.8"
    assert (second.proved, second.cost) == ("", "")
    assert measures_met(DOCUMENT) == [True, False]


def test_a_spec_without_such_requirements_has_no_rows() -> None:
    plain = parse_spec(
        "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\nobjective: {maximize: ki}\n"
    )
    assert measure_rows(plain, {"requirements": []}) == ()


def test_what_is_not_known() -> None:
    never = rows(changed(0, verdict="violated", achieved=None, score=None, met=False))[0]
    assert (never.achieved, never.score) == ("never", "–")
    nothing = rows(changed(0, verdict="open", achieved=None, score=None, met=False, worst=None, drawn=None))[0]
    assert (nothing.sign, nothing.achieved, nothing.worst, nothing.proved) == ("–", "–", "", "")
    assert measure_rows(SPEC, None) == ()
    assert measures_met({}) == []


def check(document: dict[str, Any]) -> None:
    check_measures(JsonObject(document, ""), SPEC)


def test_a_document_as_it_is_written_passes() -> None:
    check(DOCUMENT)
    check(changed(0, worst=None, drawn=None, achieved=None, score=None, verdict="open", met=False))
    # what never settles has no number
    check(changed(0, achieved=None, score=None, verdict="violated", met=False))
    # a limit may be missed by the tolerance
    check(changed(0, achieved=0.1 + 1e-8, score=1.0 + 1e-8))
    plain = parse_spec(
        "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\nobjective: {maximize: ki}\n"
    )
    check_measures(JsonObject({}, ""), plain)


@pytest.mark.parametrize(
    "entries",
    [
        {"name": "undershoot"},
        {"relation": "at_least"},
        {"relation": "below"},
        {"limit": 0.2},
        {"limit": "0.1"},
        {"scenario": None},
        {"scenario": "load"},
        {"verdict": "fine"},
        {"met": "yes"},
        {"met": None},
        {"achieved": "0.09"},
        {"score": "1"},
        {"multiplier": []},
        {"worst": {"scenario": "other", "time_s": 2.4, "plant": {"static_gain": 1.2}}},
        {"worst": {"scenario": "step", "time_s": "now", "plant": {"static_gain": 1.2}}},
        {"worst": {"scenario": "step", "time_s": 2.4, "plant": {}}},
        {"worst": {"scenario": "step", "time_s": 2.4, "plant": {"static_gain": "big"}}},
        {"worst": {"scenario": "step", "time_s": 2.4, "plant": {"static_gain": 1.0, "other": 2.0}}},
        {"worst": 5},
        {"drawn": {"met": 11, "total": 10, "low": 0.5, "high": 0.9, "confidence": 0.99}},
        {"drawn": {"met": None, "total": 10, "low": 0.5, "high": 0.9, "confidence": 0.99}},
        {"drawn": {"met": 9, "total": 10, "low": 0.95, "high": 0.9, "confidence": 0.99}},
        {"drawn": {"met": 9, "total": 10, "low": 0.5, "high": 1.9, "confidence": 0.99}},
        {"drawn": {"met": 9, "total": 10}},
        # verdicts and numbers that contradict each other
        {"verdict": "violated"},
        {"met": False},
        {"achieved": 0.2},
        {"score": 1.2},
        {"achieved": None},
        {"verdict": "open", "met": False},
        {"verdict": "violated", "met": False},
    ],
    ids=str,
)
def test_another_document_is_refused(entries: dict[str, Any]) -> None:
    with pytest.raises(CertificateError):
        check(changed(0, **entries))


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_document_of_other_requirements_is_refused(count: int) -> None:
    entries = [*DOCUMENT["scenario_requirements"], DOCUMENT["scenario_requirements"][0]][:count]
    with pytest.raises(CertificateError, match="scenario_requirements"):
        check({"scenario_requirements": entries})
    with pytest.raises(CertificateError):
        check({})
