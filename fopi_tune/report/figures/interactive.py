"""A drawn figure as one for the pointer:  Matplotlib figure -> the JSON of a Bokeh layout; equal figures, equal JSON.

Lines, bands, hatched parts, marks, words and the legend are read from the figure that was drawn: no picture is
described twice.  A figure with anything else, such as fields of colours or axes of names, has none and stays a drawing.
The identifiers of Bokeh count up in a process; here they are numbered anew in each figure.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.bode_form import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

#: pixels for an inch of the drawing
_PIXELS_PER_INCH = 88
_DASHES: dict[Any, str] = {"-": "solid", "--": "dashed", "-.": "dotdash", ":": "dotted"}
_MARKERS = {"o": "circle", ".": "dot", "+": "cross", "x": "x", "s": "square"}
_NO_MARKER = ("None", "none", " ", "")
#: a label that Matplotlib leaves out of its legend begins with this
_UNNAMED = "_"
#: pixels of the labels below the last panel, and of a line of the legend
_LABELS, _LEGEND_LINE = 48, 22
#: pixels beside and below the numbers' part of a panel
_BORDER = 70
#: the wheel scrolls the page; zooming is by a box, or by buttons that the keyboard reaches
_TOOLS = "pan,box_zoom,zoom_in,zoom_out,undo,reset"


def interactive_json(figure: Figure) -> str:
    """The JSON that `Bokeh.embed.embed_item` shows: zoom, pan, values under the pointer, lines that the legend hides.

    Args:
        figure: drawn, its limits known.

    Returns:
        Empty where the figure has what this does not show.
    """
    if not all(_is_shown(axes) for axes in figure.axes):
        return ""
    # loaded here: it costs half a second
    from bokeh.embed import json_item
    from bokeh.layouts import gridplot

    panels: list[Any] = []
    for axes in figure.axes:
        shared = [panels[k] for k, other in enumerate(figure.axes[: len(panels)]) if _shares_x(axes, other)]
        panels.append(_panel(figure, axes, shared[0].x_range if shared else None))
    _add_legend(panels)
    rows = [[panel] for panel in panels]
    grid = gridplot(rows, sizing_mode=None, merge_tools=True, toolbar_location="above", toolbar_options={"logo": None})
    # not as an argument, which would be handed on to the panels
    grid.sizing_mode = "stretch_width"
    return _numbered_anew(json.dumps(json_item(grid), allow_nan=False))


def _is_shown(axes: Axes) -> bool:
    """Whether all that axes have is shown here: no images, no fields of colours, no names for numbers, known marks."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.ticker import FixedFormatter, FuncFormatter

    # a bar of colours beside the panels is a field too
    plain = all(isinstance(each, LineCollection | PolyCollection) for each in axes.collections)
    named = any(
        isinstance(axis.get_major_formatter(), FixedFormatter | FuncFormatter) and axis.get_scale() == "linear"
        for axis in (axes.xaxis, axes.yaxis)
    )
    marked = all(str(line.get_marker()) in (*_MARKERS, *_NO_MARKER) for line in axes.get_lines())
    return plain and marked and not axes.images and not named


def _shares_x(one: Axes, other: Axes) -> bool:
    return one.get_shared_x_axes().joined(one, other)


def _panel(figure: Figure, axes: Axes, x_range: Any) -> Any:
    from bokeh.models import HoverTool, Line, Range1d
    from bokeh.plotting import figure as plot

    (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    height = figure.get_figheight() * _PIXELS_PER_INCH / len(figure.axes)
    # a plane keeps its angles, with borders as high as wide, and fits a narrow screen
    plane: dict[str, Any] = {
        "aspect_ratio": 1.0, "max_width": round(height), "sizing_mode": "scale_width", "min_border_bottom": _BORDER,
    }  # fmt: skip
    shape: dict[str, Any] = (
        plane if axes.get_aspect() == 1.0 else {"height": round(height), "sizing_mode": "stretch_width"}
    )
    panel = plot(
        **shape,
        tools=_TOOLS,
        x_axis_type="log" if axes.get_xscale() == "log" else "linear",
        y_axis_type="log" if axes.get_yscale() == "log" else "linear",
        x_range=x_range or Range1d(start=low, end=high),
        y_range=Range1d(start=bottom, end=top),
        x_axis_label=_words(axes.get_xlabel()) or None,
        y_axis_label=_words(axes.get_ylabel()) or None,
        min_border_left=_BORDER,
    )
    # where nothing is measured
    panel.yaxis.visible = len(axes.get_yticks()) > 0
    named: list[Any] = []
    for (glyph, name, *look), parts in _drawn_alike(axes).items():
        columns = {key: _parted([part[key] for part in parts]) for key in parts[0]}
        renderer = _add(panel, glyph(**{key: key for key in columns}, **dict(look)), columns, name)
        if name and glyph is Line:
            named.append(renderer)
    tips = [(_words(axes.get_xlabel()) or "x", "$x{0.0000a}"), (_words(axes.get_ylabel()) or "y", "$y{0.0000a}")]
    _write_texts(axes, panel)
    panel.add_tools(HoverTool(renderers=named, tooltips=[("", "$name"), *tips], line_policy="interp"))
    return panel


def _drawn_alike(axes: Axes) -> dict[tuple[Any, ...], list[dict[str, Array]]]:
    """(kind of glyph, name, looks) -> the columns of all that is drawn so, areas below lines.

    One glyph for each of them: a model in the browser costs more than its points.
    """
    alike: dict[tuple[Any, ...], list[dict[str, Array]]] = {}
    for drawn in (_areas(axes), *(_line(axes, line) for line in axes.get_lines())):
        for glyph, name, look, columns in drawn:
            alike.setdefault((glyph, name, *look.items()), []).append(columns)
    return alike


def _line(axes: Axes, line: Line2D) -> Iterator[tuple[type, str, dict[str, Any], dict[str, Array]]]:
    """The glyphs of one line, of its marks, or of both."""
    from bokeh.models import HSpan, Line, Scatter, VSpan

    x, y = (np.asarray(values, dtype=float) for values in line.get_data())
    colour, width, dash = _colour(line.get_color()), max(1.2, 1.4 * line.get_linewidth()), _dash(line)
    name = _name_of(line)
    look = {"line_color": colour, "line_width": width, "line_dash": dash}
    if line.get_transform() != axes.transData:
        # axhline and axvline: one of the coordinates is a share of the axes, and the line has no end
        yield (HSpan, name, look, {"y": y[:1]}) if y[0] == y[-1] else (VSpan, name, look, {"x": x[:1]})
        return
    marker = _MARKERS.get(str(line.get_marker()))
    if line.get_linestyle() not in ("None", "none", ""):
        x, y = _stepped(x, y) if line.get_drawstyle() == "steps-post" else (x, y)
        yield Line, name, look, {"x": x, "y": y}
    if marker is not None:
        size = 1.4 * line.get_markersize()
        yield (
            Scatter,
            "",
            {"marker": marker, "size": size, "line_color": colour, "fill_color": colour},
            {"x": x, "y": y},
        )


def _write_texts(axes: Axes, panel: Any) -> None:
    """Write the words that stand in the axes, where they stand."""
    from bokeh.models import Label

    for text in axes.texts:
        dots = text.get_transform().transform(text.get_position())
        x, y = axes.transData.inverted().transform(dots)
        place = {"x": float(x), "y": float(y), "text_align": text.get_horizontalalignment()}
        panel.add_layout(Label(text=text.get_text(), text_font_size="12px", **place))


def _areas(axes: Axes) -> Iterator[tuple[type, str, dict[str, Any], dict[str, Array]]]:
    """The glyphs of bands, hatched parts and circles."""
    from bokeh.models import Patch

    for patch in [*axes.collections, *axes.patches]:
        hatch = patch.get_hatch()
        face, edge = patch.get_facecolor(), patch.get_edgecolor()
        face, edge = (np.atleast_2d(each)[0] if len(each) else (0.0, 0.0, 0.0, 0.0) for each in (face, edge))
        width = float(np.atleast_1d(patch.get_linewidth())[0])
        look = {
            "fill_color": _colour(face[:3]), "fill_alpha": float(face[3]),
            "line_color": _colour(edge[:3]), "line_alpha": float(edge[3]) if width else 0.0, "line_width": width,
            "line_dash": "solid" if hatch else _dash_of_patch(patch),
            "hatch_pattern": _hatch(hatch), "hatch_color": _colour(edge[:3]), "hatch_alpha": 0.5, "hatch_weight": 0.6,
        }  # fmt: skip
        for x, y in _outlines(axes, patch):
            yield Patch, _name_of(patch), look, {"x": x, "y": y}


def _parted(parts: Sequence[Array]) -> Array:
    """Lines or outlines one after the other, parted by a NaN, which nothing is drawn to."""
    return np.concatenate([piece for part in parts for piece in (part, [np.nan])][:-1])


def _add(panel: Any, glyph: Any, columns: dict[str, Array], name: str = "") -> Any:
    """Add a glyph; alone, as its copies for what is selected or muted would be four fifths of a page's models."""
    from bokeh.models import ColumnDataSource

    # single precision is more than a screen shows, and half as long
    data: dict[str, Any] = {key: np.asarray(values, dtype=np.float32) for key, values in columns.items()}
    return panel.add_glyph(ColumnDataSource(data), glyph, name=name)


def _outlines(axes: Axes, patch: Any) -> Iterator[tuple[Array, Array]]:
    """The closed outlines of a patch or of a collection's paths, in data coordinates."""
    from matplotlib.patches import Patch

    # in dots of the drawing, so that circles get corners enough
    to_dots, back = patch.get_transform(), axes.transData.inverted()
    paths = [patch.get_path()] if isinstance(patch, Patch) else patch.get_paths()
    for path in paths:
        for outline in to_dots.transform_path(path).to_polygons(closed_only=False):
            corners = np.asarray(back.transform(outline), dtype=float)
            if len(corners) > 1 and np.all(np.isfinite(corners)):
                yield corners[:, 0], corners[:, 1]


def _add_legend(panels: list[Any]) -> None:
    """The names of lines and bands below the last panel; a click, or Enter, hides what has the name in every panel."""
    from bokeh.models import Legend, LegendItem

    named: dict[str, list[Any]] = {}
    for panel in panels:
        for renderer in panel.renderers:
            if renderer.name:
                named.setdefault(str(renderer.name), []).append(renderer)
    if named:
        if panels[-1].aspect_ratio is not None:
            panels.append(_room_for_legend())
        for found in named.values():
            if not any(each in panels[-1].renderers for each in found):
                # a legend shows only what is drawn in its own panel: here without any point
                nowhere = np.full(2, np.nan)
                found.append(_add(panels[-1], found[0].glyph.clone(), {"x": nowhere, "y": nowhere}))
        items = [LegendItem(label=name, renderers=found) for name, found in named.items()]
        # one below the other: side by side they would not fit a narrow screen
        panels[-1].add_layout(Legend(items=items, click_policy="hide", location="left"), "below")
        panels[-1].height += _LABELS + _LEGEND_LINE * len(items)


def _room_for_legend() -> Any:
    """A panel without axes: a legend inside a plane's would take of its height alone, and the plane lose its angles."""
    from bokeh.models import Range1d
    from bokeh.plotting import figure as plot

    x, y = (Range1d(start=0.0, end=1.0) for _ in range(2))
    looks: dict[str, Any] = {"tools": "", "outline_line_color": None, "min_border_left": _BORDER}
    room: Any = plot(height=0, sizing_mode="stretch_width", x_range=x, y_range=y, **looks)
    room.axis.visible = room.grid.visible = False
    return room


def _name_of(artist: Any) -> str:
    """Its name in the legend; empty without."""
    label = artist.get_label()
    return "" if label is None or str(label).startswith(_UNNAMED) else _words(str(label))


def _words(label: str) -> str:
    """A label without what keeps dollar signs from starting mathematics."""
    return label.replace(r"\$", "$")


def _stepped(x: Array, y: Array) -> tuple[Array, Array]:
    """The corners of a line that keeps its value up to the next point."""
    return np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]


def _colour(value: Any) -> str:
    from matplotlib.colors import to_hex

    return to_hex(value)


def _dash(line: Line2D) -> Any:
    style = line.get_linestyle()
    _, pattern = getattr(line, "_unscaled_dash_pattern", (0, None))
    return _DASHES.get(style, "solid") if pattern is None else tuple(round(4.0 * float(each)) or 1 for each in pattern)


def _dash_of_patch(patch: Any) -> str:
    style = patch.get_linestyle()
    return _DASHES.get(style, "solid") if isinstance(style, str) else "solid"


def _hatch(hatch: str | None) -> str | None:
    if not hatch:
        return None
    return {"/": "right_diagonal_line", "\\": "left_diagonal_line"}.get(hatch[0], "diagonal_cross")


def _numbered_anew(text: str) -> str:
    """The same layout with identifiers that count from 1 in the order of their places."""
    found = dict.fromkeys(re.findall(r'"id": "(p\d+)"', text))
    names = {old: f"f{k}" for k, old in enumerate(found, 1)}
    return re.sub(r'"(p\d+)"', lambda hit: f'"{names.get(hit[1], hit[1])}"', text)
