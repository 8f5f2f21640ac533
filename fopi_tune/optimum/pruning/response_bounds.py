"""Limits of responses over a box of controllers, at one frequency of one plant.

Such a limit says that C stays outside a disc, or inside, or on one side of a line:

    q(C) = a |C|^2 + 2 Re(b C) + c <= 0 ,      P the plant, M the limit

    |S|   <= M    -|P|^2 |C|^2 - 2 Re(P C) - 1 + 1/M^2
    |T|   <= M    (1 - M^2) |P|^2 |C|^2 - 2 M^2 Re(P C) - M^2
    |C S| <= M    (1 - M^2 |P|^2) |C|^2 - 2 M^2 Re(P C) - M^2
    |P S| <= M    -|P|^2 |C|^2 - 2 Re(P C) - 1 + |P|^2/M^2
    |L|   <= M    |P|^2 |C|^2 - M^2                                                                                (1)

and the opposite for >=.  With the Taylor model of `fopi_tune.optimum.parametrization` and w = a conj(C_c) + b,

    q >= q(C_c) + 2 sum Re(w C_i) t_i - 2 |w| r - max(-a, 0) (sum |C_i| h_i + r)^2 ,     |t_i| <= h_i .      (2)

Source: derived; (1) is each response's limit squared and written out, (2) a lower bound over the Taylor model.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.core.peaks import Response
from fopi_tune.optimum.parametrization import TaylorModel

_ZERO = arb(0)


@dataclass(frozen=True)
class LinearBound:
    """A lower bound of a condition's violation over a box that is linear in its coordinates.

    The violation of gains at the coordinates centre + t is at least  middle + sum_i slopes_i t_i/half_i ; gains that
    meet the condition have none above 0.

    Args:
        middle: at the centre, less all that is not linear.
        slopes: along the coordinates, times the half-widths.
    """

    middle: arb
    slopes: tuple[arb, ...]

    @property
    def lowest(self) -> arb:
        """No gains of the box have less."""
        return self.middle - sum((abs(slope) for slope in self.slopes), _ZERO)

    def scaled(self, weight: arb) -> LinearBound:
        """The weighted violation; the weight must not be negative."""
        return LinearBound(weight * self.middle, tuple(weight * slope for slope in self.slopes))

    def plus(self, other: LinearBound) -> LinearBound:
        """The sum of two violations of the same gains."""
        slopes = tuple(a + b for a, b in zip(self.slopes, other.slopes, strict=True))
        return LinearBound(self.middle + other.middle, slopes)


def quadratic(response: Response, p: acb, limit: arb, upper: bool) -> tuple[arb, acb, arb]:
    """a, b and c of (1), from M^2."""
    size = abs(p) ** 2
    if response is Response.SENSITIVITY:
        found = -size, -p, 1 / limit - 1
    elif response is Response.LOAD_SENSITIVITY:
        found = -size, -p, size / limit - 1
    elif response is Response.LOOP_GAIN:
        found = size, acb(0), -limit
    else:
        first = size if response is Response.COMPLEMENTARY_SENSITIVITY else arb(1)
        found = first - limit * size, -limit * p, -limit
    return found if upper else (-found[0], -found[1], -found[2])


def linear_bound(q: tuple[arb, acb, arb], taylor_model: TaylorModel, half: tuple[arb, ...]) -> LinearBound:
    """The bound (2)."""
    a, b, c = q
    middle = taylor_model.middle
    w = a * middle.conjugate() + b
    pairs = list(zip(taylor_model.slopes, half, strict=True))
    value = a * abs(middle) ** 2 + 2 * (b * middle).real + c - 2 * abs(w) * taylor_model.remainder
    if not a >= 0:
        reach = sum((abs(slope) * h for slope, h in pairs), taylor_model.remainder)
        value = value - abs(a) * reach**2
    return LinearBound(value, tuple(2 * (w * slope).real * h for slope, h in pairs))


def lower_bound(q: tuple[arb, acb, arb], taylor_model: TaylorModel, half: tuple[arb, ...]) -> arb:
    """The least value of q over a box, by (2)."""
    return linear_bound(q, taylor_model, half).lowest
