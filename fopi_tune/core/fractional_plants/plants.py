"""Batches of fractional plants on the imaginary axis.

Each side of P is its term of the lowest order times a sum of powers (`core/compiled/power_sums.py`):

    sum c_j s^e_j = c_0 s^e_0 G(s) ,      G = 1 + sum (c_j/c_0) s^(e_j - e_0) .                                      (1)

G is analytic right of the imaginary axis, where s^e has its principal value, and is 1 at s = 0.  Its phase along
+0 -> j inf is known in closed form, and with q the highest of its exponents the number of its zeros there is

    Z = q/2 - (arg G(j inf) - arg G(j0))/pi .                                                                      (2)

Source: (2) is the argument principle on a quarter circle and its mirror image.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.batches.plants import Plants, share_a_root_on_the_axis
from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows, joined_sums
from fopi_tune.core.fractional_plants.orders import Orders, not_for_fractional
from fopi_tune.core.fractional_plants.sides import (
    ON_AXIS,
    axis_roots,
    bends,
    resonances,
    side_values,
    sums_of,
)
from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError


def _no_polynomial(_: object) -> NoReturn:
    raise DomainError(not_for_fractional("this computation", "it takes polynomials in s"))


#: in place of what only polynomials have: to ask for it is a mistake, which is said
_NO_POLYNOMIAL: Any = property(_no_polynomial)


class FractionalPlants(Plants):
    """m plants with the same orders.

    Args:
        top: coefficients of the numerators, shape (m, a), by falling order.
        bottom: coefficients of the denominators, shape (m, b).
        dead_time_s: shape (m,).
        orders: of all of them.
    """

    def __init__(self, top: Array, bottom: Array, dead_time_s: Array, orders: Orders) -> None:
        for name, value in (("top", top), ("bottom", bottom), ("dead_time_s", dead_time_s), ("orders", orders)):
            object.__setattr__(self, name, value)

    top: Array
    bottom: Array
    orders: Orders

    def take(self, rows: Rows) -> FractionalPlants:
        """Select rows, with repetition."""
        return FractionalPlants(self.top[rows], self.bottom[rows], self.dead_time_s[rows], self.orders)

    # the coefficients are not those of polynomials, and there may be infinitely many roots on other sheets
    numerator = denominator = zeros = poles = _NO_POLYNOMIAL

    @property
    def polynomials(self) -> tuple[Array, Array]:
        """Such that compiled functions take L from the sums of powers, which lose no digits."""
        return np.zeros((len(self), 1)), np.ones((len(self), 1))

    @cached_property
    def _sums(self) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        """Of N and D by (1): c_0 and e_0, shape (m,), and the table of G, shape (m, 6, n)."""
        return sums_of(self.orders.numerator, self.top), sums_of(self.orders.denominator, self.bottom)

    @cached_property
    def unstable_poles(self) -> NDArray[np.int_]:
        """Number of poles in the open right half-plane, shape (m,), by (2)."""
        from fopi_tune.core.compiled.power_sums import ends

        exponent, _, phase = ends(self._sums[1][2])
        return np.rint(0.5 * exponent - phase / np.pi).astype(np.int_)

    @property
    def axis_poles(self) -> Complex:
        """The poles on the imaginary axis, 0 among them, shape (m, n); inf in place of those that are not there."""
        return axis_roots(self.orders.denominator, self.bottom)

    @property
    def pole_sizes_rad_s(self) -> Array:
        """Where neighbouring terms of a denominator are equal, which is about the size of a pole."""
        return np.asarray(np.abs(bends(self.orders.denominator, self.bottom)), dtype=float)

    @property
    def slowest_s(self) -> float:
        """The slowest time constant of any plant, 1/omega, omega where neighbouring terms are equal; 0 without, s."""
        found = [bends(self.orders.denominator, self.bottom), bends(self.orders.numerator, self.top)]
        return next((1.0 / float(np.abs(part).min()) for part in found if len(part)), 0.0)

    @property
    def has_falling_phase(self) -> bool:
        """Whether the phase is known to fall all the way: N is a number, D has two terms of one sign, one of order 0.

        With D = a s^alpha + b its phase is that of 1 + w along a ray, which turns one way.
        """
        return self._has_one_bend and self.orders.denominator[0] < 2.0

    @property
    def has_falling_gain(self) -> bool:
        """Whether |P| is known to fall all the way: as above, with an order of at most 1."""
        # |1 + w|^2 = 1 + 2 cos(alpha pi/2) |w| + |w|^2
        return self._has_one_bend and self.orders.denominator[0] <= 1.0

    @property
    def _has_one_bend(self) -> bool:
        orders = self.orders
        if orders.numerator != (0.0,) or len(orders.denominator) != 2 or orders.denominator[1] != 0.0:
            return False
        return bool(np.all(self.bottom[:, 0] * self.bottom[:, 1] > 0.0))

    def at_real(self, s: float) -> tuple[Array, Array]:
        """N and D at a real s > 0, shape (m,) each."""
        powers = [s ** np.array(side) for side in (self.orders.numerator, self.orders.denominator)]
        return self.top @ powers[0], self.bottom @ powers[1]

    @property
    def ends_at_zero(self) -> tuple[Array, Array]:
        """N(0) and D(0), shape (m,) each."""
        sides = (self.top, self.orders.numerator), (self.bottom, self.orders.denominator)
        top, bottom = (table[:, -1] * (orders[-1] == 0.0) for table, orders in sides)
        return top, bottom

    @cached_property
    def hidden_on_axis(self) -> NDArray[np.bool_]:
        """Whether N and D share a root on the imaginary axis, shape (m,)."""
        zeros = axis_roots(self.orders.numerator, self.top)
        return share_a_root_on_the_axis(zeros, self.axis_poles, 2.0 * ON_AXIS)

    @property
    def corner_roots(self) -> Complex:
        """Where two neighbouring terms of a side are equal, and the resonances, with their damping."""
        found: list[Complex] = []
        for orders, side in ((self.orders.numerator, self.top), (self.orders.denominator, self.bottom)):
            found += [bends(orders, side), resonances(orders, side)]
        return np.concatenate(found)

    def response(self, rows: Rows, omega: Array) -> Complex:
        """P(j omega) without its dead time; rows and omega of shape (n,)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return side_values(self.orders.numerator, self.top[rows], omega) / side_values(
                self.orders.denominator, self.bottom[rows], omega
            )

    @cached_property
    def log(self) -> BodeForm:
        """ln P.  A pole in the right half-plane contributes -180 deg at omega -> 0, as Nyquist's criterion needs."""
        (lead, first, top), (other, last, bottom) = self._sums
        none = np.zeros((len(self), 0))
        bottom = bottom.copy()
        bottom[:, 4, -1] *= -1.0
        slope0 = first - last
        # an odd number of poles on the right makes P(0) negative by itself
        negative = (lead < 0.0) ^ (other < 0.0) ^ (self.unstable_poles % 2 == 1)
        phase0 = np.asarray(-np.pi * negative - np.pi * self.unstable_poles + 0.5 * np.pi * slope0, dtype=float)
        return BodeForm(
            np.log(np.abs(lead)) - np.log(np.abs(other)), slope0, phase0, none, none, none, none, self.dead_time_s,
            joined_sums(top, bottom),
        )  # fmt: skip


class FractionalPlant(Plant):
    """One fractional plant.

    Args:
        top: coefficients of the numerator's terms, by falling order.
        bottom: coefficients of the denominator's terms, by falling order; the first is not 0.
        dead_time_s: dead time, >= 0.
        orders: of the terms.

    Raises:
        DomainError: as of `Plant`, or other numbers of terms.
    """

    top: tuple[float, ...]
    bottom: tuple[float, ...]
    orders: Orders

    def __init__(self, top: tuple[float, ...], bottom: tuple[float, ...], dead_time_s: float, orders: Orders) -> None:
        if (len(orders.numerator), len(orders.denominator)) != (len(top), len(bottom)):
            raise DomainError("each coefficient of a fractional plant needs an order")
        if not any(top) or not all(math.isfinite(value) for value in top):
            raise DomainError("the numerator is 0 or not finite: there is no plant to control")
        Plant((1.0,), bottom, dead_time_s)
        for name, value in (("top", top), ("bottom", bottom), ("dead_time_s", dead_time_s), ("orders", orders)):
            object.__setattr__(self, name, value)

    # the coefficients are not those of polynomials
    numerator = denominator = _NO_POLYNOMIAL

    @property
    def _numbers(self) -> tuple[object, ...]:
        return self.top, self.bottom, self.dead_time_s, self.orders

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FractionalPlant) and self._numbers == other._numbers

    def __hash__(self) -> int:
        return hash(self._numbers)

    def __repr__(self) -> str:
        numbers = ", ".join(f"{name}={getattr(self, name)!r}" for name in ("top", "bottom", "dead_time_s", "orders"))
        return f"FractionalPlant({numbers})"

    def batch(self, kind: Callable[[Array, Array, Array], Any]) -> FractionalPlants:
        """The plant as a batch of one row, of no other `kind`."""
        return FractionalPlants(
            np.array([self.top]), np.array([self.bottom]), np.array([self.dead_time_s]), self.orders
        )
