"""Numbers with their first and second derivatives in ball arithmetic, by automatic differentiation.

Plant models compute their coefficients with ordinary arithmetic (`PlantModel.assemble`); called with jets, the same
code yields enclosures of the coefficients and of their derivatives over a box of uncertain numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from flint import arb

from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.plant import rational

#: value, first and second derivative of a function of one number
Derivatives = tuple[arb, arb, arb]


@dataclass(frozen=True, eq=False)
class Jet:
    """A ball and the balls of its derivatives.

    Args:
        value: the number.
        slopes: d/d theta_j.
        pairs: d^2/(d theta_j d theta_i), in the order of `pairs_of`.
    """

    value: arb
    slopes: tuple[arb, ...]
    pairs: tuple[arb, ...]

    @classmethod
    def constant(cls, number: Any, axes: int) -> Jet:
        """A number that is the same for all plants."""
        return cls(arb(number), (arb(0),) * axes, (arb(0),) * (axes * (axes + 1) // 2))

    @property
    def is_zero(self) -> bool:
        """Whether it is 0 for all plants."""
        return self.value.is_zero() and self.is_constant

    @property
    def is_constant(self) -> bool:
        """Whether it is the same for all plants."""
        return all(slope.is_zero() for slope in self.slopes)

    def _of(self, other: Any) -> Jet:
        return other if isinstance(other, Jet) else Jet.constant(other, len(self.slopes))

    def __add__(self, other: Any) -> Jet:
        right = self._of(other)
        return Jet(self.value + right.value, _sums(self.slopes, right.slopes), _sums(self.pairs, right.pairs))

    def __neg__(self) -> Jet:
        return Jet(-self.value, tuple(-x for x in self.slopes), tuple(-x for x in self.pairs))

    def __sub__(self, other: Any) -> Jet:
        return self + (-self._of(other))

    def __mul__(self, other: Any) -> Jet:
        if not isinstance(other, Jet):
            factor = arb(other)
            return Jet(
                self.value * factor, tuple(x * factor for x in self.slopes), tuple(x * factor for x in self.pairs)
            )
        a, b = self.value, other.value
        slopes = tuple(a * y + b * x for x, y in zip(self.slopes, other.slopes, strict=True))
        mixed = (self.slopes[j] * other.slopes[i] + self.slopes[i] * other.slopes[j] for j, i in pairs_of(len(slopes)))
        pairs = tuple(
            a * y + b * x + both for x, y, both in zip(self.pairs, other.pairs, mixed, strict=True)
        )  # fmt: skip
        return Jet(a * b, slopes, pairs)

    def __truediv__(self, other: Any) -> Jet:
        if not isinstance(other, Jet):
            return self * (1 / arb(other))
        inverse = 1 / other.value
        return self * other.through(lambda x: (inverse, -(inverse**2), 2 * inverse**3))

    def __radd__(self, other: Any) -> Jet:
        return self + other

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __rmul__(self, other: Any) -> Jet:
        return self * other

    def __rtruediv__(self, other: Any) -> Jet:
        return self._of(other) / self

    def through(self, function: Callable[[arb], Derivatives]) -> Jet:
        """A function of it."""
        value, first, second = function(self.value)
        squares = (self.slopes[j] * self.slopes[i] for j, i in pairs_of(len(self.slopes)))
        pairs = tuple(first * x + second * y for x, y in zip(self.pairs, squares, strict=True))
        return Jet(value, tuple(first * x for x in self.slopes), pairs)

    def exp(self) -> Jet:
        """e to it."""
        value = self.value.exp()
        return self.through(lambda x: (value, value, value))


def pairs_of(axes: int) -> list[tuple[int, int]]:
    """(j, i) with i <= j, in the order in which terms of second order are kept."""
    return [(j, i) for j in range(axes) for i in range(j + 1)]


def _sums(one: Sequence[arb], other: Sequence[arb]) -> tuple[arb, ...]:
    return tuple(x + y for x, y in zip(one, other, strict=True))


def assemble_jets(family: PlantFamily, theta: Sequence[arb]) -> tuple[list[Jet], list[Jet], Jet]:
    """Numerator and denominator without leading zeros, and dead time, with the uncertain numbers in these balls."""
    axes, uncertain = len(theta), iter(enumerate(theta))
    values: dict[str, Any] = {}
    # in the model's own order, which defines the lists of coefficients
    for name, number in family.parameters.items():
        if number.is_exact:
            values[name] = Jet.constant(number.nominal, axes)
        else:
            axis, ball = next(uncertain)
            slopes = tuple(arb(int(j == axis)) for j in range(axes))
            values[name] = Jet(ball, slopes, (arb(0),) * (axes * (axes + 1) // 2))
    numerator, denominator, dead_time = family.assemble(values, lambda value: Jet.constant(rational(value), axes))

    def trimmed(coefficients: Sequence[Any]) -> list[Jet]:
        found = [c if isinstance(c, Jet) else Jet.constant(c, axes) for c in coefficients]
        while len(found) > 1 and found[0].is_zero:
            found.pop(0)
        return found

    late = dead_time if isinstance(dead_time, Jet) else Jet.constant(dead_time, axes)
    return trimmed(numerator), trimmed(denominator), late
