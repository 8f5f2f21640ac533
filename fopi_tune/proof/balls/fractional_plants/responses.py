"""L, S, T, C S, P S of a fractional plant over one box of frequencies and plants, in ball arithmetic.

With s = j omega the sides of P are X = sum c_i s^e_i, s^e = omega^e e^{j pi e/2} and omega^e = e^{e u}.  The factors
of the loop are those of `fopi_tune.proof.balls.responses` with k the highest order of D, and

    s X'(s) = sum e_i c_i s^e_i ,        s (s X')' = sum e_i^2 c_i s^e_i .                                           (1)

Of two terms the common power cancels: with r = 1/(1 + (c_0/c_1) s^(e_0 - e_1)),

    s X'/X = e_0 + (e_1 - e_0) r ,        d/du of that = (e_1 - e_0)^2 r (1 - r) .                                   (2)

Source: derived.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from flint import acb, arb

from fopi_tune.core.fractional_plants.orders import Orders
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.plant import Dual
from fopi_tune.proof.balls.responses import LoopEnclosure

#: a side of a plant: its terms' orders and coefficients
Terms = tuple[tuple[arb, Dual], ...]


def least_gap(orders: Orders) -> float:
    """The smallest difference between two orders of a side, at most 1: the terms grow apart no faster."""
    sides = (orders.numerator, orders.denominator)
    gaps = [high - low for side in sides for high, low in pairwise(side)]
    return min([1.0, *gaps])


class FractionalLoopEnclosure(LoopEnclosure):
    """The loop over one box, of fractional plants."""

    @computed_once
    def _top(self) -> Terms:
        return tuple(zip(self.plant.numerator_orders, self.plant.numerator, strict=True))

    @computed_once
    def _bottom(self) -> Terms:
        return tuple(zip(self.plant.denominator_orders, self.plant.denominator, strict=True))

    @computed_once
    def _highest(self) -> arb:
        return self.plant.denominator_orders[0]

    def _power(self, order: arb) -> acb:
        """s^order; in the high tail s^(order - k)."""
        return self.at.real_power_of_s(self._highest - order if self.high_tail else order)

    def _sum(self, terms: Terms, times: int = 0) -> acb:
        """X, or (1) where the terms count `times` times by their order."""
        found = acb(0)
        for order, coefficient in terms:
            weight = coefficient.value * order**times if times else coefficient.value
            found += weight * self._power(order)
        return found

    @computed_once
    def numerator(self) -> acb:
        """N, without the dead time; in the high tail over s^k."""
        return self._sum(self._top)

    @computed_once
    def d(self) -> acb:
        """D; in the high tail over s^k."""
        return self._sum(self._bottom)

    @computed_once
    def plant_sides(self) -> tuple[acb, acb]:
        """P without delay and measurement filter as a quotient."""
        bottom = self.loop.filter_bottom
        if bottom is None:
            return self.numerator, self.d
        if not self.high_tail:
            return self.numerator * bottom.at(self.s), self.d
        # over s^k with the degree of 1/F in it
        rest = self._highest - bottom.degree
        top = sum((c.value * self.at.real_power_of_s(rest - e) for e, c in self._top), acb(0))
        return top * bottom.reversed.at(self.s), self.d

    def _ratio(self, terms: Terms) -> acb:
        """r of (2)."""
        (high, first), (low, second) = terms
        # the power of the smaller exponent over the larger one is bounded in both directions outside of tails
        return 1 / (1 + (second.value / first.value) / self.at.real_power_of_s(high - low))

    def _slope_of(self, terms: Terms, value: acb) -> acb:
        """s X'/X."""
        if len(terms) == 1:
            return acb(terms[0][0])
        if len(terms) == 2 and not terms[0][1].value.contains(0):
            (high, _), (low, _) = terms
            return low + (high - low) * self._ratio(terms)
        return self._sum(terms, 1) / value

    def _curvature_of(self, terms: Terms, value: acb) -> acb:
        """d/du of s X'/X."""
        if len(terms) == 1:
            return acb(0)
        if len(terms) == 2 and not terms[0][1].value.contains(0):
            (high, _), (low, _) = terms
            r = self._ratio(terms)
            return (high - low) ** 2 * r * (1 - r)
        slope = self._sum(terms, 1) / value
        return self._sum(terms, 2) / value - slope * slope

    @computed_once
    def characteristic_slope(self) -> acb:
        """The derivative in u of D + C N e^{-Ls}; not in a tail."""
        inner = self.controller_slope * self.numerator + self._sum(self._top, 1)
        if self.delay is not None:
            inner = (inner - acb(0, self.omega * self.plant.dead_time.value) * self.numerator) * self.delay
        return self._sum(self._bottom, 1) + self.c * inner

    @computed_once
    def log_slope(self) -> acb:
        """d ln L/du; not in a tail."""
        slope = self.controller_slope + self._slope_of(self._top, self.numerator) - self._slope_of(self._bottom, self.d)
        dead_time = self.plant.dead_time.value
        return slope if dead_time.is_zero() else slope - acb(0, self.omega * dead_time)

    @computed_once
    def log_gradient(self) -> list[acb]:
        """d ln L/dtheta_k, k = 1 ... p."""
        gradient = [acb(0) for _ in range(self.loop.axes - 1)]
        for terms, value, sign in ((self._top, self.numerator, 1), (self._bottom, self.d, -1)):
            for order, coefficient in terms:
                for axis, slope in coefficient.gradient.items():
                    gradient[axis - 1] += sign * (self._power(order) * slope / value)
        return self._with_dead_time(gradient)

    def term_share(self, power: Any, coefficient: arb, above: bool) -> acb:
        """coefficient s^power over N, or over D."""
        return self._power(power) * coefficient / (self.numerator if above else self.d)

    @computed_once
    def log_curvature(self) -> acb:
        """d2 ln L/du2; not in a tail."""
        curvature = self.at.controller_curvature + self._curvature_of(self._top, self.numerator)
        curvature = curvature - self._curvature_of(self._bottom, self.d)
        dead_time = self.plant.dead_time.value
        return curvature if dead_time.is_zero() else curvature - acb(0, self.omega * dead_time)

    @computed_once
    def log_slope_gradient(self) -> list[acb]:
        """d2 ln L/du dtheta_k, k = 1 ... p; not in a tail."""
        gradient = [acb(0) for _ in range(self.loop.axes - 1)]
        for terms, value, sign in ((self._top, self.numerator, 1), (self._bottom, self.d, -1)):
            own = self._slope_of(terms, value)
            for order, coefficient in terms:
                for axis, slope in coefficient.gradient.items():
                    gradient[axis - 1] += sign * (self._power(order) * slope / value * (order - own))
        for axis, slope in self.plant.dead_time.gradient.items():
            gradient[axis - 1] = gradient[axis - 1] - acb(0, self.omega * slope)
        return gradient
