"""What is said while a study runs: cells, workers, the measured cost of a cell, and the time that is left."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fopi_tune.cli.progress import ProgressStyle, progress_display
from fopi_tune.study import Machines, run
from fopi_tune.study.ledger import Cost, Counts
from fopi_tune.study.load import load_study


def said(style: ProgressStyle, capsys: pytest.CaptureFixture[str], *all_counts: Counts) -> list[str]:
    with progress_display(style, quiet=False) as told:
        assert told is not None
        for counts in all_counts:
            told(counts)
    return capsys.readouterr().err.splitlines()


def test_a_line_has_the_cost_of_a_cell_and_the_time_that_is_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fopi_tune.cli.progress._LINE_EVERY_S", 0.0)
    lines = said(
        ProgressStyle.LINES, capsys, Counts(60, 0, 0), Counts(60, 12, 0, Cost(2, 0.314, 93.0)),
        Counts(60, 58, 2, Cost(1, 2.0, 0.0)),
    )  # fmt: skip
    assert lines[0] == "0 of 60 cells"
    assert lines[1].startswith("12 of 60 cells, 2 workers, 0.31 processor s a cell, ")
    assert lines[1].endswith(", 1 min 33 s left")
    assert lines[2].startswith("60 of 60 cells, 2 failed, 1 worker, 2 processor s a cell, ")
    assert "left" not in lines[2]


def test_lines_for_programs_have_the_cost_too(capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(ProgressStyle.JSONL, capsys, Counts(4, 0, 0), Counts(4, 1, 0, Cost(2, 0.5, 3.0)))
    first, second = (json.loads(line) for line in lines)
    assert (first["workers"], first["cell_processor_s"], first["left_s"]) == (None, None, None)
    assert (second["workers"], second["cell_processor_s"], second["left_s"]) == (2, 0.5, 3.0)


def test_without_an_estimate_the_rate_tells_the_time(capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(ProgressStyle.JSONL, capsys, Counts(4, 0, 0), Counts(4, 2, 0, Cost(2, 0.5, None)))
    told = json.loads(lines[1])
    assert told["left_s"] == pytest.approx(2.0 / told["cells_per_s"])


def test_a_run_measures_its_cells(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text("schema: 1\nname: s\nclaims: [slow_1, slow_2, slow_3]\n", encoding="utf-8")
    asked: list[Counts] = []
    run(load_study(file, registry="cases.study_claims"), tmp_path / "out", Machines(0), told=asked.append)
    assert asked[0].cost is None
    costs = [counts.cost for counts in asked[1:]]
    assert all(cost is not None and cost.workers == 1 and cost.cell_processor_s >= 0.0 for cost in costs)
    last = costs[-1]
    assert last is not None
    assert last.left_s == 0.0
