"""The convex path against the search of the whole box:  specs/brake_delay.yaml with alpha fixed, and all of it.

Run:  python benchmarks/convex.py [SPEC [ALPHA]]

The convex path looks for its own starts, compiles its two problems, and takes in what its exact peaks and crossings
find.  Seconds are the processor's, as other work may share the machine.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import cvxpy  # noqa: F401  - its import is no part of what is measured

from fopi_tune.convex import convex_design
from fopi_tune.core.controller import FoPi
from fopi_tune.design import design
from fopi_tune.proof import verify
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec, GainRange

_REPEATS = 5
Answer = TypeVar("Answer")


def timed(run: Callable[[], Answer], repeats: int = _REPEATS) -> tuple[float, Answer]:
    """Median processor seconds of some runs, and the last answer."""
    seconds: list[float] = []
    answers: list[Answer] = []
    for _ in range(repeats):
        start = time.process_time()
        answers.append(run())
        seconds.append(time.process_time() - start)
    return statistics.median(seconds), answers[-1]


def show(name: str, seconds: float, spec: DesignSpec, gains: FoPi | None) -> None:
    """One line: time, objective by the check, violation."""
    if gains is None:
        print(f"{name:44} {seconds:8.3f} s   no answer")
        return
    found = verify(spec, gains)
    missed = max((max(-result.slack, 0.0) for result in found.requirements if result.slack is not None), default=0.0)
    print(f"{name:44} {seconds:8.3f} s   objective {found.objective:.8g}   violation {missed:.1e}")


def main() -> None:
    """Measure and print."""
    path = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).parent.parent / "specs" / "brake_delay.yaml")
    alpha = float(sys.argv[2]) if len(sys.argv) > 2 else 1.2
    whole = load_spec(path)
    spec = replace(whole, controller=replace(whole.controller, alpha=GainRange(alpha, alpha)))
    convex_s, convex = timed(lambda: convex_design(spec))
    search_s, found = timed(lambda: design(spec))
    print(f"{spec.name}, alpha = {alpha:g}: median of {_REPEATS} runs, processor time")
    show("convex path, everything", convex_s, spec, convex.gains)
    show("search of the whole box, everything", search_s, spec, found.gains)
    whole_s, answer = timed(lambda: convex_design(whole), 1)
    design_s, other = timed(lambda: design(whole), 1)
    show("alpha free: convex path", whole_s, whole, answer.gains)
    show("alpha free: search of the whole box", design_s, whole, other.gains)


if __name__ == "__main__":
    main()
