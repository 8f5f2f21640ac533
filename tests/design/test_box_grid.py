"""The grid of plants over a box."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.design.box_grid import BoxGrid


def family(**ranges: tuple[float, float]) -> PlantFamily:
    numbers = {"static_gain": (1.0, 1.0), "time_constant_s": (1.0, 1.0), "dead_time_s": (0.0, 0.0)} | ranges
    return PlantFamily("lag", {name: Uncertain(0.5 * (a + b), a, b) for name, (a, b) in numbers.items()})


def test_the_nominal_plant_comes_first_and_the_corners_are_exact() -> None:
    grid = BoxGrid.of(family(static_gain=(0.3, 0.7), time_constant_s=(1e-2, 30.0)))
    assert grid.points[0] == pytest.approx([0.5, 15.005])
    rows = {tuple(point) for point in grid.points}
    assert {(0.3, 1e-2), (0.7, 1e-2), (0.3, 30.0), (0.7, 30.0)} <= rows


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wide_range_is_divided_in_equal_ratios_and_a_narrow_one_in_equal_steps(sign: float) -> None:
    ends = sorted((sign * 0.1, sign * 100.0))
    grid = BoxGrid.of(family(static_gain=(ends[0], ends[1])))
    values = np.sort(np.abs(grid.points[1:, 0]))
    assert values[1:] / values[:-1] == pytest.approx(1000.0 ** (1.0 / 16.0))
    narrow = np.sort(BoxGrid.of(family(static_gain=(1.0, 3.0))).points[1:, 0])
    assert np.diff(narrow) == pytest.approx(2.0 / 16.0)


def test_a_star_stays_in_the_box_and_moves_by_the_grids_steps() -> None:
    grid = BoxGrid.of(family(static_gain=(0.1, 100.0), time_constant_s=(1.0, 2.0)))
    moved = grid.around(np.array([1.0, 1.5]), grid.star * grid.spacing)
    assert moved[:, 0].min() == pytest.approx(1000.0 ** (-1.0 / 6.0))
    assert moved[:, 1].max() == pytest.approx(1.5 + 1.0 / 6.0)
    at_corner = grid.around(np.array([100.0, 2.0]), grid.star * grid.spacing)
    assert at_corner[:, 0].max() == 100.0
    assert at_corner[:, 1].max() == 2.0


def test_the_worst_of_their_surroundings_are_found_beside_the_two_worst() -> None:
    grid = BoxGrid.of(family(static_gain=(1.0, 2.0), time_constant_s=(1.0, 2.0)))
    x, y = grid.points.T
    # three dips, the third one 0.2 shallower; two grid points of the deepest are the two worst
    centres = np.array([[1.0, 1.0], [2.0, 2.0], [1.0, 2.0]])
    dips = [np.hypot(x - cx, y - cy) + depth for (cx, cy), depth in zip(centres, (0.0, 0.1, 0.2), strict=True)]
    rows = grid.worst_rows(np.min(dips, axis=0))
    assert {tuple(grid.points[row]) for row in rows} == {(1.0, 1.0), (2.0, 2.0), (1.0, 2.0)}
    assert len(grid.worst_rows(np.min(dips, axis=0), few=True)) == 2


def test_added_plants_are_looked_at() -> None:
    grid = BoxGrid.of(family(static_gain=(1.0, 2.0))).with_points(np.array([[1.234]]))
    slack = np.abs(grid.points[:, 0] - 1.234)
    assert grid.points[grid.worst_rows(slack)[0]] == pytest.approx([1.234])


def test_a_known_plant_is_a_grid_of_one() -> None:
    grid = BoxGrid.of(family())
    assert grid.points.shape == (1, 0)
    assert grid.worst_rows(np.array([0.3])) == [0]
    assert grid.with_points(np.zeros((2, 0))).points.shape == (3, 0)
