"""Distributions of an uncertain number:  u in (0, 1), Uncertain -> value, by the inverse of the distribution function.

`Uniform`, `TruncatedNormal` and `Beta` stay within the number's range; `Normal` and the noises may leave it.  "The
nominal value plus random noise with mean value m" does not say whose mean is meant and which shape the noise has; with
a nominal value n it can mean

    NormalNoise(m, std)  n + noise; the noise itself has the mean m and some spread
    FoldedNoise(m)       n + |noise|, normal noise of mean 0 whose size has the mean m
    UniformNoise(m)      n + noise, uniform on [0, 2 m]
    NormalNoise(0, m sqrt(pi/2))   n + noise of both signs whose size has the mean m

Only elementwise functions are used, so that a value does not depend on its neighbours in the array.  SciPy is imported
when values are drawn; reading a spec does not need it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError

#: a distribution in a spec: a word, or a word with its numbers
Words = str | Mapping[str, Mapping[str, float | str | list[float]]]
#: standard deviations that no draw exceeds: |Phi^-1(u)| = 8.21 at u = 2^-53 and 8.29 at 2^-54
_FARTHEST = 9.0


class Distribution(ABC):
    """A distribution of one uncertain number."""

    @abstractmethod
    def values(self, u: Array, number: Uncertain) -> Array:
        """Quantiles: the values whose distribution function is u.

        Args:
            u: any shape, in (0, 1).
            number: the range and nominal value.

        Raises:
            DomainError: this range has no such distribution.
        """

    @abstractmethod
    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The least and the greatest possible value, infinite where there is none."""

    @abstractmethod
    def words(self) -> Words:
        """The distribution as a spec writes it."""

    def reach(self, number: Uncertain) -> tuple[float, float]:
        """Finite bounds that no draw exceeds, because a random number u has 53 bits."""
        return self.limits(number)

    def problem(self, number: Uncertain) -> str | None:
        """Why nothing can be drawn for this number and what to do, or None."""
        if all(map(math.isfinite, self.reach(number))):
            return None
        return "has values that are too large for a floating-point number; write smaller numbers"


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform on [min, max]."""

    def values(self, u: Array, number: Uncertain) -> Array:
        """min + u (max - min)."""
        return _between(u, number)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max

    def words(self) -> Words:
        """uniform."""
        return "uniform"


@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """A normal distribution of this mean and standard deviation, truncated to [min, max]."""

    mean: float
    std: float

    def __post_init__(self) -> None:
        _finite(self, self.mean, self.std)
        _positive(self, "std", self.std)

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
        _finite(self, self.a, self.b)
        _positive(self, "a", self.a)
        _positive(self, "b", self.b)

    def values(self, u: Array, number: Uncertain) -> Array:
        """min + I^-1(u; a, b) (max - min)."""
        from scipy import special

        return _between(np.asarray(special.betaincinv(self.a, self.b, u)), number)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max

    def words(self) -> Words:
        """beta with a and b."""
        return {"beta": {"a": self.a, "b": self.b}}


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal; its values may lie outside the range.

    Args:
        mean: the mean, in the number's unit.
        std: the standard deviation, > 0.
        clip: (least, greatest) value; values beyond are moved to these ends.  None clips nothing.
    """

    mean: float
    std: float
    clip: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        _finite(self, self.mean, self.std)
        _positive(self, "std", self.std)
        if self.clip is not None and not self.clip[0] < self.clip[1]:
            raise DomainError(f"{self} has an empty clip; give (least, greatest)")

    def values(self, u: Array, number: Uncertain) -> Array:
        """mean + std Phi^-1(u), clipped."""
        from scipy import special

        return np.clip(self.mean + self.std * special.ndtri(u), *self.limits(number))

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The clip."""
        return self.clip or (-math.inf, math.inf)

    def words(self) -> Words:
        """normal with mean and std, and its clip if it has one."""
        clip = {} if self.clip is None else {"clip": list(self.clip)}
        return {"normal": {"mean": self.mean, "std": self.std, **clip}}

    def reach(self, number: Uncertain) -> tuple[float, float]:
        """Nine standard deviations, clipped."""
        far, (least, most) = _FARTHEST * self.std, self.limits(number)
        return min(max(self.mean - far, least), most), max(min(self.mean + far, most), least)


@dataclass(frozen=True)
class NormalNoise(Distribution):
    """The nominal value plus normal noise of this mean and standard deviation; it may leave the range."""

    mean: float
    std: float

    def __post_init__(self) -> None:
        _finite(self, self.mean, self.std)
        _positive(self, "std", self.std)

    def values(self, u: Array, number: Uncertain) -> Array:
        """nominal + (mean + std Phi^-1(u))."""
        from scipy import special

        return number.nominal + (self.mean + self.std * special.ndtri(u))

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """None."""
        return -math.inf, math.inf

    def words(self) -> Words:
        """nominal_plus_noise of shape normal."""
        return {"nominal_plus_noise": {"shape": "normal", "mean": self.mean, "std": self.std}}

    def reach(self, number: Uncertain) -> tuple[float, float]:
        """Nine standard deviations."""
        far = _FARTHEST * self.std
        return number.nominal + (self.mean - far), number.nominal + (self.mean + far)


@dataclass(frozen=True)
class FoldedNoise(Distribution):
    """The nominal value plus |noise|, normal noise about 0 whose size has this mean; a negative mean subtracts."""

    mean: float

    def __post_init__(self) -> None:
        _noise(self, self.mean)

    def values(self, u: Array, number: Uncertain) -> Array:
        """nominal + mean sqrt(pi/2) |z|, |z| = -Phi^-1((1 - u)/2), because E|z| = sqrt(2/pi)."""
        from scipy import special

        return number.nominal - self.mean * math.sqrt(math.pi / 2) * special.ndtri((1.0 - u) / 2.0)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """From the nominal value on."""
        return (number.nominal, math.inf) if self.mean > 0 else (-math.inf, number.nominal)

    def words(self) -> Words:
        """nominal_plus_noise of shape half_normal."""
        return {"nominal_plus_noise": {"shape": "half_normal", "mean": self.mean}}

    def reach(self, number: Uncertain) -> tuple[float, float]:
        """From the nominal value to nine standard deviations of the noise."""
        far = number.nominal + self.mean * math.sqrt(math.pi / 2) * _FARTHEST
        return min(number.nominal, far), max(number.nominal, far)


@dataclass(frozen=True)
class UniformNoise(Distribution):
    """The nominal value plus noise that is uniform between 0 and twice this mean."""

    mean: float

    def __post_init__(self) -> None:
        _noise(self, self.mean)

    def values(self, u: Array, number: Uncertain) -> Array:
        """nominal + 2 mean u."""
        return number.nominal + 2.0 * self.mean * u

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """From the nominal value to twice the mean away."""
        low, high = sorted((number.nominal, number.nominal + 2.0 * self.mean))
        return low, high

    def words(self) -> Words:
        """nominal_plus_noise of shape uniform."""
        return {"nominal_plus_noise": {"shape": "uniform", "mean": self.mean}}


def _between(x: Array, number: Uncertain) -> Array:
    # not min + x (max - min): that may overflow, and does not reach both ends exactly
    return np.clip((1.0 - x) * number.min + x * number.max, number.min, number.max)


def _finite(distribution: Distribution, *numbers: float) -> None:
    if not all(math.isfinite(v) for v in numbers):
        raise DomainError(f"{distribution} has a number that is not finite")


def _positive(distribution: Distribution, name: str, value: float) -> None:
    if value <= 0:
        raise DomainError(f"{distribution}: {name} must be greater than 0")


def _noise(distribution: Distribution, mean: float) -> None:
    _finite(distribution, mean)
    if mean == 0:
        raise DomainError(f"{distribution}: without a mean there is no noise; use shape normal for noise to both sides")
