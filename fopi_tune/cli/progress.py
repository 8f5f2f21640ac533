"""Progress of a study on stderr:  a bar on a terminal, otherwise plain lines or JSON lines."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import TYPE_CHECKING

from fopi_tune.cli.output import say
from fopi_tune.core.text_tables.words import counted

if TYPE_CHECKING:
    from fopi_tune.study.ledger import Counts

#: seconds between two plain lines
_LINE_EVERY_S = 10.0

ProgressCallback = Callable[["Counts"], None]


class ProgressStyle(StrEnum):
    """What is shown while cells run."""

    AUTO = "auto"
    BAR = "bar"
    LINES = "lines"
    JSONL = "jsonl"
    NONE = "none"


@contextlib.contextmanager
def progress_display(wanted: ProgressStyle, quiet: bool) -> Iterator[ProgressCallback | None]:
    """The callback that shows progress in the given style; None for no display."""
    if wanted is ProgressStyle.AUTO:
        on_terminal = sys.stderr is not None and sys.stderr.isatty()
        wanted = ProgressStyle.NONE if quiet else ProgressStyle.BAR if on_terminal else ProgressStyle.LINES
    if wanted is ProgressStyle.BAR:
        with _bar() as update:
            yield update
    elif wanted is ProgressStyle.NONE:
        yield None
    else:
        yield _lines() if wanted is ProgressStyle.LINES else _json_lines()


class _Clock:
    """Rate and time left, from the cells of this run."""

    def __init__(self) -> None:
        self.start = time.monotonic()
        self.ran_at_start: int | None = None

    def at(self, counts: Counts) -> tuple[float, float | None, float | None]:
        """Seconds since the start, cells a second, seconds left; None before a cell has run."""
        ran = counts.total - counts.left
        if self.ran_at_start is None:
            self.ran_at_start = ran
        elapsed = time.monotonic() - self.start
        if ran == self.ran_at_start or elapsed <= 0.0:
            return elapsed, None, None
        rate = (ran - self.ran_at_start) / elapsed
        left = counts.left / rate
        if counts.cost is not None and counts.cost.left_s is not None:
            # without the start of the workers, which is in the rate
            left = counts.cost.left_s
        return elapsed, rate, left


def _lines() -> ProgressCallback:
    clock, last = _Clock(), [-_LINE_EVERY_S]

    def update(counts: Counts) -> None:
        elapsed, rate, left = clock.at(counts)
        if elapsed - last[0] < _LINE_EVERY_S and counts.left:
            return
        last[0] = elapsed
        failed = f", {counts.failed} failed" if counts.failed else ""
        speed = f", {rate:.2g} cells/s" if rate is not None else ""
        rest = f", {_duration(left)} left" if left is not None and counts.left else ""
        told = f"{counts.done + counts.failed} of {counted(counts.total, 'cell')}"
        say(f"{told}{failed}{_cost_phrase(counts)}{speed}{rest}")

    return update


def _json_lines() -> ProgressCallback:
    clock = _Clock()

    def update(counts: Counts) -> None:
        elapsed, rate, left = clock.at(counts)
        event = {
            "event": "progress",
            "total": counts.total,
            "done": counts.done,
            "failed": counts.failed,
            "left": counts.left,
            "elapsed_s": round(elapsed, 3),
            "cells_per_s": rate,
            "left_s": left,
            "workers": None if counts.cost is None else counts.cost.workers,
            "cell_processor_s": None if counts.cost is None else counts.cost.cell_processor_s,
        }
        say(json.dumps(event))

    return update


@contextlib.contextmanager
def _bar() -> Iterator[ProgressCallback]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("cells"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]} failed{task.fields[cost]}  {task.fields[rate]}  {task.fields[left]}"),
    )
    clock = _Clock()
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("cells", total=None, failed=0, rate="", left="", cost="")

        def update(counts: Counts) -> None:
            _, rate, left = clock.at(counts)
            bar.update(
                task,
                total=counts.total,
                completed=counts.done + counts.failed,
                failed=counts.failed,
                cost=_cost_phrase(counts),
                rate=f"{rate:.2g}/s" if rate is not None else "",
                left=f"{_duration(left)} left" if left is not None else "",
            )

        yield update


def _cost_phrase(counts: Counts) -> str:
    """Workers, and the measured processor time of a cell."""
    if counts.cost is None:
        return ""
    workers = f"{counts.cost.workers} worker{'s' if counts.cost.workers > 1 else ''}"
    return f", {workers}, {counts.cost.cell_processor_s:.2g} processor s a cell"


def _duration(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
