"""Distributions that the range of a number does not bound:  normal, lognormal, noise about the nominal value.

"The nominal value plus random noise with mean value m" does not say whose mean is meant and which shape the noise has;
with a nominal value n it can mean

    NormalNoise(m, std)  n + noise; the noise itself has the mean m and some spread
    FoldedNoise(m)       n + |noise|, normal noise of mean 0 whose size has the mean m
    UniformNoise(m)      n + noise, uniform on [0, 2 m]
    NormalNoise(0, m sqrt(pi/2))   n + noise of both signs whose size has the mean m
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.distributions.distribution import Distribution, MeanAndStd, Words, check_finite, check_positive
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError

#: standard deviations that no draw exceeds: |Phi^-1(u)| = 8.21 at u = 2^-53 and 8.29 at 2^-54
FARTHEST = 9.0


@dataclass(frozen=True)
class Normal(MeanAndStd):
    """Normal; its values may lie outside the range.

    Args:
        mean: the mean, in the number's unit.
        std: the standard deviation, > 0.
        clip: (least, greatest) value; values beyond are moved to these ends.  None clips nothing.
    """

    clip: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
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
        far, (least, most) = FARTHEST * self.std, self.limits(number)
        return min(max(self.mean - far, least), most), max(min(self.mean + far, most), least)


@dataclass(frozen=True)
class LogNormal(MeanAndStd):
    """Lognormal: positive, its logarithm is normal; its values may lie outside the range.

    Args:
        mean: of the number itself (not of its logarithm), in its unit, > 0.
        std: standard deviation of the number itself, > 0.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "mean", self.mean)
        check_finite(self, self.std / self.mean)

    @property
    def _of_logarithm(self) -> tuple[float, float]:
        """Mean and standard deviation of ln x.

        s^2 = ln(1 + (std/mean)^2),  m = ln(mean) - s^2/2.
        """
        variance = 2.0 * math.log(math.hypot(1.0, self.std / self.mean))
        return math.log(self.mean) - 0.5 * variance, math.sqrt(variance)

    def values(self, u: Array, number: Uncertain) -> Array:
        """exp(m + s Phi^-1(u))."""
        from scipy import special

        mean, std = self._of_logarithm
        return np.exp(mean + std * special.ndtri(u))

    def limits(self, number: Uncertain) -> tuple[float, float]:
        """Positive numbers."""
        return 0.0, math.inf

    def words(self) -> Words:
        """lognormal with mean and std."""
        return {"lognormal": {"mean": self.mean, "std": self.std}}

    def reach(self, number: Uncertain) -> tuple[float, float]:
        """Nine standard deviations of the logarithm."""
        mean, std = self._of_logarithm
        far = mean + FARTHEST * std
        return math.exp(mean - FARTHEST * std), math.inf if far > 700.0 else math.exp(far)


@dataclass(frozen=True)
class NormalNoise(MeanAndStd):
    """The nominal value plus normal noise of this mean and standard deviation; it may leave the range."""

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
        far = FARTHEST * self.std
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
        far = number.nominal + self.mean * math.sqrt(math.pi / 2) * FARTHEST
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


def _noise(distribution: Distribution, mean: float) -> None:
    check_finite(distribution, mean)
    if mean == 0:
        raise DomainError(f"{distribution}: without a mean there is no noise; use shape normal for noise to both sides")
