"""The filter of s^-alpha by Tustin's rule as a function of its order, in ball arithmetic and in floating point.

With w = (z - 1)/(z + 1), s = 2 w/Ts, the filter of `fopi_tune.digital.oustaloup` with its true integrator is

    F = (wm^(1 - alpha) Ts/2)/w  prod_k  ((w + a_k)/(w + b_k)) (|j mu + b_k|/|j mu + a_k|) ,                        (1)

wm the middle of the band, mu = wm Ts/2, and a_k, b_k = e^g, g = c + d alpha, the corners times Ts/2; of the modified
filter one has g = c - ln alpha.  With e = 1 for zeros and -1 for poles, p = x/(w + x) of a corner x, and

    l1 = p ,   l2 = p (1 - p) ,   l3 = l2 (1 - 2 p) ,   l4 = l2 (1 - 6 p + 6 p^2) ,

the derivatives of ln(w + e^g) by g, and g1 to g4 those of g by alpha, those of ln F by alpha are

    y1 = -ln wm + sum e [l1 g1] ,   y2 = sum e [l2 g1^2 + l1 g2] ,   y3 = sum e [l3 g1^3 + 3 l2 g1 g2 + l1 g3] ,
    y4 = sum e [l4 g1^4 + 6 l3 g1^2 g2 + l2 (3 g2^2 + 4 g1 g3) + l1 g4] ,                                           (2)

[.] less its real part at w = j mu, and

    d ln F/d ln w = -1 + sum e (1 - p) ,   its derivatives by alpha   -sum e l2 g1 ,   -sum e (l3 g1^2 + l2 g2) .   (3)

The exported filter has the same numbers, rounded to doubles.

Source: derived; (1) is (1) and (3) of `fopi_tune.digital.oustaloup` with s = 2 w/Ts, (2) and (3) are its derivatives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import acb, arb

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.digital.discretize import Method
from fopi_tune.proof.balls.sampled_controllers import Sections
from fopi_tune.spec.model import DigitalSpec

#: a corner's e, c, d, and whether g is c - ln alpha
_Corner = tuple[int, arb, arb, bool]


@dataclass(frozen=True)
class FilterAtOrder:
    """F of (1) at one order, or at all orders of a ball.

    Args:
        gain: F w prod (w + b_k)/(w + a_k), which does not depend on w.
        log_middle: ln wm.
        middle: j mu.
        corners: zeros and poles in turn: e, x, and the derivatives of g.
    """

    gain: arb
    log_middle: arb
    middle: acb
    corners: tuple[tuple[int, arb, tuple[arb, arb, arb, arb]], ...]

    def value(self, w: acb) -> acb:
        """F by (1)."""
        found = self.gain / w
        for (_, zero, _), (_, pole, _) in zip(self.corners[::2], self.corners[1::2], strict=True):
            found = found * ((w + zero) / (w + pole))
        return found

    @cached_property
    def _at_middle(self) -> tuple[acb, acb, acb]:
        return self._sums(self.middle)

    def _sums(self, w: acb) -> tuple[acb, acb, acb]:
        """The first three sums of (2) without what is taken off."""
        one, two, three = acb(0), acb(0), acb(0)
        for side, x, (g1, g2, g3, _) in self.corners:
            l1 = x / (w + x)
            l2 = l1 * (1 - l1)
            turn = side * g1
            one, two = one + l1 * turn, two + l2 * (turn * g1)
            three = three + l2 * (1 - 2 * l1) * (turn * g1 * g1)
            if not g2.is_zero():
                two, three = two + side * (l1 * g2), three + side * (3 * l2 * g1 * g2 + l1 * g3)
        return one, two, three

    def log_derivatives(self, w: acb) -> tuple[acb, acb, acb]:
        """y1, y2 and y3 of (2)."""
        (one, two, three), off = self._sums(w), self._at_middle
        return one - off[0].real - self.log_middle, two - off[1].real, three - off[2].real

    @cached_property
    def _fourth_at_middle(self) -> arb:
        return self._fourth(self.middle).real

    def _fourth(self, w: acb) -> acb:
        total = acb(0)
        for side, x, (g1, g2, g3, g4) in self.corners:
            l1, square = x / (w + x), g1 * g1
            l2 = l1 * (1 - l1)
            total = total + l2 * (1 - 6 * l2) * (side * square * square)
            if not g2.is_zero():
                more = 6 * (l2 * (1 - 2 * l1)) * square * g2 + l2 * (3 * g2 * g2 + 4 * g1 * g3) + l1 * g4
                total = total + side * more
        return total

    def fourth_derivative(self, w: acb) -> acb:
        """y4 of (2)."""
        return self._fourth(w) - self._fourth_at_middle

    def slope(self, w: acb) -> acb:
        """d ln F/d ln w by (3): the first of `slopes` alone, at less cost."""
        found = acb(-1)
        for (_, zero, _), (_, pole, _) in zip(self.corners[::2], self.corners[1::2], strict=True):
            found = found - zero / (w + zero) + pole / (w + pole)
        return found

    def slopes(self, w: acb) -> tuple[acb, acb, acb]:
        """(3)."""
        slope, first, second = acb(-1), acb(0), acb(0)
        for side, x, (g1, g2, _, _) in self.corners:
            p = x / (w + x)
            l2 = p * (1 - p)
            # sum e of one over zeros and poles in turn is 0
            slope, first = slope - side * p, first - l2 * (side * g1)
            second = second - side * (l2 * (1 - 2 * p) * (g1 * g1) + l2 * g2)
        return slope, first, second

    def sections(self, kp: arb, ki: arb) -> Sections:
        """kp + ki F as  direct + sum_k rho_k/(w + sigma_k)."""
        if ki.is_zero():
            return kp, ()
        zeros, poles = [x for _, x, _ in self.corners[::2]], [arb(0), *(x for _, x, _ in self.corners[1::2])]
        pairs = []
        for k, pole in enumerate(poles):
            rho = ki * self.gain
            for zero in zeros:
                rho = rho * (zero - pole)
            for i, other in enumerate(poles):
                if i != k:
                    rho = rho / (other - pole)
            pairs.append((pole, rho))
        return kp, tuple(pairs)


@dataclass(frozen=True)
class FilterOfOrder:
    """F of (1).

    Args:
        digital: the spec's section: `oustaloup` or `modified_oustaloup`, by Tustin's rule without prewarping.
    """

    digital: DigitalSpec

    @cached_property
    def _half(self) -> arb:
        """Ts/2."""
        return arb(self.digital.sample_time_s) / 2

    @cached_property
    def _log_middle(self) -> arb:
        """ln wm."""
        low, high = map(arb, self.digital.band_rad_s)
        return (low * high).log() / 2

    @cached_property
    def _corners(self) -> tuple[_Corner, ...]:
        """A zero and a pole in turn."""
        modified = Method(self.digital.method) is Method.MODIFIED_OUSTALOUP
        low, high = map(arb, self.digital.band_rad_s)
        count = self.digital.poles - int(modified)
        found: list[_Corner] = []
        if count:
            step = (high / low).log() / count
            for k in range(count):
                base = low.log() + step * (arb(2 * k + 1) / 2) + self._half.log()
                # ln a_k, ln b_k = base -+ (1 - alpha) step/2
                found += [(1, base - step / 2, step / 2, False), (-1, base + step / 2, -step / 2, False)]
        if modified:
            fast = (10 * high / 9).log() + self._half.log()
            found += [(1, fast, arb(0), False), (-1, fast, arb(0), True)]
        return tuple(found)

    def at_order(self, alpha: arb) -> FilterAtOrder:
        """F at one order, or at all orders of a ball."""
        nothing, middle = arb(0), self._log_middle.exp() * self._half
        gain, square = ((1 - alpha) * self._log_middle).exp() * self._half, middle * middle
        corners = list[tuple[int, arb, tuple[arb, arb, arb, arb]]]()
        inverse = 1 / alpha
        for side, c, d, over in self._corners:
            x = (c + d * alpha).exp()
            rates = (d, nothing, nothing, nothing)
            if over:
                x, rates = x * inverse, (-inverse, inverse**2, -2 * inverse**3, 6 * inverse**4)
            size = (square + x * x).sqrt()
            gain = gain / size if side > 0 else gain * size
            corners.append((side, x, rates))
        return FilterAtOrder(gain, self._log_middle, acb(0, middle), tuple(corners))

    # -- in floating point --------------------------------------------------------------------------------------------

    @cached_property
    def _table(self) -> tuple[Array, float, float]:
        """e, c, d and whether g is c - ln alpha, shape (n, 4); ln wm and ln Ts/2."""
        rows = [(side, float(c.mid()), float(d.mid()), float(over)) for side, c, d, over in self._corners]
        table = np.array(rows, dtype=float).reshape(len(rows), 4)
        return table, float(self._log_middle.mid()), math.log(0.5 * self.digital.sample_time_s)

    def in_floats(self, w: Complex, alpha: Array) -> tuple[Complex, Complex, Complex]:
        """F, y1 and y2 for arrays that go together."""
        table, log_middle, log_half = self._table
        middle = 1j * np.exp(log_middle + log_half)
        value = np.exp((1.0 - alpha) * log_middle + log_half) / w
        first, second = -log_middle + 0.0 * w, 0.0 * w
        for side, c, d, over in table:
            x = np.exp(c + d * alpha) / (alpha if over else 1.0)
            rate, bend = d - over / alpha, over / alpha**2
            here, there = x / (w + x), x / (middle + x)
            factor = (w + x) / np.abs(middle + x)
            value = value * factor if side > 0 else value / factor
            first = first + side * rate * (here - there.real)
            curve = [p * (1.0 - p) * rate**2 + p * bend for p in (here, there)]
            second = second + side * (curve[0] - curve[1].real)
        return value, first, second
