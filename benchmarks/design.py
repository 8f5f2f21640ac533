"""Processor time of cold designs in a warm process:  the shipped specs, and random ones of every kind.

Run:  python benchmarks/design.py [SEEDS]

A design is cold when nothing of its spec was computed before; the process is warm when Numba and CasADi have compiled
what all specs share.  Gains count only when the verification finds every requirement met.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from cases.random_specs import random_spec  # noqa: E402

from fopi_tune.design import design  # noqa: E402
from fopi_tune.proof import verify  # noqa: E402
from fopi_tune.results.status import Status  # noqa: E402
from fopi_tune.spec import load_spec, parse_spec  # noqa: E402
from fopi_tune.spec.model import DesignSpec  # noqa: E402


def measured(spec: DesignSpec) -> tuple[float, Status, bool]:
    """Milliseconds of processor time, how it ended, and whether the gains verify."""
    start = time.process_time()
    candidate = design(spec)
    spent = 1e3 * (time.process_time() - start)
    met = candidate.gains is not None and verify(spec, candidate.gains).all_met
    return spent, candidate.status, met


def main() -> None:
    """Measure and print."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    shipped = [load_spec(path) for path in sorted((ROOT / "specs").glob("*.yaml"))]
    drawn = [parse_spec(random_spec(seed)) for seed in range(seeds)]
    for spec in (*shipped, *drawn[:12]):
        design(spec)  # compiles what is shared
    for name, specs in (("shipped", shipped), ("random", drawn)):
        found = [measured(spec) for spec in specs]
        times = sorted(spent for spent, _, _ in found)
        solved = sum(status is Status.SOLVED for _, status, _ in found)
        wrong = sum(status is Status.SOLVED and not met for _, status, met in found)
        print(
            f"{name:8} {len(times):3} specs   median {statistics.median(times):7.1f} ms   "
            f"90 % {times[int(0.9 * (len(times) - 1))]:7.1f} ms   solved {solved}   refuted by the check {wrong}"
        )


if __name__ == "__main__":
    main()
