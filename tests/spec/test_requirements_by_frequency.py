"""Limits by the frequency:  points become lines, each a requirement, and mistakes are told with their places."""

from __future__ import annotations

import math

import jsonschema
import pytest
from ruamel.yaml import YAML

import fopi_tune as ft
from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.language import json_schema
from fopi_tune.spec.model import Relation

HEAD = """schema: 1
name: x
plant: {model: lag, static_gain: 1, time_constant_s: 2}
controller: {kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: 1}
requirements:
"""
SHAPED = "{at_most: {by_frequency: [[0.01, -40], [0.1, -20], [1, -20], [10, 3]]}}"


def spec_with(*requirements: str, more: str = "") -> ft.DesignSpec:
    return parse_spec(HEAD + "".join(f"  - {{{each}}}\n" for each in requirements) + more)


def test_points_become_lines_that_are_straight_over_the_logarithm_of_the_frequency() -> None:
    first, flat, last = spec_with(f"sensitivity_db: {SHAPED}, on: nominal").requirements
    assert {each.relation for each in (first, flat, last)} == {Relation.AT_MOST}
    assert [(each.from_rad_s, each.to_rad_s) for each in (first, flat, last)] == [(0.01, 0.1), (0.1, 1.0), (1.0, 10.0)]
    assert [(each.limits, each.end_limit) for each in (first, flat, last)] == [
        ((-40,), -20),
        ((-20,), None),
        ((-20,), 3),
    ]
    assert first.limit_at(0.01) == -40.0
    assert first.limit_at(0.01 * math.sqrt(10.0)) == pytest.approx(-30.0)
    assert first.limit_at(0.1) == pytest.approx(-20.0)
    # 3 dB below the limit at 0.05 rad/s is told as 3 dB below that at 0.01 rad/s
    assert first.value_at(-43.0, 0.05) == pytest.approx(first.limit_at(0.05) - 3.0)
    # what rounding leaves of 0 dB is 0 dB
    (falling,) = spec_with("sensitivity_db: {at_most: {by_frequency: [[10, 0], [1000, -40]]}}").requirements
    assert falling.limit_at(math.nextafter(10.0, 20.0)) == 0.0
    moved = first.moved((-42.0,))
    assert (moved.limits, moved.end_limit) == ((-42.0,), -22.0)


def test_the_schema_knows_the_word() -> None:
    document = YAML(typ="safe", pure=True).load(HEAD + f"  - {{sensitivity_db: {SHAPED}}}\n")
    validator = jsonschema.Draft202012Validator(json_schema())
    validator.validate(document)
    document["requirements"][0]["sensitivity_db"]["at_most"]["by_frequency"] = [[0.1, 3]]
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(document)


def test_specs_without_lines_keep_their_digests_and_lines_have_their_own() -> None:
    constant = digests_of(spec_with("sensitivity_db: {at_most: -20}, from_rad_s: 0.1, to_rad_s: 1"))
    assert constant == digests_of(spec_with("sensitivity_db: {at_most: {by_frequency: [[0.1, -20], [1, -20]]}}"))
    assert constant != digests_of(spec_with("sensitivity_db: {at_most: {by_frequency: [[0.1, -20], [1, -19]]}}"))


@pytest.mark.parametrize(
    ("requirement", "said"),
    [
        ("sensitivity_db: {at_most: {by_frequency: [[0.1, 3]]}}", "6:47: requirements[0].sensitivity_db.at_most"),
        ("sensitivity_db: {at_most: {by_frequency: [[0.1, 3], [0.1, 4]]}}", "frequencies must increase"),
        ("sensitivity_db: {at_most: {by_frequency: [[0, 3], [0.1, 4]]}}", "a frequency must be greater than 0"),
        ("sensitivity_db: {at_most: {by_frequency: [[0.1, 3], [1]]}}", "the list has 1 entry"),
        ("sensitivity_db: {at_most: {by_frequency: [[0.1, 3], [1, x]]}}", "'x' is not a number"),
        ("sensitivity_db: {at_most: {by_frequency: [[0.1, 3], [1, 2]]}}, to_rad_s: 3", "is given beside by_frequency"),
        ("sensitivity_db: {between: {by_frequency: [[0.1, 3], [1, 2]]}}", "list"),
        ("sensitivity_db: {equals: {by_frequency: [[0.1, 3], [1, 2]]}}", "number"),
        ("phase_margin_deg: {at_least: {by_frequency: [[0.1, 3], [1, 2]]}}", "number"),
        ("sensitivity_db: {at_most: {by_freq: [[0.1, 3], [1, 2]]}}", "by_frequency"),
    ],
)
def test_mistakes_are_told_with_their_places(requirement: str, said: str) -> None:
    with pytest.raises(SpecError) as caught:
        spec_with(requirement)
    assert said in str(caught.value)


def test_a_line_that_reaches_nyquists_frequency_is_refused_on_samples() -> None:
    shaped = "sensitivity_db: {at_most: {by_frequency: [[0.1, 3], [%s, 4]]}}"
    digital = "digital: {sample_time_s: 0.1, design: sampled}\n"
    assert len(spec_with(shaped % 31, more=digital).requirements) == 1
    with pytest.raises(SpecError, match=r"reaches to Nyquist's frequency, 31\.4159 rad/s"):
        spec_with(shaped % 32, more=digital)


def test_the_convex_path_refuses_lines_by_name() -> None:
    spec = spec_with(
        "sensitivity_db: {at_most: {by_frequency: [[0.1, 3], [1, 4]]}}", more="objective: {maximize: ki}\n"
    )
    design = ft.tune(spec, solver=ft.Solver.CONVEX)
    assert design.status is not ft.Status.SOLVED
    assert "does not know sensitivity_db by_frequency" in design.message
