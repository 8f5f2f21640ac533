"""Matrices of balls with their partial derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, arb_mat

from fopi_tune.proof.balls.plant import Dual


@dataclass(frozen=True)
class DualMatrix:
    """A matrix of `Dual` numbers, as one matrix of values and one of derivatives an axis.

    Args:
        value: the matrix.
        gradient: axis -> derivatives; an axis that is missing has derivatives 0.
    """

    value: arb_mat
    gradient: dict[int, arb_mat]

    @classmethod
    def of(cls, rows: Sequence[Sequence[Dual]]) -> DualMatrix:
        """The matrix of these rows."""
        axes = {axis for row in rows for number in row for axis in number.gradient}
        gradient = {
            axis: arb_mat([[number.gradient.get(axis, arb(0)) for number in row] for row in rows]) for axis in axes
        }
        return cls(arb_mat([[number.value for number in row] for row in rows]), gradient)

    @classmethod
    def identity(cls, size: int) -> DualMatrix:
        """The unit matrix."""
        return cls(arb_mat([[int(i == j) for j in range(size)] for i in range(size)]), {})

    @property
    def size(self) -> int:
        """The number of rows."""
        return self.value.nrows()

    def entry(self, i: int, j: int) -> Dual:
        """One number of it."""
        return Dual(self.value[i, j], {axis: slopes[i, j] for axis, slopes in self.gradient.items()})

    def trace(self) -> Dual:
        """The sum of the diagonal."""
        return Dual(self.value.trace(), {axis: slopes.trace() for axis, slopes in self.gradient.items()})

    def __add__(self, other: DualMatrix) -> DualMatrix:
        return DualMatrix(self.value + other.value, _sums(self.gradient, other.gradient))

    def __sub__(self, other: DualMatrix) -> DualMatrix:
        return self + other * Dual.of(-1)

    def __mul__(self, number: Dual) -> DualMatrix:
        along = {axis: self.value * slope for axis, slope in number.gradient.items()}
        own = {axis: slopes * number.value for axis, slopes in self.gradient.items()}
        return DualMatrix(self.value * number.value, _sums(own, along))

    def __matmul__(self, other: DualMatrix) -> DualMatrix:
        """The product."""
        own = {axis: slopes * other.value for axis, slopes in self.gradient.items()}
        others = {axis: self.value * slopes for axis, slopes in other.gradient.items()}
        return DualMatrix(self.value * other.value, _sums(own, others))


def _sums(one: dict[int, arb_mat], other: dict[int, arb_mat]) -> dict[int, arb_mat]:
    """The sum of two gradients."""
    sums = dict(one)
    for axis, slopes in other.items():
        sums[axis] = sums[axis] + slopes if axis in sums else slopes
    return sums
