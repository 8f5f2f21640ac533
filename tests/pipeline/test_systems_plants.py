"""Plants of modes with zeros and dead times, through every stage of a system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases.project import ROOT
from oracles.two_modes import drive

import fopi_tune as ft
from fopi_tune.errors import DomainError
from tests.pipeline.test_systems_examples import part_of, written

DUCT = ROOT / "systems" / "examples" / "duct.yaml"
LINES = (
    "hysteresis: 0.3", "to_lower_above: 0.6\n  to_raise_below: -0.4\n  coast: true",
    "to_lower_above: 0.4\n  to_raise_below: {absolute: 0.8}\n  min_dwell_s: 0.6",
)  # fmt: skip


def plant(rng: np.random.Generator, gain: float) -> str:
    """A stable plant of order 1 to 3 with real poles, fewer zeros, also to the right, and perhaps a dead time."""
    order = int(rng.integers(1, 4))
    bottom = np.array([1.0])
    for _ in range(order):
        bottom = np.convolve(bottom, [rng.uniform(0.3, 2.5), 1.0])
    top = np.array([gain])
    for _ in range(int(rng.integers(0, order))):
        top = np.convolve(top, [rng.uniform(-0.4, 1.5), 1.0])
    late = float(rng.choice([0.0, 0.2, rng.uniform(0.01, 1.2)]))
    rows = f"numerator: {[float(x) for x in top]}, denominator: {[float(x) for x in bottom]}"
    return f"{{model: transfer_function, {rows}, dead_time_s: {late}}}"


def random_system(folder: Path, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    delay = float(rng.choice([0.0, 1.0, 0.4]))
    for name, gain in (("raise", 12.0), ("lower", 9.0)):
        (folder / f"{name}.yaml").write_text(
            f"schema: 1\nname: {name}\nplant: {plant(rng, gain)}\nrequirements: [{{phase_margin_deg: {{at_least: 5}}}}]"
            f"\ndigital: {{sample_time_s: 0.2, poles: 3, delay_samples: {delay}}}\n"
        )
    inactive = rng.choice(["held", "reset", "tracking"])
    load = "load: [{at_s: 6.1, value: 0.05}, {at_s: 14, value: -0.03, ramp_s: 2}]" if rng.random() < 0.7 else ""
    path = folder / "pair.yaml"
    path.write_text(f"""\
schema: 1
name: pair
system:
  raise: {{spec: raise.yaml, gains: {{kp: 0.08, ki: 0.03, alpha: 0.9}}, output_limits: [0, 1]}}
  lower: {{spec: lower.yaml, gains: {{kp: 0.1, ki: 0.05, alpha: 1}}, output_limits: [-1, 0]}}
  {LINES[seed % 3]}
  inactive: {inactive}
scenarios:
  - name: day
    duration_s: 24
    initial_output: {3 if seed % 4 == 3 else 0}
    reference: [{{at_s: 0, value: 5}}, {{at_s: 8, value: 1}}, {{at_s: 16, value: 4, ramp_s: 3}}]
    {load}
""")
    return path


@pytest.mark.parametrize("seed", range(20))
def test_a_random_system_is_driven_as_its_words_say(tmp_path: Path, seed: int) -> None:
    path = random_system(tmp_path, seed)
    document = written(path)
    section, (scenario,) = document["system"], document["scenarios"]
    specs = [written(tmp_path / f"{name}.yaml") for name in ("raise", "lower")]
    parts = [part_of(section[name], spec, tmp_path) for name, spec in zip(("raise", "lower"), specs, strict=True)]
    delay = specs[0]["digital"]["delay_samples"]
    output, states = drive(section, (parts[0], parts[1]), ("raise", "lower"), scenario, 0.2, (delay, delay))
    (found,) = ft.simulate_system(path).driven
    assert np.array_equal(found.traces.mode[0], states)
    assert np.abs(found.traces.output[0] - output).max() <= 1e-9
    assert {1, 2} <= set(states)


def test_drawn_pairs_are_replayed_with_their_own_dead_times() -> None:
    found = ft.validate_system(DUCT, samples=60, seed=3)
    assert found.evidence.scenarios[0].finite.total == 60
    assert "heater.dead_time_s" in found.evidence.numbers
    one, two = (ft.simulate_system(DUCT, replay=index, samples=60, seed=3) for index in (0, 1))
    assert one.plant["heater.dead_time_s"] != two.plant["heater.dead_time_s"]
    assert np.abs(one.driven[0].traces.output - two.driven[0].traces.output).max() > 1e-3


def test_nothing_arrives_before_the_dead_time() -> None:
    # the control of the sample at 0.5 s, the first one with an error, is there at 3.8 s
    y = ft.simulate_system(DUCT).driven[0].traces.output[0]
    assert np.all(y[:7] == 0.0)
    assert y[7] < 1e-9
    assert y[8] > 1e-3


def test_continuous_time_names_the_dead_time() -> None:
    with pytest.raises(DomainError, match="heater: the dead time of its plant is simulated on samples; leave `exa"):
        ft.simulate_system(DUCT, exact=True)


def test_a_certificate_names_what_it_does_not_model() -> None:
    found = ft.prove_system(DUCT, setpoints=(4.0, 14.0)).certificate
    said = " ".join(found.statements)
    assert "a dead time is not modelled" in said or "only plants of model lag or pole" in said


def test_the_code_of_both_controllers_needs_no_plant() -> None:
    assert "fopi_duct_f64.c" in ft.discretize_system(DUCT).code()


@pytest.mark.long
def test_gains_of_a_mode_with_a_dead_time_are_designed(tmp_path: Path) -> None:
    for name in ("duct.yaml", "duct_heater.yaml", "duct_cooler.yaml"):
        (tmp_path / name).write_text((DUCT.parent / name).read_text())
    path = tmp_path / "duct.yaml"
    text = path.read_text().replace("gains: {kp: 0.04, ki: 0.008, alpha: 1}, ", "")
    design = "tune: [cooler]\nobjective: {minimize: iae}\nrequirements: [{overshoot: {at_most: 6}}]\n"
    path.write_text(text + design)
    spec = tmp_path / "duct_cooler.yaml"
    ranges = "controller: {kp: {min: 0, max: 0.3}, ki: {min: 0.0001, max: 0.1}, alpha: {min: 0.5, max: 1.3}}\n"
    spec.write_text(spec.read_text() + ranges)
    found = ft.tune_system(path)
    assert found.status.value == "solved"
    assert found.gains is not None
    before = ft.simulate_system(DUCT).driven[0].measures["iae"]
    assert ft.simulate_system(path, found.gains).driven[0].measures["iae"] < before
