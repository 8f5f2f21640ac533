"""Figures of a study's table:  a column as colours over two others, and every cell as a line through parallel axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.report.figures.picture import BLACK, BLUE, ORANGE, WIDE, Picture, legend_below, plain_text
from fopi_tune.report.text.formatting import number
from fopi_tune.study.model import SUCCESS_STATUSES, HeatMap, Value
from fopi_tune.study.table import StudyTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: more values than this along an axis are no grid
_MOST_FIELDS = 40
_MOST_TICKS, _MOST_LINES = 12, 2000
#: a ratio of the largest to the least value from which a scale is logarithmic
_WIDE_RATIO = 100.0
_BLANK = "#dddddd"


@dataclass(frozen=True)
class CellColumns:
    """The rows of a study's specs by their columns.

    Args:
        table: of the study.
    """

    table: StudyTable

    @cached_property
    def rows(self) -> list[dict[str, Value]]:
        """The rows of specs and systems."""
        return [row for row in self.table.to_dicts() if row.get("spec") is not None]

    def values(self, name: str) -> list[Value]:
        """A column."""
        return [row.get(name) for row in self.rows]

    def is_numeric(self, name: str) -> bool:
        """Whether a column has numbers, and nothing else."""
        present = [value for value in self.values(name) if value is not None]
        return bool(present) and all(_is_number(value) for value in present)

    def varies(self, name: str) -> bool:
        """Whether a column has two values that differ."""
        return len({repr(value) for value in self.values(name) if value is not None}) > 1

    @property
    def best(self) -> int | None:
        """The row of the best cell."""
        best = self.table.best
        number_of = None if best is None or best.index is None else best.index + 1
        return next((i for i, row in enumerate(self.rows) if row["cell"] == number_of), None)

    def scale(self, name: str) -> Scale:
        """The axis of a column."""
        distinct = dict.fromkeys(value for value in self.values(name) if value is not None)
        numbers = sorted({float(value) for value in distinct if _is_number(value)})
        words = [value for value in distinct if not _is_number(value)]
        return Scale(name, tuple(numbers), tuple(words))


@dataclass(frozen=True)
class Scale:
    """The distinct values of a column: numbers in order, then words as they come."""

    name: str
    numbers: tuple[float, ...]
    words: tuple[Value, ...]

    @property
    def size(self) -> int:
        """How many values there are."""
        return len(self.numbers) + len(self.words)

    @property
    def labels(self) -> list[str]:
        """The values in words."""
        return [*(number(value) for value in self.numbers), *(_word(value) for value in self.words)]

    def index(self, value: Value) -> int:
        """The place of a value among them."""
        if _is_number(value):
            return self.numbers.index(float(value))  # pyright: ignore[reportArgumentType]
        return len(self.numbers) + self.words.index(value)

    @property
    def is_wide(self) -> bool:
        """Whether the numbers are positive and far apart."""
        return bool(self.numbers) and self.numbers[0] > 0.0 and self.numbers[-1] > _WIDE_RATIO * self.numbers[0]


def heat_map_picture(cells: CellColumns, figure: HeatMap) -> Picture | None:
    """A column over two others; None where it has no numbers.

    Fields are the median of their cells.  Cells that are no grid, such as drawn ones, are points.
    """
    placed = [
        (row[figure.x], row[figure.y], float(row[figure.column]), int(str(row["cell"])), index)  # pyright: ignore
        for index, row in enumerate(cells.rows)
        if _is_number(row.get(figure.column)) and row.get(figure.x) is not None and row.get(figure.y) is not None
    ]
    if not placed:
        return None
    across, up = cells.scale(figure.x), cells.scale(figure.y)
    as_fields = bool(across.words or up.words) or _is_grid(cells, across, up)
    values = np.array([value for _, _, value, _, _ in placed])
    places = np.array([[across.index(x), up.index(y)] for x, y, _, _, _ in placed], dtype=float)
    if not as_fields:
        places = np.array([[x, y] for x, y, _, _, _ in placed], dtype=float)
    ring = next((place for place, (*_, index) in zip(places, placed, strict=True) if index == cells.best), None)

    def draw(drawing: Figure) -> None:
        axes = drawing.subplots()
        mesh = (_draw_fields if as_fields else _draw_points)(axes, places, values, across, up)
        if ring is not None:
            axes.plot(ring[:1], ring[1:], "o", markersize=13, markerfacecolor="none", color=ORANGE, markeredgewidth=2.5)
        axes.set_xlabel(plain_text(figure.x))
        axes.set_ylabel(plain_text(figure.y))
        bar = drawing.colorbar(mesh, ax=axes, label=plain_text(figure.column))
        # as lines and not as an image, which a page does not load
        if bar.solids is not None:
            bar.solids.set(rasterized=False, edgecolor="face")

    title = f"{figure.column} over {figure.x} and {figure.y}"
    least, most = int(np.argmin(values)), int(np.argmax(values))
    told = (
        f"{figure.column} as colour over {figure.x} (across) and {figure.y} (up): from {number(values[least])} in cell "
        f"{placed[least][3]} to {number(values[most])} in cell {placed[most][3]}."
    )
    if as_fields and len(np.unique(places, axis=0)) < len(placed):
        told += " A field with several cells shows their median."
    if missing := len(cells.rows) - len(placed):
        told += (
            f" {missing} of {counted(len(cells.rows), 'cell')} {agreeing(missing, 'has', 'have')} no number there "
            f"and {agreeing(missing, 'is', 'are')} left out; a grey field has none."
        )
    if ring is not None and cells.best is not None:
        told += f" The ring is around the best cell, {cells.rows[cells.best]['cell']}."
    return Picture(title, told, draw, (WIDE, 5.0))


def _is_grid(cells: CellColumns, across: Scale, up: Scale) -> bool:
    """Whether the cells fill at least half of the fields of their values."""
    pairs = {(row.get(across.name), row.get(up.name)) for row in cells.rows}
    return max(across.size, up.size) <= _MOST_FIELDS and 2 * len(pairs) >= across.size * up.size


def _draw_fields(axes: Axes, places: Array, values: Array, across: Scale, up: Scale) -> Any:
    field = np.full((up.size, across.size), np.nan)
    whole = places.astype(int)
    for i, j in np.unique(whole, axis=0):
        field[j, i] = np.median(values[(whole == (i, j)).all(axis=1)])
    axes.set_facecolor(_BLANK)
    edges = (np.arange(across.size + 1) - 0.5, np.arange(up.size + 1) - 0.5)
    mesh = axes.pcolormesh(*edges, np.ma.masked_invalid(field), cmap="viridis", norm=_norm(values))
    for axis, scale in ((axes.xaxis, across), (axes.yaxis, up)):
        shown = np.unique(np.linspace(0, scale.size - 1, min(scale.size, _MOST_TICKS)).round().astype(int))
        axis.set_ticks(shown.tolist(), [plain_text(scale.labels[index]) for index in shown])
    return mesh


def _draw_points(axes: Axes, places: Array, values: Array, across: Scale, up: Scale) -> Any:
    points = axes.scatter(places[:, 0], places[:, 1], c=values, cmap="viridis", norm=_norm(values), s=24)
    if across.is_wide:
        axes.set_xscale("log")
    if up.is_wide:
        axes.set_yscale("log")
    axes.grid(True, linewidth=0.3)
    return points


def _norm(values: Array) -> str:
    """The scale of the colours."""
    return "log" if values.min() > 0.0 and values.max() > _WIDE_RATIO * values.min() else "linear"


def parallel_coordinates_picture(cells: CellColumns, columns: Sequence[str]) -> Picture | None:
    """A line for each cell through an axis for each column; None where there are less than two columns with values."""
    scales = [scale for scale in (cells.scale(name) for name in columns) if scale.size]
    if len(scales) < 2 or not cells.rows:
        return None
    heights = np.array([[_height(scale, row.get(scale.name)) for scale in scales] for row in cells.rows])
    good = np.array([row.get("outcome") in SUCCESS_STATUSES for row in cells.rows])
    shown = np.unique(np.linspace(0, len(good) - 1, min(len(good), _MOST_LINES)).round().astype(int))

    def draw(drawing: Figure) -> None:
        axes = drawing.subplots()
        for wanted, colour, dashes, label in (
            (False, ORANGE, "--", "other outcomes"),
            (True, BLUE, "-", "ends well"),
        ):
            _draw_lines(axes, heights[[i for i in shown if good[i] == wanted]], colour, dashes, label)
        if cells.best is not None:
            axes.plot(heights[cells.best], color=BLACK, linewidth=2.5, label="best cell")
        for place, scale in enumerate(scales):
            _draw_axis(axes, place, scale)
        axes.set_xticks(range(len(scales)), [plain_text(scale.name) for scale in scales], rotation=20, ha="right")
        axes.set_yticks([])
        axes.set_ylim(-0.08, 1.08)
        axes.set_xlim(-0.3, len(scales) - 0.5)
        axes.spines[:].set_visible(False)
        legend_below(drawing, axes)

    axes_told = "; ".join(f"{scale.name} {scale.labels[0]} to {scale.labels[-1]}" for scale in scales)
    well = int(good.sum())
    badly = len(good) - well
    told = (
        f"A line for each of {counted(len(cells.rows), 'cell')} through its values, the least below and the largest "
        f"above: {axes_told}. {counted(well, 'cell')} {agreeing(well, 'ends', 'end')} well (blue, solid), "
        f"{badly} {agreeing(badly, 'does', 'do')} not (orange, dashed)."
    )
    told += f" {len(shown)} of them {agreeing(len(shown), 'is', 'are')} drawn." if len(shown) < len(good) else ""
    if cells.best is not None:
        told += f" The thick line is the best cell, {cells.rows[cells.best]['cell']}."
    return Picture("Cells through their values", told, draw, (WIDE, 4.6))


def _height(scale: Scale, value: Value) -> float:
    """The place of a value on an axis, from 0 to 1; NaN without a value."""
    if value is None:
        return np.nan
    if scale.words or scale.size == 1:
        return scale.index(value) / (scale.size - 1) if scale.size > 1 else 0.5
    low, high, at = scale.numbers[0], scale.numbers[-1], float(value)
    if scale.is_wide:
        return float(np.log(at / low) / np.log(high / low))
    return (at - low) / (high - low)


def _draw_lines(axes: Axes, heights: Array, colour: str, dashes: str, label: str) -> None:
    from matplotlib.collections import LineCollection

    if not len(heights):
        return
    across = np.broadcast_to(np.arange(heights.shape[1]), heights.shape)
    alpha = float(np.clip(30.0 / len(heights), 0.15, 0.9))
    lines = LineCollection(
        list(np.stack([across, heights], axis=2)), colors=colour, linestyles=dashes, linewidths=1.0, alpha=alpha
    )
    axes.add_collection(lines)
    axes.plot([], [], color=colour, linestyle=dashes, label=label)


def _draw_axis(axes: Axes, place: int, scale: Scale) -> None:
    axes.axvline(place, color=BLACK, linewidth=0.8)
    ends = [0, scale.size - 1] if not scale.words or scale.size > _MOST_TICKS else range(scale.size)
    for index in dict.fromkeys(ends):
        value: Value = [*scale.numbers, *scale.words][index]
        text = plain_text(scale.labels[index][:24])
        offset = (3, -10) if index == 0 and scale.size > 1 else (3, 3)
        axes.annotate(text, (place, _height(scale, value)), offset, textcoords="offset points", fontsize=8)


def chosen_heat_maps(axes: Sequence[str], results: Sequence[str], most: int = 3) -> tuple[HeatMap, ...]:
    """The results over the first two columns that vary."""
    return tuple(HeatMap(name, axes[0], axes[1]) for name in results[:most]) if len(axes) > 1 else ()


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _word(value: Value) -> str:
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def figures_of(cells: CellColumns, maps: Sequence[HeatMap], axes: Sequence[str]) -> Mapping[str, Picture]:
    """The figures that have something to show, by their names."""
    made = {f"heat_map_{k + 1}": heat_map_picture(cells, each) for k, each in enumerate(maps)}
    made["parallel_coordinates"] = parallel_coordinates_picture(cells, axes)
    return {name: picture for name, picture in made.items() if picture is not None}
