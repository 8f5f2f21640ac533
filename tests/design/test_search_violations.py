"""What a check refutes comes back as a cut of the search, and limits at the ends of the frequency axis bind."""

from __future__ import annotations

import math

import pytest

import fopi_tune as ft
from fopi_tune.design import design
from fopi_tune.design.search import Search
from fopi_tune.results.candidate import Violation
from fopi_tune.results.status import Status
from fopi_tune.spec import load_spec, parse_spec

DELAY = "specs/brake_delay.yaml"


def test_a_violation_found_by_the_check_enters_the_next_design() -> None:
    spec = load_spec(DELAY)
    violation = Violation(2, (1.6,), 4.2)
    search = Search.of(spec, (violation,))
    assert any(point.constraint == 2 and point.omega_rad_s == 4.2 for point in search.first_cuts.points)
    assert design(spec, (violation,)).status is Status.SOLVED


def test_a_violation_at_an_end_of_the_axis_is_a_limit_of_the_next_design() -> None:
    spec = parse_spec(_LIMITED)
    violations = (Violation(0, (1.0,), math.inf), Violation(1, (2.0,), 0.0))
    points = Search.of(spec, violations).first_cuts.points
    assert any(p.constraint == 0 and p.theta == (1.0,) and p.omega_rad_s == math.inf for p in points)
    # a band that begins above 0 has no limit there
    assert not any(p.constraint == 1 and p.omega_rad_s == 0.0 for p in points)


def test_the_oracle_looks_where_a_check_found_a_violation() -> None:
    search = Search.of(parse_spec(_LIMITED), (Violation(0, (1.2345,), 7.654),))
    assert any(tuple(point) == (1.2345,) for point in search.exchange.oracle.box.points)
    assert 7.654 in search.exchange.oracle.omega_grid


def test_violations_of_margins_and_of_stability_bring_their_plants_into_play() -> None:
    spec = parse_spec(
        "schema: 1\nname: x\nplant: {model: lag, static_gain: {min: 1, max: 2}, time_constant_s: 1, dead_time_s: 0.2}\n"
        "requirements: [{phase_margin_deg: {at_least: 50}}, {gain_margin_db: {at_least: 6}}]\n"
    )
    margins = Search.of(spec, (Violation(0, (1.3,), 2.0), Violation(1, (1.4,), 5.0))).first_cuts
    assert (1.3,) in margins.plants
    assert [(p.theta, p.crossing) for p in margins.margin_plants] == [((1.4,), False)]
    # a gain margin that is refuted again: its phase crossover itself is in play too
    again = Search.of(spec, (Violation(1, (1.4,), 5.0), Violation(1, (1.4,), 5.1))).first_cuts
    assert [(p.theta, p.crossing) for p in again.margin_plants] == [((1.4,), False), ((1.4,), True)]
    unstable = Search.of(spec, (Violation(None, (1.7,), math.nan),)).first_cuts
    assert (1.7,) in unstable.plants


_LIMITED = """
schema: 1
name: limited
plant: {model: lag, static_gain: {min: 1, max: 2}, time_constant_s: 1}
controller: {kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.7, max: 1.4}}
requirements:
  - {control_sensitivity_db: {at_most: 8}}
  - {complementary_sensitivity_db: {at_most: 1}, from_rad_s: 0.5}
objective: {maximize: ki}
"""


_DIRECT = "{model: transfer_function, numerator: [0.5, 2], denominator: [1, 1]}"
_LATE = "{model: transfer_function, numerator: [0.8, 1], denominator: [1, 1], dead_time_s: {min: 1, max: 2}}"
_SLOW = "{model: lag, static_gain: {min: 1, max: 2}, time_constant_s: 3}"


@pytest.mark.parametrize(
    ("plant", "ki", "requirement", "kp"),
    [
        # |C S| -> kp/(1 + kp p), with p = 0.5 as omega -> inf, below 1: kp = 2
        (_DIRECT, 1, "control_sensitivity_db: {at_most: 0}", 2.0),
        # |T| -> kp K/(1 + kp K) as omega -> 0, below 0.8: kp K = 4 of the largest gain, 2
        (_SLOW, 0, f"complementary_sensitivity_db: {{at_most: {20.0 * math.log10(0.8)}}}", 2.0),
        # |L| -> kp K as omega -> 0, below 10
        (_SLOW, 0, "loop_gain_db: {at_most: 20}", 5.0),
        # |S| comes up to 1/(1 - kp p) behind a dead time, with p = 0.8, below 2
        (_LATE, 0.01, f"sensitivity_db: {{at_most: {20.0 * math.log10(2.0)}}}", None),
    ],
)
def test_limits_at_the_ends_of_the_axis_bind(plant: str, ki: float, requirement: str, kp: float | None) -> None:
    box = f"controller: {{kp: {{min: 0, max: 9}}, ki: {ki}, alpha: 1}}\n"
    text = f"schema: 1\nname: x\nplant: {plant}\n{box}requirements: [{{{requirement}}}]\n"
    tuned = ft.tune(parse_spec(text + "objective: {minimize: iae_disturbance}\n"), proof=False)
    assert tuned.status is Status.SOLVED
    assert tuned.gains is not None
    if kp is not None:
        # limits are designed 4e-7 tighter, of which |T| gives a fifth to kp
        assert tuned.gains.kp == pytest.approx(kp, rel=3e-6)
    assert all(report.result is not None and report.result.slack is not None for report in tuned.requirements)
    slack = tuned.requirements[0].result.slack if tuned.requirements[0].result else None
    assert slack == pytest.approx(0.0, abs=2e-6)
