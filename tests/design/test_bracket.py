"""The bracket: gains that are known to be beaten by some part are never said to be closer than that."""

from __future__ import annotations

import pytest

import fopi_tune as ft
from fopi_tune.design.bracket import bracket_of, excluded_share
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.search import best_of_box

BOX = "controller: {kp: {min: 0, max: 20}, ki: {min: 0.001, max: 20}, alpha: {min: 0.6, max: 1.4}}\n"
LAG = "plant: {model: lag, static_gain: {min: 1.5, max: 2.6}, time_constant_s: {min: 3, max: 6}, dead_time_s: 0.9}\n"
ASKED = "requirements:\n  - {sensitivity_db: {at_most: 4.1}}\n  - {gain_margin_db: {at_least: 7}}\n"
OBJECTIVES = ["objective: {maximize: ki}\n", "objective: {minimize: iae_disturbance}\n", ""]


def polish_of(objective: str, asked: str = ASKED) -> Polish:
    return Polish(Problem.of(ft.parse_spec(f"schema: 1\nname: x\n{LAG}{BOX}{asked}{objective}")))


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_a_cost_that_is_beaten_is_never_bracketed_closer_than_that(objective: str) -> None:
    polish = polish_of(objective)
    best = best_of_box(polish)
    assert best is not None
    for worse in (0.002, 0.02, 0.15):
        step = worse * max(abs(best.cost), 0.1) if "iae" not in objective else worse
        bracket = bracket_of(polish, best.cost + 1.5 * step, best.x)
        assert bracket is not None
        assert bracket.gap > worse


def test_the_whole_box_of_a_spec_that_clashes_is_excluded() -> None:
    # Bode's integral: |S| below -20 dB up to a fifth of the corner cannot go with a peak of 0.2 dB
    clash = "requirements:\n  - {sensitivity_db: {at_most: 0.2}}\n  - {sensitivity_db: {at_most: -20}, to_rad_s: 0.2}\n"
    assert excluded_share(polish_of("", clash).problem) == pytest.approx(1.0)


def test_a_box_with_good_gains_is_not_excluded() -> None:
    assert excluded_share(polish_of("").problem) < 1.0
