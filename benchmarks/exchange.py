"""Exchange against a full grid:  the same NLP of specs/brake_delay.yaml, 200 frequencies times 10 plants.

Run:  python benchmarks/exchange.py [SPEC]

Both sides start at the same gains and use the same compiled expressions, solver and options.  The grid puts every
frequency and every plant into Ipopt at once; the exchange puts in what its oracle finds.  Both answers are then checked
by `fopi_tune.proof`, which knows of neither grid.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.design import design
from fopi_tune.design.constraints import STABILITY_GUARD, scale_of
from fopi_tune.design.exchange import Exchange
from fopi_tune.design.nlp.compile import compile_problem
from fopi_tune.design.nlp.slots import MarginPlant, Mode, Point, Task
from fopi_tune.design.nlp.solve import solve
from fopi_tune.design.search import Search
from fopi_tune.proof import verify
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec

_OMEGAS, _PLANTS, _REPEATS = 200, 10, 5


def grid_task(search: Search, spec: DesignSpec) -> Task:
    """Everything at once: every side of every requirement at 200 frequencies of its band and 10 plants."""
    scale, constraints = scale_of(spec), search.exchange.constraints
    axes = [np.linspace(a, b, _PLANTS) for a, b in zip(spec.plant.low, spec.plant.high, strict=True)]
    plants = [tuple(p) for p in np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)).tolist()]
    low, high = spec.digital.band_rad_s if spec.digital else (scale.omega_rad_s * 1e-3, scale.omega_rad_s * 1e3)
    points = []
    for k, constraint in enumerate(constraints):
        if constraint.where is EvaluatedAt.BAND and constraint.requirement != STABILITY_GUARD:
            omegas = np.geomspace(
                max(constraint.from_rad_s, min(low, constraint.to_rad_s / 100)), min(constraint.to_rad_s, high), _OMEGAS
            )
            points += [Point(k, plant, float(w)) for plant in plants for w in omegas]
    points += [Point(None, plant, float(w)) for plant in plants for w in np.geomspace(low, high, _OMEGAS)]
    margins = tuple(
        MarginPlant(k, plant, crossing=False)
        for k, constraint in enumerate(constraints)
        if constraint.where is EvaluatedAt.PHASE_CROSSOVERS
        for plant in plants
    )
    limits = tuple(constraint.limit for constraint in constraints)
    return Task(
        tuple(points), (), tuple(plants), margins, limits, Mode.OBJECTIVE, search.all_requirements, trust_radius=100.0
    )


def timed(run: Callable[[], object]) -> tuple[float, object]:
    """Median seconds of some runs, and the last answer."""
    seconds, answer = [], None
    for _ in range(_REPEATS):
        start = time.perf_counter()
        answer = run()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds), answer


def worst_violation(spec: DesignSpec, gains: FoPi) -> float:
    """The largest violation of any requirement, natural units; 0 when all hold."""
    return max(0.0, *(-r.slack for r in verify(spec, gains).requirements if r.slack is not None))


def main() -> None:
    """Measure and print."""
    path = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).parent.parent / "specs" / "brake_delay.yaml")
    spec = load_spec(path)
    search = Search.of(spec, ())
    start = search.starts[0]
    exchange: Exchange = search.exchange
    task = grid_task(search, spec)
    began = time.perf_counter()
    problem = compile_problem(
        spec.plant, search.scale, exchange.constraints, search.objective, exchange.horizon_s, _OMEGAS * _PLANTS
    )
    compile_s = time.perf_counter() - began
    grid_s, grid = timed(lambda: solve(problem, spec.controller, task, start, 1.0))
    limits, everything = search.limits(4e-7), search.all_requirements
    run_s, run = timed(lambda: exchange.run(start, search.first_cuts, Mode.OBJECTIVE, everything, frozenset(), limits))
    whole_s, candidate = timed(lambda: design(spec))
    rows = [
        ("full grid, solve only", grid_s, grid.gains, grid.status),  # type: ignore[attr-defined]
        ("exchange, one start", run_s, run.solved.gains, f"ok = {run.ok}, {run.rounds} rounds"),  # type: ignore[attr-defined]
        ("design, all starts, compiling", whole_s, candidate.gains, candidate.status.value),  # type: ignore[attr-defined]
    ]
    print(f"{spec.name}: {len(task.points)} grid points, compiled once in {compile_s:.2f} s; median of {_REPEATS} runs")
    for name, seconds, gains, note in rows:
        violation = worst_violation(spec, gains)
        print(f"{name:32} {seconds * 1e3:10.1f} ms   violation {violation:.1e}   {note}")
    print(f"ratio grid / exchange: {grid_s / run_s:.1f}   (with compiling: {(grid_s + compile_s) / whole_s:.1f})")
    assert math.isfinite(grid_s)


if __name__ == "__main__":
    main()
