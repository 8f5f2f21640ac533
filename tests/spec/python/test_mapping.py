"""Specs from mappings: the same as from YAML, with the same messages, and text that reads back."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

import fopi_tune as ft
from fopi_tune.spec.digests import content_digest
from fopi_tune.spec.load import load_any
from fopi_tune.spec.python.mapping import yaml_of

SHIPPED = sorted(str(path) for path in Path("specs").glob("*.yaml"))
PI: dict[str, Any] = {
    "name": "pi",
    "plant": {"model": "lag", "static_gain": 1.0, "time_constant_s": {"min": 1.6, "max": 3.1}},
    "controller": {"kp": {"min": 0, "max": 10}, "ki": {"min": 0, "max": 10}, "alpha": 1},
    "requirements": [{"phase_margin_deg": {"at_least": 60}}],
    "objective": {"maximize": "ki"},
}
#: the same without an objective
OPEN = {key: value for key, value in PI.items() if key != "objective"}


@pytest.mark.parametrize("path", SHIPPED)
def test_a_shipped_spec_as_a_mapping_is_the_same_spec(path: str) -> None:
    entries = YAML(typ="safe").load(Path(path))
    read, made = ft.load_spec(path), ft.spec(entries)
    assert content_digest(made) == content_digest(read)
    again = ft.load_spec(made.to_yaml())
    assert again == made
    assert again.to_yaml() == made.to_yaml()
    assert read.to_yaml() == Path(path).read_text()


def test_every_source_is_the_same_spec(tmp_path: Path) -> None:
    text = yaml_of(PI)
    (tmp_path / "pi.yaml").write_text(text)
    for source in (PI, text, tmp_path / "pi.yaml", str(tmp_path / "pi.yaml"), ft.spec(PI)):
        assert content_digest(ft.load_spec(source)) == content_digest(ft.spec(PI))
    assert ft.tune(PI, proof=False).gains == ft.tune(text, proof=False).gains


def test_a_system_may_be_a_mapping_or_a_text() -> None:
    text = Path("systems/car.yaml").read_text().replace("../specs/", "specs/")
    system = ft.load_system(text)
    assert ft.load_system(YAML(typ="safe").load(text)).modes == system.modes
    assert [mode.name for mode in system.modes] == ["throttle", "brake"]
    with pytest.raises(ft.SpecError, match="this is a spec, no system"):
        ft.load_system(PI)
    assert load_any(PI) == ft.spec(PI)


def test_numbers_of_numpy_and_objects_of_this_package_are_written() -> None:
    plant = ft.TransferFunction([1.0], np.array([2.0, 1.0]), np.float64(0.25))
    made = ft.spec(
        OPEN, plant=plant, controller=ft.FoPi(np.float64(1.5), 0.5, 1.0), validation={"samples": np.int64(50)}
    )
    assert made.plant.parameters["dead_time_s"].nominal == 0.25
    assert made.controller.kp.min == made.controller.kp.max == 1.5
    assert made.validation is not None
    assert made.validation.samples == 50
    assert ft.spec(PI, plant=ft.Plant((1.0,), (2.0, 1.0))).plant.model == "transfer_function"
    ranged = {**PI["plant"], "time_constant_s": ft.Uncertain(2.0, 1.6, 3.1)}
    assert ft.spec(PI, plant=ranged).plant.low.tolist() == [1.6]


@pytest.mark.parametrize(
    "gains",
    [
        ft.Pid(1.0, 0.5, 0.2, 0.1),
        ft.FoPid(1.0, 0.5, 0.9, 0.2, 0.8, 0.1),
        ft.FoPi(1.0, 0.5, 0.9, measurement_filter=ft.MeasurementFilter(2, 0.3)),
    ],
    ids=["pid", "fopid", "filtered"],
)
def test_a_controller_of_any_structure_stands_for_its_numbers(gains: ft.FoPi) -> None:
    design = ft.tune(ft.spec(PI, controller=gains, objective={"minimize": "sensitivity_peak_db"}), proof=False)
    assert design.gains == gains


WRONG: list[tuple[Any, str]] = [
    ({}, "spec: plant: the key is missing; add it"),
    (
        {**PI, "plant": {**PI["plant"], "static_gain": None}},
        "spec: plant.static_gain: None is no value of a spec; leave",
    ),
    (
        {**PI, "plant": {**PI["plant"], "static_gain": 1j}},
        "spec: plant.static_gain: an object of type complex is no value of a spec",
    ),
    ({**PI, 3: 4}, "spec: the key 3 is no text; write it in quotes"),
    ({**PI, "controller": {"kp": 1, "ki": 1, "Ti": 3}}, "spec: controller.Ti: "),
    ({**PI, "objective": {"maximise": "ki"}}, "spec: objective"),
    (
        {**PI, "requirements": [{"phase_margin_deg": {"at_least": float("nan")}}]},
        "spec: requirements[0].phase_margin_deg",
    ),
    ({**PI, "description": "a\nb: c"}, ""),
    ({**PI, "controller": ft.FoPi(1.0, 0.5, 1.0)}, "spec: objective.maximize: ki is fixed; give it a range there or"),
]


@pytest.mark.parametrize(("source", "words"), WRONG)
def test_messages_have_paths_in_place_of_lines(source: Any, words: str) -> None:
    if not words:
        assert ft.spec(source).description == "a\nb: c"
        return
    with pytest.raises(ft.SpecError) as caught:
        ft.tune(source)
    assert str(caught.value).startswith(words)
    assert all(problem.line == problem.column == 0 for problem in caught.value.problems)


def test_what_refers_to_itself_is_refused() -> None:
    entries: dict[str, Any] = dict(PI)
    entries["plant"] = entries
    with pytest.raises(ft.SpecError, match="is nested too deeply"):
        ft.spec(entries)


@pytest.mark.parametrize("source", [7, None, b"name: a", [1]])
def test_what_is_no_spec_is_an_error_of_this_package(source: Any) -> None:
    with pytest.raises(ft.FopiError, match=r"an object of type \w+ is no spec; give the path of a file, its text in"):
        ft.tune(source)


@pytest.mark.parametrize("text", [7, None, {"name": "a"}, ["name: a"]])
def test_what_is_no_text_of_a_spec_is_an_error_of_this_package(text: Any) -> None:
    with pytest.raises(ft.FopiError, match="is no text of a spec; give it in YAML"):
        ft.parse_spec(text)


def test_a_spec_that_was_changed_has_another_hash_and_a_text_that_says_the_same() -> None:
    made = ft.spec(PI)
    changed = dataclasses.replace(made, description="slower", objective=None)
    assert ft.load_spec(changed).sha256 not in ("", made.sha256)
    again = ft.load_spec(changed.to_yaml())
    assert again.content_sha256 == ft.load_spec(changed).content_sha256 != made.content_sha256
    assert again.description == "slower"


@pytest.mark.parametrize("entries", ["spec.yaml", [1], 3])
def test_entries_that_are_no_mapping_are_told(entries: Any) -> None:
    with pytest.raises(ft.DomainError, match="no mapping of a spec's entries; give a dict or keywords"):
        ft.spec(entries)


@pytest.mark.parametrize("digits", [400, 5000])
def test_a_number_beyond_every_float_is_told_by_its_place(digits: int) -> None:
    number = -(10**digits)
    with pytest.raises(ft.SpecError, match=r"plant\.static_gain: the number is too large"):
        ft.spec(PI, plant={"model": "lag", "static_gain": number, "time_constant_s": 1})


def test_an_array_without_dimensions_is_its_number() -> None:
    plant = {"model": "lag", "static_gain": np.array(1.5), "time_constant_s": 1}
    assert ft.spec(PI, plant=plant).plant.parameters["static_gain"].nominal == 1.5
