"""The numbers that are searched, gains and orders of a structure, as an array:  their ranges, units and sizes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import WEIGHT_NAME, FoPi
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.structures import LARGEST_GAIN, Structure

#: sizes of gains are at least this part of the unit gain
_SMALLEST_SIZE = 0.02
#: of the setpoint's weight, dimensionless: as exact as the search is
_AT_END = 1e-7


@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers x of a problem's controllers, in the user's units, shape (n,).

    The gains come first, then the orders, then the weight of the setpoint where that has a range.

    Args:
        loop: requirements on the loop's frequency response; gives the structure, the ranges and the scale.
    """

    loop: Problem

    @cached_property
    def structure(self) -> Structure:
        """What the numbers are."""
        return self.loop.structure

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the numbers: those of the structure and, where it is designed, the setpoint's weight."""
        weight = () if self.loop.spec.controller.setpoint_weight_range is None else (WEIGHT_NAME,)
        return *self.structure.names, *weight

    @property
    def count(self) -> int:
        """n."""
        return len(self.names)

    @property
    def linear(self) -> int:
        """How many are gains."""
        return self.structure.linear

    def of(self, gains: FoPi) -> Array:
        """x of a controller, shape (n,)."""
        values = (getattr(gains, name) for name in self.names)
        # a start may be without the weight
        return np.array([self.loop.spec.controller.first_weight if value is None else value for value in values])

    def controller(self, x: Array) -> FoPi:
        """The controller with these numbers, shape (n,)."""
        box = self.loop.spec.controller
        named = dict(zip(self.names, map(float, x), strict=True))
        return box.controller(**{"alpha": box.alpha.min, **named})

    def inside(self, x: Array) -> FoPi:
        """The controller with these numbers within their ranges."""
        found = np.clip(x, *self.box)
        # a solver ends next to an end; that of a weight, such as 0, is written as it is
        for end in self.box:
            near = (np.abs(found - end) < _AT_END) & (np.array(self.names) == WEIGHT_NAME)
            found = np.where(near, end, found)
        return self.controller(found)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """The ranges, those of gains that are open cut where these count as unbounded; shapes (n,)."""
        ranges = [self.loop.spec.controller.ranges[name] for name in self.names]
        most = LARGEST_GAIN * self.units(np.ones(self.count))
        most[self.linear :] = np.inf
        low, high = np.array([each.min for each in ranges]), np.array([each.max for each in ranges])
        return np.maximum(low, -most), np.minimum(high, most)

    def units(self, x: Array) -> Array:
        """Gains that make the nominal |L| about 1 at its characteristic frequency with the orders of x, 1 of orders."""
        ones = x[: len(self.structure.names)].copy()
        ones[: self.linear] = 1.0
        gains = self.loop.scale.controller(ones)
        of_gains = [getattr(gains, name) for name in self.names[: self.linear]]
        return np.concatenate([of_gains, np.ones(self.count - self.linear)])

    def sizes(self, x: Array) -> Array:
        """What a step of 1 means for each number near x, shape (n,)."""
        found = np.maximum(np.abs(x), _SMALLEST_SIZE * self.units(x))
        found[self.linear :] = 1.0
        return found
