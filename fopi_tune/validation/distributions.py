"""Distributions of an uncertain number:  u in (0, 1), Uncertain -> value, by the inverse of the distribution function.

`Uniform`, `TruncatedNormal` and `Beta` stay within the number's range.  `Normal`, `FoldedNoise` and `UniformNoise` may
leave it: they are readings of "the nominal value plus random noise with mean value m", which does not say whose mean
and which shape.  For a nominal value n,

    Normal(n + m, std)   the noise itself has the mean m and some spread
    FoldedNoise(m)       n + |noise|, normal noise of mean 0 whose size has the mean m
    UniformNoise(m)      n + noise, uniform on [0, 2 m]
    Normal(n, m sqrt(pi/2))   noise to both sides whose size has the mean m

Only arithmetic and SciPy's scalar functions are used, so that a value does not depend on its neighbours in the array.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError

Array = NDArray[np.float64]


class Distribution(ABC):
    """A distribution of one uncertain number."""

    @abstractmethod
    def values(self, u: Array, number: Uncertain) -> Array:
        """Values with distribution function u.

        Args:
            u: any shape, in (0, 1).
            number: the range and nominal value.

        Raises:
            DomainError: this range has no such distribution.
        """

    @abstractmethod
    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The least and the greatest possible value, infinite where there is none."""


@dataclass(frozen=True)
class Uniform(Distribution):
    """Every value of [min, max] alike."""

    def values(self, u: Array, number: Uncertain) -> Array:
        """min + u (max - min)."""
        return _between(u, number)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max


@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """Normal with this mean and standard deviation before what lies outside [min, max] is left out."""

    mean: float
    std: float

    def __post_init__(self) -> None:
        _finite(self, self.mean, self.std)
        _positive(self, "std", self.std)

    def values(self, u: Array, number: Uncertain) -> Array:
        """x = mean + std Phi^-1(Phi(a) + u (Phi(b) - Phi(a))), a and b the ends in standard deviations.

        Raises:
            DomainError: the range's probability cannot be told from 0, or is so small a part of its tail's that
                differences lose their digits.
        """
        a, b = (number.min - self.mean) / self.std, (number.max - self.mean) / self.std
        # the upper tail is computed as the lower one, where probabilities keep their digits
        sign = -1.0 if a > 0.0 else 1.0
        start, end = special.ndtr(sign * a), special.ndtr(sign * b)
        where = f"[{number.min!r}, {number.max!r}]"
        if max(start, end) < 1e-290:
            raise DomainError(f"{self} has next to no probability on {where}; check mean and std")
        if abs(end - start) < 1e-6 * max(start, end):
            raise DomainError(f"{self} does not vary on {where} by what a float can tell; use Uniform")
        x = self.mean + sign * self.std * special.ndtri(start + u * (end - start))
        return np.clip(x, number.min, number.max)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max


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
        return _between(np.asarray(special.betaincinv(self.a, self.b, u)), number)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The range."""
        return number.min, number.max


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal, whatever the range says.

    Args:
        mean: the mean, in the number's unit.
        std: the standard deviation, > 0.
        clip: ends to which values beyond them are moved (they then have a probability of their own); None moves none.
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
        return np.clip(self.mean + self.std * special.ndtri(u), *self.limits(number))

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The clip."""
        return self.clip or (-math.inf, math.inf)


@dataclass(frozen=True)
class FoldedNoise(Distribution):
    """The nominal value plus |noise|, normal noise about 0 whose size has this mean; a negative mean subtracts."""

    mean: float

    def __post_init__(self) -> None:
        _noise(self, self.mean)

    def values(self, u: Array, number: Uncertain) -> Array:
        """nominal + mean sqrt(pi/2) |z|, |z| = -Phi^-1((1 - u)/2), because E|z| = sqrt(2/pi)."""
        return number.nominal - self.mean * math.sqrt(math.pi / 2) * special.ndtri((1.0 - u) / 2.0)

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """From the nominal value on."""
        return (number.nominal, math.inf) if self.mean > 0 else (-math.inf, number.nominal)


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


def _between(x: Array, number: Uncertain) -> Array:
    # x min and x max apart: max - min may overflow, and both ends are met exactly
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
        raise DomainError(f"{distribution}: without a mean there is no noise; use Normal for noise to both sides")
