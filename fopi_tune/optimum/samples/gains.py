"""Coordinates of controllers on samples:  those of `fopi_tune.optimum.parametrization`, with the filter for s^-alpha.

With F of `filter_of_order`, G = ws^alpha F and y = ln G, over a box with centre c and half-widths h

    C = kp + z G ,   e = t_z (G - G_c) + z_c (G - G_c - G_c y'_c t_alpha) ,
    |G - G_c| <= |G_c| x e^x ,   |G - G_c - G_c y'_c t| <= |G_c| (x^2/2 e^x + r) ,                                  (1)
    r = max |y''| h_alpha^2/2 ,   x = |y'_c| h_alpha + r .

With a fixed nominal crossover, C(wc) = x, and F_c = F(wc) = R + jI,

    ki = Im x/I ,   kp = Re x - Im x R/I ,   C = Re x + Im x h ,   h = (F - R)/I .                                   (2)

`log_s` of the Taylor models is ln w, and u is ln nu.

Source: derived; (1) is Taylor's theorem for y, (2) solves kp + ki F_c = x for the gains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.optimum.parametrization import (
    ControllerBox,
    ControllerEnclosure,
    CrossoverBox,
    CrossoverParametrization,
    GainBox,
    GainParametrization,
    TaylorModel,
)
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder
from fopi_tune.proof.balls.box import Box, Interval, ball_of, centre_of


@dataclass(frozen=True)
class SampledGainParametrization(GainParametrization):
    """kp, z = ki ws^-alpha and alpha.

    Args:
        filter: F.
    """

    filter: FilterOfOrder

    def controllers(self, box: Box) -> ControllerBox:
        return SampledGainBox(self, box)


class BoxOnSamples(ControllerBox):
    """What the filter changes of a box.

    Attributes:
        filter: F.
    """

    filter: FilterOfOrder
    has_closed_forms = False

    def _unit(self, alpha: arb) -> arb:
        """What the integral's gain counts: z = ki/unit."""
        return (alpha * self.reference).exp()

    def integral_response(self, integral: arb, u: Interval) -> acb:
        return integral * self._response(u)

    def _response(self, u: Interval) -> acb:
        """G over the box and an interval of u, from its value at the centres of both and its slopes."""
        (middle,), alpha = centre_of((u,)), arb(self.centre[2])
        at, over = acb(0, arb(middle).exp()), acb(0, ball_of(u).exp())
        value = self.filter.value(at, alpha) * self._unit(alpha)
        turn = (self.filter.slopes(over, self.alpha)[0] + self.reference) * (self.alpha - alpha)
        return value * (turn + self.filter.along(over, self.alpha) * (ball_of(u) - arb(middle))).exp()

    def integral_slope(self, u: Interval) -> acb:
        return self.filter.along(acb(0, ball_of(u).exp()), self.alpha)

    def integral_size_below(self, integral: arb, u: float) -> tuple[arb, arb]:
        return self._size_in_tail(integral, u, high=False)

    def integral_size_above(self, integral: arb, u: float) -> tuple[arb, arb]:
        return self._size_in_tail(integral, u, high=True)

    def _size_in_tail(self, integral: arb, u: float, high: bool) -> tuple[arb, arb]:
        size, (low, most) = (
            abs(integral) * self._unit(self.alpha),
            self.filter.size_in_tail(arb(u).exp(), self.alpha, high),
        )
        return arb((size.lower() * low).lower()), arb((size.upper() * most).upper())


class SampledGainBox(BoxOnSamples, GainBox):
    """A box of kp, z and alpha."""

    def __init__(self, parametrization: SampledGainParametrization, box: Box) -> None:
        super().__init__(parametrization, box)
        self.filter = parametrization.filter

    def taylor_model(self, log_s: acb) -> TaylorModel:
        """Taylor model of (1)."""
        w, alpha, z = log_s.exp(), arb(self.centre[2]), self._integral_c
        _, wide_z, wide_alpha = self.half
        value = self.filter.value(w, alpha) * self._unit(alpha)
        slope = self.filter.slopes(w, alpha)[0] + self.reference
        rest = abs(self.filter.slopes(w, self.alpha)[1]) * wide_alpha**2 / 2
        x = abs(slope) * wide_alpha + rest
        grown = x * x.exp()
        remainder = abs(value) * (wide_z * grown + abs(z) * (x / 2 * grown + rest))
        return TaylorModel(self.centre[0] + z * value, (acb(1), value, z * value * slope), arb(remainder.abs_upper()))

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        over = acb(0, ball_of(u).exp())
        unit = self._response(u)
        integral = self.integral * unit
        slope = self.filter.slopes(over, self.alpha)[0] + self.reference
        return ControllerEnclosure(
            self.kp + integral, (acb(1), unit, integral * slope), integral * self.filter.along(over, self.alpha)
        )


@dataclass(frozen=True)
class SampledCrossoverParametrization(CrossoverParametrization):
    """alpha and psi, by (2).

    Args:
        filter: F.
        nu: tan(wc Ts/2).
    """

    filter: FilterOfOrder
    nu: arb

    def controllers(self, box: Box) -> ControllerBox:
        return SampledCrossoverBox(self, box)


class SampledCrossoverBox(BoxOnSamples, CrossoverBox):
    """A box of alpha and psi."""

    parametrization: SampledCrossoverParametrization

    def __init__(self, parametrization: SampledCrossoverParametrization, box: Box) -> None:
        self.filter = parametrization.filter
        super().__init__(parametrization, box)

    def _at_crossover(self, alpha: arb) -> tuple[acb, acb, acb]:
        """F_c with its first and second derivatives in alpha."""
        return self._filter_at(acb(0, self.parametrization.nu), alpha)

    def _filter_at(self, w: acb, alpha: arb) -> tuple[acb, acb, acb]:
        value, (first, second) = self.filter.value(w, alpha), self.filter.slopes(w, alpha)
        return value, value * first, value * (first * first + second)

    def _gains(self, x: acb, alpha: arb) -> tuple[arb, arb]:
        at = self.filter.value(acb(0, self.parametrization.nu), alpha)
        return x.real - x.imag * at.real / at.imag, x.imag / at.imag

    def _kp_term(self, alpha: arb) -> tuple[arb, arb, arb]:
        """-R/I with its derivatives."""
        value, first, second = self._at_crossover(alpha)
        q = value.real / value.imag
        q1 = (first.real - q * first.imag) / value.imag
        return -q, -q1, -(second.real - 2 * q1 * first.imag - q * second.imag) / value.imag

    def _ki_term(self, alpha: arb) -> tuple[arb, arb, arb]:
        """-1/I with its derivatives."""
        value, first, second = self._at_crossover(alpha)
        i, i1, i2 = value.imag, first.imag, second.imag
        return -1 / i, i1 / i**2, i2 / i**2 - 2 * i1**2 / i**3

    def _h_on_samples(self, w: acb, alpha: arb) -> tuple[acb, acb, acb]:
        """h with its derivatives."""
        at, at1, at2 = self._at_crossover(alpha)
        value, first, second = self._filter_at(w, alpha)
        h = (value - at.real) / at.imag
        h1 = (first - at1.real - h * at1.imag) / at.imag
        return h, h1, (second - at2.real - 2 * h1 * at1.imag - h * at2.imag) / at.imag

    def taylor_model(self, log_s: acb) -> TaylorModel:
        w = log_s.exp()
        h, first, _ = self._h_on_samples(w, self._alpha_c)
        return self._taylor_model(self._x, h, first, *self._h_on_samples(w, self.alpha)[1:])

    @cached_property
    def _over_crossover(self) -> tuple[acb, acb, acb]:
        return self._at_crossover(self.alpha)

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        w, x = acb(0, ball_of(u).exp()), self._point(self._psi)
        at, at1, _ = self._over_crossover
        value = self._response(u)
        h = (value - at.real) / at.imag
        first = (value * self.filter.slopes(w, self.alpha)[0] - at1.real - h * at1.imag) / at.imag
        along = value * self.filter.along(w, self.alpha) / at.imag
        return ControllerEnclosure(x.real + x.imag * h, (x.imag * first, -x.imag + x.real * h), x.imag * along)
