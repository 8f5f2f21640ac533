"""Coordinates of the controllers that make one frequency a gain crossover of the nominal plant.

Every controller with |C(j wc) P0(j wc)| = 1 has an alpha and psi = pi + arg L0(j wc) (modulo 2 pi).  With
x = e^{j(psi - pi)}/P0(j wc) and a = alpha pi/2

    ki = -Im x wc^alpha/sin a ,   kp = Re x + Im x cot a ,   C = Re x + Im x h ,
    h = (cos a - e^{-alpha tau})/sin a ,   tau = ln(s/wc) .                                                        (1)

Source: derived; (1) solves L0 = e^{j(psi - pi)} for the gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.optimum.parametrization import ControllerBox, ControllerEnclosure, Parametrization, TaylorModel
from fopi_tune.proof.balls.box import Box, Interval, ball_of, centre_of
from fopi_tune.spec.model import GainRange

_ZERO = arb(0)


@dataclass(frozen=True)
class CrossoverParametrization(Parametrization):
    """Every controller that makes one frequency a gain crossover of the nominal plant, by (1).

    Args:
        omega_rad_s: wc.
        plant: P0(j wc), not 0.
    """

    omega_rad_s: float
    plant: acb
    names = ("alpha", "psi")

    def controllers(self, box: Box) -> ControllerBox:
        return CrossoverBox(self, box)

    def widths(self, box: Box, root: Box) -> list[float]:
        sides = zip(box, root, strict=True)
        return [(b - a) / (last - first) if last > first else 0.0 for (a, b), (first, last) in sides]

    @cached_property
    def log_omega(self) -> arb:
        """ln wc."""
        return arb(self.omega_rad_s).log()

    @staticmethod
    def circle(alpha: GainRange, first: float) -> Box:
        """Every order and every psi, from `first` (rounded down) once round."""
        start = math.nextafter(first, -math.inf)
        return (alpha.min, alpha.max), (start, start + 2.0 * math.pi + 1e-12)


class CrossoverBox(ControllerBox):
    """A box of alpha and psi."""

    def __init__(self, parametrization: CrossoverParametrization, box: Box) -> None:
        self.box, self.parametrization = box, parametrization
        alpha, psi = map(arb, centre_of(box))
        self._alpha_c, self._psi = alpha, ball_of(box[1])
        self.alpha = ball_of(box[0])
        self._x = self._point(psi)
        over_x = self._point(self._psi)
        self.kp, self.integral = self._gains(over_x, self.alpha)
        self.reference = _ZERO
        self.centre = (*self._gains(self._x, alpha), alpha)

    def _point(self, psi: arb) -> acb:
        """x by (1)."""
        return -acb(psi.cos(), psi.sin()) / self.parametrization.plant

    def _gains(self, x: acb, alpha: arb) -> tuple[arb, arb]:
        a = alpha * arb.pi() / 2
        power = (alpha * self.parametrization.log_omega).exp()
        return x.real + x.imag * a.cot(), -x.imag * power / a.sin()

    def _h(self, alpha: arb, tau: acb) -> tuple[acb, acb, acb]:
        """h with its first and second derivatives in alpha."""
        k = arb.pi() / 2
        sine, cosine, e = (k * alpha).sin(), (k * alpha).cos(), (-alpha * tau).exp()
        h = (cosine - e) / sine
        first = (-k / sine + tau * e + k * e * cosine / sine) / sine
        second = 2 * k * k * cosine / sine**2 - tau * tau * e - 2 * k * tau * e * cosine / sine
        return h, first, (second - k * k * e * (1 + cosine * cosine) / sine**2) / sine

    def taylor_model(self, log_s: acb) -> TaylorModel:
        tau, x = log_s - self.parametrization.log_omega, self._x
        h, first, _ = self._h(self._alpha_c, tau)
        return self._taylor_model(x, h, first, *self._h(self.alpha, tau)[1:])

    def _taylor_model(self, x: acb, h: acb, first: acb, over_first: acb, over_second: acb) -> TaylorModel:
        """Of Re x + Im x h(alpha), x on a circle."""
        t_alpha, t_psi = self.half
        # |x(psi) - x_c| <= |x| t,  |x(psi) - x_c - j x_c t| <= |x| t^2/2
        size = abs(x)
        remainder = size * t_psi * (t_psi / 2 * (1 + abs(h)) + abs(over_first) * t_alpha)
        remainder = remainder + abs(x.imag) * abs(over_second) * t_alpha**2 / 2
        return TaylorModel(x.real + x.imag * h, (x.imag * first, -x.imag + x.real * h), remainder.upper())

    def gain_taylor_model(self, name: str) -> TaylorModel:
        x = self._x
        if name == "kp":
            f, first, _ = self._kp_term(self._alpha_c)
            _, over_first, over_second = self._kp_term(self.alpha)
            return self._taylor_model(x, acb(f), acb(first), acb(over_first), acb(over_second))
        f, first, _ = self._ki_term(self._alpha_c)
        _, over_first, over_second = self._ki_term(self.alpha)
        # ki = -Im x f:  the same without Re x; the remainder of the sum bounds that of this term
        found = self._taylor_model(x, acb(f), acb(first), acb(over_first), acb(over_second))
        return TaylorModel(acb(-x.imag * f), (acb(-x.imag * first), acb(-x.real * f)), found.remainder)

    def _kp_term(self, alpha: arb) -> tuple[arb, arb, arb]:
        """cot a with its first and second derivatives in alpha."""
        k = arb.pi() / 2
        cot, sine = (k * alpha).cot(), (k * alpha).sin()
        return cot, -k / sine**2, 2 * k * k * cot / sine**2

    def _ki_term(self, alpha: arb) -> tuple[arb, arb, arb]:
        """f = wc^alpha/sin a with its derivatives:  f' = f q,  f'' = f (q^2 + q'),  q = ln wc - k cot a."""
        k = arb.pi() / 2
        f = (alpha * self.parametrization.log_omega).exp() / (k * alpha).sin()
        q = self.parametrization.log_omega - k * (k * alpha).cot()
        return f, f * q, f * (q * q + (k / (k * alpha).sin()) ** 2)

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        tau = acb(ball_of(u) - self.parametrization.log_omega, arb.pi() / 2)
        x = self._point(self._psi)
        h, first, _ = self._h(self.alpha, tau)
        e = (-self.alpha * tau).exp() / (arb.pi() / 2 * self.alpha).sin()
        return ControllerEnclosure(x.real + x.imag * h, (x.imag * first, -x.imag + x.real * h), x.imag * self.alpha * e)
