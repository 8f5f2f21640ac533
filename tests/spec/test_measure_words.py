"""Measures of simulations where they do not belong: the message has what to write instead, and where."""

from __future__ import annotations

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import MEASURES

HEAD = "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
REQUIREMENT = "requirements: [{phase_margin_deg: {at_least: 60}}]\n"
SIMULATED = """digital: {sample_time_s: 0.1, measurement_unit: m/s}
scenarios: [{name: s, duration_s: 10, reference: [{at_s: 0, value: 1}]}]
"""


def message(text: str) -> str:
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    (problem,) = caught.value.problems
    return problem.message


@pytest.mark.parametrize("name", MEASURES)
def test_every_measure_under_requirements_is_sent_to_limits(name: str) -> None:
    found = message(f"{HEAD}requirements:\n- {name}: {{at_most: 3}}\n")
    advised = f"limits: [{{{name}: {{at_most: 3}}}}]"
    assert advised in found
    # what is advised is a spec
    spec = parse_spec(HEAD + REQUIREMENT + SIMULATED + advised + "\n")
    assert (spec.limits[0].measure, spec.limits[0].limit) == (name, 3.0)


@pytest.mark.parametrize(
    ("written", "advised"),
    [
        ("settling_time: {at_most: 5}", "limits: [{settling_time_s: {at_most: 5}}]"),
        ("settling_time_s: 5", "limits: [{settling_time_s: {at_most: 5}}]"),
        ("max_overshoot: 0.1", "limits: [{overshoot: {at_most: 0.1}}]"),
        # 10 of another unit is not repeated
        ("overshoot_percent: {at_most: 10}", "overshoot (output unit) is measured in simulations"),
        ("overshoot_percent: {at_most: 10}", "limits: [{overshoot: {at_most: ...}}]"),
        ("steady_state_error: {at_most: 0.01}", "limits: [{final_error: {at_most: 0.01}}]"),
        ("rise_time: {at_most: 1}", "limits: [{rise_time_s: {at_most: 1}}]"),
        ("risetime_ms: {at_most: 100}", "limits: [{rise_time_s: {at_most: ...}}]"),
        ("undershoot_percent: 5", "limits: [{undershoot: {at_most: ...}}]"),
        ("decay_ratio: {at_most: 0.25}", "neither a requirement nor a measure"),
        ("bandwidth: {at_least: 1}", "write crossover_rad_s (rad/s)"),
    ],
)
def test_other_words_for_measures_are_understood(written: str, advised: str) -> None:
    assert advised in message(f"{HEAD}requirements:\n- {written}\n")


def test_a_limit_with_its_scenario_among_the_requirements() -> None:
    with pytest.raises(SpecError) as caught:
        parse_spec(f"{HEAD}requirements:\n- overshoot: {{at_most: 1}}\n  scenario: s\n")
    assert [problem.path for problem in caught.value.problems] == [
        "requirements[0].overshoot",
        "requirements[0].scenario",
    ]
    assert all("limits" in problem.message for problem in caught.value.problems)


@pytest.mark.parametrize(
    ("written", "advised"),
    [
        ("phase_margin_deg: {at_least: 60}", "phase_margin_deg is a requirement; write it under requirements"),
        ("overshoot_percent: {at_most: 5}", "write overshoot (output unit)"),
        ("overshoot: < 5", "write {at_most: 5}"),
        ("overshoot: [1, 5]", "write two: {at_least: 1}, {at_most: 5}"),
    ],
)
def test_limits_that_are_written_otherwise(written: str, advised: str) -> None:
    assert message(f"{HEAD}{REQUIREMENT}{SIMULATED}limits:\n- {written}\n").endswith(advised)


def test_a_measure_as_an_objective() -> None:
    assert "iae_disturbance is close to it" in message(f"{HEAD}objective: {{minimize: iae}}\n")
    assert "overshoot can be limited under limits" in message(f"{HEAD}objective: {{minimize: overshoot}}\n")
