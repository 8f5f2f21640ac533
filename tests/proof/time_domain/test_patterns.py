"""Patterns of limited samples hold what the limits do to every v of their range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.time_domain_cases import saturated_throttle

from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, State, init, step
from fopi_tune.proof.time_domain.bounded import Signals
from fopi_tune.proof.time_domain.patterns import Filter, Pattern, filter_under, free_pattern, pattern_of
from fopi_tune.spec.model import ScenarioSpec

CASE = replace(saturated_throttle(), scenario=ScenarioSpec("s", 9.8, saturated_throttle().scenario.reference))
K = CASE.samples
LOW, HIGH = CASE.output_limits


def pattern_between(low: float, high: float) -> Pattern:
    return pattern_of(CASE, np.full(K, low), np.full(K, high))


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.2, 0.8), (1.1, 2.0), (-3.0, -0.1), (0.5, 1.5), (-0.5, 0.2), (0.999, 5.0), (-1.0, 3.0), (1.0, 1.0)],
)
def test_what_a_limit_does_is_held(low: float, high: float) -> None:
    pattern = pattern_between(low, high)
    for v in np.linspace(low, high, 101):
        limited = min(max(v, LOW), HIGH)
        middle = (1.0 - pattern.share[0]) * v + pattern.limited[0]
        assert abs(limited - middle) <= pattern.reach[0] + 1e-15
    assert len(pattern.symbols) == (K if low < HIGH < high or low < LOW < high else 0)
    assert pattern.low[0] <= low <= high <= pattern.high[0]


def test_free_samples_are_those_within_the_limits() -> None:
    assert free_pattern(CASE).is_free
    assert pattern_between(0.1, 0.9).is_free
    assert not pattern_between(0.1, 1.1).is_free


def test_the_filter_under_a_pattern_is_the_runtime() -> None:
    """With limits at every other sample; errors that do not depend on the output."""
    rng = np.random.default_rng(5)
    errors = rng.standard_normal(K)
    demanded, state = [], init(CASE.controller)
    for error in errors:
        # v before the limits: the same controller with limits that are not reached
        wide = Runtime(
            Precision.FLOAT64, CASE.controller.direct, CASE.controller.poles, CASE.controller.residues,
            CASE.controller.weights, CASE.controller.tracking_gain, (-1e200, 1e200),
        )  # fmt: skip
        demanded.append(float(step(wide, State(state.x, state.output), error, 0.0).output))
        state = step(CASE.controller, state, error, 0.0)
    v = np.array(demanded)
    pattern = pattern_of(CASE, v - 1e-9, v + 1e-9)
    own = filter_under(CASE, pattern)
    assert isinstance(own, Filter)
    assert own.own is not None
    inner = own.own.apply(CASE.correction.apply(Signals.exactly(pattern.limited[:, None])))
    found = own.path.apply(Signals.exactly(errors[:, None])) + inner
    assert found.errors[0] < 1e-8
    assert np.abs(found.values[:, 0] - v).max() < 1e-8
