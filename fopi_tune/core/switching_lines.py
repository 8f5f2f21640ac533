"""Where two modes with one output take turns:  setpoint -> the outputs at which each is left.

With a the line of `up` and b that of `down`, for the measurement y_m:

    mode 1 -> 2 when y_m >= a,      mode 2 -> 1 when y_m <= b .                                                      (1)

A relative threshold x is the line r + x, an absolute one x itself.  A hysteresis of half-width eps is a = r + eps and
b = r - eps.  Where the modes coast, in state 0, neither controller acts and the control is 0:

    mode 1 -> 0 when y_m >= `coast_above`,  mode 2 -> 0 when y_m <= `coast_below`,  0 -> 2 and 0 -> 1 as in (1),     (2)

(1) first.  Lines in the order b < `coast_above` <= a and b <= `coast_below` < a leave no state at the sample at which
it was entered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fopi_tune.errors import DomainError


@dataclass(frozen=True)
class Threshold:
    """One line.

    Args:
        value: in the output's unit.
        is_absolute: whether it is the output itself; otherwise it is added to the setpoint.
    """

    value: float
    is_absolute: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise DomainError(f"threshold {self.value!r} must be a finite number")

    def level(self, setpoint: float) -> float:
        """The output on this line."""
        return self.value if self.is_absolute else setpoint + self.value


@dataclass(frozen=True)
class SwitchingLines:
    """Every line of a pair.

    Args:
        up: from mode 1, which raises the output, to mode 2, at it or above.
        down: from mode 2 to mode 1, at it or below.
        coast_above: from mode 1 to coasting; None where the modes do not coast.
        coast_below: from mode 2 to coasting; None likewise.

    Raises:
        DomainError: lines of one kind in another order than that of (2), or one of two for coasting.
    """

    up: Threshold
    down: Threshold
    coast_above: Threshold | None = None
    coast_below: Threshold | None = None

    def __post_init__(self) -> None:
        if (self.coast_above is None) != (self.coast_below is None):
            raise DomainError("coasting needs both lines, coast_above and coast_below")
        if (found := self.misplaced) is not None:
            low, high = found
            raise DomainError(f"the line {low} must lie below {high}, or a mode is left as soon as it is entered")

    @classmethod
    def of(cls, hysteresis: float | SwitchingLines) -> SwitchingLines:
        """The lines themselves, or those of a half-width, in the output's unit."""
        if isinstance(hysteresis, SwitchingLines):
            return hysteresis
        if not 0.0 <= hysteresis < math.inf:
            raise DomainError(f"the half-width of the hysteresis, {hysteresis!r}, must be finite and >= 0")
        return cls(Threshold(hysteresis), Threshold(-hysteresis))

    @property
    def coasts(self) -> bool:
        """Whether there is a band in which both outputs rest."""
        return self.coast_above is not None

    @property
    def half_width(self) -> float | None:
        """eps where the lines are those of a hysteresis around the setpoint; None where they are others."""
        relative = not (self.up.is_absolute or self.down.is_absolute or self.coasts)
        return self.up.value if relative and self.down.value == -self.up.value else None

    @property
    def misplaced(self) -> tuple[str, str] | None:
        """Two lines of one kind, by their fields, of which the first must lie below the other; None where all do."""
        for low, high, strictly in self._ordered():
            if getattr(self, low).is_absolute == getattr(self, high).is_absolute:
                below, above = getattr(self, low).value, getattr(self, high).value
                if below > above or (strictly and below == above):
                    return low, high
        return None

    def misplaced_at(self, setpoint: float) -> tuple[str, str] | None:
        """The same of lines of any kind, at a setpoint."""
        for low, high, strictly in self._ordered():
            below, above = getattr(self, low).level(setpoint), getattr(self, high).level(setpoint)
            if below > above or (strictly and below == above):
                return low, high
        return None

    def _ordered(self) -> Iterator[tuple[str, str, bool]]:
        """Fields of two lines, the lower one first, and whether they may not be equal."""
        yield "down", "up", self.coasts
        if self.coasts:
            yield "down", "coast_above", True
            yield "coast_above", "up", False
            yield "down", "coast_below", False
            yield "coast_below", "up", True

    @property
    def numbers(self) -> tuple[tuple[float, float], ...]:
        """Value and whether it is absolute, 1 or 0, of up, down, coast_above and coast_below; 0 without coasting."""
        rest = Threshold(0.0)
        every = (self.up, self.down, self.coast_above or rest, self.coast_below or rest)
        return tuple((each.value, float(each.is_absolute)) for each in every)
