"""Requirements on scenarios in the terminal's table."""

from __future__ import annotations

import math

import pytest

from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.proof.verification.results import MeasureResult, Place
from fopi_tune.report.text.design import requirement_lines
from fopi_tune.report.text.formatting import TIE
from fopi_tune.report.text.measures import about_phrase, limit_phrase, limit_scope_phrase, measure_phrase
from fopi_tune.results.measures import MeasureReport
from fopi_tune.spec.model import Limit, Relation, Requirement

PLACE = Place(None, {"static_gain": 1.2}, (1.2,))
DRAWN = Fraction(10000, 10000, 0.9994703, 1.0, 0.9995, 1.0, 0.99)


def report(
    achieved: float | None, *, met: bool = True, limit: float = 0.1, scenario: str | None = "step",
    time_s: float | None = 2.4, multiplier: float | None = None, drawn: Fraction | None = None, place: Place = PLACE,
    measure: str = "overshoot", relation: Relation = Relation.AT_MOST,
) -> MeasureReport:  # fmt: skip
    asked = Limit(measure, relation, limit, scenario)
    found = None
    if achieved is not None:
        score = 0.5 if met else 2.0 if math.isfinite(achieved) else math.inf
        found = MeasureResult(asked, "step", achieved, score, place, time_s, met, 1029)
    return MeasureReport(asked, found, multiplier, drawn)


def table(*reports: MeasureReport, objective: float | None = 1.0) -> str:
    lines = [line for line, _ in requirement_lines([], objective, reports)]
    assert all(len(line) <= 80 for line in lines)
    return "\n".join(lines).replace(TIE, " ")


def words(*reports: MeasureReport, objective: float | None = 1.0) -> str:
    return " ".join(table(*reports, objective=objective).split())


def test_the_lines_of_a_checked_requirement() -> None:
    header, first, *_ = table(report(0.09, multiplier=38.219, drawn=DRAWN)).strip("\n").split("\n")
    # in the columns of the other requirements
    for name, value in (("achieved", "0.09"), ("score", "0.500"), ("multiplier", "38.2")):
        assert header.index(name) + len(name) == first.index(value) + len(value)
    assert first.startswith("checked   overshoot <= 0.1 ")
    assert words(report(0.09, drawn=DRAWN)).count(
        "family, scenario step; worst at 2.4 s with static_gain = 1.2; 10000 of 10000 drawn plants meet it "
        "(99.94 .. 100 %)"
    )


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (report(None), "open overshoot <= 0.1 - - family, scenario step"),
        (report(0.2, met=False), "violated overshoot <= 0.1 0.2 2.000 family, scenario step; worst at 2.4 s with"),
        (
            report(math.inf, met=False, time_s=None),
            "violated overshoot <= 0.1 never - family, scenario step; worst with",
        ),
        # a missed limit is not printed as if it were reached
        (report(0.1000004, met=False), "violated overshoot <= 0.1 0.1000004 2.000"),
        (report(0.09, scenario=None), "family, every scenario; worst in step at 2.4 s with static_gain = 1.2"),
        (report(5.0, relation=Relation.AT_LEAST, limit=3.0), "checked overshoot >= 3 5 0.500"),
        (report(0.09, time_s=None, place=Place(None, {}, ())), "family, scenario step; one plant"),
        (report(0.09, place=Place(None, {}, ())), "family, scenario step; worst at 2.4 s"),
    ],
)
def test_what_is_told(said: MeasureReport, expected: str) -> None:
    assert expected in words(said)


def test_drawn_plants_are_of_a_family_of_several() -> None:
    assert "drawn plants" not in words(report(0.09, drawn=DRAWN, place=Place(None, {}, ())))


def test_a_multiplier_that_is_rounding_is_0() -> None:
    assert words(report(0.09, multiplier=1e-7), objective=100.0).split("0.500 ")[1].startswith("0 ")
    assert words(report(0.09, multiplier=0.5), objective=100.0).split("0.500 ")[1].startswith("0.5 ")


def test_a_long_name_has_a_line_of_its_own() -> None:
    found = table(report(2.0, measure="acceleration_m_s2", limit=1.2345678901234))
    assert "checked   acceleration_m_s2 <= 1.23456789" in found


def test_phrases() -> None:
    limit = Limit("settling_time_s", Relation.AT_MOST, 12.0)
    assert measure_phrase(limit) == "settling_time_s <= 12"
    assert about_phrase(limit) == "family, every scenario"
    assert (limit_phrase(limit), limit_scope_phrase(limit)) == ("settling_time_s <= 12", "family, every scenario")
    margin = Requirement("phase_margin_deg", Relation.AT_LEAST, (60.0,))
    assert (limit_phrase(margin), limit_scope_phrase(margin)) == ("phase_margin_deg >= 60", "family")
