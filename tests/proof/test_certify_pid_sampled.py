"""A PID on samples by Tustin's rule: limits around the worst case against state space and eigenvalues.

Its sections are written down by hand; the pole of the derivative's filter is (2 Tf - Ts)/(2 Tf + Ts), negative for a
filter that is faster than half a sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from cases.random_pids import on_samples, pid_for, plants_of, sized, uncertain
from cases.sampled_limits_told_apart import outcomes
from flint import acb, arb, ctx

from fopi_tune.core.controller import Pid
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.sampled_controllers import sections_of, value_and_derivative

#: of the random numbers
SALT = 22


def test_the_sections_written_down_by_hand_are_the_bilinear_map_of_the_pid() -> None:
    rng = np.random.default_rng(31)
    with ctx.workprec(64):
        for _ in range(30):
            ts = sized(rng, 0.01, 0.5)
            kp, ki, kd = rng.normal(size=3).tolist()
            pid = Pid(kp, ki, kd, sized(rng, 0.1 * ts, 10.0 * ts))
            sections = on_samples(pid, ts)
            nu = sized(rng, 1e-3, 1e3)
            # s = (2/Ts) w with w = j nu
            expected = complex(pid(2j * nu / ts))
            value, _ = value_and_derivative(sections_of(Implementation(sections)), acb(0, arb(nu)))
            # direct and residues are rounded to doubles, and cancel where the filter is fast
            size = abs(pid.kp) + abs(pid.ki) * ts / nu + abs(pid.kd) / pid.derivative_filter_time_constant_s
            assert abs(complex(value.mid()) - expected) < 1e-12 * size
            assert abs(sections.response(np.array([2.0 / ts * math.atan(nu)]))[0] - expected) < 1e-12 * size


def _loop(rng: np.random.Generator) -> tuple[PlantFamily, Pid, Implementation]:
    plants = uncertain(rng, plants_of(rng), least=1)
    pid = pid_for(rng, plants)
    # filters of a fifth of a sample up to many samples
    sample_time_s = pid.derivative_filter_time_constant_s * sized(rng, 0.1, 5.0)
    delay = float(rng.choice([0.0, 0.0, 1.0, rng.uniform(0.0, 2.0)]))
    return plants, pid, Implementation(on_samples(pid, sample_time_s), delay)


@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 8), marks=pytest.mark.long)])
def test_limits_around_the_worst_case_of_a_pid_on_samples_are_told_apart(seeds: range) -> None:
    counted, undecided = outcomes(seeds, _loop, SALT)
    assert undecided == []
    assert counted["told apart"] >= 5 * len(seeds) // 8, counted


@pytest.mark.long
def test_limits_around_the_worst_cases_of_forty_pids_on_samples_are_told_apart(
    record_property: Callable[[str, object], None],
) -> None:
    counted, undecided = outcomes(range(100, 140), _loop, SALT)
    record_property("outcomes", dict(counted))
    print(dict(counted), "undecided:", undecided)
    assert len(undecided) <= 1, undecided
    assert counted["told apart"] >= 30, counted
