"""Designs for scenarios: the optimum that another solver found, no gains nearby better, limits held by all plants."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, brake, parsed
from oracles.scenario_gains import best_of, drawn, grid, measured, missed, near, objective

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.search import design_for_scenarios
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.errors import DomainError
from fopi_tune.proof import Verification, verify
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

#: relative, of an objective
OPTIMAL = 1e-3
#: of limits, in the measure's unit
MET = 1e-6
#: one uncertain number: quick
TEXT = """
schema: 1
name: small
plant: {{model: lag, static_gain: 1.0, time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}, dead_time_s: 0.3}}
controller: {{kp: {kp}, ki: {ki}, alpha: {alpha}}}
digital: {{sample_time_s: 0.2, poles: 5{digital}}}
scenarios:
  - {{name: step, duration_s: 20, reference: [{{at_s: 0, value: 1}}]}}
  - {{name: load, duration_s: 20, reference: [{{at_s: 0, value: 0}}], load: [{{at_s: 0, value: 1}}]}}
requirements:
{requirements}
{objective}
"""
PEAK = "sensitivity_db: {at_most: 3.5}"
CALM = "{overshoot: {at_most: 0.05}, scenario: step}"
LOAD = "objective: {minimize: iae, scenario: load}"


def small(
    *requirements: str, objective: str = LOAD, kp: str = "{min: 0, max: 9}", ki: str = "{min: 0, max: 9}",
    alpha: str = "{min: 0.5, max: 1.4}", digital: str = "",
) -> DesignSpec:  # fmt: skip
    """A small problem of an uncertain lag with a dead time."""
    listed = "\n".join(f"  - {each}" for each in requirements)
    return parsed(
        TEXT.format(requirements=listed, objective=objective, kp=kp, ki=ki, alpha=alpha, digital=digital)
    )  # fmt: skip


def solved(spec: DesignSpec) -> tuple[FoPi, Verification, Candidate]:
    """The gains of a design, verified."""
    return solved_text(spec.source.decode())


@lru_cache
def solved_text(text: str) -> tuple[FoPi, Verification, Candidate]:
    """The same, once for each text."""
    spec = parsed(text)
    found = design_for_scenarios(spec)
    assert found.status is Status.SOLVED, found.message
    assert found.gains is not None
    checked = verify(spec, found.gains, implementation=designed_implementation(spec, found.gains))
    assert checked.all_met, [(each.requirement, each.achieved) for each in checked.measures if not each.is_met]
    box, gains = spec.controller, found.gains
    assert box.kp.min <= gains.kp <= box.kp.max
    assert box.ki.min <= gains.ki <= box.ki.max
    assert box.alpha.min <= gains.alpha <= box.alpha.max
    return gains, checked, found


def assert_optimal(spec: DesignSpec, gains: FoPi, per_axis: int = 5, count: int = 25) -> float:
    """No gains nearby are better by more than a thousandth; returns the objective."""
    points = grid(spec, per_axis)
    here = objective(spec, gains, points)
    room = OPTIMAL * max(abs(here), 1e-3)
    best, other = best_of(spec, near(spec, gains, count, seed=4), points, here - room)
    assert other is None, f"{other} has {best}, {gains} has {here}"
    return here


SHORT = {"brake_step", "brake_delay"}


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", [pytest.param(k, marks=pytest.mark.long if k not in SHORT else ()) for k in DESIGNS])
def test_a_problem_is_solved_to_a_thousandth(name: str) -> None:
    spec, known = DESIGNS[name].spec, DESIGNS[name]
    gains, checked, _ = solved(spec)
    assert checked.objective == pytest.approx(known.iae, rel=OPTIMAL)
    if known.gains is not None:
        np.testing.assert_allclose([gains.kp, gains.ki, gains.alpha], known.gains, rtol=3e-3)
    points = drawn(spec, 2000, seed=19)
    assert max(missed(spec, gains, points), default=0.0) <= MET
    # the objective over drawn plants is below that of the worst plant, and not far
    assert objective(spec, gains, points) == pytest.approx(known.iae, rel=0.02)
    assert checked.objective is not None
    assert objective(spec, gains, points) <= checked.objective * (1.0 + 1e-9)


OBJECTIVES = {
    "ise": ("{minimize: ise, scenario: load}", (PEAK,)),
    "peak rate": (
        "{minimize: peak_rate_per_s, scenario: step}",
        (PEAK, "{settling_time_s: {at_most: 12}, scenario: step}"),
    ),
    "peak jerk": (
        "{minimize: peak_jerk_per_s2, scenario: step}",
        (PEAK, "{settling_time_s: {at_most: 12}, scenario: step}"),
    ),
    "overshoot": ("{minimize: overshoot, scenario: step}", (PEAK, "{iae: {at_most: 2.0}, scenario: load}")),
    "peak control": ("{minimize: peak_control, scenario: step}", (PEAK, "{iae: {at_most: 2.0}, scenario: load}")),
    "rise time": ("{minimize: rise_time_s, scenario: step}", (PEAK, CALM)),
    "final error": ("{minimize: final_error, scenario: step}", (PEAK, CALM)),
    "undershoot": ("{minimize: undershoot, scenario: step}", (PEAK, "{iae: {at_most: 2.0}, scenario: load}")),
    "settling time": ("{minimize: settling_time_s, scenario: step}", (PEAK,)),
}
LONG = {"undershoot", "overshoot", "peak control", "settling time", "peak rate", "peak jerk", "ise"}


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", [pytest.param(k, marks=pytest.mark.long if k in LONG else ()) for k in OBJECTIVES])
def test_every_measure_can_be_minimised(name: str) -> None:
    aim, requirements = OBJECTIVES[name]
    spec = small(*requirements, objective=f"objective: {aim}")
    gains, checked, _ = solved(spec)
    value = assert_optimal(spec, gains)
    assert checked.objective is not None
    assert checked.objective >= value - 1e-9
    assert max(missed(spec, gains, drawn(spec, 300, seed=3)), default=0.0) <= MET


VARIANTS = {
    "kp fixed": small(PEAK, CALM, kp="0.9"),
    "ki fixed": small(PEAK, CALM, ki="0.4"),
    "order fixed": small(PEAK, CALM, alpha="0.8"),
    "a PI": small(PEAK, CALM, alpha="1.0"),
    "matched": small(PEAK, CALM, digital=", rule: matched"),
    "exact at the crossover": small(PEAK, CALM, digital=", prewarp: crossover"),
    "a computing delay": small(PEAK, CALM, digital=", delay_samples: 0.5"),
    "maximize ki": small(PEAK, CALM, objective="objective: {maximize: ki}"),
    "every scenario": small(PEAK, "peak_control: {at_most: 1.2}"),
    "at least": small(PEAK, "{rise_time_s: {at_least: 3}, scenario: step}"),
    "the least IAE": small(PEAK, "{iae: {at_least: 2.5}, scenario: load}"),
    "an IAE's limit": small(
        PEAK, "{iae: {at_most: 2.0}, scenario: load}", objective="objective: {minimize: ise, scenario: step}"
    ),
    "limited": small(PEAK, CALM, digital=", output_limits: [-1.1, 1.1]"),
    "no requirement of the loop": small(CALM),
    "no requirement": small("sensitivity_db: {at_most: 20}", objective="objective: {minimize: iae, scenario: step}"),
}
SHORT_VARIANTS = {"order fixed", "exact at the crossover", "maximize ki", "limited"}


@pytest.mark.thinned(slow=["limited", "exact"])
@pytest.mark.parametrize(
    "name", [pytest.param(k, marks=pytest.mark.long if k not in SHORT_VARIANTS else ()) for k in VARIANTS]
)
def test_a_variant_is_solved_and_no_gains_nearby_are_better(name: str) -> None:
    spec = VARIANTS[name]
    gains, _, _ = solved(spec)
    assert_optimal(spec, gains)
    assert max(missed(spec, gains, drawn(spec, 300, seed=3)), default=0.0) <= MET


@pytest.mark.parametrize(
    "requirements",
    [
        (PEAK, "{settling_time_s: {at_most: 9}, scenario: step}"),
        pytest.param(("{settling_time_s: {at_most: 9}, scenario: step}",), marks=pytest.mark.long),
        pytest.param((CALM,), marks=pytest.mark.long),
    ],
)
def test_without_an_objective_the_slack_is_the_largest(requirements: tuple[str, ...]) -> None:
    spec = small(*requirements, objective="")
    gains, _, _ = solved(spec)
    assert max(missed(spec, gains, drawn(spec, 300, seed=3))) <= 0.0


def test_fixed_gains_are_taken_as_they_are() -> None:
    spec = small(CALM, kp="1.0", ki="0.5", alpha="0.9")
    found = design_for_scenarios(spec)
    assert (found.status, found.gains) == (Status.SOLVED, FoPi(1.0, 0.5, 0.9))
    off = design_for_scenarios(small(CALM, kp="0", ki="0", alpha="0.9"))
    assert (off.status, off.gains) == (Status.INFEASIBLE, None)


PRICED = {
    "brake_ramp_4.5": (DESIGNS["brake_ramp_4.5"].text, "sensitivity_db: {at_most: 2.0}", 2.0, "loop", 0),
    "acceleration": (DESIGNS["brake_step"].text, "acceleration_m_s2: {at_most: 2.0}", 2.0, "scenarios", 0),
    "overshoot": (DESIGNS["lgd"].text, "overshoot: {at_most: 0.1}", 0.1, "scenarios", 0),
    "low band": (DESIGNS["brake_delay"].text, "sensitivity_db: {at_most: 2.5}", 2.5, "loop", 1),
    "iae": (
        small(
            PEAK, "{iae: {at_most: 2.0}, scenario: load}",
            objective="objective: {minimize: peak_control, scenario: step}",
        ).source.decode(), "iae: {at_most: 2.0}", 2.0, "scenarios", 0,
    ),
    "at least": (VARIANTS["at least"].source.decode(), "rise_time_s: {at_least: 3}", 3.0, "scenarios", 0),
}  # fmt: skip
LONG_PRICES = {"overshoot", "brake_ramp_4.5", "iae", "at least", "low band"}


@pytest.mark.parametrize("name", [pytest.param(k, marks=pytest.mark.long if k in LONG_PRICES else ()) for k in PRICED])
def test_a_multiplier_is_what_a_moved_limit_changes(name: str) -> None:
    text, words, limit, kind, index = PRICED[name]
    _, _, found = solved(parsed(text))
    price = (found.multipliers if kind == "loop" else found.scenario_multipliers)[index]
    assert price is not None
    assert price > 0.0
    values = []
    for share in (-1e-3, 1e-3):
        head, _, old = words.rpartition(" ")
        assert float(old.strip("}")) == limit
        moved = f"{head} {limit * (1.0 + share):.12g}}}"
        values.append(solved(parsed(text.replace(words, moved, 1)))[1].objective)
    assert None not in values
    change = (values[1] - values[0]) / (2e-3 * limit)
    # positive where relaxing gains: upwards of an upper limit
    side = -1.0 if "at_most" in words else 1.0
    assert price == pytest.approx(side * change, rel=0.01)


def test_a_limit_that_does_not_bind_costs_nothing() -> None:
    _, _, found = solved(DESIGNS["brake_step"].spec)
    assert found.multipliers == (0.0, 0.0)
    (price,) = found.scenario_multipliers
    assert price is not None
    assert price > 1.0


def test_a_limit_that_no_gain_moves_costs_nothing() -> None:
    """There is no undershoot below 0."""
    spec = small(PEAK, "{undershoot: {at_most: 0}, scenario: step}", "{overshoot: {at_most: 0}, scenario: step}")
    gains, _, found = solved(spec)
    undershoot, overshoot = found.scenario_multipliers
    assert undershoot == 0.0
    assert overshoot is not None
    assert overshoot > 0.0
    assert max(missed(spec, gains, drawn(spec, 300, seed=3))) <= MET


def test_a_settling_time_has_no_multiplier() -> None:
    _, _, found = solved(small(CALM, "{settling_time_s: {at_most: 12}, scenario: step}"))
    assert found.scenario_multipliers[0] is not None
    assert found.scenario_multipliers[1] is None


def test_the_same_gains_whatever_was_solved_before_and_whatever_its_name() -> None:
    _, _, before = solved(DESIGNS["brake_step"].spec)
    design_for_scenarios(VARIANTS["ki fixed"])
    assert repr(design_for_scenarios(parsed(brake("another_name", "step")))) == repr(before)


def test_a_fitted_filter_is_refused_with_what_to_write() -> None:
    with pytest.raises(DomainError, match="write method: modified_oustaloup or oustaloup"):
        design_for_scenarios(small(PEAK, CALM, alpha="0.8", digital=", method: fit"))
    fixed = design_for_scenarios(small(PEAK, CALM, kp="1", ki="0.5", alpha="0.8", digital=", method: fit"))
    assert fixed.gains == FoPi(1.0, 0.5, 0.8)


@pytest.mark.long
def test_a_start_that_is_close_changes_no_optimum() -> None:
    known = DESIGNS["brake_step"]
    start = FoPi(0.04, 0.03, 0.9)
    found = design_for_scenarios(known.spec, start=start)
    assert found.gains is not None
    assert objective(known.spec, found.gains, grid(known.spec, 200)) == pytest.approx(known.iae, rel=OPTIMAL)


@pytest.mark.long
def test_worst_plants_inside_the_box_count() -> None:
    """Between the vertices the rate of a ramp is above that of both."""
    spec = DESIGNS["throttle_sat"].spec
    gains, checked, _ = solved(spec)
    assert spec.objective is not None
    assert spec.objective.scenario is not None
    values = measured(spec, gains, spec.objective.scenario, "iae", grid(spec, 400))
    assert checked.objective == pytest.approx(values.max(), rel=1e-4)
    assert checked.objective >= values.max() - 1e-9


@pytest.mark.long
@pytest.mark.parametrize("name", ["brake_ramp_4.5", "throttle_sat"])
def test_no_gains_of_a_grid_are_better(name: str) -> None:
    known, spec = DESIGNS[name], DESIGNS[name].spec
    box, points = spec.controller, grid(spec, 3)
    most = [box.kp.max, box.ki.max]
    far = [
        FoPi(float(kp), float(ki), float(alpha))
        for kp in np.geomspace(2e-3, most[0], 26)
        for ki in np.geomspace(2e-3, most[1], 26)
        for alpha in np.linspace(box.alpha.min, box.alpha.max, 25)
    ]
    gains, _, _ = solved(spec)
    fine = np.linspace(-1.0, 1.0, 17)
    close = [
        FoPi(gains.kp * (1.0 + 0.08 * a), gains.ki * (1.0 + 0.08 * b), float(np.clip(gains.alpha + 0.03 * c, 0.3, 1.5)))
        for a in fine
        for b in fine
        for c in fine
    ]
    best, other = best_of(spec, [*far, *close], points, known.iae * (1.0 - OPTIMAL))
    assert other is None, f"{other} has {best}"
