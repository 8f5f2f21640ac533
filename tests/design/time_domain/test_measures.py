"""Measures as functions of the gains: values against the compiled simulation, slopes against its differences."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.measures import Points, ScenarioRun, points_of, unit_of
from fopi_tune.design.time_domain.model import Modeller
from fopi_tune.design.time_domain.problem import ScenarioProblem, ScenarioRow
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.measures import measure_values
from fopi_tune.simulation.sampled.simulate import measure
from fopi_tune.simulation.scenario import Measures, Mode
from fopi_tune.spec import parse_spec
from fopi_tune.spec.measures import DESIGNED_MEASURES
from fopi_tune.spec.model import DesignSpec, Limit, Relation

TEXT = """
schema: 1
name: a
plant:
  model: lag
  static_gain: 2.0
  time_constant_s: {{min: 1.6, max: 3.1, nominal: 2.3}}
  dead_time_s: {{min: 0, max: 0.3}}
controller: {{kp: {{min: -9, max: 9}}, ki: {{min: -9, max: 9}}, alpha: {{min: 0.3, max: 1.7}}}}
requirements: [{{iae: {{at_most: 9}}}}]
digital: {{sample_time_s: 0.2, poles: 5, measurement_unit: mph{digital}}}
scenarios: [{{name: one, duration_s: 24, {scenario}}}]
"""
STEP = "reference: [{at_s: 0, value: 3}]"
#: scenario and further words of the section digital
RUNS = {
    "step": (STEP, ""),
    "downwards": ("initial_output: 5, reference: [{at_s: 0.3, value: -1}]", ""),
    "ramp": ("initial_output: 30, reference: [{at_s: 0, value: 0, ramp_s: 7.3}]", ""),
    "load alone": ("reference: [{at_s: 0, value: 0}], load: [{at_s: 1, value: 1}]", ""),
    "several": (
        "reference: [{at_s: 0, value: 3}, {at_s: 9, value: 1, ramp_s: 2}, {at_s: 16, value: 2}], "
        "load: [{at_s: 5, value: 0.4}, {at_s: 19, value: -0.2}]",
        "",
    ),
    "a load while it rises": ("reference: [{at_s: 0, value: 3}], load: [{at_s: 0.4, value: 0.2}]", ""),
    "judged later": (f"{STEP}, load: [{{at_s: 12, value: 1}}], judged_from_s: 6.1", ""),
    "judged within a ramp": ("reference: [{at_s: 0, value: 3, ramp_s: 9}], judged_from_s: 4", ""),
    "free, with a wide band": (f"initial_output: 2, before: free, settling_band: 0.3, {STEP}", ""),
    "limited": (f"{STEP}, load: [{{at_s: 12, value: 0.3}}]", ", output_limits: [-0.2, 1.8]"),
    "slow actuator": (f"{STEP}, rate_per_s: 1.3", ", output_limits: [-3, 3], delay_samples: 1.5"),
}
GAINS = {"FOPI": FoPi(1.1, 0.7, 0.85), "PI": FoPi(0.8, 0.6, 1.0), "order above 1": FoPi(0.9, 0.5, 1.2)}
POINTS = np.array([[1.6, 0.0], [1.7, 0.27], [2.3, 0.1], [2.9, 0.2], [3.1, 0.3]])
#: of a difference; the smaller, the fewer samples change a branch within it, the larger, the smaller its rounding
MOVE = 1e-6
#: relative; by how much the two halves of a difference may differ, a curvature of 100 times the movement
SMOOTH = 5e-5
POINTWISE = tuple(name for name in DESIGNED_MEASURES if name != "settling_time_s")


@lru_cache
def spec_of(name: str) -> DesignSpec:
    scenario, digital = RUNS[name]
    return parse_spec(TEXT.format(scenario=scenario, digital=digital))


@lru_cache
def run_of(name: str) -> ScenarioRun:
    return ScenarioProblem.of(spec_of(name)).runs[0]


@lru_cache(maxsize=512)
def points(name: str, gains: FoPi, word: str, limit: float = 1.0, relation: Relation = Relation.AT_MOST) -> Points:
    spec, run = spec_of(name), run_of(name)
    row = ScenarioRow(0, Limit(word, relation, limit), run)
    problem = ScenarioProblem.of(spec)
    found = Modeller(problem, LoopCuts(problem.loop), POINTS).trajectories_of(gains)
    assert found is not None
    return points_of(word, run, found[run.spec.name], row.unsettled_samples)


@lru_cache(maxsize=512)
def simulated(name: str, gains: FoPi) -> Measures:
    spec, run = spec_of(name), run_of(name)
    assert spec.digital is not None
    runtime = Runtime.of(implementation_of(spec, gains).sections, Precision.FLOAT64, spec.digital.output_limits)
    return measure([Mode(runtime, Plants.members(spec.plant, POINTS))], run.run, run.horizon)


def values(name: str, gains: FoPi, word: str) -> np.ndarray:
    return np.asarray(measure_values(simulated(name, gains), word, "mph"))


def moved(gains: FoPi, j: int, by: float) -> FoPi:
    numbers = [gains.kp, gains.ki, gains.alpha]
    numbers[j] += by
    return FoPi(*numbers)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("which", GAINS)
@pytest.mark.parametrize("name", RUNS)
def test_the_largest_point_is_the_simulations_measure(name: str, which: str) -> None:
    for word in POINTWISE:
        expected, found = values(name, GAINS[which], word), points(name, GAINS[which], word).values.max(axis=1)
        ends = np.isfinite(expected)
        np.testing.assert_allclose(found[ends], expected[ends], rtol=1e-11, atol=1e-11, err_msg=word)
        # only a rise may not end; what is beyond the scenario's end is worse than any that does
        assert word == "rise_time_s" or ends.all()
        assert np.all(found[~ends] > 0.0)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("which", GAINS)
@pytest.mark.parametrize("name", RUNS)
def test_a_settling_time_is_kept_where_no_point_is_above_1(name: str, which: str) -> None:
    settled = values(name, GAINS[which], "settling_time_s")
    limits = {0.2, 1.0, 3.3, 7.0, 12.0, 23.0}
    # a sample before and after each plant's own
    limits |= {float(t + move) for t in settled[np.isfinite(settled)] for move in (-0.2, 0.0, 0.2) if t + move > 0.0}
    for limit in sorted(limits):
        inside = points(name, GAINS[which], "settling_time_s", limit).values.max(axis=1) <= 1.0
        np.testing.assert_array_equal(inside, settled <= limit + 1e-9, err_msg=f"{limit} s; {settled}")
        outside = points(name, GAINS[which], "settling_time_s", limit, Relation.AT_LEAST).values.max(axis=1) > 1.0
        np.testing.assert_array_equal(outside, settled >= limit - 1e-9, err_msg=f"at least {limit} s; {settled}")


@pytest.mark.thinned(4)
@pytest.mark.parametrize("which", GAINS)
@pytest.mark.parametrize("name", RUNS)
def test_slopes_are_the_differences_of_the_simulations_measures(name: str, which: str) -> None:
    gains, compared = GAINS[which], 0
    for word in POINTWISE:
        here = points(name, gains, word)
        slopes = here.largest.slopes[:, 0]
        for j in range(3):
            both = [values(name, moved(gains, j, by), word) for by in (MOVE, -MOVE)]
            difference = (both[0] - both[1]) / (2.0 * MOVE)
            # across a kink the halves differ: no derivative
            half = (both[0] - values(name, gains, word)) / MOVE
            smooth = np.isfinite(difference) & (np.abs(half - difference) <= SMOOTH * (1.0 + np.abs(difference)))
            size = 1.0 + np.abs(difference[smooth])
            assert np.all(np.abs(slopes[smooth, j] - difference[smooth]) <= SMOOTH * size), (word, j)
            compared += int(smooth.sum())
    assert compared >= 0.8 * len(POINTWISE) * 3 * len(POINTS)


@pytest.mark.parametrize("name", ["step", "ramp", "several", "limited"])
def test_slopes_of_settling_points_are_their_differences(name: str) -> None:
    gains, limit = GAINS["FOPI"], 2.0
    here = points(name, gains, "settling_time_s", limit)
    for j in range(3):
        both = [points(name, moved(gains, j, by), "settling_time_s", limit).values for by in (MOVE, -MOVE)]
        difference = (both[0] - both[1]) / (2.0 * MOVE)
        size = np.abs(difference).max()
        # a few samples come to a limit of the control, or leave it, within the difference
        right = np.abs(here.slopes[..., j] - difference) <= 1e-4 * size
        assert right.mean() > 0.98


def test_a_rise_that_does_not_end_points_to_where_it_does() -> None:
    """The farther from nine tenths the output ends, the longer it counts, and its slope says so."""
    name, weak = "step", FoPi(0.02, 0.002, 1.0)
    assert np.all(np.isinf(values(name, weak, "rise_time_s")))
    here = points(name, weak, "rise_time_s")
    stronger = points(name, FoPi(0.021, 0.0021, 1.0), "rise_time_s")
    assert np.all(here.values.max(axis=1) > run_of(name).spec.duration_s)
    assert np.all(stronger.values.max(axis=1) < here.values.max(axis=1))
    change = np.einsum("mj,j->m", here.largest.slopes[:, 0], np.array([0.001, 0.0001, 0.0]))
    actual = stronger.largest.values[:, 0] - here.largest.values[:, 0]
    np.testing.assert_allclose(change, actual, rtol=0.1)


def test_the_unit_of_slacks_is_the_step_of_overshoots_and_else_the_limit() -> None:
    several = run_of("several")
    assert unit_of("overshoot", several, 0.1) == unit_of("undershoot", several, 0.1) == 3.0
    assert unit_of("iae", several, 4.0) == 4.0
    assert unit_of("final_error", several, 0.0) == 1.0
    assert unit_of("settling_time_s", several, 7.0) == 1.0
    # without a step of the reference there is no size but the limit
    assert unit_of("overshoot", run_of("load alone"), 0.25) == 0.25
