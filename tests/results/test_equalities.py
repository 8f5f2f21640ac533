"""Equalities that are missed:  by how much, in their unit, with the range to write; scores on a scale for people."""

from __future__ import annotations

import json
import math
import re

import pytest

import fopi_tune as ft
from fopi_tune.proof.verification.requirements import assess_requirement
from fopi_tune.proof.verification.results import Extreme, Place, RequirementResult
from fopi_tune.report.text.design import check_text
from fopi_tune.results.equalities import equality_notes, in_percent, shown_score
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import Relation, Requirement

EQUALITIES = """\
schema: 1
name: rounded
plant: {model: lag, static_gain: 1, time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}}
controller: {kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.3, max: 1.5}}
requirements:
  - {crossover_rad_s: {equals: 0.3}, on: nominal}
  - {phase_margin_deg: {equals: 90}, on: nominal}
  - phase_margin_deg: {at_least: 80}
"""


def missed(quantity: str, limit: float, achieved: float) -> RequirementResult:
    asked = Requirement(quantity, Relation.EQUALS, (limit,))
    return assess_requirement(asked, (Extreme(True, achieved, Place(1.0, {}, ())),) * 2, 1e-6)


def test_shares_have_two_digits_and_no_powers_of_ten() -> None:
    assert [in_percent(share) for share in (0.00024, 0.446, 0.9949, 0.996, 1.0, 12.3)] == [
        "0.024 %",
        "45 %",
        "99 %",
        "100 %",
        "100 %",
        "1230 %",
    ]


def test_published_gains_rounded_to_three_digits_are_said_to_miss_by_rounding() -> None:
    check = ft.prove(parse_spec(EQUALITIES), ft.FoPi(0.385, 0.388, 0.820))
    assert check.status == "violated"
    words = " ".join(str(check_text(check)).split())
    assert "crossover_rad_s = 0.3 is missed by 7.22e-05 rad/s (0.024 %)" in words
    assert "phase_margin_deg = 90 is missed by 0.0175 deg" in words
    assert "crossover_rad_s: {between: [0.2997, 0.3003]}" in words
    assert "phase_margin_deg: {between: [89.9, 90.1]}" in words
    assert "violated crossover_rad_s = 0.3 0.30007 0.241" in words
    assert json.loads(json.dumps(check.to_dict()))["notes"] == list(check.notes)


def test_what_is_suggested_is_met() -> None:
    gains = ft.FoPi(0.385, 0.388, 0.820)
    text = EQUALITIES
    for note in ft.prove(parse_spec(EQUALITIES), gains).notes:
        quantity, between = re.findall(r"(\w+): (\{between: .*\})", note)[0]
        text = re.sub(rf"{quantity}: \{{equals: [^}}]*\}}", f"{quantity}: {between}", text)
    assert ft.prove(parse_spec(text), gains).status == "met"


@pytest.mark.parametrize(
    ("quantity", "limit", "achieved", "score"),
    [
        ("crossover_rad_s", 2.0, 2.0 * math.exp(1e-3), 1.0),
        ("phase_margin_deg", 60.0, 59.95, 0.5),
        ("phase_slope_deg_per_decade", 0.0, 0.3, 3.0),
        ("delay_margin_s", 0.5, 0.501, 2.0),
        ("gain_margin_db", 6.0, 6.0 + 2e-3 * 20.0 / math.log(10.0), 2.0),
    ],
)
def test_a_shown_score_counts_a_thousandth_or_a_tenth_of_a_degree(
    quantity: str, limit: float, achieved: float, score: float
) -> None:
    result = missed(quantity, limit, achieved)
    assert shown_score(result.requirement, achieved) == pytest.approx(score, rel=1e-9)
    assert not result.is_met
    (note,) = equality_notes([result])
    low, high = map(float, re.findall(r"between: \[(.*), (.*)\]", note)[0])
    assert low < achieved < high
    assert low < limit < high


def test_far_from_the_limit_no_range_is_suggested_and_a_met_equality_has_no_note() -> None:
    (note,) = equality_notes([missed("crossover_rad_s", 1.0, 1.5)])
    assert note == "crossover_rad_s = 1 is missed by 0.5 rad/s (50 %)"
    assert equality_notes([missed("crossover_rad_s", 1.0, 1.0 + 1e-8)]) == ()
