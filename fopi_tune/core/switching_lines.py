"""Where two modes with one output take turns:  setpoint -> the outputs at which each is left.

With a the line of `up` and b that of `down`, for the measurement y_m:

    mode 1 -> 2 when y_m >= a,      mode 2 -> 1 when y_m <= b .                                                      (1)

A relative threshold x is the line r + x, an absolute one x itself.  A hysteresis of half-width eps is a = r + eps and
b = r - eps.  Where the modes coast, in state 0, neither controller acts and the control is 0:

    mode 1 -> 0 when y_m >= `coast_above`,  mode 2 -> 0 when y_m <= `coast_below`,  0 -> 2 and 0 -> 1 as in (1),     (2)

(1) first.  With b < a, b < `coast_above` and `coast_below` < a no state is left at the next sample for an output that
stays where it is.  A mode coasts only where `coast_above` <= a, or b <= `coast_below`.

Source: definitions; (1) is the hysteresis of the paper with lines of their own.
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

    @property
    def entry(self) -> float | dict[str, float]:
        """As it is written in files."""
        return {"absolute": self.value} if self.is_absolute else self.value


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
        if (found := self.misplaced_among(self.up, self.down, self.coast_above, self.coast_below)) is not None:
            low, high = found
            raise DomainError(f"the line {low} must lie below {high}, or a mode is left as soon as it is entered")

    @classmethod
    def of(cls, hysteresis: float | SwitchingLines) -> SwitchingLines:
        """The lines themselves, or those of a half-width, in the output's unit."""
        if isinstance(hysteresis, SwitchingLines):
            return hysteresis
        if not 0.0 <= hysteresis < math.inf:
            raise DomainError(f"half_width {hysteresis!r} must be finite and >= 0")
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

    @staticmethod
    def misplaced_among(
        up: Threshold, down: Threshold, coast_above: Threshold | None, coast_below: Threshold | None
    ) -> tuple[str, str] | None:
        """Two lines of one kind, by their fields, of which the first must lie below the other; None where all do."""
        every = {"up": up, "down": down, "coast_above": coast_above, "coast_below": coast_below}
        for low, high, strictly in _ordered(coast_above is not None and coast_below is not None):
            one, other = every[low], every[high]
            if one is None or other is None or one.is_absolute != other.is_absolute:
                continue
            if one.value > other.value or (strictly and one.value == other.value):
                return low, high
        return None

    def misplaced_at(self, setpoint: float) -> tuple[str, str] | None:
        """The same of lines of any kind, at a setpoint, where a state would be left as soon as it is entered."""
        for low, high, strictly in _ordered(self.coasts):
            below, above = getattr(self, low).level(setpoint), getattr(self, high).level(setpoint)
            # from a mode whose line to coast lies beyond that of the other one there is no coasting, which is harmless
            needed = strictly or not self.coasts
            if needed and (below > above or (strictly and below == above)):
                return low, high
        return None

    def named(self, raising: str, lowering: str) -> dict[str, Threshold]:
        """The lines by the words of a system's file, for modes of these names."""
        named = {f"to_{lowering}_above": self.up, f"to_{raising}_below": self.down}
        if self.coast_above is not None and self.coast_below is not None:
            named |= {"coast_above": self.coast_above, "coast_below": self.coast_below}
        return named

    @property
    def numbers(self) -> tuple[tuple[float, float], ...]:
        """Value and whether it is absolute, 1 or 0, of up, down, coast_above and coast_below; 0 without coasting."""
        rest = Threshold(0.0)
        every = (self.up, self.down, self.coast_above or rest, self.coast_below or rest)
        return tuple((each.value, float(each.is_absolute)) for each in every)


def turns_entry(lines: SwitchingLines, raising: str, lowering: str) -> dict[str, object]:
    """Where modes of these names take turns, as results and certificates have it."""
    if lines.half_width is not None:
        return {"hysteresis": lines.half_width}
    return {"thresholds": {word: line.entry for word, line in lines.named(raising, lowering).items()}}


def _ordered(coasts: bool) -> Iterator[tuple[str, str, bool]]:
    """Fields of two lines, the lower one first, and whether they may not be equal."""
    yield "down", "up", coasts
    if coasts:
        yield "down", "coast_above", True
        yield "coast_above", "up", False
        yield "down", "coast_below", False
        yield "coast_below", "up", True
