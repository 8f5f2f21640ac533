"""Periodic orbits of the car with held memories, and words that are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run

from fopi_tune.proof.switched.cycles import CycleProof, verify_cycle


def cycles(delay: float = 0.0) -> tuple[CycleProof, ...]:
    """What is proved, once for all tests."""
    return switched.certificate("held", delay).cycles


def test_many_places_have_an_orbit() -> None:
    places = {(each.setpoint, each.plants[1]["time_constant_s"]) for each in cycles()}
    assert len(places) == len(cycles()) >= 20
    assert all(each.attracts for each in cycles())
    assert all(
        each.highest > switched.CAR.lines.up.value and each.lowest < -switched.CAR.lines.up.value for each in cycles()
    )


@pytest.mark.thinned(7)
@pytest.mark.parametrize(("index", "delay"), [*((index, 0.0) for index in range(0, 20, 4)), (0, 0.4), (-1, 0.4)])
def test_a_simulation_ends_in_the_orbit(index: int, delay: float) -> None:
    proof = cycles(delay)[index]
    model, samples = switched.model("held", delay), 40_000
    setpoint, one = np.array([proof.setpoint]), np.array([25.0])
    memories = [np.zeros((size, 1)) for size in model.sizes]
    memories[0][0, 0] = 25.0 * 0.1746 / 4.39
    share = np.full((samples, 1), -np.expm1(-0.2 / proof.plants[1]["time_constant_s"]))
    throttle = -np.expm1(-0.2 * 0.1746), 4.39 / 0.1746
    found = run(model, setpoint, one, np.zeros(1, dtype=np.int64), memories, throttle, (share, 1.0), delay=delay)
    period = len(proof.modes)
    word = "".join("TB"[each] for each in found.mode[-2 * period :, 0])
    assert proof.modes in word
    deviations = found.y[-2 * period :, 0] - proof.setpoint
    # what is left of the start after 40,000 samples
    assert deviations.min() == pytest.approx(proof.lowest, abs=2e-3)
    assert deviations.max() == pytest.approx(proof.highest, abs=2e-3)


def test_false_words_are_refused() -> None:
    model, proof = switched.model("held"), cycles()[0]
    first = {"T": "B", "B": "T"}[proof.modes[0]] + proof.modes[1:]
    assert verify_cycle(model, proof) is not None
    for changed in (
        replace(proof, modes=first),
        replace(proof, parts=proof.parts[1:] + proof.parts[0]),
        replace(proof, setpoint=proof.setpoint + 5.0),
        replace(proof, modes="T" * len(proof.modes)),
        replace(proof, modes=proof.modes + "T"),
        replace(proof, parts="x" * len(proof.parts)),
        replace(proof, plants=({}, {"time_constant_s": 9.0})),
        replace(proof, plants=({}, {})),
        replace(proof, attraction=((1.0,),)),
        replace(proof, attraction=tuple(tuple(float(i == j) for j in range(i + 1)) for i in range(17))),
    ):
        assert verify_cycle(model, changed) is None, changed
    for memory in ("reset", "tracking"):
        assert verify_cycle(switched.model(memory), proof) is None
