"""The table of a study:  cells and their results -> columns and rows, and these as CSV and Parquet.

It holds no times and does not depend on the order in which cells were run, so an interrupted study gives the same
bytes.
"""

from __future__ import annotations

import base64
import csv
import io
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

from fopi_tune.errors import DomainError
from fopi_tune.study.best import BEST, Best, find_best
from fopi_tune.study.model import Cell, Kind, Study, Value
from fopi_tune.study.overrides import parse_path
from fopi_tune.study.worker import CellResult

#: of a column of whole numbers in Parquet, of 64 bits
_LARGEST_WHOLE = 2**63 - 1


@dataclass(frozen=True)
class StudyTable:
    """Columns in order, and rows in the order of the cells; missing values are None.

    Args:
        columns: their names.
        rows: a value each.
        claims: rows of claims, as their registry made them, in order.
        files: name to content of the figures.
        empty: collected columns that no cell fills.
        undecided: cells that could be neither proved nor refuted.
        best: the best cell, or why there is none; None for a study that asks for none.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]
    claims: tuple[Mapping[str, Value], ...]
    files: Mapping[str, str | bytes]
    empty: tuple[str, ...]
    undecided: int
    best: Best | None = None

    def to_csv(self) -> str:
        """RFC 4180 with newlines; numbers can be read back to the last bit."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_csv_field(value) for value in row] for row in self.rows)
        return text.getvalue()

    def to_parquet(self) -> bytes:
        """The table as Parquet: columns of whole numbers, numbers, booleans or text.

        A column with numbers and text is two: its numbers, and its text in the column of its name and `_text`.

        Raises:
            DomainError: pyarrow is not installed.
        """
        require_parquet()
        pa, pq = import_module("pyarrow"), import_module("pyarrow.parquet")

        typed: dict[str, list[Any]] = {}
        for i, name in enumerate(self.columns):
            typed |= _typed_columns(name, [row[i] for row in self.rows], {*self.columns, *typed})
        arrays = [pa.array(column, type=_arrow_type(pa, column)) for column in typed.values()]
        sink = pa.BufferOutputStream()
        pq.write_table(pa.Table.from_arrays(arrays, names=list(typed)), sink)
        return sink.getvalue().to_pybytes()

    def only_failed(self) -> StudyTable:
        """The table with the rows of failed cells alone."""
        outcome = self.columns.index("outcome")
        return replace(self, claims=(), rows=tuple(row for row in self.rows if row[outcome] == "failed"))

    def to_dicts(self) -> list[dict[str, Value]]:
        """The rows for JSON."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


def require_parquet() -> None:
    """Check that Parquet can be written, before anything is computed.

    Raises:
        DomainError: pyarrow is not installed.
    """
    try:
        import_module("pyarrow")
    except ImportError:
        message = "Parquet needs pyarrow, which is not installed; install fopi-tune[parquet], or take the CSV file"
        raise DomainError(message) from None


def collect_table(study: Study, results: Iterable[tuple[int, CellResult]]) -> StudyTable:
    """Collect a study's table from its results.

    Args:
        study: with its cells.
        results: index and result of every cell that was run, in order.
    """
    records: list[dict[str, Value]] = []
    claims: list[Mapping[str, Value]] = []
    files: dict[str, str | bytes] = {}
    for index, result in results:
        cell, document = study.cells[index], json.loads(result.document)
        files |= document.get("files", {})
        files |= {name: base64.b64decode(text) for name, text in document.get("base64", {}).items()}
        common: dict[str, Value] = {"cell": index + 1, _name_column(cell): cell.name}
        common |= override_columns(cell)
        common["outcome"] = "failed" if result.failed else document.get("outcome", "failed")
        reason: dict[str, Value] = {"reason": result.reason or document.get("reason") or None}
        if cell.kind is Kind.CLAIM:
            claim_rows = [{key: _table_value(value) for key, value in row.items()} for row in document.get("rows", [])]
            claims += claim_rows
            records += [{**common, **row, **reason} for row in claim_rows] or [{**common, **reason}]
            continue
        collected = (
            {c.name: _table_value(value_at(document, c.path)) for c in study.collect} if cell.is_designed else {}
        )
        records.append({**common, **collected, **reason})
    best = None if study.best is None else find_best(study.best, [each for each in records if "spec" in each])
    if best is not None:
        records = [{**each, BEST: each["cell"] == _number_of(best)} if "spec" in each else each for each in records]
    columns = _columns(study, records)
    rows = tuple(tuple(record.get(name) for name in columns) for record in records)
    undecided = sum(record["outcome"] == "undecided" for record in records)
    specs = [record for record in records if "spec" in record]
    empty = [c.name for c in study.collect if specs and all(record[c.name] is None for record in specs)]
    return StudyTable(columns, rows, tuple(claims), files, tuple(empty), undecided, best)


def _number_of(best: Best) -> int | None:
    """The best cell's number in the table."""
    return None if best.index is None else best.index + 1


def value_at(document: Any, path: str) -> Any:
    """The value at a path of a result, or None."""
    for step in parse_path(path) or ():
        if isinstance(step, int):
            document = document[step] if isinstance(document, list) and step < len(document) else None
        else:
            document = document.get(step) if isinstance(document, dict) else None
    return document


def known_columns(study: Study) -> tuple[str, ...]:
    """Names of the columns of the cells of specs, before anything is run."""
    names = dict.fromkeys(path for cell in study.cells for path in override_columns(cell))
    return (*names, "outcome", *(column.name for column in study.collect))


def _columns(study: Study, records: Sequence[Mapping[str, Value]]) -> tuple[str, ...]:
    """Names of the columns: cell, spec or entry, overrides, outcome, collected values, reason."""
    cells: Sequence[Cell] = study.cells
    names = dict.fromkeys(["cell", *(_name_column(cell) for cell in cells)])
    names |= dict.fromkeys(path for cell in cells for path in override_columns(cell))
    marked = [] if study.best is None else [BEST]
    names |= dict.fromkeys(["outcome", *marked, *(c.name for c in study.collect)])
    names |= dict.fromkeys(name for record in records for name in record if name != "reason")
    return (*names, "reason")


def override_columns(cell: Cell) -> dict[str, Value]:
    """A cell's overrides as columns; a mapping gives columns of its parts, named by their paths."""
    found: dict[str, Value] = {}
    for path, value in cell.overrides.items():
        found |= _parts(path, value)
    return found


def _parts(path: str, value: object) -> dict[str, Value]:
    if not isinstance(value, Mapping) or not value:
        return {path: _table_value(value)}
    return {name: part for key, inner in value.items() for name, part in _parts(f"{path}.{key}", inner).items()}


def _name_column(cell: Cell) -> str:
    """The column of a cell's name."""
    return "spec" if cell.is_designed else "entry"


def _table_value(value: Any) -> Value:
    """A value as one field of a table; lists and mappings become JSON."""
    if value is None or isinstance(value, str | int | float | bool):
        return value
    return json.dumps(value, sort_keys=True)


def _csv_field(value: Value) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _typed_columns(name: str, column: Sequence[Value], names: Collection[str]) -> dict[str, list[Any]]:
    """A column as one of a single type, or as its numbers and its text; `names` are taken."""
    present = [value for value in column if value is not None]
    numbers = [value for value in present if _is_number(value)]
    if len(numbers) < len(present) and not all(isinstance(value, bool) for value in present):
        text = [None if value is None or _is_number(value) else _csv_field(value) for value in column]
        if not numbers:
            return {name: text}
        other = f"{name}_text"
        while other in names:
            other += "_"
        return {**_typed_columns(name, [v if _is_number(v) else None for v in column], names), other: text}
    if numbers and not all(isinstance(value, int) and abs(value) <= _LARGEST_WHOLE for value in numbers):
        return {name: [None if value is None else float(value) for value in column]}
    return {name: list(column)}


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _arrow_type(pa: Any, column: Sequence[Any]) -> Any:
    """The Arrow type of a column; text for an empty one."""
    first = next((value for value in column if value is not None), "")
    kinds = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    return kinds[type(first)]
