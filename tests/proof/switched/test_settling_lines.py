"""Lines of their own, relative to the setpoint:  what is proved of them is never contradicted by simulation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import switched
from flint import arb
from oracles.switched_loop import run

from fopi_tune.core.bode_form import Array
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.proof.switched import SystemCertificate, prove_system, recheck_system
from fopi_tune.proof.switched.cycles import CycleProof, _maps, _samples_before_last_switch
from fopi_tune.proof.switched.definite import midpoints
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.proof.switched.model import SwitchedModel
from fopi_tune.proof.switched.recheck import ONCE_NOT_MODELLED
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
        f"  fan: {{spec: fan.yaml, gains: {{kp: {6 * kp!r}, ki: {6 * ki!r}, alpha: 0.9}}, output_limits: [-8, 0]}}\n"
        f"  to_fan_above: {upper!r}\n  to_heater_below: {lower!r}\n{dwell}"
        f"  inactive: {rng.choice(['reset', 'reset', 'tracking', 'held'])}\n"
        "scenarios: [{name: day, duration_s: 20, reference: [{at_s: 0, value: 8}]}]\n"
    )
    return load_system(path)


def assert_uncontradicted(system: SystemSpec, found: SystemCertificate, seed: int) -> None:
    """Drive what is claimed: from many states, and along each orbit."""
    model, proof, rng = found.model, found.settling, np.random.default_rng(seed)
    gain, tau = (system.modes[0].spec.plant.parameters[key] for key in ("static_gain", "time_constant_s"))
    fan = system.modes[1].spec.plant.parameters["time_constant_s"]
    heater = -np.expm1(-0.1 / tau.nominal), gain.nominal
    delay = model.loops[0].delay_samples
    if proof is not None:
        setpoint = rng.uniform(*proof.setpoints, LANES)
        taus = rng.choice([fan.min, fan.max], (SAMPLES, LANES))
        taus[:, ::2] = rng.uniform(fan.min, fan.max, LANES)[::2]
        if model.memory.value == "reset":
            # any state; half of them with the fan near its line, at what it can do at most
            memories = [rng.normal(size=(size, LANES)) * 0.3 for size in model.sizes]
            output, mode = rng.uniform(0.0, 1.5 * gain.nominal, LANES), rng.integers(0, 2, LANES)
            near = np.arange(LANES) % 2 == 0 if found.settles else np.full(LANES, fill_value=True)
            memories[1][0, near] = rng.choice([-20.0, -4.0, 0.0], int(near.sum()))
            output[near] = (setpoint + model.lower + rng.uniform(1e-9, 0.3, LANES))[near]
            mode[near] = 1
        else:
            output = setpoint + max(model.upper, 0.0) + rng.uniform(0.01, 10.0, LANES)
            memories, mode = [np.zeros((size, LANES)) for size in model.sizes], np.zeros(LANES, dtype=np.int64)
            memories[0][0] = output / gain.nominal
        shares = -np.expm1(-0.1 / taus)
        traces = run(model, setpoint, output, mode, memories, heater, (shares, 1.0), delay=delay)
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
    for cycle in found.cycles:
        # on the orbit: from afar another one may be reached
        y, raising, lowering, control = start_of(model, cycle)
        samples = len(cycle.modes) * max(3, 400 // len(cycle.modes))
        share = np.full((samples, 1), -np.expm1(-0.1 / cycle.plants[1].get("time_constant_s", fan.nominal)))
        lasted = _samples_before_last_switch(cycle.modes)[0]
        waits, last = np.array([max(model.min_dwell_samples - lasted, 0)]), np.array(["TB".index(cycle.modes[-1])])
        setpoint = np.array([cycle.setpoint])
        traces = run(
            model,
            setpoint,
            y,
            last,
            [raising, lowering],
            heater,
            (share, 1.0),
            waits,
            delay,
            control if delay else None,
        )
        assert "".join("TB"[each] for each in traces.mode[:, 0]) == cycle.modes * (samples // len(cycle.modes))
        # rounding of the start, which the period may enlarge where it does not attract
        assert traces.y.min() - cycle.setpoint == pytest.approx(cycle.lowest, abs=1e-6)
        assert traces.y.max() - cycle.setpoint == pytest.approx(cycle.highest, abs=1e-6)


def start_of(model: SwitchedModel, cycle: CycleProof) -> tuple[Array, Array, Array, Array]:
    """y, both memories and the last control where the orbit begins, in floats; that it is one, the simulation shows."""
    maps = [midpoints(each.matrix) for each in _maps(model, cycle, arb(cycle.setpoint))]
    whole = np.eye(len(maps[0]))
    for each in maps:
        whole = each @ whole
    z = np.asarray(np.linalg.solve(np.eye(len(whole) - 1) - whole[:-1, :-1], whole[:-1, -1]), dtype=float)
    one, other = model.sizes
    return z[:1], z[1 : 1 + one, None].copy(), z[1 + one : 1 + one + other, None].copy(), z[-1:]


@pytest.mark.parametrize(("seed", "setpoints"), [(0, (5.0, 9.0)), (6, (5.0, 9.0)), (5, (8.0, 8.0))])
def test_random_systems_do_what_is_claimed(tmp_path: Path, seed: int, setpoints: tuple[float, float]) -> None:
    system = random_system(tmp_path, seed)
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    found = prove_system(system, gains, setpoints=setpoints)
    assert (found.verdict.value == "cycles") == (seed == 5)
    assert found.settles == (seed != 5)
    assert_uncontradicted(system, found, seed)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 62))
def test_more_random_systems_do_what_is_claimed(tmp_path: Path, seed: int) -> None:
    system = random_system(tmp_path, seed)
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    found = prove_system(system, gains)
    assert_uncontradicted(system, found, seed)
    again = from_document(json.loads(json.dumps(to_document(found))))
    assert recheck_system(again, system, gains).accepted


def car_with(upper: float, lower: float) -> SwitchedModel:
    return SwitchedModel.of(switched.car("reset", hysteresis=lines(upper, lower)), switched.GAINS)


def test_lines_of_a_hysteresis_are_that_hysteresis() -> None:
    proof = switched.certificate("reset").settling
    assert proof is not None
    eps = switched.CAR.lines.up.value
    assert verify_settling(car_with(eps, -eps), proof) == verify_settling(switched.model("reset"), proof)


def test_each_line_has_its_own_part_in_a_proof() -> None:
    proof = switched.certificate("reset").settling
    assert proof is not None
    eps = switched.CAR.lines.up.value
    same, wider, deeper = (verify_settling(car_with(*each), proof) for each in ((eps, -eps), (2.0, -eps), (eps, -1.0)))
    assert same is not None
    # the upper line is above all that the output does; the lower one is where it begins
    assert wider == same
    assert deeper is not None
    assert deeper.undershoot > same.undershoot + 0.05
    assert verify_settling(car_with(0.9 * proof.overshoot, -eps), proof) is None
    assert verify_settling(car_with(eps, -2.5), proof) is None


@pytest.mark.parametrize(
    ("upper", "lower", "words"),
    [
        (-0.1, -1.0, "the throttle is left before it rests at the setpoint; write to_brake_above above 0"),
        (0.4, 0.4, "both lines are one, so that a switch may follow every sample; write to_throttle_below lower"),
    ],
)
def test_lines_between_which_nothing_rests_are_named(upper: float, lower: float, words: str) -> None:
    assert prove_settling(car_with(upper, lower), None).reason == words
    proof = switched.certificate("reset").settling
    assert proof is not None
    assert verify_settling(car_with(upper, lower), proof) is None


def test_a_certificate_of_before_relative_lines_is_still_accepted() -> None:
    found = prove_system(switched.car("reset", hysteresis=lines(1.0, -0.5)), switched.GAINS, setpoints=(6.0, 6.0))
    assert found.settles
    once = replace(found, settling=None, reason=ONCE_NOT_MODELLED)
    assert recheck_system(once).accepted
    entries = {"hysteresis": SwitchingLines(Threshold(1.0), Threshold(1.0))}
    assert not recheck_system(replace(once, model=replace(once.model, **entries), reason="another")).accepted
