"""Tasks run by Dask, on processes of this machine or on a scheduler's workers.  Importing this module loads no Dask."""

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

#: timeout of the first connection to a scheduler, seconds
_CONNECT_TIMEOUT_S = 20.0
#: a scheduler that has had no worker for so long is given up, seconds
NO_WORKERS_TIMEOUT_S = 300.0
#: between two looks at whether a task is done, seconds
_POLL_S = 0.02
#: threads of numerical libraries in a worker: one, because the cells run in parallel
_THREADS = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "FOPI_THREADS"), "1")
#: other loggers that report Dask's connections
_OTHER_LOGGERS = ("tornado.application", "asyncio")
_CONFIG: Mapping[str, Any] = {
    # no retries by Dask: the engine runs the cells of a dead worker again, alone
    "distributed.scheduler.allowed-failures": 0,
    "distributed.nanny.pre-spawn-environ": _THREADS,
    # a cell may spend long in C++ code; Dask shall not warn about it
    "distributed.admin.tick.limit": "1h",
    # a file of samples may be 16 MB, and travels with its cell
    "distributed.admin.large-graph-warning-threshold": "1GB",
}


_SCHEDULER_GONE = "the scheduler is gone; what was done is kept: run the same command again"


class ClusterError(DomainError):
    """A cluster that cannot be reached."""


class ClusterLostError(FopiError):
    """A cluster that went away while cells were run."""


class DaskRunner:
    """Runs tasks with a Dask client.

    Args:
        client: connected.
        no_workers_timeout_s: how long the scheduler may be without any worker, seconds.
    """

    def __init__(self, client: Client, no_workers_timeout_s: float = NO_WORKERS_TIMEOUT_S) -> None:
        from distributed import as_completed

        self._client = client
        self._no_workers_timeout_s = no_workers_timeout_s
        self._last_worker_at = time.monotonic()
        self._completed = as_completed(raise_errors=False)
        self._tasks: dict[str, Task] = {}
        self._count = 0
        self._workers = 1
        self._workers_checked_at = -1e9

    @property
    def workers(self) -> int:
        """Number of worker processes, updated at most once a second: workers come and go."""
        now = time.monotonic()
        if now - self._workers_checked_at > 1.0:
            self._workers_checked_at = now
            with _translate_lost_connection():
                count = len(self._client.scheduler_info(n_workers=-1)["workers"])
            self._workers = max(1, count)
            if count:
                self._last_worker_at = now
        return self._workers

    def submit(self, task: Task, versions: Mapping[str, str]) -> None:
        """Submit a task; counted blocks stay on their workers until they are combined."""
        self._count += 1
        key = f"task-{id(self):x}-{self._count}"
        run, *words = _call(task, dict(versions))
        with _translate_lost_connection():
            future = self._client.submit(run, *words, key=key, pure=False)
        self._tasks[key] = task
        self._completed.add(future)

    def next_outcome(self) -> TaskOutcome:
        """Wait for a task.

        Raises:
            ClusterLostError: the scheduler is gone, or has had no worker for too long.
        """
        from distributed.scheduler import KilledWorker

        future, status = self._next_ended()
        task = self._tasks.pop(str(future.key))
        with _translate_lost_connection():
            if status == "finished":
                if task.draws is not None:
                    return TaskOutcome(task, block=future)
                results = future.result()
                future.release()
                return TaskOutcome(task, results if isinstance(results, list) else [results])
            if status != "error":
                raise ClusterLostError(_SCHEDULER_GONE)
            error = future.exception()
            future.release()
        if isinstance(error, KilledWorker):
            return TaskOutcome(task)
        return TaskOutcome(task, reason=f"the worker could not run it, {type(error).__name__}: {error}")

    def _next_ended(self) -> tuple[Any, str]:
        """Wait for a task that ended, and how: one whose result went with its worker is run again by the scheduler."""
        while True:
            self._wait()
            future: Any = next(self._completed)
            # read once: a worker may die at any moment, and the result is then waited for where it is fetched
            status: str = future.status
            if status not in ("lost", "pending"):
                return future, status
            self._completed.add(future)

    def _wait(self) -> None:
        """Wait until a task is done."""
        while not (self._completed.has_ready() or self._completed.is_empty()):
            _ = self.workers  # looks for workers
            if time.monotonic() - self._last_worker_at > self._no_workers_timeout_s:
                raise ClusterLostError(
                    f"the scheduler has had no worker for {self._no_workers_timeout_s:g} s; what was done is kept: "
                    "start workers with `dask worker` and run the same command again"
                )
            time.sleep(_POLL_S)


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
def _translate_lost_connection() -> Iterator[None]:
    """Turn a broken connection into `ClusterLostError`, wherever it is noticed."""
    try:
        yield
    except (OSError, TimeoutError, asyncio.CancelledError, concurrent.futures.CancelledError) as error:
        raise ClusterLostError(_SCHEDULER_GONE) from error


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[DaskRunner]:
    """Processes of this machine, one thread each."""
    with _dask_settings():
        from distributed import Client, LocalCluster

        with _sigint_blocked():
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
def _sigint_blocked() -> Iterator[None]:
    """Ctrl-C reaches this process alone: threads started inside, and their worker processes, block the signal."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # its start unblocks the signal in the calling thread, so it is started before the signal is blocked
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def remote_cluster(
    address: str,
    say: Callable[[str], None],
    timeout_s: float = _CONNECT_TIMEOUT_S,
    no_workers_timeout_s: float = NO_WORKERS_TIMEOUT_S,
) -> Iterator[DaskRunner]:
    """The workers of a scheduler.

    Args:
        address: as tcp://host:8786.
        say: called with a message when it has no workers.
        timeout_s: until it must have answered, seconds.
        no_workers_timeout_s: how long it may be without any worker, seconds.

    Raises:
        ClusterError: nothing answers there.
    """
    with _dask_settings():
        from distributed import Client

        try:
            client = Client(address, timeout=timeout_s)
        except (OSError, ValueError, TimeoutError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ClusterError(
                f"no scheduler answers at {address} ({reason}); start one with `dask scheduler`, or check the address"
            ) from None
        with client:
            runner = DaskRunner(client, no_workers_timeout_s)
            worker_infos = client.scheduler_info(n_workers=-1)["workers"]
            if not worker_infos:
                say(
                    f"{address} has no workers yet; start some with `dask worker {address} --nthreads 1`; "
                    f"given up after {no_workers_timeout_s:g} s without any"
                )
            yield runner


@contextlib.contextmanager
def _dask_settings() -> Iterator[None]:
    """Dask's settings during a study; its log messages about workers that come and go are suppressed."""
    import dask.config
    import distributed  # noqa: F401 - loads the defaults that are changed below

    # some loggers of Dask have levels of their own
    names = [
        "distributed",
        *(n for n in logging.root.manager.loggerDict if n.startswith("distributed.")),
        *_OTHER_LOGGERS,
    ]
    levels = {name: logging.getLogger(name).level for name in names}
    with dask.config.set(_CONFIG):
        for name in levels:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            yield
        finally:
            for name, level in levels.items():
                logging.getLogger(name).setLevel(level)
