"""Gains for scenarios of a controller that limits its output's rate, against all gains of a grid."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from oracles.scenario_gains import measured

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.proof.certificate import Verdict
from fopi_tune.results.status import Status
from fopi_tune.spec import parse_spec

TEXT = """
schema: 1
name: slow
plant: {{model: lag, static_gain: 1, time_constant_s: {tau}}}
controller: {{kp: {{min: 0.2, max: 5}}, ki: {{min: 0.2, max: 5}}, alpha: 1}}
digital: {{sample_time_s: 0.1, output_rate_per_s: 0.25, output_limits: [0, 1.5]}}
scenarios: [{{name: step, duration_s: 20, reference: [{{at_s: 0, value: 1}}], rate_per_s: 0.25}}]
requirements: [{{overshoot: {{at_most: 0.01}}}}]
objective: {{minimize: iae, scenario: step}}
"""


@pytest.mark.parametrize("tau", ["2", pytest.param("{min: 1.5, max: 2.5}", marks=pytest.mark.long)])
def test_no_gains_of_a_grid_are_better(tau: str) -> None:
    spec = parse_spec(TEXT.format(tau=tau))
    design = ft.tune(spec)
    assert design.status is Status.SOLVED, design.message
    assert design.gains is not None
    points = spec.plant.corners()

    def worst(gains: FoPi, name: str) -> float:
        return float(measured(spec, gains, "step", name, points).max())

    assert worst(design.gains, "overshoot") <= 0.01 * (1.0 + 1e-6)
    found, best = worst(design.gains, "iae"), math.inf
    for kp, ki in itertools.product(np.geomspace(0.2, 5.0, 25).tolist(), repeat=2):
        gains = FoPi(kp, ki, 1.0)
        if worst(gains, "overshoot") <= 0.01:
            best = min(best, worst(gains, "iae"))
    assert found <= best * (1.0 + 1e-3)
    # the rate limit is reached, and nothing is claimed to be proved
    (report,) = design.measures
    assert report.verdict is not Verdict.PROVED
