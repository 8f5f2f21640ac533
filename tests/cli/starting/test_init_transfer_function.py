"""`fopi init --from-tf`: what people paste becomes a spec that is solved, or a message."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from cases.commands import fopi
from cases.random_written import random_written
from ruamel.yaml import YAML

from fopi_tune.pipeline.run import run
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.pipeline.tune import tune
from fopi_tune.results.status import Status
from fopi_tune.spec import load_spec
from fopi_tune.spec.language import json_schema

pytestmark = pytest.mark.usefixtures("plain_figures", "folder")


@pytest.mark.parametrize(
    ("text", "model", "numbers"),
    [
        ("4.39/(s+0.1746)", "pole", {"gain": 4.39, "pole_rad_s": 0.1746}),
        ("1.5*e^(-2s)/(12 s + 1)", "lag", {"static_gain": 1.5, "time_constant_s": 12, "dead_time_s": 2}),
        ("-2/(3 s + 4)", "transfer_function", {"numerator": [-2], "denominator": [3, 4]}),
        ("      4.39\n  ----------\n  s + 0.1746", "pole", {"gain": 4.39}),
        ("zpk([-1], [-2+1i -2-1i], 0.1)", "transfer_function", {"numerator": [0.1, 0.1], "denominator": [1, 4, 5]}),
    ],
)
def test_a_transfer_function_becomes_a_spec(text: str, model: str, numbers: dict[str, Any]) -> None:
    assert fopi("init", "given", "--from-tf", text).exit_code == 0
    document = YAML(typ="safe", pure=True).load(Path("given.yaml").read_text(encoding="utf-8"))
    assert document["plant"]["model"] == model
    assert document["plant"] | numbers == document["plant"]
    jsonschema.Draft202012Validator(json_schema()).validate(document)
    assert " ".join(text.split()) in Path("given.yaml").read_text(encoding="utf-8")


#: stable, integrating, unstable, with zeros on either side, dead time, resonance, far apart, without dynamics
GIVEN = [
    "4.39/(s+0.1746)", "1/(s^2-1)", "exp(-0.3*s)*2/((s+1)*(0.5*s+1)^2)", "(s^2+2*s+1)/(s^3 + 3 s^2)", "-3/(s+1)",
    "1.5*e^(-2s)/(12 s + 1)", "66.16 (s+1)/((s+2)(s+3))", "zpk([],[-1+2i -1-2i],5)", "1/s", "1/s^2", "1/(s-1)",
    "(1-s)/((s+1)^2)", "1/(s+1)^8", "1/((s+1)(s+1000))", "1/(s^2+0.02s+1)", "5", "s/(s+1)", "exp(-s)/s",
    "1e-6/(s+1e-4)", "(s-1)/((s+2)(s+3))", "exp(-0.2*s)/(s-1)", "1/(s*(s+1)*(s+2))", "2*(3-s)/(s^2+2*s+9)",
    "4/(s^2-4)/(0.01 s+1)", "exp(-0.05 s)/s^2", "1e3/s^2",
]  # fmt: skip


@pytest.mark.thinned(7)
@pytest.mark.parametrize("text", GIVEN)
def test_the_spec_of_a_transfer_function_is_solved(text: str) -> None:
    assert fopi("init", "given", "--from-tf", text).exit_code == 0
    assert tune("given.yaml").status is Status.SOLVED


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--from-tf", "s^2/(s+1)"), "--from-tf: the numerator's degree 2 exceeds the denominator's 1"),
        (("--from-tf", "1/(s+a)"), "--from-tf: line 1, column 6: 'a' is not known"),
        (("--from-tf", "exp(s)/(s+1)"), "positive exponent"),
        (("--from-tf", ""), "there is no transfer function"),
        (("--from-tf", "1/s", "--plant", "lag"), "--from-tf gives the plant"),
        (("--from-tf", "1/s", "--from-step-data", "x.csv"), "--from-tf gives the plant"),
    ],
)
def test_a_text_that_is_no_plant_ends_with_2_and_writes_nothing(arguments: tuple[str, ...], said: str) -> None:
    result = fopi("init", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert os.listdir() == []


def test_a_common_factor_is_told_on_the_screen_and_in_the_spec() -> None:
    result = fopi("init", "given", "--from-tf", "(s+1)/((s+1)*(s+2))")
    assert "The common factor s + 1 of numerator and denominator is left out." in result.stderr
    assert "The common factor s + 1" in Path("given.yaml").read_text(encoding="utf-8")
    assert load_spec("given.yaml").plant.parameters["pole_rad_s"].nominal == 2.0


@pytest.mark.long
def test_random_plants_are_solved_and_simulated_or_unstable_ones_say_why_not() -> None:
    plants = random_written(100, seed=7)
    missed: list[str] = []
    for text in plants:
        assert fopi("init", "given", "--from-tf", text, "--force", "--no-schema").exit_code == 0, text
        spec = load_spec("given.yaml")
        made = run(spec)
        if made.status != "met":
            assert "(s-" in text, text
            # a PID need not stabilise every plant, nor keep |S| below 8 dB
            assert made.design.status is Status.INFEASIBLE, text
            assert re.search(r"no gains .* stable loop|cannot be met|cannot hold together", made.design.message), text
            missed.append(text)
        elif made.design.gains is not None:
            assert simulate(spec, made.design.gains).status == "met", text
    assert len(missed) <= 5, missed


def test_limits_leave_room_above_what_no_controller_can_do() -> None:
    # z = 2.857, p = 1.82: |S| >= |z + p|/|z - p| = 4.51, 13.1 dB, at the zero for any controller
    assert fopi("init", "given", "--from-tf", "-0.0362*(-0.35*s+1)/((s-1.82)*(0.129*s+1))").exit_code == 0
    text = Path("given.yaml").read_text(encoding="utf-8")
    assert "sensitivity_db: {at_most: 18}            # distance from -1; with any controller it exceeds 13 dB" in text
    assert tune("given.yaml", proof=False).status is Status.SOLVED


@pytest.mark.parametrize("text", GIVEN[::5])
def test_the_scenario_is_simulated_and_stays_finite(text: str) -> None:
    assert fopi("init", "given", "--from-tf", text).exit_code == 0
    spec = load_spec("given.yaml")
    (scenario,) = spec.scenarios
    assert (len(scenario.reference), len(scenario.load)) == (1, 1)
    assert 0.0 < scenario.load[0].at_s < scenario.duration_s
    design = tune(spec, proof=False)
    assert design.gains is not None
    assert simulate(spec, design.gains).status == "met"
