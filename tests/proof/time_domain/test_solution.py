"""Trajectories of boxes hold those of simulated plants, and are as close to them as the third power of the box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.plants import lag, pole, transfer_function
from cases.time_domain_cases import case_of, random_case

import fopi_tune as ft
from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.time_domain import TimeDomainCase
from fopi_tune.proof.time_domain.enclosure import Enclosure
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec.model import Knot, ScenarioSpec

#: above the rounding of a simulation
ROUNDING = 1e-9
GAINS = ft.FoPi(0.4, 0.3, 0.9)
STEP = ScenarioSpec("step", 12.0, (Knot(0.0, 1.0),), (Knot(5.0, 0.3),))
FAMILIES = {
    "lag": lag((1.0, 0.9, 1.1), (1.0, 1.4), 0.25),
    "dead time": lag(1.0, 1.2, (0.21, 0.29)),
    "integrator": pole((0.55, 0.65), (-0.01, 0.02)),
    "unstable": pole(1.0, (-0.25, -0.15)),
    "second order": transfer_function([(0.9, 1.1)], [1.0, (1.2, 1.6), 1.0], 0.3),
    "zero": transfer_function([-0.3, 1.0], [1.0, 2.0, (0.9, 1.1)], (0.21, 0.29)),
    "double integrator and lag": transfer_function([0.5, 1.0], [0.2, (0.9, 1.1), 0.0]),
    "third order": transfer_function([1.0], [0.1, 0.8, (1.5, 1.7), 1.0]),
    "direct path": transfer_function([(0.15, 0.25), 1.0], [(0.9, 1.1), 1.0], 0.25),
    "no dynamics": transfer_function([(0.4, 0.6)], [1.0], 0.3),
}


def share_of(family: PlantFamily, share: float) -> Box:
    """A box about the nominal plant."""
    numbers = (family.parameters[name] for name in family.uncertain_names)
    return tuple((n.nominal - share * (n.nominal - n.min), n.nominal + share * (n.max - n.nominal)) for n in numbers)


def inside(case: TimeDomainCase, box: Box, count: int = 60) -> tuple[Array, float]:
    """How far the largest rest reaches, and how far simulations leave the enclosure."""
    found = Enclosure(case).trajectory(box)
    assert found is not None
    ends = np.array(box).reshape(-1, 2)
    shares = np.vstack([np.random.default_rng(1).random((count, len(ends))), np.zeros(len(ends)), np.ones(len(ends))])
    plants = Plants.members(case.family, ends[:, 0] + shares * (ends[:, 1] - ends[:, 0]))
    traces = simulate([Mode(case.controller, plants)], case.run)
    low, high = case.output_limits
    output, v = traces.output - found.plants.output, found.demanded
    # v itself is not among the signals; within the limits it is what is applied
    off = [found.output.low - output.min(axis=0), output.max(axis=0) - found.output.high]
    off += [np.clip(v.low, low, high) - traces.demanded.min(axis=0)]
    off += [traces.demanded.max(axis=0) - np.clip(v.high, low, high)]
    return found.output.rest, float(np.max(off))


@pytest.mark.parametrize("name", FAMILIES)
def test_enclosures_hold_simulations_and_shrink_with_the_third_power(name: str) -> None:
    case = case_of(FAMILIES[name], GAINS, 0.2, STEP, delay_samples=0.5)
    rests = []
    # in the last one a wrong term of second order would be larger than what is left out
    for share in (0.3, 0.15, 0.02):
        rest, off = inside(case, share_of(case.family, share))
        assert off <= ROUNDING
        rests.append(float(rest.max()))
    assert rests[1] <= rests[0] / 6.0


@pytest.mark.parametrize("limits", [(-0.2, 0.55), (0.1, 0.5), (-1.0, 0.45)])
@pytest.mark.parametrize("gains", [GAINS, ft.FoPi(1.5, 0.6, 1.1)])
def test_limited_loops_and_starts_at_a_limit(limits: tuple[float, float], gains: ft.FoPi) -> None:
    for bumpless in (False, True):
        scenario = replace(STEP, initial_output=-0.5, bumpless=bumpless)
        case = case_of(lag(2.0, (1.0, 1.3)), gains, 0.2, scenario, limits)
        rest, off = inside(case, share_of(case.family, 0.1))
        assert off <= ROUNDING
        assert np.all(np.isfinite(rest))


def test_random_loops_at_single_plants_are_their_simulations() -> None:
    for seed in range(300, 330):
        case = random_case(seed)
        box = tuple((value, value) for value in case.family.nominal_point.tolist())
        found = Enclosure(case).trajectory(box)
        assert found is not None, seed
        traces = simulate(
            [Mode(case.controller, Plants.members(case.family, case.family.nominal_point[None, :]))], case.run
        )
        size = max(1.0, float(np.abs(traces.output).max()))
        assert np.abs(found.output.values + found.plants.output - traces.output[0]).max() <= ROUNDING * size, seed
        assert found.output.rest.max() <= ROUNDING * size, seed


def test_loops_that_are_too_different_are_told() -> None:
    enclosure = Enclosure(case_of(lag((0.1, 10.0), (0.1, 10.0)), GAINS, 0.2, STEP))
    assert enclosure.trajectory(((0.1, 10.0), (0.1, 10.0))) is None or enclosure.reason == ""
    late = Enclosure(case_of(lag(1.0, 1.0, (0.1, 0.5)), GAINS, 0.2, STEP))
    assert late.trajectory(((0.1, 0.5),)) is None
    assert "whole number of samples" in late.reason
