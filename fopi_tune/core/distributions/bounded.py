"""Distributions between two ends:  uniform, triangular, truncated normal and beta.

`TruncatedNormal` and `Beta` are on the number's range; the ends of the others are those of the range, or given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.distributions.distribution import Distribution, MeanAndStd, Words, check_finite, check_positive
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform on [min, max].

    Args:
        between: (min, max) in the number's unit, which may be a part of its range or reach beyond it; None: the range.
    """

    between: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.between is not None:
            check_ends(self, *self.between)

    def values(self, u: Array, number: Uncertain) -> Array:
        """min + u (max - min)."""
        return within(u, *self.limits(number))

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The ends."""
        return self.between or (number.min, number.max)

    def words(self) -> Words:
        """uniform, with its ends if it has any."""
        if self.between is None:
            return "uniform"
        return {"uniform": {"min": self.between[0], "max": self.between[1]}}


@dataclass(frozen=True)
class Triangular(Distribution):
    """Triangular: the density rises from 0 at `min` to the mode and falls to 0 at `max`.

    Args:
        min: the least value, in the number's unit.
        mode: the most likely one.
        max: the greatest.
    """

    min: float
    mode: float
    max: float

    def __post_init__(self) -> None:
        check_ends(self, self.min, self.max)
        if not self.min <= self.mode <= self.max:
            raise DomainError(f"{self}: the mode must lie between min and max")

    def values(self, u: Array, number: Uncertain) -> Array:
        """min + sqrt(u w (mode - min)) up to the mode, then max - sqrt((1 - u) w (max - mode)).

        w = max - min, and u w = mode - min at the mode; the roots are taken of each factor, whose product may overflow.
        """
        width = self.max - self.min
        rise, fall = self.mode - self.min, self.max - self.mode
        left = self.min + np.sqrt(u) * (math.sqrt(width) * math.sqrt(rise))
        right = self.max - np.sqrt(1.0 - u) * (math.sqrt(width) * math.sqrt(fall))
        return np.clip(np.where(u * width < rise, left, right), self.min, self.max)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """min and max."""
        return self.min, self.max

    def words(self) -> Words:
        """triangular with min, mode and max."""
        return {"triangular": {"min": self.min, "mode": self.mode, "max": self.max}}


@dataclass(frozen=True)
class TruncatedNormal(MeanAndStd):
    """A normal distribution of this mean and standard deviation, truncated to [min, max]."""

    def values(self, u: Array, number: Uncertain) -> Array:
        """x = mean + std Phi^-1(Phi(a) + u (Phi(b) - Phi(a))), a and b the ends in standard deviations.

        Raises:
            DomainError: the range's probability is 0 up to rounding, or so small a part of its tail's that the
                difference of the two has no accurate digits.
        """
        from scipy import special

        if (problem := self.problem(number)) is not None:
            raise DomainError(f"{self} {problem}")
        sign, a, b = self._ends(number)
        start, end = special.ndtr(sign * a), special.ndtr(sign * b)
        x = self.mean + sign * self.std * special.ndtri(start + u * (end - start))
        return np.clip(x, number.min, number.max)

    def problem(self, number: Uncertain) -> str | None:
        """The range's probability must be positive, and the distribution function must vary on it in floating point."""
        sign, a, b = self._ends(number)
        # Phi(x) = erfc(-x/sqrt 2)/2
        start, end = (0.5 * math.erfc(-sign * x / math.sqrt(2.0)) for x in (a, b))
        where = f"[{number.min!r}, {number.max!r}]"
        if not max(start, end) >= 1e-290:
            return f"has next to no probability on {where}; check mean and std"
        if not abs(end - start) >= 1e-6 * max(start, end):
            return f"does not vary on {where} by what a float can tell; write uniform"
        return None

    def _ends(self, number: Uncertain) -> tuple[float, float, float]:
        """The sign of the tail that is computed, and the range's ends in standard deviations.

        The upper tail is computed by symmetry as the lower one, where probabilities are accurate.
        """
        a, b = (number.min - self.mean) / self.std, (number.max - self.mean) / self.std
        return -1.0 if a > 0.0 else 1.0, a, b

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max

    def words(self) -> Words:
        """truncated_normal with mean and std."""
        return {"truncated_normal": {"mean": self.mean, "std": self.std}}


@dataclass(frozen=True)
class Beta(Distribution):
    """The beta distribution with density x^(a-1) (1-x)^(b-1), x = 0 at min and 1 at max."""

    a: float
    b: float

    def __post_init__(self) -> None:
        check_finite(self, self.a, self.b)
        check_positive(self, "a", self.a)
        check_positive(self, "b", self.b)

    def values(self, u: Array, number: Uncertain) -> Array:
        """min + I^-1(u; a, b) (max - min)."""
        from scipy import special

        return within(np.asarray(special.betaincinv(self.a, self.b, u)), number.min, number.max)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max

    def words(self) -> Words:
        """beta with a and b."""
        return {"beta": {"a": self.a, "b": self.b}}


def within(x: Array, low: float, high: float) -> Array:
    """low + x (high - low), which is low at x = 0 and high at 1 exactly, and does not overflow; x of any shape."""
    return np.clip((1.0 - x) * low + x * high, low, high)


def check_ends(distribution: Distribution, low: float, high: float) -> None:
    """Refuse ends that are not in order, or too far apart for a floating-point number.

    Raises:
        DomainError: not so.
    """
    check_finite(distribution, low, high, high - low)
    if not low < high:
        raise DomainError(f"{distribution}: min must be less than max")
