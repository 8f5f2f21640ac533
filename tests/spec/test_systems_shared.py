"""Numbers that both plants of a system have, and that are one number."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from cases.shared_mass import BRAKE, LAGS, THROTTLE, car, write

from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import SpecError
from fopi_tune.spec.load import load_system
from fopi_tune.spec.systems import system_json_schema

REFUSED = {
    "[mass]": "the throttle's plant has no number called 'mass'; write m",
    "[m, c]": "the brake's plant has no number called 'c'; write m",
    "m": "'m' is written where a list belongs",
    "[1]": "'1' is not text",
}


def test_a_shared_number_is_one_of_the_box_and_others_are_named_by_their_mode(tmp_path: Path) -> None:
    family = car(tmp_path).family
    assert family.uncertain_names == ("throttle.c", "m")
    assert [family.columns(name) for name in ("throttle", "brake")] == [[0, 1], [1]]
    assert family.parameters["m"] == Uncertain(1100.0, 900.0, 1400.0)
    apart = car(tmp_path, more="").family
    assert apart.uncertain_names == ("throttle.c", "throttle.m", "brake.m")
    assert [apart.columns(name) for name in ("throttle", "brake")] == [[0, 1], [2]]


def test_numbers_of_models_are_shared_too_and_named_once(tmp_path: Path) -> None:
    more = "  shared: [time_constant_s, time_constant_s]"
    system = car(tmp_path, throttle=LAGS, brake=LAGS, more=more)
    assert system.shared == ("time_constant_s",)
    assert system.family.uncertain_names == ("time_constant_s",)
    assert system.family.problem("time_constant_s", Uncertain.exactly(-1.0)) is not None
    assert system.family.problem("brake.static_gain", Uncertain.exactly(1.0)) is None


def test_a_point_is_refused_where_one_of_both_plants_is_none(tmp_path: Path) -> None:
    family = car(tmp_path).family
    points = np.array([[50.0, 1000.0], [50.0, -1000.0]])
    assert family.refused(points).tolist() == [False, True]
    assert family.why_refused(points[0]) is None
    why = family.why_refused(points[1])
    assert why is not None
    assert why.startswith("throttle: ")


@pytest.mark.parametrize("names", REFUSED)
def test_what_is_no_number_of_both_plants_is_told_with_its_place(tmp_path: Path, names: str) -> None:
    path = write(tmp_path, more=f"  shared: {names}")
    with pytest.raises(SpecError) as refused:
        load_system(path)
    (problem,) = refused.value.problems
    assert problem.line == 8
    assert problem.path.startswith("system.shared")
    assert problem.message.startswith(REFUSED[names])


@pytest.mark.parametrize(
    ("throttle", "brake", "said"),
    [
        (THROTTLE, BRAKE.replace("1400", "1500"), "m is [900.0, 1400.0] with nominal 1100.0 in the throttle's spec"),
        (THROTTLE, BRAKE.replace("nominal: 1100", "nominal: 1000"), "m is [900.0, 1400.0] with nominal 1100.0"),
        (
            THROTTLE.replace("{min: 900, max: 1400, nominal: 1100}", "1100"),
            BRAKE.replace("{min: 900, max: 1400, nominal: 1100}", "1100"),
            "m is exactly 1100 in both specs",
        ),
    ],
)
def test_one_number_has_one_range(tmp_path: Path, throttle: str, brake: str, said: str) -> None:
    with pytest.raises(SpecError, match=r"system\.shared\[0\]: ") as refused:
        car(tmp_path, throttle=throttle, brake=brake)
    assert said in str(refused.value)


def test_a_distribution_of_a_shared_number_has_its_own_name(tmp_path: Path) -> None:
    normal = "{truncated_normal: {mean: 1000, std: 50}}"
    system = car(tmp_path, validation=f", distributions: {{m: {normal}}}")
    assert system.validation is not None
    assert list(system.validation.distributions) == ["m"]
    with pytest.raises(SpecError, match=r"throttle\.m"):
        car(tmp_path, validation=f", distributions: {{throttle.m: {normal}}}")


def test_the_schema_knows_what_is_shared(tmp_path: Path) -> None:
    from ruamel.yaml import YAML

    path = write(tmp_path, validation=", distributions: {m: {truncated_normal: {mean: 1000, std: 50}}}")
    document = json.loads(json.dumps(YAML(typ="safe", pure=True).load(path)))
    jsonschema.validate(document, system_json_schema())
    document["system"]["shared"] = "m"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, system_json_schema())
