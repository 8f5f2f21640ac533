"""The sequence of search, check and draws of a spec with requirements on scenarios."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, parsed
from oracles.scenario_gains import drawn, measured

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.montecarlo import CHECKED_PLANTS, scenario_fractions
from fopi_tune.pipeline import tune as tune_module
from fopi_tune.pipeline.assemble import new_violations
from fopi_tune.proof import verify
from fopi_tune.results.candidate import Candidate, CheckedCandidate, Solver, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

BRAKE = DESIGNS["brake_step"]
#: a plant without an uncertain number
CERTAIN = """
schema: 1
name: certain
plant: {model: lag, static_gain: 1, time_constant_s: 2, dead_time_s: 0.3}
controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: {min: 0.5, max: 1.4}}
digital: {sample_time_s: 0.2, poles: 5}
scenarios: [{name: step, duration_s: 20, reference: [{at_s: 0, value: 1}]}]
requirements: [sensitivity_db: {at_most: 3.5}, overshoot: {at_most: 0.02}]
objective: {minimize: iae}
"""


def checked(spec: DesignSpec, gains: FoPi) -> CheckedCandidate:
    candidate = Candidate(Status.SOLVED, gains, (None, None), scenario_multipliers=(None,))
    return CheckedCandidate(candidate, verify(spec, gains, implementation=designed_implementation(spec, gains)))


def test_a_certain_plant_is_designed_for() -> None:
    design = ft.tune(parsed(CERTAIN), proof=False)
    assert design.status is Status.SOLVED, design.message
    assert design.gains is not None
    (report,) = design.measures
    assert report.result is not None
    assert report.result.plants == 1
    assert report.result.achieved <= 0.02 + 1e-6
    # of one plant all draws are the same
    assert report.drawn is not None
    assert report.drawn.met == report.drawn.total


def test_a_refuted_limit_is_a_plant_for_the_next_design() -> None:
    spec = BRAKE.spec
    new = new_violations(checked(spec, FoPi(0.07, 0.05, 0.975)), ())
    (found,) = [each for each in new if each.scenario is not None]
    assert (found.requirement, found.scenario) == (0, "step")
    assert math.isnan(found.omega_rad_s)
    assert found.theta == (1.6,)
    assert {tuple(point) for point in ScenarioProblem.of(spec, [replace(found, theta=(1.9,))]).corners} >= {(1.9,)}
    # what is known already is no news
    assert not any(each.scenario is not None for each in new_violations(checked(spec, FoPi(0.07, 0.05, 0.975)), new))


def test_a_design_that_the_check_refutes_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    spec, asked = BRAKE.spec, []
    right = FoPi(0.0315, 0.0355, 0.9752)

    def search(searched: DesignSpec, violations: tuple[Violation, ...], *_: object) -> Candidate:
        asked.append(violations)
        gains = FoPi(0.07, 0.05, 0.975) if len(asked) == 1 else right
        return Candidate(Status.SOLVED, gains, (None, None), scenario_multipliers=(None,))

    monkeypatch.setattr(tune_module, "_scenario_candidate", search)
    design = ft.tune(spec, proof=False)
    assert (design.status, design.gains) == (Status.SOLVED, right)
    assert [len(each) > 0 for each in asked] == [False, True]


def test_gains_that_stay_refuted_are_not_called_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Candidate(Status.SOLVED, FoPi(0.07, 0.05, 0.975), (None, None), scenario_multipliers=(None,))
    monkeypatch.setattr(tune_module, "_scenario_candidate", lambda *_: wrong)
    design = ft.tune(BRAKE.spec, proof=False)
    assert design.status is not Status.SOLVED
    assert "acceleration_m_s2 is 3." in design.message
    assert "(at_most 2) in scenario step with time_constant_s = 1.6" in design.message
    assert [report.verdict for report in design.measures] == ["violated"]


def test_fixed_gains_that_miss_say_by_how_much() -> None:
    text = BRAKE.text.replace(
        "kp: {min: 0, max: 5}, ki: {min: 0, max: 5}, alpha: {min: 0.3, max: 1.5}", "kp: 0.07, ki: 0.05, alpha: 0.975"
    )
    spec = parsed(text)
    design = ft.tune(spec, proof=False)
    assert design.status is Status.INFEASIBLE
    worst = measured(spec, FoPi(0.07, 0.05, 0.975), "step", "acceleration_m_s2", np.array([[1.6]]))[0]
    (missed,) = design.clash
    assert (missed.requirement, missed.new_limit) == (2, pytest.approx(worst, rel=1e-4))
    assert missed.amount == pytest.approx(worst - 2.0, rel=1e-3)
    assert "they do not meet it" in design.message


@pytest.mark.long
def test_a_relaxation_that_is_told_can_be_met() -> None:
    text = BRAKE.text.replace("objective: {minimize: iae, scenario: step}", "  - {iae: {at_most: 110}, scenario: step}")
    spec = parsed(text)
    design = ft.tune(spec, proof=False)
    assert design.status is Status.INFEASIBLE
    assert {each.requirement for each in design.clash} == {2, 3}
    for each in design.clash:
        assert each.new_limit is not None
        place = each.requirement - len(spec.requirements)
        moved = list(spec.scenario_requirements)
        moved[place] = replace(moved[place], limit=each.new_limit)
        assert ft.tune(replace(spec, scenario_requirements=tuple(moved)), proof=False).status is Status.SOLVED
        # in few digits
        assert len(f"{each.new_limit:.12g}") <= 8


def test_the_convex_search_is_refused() -> None:
    with pytest.raises(DomainError, match="leave `solver='convex'` out"):
        ft.tune(BRAKE.spec, solver=Solver.CONVEX)


@pytest.mark.parametrize(("gains", "met"), [(FoPi(0.0315, 0.0355, 0.9752), True), (FoPi(0.034, 0.038, 0.975), False)])
def test_drawn_plants_are_counted(gains: FoPi, met: bool) -> None:
    spec = BRAKE.spec
    implementation = designed_implementation(spec, gains)
    assert implementation is not None
    (fraction,) = scenario_fractions(spec, implementation)
    assert fraction.total == CHECKED_PLANTS
    assert (fraction.met == fraction.total) is met
    assert fraction.low <= fraction.met / fraction.total <= fraction.high
    # another draw has the same share, to a few standard deviations
    share = float((measured(spec, gains, "step", "acceleration_m_s2", drawn(spec, 4000, seed=77)) <= 2.0).mean())
    assert fraction.met / fraction.total == pytest.approx(share, abs=0.035)
    assert scenario_fractions(spec, implementation) == (fraction,)


def test_of_all_scenarios_the_one_with_the_fewest_counts() -> None:
    spec = parsed(BRAKE.text.replace("at_most: 2.0}, scenario: step}", "at_most: 2.0}}"))
    gains = FoPi(0.034, 0.038, 0.975)
    implementation = designed_implementation(spec, gains)
    assert implementation is not None
    one = replace(spec, scenario_requirements=tuple(replace(e, scenario="step") for e in spec.scenario_requirements))
    assert scenario_fractions(spec, implementation) == scenario_fractions(one, implementation)
