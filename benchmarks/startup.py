"""How long the command takes to answer:  median wall time of several runs, and its ratio to `python -c pass`.

    python benchmarks/startup.py [--runs N]

Measures the package that is installed for this interpreter.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

SPEC = Path(__file__).parents[1] / "specs" / "brake.yaml"
FOPI = (sys.executable, "-c", "from fopi_tune.cli import main; main()")


def median_s(command: Sequence[str], folder: str, runs: int, expected: int) -> float:
    """Median wall time in s; the first run warms the disk's cache and does not count."""
    times = []
    for _ in range(runs + 1):
        start = time.perf_counter()
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        times.append(time.perf_counter() - start)
        if done.returncode != expected:
            sys.exit(f"{' '.join(command)} ended with {done.returncode}, not {expected}:\n{done.stderr.decode()}")
    return statistics.median(times[1:])


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description="How long the command takes to answer.")
    parser.add_argument("--runs", type=int, default=7, help="runs of each command")
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        wrong = Path(folder, "wrong.yaml")
        wrong.write_text(
            SPEC.read_text(encoding="utf-8").replace("crossover_rad_s", "crosover_rad_s"), encoding="utf-8"
        )
        cases = (
            ("python -c pass", (sys.executable, "-c", "pass"), 0, None),
            ("fopi --version", (*FOPI, "--version"), 0, 0.4),
            ("fopi tune wrong.yaml", (*FOPI, "tune", str(wrong)), 2, 0.4),
            ("fopi tune brake.yaml", (*FOPI, "tune", str(SPEC)), 0, 2.5),
        )
        print(f"{'command':<24}{'median s':>10}{'aim s':>8}{'ratio':>8}")
        base = None
        for label, command, expected, aim in cases:
            seconds = median_s(command, folder, runs, expected)
            base = base or seconds
            print(f"{label:<24}{seconds:>10.3f}{'' if aim is None else aim:>8}{seconds / base:>8.1f}")


if __name__ == "__main__":
    main()
