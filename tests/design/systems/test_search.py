"""Gains of two loops that take turns: the requirements hold, nothing scattered is better, and what no gains can do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.project import ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.design.systems import design_system
from fopi_tune.design.systems.problem import NO_LOOP, Question, SystemProblem
from fopi_tune.design.systems.search import reasons_by_formula
from fopi_tune.pipeline.systems import simulate_system
from fopi_tune.spec import load_system
from fopi_tune.spec.model import Knot, Limit, Objective, Relation, Sense, SystemSpec


def car() -> SystemSpec:
    """One short drive of the shipped car."""
    whole = load_system(ROOT / "systems" / "car_comfort.yaml")
    drive = replace(whole.scenarios[0], duration_s=45.0, reference=whole.scenarios[0].reference[:2])
    assert whole.objective is not None
    objective = replace(whole.objective, scenario=drive.name)
    return replace(whole, scenarios=(drive,), tuned=("throttle",), objective=objective)


def test_the_best_gains_of_one_mode_beside_fixed_ones_of_the_other() -> None:
    system = car()
    brake = design_system(replace(system, tuned=("brake",)), {"throttle": FoPi(0.09, 0.025, 0.8)}).gains
    assert brake is not None
    found = design_system(system, {"brake": brake["brake"]})
    assert found.is_met
    assert found.gains is not None
    assert found.judged is not None
    assert found.gains["brake"] == brake["brake"]
    problem = SystemProblem(system, {"brake": brake["brake"]})
    rng = np.random.default_rng(5)
    scattered = [problem.judge(problem.gains(x), problem.corners) for x in rng.random((150, 3))]
    met = [each.objective for each in scattered if each is not None and each.holds_without()]
    assert met
    assert min(met) >= found.judged.objective * (1.0 - 1e-3)
    # the same again
    assert design_system(system, {"brake": brake["brake"]}) == found


def test_no_loop_costs_as_much_as_can_be() -> None:
    assert Question().merit(None) == NO_LOOP


def test_the_designs_simulation_keeps_a_minimum_dwell() -> None:
    gains = {"throttle": FoPi(0.09, 0.025, 0.8), "brake": FoPi(0.5, 0.5, 0.9)}
    drive = replace(car().scenarios[0], reference=(Knot(0.0, 15.0), Knot(30.0, 6.0)))
    found = []
    for seconds in (0.0, 8.0):
        system = replace(car(), scenarios=(drive,), inactive="held", min_dwell_s=seconds)
        judged = SystemProblem(system, gains).judge(gains, system.family.nominal_point[None, :])
        assert judged is not None
        driven = simulate_system(system, gains).driven[0]
        # sums of 300 samples in another order
        assert judged.objective == pytest.approx(driven.measures["iae"], rel=1e-12)
        found.append(judged.objective)
    assert found[0] < found[1]


@pytest.mark.parametrize("name", ["train", "tank_level", "motor_with_chopper", "reflow_oven"])
def test_the_designs_simulation_is_that_of_every_word_of_a_mode(name: str) -> None:
    system = load_system(ROOT / "systems" / "examples" / f"{name}.yaml")
    (scenario,) = system.scenarios
    aim = Objective(Sense.MINIMIZE, "iae", scenario=scenario.name)
    system = replace(system, objective=aim, tuned=(system.modes[1].name,))
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    judged = SystemProblem(system, gains).judge(gains, system.family.nominal_point[None, :])
    assert judged is not None
    # sums of the samples in another order
    assert judged.objective == pytest.approx(simulate_system(system, gains).driven[0].measures["iae"], rel=1e-11)


def test_a_mode_that_begins_too_fast_is_told_by_a_formula() -> None:
    system = car()
    start = replace(
        system.scenarios[0], initial_output=30.0, before="free", reference=(Knot(0.0, 10.0),)
    )  # fmt: skip
    (reason,) = reasons_by_formula(replace(system, scenarios=(start,)))
    # y/tau at 30 km/h and 1.6 s
    assert f"slows by {30.0 / 1.6 / 3.6:.3g}" in reason
    slow = replace(start, reference=(Knot(0.0, 10.0, ramp_s=20.0),))
    assert list(reasons_by_formula(replace(system, scenarios=(slow,)))) == []
    assert list(reasons_by_formula(system)) == []


@pytest.mark.long
def test_requirements_that_clash_are_named_with_the_limits_that_would_do() -> None:
    system, brake = car(), {"brake": FoPi(0.07, 0.11, 0.45)}
    name = system.scenarios[0].name
    overshoot = Limit("overshoot", Relation.AT_MOST, 0.4, name)
    system = replace(system, requirements=(Limit("peak_control", Relation.AT_MOST, 1.0, name), overshoot))
    best = design_system(system, brake)
    assert best.is_met
    assert best.clash == ()
    assert best.judged is not None
    # nine tenths of the least integral that there is: the control's limit has no part in it
    least = best.judged.objective
    asked = (*system.requirements, Limit("iae", Relation.AT_MOST, 0.9 * least, name))
    found = design_system(replace(system, requirements=asked), brake)
    assert not found.is_met
    relaxed = {relaxation.requirement: relaxation.new_limit for relaxation in found.clash}
    assert 2 in relaxed
    assert 0 not in relaxed
    for index, limit in relaxed.items():
        assert limit is not None
        changed = tuple(replace(each, limit=limit) if i == index else each for i, each in enumerate(asked))
        assert design_system(replace(system, requirements=changed), brake).is_met
    assert relaxed[2] == pytest.approx(least, rel=0.01)
