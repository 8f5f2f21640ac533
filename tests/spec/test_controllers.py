"""The setpoint's weight in specs: which parts of a spec depend on it, and where it is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import DESIGN_PARTS, DIGITAL_PARTS, digests_of
from fopi_tune.spec.load import load_system

SPEC = """\
schema: 1
name: a
plant: {model: lag, static_gain: 1, time_constant_s: 2}
digital: {sample_time_s: 0.1, design: sampled}
requirements: [{phase_margin_deg: {at_least: 60}}]
scenarios: [{name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}]
"""
PID = "structure: pid, derivative_filter_time_constant_s: 0.2"


@pytest.mark.parametrize("structure", ["structure: fopi", "structure: pi", PID])
def test_every_structure_takes_any_finite_weight(structure: str) -> None:
    for weight in (0, 0.5, 1, 1.5, -1):
        assert (
            parse_spec(f"{SPEC}controller: {{{structure}, setpoint_weight: {weight}}}\n").controller.setpoint_weight
            == weight
        )
    assert parse_spec(f"{SPEC}controller: {{{structure}}}\n").controller.setpoint_weight == 1.0


@pytest.mark.parametrize("structure", ["structure: fopi", PID])
def test_what_runs_depends_on_the_weight_and_the_loop_does_not(structure: str) -> None:
    plain, one, half = (
        digests_of(parse_spec(f"{SPEC}controller: {{{structure}{weight}}}\n"))
        for weight in ("", ", setpoint_weight: 1", ", setpoint_weight: 0.5")
    )
    assert plain == one
    assert {part for part in plain if plain[part] != half[part]} == {"digital"}
    assert "digital" in set(DIGITAL_PARTS) - set(DESIGN_PARTS)


def test_a_weight_beside_requirements_about_scenarios_is_refused() -> None:
    for line in ("objective: {minimize: iae, scenario: one}\n", ""):
        text = (
            SPEC
            if line
            else SPEC.replace("at_least: 60}}]", "at_least: 60}}, {overshoot: {at_most: 0.2}, scenario: one}]")
        )
        with pytest.raises(SpecError, match="with setpoint_weight: 1 in this version"):
            parse_spec(f"{text}{line}controller: {{setpoint_weight: 0.5}}\n")


def test_a_weight_in_a_mode_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mode.yaml").write_text(SPEC + "controller: {setpoint_weight: 0.5}\n")
    (tmp_path / "s.yaml").write_text(
        "schema: 1\nname: s\n"
        "system: {throttle: {spec: mode.yaml}, brake: {spec: mode.yaml}, hysteresis: 0.5}\n"
        "scenarios: [{name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}]\n"
    )
    with pytest.raises(SpecError, match="a mode's controller has setpoint_weight: 1"):
        load_system(tmp_path / "s.yaml")
