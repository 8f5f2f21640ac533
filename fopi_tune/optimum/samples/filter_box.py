"""The filter of s^-alpha over a box of orders:  what the places of its poles and zeros tell beyond enclosures.

For alpha <= 1 the poles 0, b_1, ... and the zeros a_k of F alternate in w, beginning with the pole at 0, so that F has
positive residues. For alpha > 1 each b_k is below its a_k. Those of Oustaloup's filter alternate again, 0 < b_1 < a_1
< b_2 < ..., but the modified filter's fast pole f/alpha may lie below the last zero a_n. As a_n < 0.9 f, alpha < 2 and
arctan x + arctan y > arctan(x + y),

    arctan(alpha nu/f) - arctan(nu/f) < arctan(nu/a_n) ,

so that the fast pair leads by less than the last zero lags. Hence along the axis w = j nu, u = ln nu,

    |F| falls with u;    a = -arg F is in (0, 90 deg) for alpha < 1, in (90 deg, 180 deg) above;
    Re F falls with u for alpha <= 1, so that |kp + ki F| does for kp, ki >= 0.                                     (1)

As alpha rises every zero does and every pole falls, so that along it, at each frequency,

    a rises,    |F(w)/F(w_a)| rises for |w| < |w_a| and falls for |w| > |w_a|,    d ln|F|/du falls.                 (2)

Source: derived; (1) from partial fractions with positive residues and pairs of corners, (2) term by term from (1) of
`filter_of_order`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, reduce
from typing import Any, TypeVar

from flint import acb, arb

from fopi_tune.optimum.samples.filter_of_order import FilterAtOrder, FilterOfOrder
from fopi_tune.proof.balls.box import Interval, ball_of, centre_of

_T = TypeVar("_T")
#: half-widths of orders from which on size and angle by (2) sharpen a response, and replace a Taylor model in the order
_NARROW, _WIDE = 0.01, 0.1
#: responses that are kept
_MOST_KNOWN = 512
#: orders of one piece of a wide box
_PIECE = 0.05


class FilterBox:
    """F over a ball of orders.

    Args:
        filtered: F.
        alpha: the orders.
        middle: a central one.
        nu: |w_a|, at which sizes are counted as 1.
        log_unit: ln of the frequency, rad/s, of whose power of the order `anchor_size` is a multiple.
    """

    def __init__(self, filtered: FilterOfOrder, alpha: arb, middle: arb, nu: arb, log_unit: arb) -> None:
        self.filter, self._alpha, self._middle, self._w = filtered, alpha, middle, acb(0, nu)
        self._log_unit = log_unit
        self._known: dict[tuple[str, Interval], Any] = {}

    @cached_property
    def central(self) -> FilterAtOrder:
        """F at the central order."""
        return self.filter.at_order(self._middle)

    @cached_property
    def over(self) -> FilterAtOrder:
        """F at all orders."""
        return self.filter.at_order(self._alpha)

    @cached_property
    def _ends(self) -> tuple[FilterAtOrder, ...]:
        """F at the least and the largest order."""
        low, high = arb(self._alpha.lower()), arb(self._alpha.upper())
        return tuple(self.filter.at_order(order) for order in ((low, high) if low < high else (low,)))

    @cached_property
    def _anchors(self) -> list[acb]:
        """F(w_a) there."""
        return [end.value(self._w) for end in self._ends]

    @cached_property
    def _shift(self) -> arb:
        """From the central order to the others."""
        return self._alpha - self._middle

    def log_derivatives(self, w: acb) -> tuple[acb, acb]:
        """y1 and y2 of `filter_of_order`, (2), over the orders: by Taylor's theorem, as terms of the sums cancel."""
        if self._alpha.rad() > _WIDE:
            return self.over.log_derivatives(w)[:2]
        (one, two, three), t, four = self.central.log_derivatives(w), self._shift, self.over.fourth_derivative(w)
        square = t * t
        first = one + t * two + square / 2 * three + square * t / 6 * four
        return first, two + t * three + square / 2 * four

    @cached_property
    def anchor_derivatives(self) -> tuple[acb, acb]:
        """The same at w_a."""
        return self.log_derivatives(self._w)

    def derivatives_from_anchor(self, w: acb) -> tuple[acb, acb]:
        """The same of ln F/|F(w_a)|."""
        (first, second), (one, two) = self.log_derivatives(w), self.anchor_derivatives
        return first - one.real, second - two.real

    @cached_property
    def lag_at_anchor(self) -> arb:
        """-arg F(w_a), by (2)."""
        return _lag(self._anchors[0]).union(_lag(self._anchors[-1]))

    @cached_property
    def anchor_value(self) -> acb:
        """F(w_a)/|F(w_a)|."""
        lag = self.lag_at_anchor
        return acb(lag.cos(), -lag.sin())

    @cached_property
    def anchor_size(self) -> arb:
        """|F(w_a)| e^(alpha log_unit) over the orders."""
        low, high = arb(self._alpha.lower()), arb(self._alpha.upper())
        count = max(1, math.ceil(float((high - low).mid()) / _PIECE))
        pieces = [(low + (high - low) * k / count).union(low + (high - low) * (k + 1) / count) for k in range(count)]
        return reduce(arb.union, map(self._anchor_size_of, pieces))

    def _anchor_size_of(self, piece: arb) -> arb:
        middle = arb(piece.mid())
        box = FilterBox(self.filter, piece, middle, self._w.imag, self._log_unit)
        rate = box.anchor_derivatives[0].real + self._log_unit
        return abs(box.central.value(self._w)) * (middle * self._log_unit + rate * (piece - middle)).exp()

    def _once(self, compute: Callable[[Interval], _T], u: Interval) -> _T:
        """What is computed of an interval, kept: many boxes share their orders and intervals."""
        key = compute.__name__, u
        if key not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[key] = compute(u)
        return self._known[key]

    def sizes(self, u: float) -> tuple[arb, arb]:
        """Bounds of |F/F(w_a)| at a frequency, by (2)."""
        return self._once(self._sizes, (u, u))

    def _sizes(self, u: Interval) -> tuple[arb, arb]:
        w = acb(0, arb(u[0]).exp())
        found = [abs(end.value(w) / anchor) for end, anchor in zip(self._ends, self._anchors, strict=True)]
        both = found[0].union(found[-1])
        return arb(both.lower()), arb(both.upper())

    def lag(self, u: Interval) -> arb:
        """-arg F over an interval of u, which may be a tail, by (1) and (2)."""
        return self._once(self._lag, u)

    def _lag(self, u: Interval) -> arb:
        quarter = arb.pi() / 2
        low = quarter if self._alpha > 1 else arb(0)
        high = quarter if self._alpha <= 1 else 2 * quarter
        if math.isinf(u[0]) or math.isinf(u[1]):
            return low.union(high)
        (middle,) = centre_of((u,))
        w, shift = acb(0, arb(middle).exp()), ball_of(u) - arb(middle)
        found = [
            _lag(end.value(w)) - slope.imag * shift for end, slope in zip(self._ends, self._slopes(u), strict=True)
        ]
        both = found[0].union(found[-1])
        least, most = arb(both.lower()), arb(both.upper())
        return (least if least > low else low).union(most if most < high else high)

    def _slopes(self, u: Interval) -> list[acb]:
        """d ln F/du at the least and the largest order."""
        w = acb(0, ball_of(u).exp())
        return [end.slope(w) for end in self._ends]

    def slope(self, u: Interval) -> acb:
        """d ln F/du over an interval of u; of a wide box its real part by (2)."""
        return self._once(self._slope, u)

    def _slope(self, u: Interval) -> acb:
        w = acb(0, ball_of(u).exp())
        if self._alpha.rad() > _WIDE:
            slopes = self._slopes(u)
            return acb(slopes[0].real.union(slopes[-1].real), self.over.slope(w).imag)
        (slope, first, _), t = self.central.slopes(w), self._shift
        return slope + t * first + t * t / 2 * self.over.slopes(w)[2]

    def over_orders(self, w: acb) -> acb:
        """F/|F(w_a)| at a w."""
        value = self.central.value(w) / abs(self.central.value(self._w))
        return value * (self.derivatives_from_anchor(w)[0] * self._shift).exp()

    def response(self, u: Interval) -> acb:
        """F/|F(w_a)| over an interval of u: from the slopes, and of a wide box also from size and angle."""
        return self._once(self._response, u)

    def _response(self, u: Interval) -> acb:
        (middle,), ball = centre_of((u,)), ball_of(u)
        value = self.central.value(acb(0, arb(middle).exp())) / abs(self.central.value(self._w))
        rate = self.derivatives_from_anchor(acb(0, ball.exp()))[0]
        value = value * (rate * self._shift + self.slope(u) * (ball - arb(middle))).exp()
        if self._alpha.rad() < _NARROW:
            return value
        size, lag = self.sizes(u[1])[0].union(self.sizes(u[0])[1]), self.lag(u)
        polar = size * acb(lag.cos(), -lag.sin())
        if not value.is_finite():
            return polar
        return acb(value.real.intersection(polar.real), value.imag.intersection(polar.imag))


def _lag(value: acb) -> arb:
    """-arg of a value in the lower half-plane."""
    return arb.pi() / 2 - (value * acb(0, 1)).arg()
