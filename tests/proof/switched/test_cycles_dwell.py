"""Orbits with a minimum dwell:  found, followed by an independent simulation, and refused with another dwell."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run

from fopi_tune.proof.switched.cycle_search import prove_cycles
from fopi_tune.proof.switched.cycles import verify_cycle


def shortest_run(modes: str) -> int:
    """Samples of the shortest mode of a word that goes on in a circle."""
    turned = modes.lstrip(modes[0]) + modes[: len(modes) - len(modes.lstrip(modes[0]))]
    return min(len(list(part)) for _, part in itertools.groupby(turned))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("dwell", [3, 12])
def test_orbits_keep_the_dwell_and_a_simulation_ends_in_them(dwell: int) -> None:
    model, samples = replace(switched.model("held"), min_dwell_samples=dwell), 20_000
    found = prove_cycles(model, (6.0, 6.0))
    assert found
    proof = found[0]
    assert shortest_run(proof.modes) >= dwell
    memories = [np.zeros((size, 1)) for size in model.sizes]
    memories[0][0, 0] = 25.0 * 0.1746 / 4.39
    share = np.full((samples, 1), -np.expm1(-0.2 / proof.plants[1]["time_constant_s"]))
    throttle = -np.expm1(-0.2 * 0.1746), 4.39 / 0.1746
    traces = run(
        model, np.array([6.0]), np.array([25.0]), np.zeros(1, dtype=np.int64), memories, throttle, (share, 1.0)
    )
    word = "".join("TB"[each] for each in traces.mode[-2 * len(proof.modes) :, 0])
    assert proof.modes in word
    deviations = traces.y[-2 * len(proof.modes) :, 0] - 6.0
    # what is left of the start
    assert deviations.min() == pytest.approx(proof.lowest, abs=5e-3)
    assert deviations.max() == pytest.approx(proof.highest, abs=5e-3)


def test_an_orbit_is_one_of_its_own_dwell_only() -> None:
    held = switched.model("held")
    for proof in prove_cycles(replace(held, min_dwell_samples=12), (6.0, 6.0)):
        assert shortest_run(proof.modes) == 12
        # without the dwell the output is beyond the line where it kept the mode
        assert verify_cycle(held, proof) is None
        assert verify_cycle(replace(held, min_dwell_samples=shortest_run(proof.modes) + 1), proof) is None
    plain = next(each for each in switched.certificate("held").cycles if shortest_run(each.modes) < 12)
    assert verify_cycle(replace(held, min_dwell_samples=12), plain) is None


def test_with_a_dwell_of_ten_samples_each_orbit_of_the_published_car_is_wider() -> None:
    held = switched.model("held")
    plain, dwelling = (
        {
            (each.setpoint, each.plants[1]["time_constant_s"]): each.highest - each.lowest
            for each in prove_cycles(replace(held, min_dwell_samples=dwell), None)
        }
        for dwell in (0, 10)
    )
    assert len(plain) > 15
    assert set(plain) == set(dwelling)
    assert all(dwelling[place] > plain[place] for place in plain)
