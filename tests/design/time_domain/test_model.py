"""The linearised problem at gains: rows, aims and sums are those of the simulation of the plants that are known."""

from __future__ import annotations

import numpy as np
import pytest
from cases.scenario_designs import parsed
from oracles.scenario_gains import measured

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.model import Model, Modeller
from fopi_tune.design.time_domain.problem import TIGHTENING, ScenarioProblem

TEXT = """
schema: 1
name: a
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 3, nominal: 2}, dead_time_s: 0.1}
controller: {kp: {min: 0, max: 5}, ki: {min: 0, max: 5}, alpha: {min: 0.5, max: 1.4}}
digital: {sample_time_s: 0.1, poles: 5}
scenarios:
  - {name: step, duration_s: 12, reference: [{at_s: 0, value: 2}]}
  - {name: load, duration_s: 12, reference: [{at_s: 0, value: 0}], load: [{at_s: 0, value: 1}]}
requirements:
  - sensitivity_db: {at_most: 1}
  - {overshoot: {at_most: 0.3}, scenario: step}
  - {rise_time_s: {at_least: 2}, scenario: step}
  - {iae: {at_most: 1.5}, scenario: load}
  - {iae: {at_least: 0.5}, scenario: load}
"""
GAINS = FoPi(1.4, 0.7, 0.9)


def modeller(objective: str) -> Modeller:
    problem = ScenarioProblem.of(parsed(f"{TEXT}objective: {objective}\n"))
    return Modeller(problem, LoopCuts(problem.loop), problem.corners)


def model(objective: str = "{minimize: iae, scenario: load}", gains: FoPi = GAINS) -> Model:
    found = modeller(objective).at(gains)
    assert found is not None
    return found


def values(scenario: str, name: str) -> np.ndarray:
    made = modeller("{minimize: iae, scenario: load}")
    return measured(made.problem.spec, GAINS, scenario, name, made.points)


def test_rows_of_limits() -> None:
    found = model()
    over = (values("step", "overshoot") - 0.3) / 2.0
    assert found.values[found.owner == 0].max() == pytest.approx(over.max() + TIGHTENING, abs=1e-10)
    early = (2.0 - values("step", "rise_time_s")) / 2.0
    np.testing.assert_allclose(np.sort(found.values[found.owner == 1]), np.sort(early + TIGHTENING), atol=1e-10)
    # a lower limit of a sum is a row, an upper one the sum itself
    least = (0.5 - values("load", "iae")) / 0.5
    np.testing.assert_allclose(np.sort(found.values[found.owner == 3]), np.sort(least + TIGHTENING), atol=1e-10)
    assert not (found.owner == 2).any()
    most = (values("load", "iae") - 1.5) / 1.5
    sums = [each.value for each in found.sums if each.row == 2]
    np.testing.assert_allclose(sums, most + TIGHTENING, atol=1e-10)


def test_objectives() -> None:
    assert model().objective == pytest.approx(values("load", "iae").max(), rel=1e-10)
    assert model("{minimize: ise, scenario: step}").objective == pytest.approx(values("step", "ise").max(), rel=1e-10)
    made = modeller("{maximize: ki}")
    ki = made.at(GAINS)
    assert ki is not None
    assert ki.objective == pytest.approx(
        -GAINS.ki / made.problem.numbers.units(np.array([GAINS.kp, GAINS.ki, GAINS.alpha]))[1]
    )


def test_the_loops_rows_are_beside_them() -> None:
    found = model()
    assert (found.owner < 0).any()
    # |S| <= 1 dB is missed with these gains, and the known cuts say by how much
    assert found.loop_violation > 0.0
    assert found.values[found.owner < 0].max() == pytest.approx(found.loop_violation, abs=1e-6)
    assert found.violation >= found.loop_violation


def test_slopes_are_differences() -> None:
    made, step = modeller("{minimize: iae, scenario: load}"), 1e-6
    here = made.at(GAINS)
    assert here is not None
    for j, moved in enumerate((FoPi(1.4 + step, 0.7, 0.9), FoPi(1.4, 0.7 + step, 0.9), FoPi(1.4, 0.7, 0.9 + step))):
        there = made.at(moved, learn=False)
        assert there is not None
        assert len(there.values) == len(here.values)
        np.testing.assert_allclose(here.slopes[:, j], (there.values - here.values) / step, atol=2e-4)
        for one, two in zip(here.sums, there.sums, strict=True):
            np.testing.assert_allclose(one.slopes[:, j], (two.errors - one.errors) / step, atol=2e-4)


def test_without_learning_no_cut_is_added() -> None:
    made = modeller("{minimize: iae, scenario: load}")
    assert made.at(GAINS, learn=False) is not None
    assert made.cuts.pool == []
    assert made.at(GAINS) is not None
    assert made.cuts.pool != []
    # two models of two scenarios, with two neighbours for each of three numbers
    assert made.simulated == 2 * 2 * 7 * len(made.points)


@pytest.mark.parametrize("gains", [FoPi(0.0, 0.0, 1.0), FoPi(500.0, 900.0, 1.0)])
def test_where_there_is_no_loop_there_is_no_model(gains: FoPi) -> None:
    assert modeller("{minimize: iae, scenario: load}").at(gains) is None
