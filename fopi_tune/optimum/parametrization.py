"""Parametrizations of the controller:  the coordinates of the search, and C(s) over a box of them in ball arithmetic.

Over a box with centre c and half-widths h the controller at one s has a first-order Taylor model,

    C(s)  =  C_c + sum_i C_i t_i + e ,     |t_i| <= h_i ,   |e| <= r ,                                          (1)

where C_i are the derivatives at the centre, and the remainder e is of second order in the box's size.
`GainParametrization` has kp, z and alpha, where z = ki ws^-alpha is the integral's gain at a reference frequency ws:
near it the order changes little but the phase.  With rho = (s/ws)^-alpha, sigma = ln s/ws

    C = kp + z rho ,   e = t_z (rho - rho_c) + z_c (rho - rho_c + sigma rho_c t_alpha) .                           (2)

Source: derived; (1) and (2) are C written out around the centre.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.core.controller import Pid
from fopi_tune.proof.balls.box import Box, Interval, ball_of, centre_of
from fopi_tune.spec.model import ControllerSpec

_ZERO = arb(0)


@dataclass(frozen=True)
class TaylorModel:
    """First-order Taylor model (1) of a function over a box of coordinates; of a gain it is real.

    Args:
        middle: at the centre.
        slopes: derivatives there.
        remainder: r, an upper bound of |e|.
    """

    middle: acb
    slopes: tuple[acb, ...]
    remainder: arb


@dataclass(frozen=True)
class ControllerEnclosure:
    """The controller over a box of coordinates and an interval of u = ln omega, s = j omega.

    Args:
        value: C.
        slopes: its derivatives along the coordinates.
        along: its derivative in u.
    """

    value: acb
    slopes: tuple[acb, ...]
    along: acb


class ControllerBox(ABC):
    """The controllers of one box of coordinates.

    Attributes:
        box: their ranges.
        kp, integral, alpha: balls that hold every gain of the box; the integral's is that of (s/e^reference)^-alpha.
        reference: the logarithm of a frequency in rad/s.
        centre: the gains kp, ki and alpha at the centre.
        derivative, filter_time: a ball that holds every kd, and Tf; 0 without a derivative.
        pid: the controller at the centre, where there is a derivative.
    """

    box: Box
    kp: arb
    integral: arb
    alpha: arb
    reference: arb
    centre: tuple[arb, arb, arb]
    derivative: arb = _ZERO
    filter_time: arb = _ZERO

    @property
    def pid(self) -> Pid | None:
        return None

    @cached_property
    def half(self) -> tuple[arb, ...]:
        """Half-widths about the centre, rounded up."""
        return tuple(
            arb((arb(high) - c).union(c - arb(low)).abs_upper())
            for (low, high), c in zip(self.box, map(arb, centre_of(self.box)), strict=True)
        )

    @property
    def ends(self) -> tuple[tuple[arb, arb], tuple[arb, arb]]:
        """The ends of kp and of the integral's gain; a ball with an end at 0 holds numbers beyond it."""
        (kp_low, kp_high), (low, high) = ((arb(x.lower()), arb(x.upper())) for x in (self.kp, self.integral))
        return (kp_low, kp_high), (low, high)

    @property
    def has_integral(self) -> bool:
        """Whether no controller in question has ki = 0."""
        return not self.integral.contains(0)

    @property
    def mixes_integrals(self) -> bool:
        """Whether the box holds ki of different signs, of which the number of poles differs."""
        return bool(self.integral.contains(0) and not self.integral.is_zero())

    def gain_range(self, name: str) -> tuple[arb, arb]:
        """The least and the largest of the gain `kp` or `ki`."""
        gain = self.gain_taylor_model(name)
        reach = sum((abs(s.real) * h for s, h in zip(gain.slopes, self.half, strict=True)), gain.remainder)
        return gain.middle.real - reach, gain.middle.real + reach

    # -- the integral's part of C, for gains `integral` of the box ----------------------------------------------------

    def integral_response(self, integral: arb, u: Interval) -> acb:
        """Over an interval of u that is not a tail."""
        return integral * (-self.alpha * acb(ball_of(u) - self.reference, arb.pi() / 2)).exp()

    @property
    def integral_unit(self) -> arb:
        """What the integral's gain is for ki = 1."""
        return (-self.alpha * self.reference).exp()

    def integral_lag(self, u: Interval) -> arb:
        """The angle a by which it lags, over an interval that may be a tail; at most 90 deg for orders up to 1."""
        return self.alpha * arb.pi() / 2

    def steepest_rise(self, u: Interval) -> arb:
        """The most that d ln|C|/du is for orders above 1 where kp and ki are not negative."""
        sine = self.integral_lag(u).sin()
        return self.alpha * (1 - sine) / (2 * sine)

    def integral_slope(self, u: Interval) -> acb:
        """The derivative of its logarithm in u, over an interval that is not a tail."""
        return acb(-self.alpha)

    def least_integral_size(self, integral: arb, u: float) -> arb:
        """A lower bound of its size at all frequencies up to one."""
        return arb((abs(integral).lower() * (-self.alpha * (arb(u) - self.reference)).exp()).lower())

    def largest_integral_size(self, integral: arb, u: float) -> arb:
        """An upper bound of its size at all frequencies from one on."""
        return arb((abs(integral).upper() * (-self.alpha * (arb(u) - self.reference)).exp()).upper())

    @abstractmethod
    def taylor_model(self, log_s: acb) -> TaylorModel:
        """Taylor model (1) of C(s), at one s given by ln s."""

    @abstractmethod
    def gain_taylor_model(self, name: str) -> TaylorModel:
        """Taylor model (1) of the gain `kp` or `ki`."""

    @abstractmethod
    def enclosure(self, u: Interval) -> ControllerEnclosure:
        """Enclosure of C(j omega) over an interval of u."""


class Parametrization(ABC):
    """Coordinates of the gains.

    Attributes:
        names: of the axes.
        implied: the gains whose ranges no box exceeds.
    """

    names: tuple[str, ...]
    implied: tuple[str, ...] = ()

    @abstractmethod
    def controllers(self, box: Box) -> ControllerBox:
        """The controllers of a box."""

    @abstractmethod
    def widths(self, box: Box, root: Box) -> list[float]:
        """The sides of a box, as parts of what a controller of its size varies by."""


@dataclass(frozen=True)
class GainParametrization(Parametrization):
    """The gains at a reference frequency, by (2).

    Args:
        omega_rad_s: ws.
    """

    omega_rad_s: float
    names = ("kp", "integral", "alpha")
    implied = ("kp",)

    def controllers(self, box: Box) -> ControllerBox:
        return GainBox(self, box)

    def widths(self, box: Box, root: Box) -> list[float]:
        (kp_low, kp_high), (low, high), alpha = box
        size = math.hypot(max(abs(kp_low), abs(kp_high)), max(abs(low), abs(high)))
        if size == 0.0:
            return [0.0, 0.0, 0.0]
        return [(kp_high - kp_low) / size, (high - low) / size, alpha[1] - alpha[0]]

    @cached_property
    def log_omega(self) -> arb:
        """ln ws."""
        return arb(self.omega_rad_s).log()

    def roots(self, controller: ControllerSpec) -> tuple[Box, ...]:
        """A box of all gains in the ranges, rounded outwards, and one of those without an integral.

        The integral's side holds gains outside their range too.  What is shown of a box in which z is not 0 throughout
        need only be true of its ki other than 0: ki = 0 has its own box, with any order.
        """
        kp, ki, alpha = controller.kp, controller.ki, controller.alpha
        powers = [(-arb(a) * self.log_omega).exp() for a in (alpha.min, alpha.max)]
        low = min(_rounded(arb(ki.min) * power, -math.inf) for power in powers)
        high = max(_rounded(arb(ki.max) * power, math.inf) for power in powers)
        found = [((kp.min, kp.max), (low, high), (alpha.min, alpha.max))] if low < high else []
        if ki.min <= 0.0 <= ki.max:
            found.append(((kp.min, kp.max), (0.0, 0.0), (alpha.min, alpha.min)))
        return tuple(found)


def _rounded(value: arb, towards: float) -> float:
    """A ball's end, rounded outwards; 0 stays 0."""
    if value.is_zero():
        return 0.0
    return math.nextafter(float(value.lower() if towards < 0.0 else value.upper()), towards)


class BoxOfGains(ControllerBox):
    """A box whose first sides are kp and the integral's gain."""

    @property
    def ends(self) -> tuple[tuple[arb, arb], tuple[arb, arb]]:
        (kp_low, kp_high), (low, high), _ = self.box
        return (arb(kp_low), arb(kp_high)), (arb(low), arb(high))

    @property
    def has_integral(self) -> bool:
        return self.box[1] != (0.0, 0.0)

    @property
    def mixes_integrals(self) -> bool:
        low, high = self.box[1]
        return low < 0.0 < high


class GainBox(BoxOfGains):
    """A box of gains at the reference frequency."""

    def __init__(self, parametrization: GainParametrization, box: Box) -> None:
        self.box, self.reference = box, parametrization.log_omega
        self.kp, self.integral, self.alpha = (ball_of(side) for side in box)
        kp, integral, alpha = map(arb, centre_of(box))
        self._integral_c = integral
        self.centre = kp, integral * (alpha * self.reference).exp(), alpha

    def _integral_model(self, exponent: acb) -> TaylorModel:
        """Of z e^{-alpha exponent}."""
        z, alpha = self._integral_c, self.centre[2]
        _, wide_z, wide_alpha = self.half
        rho = (-alpha * exponent).exp()
        x = abs(exponent) * wide_alpha
        # |e^x - 1| <= |x| e^|x|,  |e^x - 1 - x| <= |x|^2/2 e^|x|
        remainder = abs(rho) * x * x.exp() * (wide_z + abs(z) * x / 2)
        return TaylorModel(z * rho, (acb(0), rho, -exponent * (z * rho)), remainder.upper())

    def taylor_model(self, log_s: acb) -> TaylorModel:
        found = self._integral_model(log_s - self.reference)
        return TaylorModel(self.centre[0] + found.middle, (acb(1), *found.slopes[1:]), found.remainder)

    def gain_taylor_model(self, name: str) -> TaylorModel:
        if name == "kp":
            return TaylorModel(acb(self.centre[0]), (acb(1), acb(0), acb(0)), _ZERO)
        return self._integral_model(acb(-self.reference))

    def gain_range(self, name: str) -> tuple[arb, arb]:
        gain = self.kp if name == "kp" else self.integral * (self.alpha * self.reference).exp()
        return gain.lower(), gain.upper()

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        exponent = acb(ball_of(u) - self.reference, arb.pi() / 2)
        rho = (-self.alpha * exponent).exp()
        integral = self.integral * rho
        return ControllerEnclosure(self.kp + integral, (acb(1), rho, -exponent * integral), -self.alpha * integral)
