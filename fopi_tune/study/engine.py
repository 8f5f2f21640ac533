"""Cells -> results in the ledger:  in this process, or in chunks on whatever runs them; one code path.

A chunk is a task of about a second, so that what a task costs (some milliseconds) is nothing beside it; how long cells
take is learnt on the way.  A task that took its worker down is a suspect: its cells are run again one at a time, each
alone on the cluster, so that the one that kills its worker is found, marked and passed over.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from fopi_tune.study.cells import Result, run_chunk
from fopi_tune.study.ledger import Counts, Ledger, keyed
from fopi_tune.study.model import Cell, Study

#: a chunk's aim
_CHUNK_S = 1.0
_MOST_IN_A_CHUNK = 64
#: tasks in flight a worker: one at work, one waiting
_AHEAD = 2
#: a mean follows the newest chunk by this much
_FORGETTING = 0.3

Keyed = tuple[str, Cell]
#: told how far the study is, after every chunk
Told = Callable[[Counts], None]

DIED = "its worker died (killed, out of memory or crashed), and again when the cell ran alone"


@dataclass(frozen=True)
class Ended:
    """A task that has ended.

    Args:
        cells: it had.
        results: of them; None when its worker died.
        reason: why there are no results though no worker died.
    """

    cells: Sequence[Keyed]
    results: Sequence[Result] | None
    reason: str = ""


class Runner(Protocol):
    """Something that runs chunks, in any order."""

    @property
    def workers(self) -> int:
        """Processes that can work at once; at least 1."""
        ...

    def submit(self, cells: Sequence[Keyed], versions: Mapping[str, str]) -> None:
        """Begin a chunk."""
        ...

    def next_ended(self) -> Ended:
        """Wait for a chunk that was submitted."""
        ...


@dataclass
class InProcess:
    """Runs chunks here and now."""

    workers: int = 1
    _waiting: deque[tuple[Sequence[Keyed], Mapping[str, str]]] = field(default_factory=deque)

    def submit(self, cells: Sequence[Keyed], versions: Mapping[str, str]) -> None:
        """Remember a chunk."""
        self._waiting.append((cells, versions))

    def next_ended(self) -> Ended:
        """Run the oldest."""
        cells, versions = self._waiting.popleft()
        return Ended(cells, run_chunk(cells, versions))


def run_study(
    study: Study, ledger: Ledger, versions: Mapping[str, str], runner: Callable[[], Runner], told: Told | None = None
) -> Counts:
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
    keys = keyed(study.cells, versions)
    ledger.plan(study, keys, versions)
    known = ledger.known()
    # equal cells are run once
    todo = {key: cell for key, cell in zip(keys, study.cells, strict=True) if key not in known}
    if told is not None:
        told(ledger.counts())
    if todo:
        _Run(runner(), ledger, versions, told, deque(todo.items())).all()
    return ledger.counts()


@dataclass
class _Run:
    runner: Runner
    ledger: Ledger
    versions: Mapping[str, str]
    told: Told | None
    queue: deque[Keyed]
    suspects: deque[Keyed] = field(default_factory=deque)
    in_flight: int = 0
    cell_s: float | None = None

    def all(self) -> None:
        """The queue, then the suspects one by one."""
        while self.queue or self.in_flight:
            while self.queue and self.in_flight < _AHEAD * self.runner.workers:
                self._submit([self.queue.popleft() for _ in range(self._chunk())])
            ended = self._ended()
            if ended.results is None and not ended.reason:
                self.suspects.extend(ended.cells)
                continue
            self._keep(ended)
        while self.suspects:
            self._submit([self.suspects.popleft()])
            ended = self._ended()
            self._keep(ended if ended.results is not None or ended.reason else Ended(ended.cells, None, DIED))

    def _submit(self, cells: Sequence[Keyed]) -> None:
        self.runner.submit(cells, self.versions)
        self.in_flight += 1

    def _ended(self) -> Ended:
        ended = self.runner.next_ended()
        self.in_flight -= 1
        return ended

    def _keep(self, ended: Ended) -> None:
        results = ended.results
        if results is None:
            results = [Result(key, "{}", ended.reason, 0.0) for key, _ in ended.cells]
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
        fair = len(self.queue) // (_AHEAD * self.runner.workers)
        return max(1, min(wanted, fair, _MOST_IN_A_CHUNK))
