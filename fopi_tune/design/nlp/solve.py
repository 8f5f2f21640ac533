"""One solve of a compiled problem by Ipopt:  task and start -> Solved.  `exchange` decides what is solved.

CasADi takes Ctrl-C during a solve for a failure of the solver; `raising_interrupts` raises KeyboardInterrupt
nevertheless.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from types import FrameType

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.nlp.compile import Problem
from fopi_tune.design.nlp.layout import Layout
from fopi_tune.design.nlp.rows import ALPHA, DEPTH, FIRST_RELAXATION, WORST
from fopi_tune.design.nlp.slots import Task
from fopi_tune.spec.model import ControllerSpec


@contextlib.contextmanager
def raising_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the block if Ctrl-C came inside it and was swallowed.

    Nothing is changed where the handler is not Python's own, or outside the main thread, which alone gets signals.
    """
    usual = signal.default_int_handler
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return
    received: list[int] = []

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        usual(number, frame)

    signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    if received:
        raise KeyboardInterrupt


@dataclass(frozen=True)
class Solved:
    """What the solver returned; `success` is the solver's own claim, which the oracle and the proof check."""

    success: bool
    status: str
    gains: FoPi
    worst: float
    depth: float
    relaxations: Array
    cost: float
    limit_prices: Array
    at_bound: tuple[str, ...]
    ki_scale: float
    on_trust_boundary: bool


def solve(problem: Problem, box: ControllerSpec, task: Task, start: FoPi, worst: float) -> Solved:
    """Solve one task from one start.

    Args:
        problem: compiled.
        box: the gains' box.
        start: gains to start from.
        worst: start value of the variable `worst`, the objective's largest member, natural units.

    Raises:
        TooManySlotsError: the problem has fewer slots than the task needs.
    """
    layout = Layout(problem, box, start, task)
    layout.fill(worst)
    bounds = {"lbx": layout.lbx, "ubx": layout.ubx, "lbg": layout.lbg, "ubg": layout.ubg}
    with raising_interrupts():
        result = problem.solver(x0=layout.x0, p=layout.p, **bounds)
    stats = problem.solver.stats()
    x = np.array(result["x"]).ravel()
    constraints = len(problem.constraints)
    finite = bool(np.all(np.isfinite(x)))
    scaled = x[:3] if finite else problem.scale.scaled(start)
    scaled[2] = min(max(scaled[2], layout.lbx[ALPHA]), layout.ubx[ALPHA])
    return Solved(
        success=bool(stats["success"]) and finite,
        status=str(stats["return_status"]),
        gains=_clipped(problem.scale.controller(scaled), box),
        worst=float(x[WORST]),
        depth=float(x[DEPTH]),
        relaxations=x[FIRST_RELAXATION : FIRST_RELAXATION + 2 * constraints],
        cost=float(result["f"]),
        limit_prices=np.array(problem.prices(result["x"], layout.p, result["lam_g"])).ravel(),
        at_bound=layout.open_gains_at_bound(x),
        ki_scale=layout.ki_scale,
        on_trust_boundary=layout.on_trust_boundary(x),
    )


def _clipped(gains: FoPi, box: ControllerSpec) -> FoPi:
    """Clip to the user's ranges: rescaling may exceed a bound by a rounding error."""
    kp = min(max(gains.kp, box.kp.min), box.kp.max)
    ki = min(max(gains.ki, box.ki.min), box.ki.max)
    return FoPi(kp, ki, min(max(gains.alpha, box.alpha.min), box.alpha.max))
