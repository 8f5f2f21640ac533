"""Studies: what a cell gives, the ledger, the table, and `fopi study` in one process."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import io
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from cases.project import CONTINUOUS, IMPORTED
from cases.study_files import LAG
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.design import design, neighbour
from fopi_tune.design.global_search.nonlinear.program import raising_interrupts
from fopi_tune.errors import FopiError
from fopi_tune.montecarlo.montecarlo import SCANNED
from fopi_tune.pipeline.discretize import discretize
from fopi_tune.pipeline.prove import prove
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.validate import validate
from fopi_tune.report import study_text
from fopi_tune.results.stamp import numeric_versions
from fopi_tune.simulation.sampled.simulate import available_threads
from fopi_tune.spec import load_spec
from fopi_tune.study import Machines, StudyResult, run
from fopi_tune.study.engine import InProcessRunner, Task, TaskOutcome, draw_blocks, run_study
from fopi_tune.study.ledger import LEDGER, Counts, LedgerError, open_ledger, read_ledger
from fopi_tune.study.load import load_study
from fopi_tune.study.model import Cell, Column, Kind, Study
from fopi_tune.study.overrides import spec_from_text
from fopi_tune.study.table import collect_table, value_at
from fopi_tune.study.worker import CellResult, combine_blocks, run_block, run_cell, run_chunk

HERE = Machines(0)
ENVIRONMENT = os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"}
VERSIONS = numeric_versions()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(text: str, head: str = "schema: 1\nname: s\nspecs: [lag.yaml]\n") -> str:
    Path("s.yaml").write_text(head + text, encoding="utf-8")
    return "s.yaml"


def study(text: str) -> Study:
    return load_study(write(text))


def claims(names: str) -> Study:
    return load_study(write(f"claims: {names}\n", "schema: 1\nname: c\n"), registry="cases.study_claims")


def document(cell: Cell) -> dict[str, object]:
    result = run_cell("key", cell)
    assert not result.reason, result.reason
    return json.loads(result.document)


def records(result: StudyResult) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(result.table.to_csv())))


def test_a_cells_numbers_are_those_of_the_single_commands() -> None:
    cell = study("grid: {check.plant.time_constant_s.max: [2.9]}\nstages: [tune, prove, discretize, validate]").cells[0]
    results = document(cell)
    gains = FoPi(0.385, 0.388, 0.82)
    checked = spec_from_text(cell.check)
    assert results["tune"] == tune(spec_from_text(cell.text), proof=False).to_dict()
    assert results["prove"] == prove(checked, gains).to_dict()
    assert results["discretize"] == discretize(checked, gains).to_dict()
    assert results["validate"] == validate(checked, gains).to_dict()
    assert results["outcome"] == "met"


def test_a_proof_against_the_same_spec_is_the_designs_own() -> None:
    results = document(study("stages: [tune, prove]").cells[0])
    design = tune(load_spec("lag.yaml")).to_dict()
    proved = prove(load_spec("lag.yaml"), FoPi(0.385, 0.388, 0.82)).to_dict()
    mine = results["prove"]
    assert isinstance(mine, dict)
    assert mine["status"] == proved["status"] == "met"
    assert mine["proof"]["verdict"] == design["proof"]["verdict"] == "proved"
    assert {k: v for k, v in mine["requirements"][0].items() if k != "multiplier"} == {
        k: v for k, v in proved["requirements"][0].items() if k != "multiplier"
    }


def test_an_infeasible_cell_is_an_answer_and_its_later_stages_are_left_out() -> None:
    wrong = "grid: {'requirements[0].phase_margin_deg.at_least': [85]}\nstages: [tune, prove, validate]"
    result = run_cell("key", study(wrong).cells[0])
    told = json.loads(result.document)
    assert not result.failed
    assert told["outcome"] == "infeasible"
    assert "validate" not in told
    assert "do not meet it" in told["reason"]


def test_the_first_stage_that_does_not_end_well_is_the_outcome() -> None:
    results = document(study("grid: {check.plant.time_constant_s.max: [9]}\nstages: [prove, validate]").cells[0])
    assert results["outcome"] == "violated"
    assert results["reason"] == "prove: violated"
    assert isinstance(results["validate"], dict)


def test_what_a_cell_raises_is_its_reason_and_what_it_did_before_is_kept() -> None:
    cell = study(
        "grid: {digital.band_rad_s: [[1.0e-3, 1.0e-2]], digital.method: [fit]}\nstages: [tune, discretize]"
    ).cells[0]
    result = run_cell("key", cell)
    if not result.failed:  # a band that can be made after all would make this test say nothing
        pytest.fail("the band was expected to be refused")
    assert "internal error" not in result.reason
    assert json.loads(result.document)["tune"]["status"] == "solved"
    odd = run_cell("key", Cell(0, Kind.CLAIM, "raises", {}, "cases.study_claims"))
    assert odd.reason == "internal error, ZeroDivisionError: on purpose"


def test_a_worker_with_other_versions_runs_nothing() -> None:
    cell = study("").cells[0]
    (result,) = run_chunk([("key", cell)], {**VERSIONS, "casadi": "0.0"})
    told = f"this worker has casadi {VERSIONS['casadi']} instead of 0.0"
    assert result.reason == f"{told}; install the same versions and use --retry-failed"


def test_a_result_does_not_depend_on_what_was_run_before() -> None:
    head = "schema: 1\nname: s\nspecs: [brake.yaml]\n"
    Path("brake.yaml").write_bytes((CONTINUOUS / "brake.yaml").read_bytes())
    grid = "grid:\n  requirements[4].sensitivity_db.at_most: [-20, -19.4, -18]\nstages: [tune]\nstarts: base\n"
    cells = load_study(write(grid, head)).cells

    def gains(order: tuple[int, ...]) -> dict[int, str]:
        from fopi_tune.study import worker as kept

        kept._cached_design.cache_clear()
        kept._base_neighbour.cache_clear()
        return {i: run_cell("key", cells[i]).document for i in order}

    assert gains((0, 1, 2)) == gains((2, 0, 1)) == {**gains((1,)), **gains((2,)), **gains((0,))}


def test_starting_from_the_base_finds_what_every_start_finds() -> None:
    head = "schema: 1\nname: s\nspecs: [brake.yaml]\n"
    Path("brake.yaml").write_bytes((CONTINUOUS / "brake.yaml").read_bytes())
    grid = "grid:\n  requirements[4].sensitivity_db.at_most: [-20.5, -19.4]\nstages: [tune]\n"
    near = [value_at(document(c), "tune.objective") for c in load_study(write(grid + "starts: base\n", head)).cells]
    everywhere = [value_at(document(c), "tune.objective") for c in load_study(write(grid, head)).cells]
    # the objective is flat at its optimum: the solver's 1e-9 leaves it alone to far more digits than this
    assert near == pytest.approx(everywhere, rel=1e-7)


def test_a_neighbour_with_other_plants_lends_its_gains() -> None:
    brake = load_spec(CONTINUOUS / "brake.yaml")
    gains = FoPi(0.3851, 0.3878, 0.8204)
    parameters = {**brake.plant.parameters, "time_constant_s": Uncertain(2.25, 1.7, 3.0)}
    other = dataclasses.replace(brake, plant=PlantFamily(brake.plant.model, parameters))
    near = neighbour(brake, gains)
    assert design(other, start=near) == design(other, start=gains)


def test_equal_cells_are_run_once_and_have_a_row_each(folder: Path) -> None:
    same = study("grid: {plant.static_gain: [1, 1], digital.delay_samples: [0]}\nstages: [tune]")
    asked: list[int] = []

    class Counting(InProcessRunner):
        def submit(self, task: Task, versions: Mapping[str, str]) -> None:
            asked.append(len(task.cells))
            super().submit(task, versions)

    with open_ledger(folder / "out") as ledger:
        counts = run_study(same, ledger, VERSIONS, Counting)
        rows = collect_table(same, ledger.results()).rows
    assert asked == [1]
    assert counts == Counts(2, 2, 0)
    assert [row[0] for row in rows] == [1, 2]
    assert rows[0][1:] == rows[1][1:]


def test_a_study_is_not_run_twice_and_only_what_changed_is_run_again(folder: Path) -> None:
    one = study("grid: {plant.time_constant_s.max: [3.0, 3.1]}\nstages: [tune]")
    first = run(one, folder / "out", HERE)
    asked: list[Counts] = []
    again = run(one, folder / "out", HERE, told=asked.append)
    assert again == first
    # told once, with everything there
    assert asked == [Counts(2, 2, 0)]
    asked.clear()
    other = study("grid: {plant.time_constant_s.max: [3.0, 3.2]}\nstages: [tune]")
    run(other, folder / "out", HERE, told=asked.append)
    assert asked == [Counts(2, 1, 0), Counts(2, 2, 0)]


def test_other_columns_need_no_new_run(folder: Path) -> None:
    one = study("grid: {plant.time_constant_s.max: [3.0]}\nstages: [tune]")
    run(one, folder / "out", HERE)
    asked: list[Counts] = []
    other = dataclasses.replace(one, collect=(Column("pm", "tune.nominal.phase_margin_deg"), Column("odd", "tune.od")))
    result = run(other, folder / "out", HERE, told=asked.append)
    assert asked == [Counts(1, 1, 0)]
    assert float(records(result)[0]["pm"]) > 80.0
    assert result.table.empty == ("odd",)


def test_a_stopped_study_goes_on_and_ends_with_the_same_bytes(folder: Path) -> None:
    cells = claims("[slow_1, slow_2, slow_3, slow_4, slow_5]")
    whole = run(cells, folder / "whole", HERE)

    class Stopped(InProcessRunner):
        ran = 0

        def next_outcome(self) -> TaskOutcome:
            if self.ran == 2:
                raise KeyboardInterrupt
            self.ran += 1
            return super().next_outcome()

    with open_ledger(folder / "part") as ledger, pytest.raises(KeyboardInterrupt):
        run_study(cells, ledger, VERSIONS, Stopped)
    with read_ledger(folder / "part") as ledger:
        assert ledger.counts() == Counts(5, 2, 0)
    asked: list[Counts] = []
    assert run(cells, folder / "part", HERE, resume=True, told=asked.append).table.to_csv() == whole.table.to_csv()
    assert asked[0] == Counts(5, 2, 0)


def test_a_chunk_whose_worker_died_is_run_again_cell_by_cell(folder: Path) -> None:
    cells = claims("[slow_1, slow_2, slow_3, slow_4]")
    keys = {cell.name: cell.key(VERSIONS) for cell in cells.cells}
    tried: list[list[str]] = []

    class Dying(InProcessRunner):
        """Dies whenever slow_2 is in the chunk, and the first time that slow_3 is."""

        def next_outcome(self) -> TaskOutcome:
            task, _ = self._waiting[0]
            names = [cell.name for _, cell in task.cells]
            tried.append(names)
            dies = "slow_2" in names or ("slow_3" in names and sum("slow_3" in t for t in tried) == 1)
            if dies:
                self._waiting.popleft()
                return TaskOutcome(task)
            return super().next_outcome()

    with open_ledger(folder / "out") as ledger:
        assert run_study(cells, ledger, VERSIONS, lambda: Dying(2)) == Counts(4, 3, 1)
        failures = ledger.failures()
    assert failures == [
        (1, "slow_2", "its worker died (killed, out of memory or crashed), and again when the cell ran alone")
    ]
    # suspects run alone and last
    assert tried[-2:] == [["slow_2"], ["slow_3"]]
    assert set(keys) == {name for names in tried for name in names}


def test_failed_cells_stay_failed_until_they_are_asked_for(folder: Path) -> None:
    cells = claims("[slow_1, raises]")
    first = run(cells, folder / "out", HERE)
    assert first.failures == ((1, "raises", "internal error, ZeroDivisionError: on purpose"),)
    asked: list[Counts] = []
    run(cells, folder / "out", HERE, told=asked.append)
    assert asked == [Counts(2, 1, 1)]
    asked.clear()
    again = run(cells, folder / "out", HERE, retry_failed=True, told=asked.append)
    assert asked == [Counts(2, 1, 0), Counts(2, 1, 1)]
    assert again == first


def test_chunks_grow_where_cells_are_short_and_never_starve_a_worker(folder: Path) -> None:
    cells = tuple(Cell(i, Kind.CLAIM, f"slow_{i % 12}", {"n": i}, f"registry {i}") for i in range(400))
    sizes: list[int] = []

    class Quick(InProcessRunner):
        def submit(self, task: Task, versions: Mapping[str, str]) -> None:
            sizes.append(len(task.cells))
            super().submit(task, versions)

        def next_outcome(self) -> TaskOutcome:
            task, _ = self._waiting.popleft()
            return TaskOutcome(task, [CellResult(key, "{}", "", 0.05) for key, _ in task.cells])

    with open_ledger(folder / "out") as ledger:
        counts = run_study(Study("q", cells, ()), ledger, VERSIONS, lambda: Quick(2))
    assert counts == Counts(400, 400, 0)
    assert sizes[:4] == [1, 1, 1, 1]
    # a second's worth: 20 cells of 50 ms
    assert max(sizes) == 20
    assert sizes[-1] <= 2


def test_the_time_that_is_left_is_told_without_what_a_worker_does_once(folder: Path) -> None:
    cells = claims("[slow_1, slow_2, slow_3, slow_4, slow_5]")

    class Timed(InProcessRunner):
        """The first cell takes 9 s, every other one 2 s; half of it is the processor's."""

        began = False

        def next_outcome(self) -> TaskOutcome:
            task, _ = self._waiting.popleft()
            seconds = [2.0 if self.began or i else 9.0 for i in range(len(task.cells))]
            self.began = True
            results = [CellResult(k, "{}", "", s, s / 2) for (k, _), s in zip(task.cells, seconds, strict=True)]
            return TaskOutcome(task, results)

    asked: list[Counts] = []
    with open_ledger(folder / "out") as ledger:
        run_study(cells, ledger, VERSIONS, Timed, asked.append)
    costs = [counts.cost for counts in asked]
    assert costs[0] is None
    told = [(c.workers, c.cell_processor_s, c.left_s) for c in costs if c is not None]
    assert told == [(1, 4.5, 36.0), (1, 2.75, 6.0), (1, 13 / 6, 4.0), (1, 1.875, 2.0), (1, 1.7, 0.0)]


def test_a_ledger_is_for_one_process_at_a_time_and_can_be_looked_at_meanwhile(folder: Path) -> None:
    with open_ledger(folder / "out"):
        with pytest.raises(LedgerError, match="another process runs the study"), open_ledger(folder / "out"):
            pass
        with read_ledger(folder / "out") as other:
            assert other.counts() == Counts(0, 0, 0)
    with open_ledger(folder / "out") as ledger:
        assert ledger.known() == frozenset()


def test_a_ledger_that_cannot_be_used_says_so(folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "out" / LEDGER).write_text(
        "this is no database, but long enough to be taken for one" * 40, encoding="utf-8"
    )
    with pytest.raises(LedgerError, match=r"cannot be used .* move it away to begin anew"), open_ledger(folder / "out"):
        pass
    with pytest.raises(LedgerError, match="there is no ledger"), read_ledger(folder / "nowhere"):
        pass
    with open_ledger(folder / "new"):
        pass
    connection = sqlite3.connect(folder / "new" / LEDGER)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(LedgerError, match="made by a newer fopi-tune"), open_ledger(folder / "new"):
        pass


def test_rows_have_overrides_outcome_columns_and_reason(folder: Path) -> None:
    text = "grid: {plant.time_constant_s: [{min: 1.6, nominal: 2.25, max: 3.1}, {min: 1, max: 9}]}\n"
    text += "collect: {kp: tune.gains.kp}\n"
    rows = records(run(study(text), folder / "out", HERE))
    parts = [f"plant.time_constant_s.{part}" for part in ("min", "nominal", "max")]
    assert list(rows[0]) == ["cell", "spec", *parts, "outcome", "kp", "reason"]
    assert [row["outcome"] for row in rows] == ["met", "infeasible"]
    assert [[row[part] for part in parts] for row in rows] == [["1.6", "2.25", "3.1"], ["1", "", "9"]]
    assert float(rows[0]["kp"]) == 0.385
    assert rows[0]["reason"] == ""
    assert "do not meet it" in rows[1]["reason"]


def test_claims_have_their_own_rows_and_figures_are_files(folder: Path) -> None:
    one = load_study(
        write("claims: [slow_3]\nfigures: [circle, square]\n", "schema: 1\nname: c\n"), registry="cases.study_claims"
    )
    result = run(one, folder / "out", HERE)
    rows = records(result)
    assert [(r["cell"], r["entry"], r["claim"], r["verdict"]) for r in rows] == [
        ("1", "slow_3", "slow 3", "holds"),
        ("1", "slow_3", "slow 3 again", "fails"),
        ("2", "circle", "", ""),
        ("3", "square", "", ""),
    ]
    # to the last bit
    assert float(rows[0]["recomputed"]) == (0.1 * 3) * (0.1 * 3)
    assert list(result.table.files) == ["circle.svg", "square.svg", "square.png"]
    assert result.table.files["square.png"] == b"\x89PNG square"
    assert study_text(result, "t.csv").plain == (
        "c: 3 of 3 cells done.\n\nholds: slow 3\n    published 0.3; recomputed 0.09\n    an example\n\n"
        "fails: slow 3 again\n    published a, b; recomputed -0.3"
    )


def test_parquet_has_the_tables_values_and_types(folder: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    text = "grid: {plant.time_constant_s: [{min: 1.6, nominal: 2.25, max: 3.1}, 9], digital.poles: [5, 7]}\n"
    text += "collect: {kp: tune.gains.kp}\n"
    result = run(study(text), folder / "out", HERE)
    data = result.table.to_parquet()
    assert data == run(study(text), folder / "out", HERE).table.to_parquet()
    back = pq.read_table(io.BytesIO(data))
    assert back.column_names == list(result.table.columns)
    names = ("cell", "plant.time_constant_s", "plant.time_constant_s.min", "digital.poles", "kp", "reason")
    types = [str(back.schema.field(name).type) for name in names]
    assert types == ["int64", "int64", "double", "int64", "double", "string"]
    assert back.column("kp").to_pylist() == [row[list(result.table.columns).index("kp")] for row in result.table.rows]


def test_without_pyarrow_parquet_is_refused_before_anything_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    told = CliRunner().invoke(app, ["study", write("stages: [tune]\n"), "--workers", "0", "--parquet"])
    assert told.exit_code == 2
    assert "install fopi-tune[parquet], or take the CSV file" in told.stderr
    assert not Path("results").exists()


def test_the_terminals_table_is_of_80_columns_and_says_what_it_leaves_out(folder: Path) -> None:
    cells = tuple(
        Cell(i, Kind.SPEC, "lag", {"plant.time_constant_s.max": 0.1 * i, "a.max": i % 3}, "{}") for i in range(90)
    )
    names = [f"a_long_name_of_a_column_{i}" for i in range(12)]
    wide = Study("wide", cells, tuple(Column(name, f"tune.{name}") for name in names))
    told = [
        CellResult("k", json.dumps({"outcome": "met", "tune": {n: i / 7 + k for k, n in enumerate(names)}}), "", 1.0)
        for i in range(90)
    ]
    table = collect_table(wide, enumerate(told))
    lines = study_text(StudyResult(wide, Counts(90, 90, 0), table, ()), "results/wide/table.csv").plain.splitlines()
    assert max(len(line) for line in lines) <= 80
    assert lines[2] == "in every row: spec lag, outcome met"
    assert lines[-1].startswith("50 more rows and ")
    assert lines[-1].endswith("more columns in results/wide/table.csv")
    # what two paths end with is not enough to tell them apart
    assert "constant_" in "".join(lines[4:9])


def test_the_command_writes_the_table_and_ends_with_0_when_every_cell_has_an_answer() -> None:
    text = "grid: {'requirements[0].phase_margin_deg.at_least': [80, 85]}\nstages: [tune]\n"
    told = CliRunner().invoke(app, ["study", write(text), "--workers", "0", "--progress", "jsonl"])
    assert told.exit_code == 0, told.stderr
    assert told.stdout.startswith("s: 2 of 2 cells done.\n")
    assert "infeasible" in told.stdout
    events = [json.loads(line) for line in told.stderr.splitlines() if line.startswith("{")]
    assert [(e["done"], e["left"]) for e in events] == [(0, 2), (1, 1), (2, 0)]
    rows = list(csv.DictReader(io.StringIO(Path("results/s/table.csv").read_text(encoding="utf-8"))))
    assert [row["outcome"] for row in rows] == ["solved", "infeasible"]
    status = CliRunner().invoke(app, ["study", "--status", "results/s"])
    assert (status.exit_code, status.stdout) == (0, "s: 2 of 2 cells done, 0 failed, 0 left\n")
    as_json = CliRunner().invoke(app, ["study", "s.yaml", "--workers", "0", "--json", "-q"])
    assert [row["outcome"] for row in json.loads(as_json.stdout)["rows"]] == ["solved", "infeasible"]
    assert as_json.stderr == ""


def test_failed_cells_end_with_3_and_their_reasons() -> None:
    text = "grid: {digital.band_rad_s: [[1.0e-3, 1.0e-2]], digital.method: [fit]}\nstages: [discretize]\n"
    told = CliRunner().invoke(app, ["study", write(text), "--workers", "0"])
    assert told.exit_code == 3
    assert "cell 1 (lag, digital.band_rad_s = [0.001, 0.01], " in told.stderr
    status = CliRunner().invoke(app, ["study", "--status", "results/s", "--json"])
    assert status.exit_code == 3
    assert json.loads(status.stdout)["cells"] == {"total": 1, "done": 0, "failed": 1, "left": 0}


def test_a_dry_run_lists_the_cells_and_runs_nothing() -> None:
    file = write("limit_cells: 1\ngrid: {digital.poles: [5, 7]}")
    # the limit keeps a slip from filling the memory, also of a list
    assert CliRunner().invoke(app, ["study", file, "--dry-run"]).exit_code == 2
    told = CliRunner().invoke(app, ["study", file, "--dry-run", "--force"])
    assert (told.exit_code, told.stdout) == (0, "1  lag, digital.poles = 5\n2  lag, digital.poles = 7\n")
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ([], "there is no STUDY to run"),
        (["s.yaml", "--workers", "2", "--scheduler", "tcp://a:1"], "leave one of them out"),
        (["s.yaml", "--workers", "-1"], "-1 workers"),
        (["s.yaml", "--resume"], "there is nothing to resume in results/s"),
        (["none.yaml"], "none.yaml:1:1: there is no such file"),
        (["many.yaml"], "2 cells are more than 1; run them with --force"),
        (["--status", "."], "there is no ledger.sqlite in ."),
        (["--status", "new"], "new/ledger.sqlite has no study yet"),
        (["s.yaml", "--out", "alien"], "alien/ledger.sqlite is a database of something else"),
        (
            ["s.yaml", "--out", "locked"],
            "cannot write locked/ledger.lock (locked/ledger.lock is a folder); choose another folder",
        ),
    ],
)
def test_bad_input_ends_with_2_and_one_line(arguments: list[str], part: str) -> None:
    write("limit_cells: 1\ngrid: {digital.poles: [5, 7]}\n")
    Path("s.yaml").rename("many.yaml")
    write("stages: [tune]\n")
    for name in ("new", "alien", "locked/ledger.lock"):
        Path(name).mkdir(parents=True)
    Path("new/ledger.sqlite").touch()
    with contextlib.closing(sqlite3.connect("alien/ledger.sqlite")) as connection:
        connection.execute("CREATE TABLE t (a)")
    told = CliRunner().invoke(app, ["study", "-q", *arguments])
    assert told.exit_code == 2
    assert part in told.stderr
    assert "Traceback" not in told.stderr


def test_the_schema_of_studies_is_printed() -> None:
    told = CliRunner().invoke(app, ["schema", "--study"])
    assert json.loads(told.stdout)["title"] == "fopi-tune study, schema 1"
    assert CliRunner().invoke(app, ["schema", "--study", "--system"]).exit_code == 2


def test_workers_may_be_told_how_many_threads_to_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FOPI_THREADS", "3")
    assert available_threads() == 3
    for odd in ("0", "many", "", "-1"):
        monkeypatch.setenv("FOPI_THREADS", odd)
        assert (
            available_threads() == len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else available_threads() >= 1
        )


@pytest.mark.parametrize("arguments", [["--version"], ["study", "s.yaml", "--dry-run"], ["schema", "--study"]])
def test_what_runs_no_cell_loads_neither_dask_nor_a_solver(arguments: list[str]) -> None:
    write("stages: [tune]\n")
    code = (
        "import sys, fopi_tune\nfrom fopi_tune.cli import app\n"
        f"try:\n    app({arguments!r})\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('dask', 'distributed', 'casadi', 'cvxpy', 'pyarrow', 'numba') if m in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=ENVIRONMENT)
    assert told.stdout.splitlines()[-1] == "[]"


# -- many draws -------------------------------------------------------------------------------------------------------


class Dividing(InProcessRunner):
    """Two workers in this process; `dies` and `fails` are the draws of tasks that end so."""

    dies: tuple[int, int] | None = None
    fails: tuple[int, int] | None = None

    def __init__(self) -> None:
        super().__init__(2)
        self.ran: list[str] = []

    def next_outcome(self) -> TaskOutcome:
        task, versions = self._waiting[0]
        if task.draws is None and not task.blocks:
            self.ran.append("cells")
            return super().next_outcome()
        self._waiting.popleft()
        ((key, cell),) = task.cells
        if task.draws is None:
            self.ran.append("finish")
            return TaskOutcome(task, [combine_blocks(key, cell, task.blocks)])  # type: ignore[arg-type]
        self.ran.append("block")
        if task.draws in (self.dies, self.fails):
            return TaskOutcome(task) if task.draws == self.dies else TaskOutcome(task, reason="no")
        return TaskOutcome(task, block=run_block(cell, versions, *task.draws))


@pytest.mark.thinned(4)
@pytest.mark.parametrize(
    ("dies", "fails", "ran"),
    [
        (None, None, ["block"] * 3 + ["finish"]),
        ((512, 1024), None, ["block"] * 2 + ["block"] + ["cells"]),
        (None, (0, 512), ["block"] * 3 + ["cells"]),
    ],
)
def test_draws_that_are_divided_give_the_same_cell(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    dies: tuple[int, int] | None,
    fails: tuple[int, int] | None,
    ran: list[str],
) -> None:
    cells = study("cells: [{validation.samples: 1600}]\nstages: [tune, prove, discretize, validate]")
    monkeypatch.setattr("fopi_tune.study.engine.BLOCK", 512)
    runner = Dividing()
    runner.dies, runner.fails = dies, fails
    with open_ledger(folder / "out") as ledger:
        assert run_study(cells, ledger, VERSIONS, lambda: runner) == Counts(1, 1, 0)
        ((_, result),) = ledger.results()
    assert json.loads(result.document) == document(cells.cells[0])
    assert runner.ran == ran


def test_a_cell_without_gains_has_no_blocks_and_ends_as_it_would(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    infeasible = "requirements: [{phase_margin_deg: {at_least: 140}}], validation.samples: 1600"
    cells = study(f"cells: [{{{infeasible}}}]\nstages: [tune, validate]")
    monkeypatch.setattr("fopi_tune.study.engine.BLOCK", 512)

    class Raising(Dividing):
        def next_outcome(self) -> TaskOutcome:
            task, _ = self._waiting[0]
            try:
                return super().next_outcome()
            except FopiError as error:
                return TaskOutcome(task, reason=str(error))

    with open_ledger(folder / "out") as ledger:
        assert run_study(cells, ledger, VERSIONS, Raising) == Counts(1, 1, 0)
        ((_, result),) = ledger.results()
    assert json.loads(result.document) == document(cells.cells[0])
    assert json.loads(result.document)["outcome"] == "infeasible"


def test_blocks_are_of_at_least_so_many_draws_and_leave_none_out() -> None:
    for draws in (200_000, 299_999, 1_234_567, 10_000_000):
        edges = draw_blocks(draws)
        assert [first for first, _ in edges] == [0, *(end for _, end in edges[:-1])]
        assert edges[-1][1] == draws
        assert min(end - first for first, end in edges) >= 100_000
        assert all(first % SCANNED == 0 for first, _ in edges)


def test_a_file_of_samples_travels_with_its_cells(folder: Path) -> None:
    (folder / "few.csv").write_text("time_constant_s\n1.7\n3.0\n", encoding="utf-8")
    (folder / "more.csv").write_text("time_constant_s\n1.7\n3.0\n2.0\n", encoding="utf-8")
    values = "[{samples_file: few.csv}, {samples_file: more.csv}]"
    cells = study(f"grid: {{validation: {values}}}\nstages: [validate]").cells
    assert [dict(cell.files) for cell in cells] == [
        {name: (folder / name).read_bytes()} for name in ("few.csv", "more.csv")
    ]
    for name in ("few.csv", "more.csv"):
        (folder / name).unlink()
    results: list[Any] = [document(cell)["validate"] for cell in cells]
    assert [each["stable"]["total"] for each in results] == [2, 3]
    whole = load_spec("lag.yaml")
    listed = dataclasses.replace(whole, validation=spec_from_text(cells[1].text, files=cells[1].files).validation)
    alone = validate(listed, FoPi(0.385, 0.388, 0.82)).to_dict()
    assert alone["requirements"] == results[1]["requirements"]


def test_a_file_of_samples_that_changes_changes_its_cell(folder: Path) -> None:
    keys = []
    for rows in ("1.7\n3.0\n", "1.7\n3.1\n"):
        (folder / "f.csv").write_text(f"time_constant_s\n{rows}", encoding="utf-8")
        keys.append(study("cells: [{validation: {samples_file: f.csv}}]\nstages: [validate]").cells[0].key(VERSIONS))
    assert keys[0] != keys[1]


@pytest.mark.parametrize(
    "damage",
    ["document = 'not json'", "document = '[1]'", "document = ''", "document = '{}'",
     "document = replace(document, '0.385', '0.386')", "document = replace(document, 'met', 'great')",
     "document = '{\"a\":' || replace(hex(zeroblob(50000)), '00', '[') || '}'", "document = x'ff00'",
     "document = cast(x'fffe' || document AS TEXT)", "reason = cast(x'c3' AS TEXT)",
     "failed = 1", "failed = 7", "reason = 'lost'"],
)  # fmt: skip
def test_a_result_that_was_damaged_is_told_and_its_cell_alone_is_run_again(folder: Path, damage: str) -> None:
    path = write('grid: {"requirements[0].phase_margin_deg.at_least": [75, 80]}\nstages: [prove]')
    cells, out = load_study(path), folder / "out"
    whole = run(cells, out, HERE).table
    assert {row[whole.columns.index("outcome")] for row in whole.rows} == {"met"}
    with contextlib.closing(sqlite3.connect(out / LEDGER)) as connection, connection:
        connection.execute(f"UPDATE results SET {damage} WHERE key = (SELECT key FROM plan WHERE position = 1)")
    label = cells.cells[1].label
    status = CliRunner().invoke(app, ["study", "--status", str(out)])
    again = "its result was damaged on the disk and counts as none; the study's command runs it again"
    assert status.stdout.splitlines() == ["s: 1 of 2 cells done, 0 failed, 1 left", f"cell 2 ({label}): {again}"]
    assert status.exit_code == 1
    told = json.loads(CliRunner().invoke(app, ["study", "--status", str(out), "--json"]).stdout)
    assert told["cells"] == {"total": 2, "done": 1, "failed": 0, "left": 1}
    assert told["damaged"] == [{"cell": 2, "label": label}]
    with read_ledger(out) as ledger, pytest.raises(LedgerError, match=r"has of cell 2 .* is damaged; run the same"):
        collect_table(cells, ledger.results())
    progress: list[Counts] = []
    said: list[str] = []
    assert run(cells, out, HERE, told=progress.append, say=said.append).table == whole
    assert progress == [Counts(2, 1, 0), Counts(2, 2, 0)]
    assert said == [f"what {out / LEDGER} had of cell 2 ({label}) was damaged; the cell is run again"]
    assert run(cells, out, HERE, say=said.append).table == whole
    assert len(said) == 1


def test_a_ledger_without_digests_is_gone_on_with(folder: Path) -> None:
    cells = study("stages: [prove]")
    whole = run(cells, folder / "out", HERE).table.rows
    with contextlib.closing(sqlite3.connect(folder / "out" / LEDGER)) as connection, connection:
        connection.execute("ALTER TABLE results DROP COLUMN digest")
        # what it has is of other sources
        connection.execute("UPDATE results SET key = 'earlier'")
        connection.execute("PRAGMA user_version = 1")
    with read_ledger(folder / "out") as ledger:
        assert ledger.counts() == Counts(1, 0, 0)
    for _ in range(2):
        assert run(cells, folder / "out", HERE).table.rows == whole


def test_a_finished_study_can_be_looked_at_where_nothing_can_be_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(study("stages: [prove]"), folder / "out", HERE)
    # a superuser can write everywhere
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with read_ledger(folder / "out") as ledger:
        assert ledger.counts() == Counts(1, 1, 0)
        with pytest.raises(LedgerError, match="readonly"):
            ledger.record([CellResult("k", "{}", "", 0.0)])
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["ledger.lock", LEDGER]


def test_progress_for_programs_has_no_other_lines() -> None:
    told = CliRunner().invoke(app, ["study", write("stages: [prove]"), "--workers", "0", "--progress", "jsonl"])
    assert told.exit_code == 0
    assert [json.loads(line)["done"] for line in told.stderr.splitlines()] == [0, 1]


# -- Ctrl-C -----------------------------------------------------------------------------------------------------------


def test_ctrl_c_is_heard_though_a_solver_takes_it_for_a_failed_solve() -> None:
    def solve() -> None:
        with raising_interrupts(), contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            solve()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        with raising_interrupts():
            pass
    finally:
        signal.signal(signal.SIGINT, before)
