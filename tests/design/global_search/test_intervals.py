"""The allowed intervals of a ray against the exact quantities of core/ on a grid of kappa."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from cases.thinned import thinned

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import is_stable
from fopi_tune.design.global_search.compiled import work_for
from fopi_tune.design.global_search.intervals import allowed_intervals
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.tables import table_of
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec

PLANTS = {
    "lag": "{model: lag, static_gain: 2, time_constant_s: 3, dead_time_s: 0.4}",
    "undelayed": "{model: lag, static_gain: 1, time_constant_s: 1}",
    "integrator": "{model: pole, gain: 1.5, pole_rad_s: 0, dead_time_s: 0.3}",
    "unstable": "{model: pole, gain: 2, pole_rad_s: -0.5, dead_time_s: 0.1}",
    "undamped": "{model: transfer_function, numerator: [1], denominator: [1, 0, 1]}",
    "resonance": "{model: transfer_function, numerator: [1], denominator: [1, 0.1, 1], dead_time_s: 1.3}",
    "zero": "{model: transfer_function, numerator: [-0.4, 1], denominator: [1, 2.5, 2]}",
    "proper": "{model: transfer_function, numerator: [0.5, 1], denominator: [1, 2]}",
    "negative": "{model: lag, static_gain: -1.5, time_constant_s: 2, dead_time_s: 0.2}",
    "eighth": "{model: transfer_function, numerator: [1], denominator: [1, 8, 28, 56, 70, 56, 28, 8, 1]}",
}
#: asked for all requirements with -m long only
LONG = "undelayed", "undamped", "negative", "eighth"
REQUIREMENTS = [
    "sensitivity_db: {at_most: 4}",
    "sensitivity_db: {at_most: -10}, to_rad_s: 0.05",
    "sensitivity_db: {at_least: -30}, at_rad_s: 0.1",
    "complementary_sensitivity_db: {at_most: 2}",
    "complementary_sensitivity_db: {at_most: -6}, from_rad_s: 3",
    "control_sensitivity_db: {at_most: 8}",
    "loop_gain_db: {between: [-60, 20]}, from_rad_s: 0.3, to_rad_s: 5",
    "phase_margin_deg: {at_least: 50}",
    "phase_margin_deg: {at_most: 70}",
    "gain_margin_db: {at_least: 8}",
    "gain_margin_db: {between: [4, 12]}",
    "delay_margin_s: {at_least: 0.5}",
    "delay_margin_s: {at_most: 2}",
    "crossover_rad_s: {at_least: 0.4}",
    "crossover_rad_s: {at_most: 1.2}",
    "phase_slope_deg_per_decade: {at_least: -60}",
    "phase_slope_deg_per_decade: {at_most: -10}",
    "load_sensitivity_db: {at_most: -2}",
    "load_sensitivity_db: {at_most: -20}, to_rad_s: 0.1",
    "load_sensitivity_db: {at_least: -30}, at_rad_s: 0.1",
    "sensitivity_db: {at_most: {by_frequency: [[0.03, -25], [0.7, 3], [20, 4]]}}",
    "complementary_sensitivity_db: {at_most: {by_frequency: [[1, 4], [10, -12]]}}",
    "loop_gain_db: {at_least: {by_frequency: [[0.05, 15], [0.5, -5]]}}",
]
RAYS = [
    (0.5, 1.0, 0.3),
    (1.0, 0.3, 1.0),
    (1.3, 1.0, 1.0),
    (0.9, 1.0, 0.0),
    (1.0, 0.0, 1.0),
    (0.7, -0.4, 1.0),
    (1.1, -1.0, -0.5),
]
KAPPAS = np.linspace(-6.0, 6.0, 241) + 0.0123
#: neper; the grid shows the ends of intervals this exactly; of a slope it has differences only
NEAR, NEAR_OF_A_SLOPE = 0.06, 0.4


def spec_of(plant: str, requirement: str) -> DesignSpec:
    ranges = "{kp: {min: -100, max: 100}, ki: {min: -100, max: 100}, alpha: {min: 0.3, max: 1.6}}"
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {plant}\ncontroller: {ranges}\nrequirements:\n  - {{{requirement}}}\n"
    )


@cache
def guarded_loops(plant: str, scale: tuple[float, float], alpha: float, c: float, s: float) -> tuple[Loops, np.ndarray]:
    """The loops along a ray, and the indices of those that are stable and no closer to -1 than the guard, by core/.

    Requirements that leave the scale of gain and frequency as it is share them.
    """
    gain, omega_rad_s = scale
    k = np.exp(KAPPAS)
    plants = Plants.members(spec_of(PLANTS[plant], REQUIREMENTS[0]).plant, np.zeros((len(k), 0)))
    loops = Loops(k * c / gain, k * s / gain * omega_rad_s**alpha, np.full(len(k), alpha), plants)
    # of unstable loops nothing else is asked: some have more peaks than can be searched
    stable = np.flatnonzero(is_stable(loops))
    near = QUANTITIES["sensitivity_db"].measure(loops.take(stable), True, 0.0, np.inf).value > 40.0
    return loops, stable[~near]


def meets(problem: Problem, plant: str, alpha: float, c: float, s: float) -> np.ndarray:
    """By core/: stable, no closer to -1 than the guard, and every requirement met."""
    loops, guarded = guarded_loops(plant, (problem.scale.gain, problem.scale.omega_rad_s), alpha, c, s)
    good = np.zeros(len(KAPPAS), dtype=bool)
    good[guarded] = meets_limits(problem.spec, loops.take(guarded))
    return good


def meets_limits(spec: DesignSpec, loops: Loops) -> np.ndarray:
    good = np.ones(len(loops.kp), dtype=bool)
    for r in spec.requirements:
        for largest, limit in ((False, r.lower), (True, r.upper)):
            if math.isfinite(limit):
                value = QUANTITIES[r.quantity].measure(loops, largest, r.from_rad_s, r.to_rad_s, r.tilt).value
                with np.errstate(invalid="ignore"):
                    good = good & ((value <= limit) if largest else (value >= limit))
    return good


@pytest.mark.thinned(3)
@pytest.mark.parametrize("requirement", thinned(REQUIREMENTS))
@pytest.mark.parametrize("plant", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in PLANTS])
def test_the_allowed_intervals_are_those_of_the_exact_quantities(plant: str, requirement: str) -> None:
    problem = Problem.of(spec_of(PLANTS[plant], requirement))
    omega = np.exp(problem.fine_table.v[1:-1]) * problem.scale.omega_rad_s
    table = table_of(problem.scaled, np.zeros((1, 0)), omega, problem.horizon_s)
    rows, work = problem.rows(table), work_for(table)
    near = NEAR_OF_A_SLOPE if "slope" in requirement else NEAR
    for alpha, c, s in RAYS:
        if plant == "proper" and s == 0.0:
            continue  # |S| tends to its peak as omega grows without reaching it: core/ refuses that search
        count = allowed_intervals(alpha, c, s, -6.5, 6.5, table, rows, work)
        low, high = work.found[:count, 0], work.found[:count, 1]
        found = ((KAPPAS[:, None] >= low) & (KAPPAS[:, None] <= high)).any(axis=1)
        exact = meets(problem, plant, alpha, c, s)
        ends = np.concatenate([low, high, [-99.0]])
        clear = np.abs(KAPPAS[:, None] - ends).min(axis=1) > near
        wrong = clear & (found != exact)
        assert not wrong.any(), (
            alpha,
            c,
            s,
            KAPPAS[wrong],
            found[wrong],
            np.round(work.found[:count], 4),
            exact[wrong],
        )
