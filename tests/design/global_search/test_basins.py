"""The scan: starts that differ, and no more work than is asked for."""

from __future__ import annotations

import numpy as np

import fopi_tune as ft
from fopi_tune.design.global_search.basins import scan_box
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.structures import FRACTIONAL, WITH_DERIVATIVE, WITH_ORDERS

RESONANT = (
    "schema: 1\nname: x\n"
    "plant: {model: transfer_function, numerator: [{nominal: 1.43, min: 1.16, max: 1.52}],"
    " denominator: [0.0097, {nominal: 0.074, min: 0.061, max: 0.085}, 1]}\n"
    "controller: {kp: {min: 0, max: 28}, ki: {min: 0, max: 905}, alpha: {min: 0.7, max: 1.25}}\n"
    "requirements:\n  - {crossover_rad_s: {at_least: 3.2}, on: nominal}\n  - {phase_margin_deg: {at_least: 38}}\n"
    "objective: {minimize: crossover_spread_db}\n"
)


def test_basins_that_differ_in_the_order_of_an_idle_term_are_one() -> None:
    problem = Problem.of(ft.parse_spec(RESONANT))
    idle = [basin.gains for basin in scan_box(problem, 3).basins if 0.0 < basin.gains[1] < 1e-3 * basin.gains[0]]
    # kp alone tells such basins apart; by their orders there were four
    assert len(idle) == 1


def test_orders_of_small_terms_do_not_count() -> None:
    assert FRACTIONAL.without_idle_orders(np.array([1.0, 1e-4, 0.9])).tolist() == [1.0, 1e-4, 0.0]
    assert FRACTIONAL.without_idle_orders(np.array([1.0, 0.1, 0.9])).tolist() == [1.0, 0.1, 0.9]
    assert WITH_DERIVATIVE.without_idle_orders(np.array([1.0, 0.0, 1e-5])).tolist() == [1.0, 0.0, 1e-5]
    with_orders = WITH_ORDERS.without_idle_orders(np.array([1.0, 0.5, 0.0, 0.9, 0.7]))
    assert with_orders.tolist() == [1.0, 0.5, 0.0, 0.9, 0.0]


def test_rays_that_are_good_enough_are_not_improved() -> None:
    problem = Problem.of(ft.parse_spec(RESONANT))
    question = problem.missing(frozenset({1}), frozenset({0}))
    best, enough = scan_box(question, 2), scan_box(question, 2, enough=0.0)
    assert best.basins[0].cost <= enough.basins[0].cost <= 0.0
    # where no ray is good enough all of them are improved
    assert scan_box(question, 2, enough=-10.0).basins[0].cost == best.basins[0].cost


def test_ten_times_as_many_rays_find_no_better_basin() -> None:
    problem = Problem.of(ft.parse_spec(RESONANT.replace("crossover_spread_db", "sensitivity_peak_db")))
    best = scan_box(problem, 3).basins[0].cost
    finest = min(basin.cost for basin in scan_box(problem, 3, 0.1).basins)
    # neper: the polish goes on from there
    assert best <= finest + 1e-3
