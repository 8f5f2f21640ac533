"""A plant's coefficients over a box of its uncertain numbers, with derivatives by automatic differentiation.

Plant models compute their coefficients with ordinary arithmetic (`PlantModel.assemble`).  Called with dual numbers
(balls with gradients, propagated through + - * /) instead of floats, the same code yields enclosures of the
coefficients and of their derivatives.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

from flint import acb, arb, fmpq

from fopi_tune.core.fractional_plants.family import FractionalFamily, fractional_part
from fopi_tune.core.parametric.family import ParametricFamily
from fopi_tune.core.parametric.polynomials import ParameterPolynomial
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.computed_once import computed_once


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
            term = others * slope
            sums[axis] = sums[axis] + term if axis in sums else term
        return sums

    def __add__(self, other: Any) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.value + other, self.gradient)
        return Dual(self.value + other.value, self._combined(other, 1, 1))

    def __sub__(self, other: Any) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.value - other, self.gradient)
        return Dual(self.value - other.value, self._combined(other, 1, -1))

    def __mul__(self, other: Any) -> Dual:
        if not isinstance(other, Dual):
            return Dual(self.value * other, {axis: slope * other for axis, slope in self.gradient.items()})
        return Dual(self.value * other.value, self._combined(other, other.value, self.value))

    def __truediv__(self, other: Any) -> Dual:
        right = Dual.of(other)
        quotient = self.value / right.value
        if not self.gradient and not right.gradient:
            return Dual(quotient)
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


class Polynomial:
    """X, and s X'(s), of which every frequency of a plant asks; the coefficients are prepared once.

    Args:
        values: coefficients, descending powers.
    """

    def __init__(self, values: Sequence[arb]) -> None:
        self.values, self.degree = values, len(values) - 1

    @computed_once
    def reversed(self) -> Polynomial:
        """s^degree X(1/s)."""
        return Polynomial(self.values[::-1])

    @computed_once
    def _own(self) -> list[arb]:
        return [*((self.degree - k) * c for k, c in enumerate(self.values[:-1])), _ZERO]

    def at(self, s: acb) -> acb:
        """X(s)."""
        return polynomial(self.values, s)

    def own_derivative(self, s: acb) -> acb:
        """s X'(s)."""
        return polynomial(self._own, s)

    def own_curvature(self, s: acb) -> acb:
        """s (s X')'."""
        return polynomial([*((self.degree - k) ** 2 * c for k, c in enumerate(self.values[:-1])), _ZERO], s)


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

    @computed_once
    def top(self) -> Polynomial:
        """The numerator without its derivatives."""
        return Polynomial([c.value for c in self.numerator])

    @computed_once
    def bottom(self) -> Polynomial:
        """The denominator without its derivatives."""
        return Polynomial([c.value for c in self.denominator])

    @property
    def numerator_orders(self) -> tuple[Any, ...]:
        """The powers of s of the numerator's coefficients."""
        return tuple(range(len(self.numerator) - 1, -1, -1))

    @property
    def denominator_orders(self) -> tuple[Any, ...]:
        """The powers of s of the denominator's coefficients; the first is the degree."""
        return tuple(range(len(self.denominator) - 1, -1, -1))

    @property
    def has_equal_degrees(self) -> bool:
        """Whether the numerator's highest power is the denominator's."""
        return len(self.numerator) == len(self.denominator)

    @property
    def has_direct_path(self) -> bool:
        """Whether a plant in s need not be strictly proper."""
        leading = self.numerator[0]
        return self.has_equal_degrees and not (leading.value.is_zero() and not leading.gradient)

    @property
    def at_zero(self) -> tuple[arb, arb]:
        """N(0) and D(0)."""
        return self.numerator[-1].value, self.denominator[-1].value


@dataclass(frozen=True)
class FractionalEnclosure(PlantEnclosure):
    """The coefficients of a fractional plant's terms, by falling order.

    Args:
        orders: of the numerator's terms, and of the denominator's; exact.
    """

    orders: tuple[tuple[arb, ...], tuple[arb, ...]] = ((), ())

    @classmethod
    def of(cls, family: FractionalFamily, values: Mapping[str, Any]) -> FractionalEnclosure:
        """The plants whose numbers are `values`."""
        top, bottom, dead_time = family.terms(values)
        numerator, denominator = (tuple(Dual.of(c) for c in side) for side in (top, bottom))
        orders = family.orders
        return cls(
            numerator, denominator, Dual.of(dead_time),
            orders=(tuple(map(arb, orders.numerator)), tuple(map(arb, orders.denominator))),
        )  # fmt: skip

    @property
    def numerator_orders(self) -> tuple[Any, ...]:
        return self.orders[0]

    @property
    def denominator_orders(self) -> tuple[Any, ...]:
        return self.orders[1]

    @property
    def has_equal_degrees(self) -> bool:
        return bool(self.orders[0][0] == self.orders[1][0])

    @property
    def at_zero(self) -> tuple[arb, arb]:
        sides = zip((self.numerator, self.denominator), self.orders, strict=True)
        n, d = (side[-1].value if orders[-1].is_zero() else arb(0) for side, orders in sides)
        return n, d

    def filtered(self, bottom: Polynomial) -> FractionalEnclosure:
        """F P, `bottom` being 1/F; sums of doubles and small whole numbers are exact."""
        terms = [
            (order + (bottom.degree - i), coefficient * number)
            for order, coefficient in zip(self.orders[1], self.denominator, strict=True)
            for i, number in enumerate(bottom.values)
        ]
        terms.sort(key=lambda term: -float(term[0]))
        product = tuple(coefficient for _, coefficient in terms)
        return replace(self, denominator=product, orders=(self.orders[0], tuple(order for order, _ in terms)))


def without_gradient(plant: PlantEnclosure) -> PlantEnclosure:
    """The same coefficients without their derivatives."""
    numerator, denominator = (tuple(Dual(c.value) for c in side) for side in (plant.numerator, plant.denominator))
    dead_time, gain = Dual(plant.dead_time.value), Dual(plant.gain.value)
    return replace(plant, numerator=numerator, denominator=denominator, dead_time=dead_time, gain=gain)


def without_axes(plant: PlantEnclosure, axes: Collection[int]) -> PlantEnclosure:
    """The same coefficients without their derivatives along some axes, along which a box has no width.

    The dead time keeps its own: whether it is uncertain in the family decides how it is rounded to whole samples.
    """

    def kept(c: Dual) -> Dual:
        return Dual(c.value, {axis: slope for axis, slope in c.gradient.items() if axis not in axes})

    numerator, denominator = (tuple(kept(c) for c in side) for side in (plant.numerator, plant.denominator))
    return replace(plant, numerator=numerator, denominator=denominator, gain=kept(plant.gain))


def rational(value: Fraction) -> arb:
    """A rational number as a ball."""
    return arb(fmpq(value.numerator, value.denominator))


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
    if (fractional := fractional_part(family)) is not None:
        return FractionalEnclosure.of(fractional, values)
    numerator, denominator, dead_time = family.assemble(values, rational)
    if isinstance(family, ParametricFamily):
        numerator = [_between_ends(p, c, theta) for p, c in zip(family.numerator, numerator, strict=True)]
        denominator = [_between_ends(p, c, theta) for p, c in zip(family.denominator, denominator, strict=True)]
    top, bottom = _without_leading_zeros(numerator), _without_leading_zeros(denominator)
    # the tail omega -> inf divides by the denominator's power
    if len(top) > len(bottom):
        raise DomainError("the numerator's degree may exceed the denominator's; a plant must be proper")
    return PlantEnclosure(top, bottom, Dual.of(dead_time))


def filtered(plant: PlantEnclosure, bottom: Polynomial | None) -> PlantEnclosure:
    """F P, `bottom` being 1/F; None is 1."""
    if bottom is None:
        return plant
    if isinstance(plant, FractionalEnclosure):
        return plant.filtered(bottom)
    product = [Dual.of(0)] * (len(plant.denominator) + bottom.degree)
    for k, coefficient in enumerate(plant.denominator):
        for i, number in enumerate(bottom.values):
            product[k + i] = product[k + i] + coefficient * number
    return replace(plant, denominator=tuple(product))


def _between_ends(polynomial: ParameterPolynomial, coefficient: Any, theta: Sequence[arb]) -> Any:
    """The coefficient, whose terms may cancel, between its values at the ends of axes along which it is monotone."""
    if not isinstance(coefficient, Dual) or all(value > 0 for _, value in polynomial.terms):
        return coefficient
    least, most = list(theta), list(theta)
    for axis, slope in coefficient.gradient.items():
        ball = theta[axis - 1]
        # balls that hold the ends, which may need more digits
        ends = ball.mid() - ball.rad(), ball.mid() + ball.rad()
        if slope >= 0:
            least[axis - 1], most[axis - 1] = ends
        elif slope <= 0:
            most[axis - 1], least[axis - 1] = ends
    between = polynomial.at(least, rational).union(polynomial.at(most, rational))
    return Dual(coefficient.value.intersection(between), coefficient.gradient)


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
