"""Settling:  proved for the car, refused when it is false, and never contradicted by simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run

from fopi_tune.proof.switched.settling import SettlingProof, verify_settling

MEMORIES = ("reset", "tracking")
#: bounds on r - y after the switch, which an independent program found
UNDERSHOOT = {"reset": 4.994, "tracking": 5.24}


def proof_of(memory: str, delay: float = 0.0) -> SettlingProof:
    proof = switched.certificate(memory, delay).settling
    assert proof is not None
    return proof


@pytest.mark.parametrize("memory", MEMORIES)
def test_the_car_settles_on_every_setpoint_it_is_driven_at(memory: str) -> None:
    proof = proof_of(memory)
    assert proof.setpoints == switched.SETPOINTS
    found = verify_settling(switched.model(memory), proof)
    assert found is not None
    assert (found.undershoot, found.overshoot) == (proof.undershoot, proof.overshoot)
    assert 4.9 < proof.undershoot < UNDERSHOOT[memory]
    assert proof.overshoot < switched.CAR.lines.up.value


@pytest.mark.thinned(slow=["tracking"])
@pytest.mark.parametrize("memory", MEMORIES)
def test_false_statements_are_refused(memory: str) -> None:
    model, proof = switched.model(memory), proof_of(memory)
    for changed in (
        replace(proof, setpoints=(2.0, 25.2)),
        replace(proof, setpoints=(0.4, 22.0)),
        replace(proof, setpoints=(22.0, 2.0)),
        replace(proof, samples=proof.samples // 4),
        replace(proof, samples=0),
        replace(proof, decay=0.99),
        replace(proof, decay=1.0),
        replace(proof, matrix=proof.matrix[:-1]),
        replace(proof, matrix=tuple(tuple(-number for number in row) for row in proof.matrix)),
    ):
        assert verify_settling(model, changed) is None
    assert verify_settling(replace(model, hysteresis=0.05), proof) is None
    assert verify_settling(switched.model("held"), proof) is None


@pytest.mark.thinned(slow=["1.0", "0.4"])
@pytest.mark.parametrize(
    ("memory", "delay"), [("reset", 0.0), ("tracking", 0.0), ("reset", 0.4), ("tracking", 1.0), ("reset", 1.0)]
)
def test_no_simulation_contradicts(memory: str, delay: float) -> None:
    model, proof, rng = switched.model(memory, delay), proof_of(memory, delay), np.random.default_rng(7)
    lanes, samples = 500, 3000
    setpoint = rng.uniform(*proof.setpoints, lanes)
    throttle = -np.expm1(-0.2 * 0.1746), 4.39 / 0.1746
    # time constants that jump, drift or stay
    taus = rng.choice([1.6, 3.1], (samples, lanes))
    taus[:, ::3], taus[:, 1::3] = rng.uniform(1.6, 3.1, (samples, len(setpoint[::3]))), 1.6
    brake = -np.expm1(-0.2 / taus), 1.0
    if memory == "reset":
        # any state, also ones that no loop reaches
        memories = [rng.normal(size=(size, lanes)) * 0.5 for size in model.sizes]
        output, mode = rng.uniform(0.0, 40.0, lanes), rng.integers(0, 2, lanes)
    else:
        output = setpoint + rng.uniform(0.5, 20.0, lanes)
        memories, mode = [np.zeros((size, lanes)) for size in model.sizes], np.zeros(lanes, dtype=np.int64)
        memories[0][0] = output / throttle[1]
    found = run(model, setpoint, output, mode, memories, throttle, brake, delay=delay)
    switches = np.sum(found.mode[1:] != found.mode[:-1], axis=0)
    assert switches.max() <= 3
    back = (found.mode[1:] == 0) & (found.mode[:-1] == 1)
    assert np.sum(back) > 100
    for lane in np.flatnonzero(back.any(axis=0)):
        first = 1 + int(np.flatnonzero(back[:, lane])[-1])
        # a brake that was active below the setpoint at the start is no entry
        if found.y[first - 1, lane] > setpoint[lane] - model.hysteresis:
            error = setpoint[lane] - found.y[first:, lane]
            assert error.max() <= proof.undershoot
            assert -error.min() <= proof.overshoot


@pytest.mark.thinned(slow=["tracking"])
@pytest.mark.parametrize("memory", MEMORIES)
def test_a_computing_delay_makes_the_undershoot_larger(memory: str) -> None:
    bounds = [proof_of(memory, delay).undershoot for delay in (0.0, 0.4, 1.0)]
    assert bounds == sorted(bounds)
    assert bounds[2] > bounds[0] + 0.5


def test_a_proof_for_one_delay_does_not_hold_for_another() -> None:
    assert verify_settling(switched.model("reset", 0.4), proof_of("reset")) is None
    assert verify_settling(switched.model("reset"), proof_of("reset", 0.4)) is None
