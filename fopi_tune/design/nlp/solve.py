"""One solve of a compiled problem:  slots, mode and start -> point.  Nothing here searches; see `exchange`.

Ctrl-C while CasADi is at work is caught here: CasADi takes it for a solve that failed and says so on stderr.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.logform import Array
from fopi_tune.design.nlp.compile import ALPHA, DEPTH, FIRST_GIVE, WORST, Problem
from fopi_tune.design.nlp.layout import Layout
from fopi_tune.design.nlp.slots import Task
from fopi_tune.spec.model import ControllerSpec


@contextlib.contextmanager
def not_swallowed() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the block if Ctrl-C came inside it, whatever became of the first one.

    Another handler than Python's own is left alone, as is a thread that hears no signals.
    """
    usual = signal.default_int_handler
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return
    heard: list[int] = []

    def hear(number: int, frame: FrameType | None) -> None:
        heard.append(number)
        usual(number, frame)

    signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    if heard:
        raise KeyboardInterrupt


@dataclass(frozen=True)
class Solved:
    """What the solver returned; `success` is its own word and is never the last one."""

    success: bool
    status: str
    gains: FoPi
    worst: float
    depth: float
    gives: Array
    cost: float
    limit_prices: Array
    at_bound: tuple[str, ...]
    ki_scale: float
    on_trust_bound: bool


def solve(problem: Problem, box: ControllerSpec, task: Task, start: FoPi, worst: float) -> Solved:
    """Solve one task from one start.

    Args:
        problem: compiled.
        box: the gains' box.
        start: gains to start from.
        worst: start value of the objective's largest member, natural units.

    Raises:
        TooManySlotsError: the problem has fewer slots than the task needs.
    """
    layout = Layout(problem, box, start, task)
    layout.fill(worst)
    bounds = {"lbx": layout.lbx, "ubx": layout.ubx, "lbg": layout.lbg, "ubg": layout.ubg}
    with not_swallowed():
        result = problem.solver(x0=layout.x0, p=layout.p, **bounds)
    stats = problem.solver.stats()
    x = np.array(result["x"]).ravel()
    sides = len(problem.sides)
    finite = bool(np.all(np.isfinite(x)))
    scaled = x[:3] if finite else problem.scale.scaled(start)
    scaled[2] = min(max(scaled[2], layout.lbx[ALPHA]), layout.ubx[ALPHA])
    return Solved(
        success=bool(stats["success"]) and finite,
        status=str(stats["return_status"]),
        gains=_snapped(problem.scale.controller(scaled), box),
        worst=float(x[WORST]),
        depth=float(x[DEPTH]),
        gives=x[FIRST_GIVE : FIRST_GIVE + 2 * sides],
        cost=float(result["f"]),
        limit_prices=np.array(problem.prices(result["x"], layout.p, result["lam_g"])).ravel(),
        at_bound=layout.open_gains_at_bound(x),
        ki_scale=layout.ki_scale,
        on_trust_bound=layout.on_trust_bound(x),
    )


def _snapped(gains: FoPi, box: ControllerSpec) -> FoPi:
    """Into the user's box: rescaling must not carry a gain over its bound by a rounding error."""
    kp = min(max(gains.kp, box.kp.min), box.kp.max)
    ki = min(max(gains.ki, box.ki.min), box.ki.max)
    return FoPi(kp, ki, min(max(gains.alpha, box.alpha.min), box.alpha.max))
