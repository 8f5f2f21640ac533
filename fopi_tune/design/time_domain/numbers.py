"""The numbers that are searched, gains and orders of a structure, as an array:  their ranges, units and sizes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.structures import LARGEST_GAIN, Structure

#: sizes of gains are at least this part of the unit gain
_SMALLEST_SIZE = 0.02


@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers x of a problem's controllers, in the user's units, shape (n,): the gains first, then the orders.

    Args:
        loop: requirements on the loop's frequency response; gives the structure, the ranges and the scale.
    """

    loop: Problem

    @cached_property
    def structure(self) -> Structure:
        """What the numbers are."""
        return self.loop.structure

    @property
    def count(self) -> int:
        """n."""
        return len(self.structure.names)

    @property
    def linear(self) -> int:
        """How many are gains."""
        return self.structure.linear

    def of(self, gains: FoPi) -> Array:
        """x of a controller, shape (n,)."""
        return np.array([getattr(gains, name) for name in self.structure.names])

    def controller(self, x: Array) -> FoPi:
        """The controller with these numbers, shape (n,)."""
        box = self.loop.spec.controller
        named = dict(zip(self.structure.names, map(float, x), strict=True))
        return box.controller(**{"alpha": box.alpha.min, **named})

    def inside(self, x: Array) -> FoPi:
        """The controller with these numbers within their ranges."""
        return self.controller(np.clip(x, *self.box))

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """The ranges, those of gains that are open cut where these count as unbounded; shapes (n,)."""
        ranges = [getattr(self.loop.spec.controller, name) for name in self.structure.names]
        most = LARGEST_GAIN * self.units(np.ones(self.count))
        most[self.linear :] = np.inf
        low, high = np.array([each.min for each in ranges]), np.array([each.max for each in ranges])
        return np.maximum(low, -most), np.minimum(high, most)

    def units(self, x: Array) -> Array:
        """Gains that make the nominal |L| about 1 at its characteristic frequency with the orders of x, 1 of orders."""
        scale, ones = self.loop.scale, np.ones(self.count)
        ones[self.linear :] = x[self.linear :]
        return np.concatenate([self.of(scale.controller(ones))[: self.linear], np.ones(self.count - self.linear)])

    def sizes(self, x: Array) -> Array:
        """What a step of 1 means for each number near x, shape (n,)."""
        found = np.maximum(np.abs(x), _SMALLEST_SIZE * self.units(x))
        found[self.linear :] = 1.0
        return found
