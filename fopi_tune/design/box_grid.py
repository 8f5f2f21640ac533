"""The grid of plants over a family's box, and the stars that refine around its worst ones."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import PlantFamily

#: a range without 0 whose ends differ by at least this factor is divided in equal ratios
_WIDE = 4.0
#: plants that are refined: at least and at most
_LEAST_CANDIDATES, _MOST_CANDIDATES = 2, 4
#: natural units; local minima of the slack over the box this close to the smallest are refined too
_NEAR_WORST = 0.3
#: of the box's width; candidates are farther apart
_APART = 0.3


@dataclass(frozen=True)
class BoxGrid:
    """Plants of a box of uncertain numbers.

    Args:
        low, high: the box, shape (p,).
        points: the plants, the nominal one first, shape (m, p).
        per_axis: grid points an axis.
    """

    low: Array
    high: Array
    points: Array
    per_axis: int

    @classmethod
    def of(cls, family: PlantFamily) -> BoxGrid:
        """A grid; of many numbers corners and points drawn at random, always the same."""
        low, high, p = family.low, family.high, len(family.low)
        if p == 0:
            return cls(low, high, np.zeros((1, 0)), 1)
        per_axis = {1: 17, 2: 7, 3: 5, 4: 3}.get(p, 2)
        empty = cls(low, high, family.nominal_point[None, :], per_axis)
        steps = np.linspace(0.0, 1.0, per_axis)
        if p <= 8:
            grid = empty._at(np.array(list(itertools.product(steps, repeat=p))))
        else:
            grid = empty._at(np.random.default_rng(0).integers(0, 2, (256, p)).astype(float))
        inner = empty._at(np.random.default_rng(1).random((64, p))) if p >= 4 else np.zeros((0, p))
        return empty.with_points(np.concatenate([grid, inner]))

    def with_points(self, points: Array) -> BoxGrid:
        """The grid and these plants, shape (n, p)."""
        return replace(self, points=np.concatenate([self.points, points.reshape(len(points), len(self.low))]))

    @property
    def spacing(self) -> Array:
        """The grid's step along each axis, shape (p,); of an axis in equal ratios in ln of the number."""
        width = self.high - self.low
        return np.where(self._is_wide, np.log(self._ratio), width) / max(self.per_axis - 1, 1)

    def around(self, theta: Array, offsets: Array) -> Array:
        """Plants around one: offsets as `spacing`, shape (k, p); kept in the box."""
        moved = np.where(self._is_wide, theta * np.exp(np.where(self._is_wide, offsets, 0.0)), theta + offsets)
        return np.clip(moved, self.low, self.high)

    def worst_rows(self, slack: Array, few: bool = False) -> list[int]:
        """The worst plants, far from each other: the two worst, and more that are the worst of their surroundings.

        Args:
            slack: of each plant, shape (m,).
            few: the two worst alone.
        """
        order = [int(row) for row in np.argsort(slack, kind="stable")]
        chosen = self._apart([], order, _LEAST_CANDIDATES)
        if few:
            return chosen
        near = [row for row in order if slack[row] < slack[order[0]] + _NEAR_WORST]
        lowest = [row for row in near if slack[row] <= slack[self._neighbours[row]].min()]
        return self._apart(chosen, lowest, _MOST_CANDIDATES)

    def _apart(self, chosen: list[int], rows: list[int], most: int) -> list[int]:
        for row in rows:
            if len(chosen) >= most:
                break
            if all(np.max(np.abs(self._place[row] - self._place[c]), initial=0.0) > _APART for c in chosen):
                chosen.append(row)
        return chosen

    @cached_property
    def star(self) -> Array:
        """Offsets of a refinement star in steps, the centre first; shape (k, p)."""
        p = len(self.low)
        if p <= 2:
            steps = (-1.0, -0.5, 0.0, 0.5, 1.0) if p == 1 else (-1.0, 0.0, 1.0)
            return np.array(sorted(itertools.product(steps, repeat=p), key=lambda x: sum(abs(v) for v in x)))
        axes = np.concatenate([np.eye(p), -np.eye(p)])
        corners = np.array(list(itertools.product((-1.0, 1.0), repeat=p))) if p <= 4 else np.zeros((0, p))
        return np.concatenate([np.zeros((1, p)), axes, corners])

    @cached_property
    def _is_wide(self) -> NDArray[np.bool_]:
        return (self.low * self.high > 0.0) & (np.maximum(self._ratio, 1.0 / self._ratio) >= _WIDE)

    @cached_property
    def _ratio(self) -> Array:
        same_sign = self.low * self.high > 0.0
        return np.where(same_sign, self.high / np.where(same_sign, self.low, 1.0), 1.0)

    def _at(self, x: Array) -> Array:
        """The plants at places x in [0, 1], shape (n, p); exact at the ends."""
        wide = self.low * np.where(self._is_wide, self._ratio, 1.0) ** x
        points = np.where(self._is_wide, wide, self.low + (self.high - self.low) * x)
        return np.clip(np.where(x == 1.0, self.high, points), self.low, self.high)

    @cached_property
    def _place(self) -> Array:
        """The inverse of `_at` for all points."""
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        base = np.where(self._is_wide, self.low, 1.0)
        ratio = np.log(np.where(self._is_wide, self._ratio, np.e))
        wide = np.log(np.where(self._is_wide, self.points, 1.0) / base) / ratio
        return np.where(self._is_wide, wide, (self.points - self.low) / width)

    @cached_property
    def _neighbours(self) -> NDArray[np.bool_]:
        """Which points are at most a step of the grid from each other, shape (m, m)."""
        step = 1.01 / max(self.per_axis - 1, 1)
        apart = np.abs(self._place[:, None, :] - self._place[None, :, :])
        return np.asarray(apart.max(axis=2, initial=0.0) <= step)
