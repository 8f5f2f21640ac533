"""Coordinates of controllers with a derivative:  the gains themselves, of which C is linear.

    C(s) = kp + ki rho + kd d ,     rho = 1/s ,     d = 1/(Tf + rho) ,     dC/du = -ki rho + kd rho d^2             (1)

so that the Taylor model of `parametrization` has no remainder.

Source: derived.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.core.controller import Pid
from fopi_tune.optimum.parametrization import (
    BoxOfGains,
    ControllerBox,
    ControllerEnclosure,
    Parametrization,
    TaylorModel,
)
from fopi_tune.proof.balls.box import Box, Interval, ball_of, centre_of
from fopi_tune.spec.model import ControllerSpec

_ZERO = arb(0)


@dataclass(frozen=True)
class DerivativeParametrization(Parametrization):
    """kp, ki and kd behind a filter.

    Args:
        omega_rad_s: a frequency at which the three terms are compared: boxes are cut where they vary most there.
        filter_time_s: Tf.
    """

    omega_rad_s: float
    filter_time_s: float
    names = ("kp", "ki", "kd")
    implied = ("kp", "ki", "kd")

    def controllers(self, box: Box) -> ControllerBox:
        return DerivativeBox(self, box)

    def widths(self, box: Box, root: Box) -> list[float]:
        units = self.units
        size = math.hypot(*(unit * max(abs(low), abs(high)) for unit, (low, high) in zip(units, box, strict=True)))
        if size == 0.0:
            return [0.0, 0.0, 0.0]
        return [unit * (high - low) / size for unit, (low, high) in zip(units, box, strict=True)]

    @property
    def units(self) -> tuple[float, float, float]:
        """|dC/d kp|, |dC/d ki| and |dC/d kd| at the frequency."""
        return 1.0, 1.0 / self.omega_rad_s, 1.0 / math.hypot(self.filter_time_s, 1.0 / self.omega_rad_s)

    def roots(self, controller: ControllerSpec) -> tuple[Box, ...]:
        """The box of all gains in the ranges, and that of those without an integral, which has another pole."""
        kp, ki, kd = ((side.min, side.max) for side in (controller.kp, controller.ki, controller.kd))
        found = [(kp, ki, kd)] if ki[0] < ki[1] or ki[0] != 0.0 else []
        if ki[0] <= 0.0 <= ki[1]:
            found.append((kp, (0.0, 0.0), kd))
        return tuple(found)

    def basis(self, s: acb) -> tuple[acb, acb]:
        """rho and d of (1)."""
        rho = 1 / s
        return rho, 1 / (rho + arb(self.filter_time_s))


class DerivativeBox(BoxOfGains):
    """A box of kp, ki and kd."""

    def __init__(self, parametrization: DerivativeParametrization, box: Box) -> None:
        self.box, self.parametrization = box, parametrization
        self.kp, self.integral, self.derivative = (ball_of(side) for side in box)
        self.alpha, self.reference = arb(1), _ZERO
        self.filter_time = arb(parametrization.filter_time_s)
        self.gains = centre_of(box)
        kp, ki, _ = map(arb, self.gains)
        self.centre = kp, ki, self.alpha

    @property
    def pid(self) -> Pid:
        """The controller at the centre."""
        kp, ki, kd = self.gains
        return Pid(kp, ki, kd, self.parametrization.filter_time_s)

    def taylor_model(self, log_s: acb) -> TaylorModel:
        rho, d = self.parametrization.basis(log_s.exp())
        kp, ki, kd = map(arb, self.gains)
        return TaylorModel(kp + ki * rho + kd * d, (acb(1), rho, d), _ZERO)

    def gain_taylor_model(self, name: str) -> TaylorModel:
        place = self.parametrization.names.index(name)
        slopes = tuple(acb(k == place) for k in range(3))
        return TaylorModel(acb(self.gains[place]), slopes, _ZERO)

    def gain_range(self, name: str) -> tuple[arb, arb]:
        low, high = self.box[self.parametrization.names.index(name)]
        return arb(low), arb(high)

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        rho, d = self.parametrization.basis(acb(0, ball_of(u).exp()))
        value = self.kp + self.integral * rho + self.derivative * d
        return ControllerEnclosure(value, (acb(1), rho, d), (self.derivative * d * d - self.integral) * rho)
