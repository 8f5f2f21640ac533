"""A figure as SVG text, PNG bytes or JSON for the pointer, with title and description:  equal pictures, equal bytes.

The colours are those of Okabe and Ito, for colour-blind people; lines differ by their dashes too, for grey print.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from fopi_tune.report.figures.interactive import interactive_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, BLACK, GOLD = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000", "#e69f00"
#: colour and dashes of the first, second, ... line
STYLES: tuple[tuple[str, Any], ...] = (
    (BLUE, "-"),
    (ORANGE, "--"),
    (GREEN, "-."),
    (PURPLE, ":"),
    (BLACK, (0, (5, 1, 1, 1, 1, 1))),
    (GOLD, (0, (9, 3))),
)
_RC: dict[Any, Any] = {"svg.hashsalt": "fopi-tune", "font.size": 9.0, "svg.fonttype": "none"}
_DOTS_PER_INCH = 150
#: inches; the width of a report's figures
WIDE = 8.0
#: inches; of a figure with two panels, one above the other
TWO_PANELS = (WIDE, 5.8)
#: characters of a line in the legend, and of the longest entry that shares a line
_LEGEND, _SHORT = 96, 44


@dataclass(frozen=True)
class Picture:
    """A figure before it is drawn.

    Args:
        title: one line; stands above the figure and in its metadata.
        description: a text alternative.
        draw: draws it on an empty figure.
        size_inches: width and height.
    """

    title: str
    description: str
    draw: Callable[[Figure], None]
    size_inches: tuple[float, float] = (6.4, 6.0)


def svg_of(picture: Picture) -> str:
    """SVG text with a title and a description that screen readers find."""
    with _figure(picture) as figure:
        return _svg(picture, figure)


def png_of(picture: Picture) -> bytes:
    """PNG bytes at 150 dots an inch; title and description are in its text chunks."""
    with _figure(picture) as figure:
        return _png(picture, figure)


def every_form_of(picture: Picture) -> tuple[str, bytes, str]:
    """The SVG text, the PNG bytes and the JSON of the one for the pointer, drawn once."""
    with _figure(picture) as figure:
        svg = _svg(picture, figure)
        # the layout is known now; to compute it again would take as long as the drawing
        figure.set_layout_engine("none")
        return svg, _png(picture, figure), interactive_json(figure)


def label_axes(axes: Axes, y: str, x: str = "") -> None:
    """Set the labels and a thin grid."""
    axes.set_ylabel(y)
    if x:
        axes.set_xlabel(x)
    axes.grid(True, which="both", linewidth=0.3)


def plain_text(text: str) -> str:
    """Somebody else's words, for a label: a dollar sign would start mathematics."""
    return text.replace("$", r"\$")


def with_unit_label(quantity: str, unit: str) -> str:
    """The label of an axis: "output, km/h"; the quantity alone where there is no unit."""
    return plain_text(f"{quantity}, {unit}") if unit.strip() else quantity


def log_axes(axes: Axes, *, both: bool = False) -> None:
    """Make the frequency axis (and the other, if `both`) logarithmic, with plain numbers at the powers of ten only.

    Minor ticks and numbers as formulas would take longer to draw than the curves.
    """
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if both:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.minorticks_off()


def legend_below(figure: Figure, axes: Axes) -> None:
    """Put the legend of one of the axes below all of them, where it covers no curve."""
    handles, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    longest = max(map(len, labels))
    columns = 4 if longest <= _SHORT // 2 else 2 if longest <= _SHORT else 1
    lines = ["\n".join(textwrap.wrap(label, _LEGEND)) for label in labels]
    figure.legend(
        handles, lines, loc="outside lower center", ncols=columns, fontsize=8.0, frameon=False, handlelength=3
    )


@contextmanager
def _figure(picture: Picture) -> Iterator[Figure]:
    # loaded here: plotting costs half a second
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_RC):
        figure = Figure(figsize=picture.size_inches, layout="constrained")
        picture.draw(figure)
        figure.suptitle(picture.title, fontsize=10.0, parse_math=False)
        yield figure


def _svg(picture: Picture, figure: Figure) -> str:
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = io.StringIO()
    words = {"Date": None, "Title": picture.title, "Description": picture.description, "Creator": "fopi-tune"}
    FigureCanvasSVG(figure).print_svg(text, metadata=words)
    told = f"<title>{escape(picture.title, quote=False)}</title>"
    found = text.getvalue()
    assert told in found
    return found.replace(told, f"{told}\n <desc>{escape(picture.description, quote=False)}</desc>", 1)


def _png(picture: Picture, figure: Figure) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    data = io.BytesIO()
    words = {"Title": picture.title, "Description": picture.description, "Software": "fopi-tune"}
    figure.set_dpi(_DOTS_PER_INCH)
    FigureCanvasAgg(figure).print_png(data, metadata=words)
    return data.getvalue()
