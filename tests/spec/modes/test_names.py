"""Any names of the two modes of a system."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import pytest
from cases.two_modes import rig, write
from ruamel.yaml import YAML

from fopi_tune.errors import SpecError
from fopi_tune.spec.load import load_system
from fopi_tune.spec.systems import system_json_schema


def problem(path: Path) -> str:
    with pytest.raises(SpecError) as refused:
        load_system(path)
    (found,) = refused.value.problems
    return f"{found.path}: {found.message}"


def test_the_mode_that_is_written_first_raises_the_output(tmp_path: Path) -> None:
    system = rig(tmp_path, ("pump", "drain_2"), "hysteresis: 0.3\nfirst: drain_2", more="validation: {samples: 5}")
    assert [mode.name for mode in system.modes] == ["pump", "drain_2"]
    assert system.first == "drain_2"
    assert system.family.uncertain_names == ("pump.time_constant_s", "drain_2.time_constant_s")
    assert rig(tmp_path, ("pump", "drain")).first == "pump"


def test_throttle_and_brake_keep_their_meaning_in_either_order(tmp_path: Path) -> None:
    for names in (("throttle", "brake"), ("brake", "throttle")):
        system = rig(tmp_path, names, limits=("[-1, 1]", "[-1, 1]"))
        assert [mode.name for mode in system.modes] == ["throttle", "brake"]
        assert system.first == "throttle"


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("Heater", "fan"), "system.Heater: 'Heater' cannot be the name of a mode: a mode's name is lower-case"),
        (("throttel", "brake"), "system.throttel: the mode is called throttle; mend the name"),
        (("fan_", "fan"), "system.fan: fan_ and fan differ by underscores only"),
    ],
)
def test_names_that_cannot_be_used_are_told(tmp_path: Path, names: tuple[str, str], said: str) -> None:
    assert problem(write(tmp_path, names)).startswith(said)


def test_one_mode_or_three_are_told(tmp_path: Path) -> None:
    path = write(tmp_path)
    text = path.read_text()
    path.write_text(text.replace("  hysteresis", "  cellar: {spec: fan.yaml}\n  hysteresis"))
    said = "system.cellar: a third mode is written; two loops take turns: leave two of 'heater', 'fan', 'cellar'"
    assert problem(path) == said
    alone = "\n".join(line for line in text.splitlines() if not line.startswith("  fan"))
    path.write_text(alone)
    said = "system: there is only the mode heater; two loops take turns: write a mapping for each, such as {throttle:"
    assert problem(path).startswith(said)
    path.write_text(alone.replace("  hysteresis", "  fan: fan.yaml\n  hysteresis"))
    assert problem(path).endswith("; fan is a mode as {spec: ...}")
    path.write_text(alone.replace("heater", "throttle"))
    assert problem(path) == "system.brake: the key is missing; add it, or another mode beside throttle"


def test_names_of_modes_that_are_none_are_told_with_those_there_are(tmp_path: Path) -> None:
    for turns, more, said in (
        ("hysteresis: 0.3\nfirst: brake", "", "system.first: 'brake' is not known here; write heater or fan"),
        ("hysteresis: 0.3", "tune: [brake]\nobjective: {minimize: iae}", "tune[0]: 'brake' is not known here"),
        (
            "hysteresis: 0.3",
            "validation: {samples: 5, distributions: {brake.time_constant_s: uniform}}",
            "validation.distributions.brake.time_constant_s: ",
        ),
    ):
        assert problem(write(tmp_path, turns=turns, more=more)).startswith(said)


def test_other_mistakes_are_told_beside_a_missing_mode(tmp_path: Path) -> None:
    path = write(tmp_path, more="limits: [{iae: {at_mots: 3}}]")
    path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.startswith("  fan")))
    with pytest.raises(SpecError) as refused:
        load_system(path)
    assert [each.path for each in refused.value.problems] == ["system", "limits[0].iae.at_mots"]


def test_the_schema_takes_names_of_that_pattern(tmp_path: Path) -> None:
    schema = system_json_schema()
    for names, fits in ((("pump", "drain_2"), True), (("Pump", "drain"), False), (("brake", "throttle"), True)):
        document = YAML(typ="safe", pure=True).load(write(tmp_path, names).read_text())
        if fits:
            jsonschema.validate(document, schema)
            document["system"]["hysteresis"] = {"spec": "a.yaml"}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(document, schema)


@pytest.mark.parametrize("word", ["hysteresis", "coast", "first", "shared", "min_dwell_s"])
def test_a_word_of_the_section_is_no_name_of_a_mode(tmp_path: Path, word: str) -> None:
    with pytest.raises(SpecError, match=f"system.{word}: {word} is a word of this section and no name of a mode; give"):
        load_system(write(tmp_path, (word, "fan"), f"to_fan_above: 1\nto_{word}_below: -1"))
