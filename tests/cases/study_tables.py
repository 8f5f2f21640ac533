"""Results of studies that were never run: cells with overrides, outcomes and collected numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from fopi_tune.study import StudyResult
from fopi_tune.study.ledger import Counts
from fopi_tune.study.model import BestRule, Cell, Column, Kind, ReportRule, Study
from fopi_tune.study.table import collect_table
from fopi_tune.study.worker import CellResult


def result_of(
    cells: Sequence[tuple[dict[str, Any], str, dict[str, Any]]], best: BestRule | None = None,
    report: ReportRule | None = None, name: str = "s",
) -> StudyResult:  # fmt: skip
    """The end of a study.

    Args:
        cells: overrides, outcome and collected values of each.
        best: which cell is the best.
        report: figures of its page.
        name: of the study and of its spec.
    """
    collected = dict.fromkeys(column for _, _, values in cells for column in values)
    made = tuple(Cell(i, Kind.SPEC, name, overrides, "{}") for i, (overrides, _, _) in enumerate(cells))
    study = Study(
        name, made, tuple(Column(c, f"tune.{c}") for c in collected), f"about {name}", best, report or ReportRule()
    )
    documents = (json.dumps({"outcome": outcome, "tune": values}) for _, outcome, values in cells)
    table = collect_table(study, enumerate(CellResult("k", text, "", 0.0) for text in documents))
    return StudyResult(study, Counts(len(cells), len(cells), 0), table, ())
