"""A family by named parameters:  P(s) = N(s)/D(s) e^{-dead_time_s s}, the coefficients polynomials in them.

A parameter may occur in several coefficients, which are then linked: the family is the box of the parameters, not the
larger box of the coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parametric.polynomials import ParameterPolynomial
from fopi_tune.core.plant import Assembled, PlantFamily, Uncertain
from fopi_tune.errors import DomainError

#: what stands for the model: the coefficients are what the spec makes of its parameters
EXPRESSIONS = "expressions"


@dataclass(frozen=True)
class ParametricFamily(PlantFamily):
    """Every plant whose parameters lie in their ranges; the polynomials are in the uncertain ones, in their order.

    Args:
        numerator: coefficients of N in descending powers of s; the first is not 0 everywhere.
        denominator: coefficients of D in descending powers of s; the first is 0 nowhere in the box.
        dead_time_s: a number, or one of the parameters.

    Raises:
        DomainError: not proper, or another dead time.
    """

    numerator: tuple[ParameterPolynomial, ...]
    denominator: tuple[ParameterPolynomial, ...]
    dead_time_s: ParameterPolynomial

    def __post_init__(self) -> None:
        axes = len(self.uncertain_names)
        every = (*self.numerator, *self.denominator, self.dead_time_s)
        if self.model != EXPRESSIONS or any(each.axes != axes for each in every):
            raise DomainError("coefficients must be polynomials in the uncertain parameters")
        if not self.numerator or not self.denominator or len(self.numerator) > len(self.denominator):
            raise DomainError("the numerator's degree exceeds the denominator's; a plant must be proper")
        if self.denominator[0].is_zero:
            raise DomainError("the denominator's first coefficient is 0; leave leading zeros out")
        if self.dead_time_s.value is None and self.dead_time_s.axis is None:
            raise DomainError("dead_time_s must be a number or one of the parameters")

    @classmethod
    def of(
        cls,
        parameters: Mapping[str, Uncertain],
        numerator: Sequence[ParameterPolynomial],
        denominator: Sequence[ParameterPolynomial],
        dead_time_s: ParameterPolynomial,
    ) -> ParametricFamily:
        """The family without the leading zeros of its numerator."""
        top = list(numerator)
        while len(top) > 1 and top[0].is_zero:
            top.pop(0)
        return cls(EXPRESSIONS, parameters, tuple(top), tuple(denominator), dead_time_s)

    def problem(self, name: str, value: Uncertain) -> str | None:
        return None  # what a parameter may be depends on the others: `refused`

    @property
    def dead_time(self) -> Uncertain:
        axis = self.dead_time_axis
        if axis is None:
            return Uncertain.exactly(float(self.dead_time_s.value or 0))
        return self.parameters[self.uncertain_names[axis]]

    @property
    def dead_time_axis(self) -> int | None:
        return self.dead_time_s.axis

    @property
    def is_strictly_proper(self) -> bool:
        return all(each.is_zero for each in self.numerator) or len(self.numerator) < len(self.denominator)

    @property
    def is_affine_in_each_number(self) -> bool:
        return bool(np.all(self.powers <= 1))

    def refused(self, points: Array) -> NDArray[np.bool_]:
        """Points outside of the box may have no plant: no numerator, another degree or sign of D, a negative delay."""
        top, bottom, dead_time = self.coefficients(points)
        _, inside, _ = self.coefficients(self.nominal_point[None, :])
        same_sign = bottom[:, 0] * np.sign(inside[0, 0]) > 0.0
        return ~same_sign | ~np.any(top != 0.0, axis=1) | (dead_time < 0.0)

    def why_refused(self, point: Array) -> str | None:
        if not self.refused(point[None, :])[0]:
            return None
        top, _, dead_time = self.coefficients(point[None, :])
        if dead_time[0] < 0.0:
            return f"dead_time_s = {float(dead_time[0])!r} must be at least 0; a plant cannot answer before it is asked"
        if not top.any():
            return "the numerator is 0: there is no plant to control"
        return "the denominator's first coefficient is 0, or has not the sign that it has in the family"

    def assemble(self, values: Mapping[str, Any], number: Callable[[Fraction], Any] = float) -> Assembled:
        parameters = [values.get(name, self.parameters[name].nominal) for name in self.uncertain_names]
        top, bottom = ([each.at(parameters, number) for each in side] for side in (self.numerator, self.denominator))
        return top, bottom, self.dead_time_s.at(parameters, number)

    @cached_property
    def powers(self) -> NDArray[np.int64]:
        """The powers that occur in any coefficient, shape (t, p)."""
        every = (*self.numerator, *self.denominator, self.dead_time_s)
        found = sorted({powers for each in every for powers, _ in each.terms})
        return np.array(found, dtype=np.int64).reshape(len(found), len(self.uncertain_names))

    def terms(self) -> tuple[Array, Array, Array]:
        """Of numerator (t, a), denominator (t, b) and dead time (t,) what multiplies each row of `powers`."""
        row_of = {tuple(row): k for k, row in enumerate(self.powers.tolist())}

        def table(column: Sequence[ParameterPolynomial]) -> Array:
            found = np.zeros((len(row_of), len(column)))
            for k, each in enumerate(column):
                for powers, value in each.terms:
                    found[row_of[powers], k] = float(value)
            return found

        return table(self.numerator), table(self.denominator), table([self.dead_time_s])[:, 0]
