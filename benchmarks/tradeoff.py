"""Fifty limits against one design:  CPU time of `fopi tune --tradeoff` and of `fopi tune`, each from the shell.

Run:  python benchmarks/tradeoff.py [SPEC:REQUIREMENT[:FROM:TO] ...]

The sweep's time is split: the fifty limits themselves, solved and checked, and finding the infeasible end, which needs
every start at least once.  "warm" is the sweep within one process, "cold" the same limits each designed from scratch,
measured on three of them.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import fopi_tune as ft
from fopi_tune.prices import feasible_end as ends
from fopi_tune.prices import movable_limit, sweep
from fopi_tune.results.design import objective_name

SPECS = Path(__file__).resolve().parent.parent / "specs"
CASES = (
    "throttle:3", "brake:3", "brake:5", "brake_delay:3", "second_order:1:3:7", "second_order:1",
    "lag_gain_and_delay:1:3:5", "lag_gain_and_delay:1",
)  # fmt: skip
_POINTS = 50


def command_s(arguments: list[str]) -> float:
    """CPU seconds of a command of its own process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "fopi_tune", "tune", "--quiet", "--out", folder, *arguments]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(case: str) -> str:
    """One line of the table."""
    name, number, *range_ = case.split(":")
    path = str(SPECS / f"{name}.yaml")
    low, high = (float(v) for v in range_) if range_ else (None, None)
    options = ["--tradeoff", number, "--points", str(_POINTS)]
    if range_:
        options += ["--from", range_[0], "--to", range_[1]]
    tune_s, whole_s = command_s([path]), command_s([path, *options])
    spec = ft.load_spec(path)
    knob, gains = movable_limit(spec, number), ft.tune(spec, proof=False).gains
    assert gains is not None
    spent: list[float] = []

    def timed_end(*arguments):
        start = time.process_time()
        found = ends.end_of(*arguments)
        spent.append(time.process_time() - start)
        return found

    sweep.end_of = timed_end  # pyright: ignore[reportAttributeAccessIssue]
    start = time.process_time()
    result = sweep.sweep(spec, knob, gains, sweep.SweepRange(low, high, _POINTS), objective_name(spec))
    swept_s = time.process_time() - start - sum(spent)
    start = time.process_time()
    for point in result.points[:: _POINTS // 3][:3]:
        ft.tune(knob.at(point.limit), proof=False)
    cold_s = (time.process_time() - start) / 3 * _POINTS
    return (
        f"{case:26}{tune_s:8.2f}{whole_s:10.2f}{whole_s / tune_s:8.1f}{swept_s:10.2f}{swept_s / tune_s:8.1f}"
        f"{sum(spent):8.2f}{cold_s:9.1f}{len(result.met):5d}"
    )


def main() -> None:
    """Measure and print."""
    print(
        f"{'case':26}{'tune s':>8}{'whole s':>10}{'ratio':>8}{'limits s':>10}{'ratio':>8}{'end s':>8}{'cold s':>9} met"
    )
    for case in sys.argv[1:] or CASES:
        print(measured(case), flush=True)


if __name__ == "__main__":
    main()
