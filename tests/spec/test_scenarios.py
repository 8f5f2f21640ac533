"""Designs for scenarios in the language: what is refused, where, and what to do; what such a design changes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.scenarios import designed_scenarios, every_requirement, frequency_part

HEAD = "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
DIGITAL = "digital: {sample_time_s: 0.1}\n"
ONE = "scenarios: [{name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}]\n"
TWO = (
    "scenarios:\n"
    "- {name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}\n"
    "- {name: two, duration_s: 10, reference: [{at_s: 0, value: 2}]}\n"
)
OVERSHOOT = "requirements: [{overshoot: {at_most: 0.1}}]\n"
IAE = "objective: {minimize: iae}\n"
JUMPS = "changes with the gains in jumps only and is not designed for; write limits: [{"

#: what is written -> every problem, place first
REFUSED = {
    "switch count": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{switch_count: {{at_most: 3}}}}]\n",
        ["6: requirements[0].switch_count: switch_count (1) " + JUMPS + "switch_count: {at_most: 3}}]"],
    ),
    "saturation time": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{saturation_time_s: {{at_most: 3}}}}]\n",
        ["6: requirements[0].saturation_time_s: saturation_time_s (s) " + JUMPS + "saturation_time_s: {at_most: 3}}]"],
    ),
    "quantum": (
        f"{HEAD}{DIGITAL}{OVERSHOOT}{ONE.replace('10,', '10, quantum: 0.5,')}",
        ["6: scenarios[0].quantum: no gains are designed for a quantised measurement, in which every measure jumps"],
    ),
    "quantum in the objective's": (
        f"{HEAD}{DIGITAL}{IAE}{ONE.replace('10,', '10, quantum: 0.5,')}",
        ["6: scenarios[0].quantum: no gains are designed for a quantised measurement"],
    ),
    "a continuous loop": (
        f"{HEAD}digital: {{sample_time_s: 0.1, design: continuous}}\n{OVERSHOOT}{ONE}",
        ["4: digital.design: requirements and objectives of scenarios are about the loop as it runs; write"],
    ),
    "a scenario without its measure": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{scenario: one}}]\n",
        ["6: requirements[0].scenario: scenario belongs to a measure of simulations; write it beside one"],
    ),
    "limits that contradict each other": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{iae: {{at_most: 3}}}}, {{iae: {{at_least: 4}}, scenario: one}}]\n",
        ["6: requirements[1].iae.at_least: at_least 4 on line 6 contradicts at_most 3 on line 6; relax one"],
    ),
    "limits below all values": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{iae: {{at_most: -3}}}}, {{overshoot: {{at_most: -0.1}}}}]\n",
        ["6: requirements[0].iae.at_most: -3 is never met, iae is not negative; write a limit of 0 or more"],
    ),
    "an unknown scenario": (
        f"{HEAD}{DIGITAL}requirements: [{{overshoot: {{at_most: 0.1}}, scenario: three}}]\n{TWO}",
        ["5: requirements[0].scenario: no scenario has this name; there is one, two"],
    ),
    "an objective's unknown scenario": (
        f"{HEAD}{DIGITAL}objective: {{minimize: iae, scenario: three}}\n{TWO}",
        ["5: objective.scenario: no scenario has this name; there is one, two"],
    ),
    "one of several scenarios": (
        f"{HEAD}{DIGITAL}{IAE}{TWO}",
        ["5: objective: iae of which scenario? add scenario: one (there is one, two)"],
    ),
    "no scenario": (
        f"{HEAD}{DIGITAL}{OVERSHOOT}",
        ["5: requirements[0]: there is no scenario to judge by it; add one under scenarios"],
    ),
    "no scenario of the objective": (
        f"{HEAD}{DIGITAL}{IAE}",
        ["5: objective: iae is measured in a scenario and there is none; add one under scenarios"],
    ),
    "a scenario on a loop's quantity": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{phase_margin_deg: {{at_least: 60}}, scenario: one}}]\n",
        ["6: requirements[0].scenario: phase_margin_deg is about the loop's frequency response, whatever"],
    ),
    "a scenario on a loop's objective": (
        f"{HEAD}{DIGITAL}{ONE}objective: {{minimize: iae_disturbance, scenario: one}}\n",
        ["6: objective.scenario: scenario belongs to minimize: and a measure of it, such as iae; remove it"],
    ),
    "a maximised gain's scenario": (
        f"{HEAD}{DIGITAL}{ONE}objective: {{maximize: ki, scenario: one}}\n",
        ["6: objective.scenario: scenario belongs to minimize: and a measure of it, such as iae; remove it"],
    ),
    "a maximised measure": (
        f"{HEAD}{DIGITAL}{ONE}objective: {{maximize: iae}}\n",
        ["6: objective.maximize: 'iae'"],
    ),
    "an acceleration of no velocity": (
        f"{HEAD}{DIGITAL}{ONE}requirements: [{{acceleration_m_s2: {{at_most: 2}}}}]\n",
        ["6: requirements[0].acceleration_m_s2: acceleration_m_s2 needs a measured velocity; under digital add"],
    ),
    "the least acceleration of no velocity": (
        f"{HEAD}{DIGITAL}{ONE}objective: {{minimize: acceleration_m_s2}}\n",
        ["6: objective.minimize: acceleration_m_s2 needs a measured velocity; under digital add measurement_unit"],
    ),
    "no digital controller": (
        f"{HEAD}{ONE}{OVERSHOOT}",
        ["4: scenarios: scenarios are simulated with the digital controller; add digital: {sample_time_s: 0.2}"],
    ),
    "a horizon of a measure": (
        f"{HEAD}{DIGITAL}{ONE}objective: {{minimize: iae, horizon_s: 60}}\n",
        ["6: objective.horizon_s: horizon_s belongs to minimize: iae_disturbance alone; remove it"],
    ),
    "two at once": (
        f"{HEAD}{DIGITAL}{ONE}objective: {{minimize: ki, scenario: one, horizon_s: 60}}\n",
        ["6: objective.minimize: 'ki' is not known here"],
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_designed_for_is_refused_with_what_to_do(name: str, tmp_path: Path) -> None:
    text, expected = REFUSED[name]
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    found = [f"{problem.line}: {problem.path}: {problem.message}" for problem in caught.value.problems]
    assert len(found) == len(expected), found
    for said, wanted in zip(found, expected, strict=True):
        assert said.startswith(wanted), said
    # the same through the command line
    file = tmp_path / "s.yaml"
    file.write_text(text, encoding="utf-8")
    result = CliRunner().invoke(app, ["tune", str(file)])
    assert result.exit_code == 2
    assert expected[0].split(": ")[1] in result.stderr.replace("\n", "")


def test_a_quantum_elsewhere_is_none_of_the_designs_business() -> None:
    text = f"{HEAD}{DIGITAL}requirements: [{{overshoot: {{at_most: 0.1}}, scenario: two}}]\n{TWO}"
    spec = parse_spec(text.replace("name: one,", "name: one, quantum: 0.5,"))
    assert [each.name for each in designed_scenarios(spec)] == ["two"]


def test_noise_is_no_reason_to_refuse() -> None:
    spec = parse_spec(f"{HEAD}{DIGITAL}{OVERSHOOT}{ONE.replace('10,', '10, noise_std: 0.5,')}")
    assert spec.scenarios[0].noise_std == 0.5


def test_such_a_design_is_on_samples() -> None:
    spec = parse_spec(HEAD + DIGITAL + OVERSHOOT + ONE)
    assert spec.digital is not None
    assert spec.digital.designs_sampled
    plain = parse_spec(HEAD + DIGITAL + ONE + "requirements: [{phase_margin_deg: {at_least: 60}}]\n")
    assert plain.digital is not None
    assert not plain.digital.designs_sampled


def test_the_loops_part_of_a_spec() -> None:
    text = f"{HEAD}{DIGITAL}{ONE}requirements:\n- phase_margin_deg: {{at_least: 60}}\n- overshoot: {{at_most: 1}}\n"
    for objective, kept in ((IAE, False), ("objective: {maximize: ki}\n", True), ("", False)):
        spec = parse_spec(text + objective)
        loop = frequency_part(spec)
        assert (loop.requirements, loop.scenario_requirements) == (spec.requirements, ())
        assert (loop.objective is not None) is kept
        assert [type(each).__name__ for each in every_requirement(spec)] == ["Requirement", "Limit"]
    plain = parse_spec(HEAD + "objective: {maximize: ki}\n")
    assert frequency_part(plain) is plain


DESIGNED = (
    f"{HEAD}digital: {{sample_time_s: 0.1, output_limits: [-3, 3]}}\nrequirements:\n"
    "- phase_margin_deg: {at_least: 60}\n"
    f"- {{overshoot: {{at_most: 0.1}}, scenario: one}}\nobjective: {{minimize: iae, scenario: one}}\n{TWO}"
)


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("scenario: one}\n- ", "scenario: one}\n- ", set()),
        ("at_most: 0.1", "at_most: 0.2", {"requirements", "scenarios"}),
        ("value: 1}", "value: 1.5}", {"requirements", "scenarios"}),
        # of a scenario that nothing is designed for, only what is simulated
        ("value: 2}", "value: 2.5}", {"scenarios"}),
        ("minimize: iae,", "minimize: ise,", {"objective"}),
        # the control's limits change what scenarios measure
        ("[-3, 3]", "[-3, 4]", {"loop", "digital"}),
        ("time_constant_s: 2", "time_constant_s: 3", {"plant"}),
    ],
)
def test_digests_change_with_what_the_design_depends_on(old: str, new: str, changed: set[str]) -> None:
    before, after = digests_of(parse_spec(DESIGNED)), digests_of(parse_spec(DESIGNED.replace(old, new, 1)))
    assert {part for part in before if before[part] != after[part]} == changed


def test_the_objectives_scenario_counts_as_written_where_it_is_the_only_one() -> None:
    short = parse_spec(HEAD + DIGITAL + ONE + IAE)
    long = parse_spec(HEAD + DIGITAL + ONE + "objective: {minimize: iae, scenario: one}\n")
    assert digests_of(short) == digests_of(long)
    assert dataclasses.replace(short, text_sha256="") == dataclasses.replace(long, text_sha256="")


def test_limits_of_different_scenarios_do_not_contradict_each_other() -> None:
    both = "[{iae: {at_most: 3}, scenario: one}, {iae: {at_least: 4}, scenario: two}]"
    spec = parse_spec(f"{HEAD}{DIGITAL}{TWO}requirements: {both}\n")
    assert [limit.scenario for limit in spec.scenario_requirements] == ["one", "two"]
