"""The table of a study: parts of mappings, types in Parquet, and failed cells alone."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.study.model import Cell, Column, Kind, Study, Value
from fopi_tune.study.table import StudyTable, collect_table, override_columns
from fopi_tune.study.worker import CellResult


def table(columns: dict[str, list[Value]]) -> StudyTable:
    rows = tuple(zip(*columns.values(), strict=True))
    return StudyTable(tuple(columns), rows, (), {}, (), 0)


def parquet(columns: dict[str, list[Value]]) -> dict[str, tuple[str, list[Any]]]:
    """Types and values of a table's columns as Parquet has them."""
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    back = pq.read_table(io.BytesIO(table(columns).to_parquet()))
    return {name: (str(back.schema.field(name).type), back.column(name).to_pylist()) for name in back.column_names}


def test_columns_of_one_kind_have_its_type() -> None:
    assert parquet({"a": [1, None, 3], "b": [1, 0.5, None], "c": [True, None, False], "d": ["x", None, ""]}) == {
        "a": ("int64", [1, None, 3]),
        "b": ("double", [1.0, 0.5, None]),
        "c": ("bool", [True, None, False]),
        "d": ("string", ["x", None, ""]),
    }
    assert parquet({"e": [None, None]}) == {"e": ("string", [None, None])}


def test_a_column_with_numbers_and_text_keeps_its_numbers() -> None:
    found = parquet({"a": [1, "fit", None, 2], "b": [0.5, True, None, 1], "a_text": ["x", "y", None, None]})
    assert found == {
        "a": ("int64", [1, None, None, 2]),
        "a_text_": ("string", [None, "fit", None, None]),
        "b": ("double", [0.5, None, None, 1.0]),
        "b_text": ("string", [None, "true", None, None]),
        "a_text": ("string", ["x", "y", None, None]),
    }


def test_whole_numbers_that_no_column_holds_are_doubles() -> None:
    assert parquet({"a": [2**80, 1]}) == {"a": ("double", [float(2**80), 1.0])}


def test_mappings_are_columns_of_their_parts() -> None:
    overrides = {"a": {"b": 1, "c": {"d": [1, 2], "e": "x"}, "f": {}}, "g": 3, "a.b": 5}
    cell = Cell(0, Kind.SPEC, "s", overrides, "{}")
    # a later override of a part is the one that the spec has
    assert override_columns(cell) == {"a.b": 5, "a.c.d": "[1, 2]", "a.c.e": "x", "a.f": "{}", "g": 3}


def test_cells_without_a_part_leave_its_column_empty() -> None:
    values: list[object] = [2, {"min": 1, "max": 3}]
    cells = tuple(Cell(i, Kind.SPEC, "s", {"p": value}, "{}") for i, value in enumerate(values))
    study = Study("s", cells, (Column("kp", "tune.kp"),))
    found = collect_table(study, ((i, CellResult("k", json.dumps({"outcome": "met"}), "", 0.0)) for i in range(2)))
    assert found.columns == ("cell", "spec", "p", "p.min", "p.max", "outcome", "kp", "reason")
    assert found.rows == ((1, "s", 2, None, None, "met", None, None), (2, "s", None, 1, 3, "met", None, None))


@pytest.mark.parametrize(("claims", "shown", "code"), [("slow_1, raises", [2], 3), ("slow_1, slow_2", [], 0)])
def test_failed_cells_can_be_shown_alone_while_files_have_all(
    claims: str, shown: list[int], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("fopi_tune.study.load.load_study.__defaults__", (False, "cases.study_claims", None))
    Path("s.yaml").write_text(f"schema: 1\nname: s\nclaims: [{claims}]\n", encoding="utf-8")
    command = ["study", "s.yaml", "--workers", "0", "--only-failed"]
    told = CliRunner().invoke(app, [*command, "--json"])
    assert told.exit_code == code
    assert [row["cell"] for row in json.loads(told.stdout)["rows"]] == shown
    assert len(Path("results/s/table.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(shown) + 2 * (
        2 - len(shown)
    )
    words = CliRunner().invoke(app, command).stdout
    assert ("No cell failed." in words) == (not shown)
