"""Figures of a study: what is drawn is what the table has, and what is said is what is drawn."""

from __future__ import annotations

import numpy as np
import pytest
from cases.study_tables import result_of
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.figure import Figure

from fopi_tune.report.figures.picture import Picture
from fopi_tune.report.figures.studies import CellColumns, heat_map_picture, parallel_coordinates_picture
from fopi_tune.spec.model import Sense
from fopi_tune.study.model import BestRule, HeatMap

GRID = [
    (
        {"a": a, "b.c": word, "d": d},
        "met" if a < 3 else "infeasible",
        {"z": None if (a, word) == (3, "x") else 10 * a + d},
    )
    for a in (1, 2, 3) for word in ("y", "x") for d in (0.0, 0.5)
]  # fmt: skip
OVER = HeatMap("z", "a", "b.c")


def drawn(picture: Picture | None) -> Figure:
    assert picture is not None
    figure = Figure(figsize=picture.size_inches)
    picture.draw(figure)
    return figure


def test_fields_are_the_medians_of_their_cells_and_a_field_without_a_number_is_blank() -> None:
    picture = heat_map_picture(CellColumns(result_of(GRID).table), OVER)
    axes = drawn(picture).axes[0]
    (mesh,) = (each for each in axes.collections if isinstance(each, QuadMesh))
    field = np.ma.filled(np.ma.asarray(mesh.get_array()).astype(float), np.nan).reshape(2, 3)
    np.testing.assert_allclose(field, [[10.25, 20.25, 30.25], [10.25, 20.25, np.nan]])
    assert [text.get_text() for text in axes.get_xticklabels()] == ["1", "2", "3"]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["y", "x"]
    assert picture is not None
    assert picture.description == (
        "z as colour over a (across) and b.c (up): from 10 in cell 1 to 30.5 in cell 10. A field with several cells "
        "shows their median. 2 of 12 cells have no number there and are left out; a grey field has none."
    )


def test_the_best_cell_has_a_ring() -> None:
    cells = CellColumns(result_of(GRID, BestRule(Sense.MAXIMIZE, "z")).table)
    picture = heat_map_picture(cells, OVER)
    axes = drawn(picture).axes[0]
    assert picture is not None
    assert picture.description.endswith("The ring is around the best cell, 6.")
    (ring,) = axes.lines
    # cell 6 has a = 2 and the word y
    assert np.asarray(ring.get_xydata()).tolist() == [[1.0, 0.0]]
    assert "the best cell" not in str(heat_map_picture(CellColumns(result_of(GRID).table), OVER))


def test_axes_with_many_values_have_points_at_their_places() -> None:
    numbers = np.linspace(1.0, 900.0, 60)
    rows = [({"a": float(x), "b": float(1000.0 - x)}, "met", {"z": float(x * x)}) for x in numbers]
    axes = drawn(heat_map_picture(CellColumns(result_of(rows).table), HeatMap("z", "a", "b"))).axes[0]
    (points,) = (each for each in axes.collections if isinstance(each, PathCollection))
    np.testing.assert_allclose(np.asarray(points.get_offsets()), np.column_stack([numbers, 1000.0 - numbers]))
    np.testing.assert_allclose(np.asarray(points.get_array()), numbers**2)
    assert axes.get_xscale() == "log"
    assert axes.get_yscale() == "linear"


def test_drawn_cells_are_points_although_they_are_few() -> None:
    rows = [({"a": a, "b": (7 * a) % 11}, "met", {"z": a}) for a in (0.5, 1.5, 2.5, 4.5)]
    axes = drawn(heat_map_picture(CellColumns(result_of(rows).table), HeatMap("z", "a", "b"))).axes[0]
    assert [type(each) for each in axes.collections] == [PathCollection]


@pytest.mark.parametrize("column", ["b.c", "none"])
def test_a_column_without_numbers_has_no_heat_map(column: str) -> None:
    assert heat_map_picture(CellColumns(result_of(GRID).table), HeatMap(column, "a", "d")) is None


def test_lines_go_through_the_values_of_their_cells() -> None:
    rows = [
        ({"a": 1, "w": "p"}, "met", {"z": 10.0}),
        ({"a": 3, "w": "q"}, "violated", {"z": 20.0}),
        ({"a": 2, "w": "r"}, "met", {"z": None}),
        ({"a": 2, "w": "p"}, "solved", {"z": 12.5}),
    ]
    cells = CellColumns(result_of(rows, BestRule(Sense.MINIMIZE, "z")).table)
    picture = parallel_coordinates_picture(cells, ["a", "w", "z"])
    axes = drawn(picture).axes[0]
    bad, good = (each for each in axes.collections if isinstance(each, LineCollection))
    heights = [np.asarray(line)[:, 1] for line in [*bad.get_segments(), *good.get_segments()]]
    np.testing.assert_allclose(heights[0], [1.0, 0.5, 1.0])
    np.testing.assert_allclose(heights[1], [0.0, 0.0, 0.0])
    # a cell without a value ends where it has none
    np.testing.assert_allclose(heights[2][:2], [0.5, 1.0])
    np.testing.assert_allclose(heights[-1], [0.5, 0.0, 0.25])
    assert picture is not None
    assert picture.description == (
        "A line for each of 4 cells through its values, the least below and the largest above: a 1 to 3; w p to r; z "
        "10 to 20. 3 cells end well (blue, solid), 1 does not (orange, dashed). The thick line is the best cell, 1."
    )


def test_an_axis_of_numbers_far_apart_is_logarithmic() -> None:
    rows = [({"a": a, "b": 1.0 + a}, "met", {"z": 1.0}) for a in (0.01, 0.1, 10.0)]
    axes = drawn(parallel_coordinates_picture(CellColumns(result_of(rows).table), ["a", "b"])).axes[0]
    (lines,) = (each for each in axes.collections if isinstance(each, LineCollection))
    np.testing.assert_allclose(
        [np.asarray(line)[0, 1] for line in lines.get_segments()], [0.0, 1.0 / 3.0, 1.0], atol=1e-12
    )


def test_less_than_two_columns_are_no_figure_and_of_many_lines_some_are_drawn() -> None:
    cells = CellColumns(result_of(GRID).table)
    assert parallel_coordinates_picture(cells, ["a"]) is None
    assert parallel_coordinates_picture(cells, ["a", "unknown"]) is None
    rows = [({"a": float(i), "b": float(i % 7)}, "met", {"z": 1.0}) for i in range(2500)]
    picture = parallel_coordinates_picture(CellColumns(result_of(rows).table), ["a", "b"])
    (lines,) = drawn(picture).axes[0].collections
    assert isinstance(lines, LineCollection)
    assert len(lines.get_segments()) == 2000
    assert picture is not None
    assert "2000 of them are drawn." in picture.description
