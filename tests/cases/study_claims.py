"""A registry of claims and figures for tests of studies:  some are slow, some fail, some kill their worker."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """One row, shaped as the paper's."""

    claim: str
    published: float | str
    recomputed: float | str
    verdict: str
    why: str


def _computed(name: str, value: float) -> tuple[Row, ...]:
    return (Row(name, value, value * value, "holds", "an example"), Row(f"{name} again", "a, b", -value, "fails", ""))


def _slow(name: str, value: float) -> tuple[Row, ...]:
    time.sleep(0.02)
    return _computed(name, value)


def _killed() -> tuple[Row, ...]:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("it lives on")


def _dies_once(name: str, after_s: float | None) -> tuple[Row, ...]:
    """Kills its worker the first time that it is run in a folder, at once or a little later."""
    try:
        Path(f"{name}.died").touch(exist_ok=False)
    except FileExistsError:
        return _computed(name, 0.7)
    if after_s is None:
        os.kill(os.getpid(), signal.SIGKILL)
    else:  # in what the worker does next: it sends the result, or is in another cell
        threading.Timer(after_s, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return _computed(name, 0.7)


def _raises() -> tuple[Row, ...]:
    raise ZeroDivisionError("on purpose")


CLAIMS: Mapping[str, Callable[[], tuple[Row, ...]]] = {
    **{f"slow_{i}": partial(_slow, f"slow {i}", 0.1 * i) for i in range(12)},
    "killed": _killed,
    # in one process alone: see `_dies_once`
    "dies_at_once": partial(_dies_once, "dies_at_once", None),
    **{f"dies_{n}": partial(_dies_once, f"dies_{n}", 1e-3 * n) for n in (1, 3, 10, 30)},
    "raises": _raises,
    **{f"late_{i}": partial(_slow, f"late {i}", 0.3 * i) for i in range(12)},
}
FIGURES: Mapping[str, Callable[[], str]] = {
    "circle": lambda: '<svg xmlns="urn:svg"><circle r="1"/></svg>',
    "square": lambda: svg_of("square"),
}
PICTURES: Mapping[str, Callable[[], str]] = {"square": lambda: "square"}


def svg_of(picture: str) -> str:
    """A picture as text."""
    return f"<svg>{picture}</svg>"


def png_of(picture: str) -> bytes:
    """A picture as bytes."""
    return b"\x89PNG " + picture.encode()
