"""Studies on processes: crashes, kills at any moment, Ctrl-C, and a scheduler with workers of its own."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from cases.project import CONTINUOUS, IMPORTED, ROOT
from cases.two_modes import write

from fopi_tune.study.ledger import read_ledger
from fopi_tune.study.load import load_study
from fopi_tune.study.model import Cell, Kind

TESTS = ROOT / "tests"
DASK = shutil.which("dask", path=os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", ""))))
#: with the package that was imported, and not that of the folder where the tests run: its code is compiled already
ENVIRONMENT = os.environ | {
    "PYTHONPATH": os.pathsep.join((str(TESTS), str(IMPORTED))),
    "PYTHONSAFEPATH": "1",
    "OMP_NUM_THREADS": "1",
}
SLOW = ", ".join([*(f"slow_{i}" for i in range(12)), *(f"late_{i}" for i in range(12))])
BRAKE = f"""\
schema: 1
name: brakes
specs: [{json.dumps(str(CONTINUOUS / "brake.yaml"))}]
grid:
  requirements[4].sensitivity_db.at_most: [-20, -19.6, -19.2, -18.8, -18, -17]
  plant.time_constant_s.max: [2.9, 3.1, 3.3]
"""


def study_file(folder: Path, claims: str) -> Path:
    path = folder / "s.yaml"
    path.write_text(f"schema: 1\nname: s\nclaims: [{claims}]\n", encoding="utf-8")
    return path


def started(file: Path, folder: Path, workers: str, *words: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-W",
        "error",
        str(TESTS / "cases" / "study_process.py"),
        str(file),
        str(folder),
        workers,
        *words,
    ]
    return subprocess.Popen(
        command,
        env=ENVIRONMENT,
        cwd=file.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def table_of(file: Path, folder: Path, workers: str, *words: str) -> str:
    process = started(file, folder, workers, *words)
    # the first one may have to compile, beside whatever else the machine does
    _, said = process.communicate(timeout=900)
    assert process.returncode == 0, said
    return (folder / "table.csv").read_text(encoding="utf-8")


def is_whole(ledger: Path) -> bool:
    """Whether SQLite finds nothing wrong with a ledger, and every result in it ended."""
    connection = sqlite3.connect(ledger)
    try:
        if not connection.execute("SELECT name FROM sqlite_master").fetchall():
            return True  # killed before it had tables
        states = {row[0] for row in connection.execute("SELECT failed FROM results")}
        return connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)] and states <= {0, 1}
    finally:
        connection.close()


def hear_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def workers_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    try:
        children = psutil.Process(process.pid).children(recursive=True)
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:
        return []


def wait_until_begun(process: subprocess.Popen[str]) -> bool:
    """Until the first cells are done; False where it ended without."""
    assert process.stdout is not None
    first = process.stdout.readline()
    return bool(first) and bool(process.stdout.readline())


def killed_again_and_again(file: Path, folder: Path, kills: int, seed: int, longest_s: float) -> int:
    """Kill main process and workers in turn at random moments; how many kills hit something that was at work."""
    random_moments = random.Random(seed)
    hits = 0
    for kill in range(kills):
        process = started(file, folder, "2")
        if kill % 3 == 2:  # also before anything is done: while the ledger is opened and the cluster comes up
            time.sleep(random_moments.uniform(0.0, 3.0))
        else:
            wait_until_begun(process)
            time.sleep(random_moments.uniform(0.0, longest_s))
        if kill % 2:
            victims = workers_of(process)
            if victims:
                random_moments.choice(victims).kill()
                hits += process.poll() is None
                time.sleep(random_moments.uniform(0.0, longest_s))
        if process.poll() is None:
            process.kill()
            hits += 1
        process.communicate(timeout=60)
        assert not (folder / "ledger.sqlite").exists() or is_whole(folder / "ledger.sqlite")
    return hits


def test_a_cell_that_kills_its_worker_is_marked_and_the_rest_goes_on(tmp_path: Path) -> None:
    file = study_file(tmp_path, f"killed, raises, {SLOW}")
    process = started(file, tmp_path / "out", "2")
    told, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert told.splitlines()[-1] == "failures ['killed', 'raises']"
    rows = (tmp_path / "out" / "table.csv").read_text(encoding="utf-8").splitlines()
    assert sum(",failed," in row for row in rows) == 2
    assert sum(",computed," in row for row in rows) == 2 * 24
    assert "its worker died (killed, out of memory or crashed), and again when the cell ran alone" in rows[1]
    assert said == ""


@pytest.mark.long
@pytest.mark.parametrize(
    "dying",
    ["dies_at_once", *(pytest.param(f"dies_{n}", marks=pytest.mark.long) for n in (1, 3, 10, 30))],
)
def test_a_worker_that_dies_once_in_or_after_a_cell_changes_no_row(tmp_path: Path, dying: str) -> None:
    # the cell is the first, and the others last longer than it takes to die: nothing dies while suspects run alone
    file, died = study_file(tmp_path, f"{dying}, {SLOW}"), tmp_path / f"{dying}.died"
    died.touch()
    whole = table_of(file, tmp_path / "whole", "0")
    died.unlink()
    assert table_of(file, tmp_path / "out", "2") == whole
    assert died.exists()


@pytest.mark.long
@pytest.mark.parametrize("kills", [3, 30])
def test_a_study_that_is_killed_ends_as_one_that_is_not(tmp_path: Path, kills: int) -> None:
    file = study_file(tmp_path, SLOW)
    whole = table_of(file, tmp_path / "whole", "0")
    hits = killed_again_and_again(file, tmp_path / "out", kills, seed=kills, longest_s=0.15)
    assert hits > 0
    assert table_of(file, tmp_path / "out", "0") == whole


@pytest.mark.long
def test_designs_and_proofs_that_are_killed_end_as_ones_that_are_not(tmp_path: Path) -> None:
    file = tmp_path / "brakes.yaml"
    file.write_text(BRAKE, encoding="utf-8")
    whole = table_of(file, tmp_path / "whole", "0")
    hits = killed_again_and_again(file, tmp_path / "out", 30, seed=1, longest_s=1.0)
    assert hits > 0
    assert table_of(file, tmp_path / "out", "2") == whole


def documents_of(file: Path, folder: Path) -> dict[str, str]:
    """What the ledger has of each cell, by its overrides."""
    labels = {cell.index: cell.label for cell in load_study(file).cells}
    with read_ledger(folder) as ledger:
        return {labels[index]: result.document for index, result in ledger.results()}


@pytest.mark.parametrize(
    ("starts", "limits"),
    [
        ("all", ("-20",)),
        pytest.param("all", ("-20", "-18"), marks=pytest.mark.long),
        *(pytest.param(starts, ("-20", "-19.2", "-18"), marks=pytest.mark.long) for starts in ("all", "base")),
    ],
)
def test_cells_in_another_order_by_more_workers_killed_and_resumed_have_the_same_bytes(
    tmp_path: Path, starts: str, limits: tuple[str, ...]
) -> None:
    forth, back = (f"[{', '.join(each)}]" for each in (limits, limits[::-1]))
    text = BRAKE.replace("[-20, -19.6, -19.2, -18.8, -18, -17]", forth) + f"stages: [tune]\nstarts: {starts}\n"
    forwards, backwards = tmp_path / "brakes.yaml", tmp_path / "turned.yaml"
    forwards.write_text(text, encoding="utf-8")
    turned = text.replace(forth, back).replace("[2.9, 3.1, 3.3]", "[3.3, 2.9, 3.1]")
    backwards.write_text(turned, encoding="utf-8")
    whole = table_of(forwards, tmp_path / "whole", "0")
    process = started(backwards, tmp_path / "out", "2")
    assert wait_until_begun(process)
    process.kill()
    process.communicate(timeout=60)
    table = table_of(backwards, tmp_path / "out", "2")
    assert documents_of(backwards, tmp_path / "out") == documents_of(forwards, tmp_path / "whole")
    # the same rows, but for their number, which comes first
    rows = [sorted(line.split(",", 1)[1] for line in lines.splitlines()) for lines in (table, whole)]
    assert rows[0] == rows[1]


def test_ctrl_c_ends_at_once_without_noise_and_leaves_a_ledger_that_goes_on(tmp_path: Path) -> None:
    file = tmp_path / "brakes.yaml"
    file.write_text(BRAKE, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "fopi_tune",
        "study",
        str(file),
        "--out",
        str(tmp_path / "out"),
        "--progress",
        "jsonl",
    ]
    process = subprocess.Popen(
        command,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # what a shell starts in the background ignores Ctrl-C, and its children with it
        preexec_fn=hear_ctrl_c,
    )
    assert process.stderr is not None
    # the number of cells, where nothing is done yet, and the first that are
    for _ in range(3):
        process.stderr.readline()
    os.killpg(process.pid, signal.SIGINT)
    out, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert [line for line in said.splitlines() if not line.startswith("{")] == [
        "stopped; what was done is kept: run the same command again to go on"
    ]
    status = subprocess.run(
        [sys.executable, "-m", "fopi_tune", "study", "--status", str(tmp_path / "out"), "--json"],
        env=ENVIRONMENT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    cells = json.loads(status.stdout)["cells"]
    assert status.returncode == 1
    assert cells["done"] > 0
    assert cells["done"] + cells["left"] == cells["total"] == 18


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[Any]]]:
    """A scheduler with two workers, started as the manual says: its address and its process."""
    if DASK is None:
        pytest.skip("there is no command `dask` beside this Python")
    told = tmp_path / "scheduler.json"
    common: dict[str, Any] = {"env": ENVIRONMENT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes: list[subprocess.Popen[Any]] = [
        subprocess.Popen([DASK, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(told)], **common)
    ]
    try:
        worker = [DASK, "worker", "--scheduler-file", str(told), "--nthreads", "1", "--nworkers", "2", "--no-dashboard"]
        processes.append(subprocess.Popen([*worker, "--local-directory", str(tmp_path)], **common))
        for _ in range(300):
            if told.exists() and told.read_text(encoding="utf-8").strip():
                break
            time.sleep(0.1)
        yield json.loads(told.read_text(encoding="utf-8"))["address"], processes[0]
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(timeout=30)


def test_a_scheduler_with_its_own_workers_gives_the_same_rows(
    tmp_path: Path, scheduler: tuple[str, subprocess.Popen[Any]]
) -> None:
    file = tmp_path / "s.yaml"
    text = BRAKE.replace("[-20, -19.6, -19.2, -18.8, -18, -17]", "[-20, -19]").replace(
        "name: brakes", "name: s\nclaims: all"
    )
    file.write_text(text.replace("claims: all", f"claims: [{SLOW}]"), encoding="utf-8")
    assert table_of(file, tmp_path / "remote", scheduler[0]) == table_of(file, tmp_path / "here", "0")


@pytest.mark.long
def test_a_scheduler_that_goes_away_ends_the_study_with_one_line(
    tmp_path: Path, scheduler: tuple[str, subprocess.Popen[Any]]
) -> None:
    address, its_process = scheduler
    file = tmp_path / "brakes.yaml"
    file.write_text(BRAKE, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "fopi_tune",
        "study",
        str(file),
        "--out",
        str(tmp_path / "out"),
        "--scheduler",
        address,
    ]
    process = subprocess.Popen(
        [*command, "--progress", "jsonl"], env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    for _ in range(3):  # the number of cells, where nothing is done yet, and the first that are
        process.stderr.readline()
    its_process.kill()
    _, said = process.communicate(timeout=120)
    assert process.returncode == 3
    assert [line for line in said.splitlines() if not line.startswith("{")] == [
        "the scheduler is gone; what was done is kept: run the same command again"
    ]


@pytest.mark.long
def test_sixty_cells_of_a_system_killed_resumed_and_on_a_scheduler_have_the_same_bytes(
    tmp_path: Path, scheduler: tuple[str, subprocess.Popen[Any]]
) -> None:
    write(tmp_path, more="limits: [{switch_count: {at_most: 9}}]\nvalidation: {samples: 400, seed: 3}")
    file = tmp_path / "s.yaml"
    file.write_text(
        "schema: 1\nname: s\nspecs: [rig.yaml]\nstages: [simulate, validate]\ngrid:\n"
        "  system.hysteresis: {from: 0.1, to: 0.5, steps: 5}\n"
        "  system.fan.gains.kp: {from: 0.1, to: 0.4, steps: 4, scale: log}\n"
        "  system.heater.spec.plant.time_constant_s.max: [6, 7, 8]\n"
        "collect: ['simulate.scenarios[0].measures.iae', 'validate.scenarios[0].limits[0].met']\n",
        encoding="utf-8",
    )
    whole = table_of(file, tmp_path / "whole", "0")
    assert len(whole.splitlines()) == 61
    assert killed_again_and_again(file, tmp_path / "out", 3, seed=7, longest_s=0.3) > 0
    assert table_of(file, tmp_path / "out", "2") == whole
    assert table_of(file, tmp_path / "remote", scheduler[0]) == whole


def test_an_address_where_nothing_answers_is_bad_input(tmp_path: Path) -> None:
    from fopi_tune.study import cluster

    with (
        pytest.raises(cluster.ClusterError, match="no scheduler answers at tcp://nonsense:1 "),
        cluster.remote_cluster("tcp://nonsense:1", print, timeout_s=0.3),
    ):
        pass


@pytest.mark.long
def test_draws_that_are_divided_among_processes_give_the_same_rows(tmp_path: Path) -> None:
    brake = json.dumps(str(CONTINUOUS / "brake.yaml"))
    (tmp_path / "s.yaml").write_text(
        f"schema: 1\nname: s\nspecs: [{brake}]\ngrid: {{validation.samples: [1100], validation.seed: [1, 2]}}\n"
        "stages: [tune, validate]\n"
        'collect: ["validate.requirements[0].fraction", "validate.requirements[0].quantiles"]\n',
        encoding="utf-8",
    )
    alone = table_of(tmp_path / "s.yaml", tmp_path / "alone", "0")
    assert alone.count(",met,") == 2
    assert table_of(tmp_path / "s.yaml", tmp_path / "many", "2", "blocks") == alone


def test_a_result_that_goes_with_its_worker_before_it_is_fetched_is_computed_again() -> None:
    from fopi_tune.study import cluster
    from fopi_tune.study.engine import Task

    # a cell that another version computes ends at once, with that as its reason
    task = Task([("key", Cell(0, Kind.CLAIM, "any", {}, "none"))])
    with cluster.local_cluster(2) as runner:
        runner.submit(task, {"numpy": "0"})
        ended = runner._completed
        while not ended.has_ready():
            time.sleep(0.01)
        client: Any = runner._client
        (future,) = list(client.futures)
        (holders,) = client.who_has().values()
        (process,) = client.run(os.getpid, workers=list(holders)).values()
        os.kill(process, signal.SIGKILL)
        # until the scheduler has noticed
        until = time.monotonic() + 10.0
        while client.futures[future].status == "finished" and time.monotonic() < until:
            time.sleep(0.001)
        found = runner.next_outcome()
    assert found.results is not None
    assert "instead of 0" in found.results[0].reason


class _Waiting:
    """A client of a scheduler without workers, whose tasks are never done."""

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        del n_workers
        return {"workers": {}}


def test_a_scheduler_without_workers_is_given_up() -> None:
    from fopi_tune.study import cluster

    runner = cluster.DaskRunner.__new__(cluster.DaskRunner)
    runner.__dict__.update(
        _client=_Waiting(),
        _completed=SimpleNamespace(has_ready=lambda: False, is_empty=lambda: False),
        _no_workers_timeout_s=0.1,
        _last_worker_at=time.monotonic(),
        _workers=1,
        _workers_checked_at=-1e9,
    )
    with pytest.raises(cluster.ClusterLostError, match=r"has had no worker for 0\.1 s; what was done is kept"):
        runner.next_outcome()
