"""The scaled controllers in the symbols of the solver."""

from __future__ import annotations

import math
from dataclasses import dataclass
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
    """

    corners: int = 0
    matched: int = 0
    sampled: bool = False
    derivative: bool = False
    orders: bool = False
    peaks: bool = False
    slopes: bool = False

    @classmethod
    def of(cls, sampling: Sampling, orders: bool = False) -> tuple[Kind, Array]:
        """The kind, and the numbers that its program has for parameters, shape (`parameters`,)."""
        kind = cls(len(sampling.corners), sampling.matched, sampling.half > 0.0, sampling.derivative > 0.0, orders)
        numbers = np.concatenate([[sampling.half, sampling.derivative], sampling.gain, sampling.corners.ravel()])
        return kind, numbers[: kind.parameters]

    @property
    def parameters(self) -> int:
        """How many parameters the controller has."""
        return 6 + 3 * self.corners if self.sampled or self.derivative else 0

    @property
    def unknowns(self) -> int:
        """How many numbers of the controller are unknown."""
        return 5 if self.orders else 3

    def made(self, z: Any, third: Any, numbers: Any) -> Filter | Orders | None:
        """The controller's responses, from its numbers and the parameters; None: kp' + ki' s^-alpha."""
        if not self.parameters:
            return None
        if self.orders:
            return Orders(z[3], z[4], numbers[1])
        corners, half = ca.reshape(numbers[6:], 3, self.corners), numbers[0] if self.sampled else None
        order, filter_time = (1.0, numbers[1]) if self.derivative else (third, None)
        return Filter.of(order, half, numbers[2:6], corners, self.matched, filter_time)


@dataclass(frozen=True)
class Filter:
    """The integral of a loop on samples at the unknown alpha, or an integrator beside a derivative.

    Args:
        half: h; None in continuous time.
        corners: zeros and poles.
        log_gain: ln of the gain.
        filter_time: Tf of D = s/(Tf s + 1) beside it; None without.
    """

    half: Any
    corners: tuple[tuple[Any, Any], ...]
    log_gain: Any
    filter_time: Any = None

    @classmethod
    def of(cls, alpha: Any, half: Any, gain: Any, corners: Any, matched: int, filter_time: Any = None) -> Filter:
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
        return cls(half, tuple(zip(found[::2], found[1::2], strict=True)), log_gain, filter_time)

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
    if made.filter_time is not None:
        part = third * omega / (1.0 + (omega * made.filter_time) ** 2)
        real, imag = real + part * omega * made.filter_time, imag + part
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
    return value if made.filter_time is None else value + third * s / (made.filter_time * s + 1.0)


def controller_at_infinity(kp: Any, third: Any, made: Made = None, is_first: Any = 0.0) -> Any:
    """The limit of the scaled controller as s tends to infinity; with orders `is_first` is 1 where mu is 1, else 0."""
    if isinstance(made, Orders):
        return kp + is_first * third / made.filter_time
    return kp if made is None or made.filter_time is None else kp + third / made.filter_time


def times(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[Any, Any]:
    """The product of two complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]
