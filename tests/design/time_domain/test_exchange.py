"""Exchanges with the worst plants of the family: what is known grows until no plant is worse."""

from __future__ import annotations

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, parsed
from oracles.scenario_gains import grid, measured, missed

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.exchange import MET, Counts, Exchanged, exchange, solve
from fopi_tune.design.time_domain.problem import ScenarioProblem

#: a lightly damped plant whose worst cases lie inside the box
INSIDE = """
schema: 1
name: inside
plant: {model: transfer_function, numerator: [1], denominator: [1, 0.5, {nominal: 1, min: 0.6, max: 1.6}]}
controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: {min: 0.5, max: 1.4}}
digital: {sample_time_s: 0.2, poles: 5}
scenarios: [{name: step, duration_s: 25, reference: [{at_s: 0, value: 1}]}]
requirements:
  - sensitivity_db: {at_most: 6}
  - overshoot: {at_most: 0.3}
  - peak_control: {at_most: 1.6}
objective: {minimize: iae}
"""


def answer(text: str, start: FoPi, counts: Counts) -> Exchanged:
    found = exchange(ScenarioProblem.of(parsed(text)), start, counts)
    assert found is not None
    return found


def test_limits_hold_for_plants_inside_the_box() -> None:
    spec, counts = parsed(INSIDE), Counts()
    found = answer(INSIDE, FoPi(0.1, 0.3, 1.0), counts)
    points = grid(spec, 2001)
    assert found.violation <= MET
    assert max(missed(spec, found.gains, points)) <= 1e-6
    values = measured(spec, found.gains, "step", "iae", points)
    assert found.objective == pytest.approx(values.max(), rel=1e-6)
    assert found.objective >= values.max() * (1.0 - 1e-9)
    # the objective is what the worst plant says
    assert found.worst[-1, "step"].value == found.objective
    assert counts.rounds >= 1
    assert counts.plants >= 3
    assert counts.simulated > 600


def test_more_violation_is_worse_than_any_objective() -> None:
    found = answer(INSIDE, FoPi(0.1, 0.3, 1.0), Counts())
    assert found.rank == (0.0, found.objective)


def test_known_gains_are_searched_from() -> None:
    known = DESIGNS["brake_delay"]
    assert known.gains is not None
    few, many = Counts(), Counts()
    problem = ScenarioProblem.of(known.spec)
    near = solve(problem, few, (FoPi(*known.gains),), thorough=False)
    far = solve(problem, many)
    assert near is not None
    assert far is not None
    assert near.objective == pytest.approx(known.iae, rel=1e-3)
    assert far.objective == pytest.approx(near.objective, rel=1e-5)
    assert few.steps < many.steps


def test_nothing_where_no_loop_is_stable() -> None:
    text = INSIDE.replace("kp: {min: 0, max: 9}", "kp: {min: 7, max: 9}").replace("ki: {min: 0", "ki: {min: 6")
    assert solve(ScenarioProblem.of(parsed(text)), Counts()) is None


def test_a_filter_that_is_exact_at_the_crossover_is_that_of_the_answer() -> None:
    text = INSIDE.replace("poles: 5", "poles: 5, prewarp: crossover").replace(
        "denominator: [1, 0.5", "denominator: [1, 2"
    )
    found = answer(text, FoPi(0.4, 0.3, 1.0), Counts())
    samples = found.cuts.problem.scaled.samples
    assert samples is not None
    from fopi_tune.digital.implementation import nominal_crossover

    own = nominal_crossover(parsed(text), found.gains)
    if own is None:
        assert samples.crossover_rad_s is None
    else:
        assert samples.crossover_rad_s == pytest.approx(own, rel=1e-4)
    assert np.isfinite(found.objective)
