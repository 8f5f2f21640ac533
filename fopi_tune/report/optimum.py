"""What is proved of the best gains, as lines of a design's table."""

from __future__ import annotations

from collections.abc import Iterator

from fopi_tune.optimum import Optimum, OptimumStatus
from fopi_tune.report.phrases import Line, entry, number


def optimum_lines(optimum: Optimum | None) -> Iterator[Line]:
    """Nothing where it was not asked for."""
    if optimum is None:
        return
    good = optimum.status in (OptimumStatus.CERTIFIED, OptimumStatus.INFEASIBLE)
    yield from entry("optimum", _said(optimum), "" if good else "yellow")


def _said(optimum: Optimum) -> str:
    effort = f"{optimum.boxes} boxes of gains, {optimum.seconds:.1f} s"
    status = optimum.status
    if status is OptimumStatus.INFEASIBLE:
        return f"proved infeasible: no gains in the box meet every requirement ({effort})"
    if status is OptimumStatus.NO_BOUND:
        return f"no bound: {optimum.reason}"
    if optimum.bound is None or optimum.gap is None:
        return f"nothing proved: {optimum.reason} ({effort})"
    found = f"no gains that meet every requirement are better than {number(optimum.bound)}"
    if optimum.better is not None:
        g = optimum.better
        found += f"; better gains: kp = {number(g.kp, 8)}, ki = {number(g.ki, 8)}, alpha = {number(g.alpha, 8)}"
    word = "certified" if status is OptimumStatus.CERTIFIED else f"bounded, {optimum.reason}"
    unused = f"; not used: {', '.join(optimum.left_out)}" if optimum.left_out else ""
    return f"{word}: {found}, a gap of {100.0 * optimum.gap:.2g} % ({effort}){unused}"
