"""What the exchange does not do: what cannot change its answer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases.design_cases import CONTRADICTORY

import fopi_tune as ft
from fopi_tune.design import design
from fopi_tune.design.global_search.basins import scan_box
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.spec.model import DesignSpec

#: |C S| -> 1/|P(0)| as omega -> 0, and nothing asks for more
LEVEL = (
    "schema: 1\nname: x\n"
    "plant: {model: lag, static_gain: {nominal: 1.9, min: 1.6, max: 2.3}, time_constant_s: 3, dead_time_s: 1.5}\n"
    "controller: {kp: {min: 0, max: 20}, ki: {min: 0.01, max: 20}, alpha: {min: 0.6, max: 1.3}}\n"
    "requirements:\n  - {sensitivity_db: {at_most: -6.4}, to_rad_s: 0.0135}\n  - {phase_margin_deg: {at_least: 34}}\n"
    "objective: {minimize: control_sensitivity_peak_db}\n"
)
SPREAD = (
    "schema: 1\nname: x\nplant: {model: lag, static_gain: {nominal: 2.8, min: 2.2, max: 3.2}, "
    "time_constant_s: {nominal: 9, min: 7, max: 10}, dead_time_s: 5}\n"
    "controller: {kp: {min: 0, max: 14}, ki: {min: 0, max: 0.5}, alpha: {min: 0.63, max: 1.26}}\n"
    "requirements:\n  - {crossover_rad_s: {equals: 0.024}, on: nominal}\n  - {phase_margin_deg: {at_least: 26}}\n"
    "objective: {minimize: phase_margin_spread_deg}\n"
)


def spec_with_limit(db: float) -> DesignSpec:
    spec = ft.parse_spec(LEVEL)
    first = replace(spec.requirements[0], limits=(db,))
    return replace(spec, requirements=(first, *spec.requirements[1:]))


@pytest.mark.parametrize("digital", ["", "digital: {sample_time_s: 0.3, design: sampled}\n"])
def test_an_objective_that_no_gains_lower_is_its_limit_after_few_solves(digital: str) -> None:
    found = design(ft.parse_spec(LEVEL + digital))
    assert found.objective == pytest.approx(-20.0 * math.log10(1.6), abs=1e-8)
    assert found.solves <= 3
    assert found.multipliers == (0.0, 0.0)


def test_a_limit_that_changes_nothing_has_no_price() -> None:
    # the multipliers of 0 are what other limits show
    values = [design(spec_with_limit(db)).objective for db in (-6.5, -6.3)]
    assert values[0] == pytest.approx(values[1], abs=1e-9)


def test_gains_at_the_floor_have_an_integral() -> None:
    problem = Problem.of(ft.parse_spec(LEVEL))
    assert problem.is_at_floor(problem.floor, np.array([0.1, 0.1, 1.0]))
    assert not problem.is_at_floor(problem.floor, np.array([0.1, 0.0, 1.0]))
    assert not problem.is_at_floor(problem.floor + 1e-6, np.array([0.1, 0.1, 1.0]))
    assert Problem.of(ft.parse_spec(SPREAD)).floor == -math.inf


def test_a_start_whose_worst_cases_contradict_each_other_is_asked_once() -> None:
    polish = Polish(Problem.of(ft.parse_spec(CONTRADICTORY)))
    start = scan_box(polish.problem, 1).basins[0].gains
    assert polish.run(start) is None
    solves = polish.counts.solves
    assert polish.run(start, 0.1) is None
    assert polish.counts.solves == solves


def test_an_exchange_that_comes_to_a_known_optimum_gives_that() -> None:
    polish = Polish(Problem.of(ft.parse_spec(SPREAD)))
    basins = scan_box(polish.problem, 3).basins
    best = polish.run(basins[0].gains)
    assert best is not None
    assert best.settled
    alone, solves = Polish(polish.problem), polish.counts.solves
    whole = alone.run(basins[1].gains)
    assert polish.run(basins[1].gains, rival=best) is best
    assert polish.counts.solves - solves < alone.counts.solves
    # the whole exchange ends there as well
    assert whole is not None
    assert whole.cost == pytest.approx(best.cost, rel=1e-5)
    assert not polish.problem.structure.are_apart(whole.x, best.x)


def test_a_plateau_of_the_complementary_sensitivity_holds_no_frequency() -> None:
    # |T| -> 1 as omega -> 0: its peaks there are rounding, and an equation of one had kept Ipopt from every answer
    spec = ft.parse_spec(
        "schema: 1\nname: x\nplant: {model: transfer_function, numerator: [{min: 0.6881, max: 0.8792}],"
        " denominator: [0.3001, {min: 0.9002, max: 1.15}, 1], dead_time_s: 0.415}\n"
        "controller: {structure: pi}\nrequirements:\n  - sensitivity_db: {at_most: 4.05}\n"
        "  - complementary_sensitivity_db: {at_most: 1.318}\n  - phase_margin_deg: {at_least: 42.636}\n"
        "  - {crossover_rad_s: {at_least: 0.02}, on: nominal}\nobjective: {minimize: sensitivity_peak_db}\n"
    )
    found = design(spec)
    # a slow loop's |S| rises above 1 in proportion to its crossover: half of the 0.27027 dB of 0.04 rad/s
    assert found.objective == pytest.approx(0.5 * 0.27027, rel=2e-3)
    assert found.solves <= 3


def test_a_first_step_out_of_a_basin_is_not_the_last_word() -> None:
    # 0.12 % had been lost; the best of SciPy's differential evolution on a table of the loop on samples is -22.71136 dB
    found = design(
        ft.parse_spec(
            "schema: 1\nname: x\nplant: {model: pole, gain: {nominal: 0.081846, min: 0.07264, max: 0.090731},"
            " pole_rad_s: 0, dead_time_s: {nominal: 1.3274, min: 1.1077, max: 1.5693}}\n"
            "controller: {kp: {min: 0, max: 27.382}, ki: {min: 0, max: 0.36314}, alpha: {min: 0.734, max: 1.355}}\n"
            "requirements:\n  - {sensitivity_db: {at_most: -8.983}, to_rad_s: 0.0022411}\n"
            "  - {phase_margin_deg: {at_least: 27.19}}\nobjective: {minimize: control_sensitivity_peak_db}\n"
            "digital: {sample_time_s: 0.1785, design: sampled}\n"
        )
    )
    assert found.objective is not None
    assert found.objective < -22.7113
