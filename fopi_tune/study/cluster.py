"""Dask as what runs tasks:  processes of this machine, or a scheduler's address.  Importing it loads no Dask."""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from fopi_tune.errors import DomainError, FopiError
from fopi_tune.study.engine import Task, TaskOutcome
from fopi_tune.study.worker import combine_blocks, run_block, run_chunk

if TYPE_CHECKING:
    from distributed import Client

#: seconds until a scheduler must have answered
_PATIENCE_S = 20.0
#: threads of numerical libraries in a worker: the cells themselves are what runs in parallel
_THREADS = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "FOPI_THREADS"), "1")
#: others that say what Dask's connections do
_LOGS = ("tornado.application", "asyncio")
_CONFIG: Mapping[str, Any] = {
    # a task whose worker died comes back at once: the engine runs its cells again, alone
    "distributed.scheduler.allowed-failures": 0,
    "distributed.nanny.pre-spawn-environ": _THREADS,
    # a cell is long in C++ code, which is no reason for Dask to worry
    "distributed.admin.tick.limit": "1h",
    # a file of samples may be 16 MB, and travels with its cell
    "distributed.admin.large-graph-warning-threshold": "1GB",
}


_GONE = "the scheduler is gone; what was done is kept: run the same command again"


class ClusterError(DomainError):
    """A cluster that cannot be reached."""


class ClusterLostError(FopiError):
    """A cluster that went away while cells were run."""


class DaskRunner:
    """Tasks of a Dask client."""

    def __init__(self, client: Client) -> None:
        from distributed import as_completed

        self._client = client
        self._ended = as_completed(raise_errors=False)
        self._tasks: dict[str, Task] = {}
        self._count = 0
        self._workers = 1
        self._looked = -1e9

    @property
    def workers(self) -> int:
        """Processes that are there, looked up now and then: workers come and go."""
        now = time.monotonic()
        if now - self._looked > 1.0:
            self._looked = now
            with _told_if_lost():
                self._workers = max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
        return self._workers

    def submit(self, task: Task, versions: Mapping[str, str]) -> None:
        """Hand a task to the scheduler; blocks stay on the workers that counted them until they are put together."""
        self._count += 1
        key = f"task-{id(self):x}-{self._count}"
        run, *words = _call(task, dict(versions))
        with _told_if_lost():
            future = self._client.submit(run, *words, key=key, pure=False)
        self._tasks[key] = task
        self._ended.add(future)

    def next_outcome(self) -> TaskOutcome:
        """Wait for a task.

        Raises:
            ClusterLostError: the scheduler is gone.
        """
        from distributed.scheduler import KilledWorker

        future: Any = next(self._ended)
        task = self._tasks.pop(str(future.key))
        with _told_if_lost():
            if future.status == "finished":
                if task.draws is not None:
                    return TaskOutcome(task, block=future)
                results = future.result()
                future.release()
                return TaskOutcome(task, results if isinstance(results, list) else [results])
            if future.status != "error":
                raise ClusterLostError(_GONE)
            error = future.exception()
            future.release()
        if isinstance(error, KilledWorker):
            return TaskOutcome(task)
        return TaskOutcome(task, reason=f"the worker could not run it, {type(error).__name__}: {error}")


def _call(task: Task, versions: dict[str, str]) -> tuple[Any, ...]:
    """The function that a worker calls, and its arguments."""
    if task.draws is not None:
        ((_, cell),) = task.cells
        return run_block, cell, versions, *task.draws
    if task.blocks:
        ((key, cell),) = task.cells
        return combine_blocks, key, cell, list(task.blocks)
    return run_chunk, list(task.cells), versions


@contextlib.contextmanager
def _told_if_lost() -> Iterator[None]:
    """A connection that breaks is the scheduler's end, wherever it is noticed."""
    try:
        yield
    except (OSError, TimeoutError, asyncio.CancelledError, concurrent.futures.CancelledError) as error:
        raise ClusterLostError(_GONE) from error


def available_cores() -> int:
    """Of this machine, as far as this process may use them."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[DaskRunner]:
    """Processes of this machine, one thread each."""
    with _quiet():
        from distributed import Client, LocalCluster

        with _uninterrupted():
            # the scheduler opens an HTTP server in any case: on a port that is free, for this machine alone
            http = {"dashboard": False, "dashboard_address": f"{_loopback()}:0"}
            settings: dict[str, Any] = {"scheduler_kwargs": http, "silence_logs": logging.CRITICAL}
            cluster = LocalCluster(n_workers=workers, threads_per_worker=1, **settings)
        with cluster, Client(cluster) as client:
            yield DaskRunner(client)


def _loopback() -> str:
    """The address under which this machine alone reaches itself."""
    return str(socket.getaddrinfo(None, 0, socket.AF_INET, socket.SOCK_STREAM)[0][4][0])


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C is for this process alone: threads that begin here, and the workers they start, never see it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # it unblocks the signal in the thread that starts it, which would else be the one that starts the workers
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def remote_cluster(address: str, say: Callable[[str], None], patience_s: float = _PATIENCE_S) -> Iterator[DaskRunner]:
    """The workers of a scheduler.

    Args:
        address: as tcp://host:8786.
        say: told when it has no workers.
        patience_s: until it must have answered.

    Raises:
        ClusterError: nothing answers there.
    """
    with _quiet():
        from distributed import Client

        try:
            client = Client(address, timeout=patience_s)
        except (OSError, ValueError, TimeoutError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ClusterError(
                f"no scheduler answers at {address} ({reason}); start one with `dask scheduler`, or check the address"
            ) from None
        with client:
            runner = DaskRunner(client)
            told = client.scheduler_info(n_workers=-1)["workers"]
            if not told:
                say(f"{address} has no workers yet; start some with `dask worker {address} --nthreads 1`")
            yield runner


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Dask's settings for the time of a study; what it logs about workers that come and go is not for the user."""
    import dask.config
    import distributed  # noqa: F401 - its own defaults must be there before they are changed for a while

    # parts of Dask have levels of their own
    names = ["distributed", *(n for n in logging.root.manager.loggerDict if n.startswith("distributed.")), *_LOGS]
    levels = {name: logging.getLogger(name).level for name in names}
    with dask.config.set(_CONFIG):
        for name in levels:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            yield
        finally:
            for name, level in levels.items():
                logging.getLogger(name).setLevel(level)
