"""Requirements of systems that are none: where they belong."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases.two_modes import write as rig_file

from fopi_tune.errors import SpecError
from fopi_tune.spec.load import load_system

_MODE = "schema: 1\nname: m\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\ndigital: {sample_time_s: 0.1}\n"
_SYSTEM = """\
schema: 1
name: s
system: {{throttle: {{spec: mode.yaml}}, brake: {{spec: mode.yaml}}, hysteresis: 0.5}}
tune: [brake]
scenarios: [{{name: one, duration_s: 10, reference: [{{at_s: 0, value: 1}}]}}]
requirements: [{requirements}]
objective: {{minimize: iae}}
"""
REFUSED = {
    "{sensitivity_db: {at_most: 3}}": "sensitivity_db: sensitivity_db is about the frequency response of one loop",
    "{switch_count: {at_most: 3}}": "switch_count: switch_count (1) changes with the gains in jumps only and is not",
    "{scenario: one}": "scenario: scenario belongs to a measure of simulations",
    "{iae: {at_most: 3}}, {iae: {at_least: 4}}": "iae.at_least: at_least 4 on line 6 contradicts at_most 3 on line 6",
}


@pytest.mark.parametrize("requirements", REFUSED)
def test_what_is_no_requirement_of_a_system(tmp_path: Path, requirements: str) -> None:
    (tmp_path / "mode.yaml").write_text(f"{_MODE}requirements: [{{phase_margin_deg: {{at_least: 45}}}}]\n")
    (tmp_path / "s.yaml").write_text(_SYSTEM.format(requirements=requirements))
    with pytest.raises(SpecError) as refused:
        load_system(tmp_path / "s.yaml")
    (problem,) = refused.value.problems
    assert f"{problem.path}: {problem.message}".partition(".")[2].startswith(REFUSED[requirements])


@pytest.mark.parametrize("beside", ["limits: [{iae: {at_most: 3}}]", "requirements: [{iae: {at_most: 3}}]"])
def test_a_scenario_that_cannot_be_read_is_not_missed_by_what_is_about_it(tmp_path: Path, beside: str) -> None:
    path = rig_file(tmp_path, more=f"tune: [fan]\nobjective: {{minimize: iae, scenario: day}}\n{beside}")
    path.write_text(path.read_text(encoding="utf-8").replace("duration_s: 40", "duration_s: -40"), encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        load_system(path)
    assert not [
        str(each) for each in caught.value.problems if "no scenario" in str(each) or "there is none" in str(each)
    ]
    assert "duration_s: -40 is out of range" in str(caught.value)


def test_an_objective_without_gains_to_tune_is_told_the_systems_own_modes(tmp_path: Path) -> None:
    path = rig_file(tmp_path, more="objective: {minimize: iae}")
    with pytest.raises(SpecError, match=r"whose gains\? add tune: with the names of one mode or both, such as \[fan\]"):
        load_system(path)
