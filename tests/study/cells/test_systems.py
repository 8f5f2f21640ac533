"""Systems as cells of a study: what a cell is, what is run on it, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cases.project import ROOT
from cases.two_modes import write

from fopi_tune.core.controller import numbers_of
from fopi_tune.errors import SpecError
from fopi_tune.pipeline.discretize import discretize_system
from fopi_tune.pipeline.prove_system import prove_system
from fopi_tune.pipeline.systems import simulate_system, validate_system
from fopi_tune.pipeline.tune import tune
from fopi_tune.results.design import Design
from fopi_tune.spec import load_document, load_system
from fopi_tune.spec.model import DesignSpec
from fopi_tune.study import Machines, run
from fopi_tune.study.cells.systems import system_from_text
from fopi_tune.study.ledger import Counts
from fopi_tune.study.load import load_study
from fopi_tune.study.model import Cell, Kind, Study
from fopi_tune.study.worker import run_cell

HEAD = "schema: 1\nname: s\nspecs: [rig.yaml]\n"
MORE = "limits: [{switch_count: {at_most: 9}}]\nvalidation: {samples: 40, seed: 3}"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write(tmp_path, more=MORE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def study(text: str, head: str = HEAD) -> Study:
    Path("s.yaml").write_text(head + text, encoding="utf-8")
    return load_study("s.yaml")


def mistakes(text: str, head: str = HEAD) -> list[str]:
    with pytest.raises(SpecError) as caught:
        study(text, head)
    return [str(problem) for problem in caught.value.problems]


def document(cell: Cell) -> dict[str, Any]:
    result = run_cell("key", cell)
    assert not result.reason, result.reason
    return json.loads(result.document)


def without_digest(told: dict[str, Any]) -> dict[str, Any]:
    """A result, but for the hash of the text that it is of."""
    return {**told, "stamp": {key: value for key, value in told["stamp"].items() if key != "spec_sha256"}}


@pytest.mark.parametrize(
    "stages",
    ["discretize, simulate, validate", pytest.param("prove, discretize, simulate, validate", marks=pytest.mark.long)],
)
def test_a_cells_numbers_are_those_of_the_single_commands_on_a_system_written_out(stages: str) -> None:
    grid = (
        "grid: {system.hysteresis: [0.4], system.fan.gains.kp: [0.25], system.fan.spec.plant.time_constant_s.max: [4],"
        " 'scenarios[0].reference[1].value': [2.5], validation.samples: [60]}\n"
    )
    (cell,) = study(f"{grid}stages: [{stages}]").cells
    told = document(cell)
    text = Path("rig.yaml").read_text(encoding="utf-8").replace("samples: 40", "samples: 60")
    text = text.replace("hysteresis: 0.3", "hysteresis: 0.4").replace("kp: 0.2,", "kp: 0.25,")
    Path("rig.yaml").write_text(text.replace("value: 3}", "value: 2.5}"), encoding="utf-8")
    fan = Path("fan.yaml").read_text(encoding="utf-8")
    Path("fan.yaml").write_text(fan.replace("max: 3,", "max: 4,"), encoding="utf-8")
    system = load_system("rig.yaml")
    commands = {
        "prove": prove_system,
        "discretize": discretize_system,
        "simulate": simulate_system,
        "validate": validate_system,
    }
    for stage in stages.split(", "):
        wanted = json.loads(json.dumps(commands[stage](system).to_dict()))
        assert without_digest(told[stage]) == without_digest(wanted), stage
    bad = [told[stage]["status"] for stage in stages.split(", ")]
    bad = [status for status in bad if status not in ("settles", "made", "met")]
    assert told["outcome"] == (bad[0] if bad else "met")


@pytest.mark.parametrize("names", [("heater", "fan"), ("brake", "throttle"), ("a", "z"), ("z", "a")])
def test_which_mode_raises_the_output_survives_the_canonical_text(names: tuple[str, str], tmp_path: Path) -> None:
    write(tmp_path, names)
    (cell,) = study("stages: [simulate]").cells
    again, written = system_from_text(cell.text), load_system("rig.yaml")
    assert [mode.name for mode in again.modes] == [mode.name for mode in written.modes]
    assert [mode.spec.plant for mode in again.modes] == [mode.spec.plant for mode in written.modes]
    assert [mode.gains for mode in again.modes] == [mode.gains for mode in written.modes]
    assert (again.hysteresis, again.scenarios) == (written.hysteresis, written.scenarios)


def test_the_text_does_not_depend_on_descriptions_and_on_what_a_system_does_not_read_of_its_specs() -> None:
    one = study("stages: [simulate]").cells[0]
    fan = Path("fan.yaml").read_text(encoding="utf-8")
    Path("fan.yaml").write_text(f"{fan}description: a fan\nvalidation: {{samples: 7}}\n", encoding="utf-8")
    assert study("stages: [simulate]").cells[0].key({}) == one.key({})
    Path("fan.yaml").write_text(fan.replace("poles: 5", "poles: 6"), encoding="utf-8")
    assert study("stages: [simulate]").cells[0].key({}) != one.key({})


def test_a_mode_may_be_given_another_spec_by_its_path() -> None:
    fan = Path("fan.yaml").read_text(encoding="utf-8")
    Path("strong.yaml").write_text(fan.replace("static_gain: 12", "static_gain: 15"), encoding="utf-8")
    cells = study(
        "grid: {system.fan.spec: [fan.yaml, strong.yaml], system.fan.spec.digital.poles: [6]}\nstages: [simulate]"
    )
    systems = [system_from_text(cell.text) for cell in cells.cells]
    assert [s.modes[1].spec.plant.parameters["static_gain"].nominal for s in systems] == [12.0, 15.0]
    assert all(s.modes[1].spec.digital and s.modes[1].spec.digital.poles == 6 for s in systems)
    found = mistakes("grid: {system.fan.spec: [weak.yaml]}\nstages: [simulate]")
    assert found[0].startswith("s.yaml:4:8: system.fan.spec: cell 1 (rig, system.fan.spec")
    assert "weak.yaml:1:1: there is no such file" in found[0]


def test_a_check_is_about_another_system_with_the_same_gains() -> None:
    text = "grid: {check.system.hysteresis: [0.9], check.system.heater.spec.plant.time_constant_s.max: [9]}\n"
    (cell,) = study(text + "stages: [simulate]").cells
    assert system_from_text(cell.text).hysteresis == 0.3
    checked = system_from_text(cell.check)
    assert checked.hysteresis == 0.9
    told = document(cell)
    assert without_digest(told["simulate"]) == without_digest(simulate_system(checked).to_dict())


def test_specs_and_systems_are_cells_of_one_study() -> None:
    head = HEAD.replace("[rig.yaml]", "[rig.yaml, fan.yaml]")
    gains = "cells: [{}]\nstages: [simulate, validate]\n"
    Path("fan.yaml").write_text(
        Path("fan.yaml").read_text(encoding="utf-8") + "controller: {kp: 0.2, ki: 0.15, alpha: 0.8}\n", encoding="utf-8"
    )
    found = study(gains, head)
    assert [(cell.kind, cell.name, cell.draws > 0) for cell in found.cells] == [
        (Kind.SYSTEM, "rig", False), (Kind.SPEC, "fan", True),
    ]  # fmt: skip
    assert {"simulate.status", "validate.status"} <= {column.path for column in found.collect}


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "rig.yaml:1:1: stage tune: the system does not say what to tune; add tune: and objective: to it, or write "
         "stages: [prove]"),
        ("stages: [tune]", "or write stages: [simulate, validate, prove]"),
        ("stages: [simulate]\nstarts: base", "s.yaml:3:9: specs[0]: is a system, whose design does not start from"),
        ("stages: [simulate]\ngrid: {system.hysteresis: [-1]}", "s.yaml:5:28: system.hysteresis: cell 1 (rig, system."
         "hysteresis = -1): system.hysteresis: -1 is out of range"),
        ("stages: [simulate]\ngrid: {system.fan.spec.plant.time_constant_s.max: [0.1]}", "s.yaml:5:8: system.fan.spec."
         "plant.time_constant_s.max: cell 1"),
        ("stages: [simulate]\ngrid: {system.fan.spec.plant.time_constant.max: [2]}", "did you mean 'time_constant_s'?"),
        ("stages: [simulate]\ngrid: {system.fn.gains.kp: [2]}", "system.fn: "),
        ("stages: [simulate]\ngrid: {system.fan.spec.validation.samples: [2]}", "s.yaml:5:8: system.fan.spec."
         "validation.samples: cell 1 (rig, system.fan.spec.validation.samples = 2): a system does not read the "
         "validation of a mode's spec; give values to validation itself"),
        ("stages: [simulate]\ngrid: {check.system.fan.gains.kp: [2]}", "s.yaml:5:8: grid.check.system.fan.gains.kp: "
         "the gains that are checked are those of the design; give values to system.fan.gains itself"),
        ("stages: [simulate]\ngrid: {'scenarios[3].duration_s': [2]}", "scenarios has 1 entry in the spec"),
        ("stages: [simulate]\ngrid: {system.fan.spec.digital.sample_time_s: [0.7]}", "s.yaml:5:8: system.fan.spec."
         "digital.sample_time_s: cell 1"),
        ("stages: [fly]", "s.yaml:4:10: stages[0]: 'fly' is not known here"),
    ],
)  # fmt: skip
def test_mistakes_have_a_place_and_advice(text: str, part: str) -> None:
    found = mistakes(text)
    assert any(part in line for line in found), found


def test_mistakes_of_a_modes_spec_are_told_once_in_its_own_file() -> None:
    fan = Path("fan.yaml").read_text(encoding="utf-8")
    Path("fan.yaml").write_text(fan.replace("max: 3,", "max: 0.3,"), encoding="utf-8")
    found = mistakes("stages: [simulate]\ngrid: {system.hysteresis: [0.1, 0.2]}")
    assert len(found) == 1
    assert found[0].startswith("fan.yaml:3:61: plant.time_constant_s.min: min 1.5 is greater than max 0.3")
    Path("fan.yaml").write_text(fan.replace("digital", "digtal"), encoding="utf-8")
    assert mistakes("stages: [simulate]")[0].startswith("fan.yaml:5:1: digtal: ")
    Path("fan.yaml").unlink()
    found = mistakes("stages: [simulate]")
    assert found[0].startswith(
        "rig.yaml:5:15: system.fan.spec: the spec cannot be used: fan.yaml:1:1: there is no such"
    )


def test_a_spec_in_place_of_its_path_is_refused_as_everywhere() -> None:
    text = Path("rig.yaml").read_text(encoding="utf-8").replace("spec: fan.yaml", "spec: {name: fan}")
    Path("rig.yaml").write_text(text, encoding="utf-8")
    (found,) = mistakes("stages: [simulate]")
    assert found == (
        "rig.yaml:5:15: system.fan.spec: a mapping is written where text belongs; write the path of the spec"
    )


@pytest.mark.parametrize("system", ["[1]", "5", "{heater: 5}", "{heater: {spec: heater.yaml}}", "{a: {}, b: {}}"])
def test_a_file_that_is_no_system_is_told_in_its_place(system: str) -> None:
    Path("rig.yaml").write_text(f"schema: 1\nname: rig\nsystem: {system}\nscenarios: []\n", encoding="utf-8")
    found = mistakes("stages: [simulate]\ngrid: {system.hysteresis: [1]}")
    assert found
    assert all(line.startswith(("rig.yaml:", "s.yaml:5:")) for line in found)


def test_gains_that_a_mode_leaves_out_are_tuned_once_for_all_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    text = Path("rig.yaml").read_text(encoding="utf-8").replace(", gains: {kp: 0.2, ki: 0.15, alpha: 0.8}", "")
    Path("rig.yaml").write_text(text, encoding="utf-8")
    asked_for = "[{phase_margin_deg: {at_least: 60}}, {crossover_rad_s: {at_most: 1}}]\nobjective: {maximize: ki}"
    fan = Path("fan.yaml").read_text(encoding="utf-8").replace("[{phase_margin_deg: {at_least: 20}}]", asked_for)
    Path("fan.yaml").write_text(f"{fan}controller: {{alpha: 1}}\n", encoding="utf-8")
    asked: list[Design] = []

    def counted(spec: DesignSpec, **options: Any) -> Design:
        asked.append(tune(spec, **options))
        return asked[-1]

    monkeypatch.setattr("fopi_tune.study.system_stages.tune", counted)
    cells = study("grid: {system.hysteresis: [0.31, 0.32]}\nstages: [simulate]").cells
    told = [document(cell)["simulate"] for cell in cells]
    (design,) = asked
    assert design.spec.name == "fan"
    assert design.gains is not None
    assert [each["gains"]["fan"] for each in told] == [numbers_of(design.gains)] * 2


def test_a_spec_is_simulated_too() -> None:
    told = document(load_study_of_spec("stages: [simulate, validate]").cells[0])
    assert told["simulate"]["status"] in ("met", "violated")
    assert told["simulate"]["scenarios"]


def load_study_of_spec(text: str) -> Study:
    Path("fan.yaml").write_text(
        Path("fan.yaml").read_text(encoding="utf-8") + "controller: {kp: 0.2, ki: 0.15, alpha: 0.8}\n", encoding="utf-8"
    )
    return study(text, HEAD.replace("rig.yaml", "fan.yaml"))


def test_a_study_of_systems_that_is_stopped_goes_on_and_ends_with_the_same_bytes(folder: Path) -> None:
    text = "grid: {system.hysteresis: [0.2, 0.3], system.fan.spec.plant.time_constant_s.max: [3, 4, 5]}\n"
    loaded = study(text + "stages: [simulate, validate]\ncollect: ['simulate.scenarios[0].measures.iae']\n")
    whole = run(loaded, folder / "whole", Machines(0)).table.to_csv()

    def stop(counts: Counts) -> None:
        if counts.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(loaded, folder / "out", Machines(0), told=stop)
    again = run(loaded, folder / "out", Machines(0))
    assert again.counts == Counts(6, 6, 0)
    assert again.table.to_csv() == whole
    assert not again.table.empty


@pytest.mark.long
def test_a_tuned_systems_cell_has_the_gains_of_fopi_tune_and_is_checked_with_them() -> None:
    car = ROOT / "systems" / "car_comfort.yaml"
    document_of = load_document(car)[0]
    assert document_of.has("tune")
    head = f"schema: 1\nname: s\nspecs: [{json.dumps(str(car))}]\n"
    cells = study("grid: {validation.samples: [300]}\nstages: [tune, simulate, validate]", head).cells
    told = document(cells[0])
    assert told["tune"]["status"] == "solved"
    assert told["simulate"]["gains"] == told["tune"]["gains"] == told["validate"]["gains"]
    assert told["outcome"] == told["validate"]["status"]


EXAMPLES = sorted(
    path for path in (ROOT / "systems" / "examples").glob("*.yaml") if "\nsystem:" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_a_cell_that_says_the_same(path: Path) -> None:
    """True and false among others: they came back as text, and each cell of a system that coasts failed."""
    (cell,) = study(
        "grid: {validation.samples: [5]}\nstages: [simulate]", f"schema: 1\nname: s\nspecs: [{path}]\n"
    ).cells
    again, written = system_from_text(cell.text), load_system(path)
    assert (again.hysteresis, again.scenarios) == (written.hysteresis, written.scenarios)
    assert [mode.feedforward for mode in again.modes] == [mode.feedforward for mode in written.modes]
    assert not run_cell("key", cell).reason


def test_coasting_may_be_an_axis() -> None:
    path = ROOT / "systems" / "examples" / "student_car.yaml"
    head = f"schema: 1\nname: s\nspecs: [{path}]\n"
    cells = study("grid: {system.coast: [true, false]}\nstages: [simulate]", head).cells
    assert [system_from_text(cell.text).lines.coasts for cell in cells] == [True, False]


def test_paths_reach_the_dead_time_and_the_zero_of_a_mode(folder: Path) -> None:
    for name in ("duct", "duct_heater", "duct_cooler"):
        (folder / f"{name}.yaml").write_text((ROOT / "systems" / "examples" / f"{name}.yaml").read_text())
    grid = (
        "grid: {system.heater.spec.plant.dead_time_s.nominal: [3.1], system.heater.spec.plant.numerator: [[60, 25]],"
        " system.cooler.spec.plant.dead_time_s: [0.7], validation.samples: [20]}\nstages: [simulate, validate]\n"
    )
    (cell,) = study(grid, HEAD.replace("rig.yaml", "duct.yaml")).cells
    found = document(cell)
    plain = simulate_system(folder / "duct.yaml").to_dict()["scenarios"]
    for name, *changes in (
        ("duct_heater", ("nominal: 3.3", "nominal: 3.1"), ("[150, 25]", "[60, 25]")),
        ("duct_cooler", ("dead_time_s: 1.2", "dead_time_s: 0.7")),
        ("duct", ("samples: 2000", "samples: 20")),
    ):
        path = folder / f"{name}.yaml"
        text = path.read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
    assert found["simulate"]["scenarios"] == simulate_system(folder / "duct.yaml").to_dict()["scenarios"] != plain
    assert found["validate"]["scenarios"] == validate_system(folder / "duct.yaml").to_dict()["scenarios"]
