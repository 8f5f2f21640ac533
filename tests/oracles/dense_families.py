"""The worst margin over a family by `oracles.dense_margins`:  a grid of members, then pattern search."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from oracles.dense_margins import Continuous, Loop, OnSamples, value

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Family:
    """The members of a family with one controller.

    Args:
        plants: the family.
        gains: the ideal controller.
        implementation: the digital one; None in continuous time.
    """

    plants: PlantFamily
    gains: FoPi
    implementation: Implementation | None = None

    def loop(self, point: Array) -> Loop:
        """The loop with the plant at a place of the box."""
        plant = self.plants.member(point)
        if self.implementation is not None:
            return OnSamples.of(plant, self.implementation)
        return Continuous(plant, self.gains.kp, self.gains.ki, self.gains.alpha)

    @cached_property
    def _shares(self) -> Array:
        """Places of the box, shape (m, p), from 0 to 1; its ends are among them."""
        per_axis = {0: 1, 1: 13, 2: 6}.get(len(self.plants.low), 3)
        axes = np.linspace(0.0, 1.0, per_axis)
        return np.array(list(itertools.product(axes, repeat=len(self.plants.low))), dtype=float)

    def _point(self, share: Array) -> Array:
        return self.plants.low + share * (self.plants.high - self.plants.low)

    def unstable_point(self) -> Array | None:
        """A place where the loop is not stable; None when none of the places is."""
        nominal = self.plants.nominal_point
        points = [nominal, *(self._point(share) for share in self._shares)]
        return next((point for point in points if not self.loop(point).is_stable), None)

    def worst(self, quantity: str, largest: bool) -> float:
        """The largest or the smallest margin in rad, s or neper, were all members stable."""
        sign = 1.0 if largest else -1.0

        def badness(share: Array) -> float:
            return sign * value(self.loop(self._point(share)), quantity)

        values = [badness(share) for share in self._shares]
        starts = [(self._shares[k], values[k]) for k in np.argsort(values)[::-1][:2]]
        axes = len(self.plants.low)
        moves = [way * axis for axis in np.eye(axes) for way in (1.0, -1.0)]
        best = max(values)
        for here, height in starts if axes and math.isfinite(best) else ():
            step = 0.5 / (len(values) ** (1.0 / axes) - 1.0)
            while step > 2e-4:
                tried = [np.clip(here + step * move, 0.0, 1.0) for move in moves]
                reached = [badness(share) for share in tried]
                k = int(np.argmax(reached))
                here, height, step = (tried[k], reached[k], step) if reached[k] > height else (here, height, 0.5 * step)
            best = max(best, height)
        return sign * best
