"""Cells -> results in the ledger:  in this process, or in tasks on whatever runs them; one code path.

A chunk is a task of about a second, so that what a task costs (some milliseconds) is nothing beside it; how long cells
take is learnt on the way.  A task that took its worker down is a suspect: its cells are run again one at a time, each
alone on the cluster, so that the one that kills its worker is found, marked and passed over.

The draws of a cell that has many are counted in blocks by all workers; their sum has the same bits however divided.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from fopi_tune.study.ledger import CellCounts, Ledger, cell_keys
from fopi_tune.study.model import Cell, Study
from fopi_tune.study.worker import CellResult, run_chunk

#: a chunk's aim
_CHUNK_S = 1.0
_MOST_IN_A_CHUNK = 64
#: tasks in flight a worker: one at work, one waiting
_AHEAD = 2
#: fewest draws of a task; what a task costs, and making its filter again, is nothing
#: beside them (a multiple of what is scanned at once)
BLOCK = 196 * 512
#: a mean follows the newest chunk by this much
_FORGETTING = 0.3

KeyedCell = tuple[str, Cell]
#: told how far the study is, after every chunk
ProgressCallback = Callable[[CellCounts], None]

WORKER_DIED = "its worker died (killed, out of memory or crashed), and again when the cell ran alone"


@dataclass(frozen=True)
class Task:
    """What one process does at a time.

    Args:
        cells: a chunk of them; one, of a task that is about its draws.
        draws: count these draws of the cell's stage `validate`, (first, end), for a later task.
        blocks: what such tasks have counted, as their ends told it: all that is left is to put it together.
    """

    cells: Sequence[KeyedCell]
    draws: tuple[int, int] | None = None
    blocks: Sequence[object] = ()


@dataclass(frozen=True)
class TaskOutcome:
    """A task that has ended.

    Args:
        task: that has.
        results: of its cells; None when its worker died, or it was about draws.
        block: what it counted, for another task's `blocks`.
        reason: why there is nothing though no worker died.
    """

    task: Task
    results: Sequence[CellResult] | None = None
    block: object | None = None
    reason: str = ""

    @property
    def died(self) -> bool:
        """Whether its worker did."""
        return self.results is None and self.block is None and not self.reason


class Runner(Protocol):
    """Something that runs tasks, in any order."""

    @property
    def workers(self) -> int:
        """Processes that can work at once; at least 1."""
        ...

    def submit(self, task: Task, versions: Mapping[str, str]) -> None:
        """Begin a task."""
        ...

    def next_outcome(self) -> TaskOutcome:
        """Wait for a task that was submitted."""
        ...


@dataclass
class InProcessRunner:
    """Runs chunks here and now; one worker, for whom draws are not divided."""

    workers: int = 1
    _waiting: deque[tuple[Task, Mapping[str, str]]] = field(default_factory=deque)

    def submit(self, task: Task, versions: Mapping[str, str]) -> None:
        """Remember a task."""
        self._waiting.append((task, versions))

    def next_outcome(self) -> TaskOutcome:
        """Run the oldest."""
        task, versions = self._waiting.popleft()
        return TaskOutcome(task, run_chunk(task.cells, versions))


def run_study(
    study: Study,
    ledger: Ledger,
    versions: Mapping[str, str],
    runner: Callable[[], Runner],
    told: ProgressCallback | None = None,
) -> CellCounts:
    """Run every cell that the ledger does not know.

    Args:
        study: with its cells.
        ledger: open for writing.
        versions: what the cells are computed with.
        runner: makes what runs them; not asked for when there is nothing to run.
        told: how far it is.

    Returns:
        How it ended; nothing is left unless `runner` raises.
    """
    keys = cell_keys(study.cells, versions)
    ledger.plan(study, keys, versions)
    known = ledger.known()
    # equal cells are run once
    todo = {key: cell for key, cell in zip(keys, study.cells, strict=True) if key not in known}
    if told is not None:
        told(ledger.counts())
    if todo:
        _Scheduler(runner(), ledger, versions, told, deque(todo.items())).all()
    return ledger.counts()


@dataclass
class _Scheduler:
    runner: Runner
    ledger: Ledger
    versions: Mapping[str, str]
    told: ProgressCallback | None
    queue: deque[KeyedCell]
    #: tasks about the draws of cells that were begun
    ready: deque[Task] = field(default_factory=deque)
    #: blocks of those cells so far, by the cell's key
    blocks: dict[str, list[object]] = field(default_factory=dict)
    suspects: deque[KeyedCell] = field(default_factory=deque)
    in_flight: int = 0
    cell_s: float | None = None

    def all(self) -> None:
        """The queue, then the suspects one by one."""
        while self.queue or self.ready or self.in_flight:
            while (self.queue or self.ready) and self.in_flight < _AHEAD * self.runner.workers:
                self._submit(self.ready.popleft() if self.ready else self._next())
            ended = self._ended()
            if ended.task.draws is not None:
                self._gather(ended)
            elif ended.died:
                self.suspects.extend(ended.task.cells)
            else:
                self._keep(ended)
        while self.suspects:
            self._submit(Task([self.suspects.popleft()]))
            ended = self._ended()
            self._keep(ended, WORKER_DIED if ended.died else "")

    def _next(self) -> Task:
        """The next chunk, or the first block of the next cell when that has many draws."""
        if not self._is_divided(self.queue[0][1]):
            chunk = [self.queue.popleft()]
            while self.queue and len(chunk) < self._chunk() and not self._is_divided(self.queue[0][1]):
                chunk.append(self.queue.popleft())
            return Task(chunk)
        key, cell = self.queue.popleft()
        self.blocks[key] = []
        edges = draw_blocks(cell.draws)
        self.ready += [Task([(key, cell)], edge) for edge in edges]
        return self.ready.popleft()

    def _is_divided(self, cell: Cell) -> bool:
        return cell.draws >= 2 * BLOCK and self.runner.workers > 1

    def _gather(self, ended: TaskOutcome) -> None:
        """A block that has ended: the last one of a cell is followed by the task that puts them together."""
        ((key, cell),) = ended.task.cells
        if key not in self.blocks:
            return
        if ended.block is not None:
            self.blocks[key].append(ended.block)
            if len(self.blocks[key]) == len(draw_blocks(cell.draws)):
                self.ready.appendleft(Task([(key, cell)], blocks=self.blocks.pop(key)))
            return
        # there is nothing to put together: whatever the reason is, the cell as a whole has it
        del self.blocks[key]
        self.ready = deque(task for task in self.ready if task.cells[0][0] != key)
        if ended.died:
            self.suspects.append((key, cell))
        else:
            self.ready.appendleft(Task([(key, cell)]))

    def _submit(self, task: Task) -> None:
        self.runner.submit(task, self.versions)
        self.in_flight += 1

    def _ended(self) -> TaskOutcome:
        ended = self.runner.next_outcome()
        self.in_flight -= 1
        return ended

    def _keep(self, ended: TaskOutcome, reason: str = "") -> None:
        results = ended.results
        if results is None:
            results = [CellResult(key, "{}", reason or ended.reason, 0.0) for key, _ in ended.task.cells]
        else:
            mean = sum(r.seconds for r in results) / max(1, len(results))
            self.cell_s = mean if self.cell_s is None else (1 - _FORGETTING) * self.cell_s + _FORGETTING * mean
        self.ledger.record(results)
        if self.told is not None:
            self.told(self.ledger.counts())

    def _chunk(self) -> int:
        """Cells of the next chunk: about a second's, and towards the end so few that all workers end together."""
        if self.cell_s is None:
            return 1
        wanted = int(_CHUNK_S / max(self.cell_s, 1e-6))
        fair = (len(self.queue) + 1) // (_AHEAD * self.runner.workers)
        return max(1, min(wanted, fair, _MOST_IN_A_CHUNK))


def draw_blocks(draws: int) -> list[tuple[int, int]]:
    """Blocks of at least `BLOCK` draws, but for the rest: (first, end) of each."""
    firsts = range(0, draws - draws % BLOCK, BLOCK) if draws > BLOCK else range(1)
    return list(itertools.pairwise([*firsts, draws]))
