"""What an inversion needs to know of a plant P0 = N/D, polynomials or sums of real powers.

A sum of powers sum c_j s^e_j with the highest order e_n has no zero on the principal sheet where

    |c_n| r^e_n > sum over the others |c_j| r^e_j ,        r = |s| ,                                                 (1)

which holds from one radius on.  Nearer to 0 its zeros in the sector |arg s| <= theta are counted: with
h = sum c_j s^e_j/(c_n s^e_n), which tends to 1,

    the number beyond the radius w = (1/pi) (arg h at w, followed from infinity along arg s = theta and the arc).    (2)

Source: (1) is the triangle inequality, (2) the argument principle.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.fractional_plants.plants import FractionalPlant
from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import Plant
from fopi_tune.simulation.fractional.inversion import SECTOR_RAD

#: coefficients and orders of a sum of powers
Terms = Sequence[tuple[float, float]]
#: of ln r in (1)
_FARTHEST, _HALVINGS = 300.0, 80
#: steps of ln s in (2), the largest turn of h in one, halvings of the radius, and how far it lies beyond a zero
_STEP, _TURN, _RADII, _BEYOND = 0.02, 0.7, 12, 1.05


class PlantSides(ABC):
    """N and D of a plant without its dead time."""

    @property
    @abstractmethod
    def direct(self) -> float:
        """P0(inf)."""

    @property
    @abstractmethod
    def falls(self) -> float:
        """The exponent by which |P0| falls as |s| -> inf."""

    @abstractmethod
    def at(self, s: Complex) -> tuple[Complex, Complex]:
        """N and D at complex numbers of any shape."""

    @property
    @abstractmethod
    def corners_rad_s(self) -> Array:
        """Where |P0| bends."""

    @property
    @abstractmethod
    def farthest_pole_rad_s(self) -> float:
        """No pole in the sector of the inversion is farther from 0; 0 where there is none in it."""

    @property
    @abstractmethod
    def rightmost_pole_rad_s(self) -> float:
        """No pole has a larger real part, which is at least 0."""


def sides_of(plant: Plant) -> PlantSides:
    """The sides of a plant."""
    return PowerSides(plant) if isinstance(plant, FractionalPlant) else PolynomialSides(plant)


@dataclass(frozen=True)
class PolynomialSides(PlantSides):
    """Polynomials in s."""

    plant: Plant

    @property
    def direct(self) -> float:
        n, d = np.trim_zeros(self.plant.numerator, "f"), self.plant.denominator
        return n[0] / d[0] if len(n) == len(d) else 0.0

    @property
    def falls(self) -> float:
        return len(self.plant.denominator) - len(np.trim_zeros(self.plant.numerator, "f"))

    def at(self, s: Complex) -> tuple[Complex, Complex]:
        n, d = (np.asarray(np.polyval(p, s), dtype=complex) for p in (self.plant.numerator, self.plant.denominator))
        return n, d

    @property
    def corners_rad_s(self) -> Array:
        poles, zeros = np.roots(self.plant.denominator), np.roots(self.plant.numerator)
        return np.concatenate([np.abs(poles), np.abs(zeros)])

    @property
    def _aside(self) -> Complex:
        poles = np.roots(self.plant.denominator)
        return np.asarray(poles[np.abs(np.angle(poles)) < SECTOR_RAD], dtype=complex)

    @property
    def farthest_pole_rad_s(self) -> float:
        return float(np.abs(self._aside).max(initial=0.0))

    @property
    def rightmost_pole_rad_s(self) -> float:
        return max(0.0, float(self._aside.real.max(initial=0.0)))


@dataclass(frozen=True)
class PowerSides(PlantSides):
    """Sums of real powers of s, on the principal branch; poles are known by (1) alone."""

    plant: FractionalPlant

    @property
    def top(self) -> Terms:
        """Coefficients and orders of N."""
        return _terms(self.plant.top, self.plant.orders.numerator)

    @property
    def bottom(self) -> Terms:
        """Coefficients and orders of D."""
        return _terms(self.plant.bottom, self.plant.orders.denominator)

    @property
    def direct(self) -> float:
        (c, e), (d, f) = self.top[0], self.bottom[0]
        return c / d if e == f else 0.0

    @property
    def falls(self) -> float:
        return self.bottom[0][1] - self.top[0][1]

    def at(self, s: Complex) -> tuple[Complex, Complex]:
        n, d = (
            np.asarray(sum((c * s**e for c, e in side), np.zeros_like(s)), dtype=complex)
            for side in (self.top, self.bottom)
        )
        return n, d

    @property
    def corners_rad_s(self) -> Array:
        return np.asarray(np.abs(Plants.of(self.plant).corner_roots), dtype=float)

    @property
    def farthest_pole_rad_s(self) -> float:
        return farthest_in_sector(self.bottom)

    @property
    def rightmost_pole_rad_s(self) -> float:
        return farthest_in_sector(self.bottom) if Plants.of(self.plant).unstable_poles[0] else 0.0

    def farthest_closed_loop_pole_rad_s(self, kp: float, ki: float, alpha: float) -> float:
        """Of s^alpha D + (kp s^alpha + ki) N, a sum of powers too, by (1) and (2).

        Args:
            kp, ki, alpha: the gains as in `FoPi`.
        """
        joined: dict[float, float] = {}
        order = alpha if ki else 0.0
        for gain, shift, side in ((1.0, order, self.bottom), (kp, order, self.top), (ki, 0.0, self.top)):
            for c, e in side:
                joined[e + shift] = joined.get(e + shift, 0.0) + gain * c
        return farthest_in_sector([(c, e) for e, c in joined.items() if c])


def _terms(coefficients: tuple[float, ...], orders: tuple[float, ...]) -> Terms:
    return [(c, e) for c, e in zip(coefficients, orders, strict=True) if c]


def farthest_zero(terms: Terms) -> float:
    """The radius from which (1) holds, rad/s; 0 of a single term."""
    last = max(terms, key=lambda term: term[1])
    rest = [(math.log(abs(c / last[0])), e - last[1]) for c, e in terms if e < last[1]]
    if not rest:
        return 0.0
    # the sum of the others over the last term falls
    low, high = -_FARTHEST, _FARTHEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if sum(math.exp(min(b + e * middle, _FARTHEST)) for b, e in rest) < 1.0:
            high = middle
        else:
            low = middle
    return math.exp(high)


def farthest_in_sector(terms: Terms) -> float:
    """A radius beyond which there is no zero in the sector of the inversion, rad/s; 0 where there is none in it."""
    far = farthest_zero(terms)
    if far == 0.0:
        return 0.0
    last = max(terms, key=lambda term: term[1])
    rest = [(c / last[0], e - last[1]) for c, e in terms if e < last[1]]
    # nearer to 0 than by (1) of 1/s there is none
    high, low = math.log(far), -math.log(farthest_zero([(c, -e) for c, e in terms]))
    if _is_free(rest, low, high):
        return 0.0
    for _ in range(_RADII):
        middle = 0.5 * (low + high)
        if _is_free(rest, middle, high):
            high = middle
        else:
            low = middle
    return _BEYOND * math.exp(high)


def _is_free(rest: Terms, low: float, high: float) -> bool:
    """Whether (2) is 0 at w = e^low, h being 1 and `rest`; beyond e^high |h - 1| < 1."""
    count = max(2, math.ceil((high - low) / _STEP))
    ray = np.linspace(high, low, count) + 1j * SECTOR_RAD
    arc = low + 1j * np.linspace(SECTOR_RAD, 0.0, math.ceil(SECTOR_RAD / _STEP))
    path = np.concatenate([ray, arc[1:]])
    h = 1.0 + sum((c * np.exp(e * path) for c, e in rest), np.zeros_like(path))
    with np.errstate(all="ignore"):
        turns = np.angle(h[1:] / h[:-1])
    if not np.all(np.abs(turns) < _TURN):
        return False
    return abs(float(np.angle(h[0]) + turns.sum())) < 0.5
