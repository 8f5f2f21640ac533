"""Requirements on scenarios in results: verdicts, and the entries of the JSON."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.proof.verification.results import MeasureResult, Place
from fopi_tune.results.measures import MeasureReport, measure_reports, measures_dict
from fopi_tune.spec.model import Limit, Relation

LIMIT = Limit("overshoot", Relation.AT_MOST, 0.1, "step")
PLACE = Place(None, {"static_gain": 1.2}, (1.2,))
DRAWN = Fraction(9990, 10000, 0.998, 0.9996, 0.998, 0.9996, 0.99)


def result(achieved: float = 0.09, met: bool = True, time_s: float | None = 2.4) -> MeasureResult:
    return MeasureResult(LIMIT, "step", achieved, 0.99, PLACE, time_s, met, 1029)


def strict(report: MeasureReport) -> dict[str, Any]:
    found = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert isinstance(found, dict)
    return found


def test_every_number_of_a_checked_requirement() -> None:
    assert strict(MeasureReport(LIMIT, result(), 3.5, DRAWN)) == {
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
        "why_checked": None,
    }


@pytest.mark.parametrize(
    ("found", "verdict", "met", "achieved"),
    [
        (result(), "checked", True, 0.09),
        (result(0.2, False), "violated", False, 0.2),
        # what never settles has no number
        (result(math.inf, False, None), "violated", False, None),
        (None, "open", False, None),
    ],
)
def test_the_verdict(found: MeasureResult | None, verdict: str, met: bool, achieved: float | None) -> None:
    said = strict(MeasureReport(LIMIT, found))
    assert (said["verdict"], said["met"], said["achieved"]) == (verdict, met, achieved)
    assert said["drawn"] is None
    assert said["multiplier"] is None
    assert (said["worst"] is None) is (found is None)


def test_each_requirement_has_its_own_result() -> None:
    other = Limit("iae", Relation.AT_LEAST, 3.0)
    both = measure_reports((LIMIT, other), (result(), result(5.0)), (1.0, None), (DRAWN, DRAWN))
    assert [each.requirement for each in both] == [LIMIT, other]
    assert [each.multiplier for each in both] == [1.0, None]
    assert [each.result.achieved for each in both if each.result is not None] == [0.09, 5.0]
    without = measure_reports((LIMIT, other), ())
    assert [(each.result, each.multiplier, each.drawn) for each in without] == [(None, None, None)] * 2


def test_a_result_without_such_requirements_says_nothing_of_them() -> None:
    assert measures_dict(()) == {}
    assert list(measures_dict(measure_reports((LIMIT,), ()))) == ["scenario_requirements"]
