"""Event detection: whether a guard function, negative so far, reaches 0 within a step; no crossing is missed.

On [t, t + h] let f'' stay within a known R of f''(t) (`flow`, formula (3)).  Then for 0 <= s <= h

    f(t + s) <= f + f' s + (f'' + R) s^2/2,     f' + (f'' - R) s <= f'(t + s) <= f' + (f'' + R) s.                  (1)

There are three cases.  The first bound is negative throughout: no zero.  Or f' keeps its sign: no zero where f falls,
and where it rises exactly one zero if f >= 0 at the end of the step.  Otherwise the step is too long to decide and is
halved.  Only a tangency (f' and f both 0) stays undecided down to the shortest step.  All this holds for the exact
solution, up to the rounding of f.

Source: Taylor's formula with a bound of the second derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class GuardStatus(Enum):
    """Whether a guard is crossed within a step."""

    CLEAR = "no zero within the step"
    CROSSED = "one zero within the step"
    UNDECIDED = "cannot tell: take a shorter step"


@dataclass(frozen=True)
class Guard:
    """A guard function f at the start of a step; an event happens where it reaches 0 from below.

    Args:
        value, slope, curvature: f, f', f''.
        rounding: |f| below it counts as 0.
        on_line: the step starts where f = 0, on its way to f < 0.
        at_rest: f stays within its rounding of 0 for the longest step, as in a steady state on the line.
    """

    value: float
    slope: float
    curvature: float
    rounding: float
    on_line: bool = False
    at_rest: bool = False

    def is_leaving(self, step_s: float) -> bool:
        """Whether f is positive, or 0 and about to be; derivatives count from their rounding over `step_s`."""
        if abs(self.value) > self.rounding:
            return self.value > 0.0
        for derivative, size in ((self.slope, step_s), (self.curvature, step_s**2)):
            if abs(derivative) * size > self.rounding:
                return derivative > 0.0
        return False

    def rests_for(self, longest_s: float, change: float) -> bool:
        """Whether f stays within its rounding for the longest step, R being that step's."""
        reach = abs(self.slope) * longest_s + 0.5 * (abs(self.curvature) + change) * longest_s**2
        return abs(self.value) + reach <= self.rounding

    def check(self, step_s: float, change: float, at_end: float) -> GuardStatus:
        """Whether the guard is crossed within one step.

        Args:
            step_s: h.
            change: R.
            at_end: f(t + h).
        """
        above = self.curvature + change
        if self.at_rest:
            return GuardStatus.CLEAR
        if self.on_line:
            # starts from 0, and by rounding perhaps just before the maximum of a tangency
            highest, end = self._highest(0.0, step_s, above), step_s * (self.slope + 0.5 * above * step_s)
            if highest <= 0.0 > end or (highest <= self.rounding and end < -2.0 * self.rounding):
                return GuardStatus.CLEAR
        elif self._highest(self.value, step_s, above) < -self.rounding:
            return GuardStatus.CLEAR
        if self.slope + max(0.0, step_s * above) <= 0.0:
            return GuardStatus.CLEAR
        if self.slope + min(0.0, step_s * (self.curvature - change)) >= 0.0:
            return GuardStatus.CROSSED if at_end >= 0.0 else GuardStatus.CLEAR
        return GuardStatus.UNDECIDED

    def _highest(self, value: float, step: float, above: float) -> float:
        """The largest value over the step of the parabola (1) that starts from this value."""
        highest = max(value, value + step * (self.slope + 0.5 * above * step))
        if above < 0.0 < self.slope < -above * step:
            highest = max(highest, value - 0.5 * self.slope**2 / above)
        return highest
