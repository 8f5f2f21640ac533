"""Joint yield: counted again from the draws one by one, with SciPy's interval, in blocks, with draws that are none."""

from __future__ import annotations

import dataclasses
import math
import pickle

import numpy as np
import pytest
from scipy import stats

import fopi_tune as ft
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.montecarlo.draws import sample_points
from fopi_tune.montecarlo.montecarlo import Evidence, evidence_of, monte_carlo, sample_block
from fopi_tune.montecarlo.outcomes import sampling_plan_of
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

GAINS = ft.FoPi(0.44651, 0.37033, 0.83197)
#: slow plants miss the upper limit of the crossover, fast ones the lower limit; the scenarios have limits of their own
SPEC = """
schema: 1
name: joint
plant:
  model: lag
  static_gain: {nominal: 1, min: 0.8, max: 1.2}
  time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}
controller: {kp: 0.44651, ki: 0.37033, alpha: 0.83197}
requirements:
  - {crossover_rad_s: {between: [0.25, 0.34]}}
  - {phase_margin_deg: {at_least: 84}}
digital: {sample_time_s: 0.2}
scenarios:
  - {name: up, duration_s: 8, reference: [{at_s: 0, value: 1}]}
  - {name: push, duration_s: 8, reference: [{at_s: 0, value: 0}], load: [{at_s: 0, value: 0.5}]}
limits:
  - {peak_control: {at_most: 1.0}, scenario: up}
  - {overshoot: {at_most: 0.03}, scenario: up}
  - {iae: {at_most: 1.45}, scenario: push}
validation: VALIDATION
"""
DRAWS = 150


def joint_spec(validation: str = f"{{samples: {DRAWS}, seed: 4, confidence: 0.95}}") -> DesignSpec:
    return parse_spec(SPEC.replace("VALIDATION", validation))


def evidence(spec: DesignSpec) -> Evidence:
    return monte_carlo(spec, GAINS, implementation_of(spec, GAINS))


def met_one_by_one(spec: DesignSpec) -> np.ndarray:
    """Columns: both requirements; the limits on each scenario.  Margins by the core's, a simulation a plant."""
    assert spec.validation is not None
    points = sample_points(sampling_plan_of(spec.validation), spec.plant, 0, spec.validation.samples)
    implementation = implementation_of(spec, GAINS)
    loops = SampledLoops.implemented(GAINS, implementation, Plants.members(spec.plant, points))
    crossover, margin = (
        QUANTITIES[name].measure(loops, False, 0.0, math.inf).value for name in ("crossover_rad_s", "phase_margin_deg")
    )
    inside = (crossover >= 0.25) & (crossover <= 0.34) & (margin >= 84.0)
    rows = []
    for point in points:
        driven = ft.simulate(spec, GAINS, plant=spec.plant.describe(point))
        up, push = (each.measures for each in driven.driven)
        rows.append((up["peak_control"] <= 1.0 and up["overshoot"] <= 0.03, push["iae"] <= 1.45))
    return np.column_stack([inside, np.array(rows)])


def test_the_joint_yield_is_that_of_the_draws_one_by_one() -> None:
    spec = joint_spec()
    found, met = evidence(spec), met_one_by_one(spec)
    everything = met.all(axis=1)
    assert 0.1 < everything.mean() < 0.9
    # no single demand tells it
    singles = [each.fraction.met for each in (*found.requirements, *found.limits)]
    assert found.joint.fraction.met == everything.sum() < min(singles)
    assert found.joint.missed_inside == DRAWS - everything.sum()
    assert found.joint.first_missed == tuple(np.flatnonzero(~everything)[:5].tolist())
    assert [(each.scenario, each.fraction.met) for each in found.scenarios] == [
        ("up", met[:, 1].sum()),
        ("push", met[:, 2].sum()),
    ]


@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_the_interval_of_the_joint_yield_is_scipys(confidence: float) -> None:
    found = evidence(joint_spec(f"{{samples: 90, seed: 2, confidence: {confidence}}}")).joint.fraction
    exact = stats.binomtest(found.met, found.total).proportion_ci(confidence, "exact")
    np.testing.assert_allclose((found.low, found.high), (exact.low, exact.high), rtol=1e-12)
    assert 0 < found.met < found.total == 90


def test_blocks_count_the_same_joint_yield() -> None:
    spec = joint_spec("{samples: 1100, seed: 9}")
    implementation = implementation_of(spec, GAINS)
    whole = evidence(spec)
    blocks = [sample_block(spec, GAINS, implementation, *edge) for edge in ((1024, 1100), (0, 512), (512, 1024))]
    parts = evidence_of(spec, pickle.loads(pickle.dumps(blocks)))
    assert (parts.joint, parts.scenarios) == (whole.joint, whole.scenarios)


def test_draws_that_are_no_plants_enter_no_yield() -> None:
    spec = joint_spec("{samples: 200, distributions: {time_constant_s: {normal: {mean: 0.5, std: 1.5}}}}")
    found = evidence(spec)
    assert found.no_plants > 20
    assert found.joint.fraction.total == found.scenarios[0].fraction.total == 200 - found.no_plants
    assert found.joint.missed_inside <= found.joint.fraction.total - found.joint.fraction.met


def test_an_unstable_loop_meets_nothing_at_once() -> None:
    spec = parse_spec(SPEC.replace("VALIDATION", "{samples: 40}").replace("kp: 0.44651", "kp: 40"))
    gains = dataclasses.replace(GAINS, kp=40.0)
    found = monte_carlo(spec, gains, implementation_of(spec, gains))
    assert found.stable.met == found.joint.fraction.met == 0
    assert found.joint.first_missed == (0, 1, 2, 3, 4)
