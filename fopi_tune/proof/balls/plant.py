"""A plant's coefficients over a box of its uncertain numbers, with derivatives by automatic differentiation.

Plant models compute their coefficients with ordinary arithmetic (`PlantModel.assemble`).  Called with dual numbers
(balls with gradients, propagated through + - * /) instead of floats, the same code yields enclosures of the
coefficients and of their derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from flint import acb, arb

from fopi_tune.core.plant import PLANT_MODELS, PlantFamily
from fopi_tune.errors import DomainError


@dataclass(frozen=True)
class Dual:
    """Dual number: a real ball and the balls of its partial derivatives.

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


_ZERO = arb(0)


@dataclass(frozen=True)
class PlantEnclosure:
    """A plant's coefficients over a box of its uncertain numbers; gradients' axes count from 1.

    Args:
        numerator: descending powers.
        denominator: descending powers.
        dead_time: s.
        late: of a plant behind a hold, the factor z^-late.
        gain: a separate factor of the numerator, whose derivative is cheap.
    """

    numerator: tuple[Dual, ...]
    denominator: tuple[Dual, ...]
    dead_time: Dual
    late: int = 0
    gain: Dual = field(default_factory=lambda: Dual.of(1))

    @property
    def has_direct_path(self) -> bool:
        """Whether a plant in s need not be strictly proper."""
        leading = self.numerator[0]
        return len(self.numerator) == len(self.denominator) and not (leading.value.is_zero() and not leading.gradient)


def without_gradient(plant: PlantEnclosure) -> PlantEnclosure:
    """The same coefficients without their derivatives."""
    numerator, denominator = (tuple(Dual(c.value) for c in side) for side in (plant.numerator, plant.denominator))
    return PlantEnclosure(numerator, denominator, Dual(plant.dead_time.value), plant.late, Dual(plant.gain.value))


def assemble(family: PlantFamily, theta: Sequence[arb]) -> PlantEnclosure:
    """The plants whose uncertain numbers lie in these balls.

    Raises:
        DomainError: not proper.
    """
    uncertain = iter(enumerate(theta, 1))
    values: dict[str, Any] = {}
    # in the model's own order, which defines the lists of coefficients
    for name, number in family.parameters.items():
        if number.is_exact:
            values[name] = arb(number.nominal)
        else:
            axis, ball = next(uncertain)
            values[name] = Dual(ball, {axis: arb(1)})
    numerator, denominator, dead_time = PLANT_MODELS[family.model].assemble(values)
    top, bottom = _without_leading_zeros(numerator), _without_leading_zeros(denominator)
    # the tail omega -> inf divides by the denominator's power
    if len(top) > len(bottom):
        raise DomainError("the numerator's degree may exceed the denominator's; a plant must be proper")
    return PlantEnclosure(top, bottom, Dual.of(dead_time))


def _without_leading_zeros(coefficients: Sequence[Any]) -> tuple[Dual, ...]:
    found = [Dual.of(c) for c in coefficients]
    while len(found) > 1 and found[0].value.is_zero() and not found[0].gradient:
        found.pop(0)
    return tuple(found)


def polynomial(coefficients: Sequence[arb], s: acb) -> acb:
    """Horner's rule, descending powers."""
    value = acb(coefficients[0])
    for coefficient in coefficients[1:]:
        value = value * s + coefficient
    return value


def own_derivative(coefficients: Sequence[arb], s: acb) -> acb:
    """s X'(s), descending powers."""
    degree = len(coefficients) - 1
    return polynomial([*((degree - k) * c for k, c in enumerate(coefficients[:-1])), _ZERO], s)
