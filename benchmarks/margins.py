"""Margins of many sampled loops:  what `fopi validate` counts of each plant, against python-control plant by plant.

    python benchmarks/margins.py [--plants N]

The loop: the brake of `specs/brake.yaml` with a digital controller of 8 sections and uncertain lags.  Of every plant:
stability, phase margin, crossover, gain margin and the largest |S| below 0.02 rad/s.  Ratios within one run are what to
compare; other work on the machine moves the rest.
"""

from __future__ import annotations

import argparse
import time
import warnings
from typing import Any

import control
import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.montecarlo.montecarlo import monte_carlo
from fopi_tune.spec.load import parse_spec

TEXT = """
schema: 1
name: brake
plant: {model: lag, static_gain: 1.0, time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}}
controller: {kp: 0.44651, ki: 0.37033, alpha: 0.83197}
requirements:
  - phase_margin_deg: {at_least: 80}
  - crossover_rad_s: {at_least: 0.1}
  - gain_margin_db: {at_least: 12}
  - {sensitivity_db: {at_most: -20}, to_rad_s: 0.02}
digital: {sample_time_s: 0.2}
"""
GAINS = FoPi(0.44651, 0.37033, 0.83197)
#: plants of the alternative, which takes some milliseconds each
FEW = 40


def ours(plants: int) -> float:
    """Seconds for this many plants, drawing and statistics included; the compiled scan is there already."""
    spec = parse_spec(TEXT + f"validation: {{samples: {plants}, seed: 1}}\n")
    implementation = implementation_of(spec, GAINS)
    begin = time.perf_counter()
    found = monte_carlo(spec, GAINS, implementation)
    taken = time.perf_counter() - begin
    assert found.stable.met == plants
    return taken


def theirs(plants: int) -> float:
    """Seconds of python-control: margins by its own search, |S| on 400 frequencies."""
    spec = parse_spec(TEXT)
    sections = implementation_of(spec, GAINS).sections
    ts = sections.sample_time_s
    poles, residues = np.array(sections.poles), np.array(sections.residues)
    controller = control.ss(np.diag(poles), np.ones((len(poles), 1)), residues[None, :], sections.direct, ts)
    omega = np.geomspace(1e-6, 0.02, 400)
    begin = time.perf_counter()
    for lag in np.linspace(1.6, 3.1, plants):
        pole = float(np.exp(-ts / lag))
        loop = control.ss([[pole]], [[1.0 - pole]], [[1.0]], [[0.0]], ts) * controller
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            control.stability_margins(loop)
        found: Any = control.frequency_response(loop, omega)
        np.abs(1.0 / (1.0 + found.complex)).max()
        closed: Any = control.feedback(loop, 1)
        np.abs(np.linalg.eigvals(closed.A)).max()
    return time.perf_counter() - begin


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plants", type=int, default=200_000)
    plants = parser.parse_args().plants
    ours(2000)
    taken, other = ours(plants), theirs(FEW) / FEW * plants
    print(f"{plants} plants: {taken:.2f} s, {1e6 * taken / plants:.1f} s a million")
    print(f"python-control, {FEW} plants one by one: {1e6 * other / plants:.0f} s a million, {other / taken:.0f} times")


if __name__ == "__main__":
    main()
