"""The scaled controllers in the symbols of the solver."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.design.global_search.compiled import Sampling


class Kind(NamedTuple):
    """What programs differ in.

    Args:
        corners: of a filter.
        matched: whether they are matched poles and zeros.
        sampled: whether the loop is on samples.
        derivative: whether there is a derivative, beside an integrator.
        orders: whether integral and derivative have orders that are unknowns too.
        peaks: whether a slot keeps its frequency at a peak.
        slopes: whether a slot has a slope of the phase.
        rise_corners: of a derivative's filter.
        filtered: whether a measurement filter makes |C S| smaller.
        terms: of fractional plants the numbers of terms of N and D.
        measured: whether plants are pieces of measured curves.
    """

    corners: int = 0
    matched: int = 0
    sampled: bool = False
    derivative: bool = False
    orders: bool = False
    peaks: bool = False
    slopes: bool = False
    rise_corners: int = 0
    filtered: bool = False
    terms: tuple[int, int] = (0, 0)
    measured: bool = False

    @classmethod
    def of(cls, sampling: Sampling, orders: bool = False) -> tuple[Kind, Array]:
        """The kind, and the numbers that its program has for parameters, shape (`parameters`,)."""
        sampled, rise = sampling.half > 0.0, len(sampling.rise_corners)
        kind = cls(
            len(sampling.corners), sampling.matched, sampled, sampling.derivative > 0.0, orders, rise_corners=rise
        )
        numbers = np.concatenate(
            [[sampling.half, sampling.derivative], sampling.gain, sampling.corners.ravel(),
             sampling.rise_corners.ravel()]
        )  # fmt: skip
        return kind, numbers[: kind.parameters]

    @property
    def parameters(self) -> int:
        """How many parameters the controller has."""
        return 6 + 3 * (self.corners + self.rise_corners) if self.sampled or self.derivative else 0

    @property
    def unknowns(self) -> int:
        """How many numbers of the controller are unknown."""
        return 5 if self.orders else 3

    def made(self, z: Any, third: Any, numbers: Any) -> Filter | Orders | None:
        """The controller's responses, from its numbers and the parameters; None: kp' + ki' s^-alpha."""
        if not self.parameters:
            return None
        if self.orders and not self.sampled:
            return Orders(z[3], z[4], numbers[1])
        last = 6 + 3 * self.corners
        corners, half = ca.reshape(numbers[6:last], 3, self.corners), numbers[0] if self.sampled else None
        order = z[3] if self.orders else 1.0 if self.derivative else third
        found = Filter.of(order, half, numbers[2:6], corners, self.matched)
        if not self.derivative:
            return found
        # without corners its integral is 1/s, as that of a PID
        rise_corners, middle = ca.reshape(numbers[last:], 3, self.rise_corners), numbers[2]
        rise = Filter.of(2.0 - z[4] if self.orders else 1.0, half, [middle] * 4, rise_corners, 0)
        return replace(found, filter_time=numbers[1], rise=rise)


@dataclass(frozen=True)
class Filter:
    """The integral of a loop on samples at the unknown alpha, or an integrator beside a derivative.

    Args:
        half: h; None in continuous time.
        corners: zeros and poles.
        log_gain: ln of the gain.
        filter_time: Tf of D = s^2 F/(Tf s + 1) beside it; None without.
        rise: F of that, an integral of the order 2 - mu.
    """

    half: Any
    corners: tuple[tuple[Any, Any], ...]
    log_gain: Any
    filter_time: Any = None
    rise: Filter | None = None

    @classmethod
    def of(cls, alpha: Any, half: Any, gain: Any, corners: Any, matched: int) -> Filter:
        """From the numbers of `Sampling`: `gain` of shape (4,), `corners` of shape (3, 2 N)."""
        middle, last, here, there = (gain[k] for k in range(4))
        log_gain, found = last - here + there - alpha * middle, []
        for k in range(corners.shape[1]):
            corner = ca.exp(corners[0, k] + corners[1, k] * alpha + corners[2, k] * ca.log(alpha))
            sign = 1.0 if k % 2 == 0 else -1.0
            if matched:
                sizes = ca.exp(2.0 * here) + corner**2, ca.exp(2.0 * last) + corner**2
                log_gain += 0.5 * sign * (ca.log(sizes[0]) - ca.log(sizes[1]))
                corner = ca.tanh(half * corner) / half
            log_gain -= 0.5 * sign * ca.log(ca.exp(2.0 * there) + corner**2)
            found.append(corner)
        return cls(half, tuple(zip(found[::2], found[1::2], strict=True)), log_gain)

    def parts(self, omega: Any) -> tuple[Any, Any]:
        """Real and imaginary part of the integral at s = j omega."""
        found = ca.SX(0), -ca.exp(self.log_gain) / omega
        for zero, pole in self.corners:
            size = pole**2 + omega**2
            found = times(found, ((zero * pole + omega**2) / size, omega * (pole - zero) / size))
        return found

    def at_real(self, s: Any) -> Any:
        """The integral at a real s."""
        value = ca.exp(self.log_gain) / s
        for zero, pole in self.corners:
            value *= (s + zero) / (s + pole)
        return value

    def derivative_parts(self, omega: Any) -> tuple[Any, Any]:
        """Real and imaginary part of D at s = j omega."""
        #  s^2/(Tf s + 1) = -omega^2 (1 - j omega Tf)/(1 + (omega Tf)^2)
        assert self.rise is not None
        size = -(omega**2) / (1.0 + (omega * self.filter_time) ** 2)
        return times(self.rise.parts(omega), (size, -size * omega * self.filter_time))


@dataclass(frozen=True)
class Orders:
    """Unknown orders of integral and derivative, in continuous time.

    Args:
        alpha, mu: the orders.
        filter_time: Tf of D = s^mu/(Tf s + 1).
    """

    alpha: Any
    mu: Any
    filter_time: Any
    half: Any = None

    def parts(self, kp: Any, ki: Any, kd: Any, v: Any) -> tuple[Any, Any]:
        """Real and imaginary part of the controller at j e^v; D is s^(mu - 1)/(Tf + 1/s)."""
        power, angle = ki * ca.exp(-self.alpha * v), self.alpha * (math.pi / 2)
        lag, rest = ca.exp(-v), self.mu - 1.0
        size = kd * ca.exp(rest * v) / (self.filter_time**2 + lag**2)
        cosine, sine = ca.cos(rest * (math.pi / 2)), ca.sin(rest * (math.pi / 2))
        return (
            kp + power * ca.cos(angle) + size * (cosine * self.filter_time - sine * lag),
            -power * ca.sin(angle) + size * (sine * self.filter_time + cosine * lag),
        )


Made = Filter | Orders | None


def controller_parts(kp: Any, ki: Any, third: Any, v: Any, made: Made = None) -> tuple[Any, Any]:
    """Real and imaginary part of the scaled controller at j e^v.

    kp' + ki' e^{-alpha (v + j pi/2)}, kp' + ki' F, kp' + ki' F + kd' D, or that with orders.
    """
    if isinstance(made, Orders):
        return made.parts(kp, ki, third, v)
    if made is None:
        power, angle = ki * ca.exp(-third * v), third * (math.pi / 2)
        return kp + power * ca.cos(angle), -power * ca.sin(angle)
    omega = ca.exp(v)
    real, imag = made.parts(omega)
    real, imag = kp + ki * real, ki * imag
    if made.rise is not None:
        derivative = made.derivative_parts(omega)
        real, imag = real + third * derivative[0], imag + third * derivative[1]
    return real, imag


def controller_at_real(kp: Any, ki: Any, third: Any, log_s: Any, made: Made = None) -> Any:
    """The scaled controller at a real s."""
    if isinstance(made, Orders):
        derivative = ca.exp(made.mu * log_s) / (made.filter_time * ca.exp(log_s) + 1.0)
        return kp + ki * ca.exp(-made.alpha * log_s) + third * derivative
    if made is None:
        return kp + ki * ca.exp(-third * log_s)
    s = ca.exp(log_s)
    value = kp + ki * made.at_real(s)
    return value if made.rise is None else value + third * s**2 * made.rise.at_real(s) / (made.filter_time * s + 1.0)


def controller_at_infinity(kp: Any, third: Any, made: Made = None, is_first: Any = 0.0) -> Any:
    """The limit of the scaled controller as s tends to infinity; with orders `is_first` is 1 where mu is 1, else 0."""
    if isinstance(made, Orders):
        return kp + is_first * third / made.filter_time
    return kp if made is None or made.rise is None else kp + third * ca.exp(made.rise.log_gain) / made.filter_time


def times(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[Any, Any]:
    """The product of two complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]
