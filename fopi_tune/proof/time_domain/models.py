"""Numbers that depend on a plant, over a box of plants: their terms up to second order, and a bound of all others.

    f = values + sum_j slopes_j d_j + sum_(i <= j) pairs_ji d_j d_i + at most `rest`,   d = theta - centre           (1)

with |d_j| <= radii_j.  A `Model` holds (1) for n numbers at once; one number is a model of length 1 and combines with
any other.  Sums and products are exact up to the rest, which takes what is of third order, and rounding.

Source: Taylor models of second order, e.g. Makino and Berz, Int. J. Pure Appl. Math. 4, 2003.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import arb

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.jets import Jet, pairs_of

#: relative; above the rounding of a product with all its terms, and of a sum of a few dozen numbers
_ROUNDING, _UP = 2.0**-48, 1.0 + 2.0**-40
_TINY = 1e-280


@dataclass(frozen=True, eq=False)
class Model:
    """(1).

    Args:
        values: shape (n,).
        slopes: shape (p, n).
        pairs: shape (p (p + 1)/2, n), in the order of `pairs_of`.
        rest: shape (n,), at least 0.
        radii: of the box, shape (p,), rounded up.
    """

    values: Array
    slopes: Array
    pairs: Array
    rest: Array
    radii: Array

    @classmethod
    def constant(cls, values: Array, radii: Array) -> Model:
        """Exact numbers, shape (n,)."""
        p, n = len(radii), len(values)
        return cls(values, np.zeros((p, n)), np.zeros((p * (p + 1) // 2, n)), np.zeros(n), radii)

    @cached_property
    def products(self) -> Array:
        """radii_j radii_i of each pair."""
        return np.array([self.radii[j] * self.radii[i] for j, i in pairs_of(len(self.radii))])

    @cached_property
    def linear(self) -> Array:
        """How far the slopes lead, rounded up; shape (n,)."""
        return (self.radii @ np.abs(self.slopes)) * _UP + _TINY

    @cached_property
    def quadratic(self) -> Array:
        """How far the terms of second order lead, rounded up; shape (n,)."""
        return (self.products @ np.abs(self.pairs)) * _UP + _TINY

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """(1) with every axis at its worst: of s d + c d^2 that is an end, or -s^2/(4 c) between them."""
        low, high = self.values.copy(), self.values.copy()
        for row, (j, i) in enumerate(pairs_of(len(self.radii))):
            square = self.pairs[row]
            if i < j:
                reach = np.abs(square) * self.products[row]
                low, high = low - reach, high + reach
                continue
            slope, h = np.abs(self.slopes[j]), self.radii[j]
            ends = (slope * h + square * h * h, -slope * h + square * h * h)
            inside = slope < 2.0 * np.abs(square) * h
            turn = np.where(inside, -(slope**2) / np.where(inside, 4.0 * square, 1.0), 0.0)
            low = low + np.minimum(np.minimum(*ends), turn)
            high = high + np.maximum(np.maximum(*ends), turn)
        off = self.rest * _UP + _ROUNDING * (np.abs(self.values) + self.linear + self.quadratic) + _TINY
        return low - off, high + off

    @property
    def low(self) -> Array:
        """Not above f anywhere in the box; shape (n,)."""
        return self._ends[0]

    @property
    def high(self) -> Array:
        """Not below f anywhere in the box; shape (n,)."""
        return self._ends[1]

    def __getitem__(self, samples: slice) -> Model:
        return Model(
            self.values[samples], self.slopes[:, samples], self.pairs[:, samples], self.rest[samples], self.radii
        )

    def _sum(self, other: Model, sign: float) -> Model:
        sizes = np.abs(self.values) + np.abs(other.values) + self.linear + other.linear
        rounding = _ROUNDING * (sizes + self.quadratic + other.quadratic)
        return Model(
            self.values + sign * other.values,
            self.slopes + sign * other.slopes,
            self.pairs + sign * other.pairs,
            (self.rest + other.rest + rounding) * _UP,
            self.radii,
        )

    def __add__(self, other: Model) -> Model:
        return self._sum(other, 1.0)

    def __sub__(self, other: Model) -> Model:
        return self._sum(other, -1.0)

    def __mul__(self, other: Model) -> Model:
        a, b = self.values, other.values
        pairs = a * other.pairs + b * self.pairs
        for row, (j, i) in enumerate(pairs_of(len(self.radii))):
            pairs[row] += self.slopes[j] * other.slopes[i]
            if i < j:
                pairs[row] += self.slopes[i] * other.slopes[j]
        one, two = self.linear + self.quadratic, other.linear + other.quadratic
        rest = self.linear * other.quadratic + self.quadratic * two
        rest = rest + (np.abs(a) + one + self.rest) * other.rest + (np.abs(b) + two) * self.rest
        rounding = _ROUNDING * (np.abs(a) + one) * (np.abs(b) + two)
        slopes = a * other.slopes + b * self.slopes
        return Model(a * b, slopes, pairs, (rest + rounding) * _UP + _TINY, self.radii)

    def times(self, factors: Array) -> Model:
        """Times exact numbers, shape (n,)."""
        rounding = _ROUNDING * (np.abs(self.values) + self.linear + self.quadratic)
        rest = np.abs(factors) * (self.rest + rounding) * _UP
        return Model(self.values * factors, self.slopes * factors, self.pairs * factors, rest, self.radii)

    def wider(self, by: Array) -> Model:
        """The same with a larger rest; shape (n,), at least 0."""
        return Model(self.values, self.slopes, self.pairs, (self.rest + by) * _UP, self.radii)

    def total(self) -> Model:
        """The sum of all n numbers."""
        many = (len(self.values) + 2) * 2.0**-52
        rounding = many * (np.abs(self.values) + self.linear + self.quadratic).sum()
        rest = np.array([(self.rest.sum() + rounding) * (_UP + many)])
        sums = self.slopes.sum(axis=1)[:, None], self.pairs.sum(axis=1)[:, None]
        return Model(np.array([self.values.sum()]), *sums, rest, self.radii)


def delayed(model: Model, samples: int) -> Model:
    """The signal of a model that many samples later, 0 before; of the same length."""
    count = len(model.values)
    keep = max(count - samples, 0)

    def late(values: Array) -> Array:
        lead = np.zeros((*values.shape[:-1], count - keep))
        return np.concatenate([lead, values[..., :keep]], axis=-1)

    return Model(late(model.values), late(model.slopes), late(model.pairs), late(model.rest), model.radii)


def number_model(over: Jet, centre: Jet, radii: Array, wider: float = 0.0) -> Model:
    """(1) of one number by Taylor's formula, or by its range alone where that is narrower.

    Args:
        over: the number and its derivatives over the box.
        centre: the same at the box's centre.
        radii: of the box.
        wider: added to the rest.
    """
    p = len(radii)
    value, rest = _doubled(centre.value)
    slopes, pairs = np.zeros((p, 1)), np.zeros((p * (p + 1) // 2, 1))
    for axis, slope in enumerate(centre.slopes):
        slopes[axis, 0], off = _doubled(slope)
        rest += off * radii[axis]
    for row, (j, i) in enumerate(pairs_of(p)):
        # d^2 f/2 on the diagonal; a pair stands for both orders
        half = over.pairs[row] / 2 if i == j else over.pairs[row]
        pairs[row, 0], off = _doubled(half)
        rest += off * radii[j] * radii[i]
    found = Model(np.array([value]), slopes, pairs, np.array([rest * _UP + wider]), radii)
    middle, reach = _doubled(over.value)
    if np.isfinite(rest) and found.rest[0] <= reach + wider:
        return found
    return Model.constant(np.array([middle]), radii).wider(np.array([reach * _UP + wider]))


def _doubled(ball: arb) -> tuple[float, float]:
    """A double in a ball, and how far the ball reaches from it."""
    middle = float(ball.mid())
    return middle, float(abs(ball - arb(middle)).upper())
