"""The systems in `systems/examples` against a simulation of their own words in plain NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.two_modes import Part, drive
from ruamel.yaml import YAML

import fopi_tune as ft
from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.digital.discretize import sections_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.spec.load import load_spec, load_system

FOLDER = Path(__file__).parents[2] / "systems" / "examples"
SYSTEMS = sorted(path for path in FOLDER.glob("*.yaml") if "\nsystem:" in path.read_text(encoding="utf-8"))
each_system = pytest.mark.parametrize("path", SYSTEMS, ids=lambda path: path.stem)


def written(path: Path) -> dict:
    return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))


def modes_of(section: dict) -> tuple[str, str]:
    first, second = (name for name, value in section.items() if isinstance(value, dict) and "spec" in value)
    return first, second


def number(value: object) -> float:
    return float(value["nominal"] if isinstance(value, dict) else value)  # pyright: ignore


def part_of(mode: dict, spec: dict, folder: Path = FOLDER) -> Part:
    plant, gains = spec["plant"], mode["gains"]
    if plant["model"] == "lag":
        numerator, denominator = (number(plant["static_gain"]),), (number(plant["time_constant_s"]), 1.0)
    elif plant["model"] == "pole":
        numerator, denominator = (number(plant["gain"]),), (1.0, plant["pole_rad_s"])
    else:
        numerator, denominator = (tuple(map(number, plant[key])) for key in ("numerator", "denominator"))
    digital = load_spec(folder / mode["spec"]).digital
    assert digital is not None
    sections = sections_of(FoPi(gains["kp"], gains["ki"], gains.get("alpha", 1.0)), digital)
    if "kd" in gains:
        filter_s = spec["controller"]["derivative_filter_time_constant_s"]
        sections = sections_of(Pid(gains["kp"], gains["ki"], gains["kd"], filter_s), digital)
    own = Runtime.of(sections, Precision.FLOAT64, tuple(mode["output_limits"]))
    filter_of = {
        "direct": own.direct, "poles": own.poles, "residues": own.residues, "weights": own.weights,
        "tracking_gain": own.tracking_gain, "integrates": own.has_integrator,
    }  # fmt: skip
    part = Part(numerator, denominator, filter_of, own.limits, mode.get("output_rate_per_s", np.inf))
    part.kd = gains.get("kd", 0.0)
    part.derivative_filter_s = spec.get("controller", {}).get("derivative_filter_time_constant_s", 1.0)
    part.dead_time_s = number(plant.get("dead_time_s", 0.0))
    fed = mode.get("feedforward", {})
    if fed == "inverse_of_nominal_lag":
        fed = {"static_gain": denominator[1] / numerator[0], "rate_gain": denominator[0] / numerator[0]}
    part.static_gain, part.rate_gain = fed.get("static_gain", 0.0), fed.get("rate_gain", 0.0)
    part.hold_below = mode.get("standstill", {}).get("hold_below_per_s", -np.inf)
    return part


@each_system
def test_an_example_is_driven_as_its_words_say(path: Path) -> None:
    document = written(path)
    section, (scenario,) = document["system"], document["scenarios"]
    names = modes_of(section)
    specs = [written(FOLDER / section[name]["spec"]) for name in names]
    one, two = (part_of(section[name], spec) for name, spec in zip(names, specs, strict=True))
    digitals = [spec["digital"] for spec in specs]
    first, second = (digital.get("delay_samples", 0) for digital in digitals)
    output, states = drive(section, (one, two), names, scenario, digitals[0]["sample_time_s"], (first, second))
    (found,) = ft.simulate_system(path).driven
    assert np.array_equal(found.traces.mode[0], states)
    assert np.abs(found.traces.output[0] - output).max() <= 1e-9
    assert set(states) == ({0, 1, 2} if section.get("coast") else {1, 2})


@each_system
def test_an_example_meets_its_limits_and_says_that_it_is_plausible(path: Path) -> None:
    found = ft.simulate_system(path)
    assert found.status == "met"
    assert "plausible" in load_system(path).description
