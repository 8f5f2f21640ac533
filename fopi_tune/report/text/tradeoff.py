"""A sweep of one limit (trade-off) as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.core.controller import numbers_of
from fopi_tune.core.terms.controller_spec import ControllerSpec
from fopi_tune.core.text_tables.words import counted
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


def tradeoff_text(result: Tradeoff) -> Text:
    """The curve as a table of at most 80 columns, and where it ends."""
    knob, solved = result.knob, result.status == "solved"
    every = -(-len(result.points) // _MOST_ROWS)
    met, of = len(result.met), len(result.points)
    said = (
        f"{met} of {counted(of, 'limit')} of the sweep can be met; the check passed each."
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
        lines += wrapped(end_words(end))
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


def end_words(end: FeasibleEnd) -> str:
    """Where the limits that can be met end."""
    if end.infeasible is None:
        side = "up" if end.way > 0 else "down"
        return f"Looking {side} to {number(end.feasible)}, every limit can be met."
    beyond = "above" if end.way > 0 else "below"
    return (
        f"Feasible up to {number(end.feasible, 6)}; no start led to gains that meet {number(end.infeasible, 6)}, "
        f"and what lies {beyond} it is taken for infeasible."
    )


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
