"""A study's table for a terminal:  at most 80 columns of ASCII.

A title is the shortest end of the column's path that is unique, broken at dots and underscores.  A column with the
same value in every row is stated once, above.  What does not fit is in the CSV file, and the last line says so.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.text import Text

from fopi_tune.core.text_tables.words import counted
from fopi_tune.spec.model import Sense
from fopi_tune.study import StudyResult
from fopi_tune.study.model import Value
from fopi_tune.study.table import StudyTable

_WIDTH = 80
_GAP = 2
_MOST_ROWS = 60
_LONGEST_WORD = 26
_CLAIM_COLUMNS = ("claim", "published", "recomputed", "verdict", "why")


@dataclass(frozen=True)
class _Column:
    title: tuple[str, ...]
    cells: tuple[str, ...]
    right: bool

    @property
    def width(self) -> int:
        """In characters."""
        return max(len(text) for text in (*self.title, *self.cells))


def study_text(result: StudyResult, file: str) -> Text:
    """Counts, claims and table.

    Args:
        result: the end of the study.
        file: where the whole table is.
    """
    counts, table = result.counts, result.table
    told = [f"{counts.done} of {counted(counts.total, 'cell')} done"]
    told += [f"{counts.failed} failed"] if counts.failed else []
    told += [f"{table.undecided} undecided"] if table.undecided else []
    lines = [f"{result.study.name}: {', '.join(told)}."]
    lines += textwrap.wrap(best_sentence(result), _WIDTH, subsequent_indent="    ")
    for row in table.claims:
        lines += ["", *_claim(row)]
    if not table.rows and not counts.failed:
        lines += ["", "No cell failed."]
    elif any(cell.overrides or cell.stages for cell in result.study.cells):
        lines += ["", *_table(table, file)]
    return Text("\n".join(lines))


def best_sentence(result: StudyResult) -> str:
    """The best cell in words, or why there is none; empty for a study that asks for none."""
    best = result.table.best
    if best is None:
        return ""
    if best.index is None or best.value is None:
        return f"Best: no cell; {best.message}."
    cell, rule = result.study.cells[best.index], best.rule
    least = "least" if rule.sense is Sense.MINIMIZE else "largest"
    value = f"{rule.column}, {best.value:.5g}"
    return f"Best: cell {best.index + 1} ({cell.label}) has the {least} {value}, {best.message}."


def _claim(row: Mapping[str, Value]) -> list[str]:
    """A claim's row as a paragraph."""
    head = f"{row.get('verdict')}: {row.get('claim')}"
    values = f"published {_full_text(row.get('published'))}; recomputed {_full_text(row.get('recomputed'))}"
    others = [
        f"{key} {_full_text(value)}" for key, value in row.items() if key not in _CLAIM_COLUMNS and value is not None
    ]
    body = "; ".join([values, *others])
    why = str(row.get("why") or "")
    lines = textwrap.wrap(head, _WIDTH, subsequent_indent="    ") + _indented(body)
    return lines + (_indented(why) if why else [])


def _full_text(value: Value) -> str:
    """A value without abbreviation."""
    return value if isinstance(value, str) else _cell_text(value)


def _indented(words: str) -> list[str]:
    return textwrap.wrap(words, _WIDTH, initial_indent="    ", subsequent_indent="    ")


def _table(table: StudyTable, file: str) -> list[str]:
    # claims and failures are listed elsewhere
    left_out = {"entry", "reason", *(key for row in table.claims for key in row)}
    names = [name for name in table.columns if name not in left_out]
    rows = [row for row in table.rows if row[table.columns.index("cell")] is not None]
    if "spec" in table.columns:
        rows = [row for row in rows if row[table.columns.index("spec")] is not None]
    values = {name: [row[table.columns.index(name)] for row in rows] for name in names}
    titles = _titles(names)
    same = [n for n in names if n != "cell" and len(rows) > 1 and len({repr(v) for v in values[n]}) == 1]
    told = [f"{titles[name]} {_cell_text(values[name][0])}" for name in same if values[name][0] is not None]
    lines = textwrap.wrap("in every row: " + ", ".join(told), _WIDTH) if told else []
    shown = len(rows) if len(rows) <= _MOST_ROWS else _MOST_ROWS - 20
    columns = [_column(titles[name], values[name][:shown]) for name in names if name not in same]
    fitting = columns
    while len(fitting) > 1 and sum(c.width for c in fitting) + _GAP * (len(fitting) - 1) > _WIDTH:
        fitting = fitting[:-1]
    lines += ["", *_column_lines(fitting, shown)] if lines else _column_lines(fitting, shown)
    missing = [counted(len(rows) - shown, "more row")] if shown < len(rows) else []
    missing += [counted(len(columns) - len(fitting), "more column")] if len(fitting) < len(columns) else []
    return lines + (["", f"{' and '.join(missing)} in {file}"] if missing else [])


def _titles(names: Sequence[str]) -> dict[str, str]:
    """The shortest unique end of each path."""
    found = {}
    for name in names:
        parts = name.split(".")
        for count in range(1, len(parts) + 1):
            end = ".".join(parts[-count:])
            others = (other for other in names if other != name)
            if count == len(parts) or not any(other == end or other.endswith(f".{end}") for other in others):
                found[name] = end
                break
    return found


def _column(title: str, values: Sequence[Value]) -> _Column:
    cells = tuple(_cell_text(value) for value in values)
    width = max([4, *(len(cell) for cell in cells)])
    numbers = all(value is None or isinstance(value, int | float) for value in values)
    return _Column(tuple(_broken(title, max(width, 9))), cells, numbers)


def _broken(title: str, width: int) -> list[str]:
    """A title in lines of about a width, broken after dots and underscores."""
    lines = [""]
    for part in re.findall(r"[^._]+[._]*|[._]+", title):
        if lines[-1] and len(lines[-1]) + len(part) > width:
            lines.append("")
        lines[-1] += part
    return lines


def _column_lines(columns: Sequence[_Column], count: int) -> list[str]:
    height = max(len(column.title) for column in columns)
    titles = [("",) * (height - len(column.title)) + column.title for column in columns]
    lines = [[title[i] for title in titles] for i in range(height)]
    lines += [[column.cells[i] for column in columns] for i in range(count)]
    gap = " " * _GAP
    aligned = (
        gap.join(t.rjust(c.width) if c.right else t.ljust(c.width) for t, c in zip(line, columns, strict=True))
        for line in lines
    )
    return [line.rstrip() for line in aligned]


def _abbreviated(text: str) -> str:
    """A short form of an uncertain number, a range of gains or an objective, which tables hold as JSON."""
    try:
        told = json.loads(text) if text.startswith("{") else None
    except ValueError:
        return text
    if isinstance(told, dict) and len(told) == 1 and all(isinstance(value, str) for value in told.values()):
        return str(next(iter(told.values())))
    if not isinstance(told, dict) or not {"min", "max"} <= set(told) <= {"min", "max", "nominal"}:
        return text
    return f"{_cell_text(told['min'])} to {_cell_text(told['max'])}"


def _cell_text(value: Value) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.5g}"
    text = _abbreviated(str(value))
    return text if len(text) <= _LONGEST_WORD else f"{text[: _LONGEST_WORD - 3]}..."
