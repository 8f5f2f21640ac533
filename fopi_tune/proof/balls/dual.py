"""First derivatives of a plant's coefficients:  a ball with its gradient, carried through + - * /.

Plant models make their coefficients from their numbers with ordinary arithmetic (`PlantModel.assemble`); given duals
instead of floats, the same code yields enclosures of the coefficients and of their derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flint import arb


@dataclass(frozen=True)
class Dual:
    """A real ball and the balls of its partial derivatives.

    Args:
        value: the number.
        gradient: axis -> derivative; an axis that is missing has derivative 0.
    """

    value: arb
    gradient: Mapping[int, arb] = field(default_factory=dict)

    @classmethod
    def of(cls, number: Any) -> Dual:
        """The number itself, or a constant."""
        return number if isinstance(number, Dual) else cls(arb(number))

    def _combined(self, other: Dual, own: Any, others: Any) -> dict[int, arb]:
        """own * gradient + others * gradient of the other."""
        sums = {axis: own * slope for axis, slope in self.gradient.items()}
        for axis, slope in other.gradient.items():
            sums[axis] = sums.get(axis, arb(0)) + others * slope
        return sums

    def __add__(self, other: Any) -> Dual:
        right = Dual.of(other)
        return Dual(self.value + right.value, self._combined(right, 1, 1))

    def __sub__(self, other: Any) -> Dual:
        right = Dual.of(other)
        return Dual(self.value - right.value, self._combined(right, 1, -1))

    def __mul__(self, other: Any) -> Dual:
        right = Dual.of(other)
        return Dual(self.value * right.value, self._combined(right, right.value, self.value))

    def __truediv__(self, other: Any) -> Dual:
        right = Dual.of(other)
        quotient = self.value / right.value
        return Dual(quotient, self._combined(right, 1 / right.value, -quotient / right.value))

    def __neg__(self) -> Dual:
        return Dual(-self.value, {axis: -slope for axis, slope in self.gradient.items()})

    def __radd__(self, other: Any) -> Dual:
        return self + other

    def __rsub__(self, other: Any) -> Dual:
        return -self + other

    def __rmul__(self, other: Any) -> Dual:
        return self * other

    def __rtruediv__(self, other: Any) -> Dual:
        return Dual.of(other) / self
