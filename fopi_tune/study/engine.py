"""Cells -> results in the ledger:  tasks in this process or on a cluster, by the same code.

A chunk of cells is a task of about a second, so that the overhead of a task (some milliseconds) is negligible.  The
time of a cell is estimated from the tasks that have ended.  When a worker dies, the cells of its task are suspects.
They are run again one at a time, alone on the cluster; a cell whose worker dies again is recorded as failed.

A cell with many draws is divided into blocks that all workers count; the sum has the same bits for every division.
"""

from __future__ import annotations

import itertools
import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from fopi_tune.montecarlo.progress import logged_progress
from fopi_tune.study.ledger import Cost, Counts, Ledger, cell_keys
from fopi_tune.study.model import Cell, Study
from fopi_tune.study.worker import CellResult, run_chunk

_log = logging.getLogger(__name__)
#: intended duration of a chunk, seconds
_CHUNK_S = 1.0
_MOST_IN_A_CHUNK = 64
#: tasks in flight for each worker: one running, one waiting
_TASKS_PER_WORKER = 2
#: fewest draws of a block, so many that the overhead of a task, and of making its filter again, is negligible
#: (a multiple of what is scanned at once)
BLOCK = 196 * 512
#: weight of the newest chunk in the exponentially smoothed time of a cell
_SMOOTHING = 0.3

KeyedCell = tuple[str, Cell]
#: called with the progress after every chunk
ProgressCallback = Callable[[Counts], None]

WORKER_DIED = "its worker died (killed, out of memory or crashed), and again when the cell ran alone"


@dataclass(frozen=True)
class Task:
    """The work of one process at a time.

    Args:
        cells: a chunk; a task about draws has one cell.
        draws: (first, end) of the draws of stage `validate` that the task counts; None for a task that runs cells.
        blocks: counts of all blocks of the cell, from the outcomes of earlier tasks, which this task combines.
    """

    cells: Sequence[KeyedCell]
    draws: tuple[int, int] | None = None
    blocks: Sequence[object] = ()


@dataclass(frozen=True)
class TaskOutcome:
    """The outcome of a task.

    Args:
        task: the one that has ended.
        results: of its cells; None when its worker died, or the task was about draws.
        block: the counts of its draws, for another task's `blocks`.
        reason: why there is no result although the worker is alive.
    """

    task: Task
    results: Sequence[CellResult] | None = None
    block: object | None = None
    reason: str = ""

    @property
    def died(self) -> bool:
        """Whether the worker died."""
        return self.results is None and self.block is None and not self.reason


class Runner(Protocol):
    """Something that runs tasks, in any order."""

    @property
    def workers(self) -> int:
        """Processes that can work at once; at least 1."""
        ...

    def submit(self, task: Task, versions: Mapping[str, str]) -> None:
        """Start a task."""
        ...

    def next_outcome(self) -> TaskOutcome:
        """Wait for a task that was submitted."""
        ...


@dataclass
class InProcessRunner:
    """Runs tasks in this process, one at a time; draws are not divided."""

    workers: int = 1
    _waiting: deque[tuple[Task, Mapping[str, str]]] = field(default_factory=deque)

    def submit(self, task: Task, versions: Mapping[str, str]) -> None:
        """Queue a task."""
        self._waiting.append((task, versions))

    def next_outcome(self) -> TaskOutcome:
        """Run the oldest task."""
        task, versions = self._waiting.popleft()
        return TaskOutcome(task, run_chunk(task.cells, versions))


def run_study(
    study: Study,
    ledger: Ledger,
    versions: Mapping[str, str],
    runner: Callable[[], Runner],
    told: ProgressCallback | None = None,
    say: Callable[[str], None] = lambda words: None,
) -> Counts:
    """Run every cell that has no result in the ledger, or one that was damaged.

    Args:
        study: with its cells.
        ledger: open for writing.
        versions: of the packages that compute the cells.
        runner: makes the runner; not called when there is nothing to run.
        told: called with the progress after every chunk.
        say: called with a message about each damaged result.

    Returns:
        The final counts; no cell is left unless `runner` raises.
    """
    keys = cell_keys(study.cells, versions)
    ledger.plan(study, keys, versions)
    for index, label in ledger.discard_damaged():
        say(f"what {ledger.path} had of cell {index + 1} ({label}) was damaged; the cell is run again")
    known = ledger.known()
    # equal cells are run once
    todo = {key: cell for key, cell in zip(keys, study.cells, strict=True) if key not in known}
    if told is not None:
        told(ledger.counts())
    _log.info("%s: %d cells, %d of them to be run", study.name, len(study.cells), len(todo))
    if todo:
        logged = _logged(study.name, told)
        _Scheduler(runner(), ledger, versions, logged, deque(todo.items())).run_all()
    return ledger.counts()


def _logged(name: str, told: ProgressCallback | None) -> ProgressCallback:
    """The callback, and lines in the log."""
    line = logged_progress(f"{name}: cells")

    def both(counts: Counts) -> None:
        line(counts.done + counts.failed, counts.total)
        if told is not None:
            told(counts)

    return both


@dataclass
class _Scheduler:
    runner: Runner
    ledger: Ledger
    versions: Mapping[str, str]
    told: ProgressCallback | None
    queue: deque[KeyedCell]
    #: waiting tasks about the draws of started cells
    ready: deque[Task] = field(default_factory=deque)
    #: counted blocks of those cells, by the cell's key
    blocks: dict[str, list[object]] = field(default_factory=dict)
    suspects: deque[KeyedCell] = field(default_factory=deque)
    in_flight: int = 0
    #: smoothed computing time of a cell, s
    cell_s: float | None = None
    #: cells that ended in this run, their computing and their processor time, s
    ended: int = 0
    ended_s: float = 0.0
    processor_s: float = 0.0
    #: the first cells, one a worker, and their computing time, s: it is also that of what a worker loads and compiles
    begun: int = 0
    begun_s: float = 0.0
    divides: bool = False

    def run_all(self) -> None:
        """Run the queue, then the suspects one by one."""
        while self.queue or self.ready or self.in_flight:
            while (self.queue or self.ready) and self.in_flight < _TASKS_PER_WORKER * self.runner.workers:
                self._submit(self.ready.popleft() if self.ready else self._next_task())
            ended = self._wait_for_outcome()
            if ended.task.draws is not None:
                self._keep_block(ended)
            elif ended.died:
                self.suspects.extend(ended.task.cells)
            else:
                self._record(ended)
        while self.suspects:
            self._submit(Task([self.suspects.popleft()]))
            ended = self._wait_for_outcome()
            self._record(ended, WORKER_DIED if ended.died else "")

    def _next_task(self) -> Task:
        """The next chunk, or the first block of the next cell when it has many draws."""
        if not self._is_divided(self.queue[0][1]):
            chunk = [self.queue.popleft()]
            while self.queue and len(chunk) < self._chunk_size() and not self._is_divided(self.queue[0][1]):
                chunk.append(self.queue.popleft())
            return Task(chunk)
        key, cell = self.queue.popleft()
        self.divides = True
        self.blocks[key] = []
        edges = draw_blocks(cell.draws)
        self.ready += [Task([(key, cell)], edge) for edge in edges]
        return self.ready.popleft()

    def _is_divided(self, cell: Cell) -> bool:
        return cell.draws >= 2 * BLOCK and self.runner.workers > 1

    def _keep_block(self, ended: TaskOutcome) -> None:
        """Keep a counted block; after the last one of a cell, queue the task that combines them."""
        ((key, cell),) = ended.task.cells
        if key not in self.blocks:
            return
        if ended.block is not None:
            self.blocks[key].append(ended.block)
            if len(self.blocks[key]) == len(draw_blocks(cell.draws)):
                self.ready.appendleft(Task([(key, cell)], blocks=self.blocks.pop(key)))
            return
        # the block failed: run the cell as a whole, which gives the reason
        del self.blocks[key]
        self.ready = deque(task for task in self.ready if task.cells[0][0] != key)
        if ended.died:
            self.suspects.append((key, cell))
        else:
            self.ready.appendleft(Task([(key, cell)]))

    def _submit(self, task: Task) -> None:
        self.runner.submit(task, self.versions)
        self.in_flight += 1

    def _wait_for_outcome(self) -> TaskOutcome:
        ended = self.runner.next_outcome()
        self.in_flight -= 1
        return ended

    def _record(self, ended: TaskOutcome, reason: str = "") -> None:
        results = ended.results
        if results is None:
            results = [CellResult(key, "{}", reason or ended.reason, 0.0) for key, _ in ended.task.cells]
        else:
            mean = sum(r.seconds for r in results) / max(1, len(results))
            first = results[: max(0, self.runner.workers - self.begun)]
            self.begun, self.begun_s = self.begun + len(first), self.begun_s + sum(r.seconds for r in first)
            self.ended, self.ended_s = self.ended + len(results), self.ended_s + sum(r.seconds for r in results)
            self.processor_s += sum(r.processor_s for r in results)
            self.cell_s = mean if self.cell_s is None else (1 - _SMOOTHING) * self.cell_s + _SMOOTHING * mean
        self.ledger.record(results)
        if self.told is not None:
            counts = self.ledger.counts()
            self.told(replace(counts, cost=self._cost(counts.left)))

    def _cost(self, left: int) -> Cost | None:
        """The measured cost of the cells that ended, and with it the time that is left."""
        if self.cell_s is None or not self.ended:
            return None
        workers, later = self.runner.workers, self.ended - self.begun
        cell_s = (self.ended_s - self.begun_s) / later if later else self.cell_s
        left_s = None if self.divides else left * cell_s / workers
        return Cost(workers, self.processor_s / self.ended, left_s)

    def _chunk_size(self) -> int:
        """Cells of the next chunk: about a second's work, and fewer near the end so that all workers end together."""
        if self.cell_s is None:
            return 1
        in_time = int(_CHUNK_S / max(self.cell_s, 1e-6))
        fair = (len(self.queue) + 1) // (_TASKS_PER_WORKER * self.runner.workers)
        return max(1, min(in_time, fair, _MOST_IN_A_CHUNK))


def draw_blocks(draws: int) -> list[tuple[int, int]]:
    """(first, end) of each block: `BLOCK` draws, and the remainder in the last one."""
    firsts = range(0, draws - draws % BLOCK, BLOCK) if draws > BLOCK else range(1)
    return list(itertools.pairwise([*firsts, draws]))
