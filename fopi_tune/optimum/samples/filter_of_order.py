"""The filter of s^-alpha by Tustin's rule as a function of its order, in ball arithmetic and in floating point.

With w = (z - 1)/(z + 1), s = 2 w/Ts, the filter of `fopi_tune.digital.oustaloup` with its true integrator is

    F = (wm^(1 - alpha) Ts/2)/w  prod_k  ((w + a_k)/(w + b_k)) (|j mu + b_k|/|j mu + a_k|) ,                        (1)

wm the middle of the band, mu = wm Ts/2, and a_k, b_k = e^(c + d alpha) the corners times Ts/2; of the modified filter
one b_k is a_k/alpha.  With e = 1 for zeros and -1 for poles, and ' the derivative in alpha of a corner x,

    (ln F)'  = -ln wm + sum e (x'/(w + x) - x x'/(mu^2 + x^2)) ,                                                    (2)
    (ln F)'' = sum e (x''/(w + x) - (x'/(w + x))^2 - (x'^2 + x x'')/(mu^2 + x^2) + 2 (x x'/(mu^2 + x^2))^2) ,       (3)
    d ln F/d ln w = -1 + sum e w/(w + x) .                                                                          (4)

The exported filter has the same numbers, rounded to doubles.

Source: derived; (1) is (1) and (3) of `fopi_tune.digital.oustaloup` with s = 2 w/Ts, (2) to (4) are its derivatives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import acb, arb

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.digital.discretize import Method
from fopi_tune.spec.model import DigitalSpec

#: a corner's e, c, d, and whether it is divided by alpha
_Corner = tuple[int, arb, arb, bool]


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

    def corners_at(self, alpha: arb) -> list[tuple[int, arb]]:
        """e and the corner of each factor of (1) at an order."""
        return [(side, self._corner(alpha, c, d, over)) for side, c, d, over in self._corners]

    @staticmethod
    def _corner(alpha: arb, c: arb, d: arb, over: bool) -> arb:
        size = (c + d * alpha).exp()
        return size / alpha if over else size

    def gain(self, alpha: arb) -> arb:
        """F w prod (w + b_k)/(w + a_k): what does not depend on w."""
        square = (self._middle_nu) ** 2
        size = ((1 - alpha) * self._log_middle).exp() * self._half
        for side, corner in self.corners_at(alpha):
            factor = (square + corner * corner).sqrt()
            size = size / factor if side > 0 else size * factor
        return size

    @cached_property
    def _middle_nu(self) -> arb:
        """mu."""
        return self._log_middle.exp() * self._half

    def value(self, w: acb, alpha: arb) -> acb:
        """F by (1)."""
        found = self.gain(alpha) / w
        for side, corner in self.corners_at(alpha):
            found = found * (w + corner) if side > 0 else found / (w + corner)
        return found

    def slopes(self, w: acb, alpha: arb) -> tuple[acb, acb]:
        """(ln F)' and (ln F)'' by (2) and (3)."""
        first, second, square = acb(-self._log_middle), acb(0), self._middle_nu**2
        for side, c, d, over in self._corners:
            x = self._corner(alpha, c, d, over)
            rate = d - 1 / alpha if over else d
            up = x * rate
            bend = x * (rate * rate + (1 / alpha**2 if over else 0))
            share, part, size = up / (w + x), bend / (w + x), square + x * x
            turn = x * up / size
            first = first + side * (share - turn)
            second = second + side * (part - share * share - (up * up + x * bend) / size + 2 * turn * turn)
        return first, second

    def along(self, w: acb, alpha: arb) -> acb:
        """(4)."""
        found = acb(-1)
        for side, corner in self.corners_at(alpha):
            # w/(w + x) = 1 - x/(w + x)
            found = found - side * (corner / (w + corner))
        return found

    def size_in_tail(self, nu: arb, alpha: arb, high: bool) -> tuple[arb, arb]:
        """Bounds of |F| below nu, or above it: each factor of (1) lies between its value and its limit."""
        least = most = self.gain(alpha) / nu
        w = acb(0, nu)
        corners = self.corners_at(alpha)
        for (_, zero), (_, pole) in zip(corners[::2], corners[1::2], strict=True):
            here, limit = abs((w + zero) / (w + pole)), arb(1) if high else zero / pole
            both = here.union(limit)
            least, most = least * both, most * both
        if high:
            return arb(0), arb(most.upper())
        return arb(least.lower()), arb.pos_inf()

    def sections(self, kp: arb, ki: arb, alpha: arb) -> tuple[arb, tuple[tuple[arb, arb], ...]]:
        """kp + ki F as  direct + sum_k rho_k/(w + sigma_k)."""
        if ki.is_zero():
            return kp, ()
        corners = self.corners_at(alpha)
        zeros, poles = [x for side, x in corners if side > 0], [arb(0), *(x for side, x in corners if side < 0)]
        gain, pairs = ki * self.gain(alpha), []
        for k, pole in enumerate(poles):
            rho = gain
            for zero in zeros:
                rho = rho * (zero - pole)
            for i, other in enumerate(poles):
                if i != k:
                    rho = rho / (other - pole)
            pairs.append((pole, rho))
        return kp, tuple(pairs)

    # -- in floating point --------------------------------------------------------------------------------------------

    @cached_property
    def _table(self) -> tuple[Array, float, float]:
        """e, c, d and the share of -ln alpha of the corners, shape (n, 4); ln wm and ln Ts/2."""
        rows = [(side, float(c.mid()), float(d.mid()), float(over)) for side, c, d, over in self._corners]
        table = np.array(rows, dtype=float).reshape(len(rows), 4)
        return table, float(self._log_middle.mid()), math.log(0.5 * self.digital.sample_time_s)

    def in_floats(self, w: Complex, alpha: Array) -> tuple[Complex, Complex, Complex]:
        """F, (ln F)' and (ln F)'' for arrays that go together."""
        table, log_middle, log_half = self._table
        square = np.exp(2.0 * (log_middle + log_half))
        log = (1.0 - alpha) * log_middle + log_half - np.log(w)
        first, second = -log_middle + 0.0 * w, 0.0 * w
        for side, c, d, over in table:
            x = np.exp(c + d * alpha) / (alpha if over else 1.0)
            rate = d - over / alpha
            up, bend, size = x * rate, x * (rate * rate + over / alpha**2), square + x * x
            share, turn = up / (w + x), x * up / size
            log = log + side * (np.log(w + x) - 0.5 * np.log(size))
            first = first + side * (share - turn)
            second = second + side * (bend / (w + x) - share * share - (up * up + x * bend) / size + 2.0 * turn * turn)
        return np.exp(log), first, second
