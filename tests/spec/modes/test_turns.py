"""Where two modes take turns, as it is written: a hysteresis, two thresholds, a band to coast in."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import pytest
from cases.two_modes import rig, write
from ruamel.yaml import YAML

from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.errors import SpecError
from fopi_tune.spec.load import load_system
from fopi_tune.spec.systems import system_json_schema

RELATIVE = "to_fan_above: 0.5\nto_heater_below: {relative: 0.1}"
MIXED = "to_fan_above: {absolute: 12}\nto_heater_below: -0.2"
COASTING = "to_fan_above: 0.6\nto_heater_below: -0.4\ncoast: true"
BAND = f"{COASTING}\ncoast_above: {{relative: 0.2}}\ncoast_below: {{absolute: 3}}"
WITH_HYSTERESIS = "hysteresis: 0.5\ncoast: true\ncoast_above: 0.1"
UNDERSTOOD = {
    "hysteresis: 0.3": SwitchingLines(Threshold(0.3), Threshold(-0.3)),
    "to_fan_above: 0.3\nto_heater_below: -0.3\ncoast: false": SwitchingLines(Threshold(0.3), Threshold(-0.3)),
    RELATIVE: SwitchingLines(Threshold(0.5), Threshold(0.1)),
    MIXED: SwitchingLines(Threshold(12.0, True), Threshold(-0.2)),
    COASTING: SwitchingLines(Threshold(0.6), Threshold(-0.4), Threshold(0.0), Threshold(0.0)),
    BAND: SwitchingLines(Threshold(0.6), Threshold(-0.4), Threshold(0.2), Threshold(3.0, True)),
    WITH_HYSTERESIS: SwitchingLines(Threshold(0.5), Threshold(-0.5), Threshold(0.1), Threshold(0.0)),
}


@pytest.mark.parametrize(("turns", "lines"), UNDERSTOOD.items())
def test_lines_are_understood_as_meant(tmp_path: Path, turns: str, lines: SwitchingLines) -> None:
    assert rig(tmp_path, turns=turns).lines == lines


def test_two_lines_beside_the_setpoint_are_a_hysteresis(tmp_path: Path) -> None:
    assert rig(tmp_path, turns="to_fan_above: 0.3\nto_heater_below: -0.3").hysteresis == 0.3


def test_lines_have_the_names_of_the_modes(tmp_path: Path) -> None:
    system = rig(tmp_path, ("fill", "drain"), "to_drain_above: 1\nto_fill_below: 0.5")
    assert system.lines.named("fill", "drain") == {"to_drain_above": Threshold(1.0), "to_fill_below": Threshold(0.5)}


REFUSED = {
    "first: fan": "system.hysteresis: the key is missing; add it; to_fan_above and to_heater_below may be written in",
    "to_fan_above: 1": "system.to_heater_below: the key is missing; add it",
    "hysteresis: 1\nto_fan_above: 1": "system.to_fan_above: hysteresis says where the modes take turns; remove one",
    "to_fan_above: 0.1\nto_heater_below: 0.2": "system.to_fan_above: to_fan_above (0.1) must lie above "
    "to_heater_below (0.2): what is between would be left as soon as it is entered",
    "to_fan_above: {absolute: 4}\nto_heater_below: {absolute: 5}": "system.to_fan_above: to_fan_above ({absolute: 4}) "
    "must lie above to_heater_below ({absolute: 5})",
    "to_heater_above: 1\nto_heater_below: 0": "system.to_heater_above: the heater raises the output and is entered "
    "below; write to_heater_below",
    "to_fan_above: 1\nto_heater_below: 0\ncoast_above: 0.5": "system.coast_above: nothing coasts; add coast: true",
    "to_fan_above: 2\nto_heater_below: 1\ncoast: true": "system.to_heater_below: coast_above (0) must lie above "
    "to_heater_below (1)",
    "to_fan_above: 2\nto_heater_below: -1\ncoast: true\ncoast_above: 3": "system.to_fan_above: to_fan_above (2) must "
    "not lie below coast_above (3): that mode would never coast",
    "hysteresis: 0\ncoast: true": "system.hysteresis: between its two lines nothing can coast; write one greater",
    "hysteresis: 1\ncoast: true\ncoast_below: 1": "system.coast_below: the upper line (1) must lie above coast_below",
    "hysteresis: 1\ncoast: yes": "system.coast: 'yes' is neither true nor false",
    "to_fan_above: {above: 1}\nto_heater_below: 0": "system.to_fan_above",
    "to_fan_above: {absolute: 5}\nto_heater_below: 0": "system.to_fan_above: at the setpoint 8 of scenario day "
    "to_fan_above is 5 and to_heater_below 8: between them a mode is left as soon as it is entered",
}


@pytest.mark.parametrize(("turns", "said"), REFUSED.items())
def test_what_makes_no_sense_is_told(tmp_path: Path, turns: str, said: str) -> None:
    with pytest.raises(SpecError) as refused:
        load_system(write(tmp_path, turns=turns))
    found = refused.value.problems[0]
    assert f"{found.path}: {found.message}".startswith(said)


def test_a_control_that_cannot_rest_at_0_cannot_coast(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"the fan's control rests at 0, which its limits \[-1.0, -0.1\] do not have"):
        load_system(write(tmp_path, turns=COASTING, limits=("[0, 1]", "[-1, -0.1]")))


@pytest.mark.parametrize("turns", UNDERSTOOD)
def test_the_schema_takes_what_is_understood(tmp_path: Path, turns: str) -> None:
    document = YAML(typ="safe", pure=True).load(write(tmp_path, turns=turns).read_text())
    jsonschema.validate(document, system_json_schema())


@pytest.mark.parametrize("turns", ["first: fan", "to_fan_above: 1", "hysteresis: 1\nto_fan_above: {above: 1}"])
def test_the_schema_refuses_what_is_not(tmp_path: Path, turns: str) -> None:
    document = YAML(typ="safe", pure=True).load(write(tmp_path, turns=turns).read_text())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, system_json_schema())


@pytest.mark.parametrize(
    ("turns", "wrong", "right"),
    [
        ("to_brake_above: 1\nto_heater_below: -1", "to_brake_above", "to_fan_above"),
        ("to_fan_above: 1\nto_traction_below: -1", "to_traction_below", "to_heater_below"),
        ("hysteresis: 0.3\nto_brake_above: 1", "to_brake_above", "to_fan_above"),
    ],
)
def test_lines_of_other_modes_are_told_with_what_is_meant(tmp_path: Path, turns: str, wrong: str, right: str) -> None:
    with pytest.raises(SpecError) as refused:
        load_system(write(tmp_path, turns=turns))
    said = [f"{each.path}: {each.message}" for each in refused.value.problems]
    assert f"system.{wrong}: the modes are called heater and fan; did you mean {right}?" in said
