"""Feed-forward of the setpoint:  r, and its change in a sample -> a part of the control that needs no error.

    u_ff = g r + h dr/dt ,        on samples  g r_k + (h/Ts)(r_k - r_{k-1}) .                                        (1)

It is added to the controller's output before the limits, so that anti-windup sees what the limits take of both.  For a
lag K/(tau s + 1) the inverse is g = 1/K and h = tau/K: the output then follows the setpoint without the controller.

Source: Astrom and Hagglund, Advanced PID Control, 2006, chapter 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fopi_tune.errors import DomainError

#: per sample and mode: g, and h/Ts
Fed = tuple[float, float]
NOT_FED: Fed = (0.0, 0.0)


@dataclass(frozen=True)
class FeedForward:
    """The two gains of (1).

    Args:
        static_gain: g, control unit per output unit.
        rate_gain: h, control unit per output unit and second.
    """

    static_gain: float = 0.0
    rate_gain: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.static_gain) and math.isfinite(self.rate_gain)):
            raise DomainError(f"{self}: both gains must be finite")

    @classmethod
    def inverse_of_lag(cls, static_gain: float, time_constant_s: float) -> FeedForward:
        """That of K/(tau s + 1)."""
        return cls(1.0 / static_gain, time_constant_s / static_gain)

    def sampled(self, sample_time_s: float) -> Fed:
        """g and h/Ts."""
        return self.static_gain, self.rate_gain / sample_time_s


def fed_by(every: tuple[FeedForward | None, ...], sample_time_s: float) -> tuple[Fed, ...]:
    """g and h/Ts of each mode; empty where none is fed forward."""
    if not any(every):
        return ()
    return tuple(NOT_FED if each is None else each.sampled(sample_time_s) for each in every)
