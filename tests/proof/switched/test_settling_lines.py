"""Lines of their own, relative to the setpoint:  what is proved of them is never contradicted by simulation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run

from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.proof.switched import SystemCertificate, SystemVerdict, prove_system, recheck_system
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.proof.switched.entries import why_no_entries
from fopi_tune.proof.switched.model import SwitchedModel
from fopi_tune.proof.switched.settling import verify_settling
from fopi_tune.proof.switched.settling_search import prove_settling
from fopi_tune.spec import load_system
from fopi_tune.spec.model import SystemSpec

LANES, SAMPLES = 200, 2500


def lines(upper: float, lower: float) -> SwitchingLines:
    return SwitchingLines(Threshold(upper), Threshold(lower))


def random_system(folder: Path, seed: int) -> SystemSpec:
    """Two lags, gains that may or may not suit them, and lines on either side of the setpoint."""
    rng = np.random.default_rng(seed)
    delay = float(rng.choice([0.0, 0.0, 0.4, 1.0]))
    low = rng.uniform(0.5, 2.0)
    plants = (
        f"{{model: lag, static_gain: {rng.uniform(15.0, 30.0)!r}, time_constant_s: {rng.uniform(2.0, 6.0)!r}}}",
        f"{{model: lag, static_gain: 1, time_constant_s: {{min: {low!r}, max: {low * rng.uniform(1.0, 2.0)!r}}}}}",
    )
    for name, plant in zip(("heater", "fan"), plants, strict=True):
        (folder / f"{name}.yaml").write_text(
            f"schema: 1\nname: {name}\nplant: {plant}\nrequirements: [{{phase_margin_deg: {{at_least: 5}}}}]\n"
            f"digital: {{sample_time_s: 0.1, poles: 3, delay_samples: {delay}}}\n"
        )
    upper = rng.uniform(0.02, 1.5)
    lower = float(rng.choice([upper - rng.uniform(0.05, 2.0), -upper - rng.uniform(0.0, 1.0)]))
    if rng.random() < 0.15:
        upper, lower = -0.1, lower - upper - 0.1
    kp, ki = rng.uniform(0.02, 0.2), rng.uniform(0.005, 0.08)
    dwell = "" if delay or rng.random() < 0.6 else f"  min_dwell_s: {rng.choice([0.3, 1.0])}\n"
    path = folder / "pair.yaml"
    path.write_text(
        "schema: 1\nname: pair\nsystem:\n"
        f"  heater: {{spec: heater.yaml, gains: {{kp: {kp!r}, ki: {ki!r}, alpha: 1}}, output_limits: [0, 1]}}\n"
        f"  fan: {{spec: fan.yaml, gains: {{kp: {6.0 * kp!r}, ki: {6.0 * ki!r}, alpha: 0.9}}, output_limits: [-8, 0]}}\n"
        f"  to_fan_above: {upper!r}\n  to_heater_below: {lower!r}\n{dwell}"
        f"  inactive: {rng.choice(['reset', 'reset', 'tracking', 'held'])}\n"
        "scenarios: [{name: day, duration_s: 20, reference: [{at_s: 0, value: 8}]}]\n"
    )
    return load_system(path)


def assert_uncontradicted(system: SystemSpec, found: SystemCertificate, seed: int) -> None:
    """Drive what is claimed from many states, or into each orbit."""
    model, proof, rng = found.model, found.settling, np.random.default_rng(seed)
    (gain, tau), fan = (system.modes[0].spec.plant.parameters[key] for key in ("static_gain", "time_constant_s")), None
    fan = system.modes[1].spec.plant.parameters["time_constant_s"]
    heater = -np.expm1(-0.1 / tau.nominal), gain.nominal
    delay = model.loops[0].delay_samples
    waits = None
    if proof is not None:
        setpoint = rng.uniform(*proof.setpoints, LANES)
        taus = rng.choice([fan.min, fan.max], (SAMPLES, LANES))
        taus[:, ::2] = rng.uniform(fan.min, fan.max, LANES)[::2]
        if model.memory.value == "reset" and found.settles:
            memories = [rng.normal(size=(size, LANES)) * 0.3 for size in model.sizes]
            output, mode = rng.uniform(0.0, 1.5 * gain.nominal, LANES), rng.integers(0, 2, LANES)
        else:
            output = setpoint + max(model.upper, 0.0) + rng.uniform(0.01, 10.0, LANES)
            memories, mode = [np.zeros((size, LANES)) for size in model.sizes], np.zeros(LANES, dtype=np.int64)
            memories[0][0] = output / gain.nominal
        shares = -np.expm1(-0.1 / taus)
        traces = run(model, setpoint, output, mode, memories, heater, (shares, 1.0), waits, delay)
        if model.memory.value != "reset" or found.settles:
            assert np.sum(traces.mode[1:] != traces.mode[:-1], axis=0).max() <= 3
        back = (traces.mode[1:] == 0) & (traces.mode[:-1] == 1)
        for lane in np.flatnonzero(back.any(axis=0)):
            first = 1 + int(np.flatnonzero(back[:, lane])[-1])
            driven = np.flatnonzero(traces.mode[:first, lane] == 0)
            entered = int(driven[-1]) + 1 if len(driven) else 0
            # the entries that are covered: the fan was active above its line before
            if traces.y[entered, lane] > setpoint[lane] + model.lower:
                error = setpoint[lane] - traces.y[first:, lane]
                assert error.max() <= proof.undershoot
                assert -error.min() <= proof.overshoot
                assert abs(error[-1]) <= 0.5 * max(proof.undershoot, 1e-6) or len(error) < 1500
    for cycle in [each for each in found.cycles if each.attracts][:3]:
        start = np.array([max(0.995 * gain.nominal, cycle.setpoint + 4.0 * max(abs(model.upper), abs(model.lower)))])
        memories = [np.zeros((size, 1)) for size in model.sizes]
        memories[0][0] = start / gain.nominal
        share = np.full((20_000, 1), -np.expm1(-0.1 / cycle.plants[1].get("time_constant_s", fan.nominal)))
        traces = run(
            model, np.array([cycle.setpoint]), start, np.zeros(1, dtype=np.int64), memories, heater, (share, 1.0), waits,
            delay,
        )  # fmt: skip
        period = len(cycle.modes)
        assert cycle.modes in "".join("TB"[each] for each in traces.mode[-2 * period :, 0])
        deviations = traces.y[-2 * period :, 0] - cycle.setpoint
        # what is left of the start
        assert deviations.min() == pytest.approx(cycle.lowest, abs=5e-3)
        assert deviations.max() == pytest.approx(cycle.highest, abs=5e-3)


def test_random_systems_do_what_is_claimed(tmp_path: Path) -> None:
    for seed in (0, 1):
        system = random_system(tmp_path, seed)
        gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
        assert_uncontradicted(system, prove_system(system, gains), seed)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 62))
def test_more_random_systems_do_what_is_claimed(tmp_path: Path, seed: int) -> None:
    system = random_system(tmp_path, seed)
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    found = prove_system(system, gains)
    assert_uncontradicted(system, found, seed)
    again = from_document(json.loads(json.dumps(to_document(found))))
    assert recheck_system(again, system, gains).accepted
