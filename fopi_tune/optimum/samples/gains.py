"""Coordinates of controllers on samples:  those of `fopi_tune.optimum.parametrization`, with the filter for s^-alpha.

With F of `filter_of_order`, G = ws^alpha F and y = ln G, over a box with centre c and half-widths h

    C = kp + z G ,   e = t_z (G - G_c) + z_c (G - G_c - G_c y'_c t_alpha) ,
    |G - G_c| <= |G_c| x e^x ,   |G - G_c - G_c y'_c t| <= |G_c| (x^2/2 e^x + r) ,                                  (1)
    r = max |y''| h_alpha^2/2 ,   x = |y'_c| h_alpha + r .

With a fixed nominal crossover, C(wc) = x, and F_c = F(wc) = R + jI = |F_c| e^(-j a),

    ki |F_c| = -Im x/sin a ,   kp = Re x + Im x cot a ,   C = Re x + Im x h ,   h = (F - R)/I .                     (2)

`log_s` of the Taylor models is ln w, and u is ln nu.

Source: derived; (1) is Taylor's theorem for y, (2) solves kp + ki F_c = x for the gains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.optimum.crossover_gains import CrossoverBox, CrossoverParametrization
from fopi_tune.optimum.parametrization import (
    ControllerBox,
    ControllerEnclosure,
    GainBox,
    GainParametrization,
    Parametrization,
    TaylorModel,
)
from fopi_tune.optimum.samples.filter_box import FilterBox
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder
from fopi_tune.proof.balls.box import Box, Interval, ball_of, centre_of

_ZERO, _ONE = arb(0), arb(1)
#: filters that are kept
_MOST_KNOWN = 512


@dataclass(frozen=True)
class _WithFilter(Parametrization):
    """Filters over intervals of orders, which many boxes share.

    Args:
        filter: F.
        nu: tan(omega Ts/2) at the anchor, the frequency at which |F| is counted as 1.
    """

    filter: FilterOfOrder
    nu: arb

    @property
    def log_unit(self) -> arb:
        """ln of the frequency, rad/s, of whose power of the order the integral's gain is a multiple."""
        return _ZERO

    @cached_property
    def _known(self) -> dict[Interval, FilterBox]:
        return {}

    def filter_box(self, alpha: Interval) -> FilterBox:
        """F over an interval of orders."""
        if alpha not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            middle = arb(centre_of((alpha,))[0])
            self._known[alpha] = FilterBox(self.filter, ball_of(alpha), middle, self.nu, self.log_unit)
        return self._known[alpha]


@dataclass(frozen=True)
class SampledGainParametrization(_WithFilter, GainParametrization):
    """kp, z = ki ws^-alpha and alpha; the anchor is any frequency."""

    @property
    def log_unit(self) -> arb:
        return self.log_omega

    def controllers(self, box: Box) -> ControllerBox:
        return SampledGainBox(self, box)


class BoxOnSamples(ControllerBox):
    """What the filter changes of a box.

    Attributes:
        filters: F over the orders of the box.
    """

    filters: FilterBox

    @property
    def scale(self) -> arb:
        """What the integral's gain is multiplied with where F is counted from its size at the anchor."""
        return _ONE

    def least_integral_size(self, integral: arb, u: float) -> arb:
        return arb(((abs(integral) * self.scale).lower() * self.filters.sizes(u)[0]).lower())

    def largest_integral_size(self, integral: arb, u: float) -> arb:
        return arb(((abs(integral) * self.scale).upper() * self.filters.sizes(u)[1]).upper())

    def integral_lag(self, u: Interval) -> arb:
        return self.filters.lag(u)

    def integral_slope(self, u: Interval) -> acb:
        return self.filters.slope(u)

    def steepest_rise(self, u: Interval) -> arb:
        # Re(q d ln F/du), q = 1/(1 + t e^(j a)), t >= 0, is at most m/(2 (1 + cos a)), m = Re(e^(-j a) d ln F/du)
        lag, slope = self.filters.lag(u), self.filters.slope(u)
        m = slope.real * lag.cos() + slope.imag * lag.sin()
        if m <= 0:
            return arb(0)
        found = m / (2 * (1 + lag.cos()))
        return arb(found.upper()) if found.is_finite() and 1 + lag.cos() > 0 else arb.pos_inf()

    def integral_response(self, integral: arb, u: Interval) -> acb:
        return integral * self.scale * self.filters.response(u)


class SampledGainBox(BoxOnSamples, GainBox):
    """A box of kp, z and alpha."""

    def __init__(self, parametrization: SampledGainParametrization, box: Box) -> None:
        super().__init__(parametrization, box)
        self.filters = parametrization.filter_box(box[2])

    @property
    def scale(self) -> arb:
        """ws^alpha |F| at the anchor."""
        return self.filters.anchor_size

    def taylor_model(self, log_s: acb) -> TaylorModel:
        """Taylor model of (1)."""
        w, z, alpha = log_s.exp(), self._integral_c, self.centre[2]
        _, wide_z, wide_alpha = self.half
        value = self.filters.central.value(w) * (alpha * self.reference).exp()
        slope = self.filters.central.log_derivatives(w)[0] + self.reference
        rest = abs(self.filters.log_derivatives(w)[1]) * wide_alpha**2 / 2
        x = abs(slope) * wide_alpha + rest
        grown = x * x.exp()
        remainder = abs(value) * (wide_z * grown + abs(z) * (x / 2 * grown + rest))
        return TaylorModel(self.centre[0] + z * value, (acb(1), value, z * value * slope), arb(remainder.abs_upper()))

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        unit = self.scale * self.filters.response(u)
        turn = self.filters.log_derivatives(acb(0, ball_of(u).exp()))[0] + self.reference
        integral = self.integral * unit
        slopes = acb(1), unit, integral * turn
        return ControllerEnclosure(self.kp + integral, slopes, integral * self.filters.slope(u))


@dataclass(frozen=True)
class SampledCrossoverParametrization(_WithFilter, CrossoverParametrization):
    """alpha and psi, by (2); the anchor is wc."""

    def controllers(self, box: Box) -> ControllerBox:
        return SampledCrossoverBox(self, box)


class SampledCrossoverBox(BoxOnSamples, CrossoverBox):
    """A box of alpha and psi; the integral's gain is ki |F_c|."""

    def __init__(self, parametrization: SampledCrossoverParametrization, box: Box) -> None:
        self.filters, self._w = parametrization.filter_box(box[0]), acb(0, parametrization.nu)
        super().__init__(parametrization, box)

    @property
    def integral_unit(self) -> arb:
        return self.filters.anchor_size

    def _gains(self, x: acb, alpha: arb) -> tuple[arb, arb]:
        # over all orders ki |F_c|, in which the order hardly shows; at the centre ki itself
        if alpha is not self._alpha_c:
            lag = self.filters.lag_at_anchor
            return x.real + x.imag * lag.cot(), -x.imag / lag.sin()
        at = self._central[0]
        return x.real - x.imag * at.real / at.imag, x.imag / at.imag

    @cached_property
    def _central(self) -> tuple[acb, acb, acb]:
        """F_c with its derivatives in alpha at the central order."""
        return self._central_at(self._w)

    def _central_at(self, w: acb) -> tuple[acb, acb, acb]:
        value, (first, second, _) = self.filters.central.value(w), self.filters.central.log_derivatives(w)
        return value, value * first, value * (first * first + second)

    @cached_property
    def _over(self) -> tuple[acb, acb, acb]:
        """F_c/|F_c| over the orders of the box, with derivatives."""
        value, (first, second) = self.filters.anchor_value, self.filters.derivatives_from_anchor(self._w)
        return value, value * first, value * (first * first + second)

    @cached_property
    def _over_in_size(self) -> tuple[acb, acb, acb]:
        """F_c over the orders of the box, with its derivatives."""
        value, (first, second) = self.filters.anchor_value * self.integral_unit, self.filters.anchor_derivatives
        return value, value * first, value * (first * first + second)

    def _at_crossover(self, alpha: arb) -> tuple[acb, acb, acb]:
        return self._central if alpha is self._alpha_c else self._over_in_size

    def _kp_term(self, alpha: arb) -> tuple[arb, arb, arb]:
        """-R/I with its derivatives."""
        value, first, second = self._at_crossover(alpha)
        q = value.real / value.imag
        q1 = (first.real - q * first.imag) / value.imag
        return -q, -q1, -(second.real - 2 * q1 * first.imag - q * second.imag) / value.imag

    def _ki_term(self, alpha: arb) -> tuple[arb, arb, arb]:
        """-1/I with its derivatives."""
        value, first, second = (part.imag for part in self._at_crossover(alpha))
        p = 1 / value
        p1 = -first * p * p
        return -p, -p1, second * p * p + 2 * first * p * p1

    def taylor_model(self, log_s: acb) -> TaylorModel:
        w = log_s.exp()
        h, first, _ = _from_crossover(self._central_at(w), self._central)
        rates, over = self.filters.derivatives_from_anchor(w), self.filters.over_orders(w)
        ahead = over, over * rates[0], over * (rates[0] * rates[0] + rates[1])
        return self._taylor_model(self._x, h, first, *_from_crossover(ahead, self._over)[1:])

    def enclosure(self, u: Interval) -> ControllerEnclosure:
        x, (at, at1, _), value = self._point(self._psi), self._over, self.filters.response(u)
        turn, along = self.filters.derivatives_from_anchor(acb(0, ball_of(u).exp()))[0], self.filters.slope(u)
        h = (value - at.real) / at.imag
        first = (value * turn - at1.real - h * at1.imag) / at.imag
        slopes = x.imag * first, -x.imag + x.real * h
        return ControllerEnclosure(x.real + x.imag * h, slopes, x.imag * value * along / at.imag)


def _from_crossover(at: tuple[acb, acb, acb], crossover: tuple[acb, acb, acb]) -> tuple[acb, acb, acb]:
    """h of (2) with its derivatives, from those of F and of F_c."""
    (value, first, second), (c, c1, c2) = at, crossover
    h = (value - c.real) / c.imag
    h1 = (first - c1.real - h * c1.imag) / c.imag
    return h, h1, (second - c2.real - 2 * h1 * c1.imag - h * c2.imag) / c.imag
