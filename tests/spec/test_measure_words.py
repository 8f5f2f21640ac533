"""Measures of simulations where they do not belong: the message has what to write instead, and where."""

from __future__ import annotations

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.measures import DESIGNED_MEASURES, MEASURES
from fopi_tune.spec.model import Relation

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


@pytest.mark.parametrize("name", DESIGNED_MEASURES)
def test_a_measure_under_requirements_is_one_of_them(name: str) -> None:
    spec = parse_spec(
        f"{HEAD}{SIMULATED}requirements:\n- {name}: {{at_most: 3}}\n- {{{name}: {{at_least: 1}}, scenario: s}}\n"
    )
    most, least = spec.scenario_requirements
    assert (most.measure, most.relation, most.limit, most.scenario) == (name, Relation.AT_MOST, 3.0, None)
    assert (least.measure, least.relation, least.limit, least.scenario) == (name, Relation.AT_LEAST, 1.0, "s")
    assert (spec.requirements, spec.limits) == ((), ())
    assert spec.designs_scenarios


@pytest.mark.parametrize("name", sorted(set(MEASURES) - set(DESIGNED_MEASURES)))
def test_a_count_under_requirements_is_sent_to_limits(name: str) -> None:
    found = message(f"{HEAD}{SIMULATED}requirements:\n- {name}: {{at_most: 3}}\n")
    advised = f"limits: [{{{name}: {{at_most: 3}}}}]"
    assert "changes with the gains in jumps only and is not designed for" in found
    assert advised in found
    # what is advised is a spec
    spec = parse_spec(HEAD + REQUIREMENT + SIMULATED + advised + "\n")
    assert (spec.limits[0].measure, spec.limits[0].limit) == (name, 3.0)


@pytest.mark.parametrize(
    ("written", "advised"),
    [
        ("settling_time: {at_most: 5}", "write {settling_time_s: {at_most: 5}} (s), and what to simulate"),
        ("max_overshoot: 0.1", "write {overshoot: {at_most: 0.1}} (output unit)"),
        # 10 of another unit is not repeated
        ("overshoot_percent: {at_most: 10}", "write {overshoot: {at_most: ...}} (output unit)"),
        ("steady_state_error: {at_most: 0.01}", "write {final_error: {at_most: 0.01}}"),
        ("rise_time: {at_most: 1}", "write {rise_time_s: {at_most: 1}}"),
        ("risetime_ms: {at_most: 100}", "write {rise_time_s: {at_most: ...}}"),
        ("undershoot_percent: 5", "write {undershoot: {at_most: ...}}"),
        ("saturation: {at_most: 1}", "limits: [{saturation_time_s: {at_most: 1}}]"),
        ("decay_ratio: {at_most: 0.25}", "neither a requirement nor a measure"),
        ("bandwidth: {at_least: 1}", "write crossover_rad_s (rad/s)"),
        ("settling_time_s: 5", "write one such as {at_most: 2.0}"),
    ],
)
def test_other_words_for_measures_are_understood(written: str, advised: str) -> None:
    assert advised in message(f"{HEAD}{SIMULATED}requirements:\n- {written}\n")


def test_a_scenario_on_a_requirement_of_the_loop() -> None:
    found = message(f"{HEAD}{SIMULATED}requirements:\n- {{phase_margin_deg: {{at_least: 60}}, scenario: s}}\n")
    assert found == "phase_margin_deg is about the loop's frequency response, whatever is simulated; remove the key"


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


@pytest.mark.parametrize("name", DESIGNED_MEASURES)
def test_a_measure_as_an_objective_is_of_the_only_scenario(name: str) -> None:
    spec = parse_spec(f"{HEAD}{SIMULATED}objective: {{minimize: {name}}}\n")
    assert spec.objective is not None
    assert (spec.objective.quantity, spec.objective.scenario) == (name, "s")
    assert spec.digital is not None
    assert spec.digital.designs_sampled


@pytest.mark.parametrize(
    ("written", "advised"),
    [
        ("minimize: settling_time", "did you mean 'settling_time_s'?"),
        ("minimize: max_settling", "write minimize: settling_time_s, with scenario: and the scenario's name"),
        ("minimize: overshoot_percent", "write minimize: overshoot, with scenario: and the scenario's name"),
        ("minimize: switch_count", "'switch_count' is not optimised; switch_count can be limited under limits"),
        ("minimize: decay_ratio", "'decay_ratio' is not optimised; overshoot can be limited under limits"),
    ],
)
def test_other_words_for_objectives_are_understood(written: str, advised: str) -> None:
    assert advised in message(f"{HEAD}{SIMULATED}objective: {{{written}}}\n")
