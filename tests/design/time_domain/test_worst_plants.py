"""The worst plants of the search: no plant of a dense sample is worse, and how much each row is missed by."""

from __future__ import annotations

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, parsed
from oracles.scenario_gains import drawn, grid, measured

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.worst_plants import Family

INSIDE = """
schema: 1
name: inside
plant:
  model: transfer_function
  numerator: [1]
  denominator: [1, 0.6, {nominal: 1, min: 0.6, max: 1.6}]
controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: {min: 0.5, max: 1.4}}
digital: {sample_time_s: 0.2, poles: 5}
scenarios:
  - {name: step, duration_s: 30, reference: [{at_s: 1, value: 2}]}
  - {name: load, duration_s: 20, reference: [{at_s: 0, value: 0}], load: [{at_s: 0, value: 1}]}
requirements:
  - {overshoot: {at_most: 0.5}, scenario: step}
  - {rise_time_s: {at_least: 2}, scenario: step}
  - {settling_time_s: {at_most: 12}, scenario: step}
  - {iae: {at_most: 9}}
objective: {minimize: ise, scenario: load}
"""


def test_no_plant_of_a_dense_sample_is_worse() -> None:
    spec, gains = parsed(INSIDE), FoPi(0.2, 0.25, 0.95)
    family = Family(ScenarioProblem.of(spec))
    worst = family.worst(gains)
    assert set(worst) == {(0, "step"), (1, "step"), (2, "step"), (3, "step"), (3, "load"), (-1, "load")}
    points = np.concatenate([grid(spec, 3001), drawn(spec, 300, seed=1)])

    def values(scenario: str, name: str) -> np.ndarray:
        return measured(spec, gains, scenario, name, points)

    # of overshoots in the size of the step, of others in the limit
    expected = {
        (0, "step"): (values("step", "overshoot") - 0.5).max() / 2.0,
        (1, "step"): (2.0 - values("step", "rise_time_s")).max() / 2.0,
        (3, "step"): (values("step", "iae") - 9.0).max() / 9.0,
        (3, "load"): (values("load", "iae") - 9.0).max() / 9.0,
        (-1, "load"): values("load", "ise").max(),
    }
    for key, value in expected.items():
        assert worst[key].value >= value - 1e-9, key
        assert worst[key].value == pytest.approx(value, abs=1e-4), key
    # the settling limit is missed where a plant settles later
    assert (worst[2, "step"].value > 0.0) is bool((values("step", "settling_time_s") > 12.0 + 1e-9).any())
    assert family.simulated > 600


def test_refinement_finds_what_the_sample_has_not() -> None:
    spec = DESIGNS["throttle_sat"].spec
    family, gains = Family(ScenarioProblem.of(spec)), FoPi(1.1363, 0.22724, 1.0)
    coarse, fine = family.worst(gains, refine=False), family.worst(gains)
    assert all(fine[key].value >= coarse[key].value for key in coarse)


def test_an_unstable_plant_is_missed_without_bound() -> None:
    spec = parsed(INSIDE)
    worst = Family(ScenarioProblem.of(spec)).worst(FoPi(8.0, 9.0, 1.2))
    assert worst[2, "step"].value > 1e6
    assert worst[-1, "load"].value > 1e6
    # where signals overflow, nothing is compared any more
    longer = parsed(INSIDE.replace("duration_s: 30", "duration_s: 1700"))
    assert np.isinf(Family(ScenarioProblem.of(longer)).worst(FoPi(8.0, 9.0, 1.2), refine=False)[2, "step"].value)


def test_one_plant_has_no_box() -> None:
    text = INSIDE.replace("{nominal: 1, min: 0.6, max: 1.6}", "1")
    worst = Family(ScenarioProblem.of(parsed(text))).worst(FoPi(0.2, 0.25, 0.95))
    assert {each.point for each in worst.values()} == {()}
