"""Whether a function that must stay negative can reach 0 within a step: no crossing is missed between two steps.

On [t, t + h] let f'' stay within a known R of f''(t) (`flow`, formula (3)).  Then for 0 <= s <= h

    f(t + s) <= f + f' s + (f'' + R) s^2/2,     f' + (f'' - R) s <= f'(t + s) <= f' + (f'' + R) s.                  (1)

Either the first bound is negative throughout: no zero; or f' keeps its sign: no zero when it falls, and when it rises
exactly one if f at the step's end says so; or the step is too long to tell and is halved.  Only a touching (f' and f
both 0) stays open down to the shortest step.  All of this holds for the exact solution, up to the rounding of f.

Source: Taylor's formula with a bound of the second derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class GuardStatus(Enum):
    """What a step does to a guard."""

    CLEAR = "no zero within the step"
    CROSSED = "one zero within the step"
    OPEN = "cannot tell: take a shorter step"


@dataclass(frozen=True)
class Guard:
    """f at the step's beginning, negative as long as nothing happens.

    Args:
        value, slope, bend: f, f', f''.
        rounding: below it f cannot be told from 0.
        on_line: the step starts where f = 0, on its way to f < 0.
        at_rest: f stays within its rounding of 0 for the longest step, as in a steady state on the line.
    """

    value: float
    slope: float
    bend: float
    rounding: float
    on_line: bool = False
    at_rest: bool = False

    def leaves(self, step_s: float) -> bool:
        """Whether f is positive, or 0 and about to be; derivatives count from their rounding over `step_s`."""
        if abs(self.value) > self.rounding:
            return self.value > 0.0
        for derivative, size in ((self.slope, step_s), (self.bend, step_s**2)):
            if abs(derivative) * size > self.rounding:
                return derivative > 0.0
        return False

    def resting(self, longest_s: float, change: float) -> bool:
        """Whether f stays within its rounding for the longest step, R being that step's."""
        reach = abs(self.slope) * longest_s + 0.5 * (abs(self.bend) + change) * longest_s**2
        return abs(self.value) + reach <= self.rounding

    def judge(self, step_s: float, change: float, at_end: float) -> GuardStatus:
        """The verdict over one step.

        Args:
            step_s: h.
            change: R.
            at_end: f(t + h).
        """
        above = self.bend + change
        if self.at_rest:
            return GuardStatus.CLEAR
        if self.on_line:
            # from 0, and by rounding perhaps just short of the top of what touches the line
            leaving, end = self._highest(0.0, step_s, above), step_s * (self.slope + 0.5 * above * step_s)
            if leaving <= 0.0 > end or (leaving <= self.rounding and end < -2.0 * self.rounding):
                return GuardStatus.CLEAR
        elif self._highest(self.value, step_s, above) < -self.rounding:
            return GuardStatus.CLEAR
        if self.slope + max(0.0, step_s * above) <= 0.0:
            return GuardStatus.CLEAR
        if self.slope + min(0.0, step_s * (self.bend - change)) >= 0.0:
            return GuardStatus.CROSSED if at_end >= 0.0 else GuardStatus.CLEAR
        return GuardStatus.OPEN

    def _highest(self, value: float, step: float, above: float) -> float:
        """The greatest value of the parabola (1) that starts from this value."""
        highest = max(value, value + step * (self.slope + 0.5 * above * step))
        if above < 0.0 < self.slope < -above * step:
            highest = max(highest, value - 0.5 * self.slope**2 / above)
        return highest
