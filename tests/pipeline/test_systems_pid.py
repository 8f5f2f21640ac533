"""Systems whose modes have a derivative, through every stage; driven beside a simulation in plain NumPy."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cases.c_export import replayed
from oracles.two_modes import drive

import fopi_tune as ft
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.proof.switched import recheck_system
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.results.status import Status
from fopi_tune.spec.load import load_system
from tests.pipeline.test_systems_examples import modes_of, part_of, written

SPEC = """\
schema: 1
name: {name}
plant: {{model: transfer_function, numerator: {numerator}, denominator: {denominator}, dead_time_s: {dead}}}
controller: {{{box}}}
requirements: [{{phase_margin_deg: {{at_least: 40}}}}]
digital: {{sample_time_s: 0.1, design: sampled, delay_samples: {delay}}}
"""
PID = "structure: pid, kp: {min: 0, max: 5}, ki: {min: 0, max: 2}, kd: {min: 0, max: 1}"
SYSTEM = """\
schema: 1
name: pair
system:
  heater: {{spec: heater.yaml, gains: {heater}, output_limits: [0, 1]{one}}}
  fan: {{spec: fan.yaml, gains: {fan}, output_limits: [-1, 0]{two}}}
  {turns}
  inactive: {memory}
scenarios:
  - name: day
    duration_s: 24
    reference: [{{at_s: 0, value: {up}}}, {{at_s: 9, value: {down}}}, {{at_s: 15, value: 2, ramp_s: 3}}]
"""
TURNS = (
    "hysteresis: 0.05", "{to_fan_above: 0.2, to_heater_below: 0.05}", "{hysteresis: 0.1, min_dwell_s: 0.7}",
    "{to_fan_above: 0.3, to_heater_below: -0.2, coast: true, coast_below: 0.1}",
)  # fmt: skip


def random_system(folder: Path, seed: int) -> Path:
    """A system of random plants, gains, limits of rates, memories and lines, its first mode with a derivative."""
    draw = np.random.default_rng(seed)

    def some(low: float, high: float) -> float:
        return round(float(draw.uniform(low, high)), 4)

    filters = [some(0.1, 0.6), some(0.1, 0.6)]
    boxes = [f"{PID}, derivative_filter_time_constant_s: {each}" for each in filters]
    gains = [f"{{kp: {some(0.2, 1.0)}, ki: {some(0.05, 0.4)}, kd: {some(0.02, 0.2)}}}" for _ in boxes]
    if seed % 3 == 0:
        boxes[1] = "kp: {min: 0, max: 5}, ki: {min: 0, max: 2}, alpha: {min: 0.6, max: 1.2}"
        gains[1] = f"{{kp: {some(0.2, 1.0)}, ki: {some(0.05, 0.4)}, alpha: 0.8}}"
    delay, dead = seed % 2, [some(0.0, 0.2) if seed % 4 == 1 else 0.0 for _ in boxes]
    for name, box, late in zip(("heater", "fan"), boxes, dead, strict=True):
        plant = {"numerator": [some(3.0, 6.0)], "denominator": [some(0.05, 0.4), some(1.5, 3.0), 1.0], "dead": late}
        text = SPEC.format(name=name, box=box, delay=delay, **plant)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    turns = TURNS[seed % 4].strip("{}").split(", ")
    rates = [f", output_rate_per_s: {some(0.8, 2.0)}" if seed % 5 in (1, 2) else "", ""]
    words = {
        "heater": gains[0], "fan": gains[1], "one": rates[0], "two": rates[1], "turns": "\n  ".join(turns),
        "memory": ("held", "tracking", "reset")[seed % 3], "up": some(2.5, 3.5), "down": some(0.4, 1.2),
    }  # fmt: skip
    path = folder / "pair.yaml"
    path.write_text(SYSTEM.format(**words), encoding="utf-8")
    return path


@pytest.mark.parametrize("seed", [*range(8), *(pytest.param(k, marks=pytest.mark.long) for k in range(8, 40))])
def test_a_random_system_is_driven_as_its_words_say(tmp_path: Path, seed: int) -> None:
    path = random_system(tmp_path, seed)
    document = written(path)
    section, (scenario,) = document["system"], document["scenarios"]
    names = modes_of(section)
    specs = [written(tmp_path / section[name]["spec"]) for name in names]
    one, two = (part_of(section[name], spec, tmp_path) for name, spec in zip(names, specs, strict=True))
    first, second = (spec["digital"]["delay_samples"] for spec in specs)
    output, states = drive(section, (one, two), names, scenario, 0.1, (first, second))
    (found,) = ft.simulate_system(path).driven
    assert np.array_equal(found.traces.mode[0], states)
    assert np.abs(found.traces.output[0] - output).max() <= 1e-9
    assert {1, 2} <= set(states)


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not found")
@pytest.mark.parametrize("seed", [1, 3])
def test_its_code_meets_its_vectors_and_names_its_gains(tmp_path: Path, seed: int) -> None:
    path = random_system(tmp_path, seed)
    made = ft.discretize_system(path)
    done = replayed(made.code(), tmp_path / "c", "gcc")
    assert done.returncode == 0, done.stdout + done.stderr
    (header,) = (text for name, text in made.code().items() if name.endswith("fopi_pair_f64.h"))
    assert f"kd = {written(path)['system']['heater']['gains']['kd']}" in str(header)


def test_drawn_pairs_are_replayed_and_a_certificate_says_what_it_does_not_model(tmp_path: Path) -> None:
    path = random_system(tmp_path, 3)
    text = path.read_text(encoding="utf-8")
    path.write_text(f"{text}validation: {{samples: 40, seed: 1}}\n", encoding="utf-8")
    assert ft.validate_system(path).to_dict()["scenarios"][0]["finite"]["met"] == 40
    assert ft.simulate_system(path, replay=7).index == 7
    with pytest.raises(DomainError, match="heater: the exact simulation of a system in continuous time is not"):
        ft.simulate_system(path, exact=True)
    system = load_system(path)
    certificate = ft.prove_system(system).certificate
    assert certificate.verdict.value == "undecided"
    assert "heater: a derivative" in certificate.reason
    document = json.loads(json.dumps(to_document(certificate)))
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    assert recheck_system(from_document(document), system, gains).accepted
    heater = gains["heater"]
    assert isinstance(heater, ft.Pid)
    other = ft.Pid(heater.kp, heater.ki, 1.01 * heater.kd, heater.derivative_filter_time_constant_s)
    assert not recheck_system(from_document(document), system, {**gains, "heater": other}).accepted


def test_gains_of_a_pid_mode_are_tuned_for_the_scenarios(tmp_path: Path) -> None:
    path = random_system(tmp_path, 0)
    text = path.read_text(encoding="utf-8")
    begin = text.index(", gains: ")
    text = text[:begin] + text[text.index("}", begin) + 1 :]
    more = "requirements: [{overshoot: {at_most: 1}}]\nobjective: {minimize: iae, scenario: day}\ntune: [heater]\n"
    path.write_text(text + more, encoding="utf-8")
    found = ft.tune_system(path)
    assert found.status is Status.SOLVED
    assert found.gains is not None
    assert isinstance(found.gains["heater"], ft.Pid)
    driven = ft.simulate_system(path, found.gains).driven[0]
    assert driven.measures["iae"] == pytest.approx(found.objective, rel=1e-6)


def test_a_mode_names_the_gains_that_its_structure_has(tmp_path: Path) -> None:
    path = random_system(tmp_path, 3)
    text = path.read_text(encoding="utf-8")
    fan = text.index("fan: {")
    for old, new, said in (
        ("kd: ", "mu: ", "the gain kd is missing; the mode's controller is of structure pid"),
        ("kd: ", "alpha: 0.8, kd: ", "leave alpha out, or write another structure"),
        ("kd: ", "mu: 0.8, kd: ", "leave mu out, or write another structure"),
    ):
        path.write_text(text[:fan].replace(old, new, 1) + text[fan:], encoding="utf-8")
        with pytest.raises(SpecError, match=said):
            load_system(path)
    for new, said in (("", "the gain alpha is missing"), (", alpha: 0.8, kd: 0.1", "of structure fopi")):
        path.write_text(text[:fan] + text[fan:].replace(", alpha: 0.8", new), encoding="utf-8")
        with pytest.raises(SpecError, match=said):
            load_system(path)
    path.write_text(text[:fan].replace("kd: ", "alpha: 1, mu: 1, kd: ", 1) + text[fan:], encoding="utf-8")
    assert isinstance(load_system(path).modes[0].gains, ft.Pid)
    with pytest.raises(DomainError, match="heater: the gains are of another structure"):
        ft.simulate_system(path, {"heater": ft.FoPi(0.1, 0.1, 1.0)})
    spec = tmp_path / "heater.yaml"
    for new, said in (
        ("derivative_filter_time_constant_s: {min: 0.1, max: 0.5}, x: 0", "filters of one time in this version"),
        ("measurement_filter: {order: 1, time_constant_s: 0.2}, derivative_filter_time_constant_s", "no measurement_f"),
    ):
        before = spec.read_text(encoding="utf-8")
        line = next(each for each in before.splitlines() if each.startswith("controller"))
        changed = line.replace("derivative_filter_time_constant_s", new, 1)
        if "x: 0" in new:
            changed = line[: line.index("derivative_filter")] + new.removesuffix(", x: 0") + "}"
        spec.write_text(before.replace(line, changed), encoding="utf-8")
        with pytest.raises(SpecError, match=said):
            load_system(path)
        spec.write_text(before, encoding="utf-8")
