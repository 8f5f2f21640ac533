"""Compiles a part of search and simulation before the tests, so that no process of them does:

    python compile_search.py PART

PART is `rays`, `worst_cases` or `time`; what two need is compiled twice, and takes less than all of it in each process
of the tests.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from cases.project import CONTINUOUS, ROOT
from cases.scenario_designs import DESIGNS

from fopi_tune.core.controller import FoPi
from fopi_tune.design.bracket import bracket_of
from fopi_tune.design.global_search.basins import scan_box
from fopi_tune.design.global_search.compiled import work_for
from fopi_tune.design.global_search.controllers import CORNERS, FIRST_RISE, filter_at, integral_at_real
from fopi_tune.design.global_search.intervals import allowed_intervals
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.worst_case import highest_crossover
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.model import Modeller
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.worst_plants import Family
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.proof import verify
from fopi_tune.spec import load_spec

#: with two equalities, and without any
SPECS = "brake", "second_order"


def rays(problem: Problem) -> None:
    """What looks for basins."""
    for coarse in (1.0, 20.0):
        scan_box(problem, 1, coarse)
    table = problem.scan_table
    allowed_intervals(1.0, 0.8, 0.6, -8.0, 5.0, table, problem.rows(table, tightening=0.0), work_for(table))


def worst_cases(problem: Problem) -> None:
    """What polishes them, and the bound."""
    polish, x = Polish(problem), np.array([0.5, 0.4, 0.9])
    polish.look(x)
    highest_crossover(x, polish.table, polish.work)
    integrator = np.ones(CORNERS)
    integrator[FIRST_RISE] = CORNERS
    filter_at(integrator, 1.0)
    integral_at_real(integrator, 0.0)
    bracket_of(polish, 1.0, x, budget=1)


def on_samples() -> None:
    """What the bound needs of filters and of crossings on samples, and what checks gains."""
    spec = load_spec(ROOT / "specs" / "brake.yaml")
    verify(spec, FoPi(0.4, 0.4, 0.8))
    problem = Problem.of(spec)
    bracket_of(Polish(problem), 1.0, np.array([0.5, 0.4, 0.9]), budget=50)


def simulated() -> None:
    """The loop in time, and what checks gains of the continuous loop."""
    simulate(load_spec(ROOT / "specs" / "brake.yaml"), FoPi(0.4, 0.4, 0.8))
    verify(load_spec(CONTINUOUS / "brake.yaml"), FoPi(0.4, 0.4, 0.8))


def scenarios(problem: ScenarioProblem) -> None:
    """What designs for scenarios need besides: simulations with and without derivatives, and the loop's cuts."""
    gains = FoPi(0.2, 0.1, 0.9)
    cuts = LoopCuts(problem.loop)
    found = cuts.look(gains)
    assert found is not None
    cuts.learn(found)
    cuts.slacks(gains)
    Modeller(problem, cuts, problem.corners).trajectories_of(gains)
    Family(problem).worst(gains, refine=False)


def in_frequency(part: Callable[[Problem], None]) -> None:
    """A part of the search, with two equalities and without any."""
    for name in SPECS:
        part(Problem.of(load_spec(CONTINUOUS / f"{name}.yaml")))


def main() -> None:
    """Compile; Numba keeps the code beside the package."""
    match sys.argv[1]:
        case "rays":
            in_frequency(rays)
        case "worst_cases":
            in_frequency(worst_cases)
            on_samples()
        case "time":
            simulated()
            scenarios(ScenarioProblem.of(DESIGNS["throttle"].spec))
        case other:
            sys.exit(f"no part is called {other}")


if __name__ == "__main__":
    main()
