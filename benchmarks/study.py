"""Studies:  what a cell costs beside its own work, how two workers compare with one, and how fast limits are re-solved.

Run:  python benchmarks/study.py [CELLS]
      python benchmarks/study.py --re-solves [CELLS]     the brake with other limits, 10,000 times when left out

"Busy" is the part of the workers' time, after they are up, that they spend inside cells.  A cell's time is measured in
its worker, so that other work on the machine makes cells and run longer alike and leaves it as it is: two workers that
are both busy do twice the work of one wherever there are two free cores.  CPU times are of all processes together.
"""

from __future__ import annotations

import os
import resource
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from fopi_tune.results.stamp import numeric_versions
from fopi_tune.study import cluster, engine
from fopi_tune.study.engine import InProcessRunner, run_study
from fopi_tune.study.ledger import open_ledger
from fopi_tune.study.load import load_study
from fopi_tune.study.model import Study
from fopi_tune.study.worker import run_cell

_BRAKE = Path(__file__).parents[1] / "specs" / "brake.yaml"
_VERSIONS = numeric_versions()
_RE_SOLVES = 10_000


@dataclass(frozen=True)
class Measured:
    """One run: seconds after the workers were up, inside cells, and of the processors in all, start-up included."""

    run_s: float
    in_cells_s: float
    cpu_s: float


def study_of(cells: int, stages: str, starts: str) -> Study:
    """The brake's design with that many limits, in a grid that is as square as may be."""
    rows = max(1, round(cells**0.5))
    columns = -(-cells // rows)
    sensitivity = [-20.0 + 3.0 * i / rows for i in range(rows)]
    margins = [78.0 + 3.0 * i / columns for i in range(columns)]
    text = (
        f"schema: 1\nname: brakes\nspecs: [{_BRAKE.name}]\nstages: {stages}\nstarts: {starts}\nlimit_cells: 1000000\n"
        f"grid:\n  requirements[4].sensitivity_db.at_most: {sensitivity}\n"
        f"  requirements[2].phase_margin_deg.at_least: {margins}\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "s.yaml")
        path.write_text(text, encoding="utf-8")
        Path(folder, _BRAKE.name).write_bytes(_BRAKE.read_bytes())
        return load_study(path)


def cpu_s() -> float:
    """Of this process and of all its children that have ended."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in used)


def measured(study: Study, workers: int) -> Measured:
    """A run from nothing."""
    before = cpu_s()
    with tempfile.TemporaryDirectory() as folder, open_ledger(Path(folder)) as ledger:
        if workers == 0:
            start = time.perf_counter()
            run_study(study, ledger, _VERSIONS, InProcessRunner)
            run_s = time.perf_counter() - start
        else:
            with cluster.local_cluster(workers) as runner:
                start = time.perf_counter()
                run_study(study, ledger, _VERSIONS, lambda: runner)
                run_s = time.perf_counter() - start
        in_cells_s = ledger.seconds()
    return Measured(run_s, in_cells_s, cpu_s() - before)


def own_cpu_s(study: Study, most: int) -> float:
    """Median processor time of a cell alone, in this process, after the first."""
    times = []
    for i, cell in enumerate(study.cells[:: max(1, len(study.cells) // most)]):
        start = time.process_time()
        result = run_cell("key", cell)
        assert not result.failed, result.reason
        if i:
            times.append(time.process_time() - start)
    return statistics.median(times)


def main() -> None:
    """Measure and print."""
    cells = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    sys.path.insert(0, str(Path(__file__).parent))
    os.environ["PYTHONPATH"] = os.pathsep.join((str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")))
    designs = study_of(cells, "[tune, prove]", "all")
    own_s = own_cpu_s(designs, 20)
    print(f"load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"tune + prove: {own_s * 1e3:.0f} ms of processor time a cell, {len(designs.cells)} cells")
    runs = {workers: measured(designs, workers) for workers in (1, 2)}
    for workers, run in runs.items():
        busy = run.in_cells_s / (workers * run.run_s)
        print(
            f"  {workers} worker(s): {run.run_s:8.1f} s, busy {100 * busy:5.1f} %, {run.cpu_s:7.1f} s of processor time"
        )
    busy = [runs[w].in_cells_s / (w * runs[w].run_s) for w in (1, 2)]
    by_clock, by_busy = runs[1].run_s / runs[2].run_s, 2 * busy[1] / busy[0]
    print(f"  2 workers / 1 worker: {by_clock:.2f} by the clock, {by_busy:.2f} by how busy they are")

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "s.yaml")
        path.write_text("schema: 1\nname: nothing\nclaims: all\n", encoding="utf-8")
        nothing = load_study(path, registry="study_nothing")
    idle = measured(Study("few", nothing.cells[:2], ()), 2)
    print(f"two workers up and down again: {idle.cpu_s:.1f} s of processor time; overhead a cell, in all processes:")
    for most, what in ((engine._MOST_IN_A_CHUNK, "cells of no work, in chunks"), (1, "each a task of its own")):
        engine._MOST_IN_A_CHUNK = most
        each_s = (measured(nothing, 2).cpu_s - idle.cpu_s) / len(nothing.cells)
        print(f"  {what:28} {each_s * 1e3:6.2f} ms, {100 * each_s / own_s:5.2f} % of a design and proof")

    for name, starts in (("the whole box", "all"), ("the base's gains and fewer rays", "base")):
        again_s = own_cpu_s(study_of(cells, "[tune]", starts), 100)
        print(f"re-solve, {name}: {again_s * 1e3:.0f} ms of processor time")


def re_solve(cells: int) -> None:
    """Designs of the brake with other limits, each with its verification, by two workers, from the base's gains."""
    before, study = time.perf_counter(), study_of(cells, "[tune]", "base")
    print(f"{len(study.cells):,} cells, read and checked in {time.perf_counter() - before:.1f} s")
    print(f"load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    run = measured(study, 2)
    each_ms, own_ms = 1e3 * run.in_cells_s / len(study.cells), 1e3 * run.cpu_s / len(study.cells)
    print(
        f"re-solved in {run.run_s:.1f} s, {run.cpu_s:.1f} s of processor time; {each_ms:.1f} ms inside a cell, busy "
        f"{100 * run.in_cells_s / (2 * run.run_s):.1f} %"
    )
    whole_ms = 1e3 * own_cpu_s(study_of(cells, "[tune]", "all"), 20)
    print(
        f"{own_ms:.1f} ms of processor time a cell, all processes and their start included; "
        f"{own_ms / whole_ms:.2f} times the {whole_ms:.1f} ms of a scan of the whole box in one process"
    )


if __name__ == "__main__":
    if "--re-solves" in sys.argv:
        re_solve(next((int(word) for word in sys.argv[1:] if word.isdigit()), _RE_SOLVES))
    else:
        main()
