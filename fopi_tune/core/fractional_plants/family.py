"""Families of fractional plants:  P(s) = sum b_j s^beta_j / sum a_i s^alpha_i e^{-dead_time_s s}.

The powers are those of the principal branch, |arg s| < pi.  The orders are exact, the coefficients may be uncertain.
With whole orders alone P is a transfer function: such a family has the coefficients of polynomials and is treated as
one everywhere.  Of any other family nothing may take the coefficients for those of polynomials: `coefficients` refuses,
`terms` has them with their orders.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.fractional_plants.orders import Orders, refuse_fractional
from fopi_tune.core.fractional_plants.plants import FractionalPlant, FractionalPlants
from fopi_tune.core.plant import Assembled, Plant, PlantFamily, Uncertain
from fopi_tune.errors import DomainError

#: what stands for the model
FRACTIONAL = "fractional"
#: why a loop on samples is not known
ON_SAMPLES = (
    "behind a hold a fractional plant remembers all of its past, and no recursion of finite length is equal to it"
)
_DEAD_TIME = "dead_time_s"


@dataclass(frozen=True)
class FractionalFamily(PlantFamily):
    """Every fractional plant whose coefficients and dead time lie in their ranges.

    The numbers are called numerator[i].coefficient and denominator[i].coefficient, i as the terms are written, and
    dead_time_s.

    Args:
        numerator_orders: of the terms as they are written, in any order.
        denominator_orders: the same of the denominator.

    Raises:
        DomainError: as of `Orders`.
    """

    numerator_orders: tuple[float, ...]
    denominator_orders: tuple[float, ...]

    def __post_init__(self) -> None:
        expected = [f"{name}[{k}].coefficient" for name, side in self._written for k in range(len(side))]
        if self.model != FRACTIONAL or list(self.parameters) != [*expected, _DEAD_TIME]:
            raise DomainError("the numbers of a fractional family are its terms' coefficients and dead_time_s")
        _ = self.orders

    @classmethod
    def of(
        cls,
        numerator: Sequence[tuple[Uncertain, float]],
        denominator: Sequence[tuple[Uncertain, float]],
        dead_time_s: Uncertain,
    ) -> FractionalFamily:
        """The family.

        Args:
            numerator: coefficient and order of each term, in any order.
            denominator: the same.
            dead_time_s: s.

        Raises:
            DomainError: as of `Orders`.
        """
        sides = {"numerator": numerator, "denominator": denominator}
        numbers = {
            f"{name}[{k}].coefficient": value for name, side in sides.items() for k, (value, _) in enumerate(side)
        }
        tops, bottoms = (tuple(float(order) for _, order in side) for side in (numerator, denominator))
        return cls(FRACTIONAL, {**numbers, _DEAD_TIME: dead_time_s}, tops, bottoms)

    @property
    def _written(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        return ("numerator", self.numerator_orders), ("denominator", self.denominator_orders)

    @property
    def orders(self) -> Orders:
        """The orders by size."""
        top, bottom = (tuple(sorted(side, reverse=True)) for _, side in self._written)
        return Orders(top, bottom)

    @property
    def is_transfer_function(self) -> bool:
        """Whether all orders are whole, so that the plants are transfer functions."""
        return self.orders.are_whole

    def problem(self, name: str, value: Uncertain) -> str | None:
        if name == _DEAD_TIME and value.min < 0:
            return "must be at least 0; a plant cannot answer before it is asked"
        leading = self.denominator_orders.index(self.orders.denominator[0])
        if name == f"denominator[{leading}].coefficient" and value.min <= 0 <= value.max:
            return "must not be or contain 0: it is that of the highest order; the family's sign must be known"
        return None

    @property
    def is_strictly_proper(self) -> bool:
        """Whether |P| -> 0 as omega -> inf for every member."""
        present = [
            order
            for k, order in enumerate(self.numerator_orders)
            if (number := self.parameters[f"numerator[{k}].coefficient"]).min != 0.0 or number.max != 0.0
        ]
        return max(present, default=-1.0) < self.orders.denominator[0]

    def assemble(self, values: Mapping[str, Any], number: Callable[[Fraction], Any] = float) -> Assembled:
        """The coefficients of polynomials, of whole orders alone.

        Raises:
            DomainError: another order.
        """
        if not self.is_transfer_function:
            refuse_fractional("this computation", "it takes polynomials in s")
        top, bottom, dead_time = self.terms(values)
        orders = self.orders
        return _dense(top, orders.numerator), _dense(bottom, orders.denominator), dead_time

    def terms(self, values: Mapping[str, Any]) -> Assembled:
        """Coefficients of the terms as `orders` has them, and the dead time, from `values` of the uncertain numbers."""
        full = {name: values.get(name, number.nominal) for name, number in self.parameters.items()}

        def side(name: str, orders: tuple[float, ...]) -> list[Any]:
            falling = sorted(range(len(orders)), key=lambda k: -orders[k])
            return [full[f"{name}[{k}].coefficient"] for k in falling]

        top, bottom = (side(name, orders) for name, orders in self._written)
        return top, bottom, full[_DEAD_TIME]

    def tables(self, points: Array) -> tuple[Array, Array, Array]:
        """Coefficients of the terms of many members.

        Args:
            points: shape (m, p), points of the box, columns as `uncertain_names`.

        Returns:
            numerators (m, a), denominators (m, b) by falling order, dead times (m,) in s.
        """
        top, bottom, dead_time = self.terms(dict(zip(self.uncertain_names, points.T, strict=True)))
        ones = np.ones(len(points))
        sides = [np.column_stack([ones * entry for entry in side]) for side in (top, bottom)]
        return sides[0], sides[1], ones * dead_time

    def batch(self, points: Array, kind: Callable[[Array, Array, Array], Any]) -> Any:
        """As of `PlantFamily`; the batch of an order that is not whole is `FractionalPlants`."""
        if self.is_transfer_function:
            return super().batch(points, kind)
        return FractionalPlants(*self.tables(points), self.orders)

    def member(self, point: Array) -> Plant:
        """The plant at one `point` of the box, shape (p,)."""
        if self.is_transfer_function:
            return super().member(point)
        top, bottom, dead_time = self.tables(np.asarray(point, dtype=float)[None, :])
        return FractionalPlant(tuple(top[0].tolist()), tuple(bottom[0].tolist()), float(dead_time[0]), self.orders)


def _dense(coefficients: Sequence[Any], orders: Sequence[float]) -> list[Any]:
    """Coefficients of whole orders as those of a polynomial, descending powers."""
    found: list[Any] = [0.0] * (int(orders[0]) + 1)
    for order, coefficient in zip(orders, coefficients, strict=True):
        found[int(orders[0]) - int(order)] = coefficient
    return found


def fractional_part(family: PlantFamily) -> FractionalFamily | None:
    """The family if some order of it is not whole, else None."""
    return family if isinstance(family, FractionalFamily) and not family.is_transfer_function else None


def is_fractional(family: PlantFamily) -> bool:
    """Whether the plants have an order that is not whole."""
    return fractional_part(family) is not None


def refuse_fractional_family(family: PlantFamily, what: str, why: str) -> None:
    """Refuse a computation that does not know fractional plants.

    Args:
        family: the plants.
        what: the computation.
        why: it does not.

    Raises:
        DomainError: an order of a plant is not whole.
    """
    if is_fractional(family):
        refuse_fractional(what, why)
