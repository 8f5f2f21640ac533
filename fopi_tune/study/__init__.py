"""Many specs:  a study file -> cells -> a ledger on the disk, which allows a restart -> a table.

Importing it loads neither Dask nor a solver.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.study.engine import Runner
    from fopi_tune.study.ledger import Counts
    from fopi_tune.study.model import Study
    from fopi_tune.study.table import StudyTable


@dataclass(frozen=True)
class Machines:
    """What runs the cells.

    Args:
        workers: processes of this machine; 0 is this process; None: one a core.
        scheduler: address of a Dask scheduler instead.
    """

    workers: int | None = None
    scheduler: str | None = None


@dataclass(frozen=True)
class StudyResult:
    """The end of a study.

    Args:
        study: with its cells.
        counts: how many of them have a result or failed.
        table: what was collected.
        failures: index, label and reason of each failed cell.
    """

    study: Study
    counts: Counts
    table: StudyTable
    failures: tuple[tuple[int, str, str], ...]


def run(
    study: Study,
    folder: Path,
    machines: Machines = Machines(),
    *,
    retry_failed: bool = False,
    resume: bool = False,
    told: Callable[[Counts], None] | None = None,
    say: Callable[[str], None] = lambda words: None,
) -> StudyResult:
    """Run the cells that were not run yet, and make the table.

    Args:
        study: from `load_study`.
        folder: of the ledger; made where there is none.
        machines: what runs the cells.
        retry_failed: run failed cells again.
        resume: refuse to begin a new study.
        told: called with the progress after every chunk.
        say: called with messages about the cluster and about damaged results.

    Raises:
        LedgerError: the ledger cannot be used, or another process runs this study.
        ClusterError: no scheduler answers.
        ClusterLostError: it went away while cells were run; what was done is kept.
        DomainError: a number of workers below 0, or nothing to resume.
    """
    from fopi_tune.results.stamp import numeric_versions
    from fopi_tune.study.best import best_files
    from fopi_tune.study.engine import run_study
    from fopi_tune.study.ledger import LEDGER, open_ledger
    from fopi_tune.study.table import collect_table

    if machines.workers is not None and machines.workers < 0:
        raise DomainError(f"{machines.workers} workers; give 0 for this process, or how many to start")
    if resume and not (folder / LEDGER).exists():
        raise DomainError(f"there is nothing to resume in {folder}; leave --resume out to begin")
    versions = numeric_versions()
    with open_ledger(folder) as ledger, contextlib.ExitStack() as stack:
        if retry_failed:
            ledger.forget_failed(study, versions)
        counts = run_study(study, ledger, versions, lambda: _runner(machines, stack, say), told, say)
        table = collect_table(study, ledger.results())
        if table.best is not None:
            index = table.best.index
            cell, document = (None, "") if index is None else (study.cells[index], ledger.document_of(index))
            table = replace(table, files={**table.files, **best_files(study.name, table.best, cell, document)})
        return StudyResult(study, counts, table, tuple(ledger.failures()))


def _runner(machines: Machines, stack: contextlib.ExitStack, say: Callable[[str], None]) -> Runner:
    from fopi_tune.study.engine import InProcessRunner

    if machines.scheduler is None and machines.workers == 0:
        return InProcessRunner()
    from fopi_tune.study import cluster

    if machines.scheduler is not None:
        return stack.enter_context(cluster.remote_cluster(machines.scheduler, say))
    return stack.enter_context(cluster.local_cluster(machines.workers or cluster.available_cores()))


__all__ = ["Machines", "StudyResult", "run"]
