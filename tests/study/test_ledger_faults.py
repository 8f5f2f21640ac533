"""Every single operation on files of `fopi study`, SQLite's own among them, killed, stopped and failing.

The ledger stays whole, no result that was recorded is lost, and the study goes on to the table of an undisturbed one.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from cases.fault_points import AVAILABLE, Commands, Ended, How, commands

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="fault points need Linux and a C compiler")

#: with fixed gains nothing is searched; two cells are met, one is violated
SPEC = """\
schema: 1
name: brake
plant: {model: lag, static_gain: 1.0, time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}, dead_time_s: 0.0}
controller: {kp: 0.38512, ki: 0.38776, alpha: 0.82038}
requirements: [{phase_margin_deg: {at_least: 80}}]
"""
STUDY = """\
schema: 1
name: s
specs: [brake.yaml]
grid: {"requirements[0].phase_margin_deg.at_least": [75, 80, 86]}
stages: [prove]
collect: ["prove.requirements[0].achieved"]
"""
#: key, whether it failed, document
Rows = list[tuple[str, int, str]]


@dataclass(frozen=True)
class Bench:
    """What the tests share: the process, the study, and what an undisturbed one does and leaves."""

    tool: Commands
    study: Path
    table: bytes
    rows: Rows
    operations: tuple[str, ...]

    @property
    def folder(self) -> Path:
        """The folder of results."""
        return self.study.parent / "results"

    def command(self, workers: int = 0) -> tuple[object, ...]:
        """The arguments of `fopi`."""
        return ("study", self.study, "--workers", workers, "--quiet", "--out", self.folder)

    def disturb(self, at: int, how: How, workers: int = 0) -> Ended:
        """Run the study into an empty folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        return self.tool.disturb(*self.command(workers), folder=self.folder, at=at, how=how)

    def check_resumed(self) -> None:
        """The same command goes on, to the same table and results."""
        again = self.tool.run(*self.command())
        assert again.status == 0, again.err
        assert (self.folder / "table.csv").read_bytes() == self.table
        assert recorded(self.folder) == self.rows

    def check_left(self) -> Rows:
        """The ledger is whole and has only results as they should be, `--status` counts them; returns them."""
        rows = recorded(self.folder)
        assert all(row in self.rows for row in rows)
        table = self.folder / "table.csv"
        assert not table.exists() or table.read_bytes() == self.table
        status = self.tool.run("study", "--status", self.folder)
        if status.status == 2:
            assert rows == []
            assert "there is no ledger.sqlite" in status.err or "has no study yet" in status.err
        else:
            # before the plan there are no cells
            done, _, total = status.out.removeprefix("?: ").removeprefix("s: ").partition(" of ")
            assert int(done) == len(rows)
            assert total.split()[0] in (("0", "3") if not rows else ("3",))
        return rows


def recorded(folder: Path) -> Rows:
    """The results in a ledger's copy, so that the ledger itself is not recovered by looking at it."""
    if not (folder / "ledger.sqlite").exists():
        return []
    copy = folder.parent / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy)
    with contextlib.closing(sqlite3.connect(copy / "ledger.sqlite")) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        if not connection.execute("SELECT name FROM sqlite_master").fetchall():
            return []
        return connection.execute("SELECT key, failed, document FROM results ORDER BY key").fetchall()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    root = tmp_path_factory.mktemp("faults")
    (root / "brake.yaml").write_text(SPEC, encoding="utf-8")
    (root / "s.yaml").write_text(STUDY, encoding="utf-8")
    with commands(root) as tool:
        begun = Bench(tool, root / "s.yaml", b"", [], ())
        assert tool.run(*begun.command()).status == 0
        table, rows = (begun.folder / "table.csv").read_bytes(), recorded(begun.folder)
        assert len(rows) == 3
        # how many cells a task has depends on the times that are kept from the first run, so it is always the same
        ended = begun.disturb(0, How.COUNT)
        assert ended.status == 0
        yield Bench(tool, root / "s.yaml", table, rows, ended.operations)


#: every n-th operation in the default set, with an n that meets every kind
SOME_AND_ALL = pytest.mark.parametrize("step", [11, pytest.param(1, marks=pytest.mark.long)])


@SOME_AND_ALL
def test_a_study_killed_at_an_operation_goes_on_without_losing_a_result(bench: Bench, step: int) -> None:
    kinds = {line.split()[0] for line in bench.operations}
    assert kinds == {"folder", "create", "write", "sync", "cut", "rename", "delete"}
    most = 0
    for at in range(1, len(bench.operations) + 1, step):
        for how in (How.KILL_BEFORE, How.KILL_AMID):
            assert bench.disturb(at, how).status == -9
            rows = bench.check_left()
            assert len(rows) >= most, "a result that was recorded at an earlier operation is lost"
            most = len(rows)
            bench.check_resumed()
    assert most == len(bench.rows)


@pytest.mark.thinned(2)
@SOME_AND_ALL
@pytest.mark.parametrize("how", [How.FULL_DISK, How.FAIL_ONCE], ids=["full", "faulty"])
def test_a_disk_that_is_full_or_fails_is_told_and_what_was_done_is_kept(bench: Bench, step: int, how: How) -> None:
    for at in range(1, len(bench.operations) + 1, step):
        ended = bench.disturb(at, how)
        rows = bench.check_left()
        # SQLite does without what it need not do: the write-ahead log is emptied again by the next that opens it
        if ended.status != 0:
            assert ended.status == 2, ended
            check_said(ended, bench.folder)
        else:
            assert rows == bench.rows
        bench.check_resumed()


def check_said(ended: Ended, folder: Path) -> None:
    """One line that says what, where, why and what to do; never to throw away what was done."""
    (line,) = ended.err.splitlines()
    assert str(folder) in line
    reasons = ("No space left on device", "Input/output error", "full", "disk I/O error", "unable to open")
    assert any(reason in line for reason in reasons), line
    assert "run the same command again: what was done is kept" in line or "choose another folder with --out" in line
    assert "begin anew" not in line


@pytest.mark.parametrize("killed", [False, True])
def test_a_read_only_folder_is_told_and_its_results_can_be_read(bench: Bench, killed: bool) -> None:
    """Also those that a killed study had not yet moved from the write-ahead log into the ledger."""
    log = [line.split()[0] if line.endswith("-wal") else "" for line in bench.operations]
    # killed when the log has all results, before it is flushed and the first page is moved
    last = len(log) - log[::-1].index("sync")
    assert bench.operations[last].split()[0] == "write"
    assert bench.operations[last].endswith("ledger.sqlite")
    bench.disturb(last, How.KILL_BEFORE if killed else How.COUNT)
    assert (bench.folder / "ledger.sqlite-wal").exists() == killed
    before = {path.name: path.read_bytes() for path in bench.folder.iterdir()}
    refused = bench.tool.disturb(*bench.command(), folder=bench.folder, how=How.READ_ONLY)
    assert refused.status == 2
    assert refused.err == (
        f"cannot write {bench.folder / 'ledger.lock'} (Read-only file system); choose another folder with --out\n"
    )
    status = bench.tool.disturb("study", "--status", bench.folder, folder=bench.folder, how=How.READ_ONLY)
    assert (status.status, status.out) == (0, "s: 3 of 3 cells done, 0 failed, 0 left\n"), status.err
    assert {path.name: path.read_bytes() for path in bench.folder.iterdir()} == before
    bench.check_resumed()


def test_a_new_folder_where_nothing_can_be_written_is_told(bench: Bench) -> None:
    ended = bench.disturb(0, How.READ_ONLY)
    assert ended.status == 2
    assert ended.err == f"cannot make {bench.folder} (Read-only file system); choose another folder with --out\n"


@SOME_AND_ALL
def test_of_two_studies_in_one_folder_the_second_is_refused(bench: Bench, step: int) -> None:
    holding = next(k for k, line in enumerate(bench.operations, 1) if line.endswith("ledger.sqlite"))
    closed = max(k for k, line in enumerate(bench.operations, 1) if line.startswith("delete"))
    for at in range(1, len(bench.operations) + 1, step):
        shutil.rmtree(bench.folder, ignore_errors=True)
        first, second = bench.tool.run_two(bench.command(), bench.command(), bench.folder, at)
        assert first.status == 0, first.err
        if holding <= at <= closed:
            words = f"another process runs the study in {bench.folder}; wait for it, or choose another --out\n"
            assert (second.status, second.err) == (2, words)
        else:  # before the first has the lock, and when it has only the table to write
            assert second.status == 0, second.err
        bench.check_resumed()


@pytest.mark.long
@pytest.mark.parametrize("how", [How.KILL_BEFORE, How.KILL_AMID])
def test_a_study_with_workers_killed_at_an_operation_goes_on(bench: Bench, how: How) -> None:
    """The cells come back from the workers in any order: the operations are about as many, not the same."""
    for at in range(3, len(bench.operations), 9):
        assert bench.disturb(at, how, workers=2).status in (-9, 0)
        bench.check_left()
        bench.check_resumed()
