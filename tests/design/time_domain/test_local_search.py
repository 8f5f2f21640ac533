"""A search from a start: the optimum of the plants that are known, limits met, starts that are none."""

from __future__ import annotations

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS
from oracles.scenario_gains import best_of, is_met, near, objective

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.local_search import local_search, merit_of, scale_of
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.model import Modeller
from fopi_tune.design.time_domain.problem import ScenarioProblem

STARTS = {"slow": FoPi(0.01, 0.01, 0.8), "fast": FoPi(0.3, 0.1, 1.0), "high order": FoPi(0.05, 0.02, 1.2)}


def modeller(name: str) -> Modeller:
    problem = ScenarioProblem.of(DESIGNS[name].spec)
    return Modeller(problem, LoopCuts(problem.loop), problem.corners)


@pytest.mark.parametrize("start", STARTS)
def test_every_start_ends_at_the_optimum(start: str) -> None:
    known, made = DESIGNS["brake_step"], modeller("brake_step")
    found = local_search(made, STARTS[start], 60)
    assert found is not None
    assert found.model.violation <= 1e-7
    # the worst plant of this problem is a vertex
    assert found.model.objective == pytest.approx(known.iae, rel=1e-3)
    assert known.gains is not None
    np.testing.assert_allclose(made.problem.numbers.of(found.gains), known.gains, rtol=5e-3)
    assert found.step is not None
    assert 1 <= found.steps <= 60


def test_no_gains_nearby_are_better_for_the_plants_that_are_known() -> None:
    spec, made = DESIGNS["brake_delay"].spec, modeller("brake_delay")
    found = local_search(made, FoPi(0.8, 0.3, 0.9), 60)
    assert found is not None
    assert is_met(spec, found.gains, made.points)
    here = objective(spec, found.gains, made.points)
    _, better = best_of(spec, near(spec, found.gains, 12, seed=2), made.points, here * (1.0 - 1e-4))
    assert better is None


def test_a_budget_is_kept() -> None:
    found = local_search(modeller("brake_step"), STARTS["slow"], 3)
    assert found is not None
    assert found.steps <= 3


def test_gains_with_an_unstable_loop_are_no_start() -> None:
    assert local_search(modeller("brake_delay"), FoPi(9.0, 9.0, 1.4), 10) is None


def test_a_merit_counts_objective_and_violation() -> None:
    made = modeller("brake_step")
    model = made.at(FoPi(0.3, 0.1, 1.0))
    assert model is not None
    assert model.violation > 0.0
    assert merit_of(model, 2.0, 10.0) == pytest.approx(model.objective / 2.0 + 10.0 * model.violation)
    assert scale_of(-3.0, 1e-6) == 3.0
    assert scale_of(-np.inf, 1e-6) == 1.0
    assert scale_of(0.0, 1e-6) == 1e-6
