"""A second opinion on loops of kp + ki s^-alpha + kd s^mu/(Tf s + 1):  margins, responses and stability by NumPy alone.

Margins and the contour are those of `dense_margins`, responses those of `pid_loops`; poles are also counted by the
roots of a polynomial in s^(1/q) where the orders are multiples of 1/q (Matignon).  On samples both powers are
Oustaloup's filters in s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from oracles.dense_margins import NEAR, Continuous, UncertainError
from oracles.pid_loops import PidFamily, PidLoop

from fopi_tune.core.controller import FoPi, FoPid
from fopi_tune.core.plant import Plant
from fopi_tune.spec.model import DigitalSpec

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
#: relative; a root closer to the sector's edge is nobody's certain knowledge in double precision
NEAR_EDGE = 1e-7


def controller(gains: FoPi, omega: Array) -> Complex:
    """C(j omega), written down anew."""
    s = 1j * omega
    found = np.full(np.shape(omega), complex(gains.kp))
    if gains.ki:
        found = found + gains.ki * np.exp(-gains.alpha * (np.log(omega) + 0.5j * np.pi))
    if isinstance(gains, FoPid):
        top = gains.kd * np.exp((gains.mu - 1.0) * (np.log(omega) + 0.5j * np.pi))
        found = found + top / (gains.derivative_filter_time_constant_s + 1.0 / s)
    return np.asarray(found, dtype=complex)


def oustaloup(beta: float, s: Complex, digital: DigitalSpec) -> Complex:
    """s^beta by Oustaloup's filter, exact in gain in the middle of the band."""
    low, high = digital.band_rad_s
    ratio, n = high / low, digital.poles
    middle, found, gain = 1j * np.sqrt(low * high), np.ones_like(s), 1.0
    for k in range(1, n + 1):
        zero, pole = (low * ratio ** ((k - 0.5 - side * 0.5 * beta) / n) for side in (1.0, -1.0))
        found = found * (s + zero) / (s + pole)
        gain *= abs((middle + zero) / (middle + pole))
    return np.asarray(found * abs(middle) ** beta / gain)


def bilinear(omega: Array, sample_time_s: float) -> Complex:
    """s of Tustin's rule at e^{j omega Ts}."""
    return np.asarray(2j / sample_time_s * np.tan(0.5 * omega * sample_time_s))


def on_samples(gains: FoPid, digital: DigitalSpec, omega: Array) -> Complex:
    """C(e^{j omega Ts}) by Tustin's rule, the powers being s^-1 s^(1 - alpha) and s s^(mu - 1)."""
    s = bilinear(omega, digital.sample_time_s)
    derivative = s * oustaloup(gains.mu - 1.0, s, digital) / (gains.derivative_filter_time_constant_s * s + 1.0)
    return np.asarray(gains.kp + gains.ki * oustaloup(1.0 - gains.alpha, s, digital) / s + gains.kd * derivative)


@dataclass(frozen=True)
class OfAnyOrder(Continuous):
    """C P in continuous time, with a derivative."""

    gains: FoPi

    @classmethod
    def of(cls, gains: FoPi, plant: Plant) -> OfAnyOrder:
        """One loop."""
        return cls(plant, gains.kp, gains.ki, gains.alpha, gains)

    def gain(self, omega: Array) -> Complex:
        """L(j omega)."""
        s = 1j * omega
        p = np.polyval(self.plant.numerator, s) / np.polyval(self.plant.denominator, s)
        return np.asarray(controller(self.gains, omega) * p * np.exp(-s * self.plant.dead_time_s), dtype=complex)

    @cached_property
    def _corners(self) -> list[float]:
        found = Continuous(self.plant, self.kp, self.ki, self.alpha)._corners
        if not isinstance(self.gains, FoPid):
            return found
        kd, mu, filter_s = self.gains.kd, self.gains.mu, self.gains.derivative_filter_time_constant_s
        more = [1.0 / filter_s]
        more += [abs(self.kp / kd) ** (1.0 / mu)] if self.kp else []
        more += [abs(self.ki / kd) ** (1.0 / (mu + self.alpha))] if self.ki else []
        return [*found, *more]

    @property
    def direct(self) -> float:
        """L(inf), but for the turns of a dead time."""
        numerator = np.trim_zeros(self.plant.numerator, "f")
        if len(numerator) < len(self.plant.denominator):
            return 0.0
        more = 0.0
        if isinstance(self.gains, FoPid) and self.gains.mu == 1.0:
            more = self.gains.kd / self.gains.derivative_filter_time_constant_s
        return (self.kp + more) * numerator[0] / self.plant.denominator[0]

    @cached_property
    def is_stable(self) -> bool:
        """By the contour."""
        if np.min(np.abs(1.0 + self.gain(self.grid))) < NEAR:
            raise UncertainError("through -1")
        if self._at_the_origin == 0.0:
            return False
        late = self.plant.dead_time_s
        if late and abs(abs(self.direct) - 1.0) < NEAR:
            raise UncertainError("a direct path of 1")
        if late and abs(self.direct) > 1.0:
            return False
        return self._poles_by_contour() == 0


def poles_by_sector(gains: FoPid, plant: Plant, q: int) -> int | None:
    """Roots of s^alpha (Tf s + 1) (D + C N) on the right, by those of a polynomial in w = s^(1/q).

    Args:
        gains: with alpha and mu multiples of 1/q.
        plant: without a dead time.
        q: of which alpha and mu are multiples.

    Returns:
        The roots with |arg w| < pi/(2 q); None when one is too close to that edge, or to 0.
    """
    alpha, mu, filter_s = round(gains.alpha * q), round(gains.mu * q), gains.derivative_filter_time_constant_s

    def in_w(coefficients: tuple[float, ...] | Array) -> Array:
        found = np.zeros((len(coefficients) - 1) * q + 1)
        found[::q] = coefficients
        return found

    def shifted(polynomial: NDArray[Any], power: int) -> Array:
        return np.concatenate([polynomial, np.zeros(power)])

    filtered, top = in_w((filter_s, 1.0)), in_w(plant.numerator)
    total = shifted(np.polymul(filtered, in_w(plant.denominator)), alpha)
    pi = np.polyadd(shifted(gains.kp * filtered, alpha), gains.ki * filtered)
    total = np.polyadd(total, np.polymul(np.polyadd(pi, shifted(np.array([gains.kd]), alpha + mu)), top))
    # without an integral s^alpha is a factor of all
    roots = np.roots(np.trim_zeros(total, "b") if gains.ki == 0.0 else total)
    edge = 0.5 * math.pi / q
    off = np.abs(np.abs(np.angle(roots)) - edge)
    if np.any(off < NEAR_EDGE) or np.any(np.abs(roots) < 1e-4):
        return None
    return int(np.sum(np.abs(np.angle(roots)) < edge))


@dataclass(frozen=True)
class FopidLoop(PidLoop):
    """One loop of any orders."""

    @cached_property
    def joined(self) -> Continuous:
        return OfAnyOrder.of(self.pid, self.plant)

    def controller(self, omega: Array) -> Complex:
        return controller(self.pid, omega)


@dataclass(frozen=True)
class FopidFamily(PidFamily):
    """The members of a family with one controller of any orders."""

    def loop(self, point: Array) -> PidLoop:
        return FopidLoop(self.plants.member(point), self.pid)
