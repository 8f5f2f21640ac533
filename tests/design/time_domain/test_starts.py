"""Starts of the search: within their ranges, apart, stable, the same every time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, parsed

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.starts import scatter, starts_of

TEXT = """
schema: 1
name: a
plant: {{model: lag, static_gain: {gain}, time_constant_s: 2}}
controller: {{kp: {kp}, ki: {ki}, alpha: {alpha}}}
digital: {{sample_time_s: 0.1, poles: 5}}
scenarios: [{{name: step, duration_s: 10, reference: [{{at_s: 0, value: 1}}]}}]
objective: {{minimize: iae}}
requirements: [sensitivity_db: {{at_most: 3}}]
"""


def problem(kp: str, ki: str, alpha: str = "{min: 0.5, max: 1.4}", gain: str = "1") -> ScenarioProblem:
    return ScenarioProblem.of(parsed(TEXT.format(kp=kp, ki=ki, alpha=alpha, gain=gain)))


@pytest.mark.parametrize(
    ("kp", "ki"),
    [
        ("{min: 0, max: 5}", "{min: 0, max: 5}"),
        ("{min: -5, max: 5}", "{min: -1, max: 9}"),
        ("{min: -5, max: -0.1}", "{min: -5, max: 0}"),
        ("{min: 2, max: 3}", "{min: 0.001, max: 0.002}"),
        ("0.7", "{min: 0, max: 1.0e+9}"),
        ("{min: 0, max: 5}", "0"),
        ("{min: 200, max: 900}", "{min: 0, max: 5}"),
    ],
)
def test_scattered_gains_fill_their_ranges(kp: str, ki: str) -> None:
    found = problem(kp, ki)
    gains = scatter(found, 200)
    low, high = found.numbers.box
    numbers = np.array([[each.kp, each.ki, each.alpha] for each in gains])
    assert len(gains) > 150
    assert np.all((numbers >= low) & (numbers <= high))
    for k in range(2):
        if low[k] == high[k]:
            assert np.all(numbers[:, k] == low[k])
        elif low[k] < 0.0 < high[k]:
            # of both signs
            assert min((numbers[:, k] < 0.0).mean(), (numbers[:, k] > 0.0).mean()) > 0.05
        else:
            sizes = np.abs(numbers[:, k])
            assert sizes.max() / sizes.min() > min(
                1.2, (max(abs(low[k]), abs(high[k])) / max(sizes.min(), 1e-9)) ** 0.5
            )
    assert np.ptp(numbers[:, 2]) > 0.8
    assert repr(scatter(found, 200)) == repr(gains)


@pytest.mark.parametrize("name", ["brake_delay", "throttle_sat"])
def test_starts_are_apart_and_have_stable_loops(name: str) -> None:
    found = ScenarioProblem.of(DESIGNS[name].spec)
    cuts = LoopCuts(found.loop)
    starts = starts_of(found, cuts, 6, 100)
    assert 2 <= len(starts) <= 6
    for k, one in enumerate(starts):
        assert cuts.look(one) is not None
        for other in starts[:k]:
            far = max(abs(math.log(one.kp / other.kp)), abs(math.log(one.ki / other.ki)))
            assert far > 0.7 or abs(one.alpha - other.alpha) > 0.15
    assert repr(starts_of(found, LoopCuts(found.loop), 6, 100)) == repr(starts)


def test_a_plant_with_a_negative_gain_has_starts() -> None:
    found = problem("{min: -9, max: 9}", "{min: -9, max: 9}", gain="-1")
    starts = starts_of(found, LoopCuts(found.loop), 4, 100)
    assert starts
    assert all(each.ki <= 0.0 for each in starts)


def test_where_no_loop_is_stable_there_is_no_start() -> None:
    found = problem("{min: 3, max: 9}", "{min: 3, max: 9}", gain="-1")
    assert starts_of(found, LoopCuts(found.loop), 4, 50) == []


def test_kp_and_ki_both_0_is_no_controller() -> None:
    assert scatter(problem("0", "0"), 16) == []
    assert FoPi(0.0, 0.0, 1.0) not in scatter(problem("0", "{min: 0, max: 3}"), 64)
