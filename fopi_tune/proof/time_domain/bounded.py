"""Signals and causal operators over K samples in floating point, each with a proved bound of its error.

A signal is a column of samples with a bound of its error at every sample; an operator is a lower triangular matrix with
a bound of its error in the norm  |A| = max_k sum_j |a_kj|,  which is induced by the largest sample of a signal.  An
operator that is the same at every sample is a power series in the delay of one sample, and |A| the sum of its terms.

Every sum of products of n terms, in any order and with or without fused operations, differs from its value by at most

    gamma_n sum |a_i| |b_i|,      gamma_n = n u/(1 - n u),    u = 2^-53 .                                            (1)

An inverse is not trusted but tested: X is a computed inverse of A and R = I - A X, |R| < 1; then

    |A^-1 - X| <= |X| |R|/(1 - |R|) .                                                                                (2)

Source: (1) Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., 2002, section 3.1; (2) Rump, Verification
methods, Acta Numerica 19, 2010, section 10.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fopi_tune.core.bode_form import Array

#: unit roundoff of a double
_U = 2.0**-53
#: samples from which on a power series is not written as a matrix
_LONG = 1_000
#: what underflow can take from a sum of products
_TINY = 1e-280


Number = TypeVar("Number", float, Array)


def above(number: Number, terms: int = 0) -> Number:
    """Not below the exact value of a sum of products of nonnegative numbers, of a few dozens or `terms` more."""
    return number * (1.0 + (64 + 2 * terms) * _U) + _TINY


def gamma(terms: int) -> float:
    """gamma_n of (1), a little larger."""
    return 1.01 * (terms + 2) * _U


@dataclass(frozen=True, eq=False)
class Signals:
    """m signals.

    Args:
        values: shape (K, m).
        errors: how far each may be from the true one at any sample, shape (m,).
    """

    values: Array
    errors: Array

    @classmethod
    def exactly(cls, values: Array) -> Signals:
        """Signals without an error, shape (K, m)."""
        return cls(values, np.zeros(values.shape[1]))

    @cached_property
    def sizes(self) -> Array:
        """The largest |sample| of the true signals, rounded up; shape (m,)."""
        return above(1.0) * (np.abs(self.values).max(axis=0, initial=0.0) + self.errors)

    def __len__(self) -> int:
        return self.values.shape[1]

    def __getitem__(self, columns: slice) -> Signals:
        return Signals(self.values[:, columns], self.errors[columns])

    def __add__(self, other: Signals) -> Signals:
        values = self.values + other.values
        return Signals(values, above(1.0) * (self.errors + other.errors + 2 * _U * (self.sizes + other.sizes)))

    def __sub__(self, other: Signals) -> Signals:
        return self + Signals(-other.values, other.errors)

    def times(self, factors: Array) -> Signals:
        """Each sample times the factor of its time, exact and at most 1 in size; shape (K,)."""
        return Signals(self.values * factors[:, None], above(1.0) * (self.errors + 2 * _U * self.sizes))

    @staticmethod
    def beside(parts: Sequence[Signals]) -> Signals:
        """All of them."""
        return Signals(np.hstack([p.values for p in parts]), np.concatenate([p.errors for p in parts]))


@dataclass(frozen=True, eq=False)
class Delays:
    """A short polynomial in the delay of one sample:  sum_i values_i x^(first + i),  exact.

    Args:
        values: shape (n,).
        first: power of the first.
    """

    values: Array
    first: int = 0

    @cached_property
    def norm(self) -> float:
        """|A|, rounded up."""
        return above(float(np.abs(self.values).sum()))

    def apply(self, signals: Signals) -> Signals:
        """The operator on signals."""
        found = np.zeros_like(signals.values)
        for power, value in enumerate(self.values, self.first):
            if value and power < len(found):
                found[power:] += value * signals.values[: len(found) - power]
        return Signals(found, above(self.norm) * (signals.errors + gamma(len(self.values) + 1) * signals.sizes))

    def series(self, count: int) -> Array:
        """The coefficients of x^0 to x^(count - 1)."""
        found = np.zeros(count)
        stop = min(self.first + len(self.values), count)
        if stop > self.first:
            found[self.first : stop] = self.values[: stop - self.first]
        return found


@dataclass(frozen=True, eq=False)
class Causal:
    """A causal operator.

    Args:
        terms: a power series, shape (K,), or a lower triangular matrix, shape (K, K).
        error: |A - terms|.
    """

    terms: Array
    error: float = 0.0

    @property
    def steady(self) -> bool:
        """Whether it is the same at every sample."""
        return self.terms.ndim == 1

    @cached_property
    def matrix(self) -> Array:
        """The terms as a matrix, shape (K, K)."""
        if not self.steady:
            return self.terms
        count = len(self.terms)
        padded = np.concatenate([np.zeros(count - 1), self.terms])
        return np.ascontiguousarray(sliding_window_view(padded, count)[:, ::-1])

    @cached_property
    def norms(self) -> Array:
        """|A| over the samples up to each one, which are all that a sample depends on, rounded up; shape (K,)."""
        sizes = np.abs(self.terms)
        sums = np.cumsum(sizes) if self.steady else np.maximum.accumulate(sizes.sum(axis=1))
        return above(sums + self.error, len(self.terms))

    @property
    def norm(self) -> float:
        """|A|, rounded up."""
        return float(self.norms[-1])

    def apply(self, signals: Signals) -> Signals:
        """The operator on signals."""
        count = len(self.terms)
        if self.steady and count > _LONG:
            columns = [np.convolve(self.terms, column)[:count] for column in signals.values.T]
            found = np.array(columns, dtype=float).reshape(len(columns), count).T
        else:
            found = self.matrix @ signals.values
        rounding = gamma(len(found)) * signals.sizes
        return Signals(found, above(self.norm) * (signals.errors + rounding) + above(self.error) * signals.sizes)

    def after(self, other: Causal) -> Causal:
        """The product: first the other one."""
        if self.steady and other.steady:
            terms = np.convolve(self.terms, other.terms)[: len(self.terms)]
        else:
            terms = self.matrix @ other.matrix
        rounding = gamma(len(self.terms)) * self.norm * other.norm
        return Causal(terms, above(rounding + self.error * other.norm + other.error * self.norm))

    def after_delays(self, other: Delays) -> Causal:
        """The product: first the short one."""
        if self.steady:
            return self.after(Causal(other.series(len(self.terms))))
        terms, count = np.zeros_like(self.terms), len(self.terms)
        for power, value in enumerate(other.values, other.first):
            if value and power < count:
                terms[:, : count - power] += value * self.terms[:, power:]
        return Causal(terms, above(self.error * other.norm + gamma(len(other.values) + 1) * self.norm * other.norm))

    def delayed(self, other: Delays) -> Causal:
        """The product: the short one last."""
        if self.steady:
            return self.after_delays(other)
        terms, count = np.zeros_like(self.terms), len(self.terms)
        for power, value in enumerate(other.values, other.first):
            if value and power < count:
                terms[power:] += value * self.terms[: count - power]
        return Causal(terms, above(self.error * other.norm + gamma(len(other.values) + 1) * self.norm * other.norm))

    def __add__(self, other: Causal) -> Causal:
        both = self.steady and other.steady
        terms = self.terms + other.terms if both else self.matrix + other.matrix
        return Causal(terms, above(self.error + other.error + 2 * _U * (self.norm + other.norm)))

    def plus_delays(self, other: Delays) -> Causal:
        """The sum with a short one."""
        return self + Causal(other.series(len(self.terms)))

    def scaled(self, rows: Array) -> Causal:
        """Each sample of the result times its factor, exact and at most 1 in size; shape (K,)."""
        return Causal(rows[:, None] * self.matrix, above(self.error + 2 * _U * self.norm))

    def inverse(self) -> Causal | None:
        """The inverse of an operator whose first term at every sample is about 1; None where (2) does not show one."""
        count = len(self.terms)
        with np.errstate(all="ignore"):
            if self.steady:
                found = _series_inverse(self.terms)
                rest = -np.convolve(self.terms, found)[:count]
                rest[0] += 1.0
                size = float(np.abs(rest).sum())
            else:
                found = _triangular_inverse(self.terms)
                rest = np.eye(count) - self.terms @ found
                size = float(np.abs(rest).sum(axis=1).max())
            result = Causal(found)
            size += (gamma(count + 1) * (self.norm + 1.0) + self.error) * (result.norm + 1.0)
            size = above(size, count)
            if not (math.isfinite(size) and size < 0.5):
                return None
            return Causal(found, above(result.norm * size / (1.0 - size)))


def _series_inverse(terms: Array) -> Array:
    """1/series by Newton's iteration, which doubles the number of right terms."""
    count, right = len(terms), 1
    found = np.array([1.0 / terms[0]])
    while right < count:
        right = min(2 * right, count)
        rest = -np.convolve(terms[:right], found)[:right]
        rest[0] += 1.0
        found = np.pad(found, (0, right - len(found))) + np.convolve(found, rest)[:right]
    rest = -np.convolve(terms, found)[:count]
    rest[0] += 1.0
    return found + np.convolve(found, rest)[:count]


def _triangular_inverse(matrix: Array) -> Array:
    """By halves: large products are fast."""
    count = len(matrix)
    if count <= 32:
        return np.asarray(np.tril(np.linalg.inv(matrix)), dtype=float)
    half = count // 2
    one, two = _triangular_inverse(matrix[:half, :half]), _triangular_inverse(matrix[half:, half:])
    found = np.zeros_like(matrix)
    found[:half, :half], found[half:, half:] = one, two
    found[half:, :half] = -two @ (matrix[half:, :half] @ one)
    return found
