"""One loop with its limits:  found and verified, refused where it is false, and true in simulations from everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import switched

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.proof.switched.saturated_loop import (
    SaturatedLoopProof,
    prove_saturated_loop,
    verify_saturated_loop,
)


def full(proof: SaturatedLoopProof) -> np.ndarray:
    size = len(proof.matrix)
    return np.array([[proof.matrix[max(i, j)][min(i, j)] for j in range(size)] for i in range(size)])


@pytest.mark.parametrize("index", [0, 1])
def test_the_car_decays_with_its_limits(index: int) -> None:
    proof = switched.certificate("reset").loops[index]
    assert proof is not None
    assert verify_saturated_loop(switched.model("reset").loops[index], 0.2, proof)
    assert proof.decay < 1.0


@pytest.mark.parametrize("index", [0, 1])
def test_simulated_states_shrink_as_stated(index: int) -> None:
    proof, loop = switched.certificate("reset").loops[index], switched.model("reset").loops[index]
    assert proof is not None
    c, p, rng = loop.controller, full(proof), np.random.default_rng(index)
    poles, residues, weights = (np.array(row) for row in (c.poles, c.residues, c.weights))
    setpoint, gain = (10.0, 4.39 / 0.1746) if index == 0 else (-0.4, 1.0)
    rest = setpoint / gain
    for _ in range(50):
        x, y = rng.normal(size=len(poles)) * 10.0 ** rng.uniform(-2, 1), rng.uniform(-50.0, 50.0)
        for _ in range(40):
            z = np.concatenate([[y - setpoint, x[0] - rest], x[1:]])
            m = -np.expm1(-0.2 * 0.1746) if index == 0 else -np.expm1(-0.2 / rng.uniform(1.6, 3.1))
            v = c.direct * (setpoint - y) + x.sum()
            u = min(max(v, c.limits[0]), c.limits[1])
            x = poles * (x + weights * c.tracking_gain * (u - v)) + residues * (setpoint - y)
            y = y + m * (gain * u - y)
            after = np.concatenate([[y - setpoint, x[0] - rest], x[1:]])
            # rounding of the quadratic form
            assert after @ p @ after <= proof.decay**2 * (z @ p @ z) * (1.0 + 1e-9)


def test_false_statements_are_refused() -> None:
    proof, loop = switched.certificate("reset").loops[1], switched.model("reset").loops[1]
    assert proof is not None
    slower = Uncertain(2.25, 1.6, 300.0)
    wider = PlantFamily("lag", {**loop.plant.parameters, "time_constant_s": slower})
    negative = (*proof.matrix[:-1], (*proof.matrix[-1][:-1], -proof.matrix[-1][-1]))
    assert not verify_saturated_loop(loop, 0.2, replace(proof, decay=0.9))
    assert not verify_saturated_loop(loop, 0.2, replace(proof, decay=1.0))
    assert not verify_saturated_loop(loop, 0.2, replace(proof, multiplier=0.0))
    assert not verify_saturated_loop(loop, 0.2, replace(proof, multiplier=-1.0))
    assert not verify_saturated_loop(loop, 0.2, replace(proof, matrix=negative))
    assert not verify_saturated_loop(loop, 0.2, replace(proof, matrix=proof.matrix[:-1]))
    assert not verify_saturated_loop(replace(loop, plant=wider), 0.2, proof)


def test_an_unstable_loop_has_no_proof() -> None:
    loop = switched.model("reset").loops[0]
    strong = replace(loop.controller, direct=50.0)
    assert prove_saturated_loop(replace(loop, controller=strong), 0.2) is None


@pytest.mark.thinned(2)
@pytest.mark.parametrize("delay", [0.4, 1.0])
def test_a_late_control_shrinks_as_stated(delay: float) -> None:
    proof, loop = switched.certificate("reset", delay).loops[1], switched.model("reset", delay).loops[1]
    assert proof is not None
    assert verify_saturated_loop(loop, 0.2, proof)
    assert not verify_saturated_loop(replace(loop, delay_samples=0.0), 0.2, proof)
    c, p, rng = loop.controller, full(proof), np.random.default_rng(3)
    poles, residues, weights = (np.array(row) for row in (c.poles, c.residues, c.weights))
    for _ in range(50):
        x, y, last = (
            rng.normal(size=len(poles)) * 10.0 ** rng.uniform(-2, 1),
            rng.uniform(-50.0, 50.0),
            rng.uniform(-1, 0),
        )
        for _ in range(40):
            z = np.array([y + 0.4, x[0] + 0.4, *x[1:], last + 0.4])
            v = c.direct * (-0.4 - y) + x.sum()
            u = min(max(v, -1.0), 0.0)
            x = poles * (x + weights * c.tracking_gain * (u - v)) + residues * (-0.4 - y)
            for control, part in ((last, delay), (u, 1.0 - delay)):
                y += -np.expm1(-0.2 * part / rng.uniform(1.6, 3.1)) * (control - y)
            last = u
            after = np.array([y + 0.4, x[0] + 0.4, *x[1:], last + 0.4])
            assert after @ p @ after <= proof.decay**2 * (z @ p @ z) * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("decay", "told"),
    [
        (0.9996534, "0.999654"),
        (0.93765, "0.9377"),
        (0.999999912345, "0.9999999124"),
        (0.0512, "0.052"),
        (1.0 - 2.0**-53, "0.9999999999999999"),
    ],
)
def test_a_decay_is_told_with_the_digits_of_its_distance_to_one_and_not_below_it(decay: float, told: str) -> None:
    found = SaturatedLoopProof((), 1.0, decay).told_decay
    assert found == told
    assert decay <= float(found) < 1.0
