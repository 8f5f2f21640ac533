"""The table of claims:  what a row is, its verdict, and the table as text for a terminal, Markdown and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from rich.text import Text

from fopi_tune.core.text_tables.words import counted
from fopi_tune.report.text.formatting import BAD, GOOD, QUIET, Line, to_text, wrapped


class Verdict(StrEnum):
    """The outcome of checking a claim."""

    HOLDS = "holds"
    #: true under a condition that the paper does not state; the row's `why` names it
    HOLDS_WITH = "holds with a condition"
    DOES_NOT_HOLD = "does not hold"
    #: the paper gives too little to decide; the row says what follows from what it gives
    NOT_PRINTED = "not printed"


@dataclass(frozen=True)
class Row:
    """A claim and the outcome of checking it.

    Args:
        claim: one sentence.
        published: what the paper prints.
        recomputed: what this tool finds.
        verdict: follows from the two.
        why: the reason, and the tolerance where numbers are compared.
    """

    claim: str
    published: str
    recomputed: str
    verdict: Verdict
    why: str


def verdict_of(holds: bool, *, on_condition: bool = False) -> Verdict:
    """The verdict of a comparison.

    Args:
        holds: whether the claim holds.
        on_condition: whether it holds only under a condition that is not printed.
    """
    if not holds:
        return Verdict.DOES_NOT_HOLD
    return Verdict.HOLDS_WITH if on_condition else Verdict.HOLDS


def rounded_count(count: float) -> str:
    """A count to two digits: the number of switches of chattering modes depends on rounding errors."""
    return f"{float(f'{count:.2g}'):.0f}"


COLUMNS = ("claim", "published", "recomputed", "verdict", "why")
_LABEL = 14
_STYLES = {
    Verdict.HOLDS: GOOD,
    Verdict.HOLDS_WITH: GOOD,
    Verdict.DOES_NOT_HOLD: BAD,
    Verdict.NOT_PRINTED: QUIET,
}
#: name of a group -> its rows; or rows alone
Rows = Mapping[str, Sequence[Row]] | Sequence[Row]


def paper_text(rows: Rows) -> Text:
    """The claims in 80 columns, each with its verdict, numbers and reason, and the counts of verdicts."""
    lines: list[Line] = []
    for group, members in _groups(rows):
        if group:
            lines += [(group, "bold"), ("", "")]
        for row in members:
            lines += _row(row)
    return to_text([*lines, *wrapped(summary(rows), "bold")])


def summary(rows: Rows) -> str:
    """The number of claims, and of each verdict."""
    every = [row for _, members in _groups(rows) for row in members]
    counts = ", ".join(f"{verdict.value}: {sum(row.verdict is verdict for row in every)}" for verdict in Verdict)
    return f"{counted(len(every), 'claim')}. {counts[0].upper()}{counts[1:]}."


def paper_markdown(rows: Rows) -> str:
    """A table for each group, and the counts of verdicts."""
    parts = []
    for group, members in _groups(rows):
        head = [f"## {group}", ""] if group else []
        table = [_cells(COLUMNS), _cells(("---",) * len(COLUMNS)), *(_cells(_values(row)) for row in members)]
        parts.append("\n".join([*head, *table]))
    return "\n\n".join([*parts, summary(rows)]) + "\n"


def paper_csv(rows: Rows) -> str:
    """A header, then a line for each row; the first column is the group, empty without groups."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(("group", *COLUMNS))
    for group, members in _groups(rows):
        writer.writerows((group, *_values(row)) for row in members)
    return buffer.getvalue()


def _groups(rows: Rows) -> Iterable[tuple[str, Sequence[Row]]]:
    return rows.items() if isinstance(rows, Mapping) else [("", rows)]


def _values(row: Row) -> tuple[str, ...]:
    return row.claim, row.published, row.recomputed, row.verdict.value, row.why


def _cells(values: Sequence[str]) -> str:
    # a bar would end the cell
    return "| " + " | ".join(value.replace("|", "\\|") for value in values) + " |"


def _row(row: Row) -> list[Line]:
    lines = wrapped(row.claim, "bold")
    for label, words, style in (
        ("published", row.published, ""),
        ("recomputed", row.recomputed, ""),
        ("verdict", f"{row.verdict.value.upper()}", _STYLES[row.verdict]),
        ("why", row.why, QUIET),
    ):
        lines += wrapped(words, style, indent=" " * _LABEL, first=f"  {label:<{_LABEL - 2}}")
    return [*lines, ("", "")]
