"""Designs of every structure for scenarios: no gains of a search by another method are better, and limits hold."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from cases.scenario_designs import parsed
from oracles.scenario_gains import best_of, drawn, grid, missed, near, objective

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.search import design_for_scenarios
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

TEXT = """
schema: 1
name: structures
plant: {{{plant}}}
controller: {{kp: {{min: 0, max: 20}}, ki: {{min: 0, max: 20}}, {controller}}}
requirements: [{{sensitivity_db: {{at_most: 5}}}}, {requirements}]
objective: {{{objective}}}
digital: {{sample_time_s: 0.1, {digital}}}
scenarios:
  - {{name: step, duration_s: 12, reference: [{{at_s: 0, value: 1}}]}}
  - {{name: load, duration_s: 12, reference: [{{at_s: 0, value: 0}}], load: [{{at_s: 0, value: 1}}]}}
"""
LAG = "model: lag, static_gain: {min: 0.8, max: 1.2}, time_constant_s: 1, dead_time_s: 0.3"
THREE_LAGS = "model: transfer_function, numerator: [1], denominator: [1, 3, 3, {min: 0.8, max: 1.2}]"
SLOW_POLE = "model: pole, gain: 1, pole_rad_s: {min: -0.3, max: -0.1}, dead_time_s: 0.2"
KD = "kd: {min: 0, max: 20}, derivative_filter_time_constant_s: 0.2"
PID, ORDERS = f"structure: pid, {KD}", "alpha: {min: 0.6, max: 1.4}, mu: {min: 0.5, max: 1}"
CALM, EASY = "{overshoot: {at_most: 0.05}, scenario: step}", "{peak_control: {at_most: 4}, scenario: step}"
NOISE = "{control_sensitivity_db: {at_most: 16}}"
CASES = {
    "pid": (LAG, PID, f"{CALM}, {NOISE}", "minimize: iae, scenario: load", "poles: 5"),
    "weight": (LAG, f"{PID}, setpoint_weight: 0.5", f"{CALM}, {NOISE}", "minimize: ise, scenario: step", "poles: 5"),
    "free weight": (
        LAG, f"{PID}, setpoint_weight: {{min: 0, max: 1}}", f"{CALM}, {NOISE}", "minimize: iae, scenario: step",
        "poles: 5",
    ),
    "filter": (
        THREE_LAGS, "structure: pi, measurement_filter: {order: 1, time_constant_s: 0.2}", f"{CALM}, {EASY}",
        "minimize: iae, scenario: load", "poles: 5, delay_samples: 1",
    ),
    "fopid": (THREE_LAGS, f"structure: fopid, {KD}, {ORDERS}", f"{CALM}, {NOISE}", "maximize: ki", "poles: 4"),
    "limits": (
        SLOW_POLE, f"{PID}, setpoint_weight: 0.8", f"{CALM}, {NOISE}", "minimize: iae, scenario: step",
        "poles: 4, output_limits: [-1, 1.5], output_rate_per_s: 4",
    ),
    "settling": (LAG, PID, f"{NOISE}, {EASY}", "minimize: settling_time_s, scenario: step", "poles: 4"),
}  # fmt: skip
SHORT = ("pid", "filter")
#: relative; what a search of the worst plants leaves
OPTIMAL = 1e-3


def spec_of(name: str) -> DesignSpec:
    plant, controller, requirements, aim, digital = CASES[name]
    text = TEXT.format(plant=plant, controller=controller, requirements=requirements, objective=aim, digital=digital)
    return parsed(text)


@lru_cache
def solved(name: str) -> tuple[DesignSpec, FoPi, Candidate]:
    spec = spec_of(name)
    found = design_for_scenarios(spec)
    assert found.status is Status.SOLVED, found.message
    assert found.gains is not None
    return spec, found.gains, found


@pytest.mark.parametrize("name", [pytest.param(k, marks=() if k in SHORT else pytest.mark.long) for k in CASES])
def test_limits_hold_and_no_gains_nearby_are_better(name: str) -> None:
    spec, gains, _ = solved(name)
    points = np.vstack([grid(spec, 9), drawn(spec, 20, seed=3)])
    assert max(missed(spec, gains, points)) <= 1e-6
    here = objective(spec, gains, points)
    best, other = best_of(spec, near(spec, gains, 40, seed=7), points, here * (1.0 - np.sign(here) * OPTIMAL))
    assert other is None, f"{other} has {best}, {gains} has {here}"


@pytest.mark.long
@pytest.mark.parametrize("name", ["pid", "weight", "free weight", "filter", "limits"])
def test_no_gains_of_the_whole_box_are_better(name: str) -> None:
    """A grid of gains, evenly in their logarithms, then those about its best ones."""
    spec, gains, _ = solved(name)
    points = grid(spec, 3)
    ranges = spec.controller.ranges
    axes = [
        [ends.min]
        if ends.is_fixed
        else [0.0, 0.3, 0.6, 0.8, 1.0]
        if key == "setpoint_weight"
        else [*np.geomspace(0.02, min(ends.max, 20.0), 12), *([0.0] if key == "kd" else [])]
        for key, ends in ranges.items()
    ]
    here = objective(spec, gains, points)
    tried = (replace(gains, **dict(zip(ranges, values, strict=True))) for values in itertools.product(*axes))
    best, other = best_of(spec, tried, points, np.inf)
    assert other is not None
    for seed in range(4):
        better, nearby = best_of(spec, near(spec, other, 150, seed), points, best)
        best, other = better, other if nearby is None else nearby
    assert here <= best * (1.0 + OPTIMAL), f"{other} has {best}, {gains} has {here}"


@pytest.mark.long
@pytest.mark.parametrize("name", ["pid", "weight"])
def test_multipliers_are_what_other_limits_are_worth(name: str) -> None:
    spec, gains, found = solved(name)
    (overshoot,) = spec.scenario_requirements
    (price,) = found.scenario_multipliers
    assert price is not None
    assert price > 0.0
    values, points = [], grid(spec, 9)
    for by in (-0.002, 0.002):
        moved = replace(spec, scenario_requirements=(replace(overshoot, limit=overshoot.limit + by),))
        other = design_for_scenarios(moved, start=gains)
        assert other.gains is not None
        values.append(objective(moved, other.gains, points))
    assert price == pytest.approx((values[0] - values[1]) / 0.004, rel=0.03)


@pytest.mark.long
def test_clashing_requirements_are_named_with_the_limits_that_can_be_had() -> None:
    plant, controller, _, aim, digital = CASES["pid"]
    hard = "{overshoot: {at_most: 0.01}, scenario: step}, {rise_time_s: {at_most: 0.2}, scenario: step}"
    spec = parsed(TEXT.format(plant=plant, controller=controller, requirements=hard, objective=aim, digital=digital))
    found = design_for_scenarios(spec)
    assert found.status is Status.INFEASIBLE
    first = len(spec.requirements)
    relaxed = {each.requirement - first: each.new_limit for each in found.clash if each.requirement >= first}
    assert relaxed
    for index, limit in relaxed.items():
        own = spec.scenario_requirements[index]
        assert limit is not None
        assert limit > own.limit
        # with that limit and the others as they are there are gains
        others = tuple(replace(each, limit=limit) if each is own else each for each in spec.scenario_requirements)
        assert design_for_scenarios(replace(spec, scenario_requirements=others)).status is Status.SOLVED


def test_a_weight_with_a_range_is_as_good_as_any_in_it() -> None:
    spec, gains, _ = solved("free weight")
    assert gains.setpoint_weight is not None
    assert 0.0 <= gains.setpoint_weight <= 1.0
    here, points = objective(spec, gains, grid(spec, 9)), grid(spec, 9)
    box = spec.controller
    for weight in (0.3, 1.0):
        fixed = replace(spec, controller=replace(box, setpoint_weight=weight, setpoint_weight_range=None))
        other = design_for_scenarios(fixed)
        assert other.gains is not None
        assert other.gains.setpoint_weight is None
        assert here <= objective(fixed, other.gains, points) * (1.0 + 1e-4)
