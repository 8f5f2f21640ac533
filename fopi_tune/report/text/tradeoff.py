"""A sweep of one limit (trade-off) as text and as a figure."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from rich.text import Text

from fopi_tune.core.controller import numbers_of
from fopi_tune.core.terms.controller_spec import ControllerSpec
from fopi_tune.prices.result import PointStatus
from fopi_tune.report.figures.picture import plain_text
from fopi_tune.report.text.formatting import (
    BAD,
    QUIET,
    Line,
    number,
    style_of,
    to_text,
    wrapped,
)
from fopi_tune.report.text.measures import limit_phrase, limit_scope_phrase

if TYPE_CHECKING:
    from fopi_tune.prices import FeasibleEnd, Tradeoff, TradeoffPoint

#: rows of the table; of more points every second, third, ... is shown
_MOST_ROWS = 26
_CURVE, _OWN, _REFUSED = "#0072b2", "#000000", "#d55e00"


def tradeoff_text(result: Tradeoff) -> Text:
    """The curve as a table of at most 80 columns, and where it ends."""
    knob, solved = result.knob, result.status == "solved"
    every = -(-len(result.points) // _MOST_ROWS)
    met, of = len(result.met), len(result.points)
    said = (
        f"{met} of {of} limits of the sweep can be met; the check passed each."
        if solved
        else "The check refused some gains."
    )
    lines: list[Line] = [*wrapped(f"{result.spec.name}, trade-off: {said}", style_of(solved)), ("", "")]
    lines += wrapped(
        f"requirement {knob.name}: {limit_phrase(knob.requirement)}, {limit_scope_phrase(knob.requirement)}"
    )
    lines += wrapped(f"objective: {result.objective_quantity}")
    others = "".join(f"{name:>{width}}" for name, width in _others(result.spec.controller).items())
    lines += [("", ""), (f"{'limit':>12}{'objective':>13}{'kp':>12}{'ki':>12}{others}", "bold")]
    shown = [p for k, p in enumerate(result.points) if k % every == 0 or k == of - 1]
    for point in sorted((*shown, result.own), key=lambda p: p.limit):
        lines.append(_row(point, point is result.own, _others(result.spec.controller)))
    lines += [("", "")]
    for end in result.ends:
        lines += wrapped(_end_words(end))
    rest = f"  One limit of {every} is shown; all are in tradeoff.csv." if every > 1 else ""
    lines += wrapped(f"* the spec's own limit.  - the limit holds nothing back there.{rest}", QUIET)
    return to_text(lines)


def _others(controller: ControllerSpec) -> dict[str, int]:
    """The columns after ki, with their widths; with five numbers the scores have no room."""
    return {
        "fopid": {"alpha": 7, "kd": 11, "mu": 7},
        "pid": {"kd": 12, "score": 9},
        "fopi": {"alpha": 10, "score": 9},
    }[controller.structure]


def _row(point: TradeoffPoint, own: bool, others: Mapping[str, int]) -> Line:
    mark = "  *" if own else ""
    if point.gains is None or point.objective is None:
        return f"{number(point.limit):>12}{point.status.value:>13}{mark}", BAD
    gains, score = point.gains, "-" if point.largest_score is None else f"{point.largest_score:.3f}"
    digits: dict[str, int] = dict.fromkeys(("alpha", "mu"), 4) if "mu" in others else {}
    shown = {name: number(value, digits.get(name, 5)) for name, value in numbers_of(gains).items()} | {"score": score}
    numbers = "".join(f"{shown[name]:>{width}}" for name, width in ({"kp": 12, "ki": 12} | dict(others)).items())
    loose = "" if point.binds else " -"
    return (
        f"{number(point.limit):>12}{number(point.objective):>13}{numbers}{loose}{mark}",
        "bold" if own else "",
    )


def _end_words(end: FeasibleEnd) -> str:
    if end.infeasible is None:
        side = "up" if end.way > 0 else "down"
        return f"Looking {side} to {number(end.feasible)}, every limit can be met."
    beyond = "above" if end.way > 0 else "below"
    return (
        f"Feasible up to {number(end.feasible, 6)}; no start led to gains that meet {number(end.infeasible, 6)}, "
        f"and what lies {beyond} it is taken for infeasible."
    )


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
        axes.plot([p.limit for p in met], [_value(p) for p in met], ".-", color=_CURVE, markersize=4, linewidth=1.2)
        if result.own.objective is not None:
            axes.plot([result.own.limit], [result.own.objective], "D", color=_OWN, markersize=5)
        axes.axvline(result.own.limit, color=_OWN, linestyle="--", linewidth=0.8)
        axes.set_xlim(low - room, high + room)
        for first, last in _shaded(result, low - room, high + room):
            axes.axvspan(first, last, facecolor="0.88", edgecolor="0.6", hatch="//", linewidth=0.0, zorder=0)
            axes.text(
                0.5 * (first + last), 0.5, "infeasible", rotation=90, ha="center", va="center",
                transform=axes.get_xaxis_transform(), bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )  # fmt: skip
        for point in result.points:
            if point.status is PointStatus.REFUSED:
                axes.axvline(point.limit, color=_REFUSED, linestyle=":", linewidth=1.2)
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
    words += [_end_words(end) for end in result.ends]
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


def price_lines(prices: Sequence[tuple[str, float | None, float | None, bool, bool]]) -> Iterator[Line]:
    """The multipliers that were checked, as (name, relaxed, tightened, agrees, kink)."""
    if not prices:
        return
    if all(agrees for *_, agrees, _ in prices):
        yield "Solving again with each limit moved confirms the multipliers.", QUIET
    for name, relaxed, tightened, agrees, kink in prices:
        if agrees:
            continue
        told = [
            f"{word} gains {number(value, 3)}" if word == "relaxing" else f"{word} costs {number(value, 3)}"
            for word, value in (("relaxing", relaxed), ("tightening", tightened))
            if value is not None
        ]
        found = ", ".join(told) or "no answer with the limit moved"
        why = ": another requirement comes into play at this very limit" if kink else ""
        if not kink and (relaxed is None) != (tightened is None):
            why = "; the other way no answer was found"
        yield from wrapped(f"* {name}, solved again with the limit moved: {found} for each unit{why}.")
