"""A plant's coefficients over a box of its uncertain numbers, with their derivatives, and its polynomials' values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from flint import acb, arb

from fopi_tune.core.plant import PLANT_MODELS, PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.dual import Dual

_ZERO = arb(0)


@dataclass(frozen=True)
class PlantBalls:
    """A plant's coefficients over a box of its uncertain numbers; gradients' axes count from 1.

    Args:
        numerator: descending powers.
        denominator: descending powers.
        dead_time: s.
        late: of a plant behind a hold, the factor z^-late.
        gain: a factor of the numerator that is kept apart, so that its derivative costs nothing.
    """

    numerator: tuple[Dual, ...]
    denominator: tuple[Dual, ...]
    dead_time: Dual
    late: int = 0
    gain: Dual = field(default_factory=lambda: Dual.of(1))


def assemble(family: PlantFamily, theta: Sequence[arb]) -> PlantBalls:
    """The plants whose uncertain numbers lie in these balls.

    Raises:
        DomainError: not proper.
    """
    uncertain = iter(enumerate(theta, 1))
    values: dict[str, Any] = {}
    # in the model's own order: lists of coefficients are read off by it
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
    return PlantBalls(top, bottom, Dual.of(dead_time))


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
