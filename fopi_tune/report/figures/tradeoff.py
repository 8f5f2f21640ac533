"""A sweep of one limit (trade-off) as a figure of its own."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from fopi_tune.prices.result import PointStatus
from fopi_tune.report.figures.picture import BLACK, BLUE, ORANGE, plain_text
from fopi_tune.report.text.formatting import number
from fopi_tune.report.text.measures import limit_phrase
from fopi_tune.report.text.tradeoff import end_words

if TYPE_CHECKING:
    from fopi_tune.prices import Tradeoff, TradeoffPoint


def tradeoff_svg(result: Tradeoff) -> str:
    """The objective against the limit; the infeasible side is shaded, the spec's own limit marked."""
    # loaded here: plotting costs half a second
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    requirement = result.knob.requirement
    title = f"{result.spec.name}: trade-off of requirement {result.knob.name}"
    limits = [p.limit for p in result.points] + [result.own.limit]
    low, high = min(limits), max(limits)
    room = 0.08 * ((high - low) or 1.0)
    with matplotlib.rc_context(
        {"svg.hashsalt": "fopi-tune", "font.size": 9.0, "svg.fonttype": "none", "hatch.linewidth": 0.4}
    ):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        canvas = FigureCanvasSVG(figure)
        axes = figure.subplots()
        met = result.met
        axes.plot([p.limit for p in met], [_value(p) for p in met], ".-", color=BLUE, markersize=4, linewidth=1.2)
        if result.own.objective is not None:
            axes.plot([result.own.limit], [result.own.objective], "D", color=BLACK, markersize=5)
        axes.axvline(result.own.limit, color=BLACK, linestyle="--", linewidth=0.8)
        axes.set_xlim(low - room, high + room)
        for first, last in _shaded(result, low - room, high + room):
            axes.axvspan(first, last, facecolor="0.88", edgecolor="0.6", hatch="//", linewidth=0.0, zorder=0)
            axes.text(
                0.5 * (first + last), 0.5, "infeasible", rotation=90, ha="center", va="center",
                transform=axes.get_xaxis_transform(), bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )  # fmt: skip
        for point in result.points:
            if point.status is PointStatus.REFUSED:
                axes.axvline(point.limit, color=ORANGE, linestyle=":", linewidth=1.2)
        axes.text(
            result.own.limit, 1.01, "the spec's limit", ha="center", va="bottom", fontsize=8.0,
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
        axes.set_xlabel(plain_text(f"limit of {result.knob.quantity_name} ({requirement.relation.value})"))
        axes.set_ylabel(plain_text(result.objective_quantity.partition(" (proxy")[0]))
        axes.set_title(plain_text(title), pad=16.0)
        axes.grid(True, linewidth=0.3)
        buffer = io.StringIO()
        canvas.print_svg(buffer, metadata={"Date": None, "Title": title, "Creator": "fopi-tune"})
    return _with_words(buffer.getvalue(), title, _alternative(result))


def _shaded(result: Tradeoff, low: float, high: float) -> Iterator[tuple[float, float]]:
    """The infeasible ranges of the limit, within the axis."""
    for end in result.ends:
        if end.infeasible is not None:
            first, last = (end.infeasible, high) if end.way > 0 else (low, end.infeasible)
            if first < last:
                yield first, last


def _alternative(result: Tradeoff) -> str:
    """A text alternative of the figure."""
    words = [f"{result.objective_quantity} against the limit of {limit_phrase(result.knob.requirement)}."]
    if result.met:
        first, last = result.met[0], result.met[-1]
        words += [
            f"From {number(_value(first))} at {number(first.limit)} to {number(_value(last))} at {number(last.limit)}."
        ]
    if result.own.objective is not None:
        words.append(f"The spec's own limit is {number(result.own.limit)}, with {number(result.own.objective)}.")
    words += [end_words(end) for end in result.ends]
    refused = [number(p.limit) for p in result.points if p.status is PointStatus.REFUSED]
    if refused:
        words.append(f"Dotted: the check refused the gains at {', '.join(refused)}.")
    return " ".join(words)


def _value(point: TradeoffPoint) -> float:
    assert point.objective is not None
    return point.objective


def _with_words(svg: str, title: str, description: str) -> str:
    """The SVG with a title and a description for screen readers."""
    at = svg.index("<svg ")
    end = svg.index(">", at) + 1
    opening = svg[at:end].replace("<svg ", '<svg role="img" aria-labelledby="title desc" ', 1)
    words = f'\n <title id="title">{escape(title)}</title>\n <desc id="desc">{escape(description)}</desc>'
    # the plotting library's own title says the same
    rest = svg[end:].replace(f"<title>{escape(title)}</title>", "", 1)
    return svg[:at] + opening + words + rest
