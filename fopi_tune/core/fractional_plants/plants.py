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
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.batches.plants import Plants
from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows, joined_sums
from fopi_tune.core.fractional_plants.orders import MOST_TERMS, Orders, not_for_fractional
from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError

#: relative to the sum of the terms' sizes; a side this small on the axis is 0 there
_ON_AXIS = 1e-9
#: places of a search for resonances, and the part of the terms' sizes below which there is one
_SCAN, _RESONANT = 400, 0.5
#: sides whose sums are kept
_KEPT = 20_000
#: of a plant that is a number
_CONSTANT = Orders((0.0,), (0.0,))


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

    @property
    def numerator(self) -> NoReturn:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Refused: the coefficients are not those of polynomials.

        Raises:
            DomainError: always.
        """
        raise _no_polynomial()

    @property
    def denominator(self) -> NoReturn:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Refused: the coefficients are not those of polynomials.

        Raises:
            DomainError: always.
        """
        raise _no_polynomial()

    @property
    def zeros(self) -> NoReturn:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Refused: there may be infinitely many on other sheets.

        Raises:
            DomainError: always.
        """
        raise _no_polynomial()

    @property
    def poles(self) -> NoReturn:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Refused: there may be infinitely many on other sheets.

        Raises:
            DomainError: always.
        """
        raise _no_polynomial()

    @property
    def polynomials(self) -> tuple[Array, Array]:
        """Such that compiled functions take L from the sums of powers, which lose no digits."""
        return np.zeros((len(self), 1)), np.ones((len(self), 1))

    @cached_property
    def _sums(self) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        """Of N and D by (1): c_0 and e_0, shape (m,), and the table of G, shape (m, 6, n)."""
        return _side(self.orders.numerator, self.top), _side(self.orders.denominator, self.bottom)

    @cached_property
    def unstable_poles(self) -> NDArray[np.int_]:
        """Number of poles in the open right half-plane, shape (m,), by (2)."""
        from fopi_tune.core.compiled.power_sums import ends

        exponent, _, phase = ends(self._sums[1][2])
        return np.rint(0.5 * exponent - phase / np.pi).astype(np.int_)

    @property
    def axis_poles(self) -> Complex:
        """The poles on the imaginary axis, 0 among them, shape (m, n); inf in place of those that are not there."""
        return _axis_roots(self.orders.denominator, self.bottom)

    @property
    def slowest_s(self) -> float:
        """The slowest time constant of any plant, 1/omega, omega where neighbouring terms are equal; 0 without, s."""
        bends = [_bends(self.orders.denominator, self.bottom), _bends(self.orders.numerator, self.top)]
        return next((1.0 / float(np.abs(found).min()) for found in bends if len(found)), 0.0)

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
        zero, pole = _axis_roots(self.orders.numerator, self.top)[:, None, :], self.axis_poles[:, :, None]
        both = np.isfinite(zero) & np.isfinite(pole)
        zero, pole = np.where(both, zero, 0.0), np.where(both, pole, 0.0)
        return np.asarray((both & (np.abs(zero - pole) <= 2.0 * _ON_AXIS * np.abs(pole))).any(axis=(1, 2)))

    @property
    def corner_roots(self) -> Complex:
        """Where two neighbouring terms of a side are equal, and the resonances, with their damping."""
        found: list[Complex] = []
        for orders, side in ((self.orders.numerator, self.top), (self.orders.denominator, self.bottom)):
            found += [_bends(orders, side), _resonances(orders, side)]
        return np.concatenate(found)

    def response(self, rows: Rows, omega: Array) -> Complex:
        """P(j omega) without its dead time; rows and omega of shape (n,)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return _values(self.orders.numerator, self.top[rows], omega) / _values(
                self.orders.denominator, self.bottom[rows], omega
            )

    def at(self, s: Complex) -> Complex:
        """The first plant at complex numbers of any shape off the negative real axis, without its dead time."""
        top, bottom = (
            sum((c * s**e for c, e in zip(side[0], orders, strict=True)), np.zeros_like(s))
            for orders, side in ((self.orders.numerator, self.top), (self.orders.denominator, self.bottom))
        )
        return np.asarray(top / bottom)

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


@dataclass(frozen=True)
class FractionalPlant(Plant):
    """One fractional plant.

    Args:
        numerator: coefficients of its terms, by falling order.
        denominator: coefficients of its terms, by falling order; the first is not 0.
        dead_time_s: dead time, >= 0.
        orders: of the terms.

    Raises:
        DomainError: as of `Plant` and `Orders`, or other numbers of terms.
    """

    orders: Orders = _CONSTANT

    def __post_init__(self) -> None:
        sizes = len(self.orders.numerator), len(self.orders.denominator)
        if sizes != (len(self.numerator), len(self.denominator)):
            raise DomainError("each coefficient of a fractional plant needs an order")
        # of the lengths alone the numerator may be the longer one
        padded = Plant((0.0, *self.numerator)[-1:], self.denominator, self.dead_time_s) if any(self.numerator) else None
        if padded is None or not all(math.isfinite(value) for value in self.numerator):
            raise DomainError("the numerator is 0 or not finite: there is no plant to control")

    def batch(self, kind: Callable[[Array, Array, Array], Any]) -> FractionalPlants:
        """The plant as a batch of one row, of no other `kind`."""
        sides = np.array([self.numerator]), np.array([self.denominator])
        return FractionalPlants(*sides, np.array([self.dead_time_s]), self.orders)


def _no_polynomial() -> DomainError:
    return DomainError(not_for_fractional("this computation", "it takes polynomials in s"))


def _side(orders: tuple[float, ...], coefficients: Array) -> tuple[Array, Array, Array]:
    every = [_sum_of(orders, tuple(row)) for row in coefficients.tolist()]
    return np.array([e[0] for e in every]), np.array([e[1] for e in every]), np.array([e[2] for e in every])


@lru_cache(_KEPT)
def _sum_of(orders: tuple[float, ...], coefficients: tuple[float, ...]) -> tuple[float, float, Array]:
    """c_0, e_0 and the table of G in (1)."""
    from fopi_tune.core.compiled.power_sums import table_of

    if not any(coefficients):
        raise DomainError("the numerator is 0: there is no plant to control")
    return table_of(orders, coefficients, max(len(orders), 2))


def _values(orders: tuple[float, ...], coefficients: Array, omega: Array) -> Complex:
    """A side at j omega; coefficients (n, terms), omega (n,)."""
    found = np.zeros(len(omega), dtype=complex)
    for k, order in enumerate(orders):
        found += coefficients[:, k] * omega**order * _turn(order)
    return found


def _turn(order: float) -> complex:
    """j^order."""
    whole = {0: 1.0, 1: 1j, 2: -1.0, 3: -1j}
    return complex(whole[int(order) % 4]) if order == int(order) else complex(np.exp(0.5j * np.pi * order))


def _sizes(orders: tuple[float, ...], coefficients: Array, omega: Array) -> Array:
    """The sum of the terms' absolute values."""
    return np.asarray(sum(np.abs(coefficients[:, k]) * omega**order for k, order in enumerate(orders)))


def _axis_roots(orders: tuple[float, ...], coefficients: Array) -> Complex:
    """Roots of sides on the imaginary axis, shape (m, 1 + MOST_TERMS): 0, and j omega with omega > 0."""
    from fopi_tune.core.compiled.power_sums import sign_changes

    found = np.full((len(coefficients), 1 + MOST_TERMS), np.inf + 0j)
    for row, own in enumerate(coefficients.tolist()):
        _, first, table = _sum_of(orders, tuple(own))
        if first > 0.0:
            found[row, 0] = 0.0
        terms = [term for term in zip(*table[:4].tolist(), strict=True) if term[1] > -np.inf]
        real, imaginary = ([(q, b, parts[k]) for q, b, *parts in terms if parts[k]] for k in (0, 1))
        omega = np.exp(np.array(sign_changes(imaginary or real)))
        values, sizes = (
            f(orders, np.repeat(coefficients[row : row + 1], len(omega), axis=0), omega) for f in (_values, _sizes)
        )
        there = omega[np.abs(values) <= _ON_AXIS * sizes][:MOST_TERMS]
        found[row, 1 : 1 + len(there)] = 1j * there
    return found


def _bends(orders: tuple[float, ...], coefficients: Array) -> Complex:
    """-omega where two neighbouring terms of a side are equal."""
    found: list[Any] = []
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for k in range(len(orders) - 1):
            ratio = np.abs(coefficients[:, k + 1] / coefficients[:, k])
            found.append(ratio ** (1.0 / (orders[k] - orders[k + 1])))
    roots = np.concatenate(found) if found else np.zeros(0)
    return -roots[np.isfinite(roots) & (roots > 1e-100) & (roots < 1e100)].astype(complex)


def _resonances(orders: tuple[float, ...], coefficients: Array) -> Complex:
    """Where a side is much smaller than its terms:  omega (-r + j sqrt(1 - r^2)), r its part of them."""
    bends = np.abs(_bends(orders, coefficients))
    if not len(bends):
        return np.zeros(0, dtype=complex)
    omega = np.geomspace(0.1 * bends.min(), 10.0 * bends.max(), _SCAN)
    m, n = len(coefficients), len(omega)
    rows, every = np.repeat(coefficients, n, axis=0), np.tile(omega, m)
    part = (np.abs(_values(orders, rows, every)) / _sizes(orders, rows, every)).reshape(m, n)
    inner = part[:, 1:-1]
    lowest = (inner < _RESONANT) & (inner <= part[:, :-2]) & (inner < part[:, 2:])
    row, column = np.nonzero(lowest)
    r = inner[row, column]
    return np.asarray(omega[1 + column] * (-r + 1j * np.sqrt(1.0 - r * r)))
