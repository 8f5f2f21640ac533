"""A spec in the search's numbers: rows, plants, ranges, and the question of how little is missed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, parsed

from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import Relation

TEXT = """
schema: 1
name: a
plant: {model: lag, static_gain: {min: 0.8, max: 1.2, nominal: 1}, time_constant_s: {min: 1, max: 3, nominal: 2}}
controller: {kp: {min: -1, max: 5}, ki: {min: 0, max: 1e12}, alpha: {min: 0.5, max: 1.4}}
digital: {sample_time_s: 0.1, poles: 5, measurement_unit: m/s}
scenarios:
  - {name: step, duration_s: 10, reference: [{at_s: 0, value: 2}]}
  - {name: load, duration_s: 10, reference: [{at_s: 0, value: 0}], load: [{at_s: 0, value: 1}]}
  - {name: unused, duration_s: 900, reference: [{at_s: 0, value: 1}]}
requirements:
  - sensitivity_db: {at_most: 3}
  - {overshoot: {at_most: 0.3}, scenario: step}
  - {iae: {at_least: 0.5}, scenario: load}
"""


def problem(more: str = "") -> ScenarioProblem:
    return ScenarioProblem.of(parsed(TEXT + more))


def test_a_row_for_each_limit_and_scenario() -> None:
    one, two = problem("objective: {minimize: ise, scenario: load}\n").rows
    assert (one.key, one.side, one.unit) == ((0, "step"), 1.0, 2.0)
    assert (two.key, two.side, two.unit) == ((1, "load"), -1.0, 0.5)
    every = problem("  - acceleration_m_s2: {at_most: 9}\n").rows
    assert [row.key for row in every[2:]] == [(2, "step"), (2, "load"), (2, "unused")]
    assert {row.run.per_m_s for row in every} == {1.0}


def test_only_scenarios_that_are_designed_for_are_simulated() -> None:
    found = problem("objective: {minimize: ise, scenario: load}\n")
    assert [run.spec.name for run in found.runs] == ["step", "load"]
    assert found.objective is not None
    assert (found.objective.index, found.objective.limit.measure) == (-1, "ise")
    assert found.objective.limit.relation is Relation.AT_MOST


def test_without_an_objective_the_smallest_slack_is_one() -> None:
    found = problem()
    assert found.maximises_depth
    assert all(row.in_depth for row in found.rows)
    for objective in ("{minimize: ise, scenario: load}", "{maximize: ki}"):
        other = problem(f"objective: {objective}\n")
        assert not other.maximises_depth
        assert not any(row.in_depth for row in other.rows)


def test_how_little_is_missed_is_asked_of_some() -> None:
    whole = problem("objective: {minimize: ise, scenario: load}\n")
    asked = whole.missing(frozenset({1}), frozenset({2}))
    (row,) = asked.rows
    assert (row.key, row.in_depth) == ((0, "step"), True)
    assert asked.objective is None
    # the loop's own has to hold
    assert asked.loop.free == frozenset()
    loop = whole.missing(frozenset({0}), frozenset())
    assert [row.in_depth for row in loop.rows] == [False, False]
    assert loop.loop.free == {0}


def test_plants_of_the_box() -> None:
    found = problem()
    corners = {tuple(point) for point in found.corners}
    assert corners == {(1.0, 2.0), (0.8, 1.0), (0.8, 3.0), (1.2, 1.0), (1.2, 3.0)}
    low, high = found.spec.plant.low, found.spec.plant.high
    assert np.all((found.family >= low) & (found.family <= high))
    assert len(found.family) > 2000
    seen = ScenarioProblem.of(found.spec, [Violation(0, (1.1, 1.7), math.nan, "step")])
    assert {tuple(point) for point in seen.corners} == corners | {(1.1, 1.7)}
    # one that the loop's frequency response was refuted at is none of these
    loop = ScenarioProblem.of(found.spec, [Violation(0, (1.1, 1.7), 0.5)])
    assert {tuple(point) for point in loop.corners} == corners


def test_ranges_of_gains_are_those_of_the_spec_and_finite() -> None:
    found = problem()
    low, high = found.numbers.box
    assert (low[0], low[1]) == (-1.0, 0.0)
    assert tuple(low[[2]]) + tuple(high[[0, 2]]) == (0.5, 5.0, 1.4)
    assert high[1] < 1e12
    gains = found.numbers.inside(np.array([99.0, -3.0, 0.1]))
    assert (gains.kp, gains.ki, gains.alpha) == (5.0, 0.0, 0.5)


def test_units_make_the_loop_gain_1() -> None:
    """Of a lag 1/(1 + 2 s) and at its corner 0.5 rad/s: |P| = 1/sqrt 2."""
    found = problem()
    for alpha in (0.6, 1.0, 1.3):
        kp, ki, one = found.numbers.units(np.array([1.0, 1.0, alpha]))
        assert one == 1.0
        # both terms are equally large at the characteristic frequency
        omega = (ki / kp) ** (1.0 / alpha)
        assert kp / abs(1.0 + 2j * omega) == pytest.approx(1.0, rel=0.8)
        assert omega == pytest.approx(0.5, rel=0.8)


@pytest.mark.parametrize("name", DESIGNS)
def test_noise_is_left_out_of_designs(name: str) -> None:
    text = DESIGNS[name].text.replace("duration_s:", "noise_std: 0.3, duration_s:")
    for run in ScenarioProblem.of(parsed(text)).runs:
        assert run.run.sensor.noise_std == 0.0
