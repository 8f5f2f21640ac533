"""Feed-forward of the setpoint: its gains on samples, and the inverse of a lag."""

from __future__ import annotations

import pytest

from fopi_tune.core.terms.feedforward import FeedForward, fed_by
from fopi_tune.errors import DomainError


def test_the_inverse_of_a_lag_holds_and_moves_it() -> None:
    inverse = FeedForward.inverse_of_lag(20.0, 4.0)
    # y' = (K u - y)/tau with y = r and r' = 3
    r, rate = 8.0, 3.0
    u = inverse.static_gain * r + inverse.rate_gain * rate
    assert (20.0 * u - r) / 4.0 == pytest.approx(rate, abs=1e-12)


def test_the_rate_is_a_difference_of_samples() -> None:
    assert FeedForward(0.5, 3.0).sampled(0.2) == (0.5, 15.0)
    assert fed_by((None, FeedForward(0.5, 3.0)), 0.2) == ((0.0, 0.0), (0.5, 15.0))
    assert fed_by((None, None), 0.2) == ()


@pytest.mark.parametrize("gains", [(float("nan"), 0.0), (0.0, float("inf"))])
def test_gains_that_are_no_numbers_are_refused(gains: tuple[float, float]) -> None:
    with pytest.raises(DomainError, match="finite"):
        FeedForward(*gains)
