"""Results in a session of Python or a notebook:  a few lines of text, an HTML table, a data frame."""

from __future__ import annotations

import html
import math
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.errors import DomainError
from fopi_tune.results.saved.writing import folder_of, obstacle, write_file
from fopi_tune.results.views.tables import Row, html_table, rows_of

if TYPE_CHECKING:
    import pandas as pd

#: of the text that stands for a result
_MOST_LINES, _WIDTH = 10, 78


class Saved(ABC):
    """What can be written to files as the command line does."""

    @abstractmethod
    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """The files that hold the result, without figures: name in the folder of results, and content.

        The spec is the first one and the document that states the gains the last.

        Raises:
            DomainError: a controller cannot be exported as code.
        """

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the files that hold the result, as the command line does; `ft.load` reads them again.

        Each file is replaced at once or not at all.  Figures and pages are not among them: `fopi report` makes them.

        Args:
            folder: where; made where there is none.

        Returns:
            The folder.

        Raises:
            DomainError: it is no folder, cannot be written to, or a controller cannot be exported as code.
        """
        path = folder_of(folder)
        for name, content in list(self.data_files()):
            try:
                write_file(path / name, content)
            except OSError as error:
                reason = obstacle(path / name, error)
                raise DomainError(f"cannot write {path / name} ({reason}); give another folder") from None
        return path


class Shown(Saved):
    """A result that shows itself."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""

    def rows(self) -> list[Row]:
        """A row for each requirement, limit or measure, as in the table of the notebook."""
        return rows_of(self.to_dict())

    def to_pandas(self) -> pd.DataFrame:
        """The rows as a data frame.

        Raises:
            DomainError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise DomainError("a data frame needs pandas; install it with `pip install pandas`") from None
        return pd.DataFrame(self.rows())

    def __repr__(self) -> str:
        return "\n".join(summary_lines(type(self).__name__, self.to_dict()))

    def _repr_html_(self) -> str:
        first, *others = summary_lines(type(self).__name__, self.to_dict())
        rows = self.rows()
        text = "<br>".join(html.escape(line) for line in others)
        return f"<p><b>{html.escape(first)}</b><br>{text}</p>" + (html_table(rows) if rows else "")


def summary_lines(kind: str, document: Mapping[str, Any]) -> list[str]:
    """What a result says in at most ten lines: status, gains, objective, and how many requirements are met.

    Args:
        kind: of the result, for the first line.
        document: its JSON.
    """
    lines = [f"{kind} of {document['name']}: {document['status']}", *_told(document)]
    if len(lines) > _MOST_LINES:
        lines = [*lines[: _MOST_LINES - 1], f"… and {counted(len(lines) - _MOST_LINES + 1, 'more line')}"]
    return [line if len(line) <= _WIDTH else line[: _WIDTH - 1] + "…" for line in lines]


def _told(document: Mapping[str, Any]) -> Iterator[str]:
    gains = document.get("gains") or {}
    several = any(isinstance(each, Mapping) for each in gains.values())
    for mode, numbers in gains.items() if several else [("", gains)]:
        if numbers:
            told = ", ".join(f"{name} = {value:.6g}" for name, value in numbers.items())
            yield (f"  {mode}: " if mode else "  ") + told
    if document.get("objective") is not None:
        gap = document.get("gap")
        within = f", at most {100.0 * gap:.3g} % from the best" if gap is not None else ""
        yield f"  {document['objective_quantity']}: {document['objective']:.6g}{within}"
    rows = [row for row in rows_of(document) if row.get("verdict") or row.get("met") is not None]
    if "joint_yield" in document:
        joint = document["joint_yield"]
        # rounded outwards: an interval never says more than was counted
        ends = math.floor(1e4 * joint["low"]) / 100.0, math.ceil(1e4 * joint["high"]) / 100.0
        shares = f"{ends[0]:g} .. {ends[1]:g} %"
        yield (
            f"  {joint['met']} of {counted(joint['total'], 'plant')} "
            f"{agreeing(joint['met'], 'meets', 'meet')} everything at once ({shares})"
        )
        rows = [row for row in rows if row["met"] < row["total"]][1:]
        yield from (f"  {_of(row)}: {row['met']} of {row['total']}" for row in rows)
    elif rows:
        missed = [
            row for row in rows if row.get("verdict") in ("violated", "open", "undecided") or row.get("met") is False
        ]
        met = len(rows) - len(missed)
        yield f"  {met} of {len(rows)} requirements and limits {agreeing(met, 'is', 'are')} met"
        yield from (f"  {row.get('verdict', 'violated')}: {_of(row)}" for row in missed)
    for words in (document.get("message"), *document.get("notes", ())):
        if words:
            yield f"  {words}"


def _of(row: Row) -> str:
    """A row's requirement, and its scenario."""
    return row["requirement"] + (f" in {row['scenario']}" if row.get("scenario") else "")
