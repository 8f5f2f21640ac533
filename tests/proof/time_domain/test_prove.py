"""Known designs are proved to the sixth digit, within few boxes; what has no method says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cases.plants import lag, transfer_function
from cases.time_domain_cases import (
    at_most,
    brake_ramp,
    case_of,
    filter_of,
    points,
    saturated_throttle,
    simulated,
    three_numbers,
)

import fopi_tune as ft
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.time_domain import TimeDomainCase, prove_limit, recheck_limit, why_no_method
from fopi_tune.proof.time_domain.proof import FREE, LIMITED
from fopi_tune.spec.model import Knot, Limit, Relation, ScenarioSpec

STEP = ScenarioSpec("step", 12.0, (Knot(0.0, 1.0),))
GAINS = ft.FoPi(0.8, 0.5, 0.9)


def test_the_brake_keeps_its_acceleration_to_the_last_millionth() -> None:
    proof = prove_limit(brake_ramp())
    assert proof.verdict is Verdict.PROVED
    assert proof.method == FREE
    assert proof.bound is not None
    assert 2.0 < proof.bound <= 2.0 * (1.0 + 1e-6)
    assert proof.examined < 60
    # nine millionths more of the integral gain are too many
    refuted = prove_limit(at_most(brake_ramp(), 2.0 - 2e-5))
    assert refuted.verdict is Verdict.REFUTED
    assert refuted.theta is not None
    assert refuted.time_s == pytest.approx(3.2)
    assert refuted.value == pytest.approx(2.0, abs=1e-7)
    assert simulated(brake_ramp(), np.array([refuted.theta]))[0] == pytest.approx(refuted.value, abs=1e-8)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    "name",
    [
        "overshoot",
        "peak_rate_per_s",
        "peak_jerk_per_s2",
        "final_error",
        "settling_time_s",
        "iae",
        "ise",
        "peak_control",
    ],
)
def test_saturated_loops_are_proved_sample_by_sample(name: str) -> None:
    case = at_most(saturated_throttle(), 1.0, name)
    coarse = np.linspace(0.15, 0.2, 2001)
    near = coarse[int(simulated(case, coarse[:, None]).argmax())]
    # the jerk has a peak of 1e-5 per s at a plant whose control leaves its limit just at a sample
    fine = np.clip(np.linspace(near - 2.5e-5, near + 2.5e-5, 2001), 0.15, 0.2)
    worst = float(simulated(case, fine[:, None]).max())
    proof = prove_limit(at_most(case, worst * (1.0 + 1e-4)), budget=200)
    assert proof.verdict is Verdict.PROVED
    assert proof.method == LIMITED
    assert proof.bound is not None
    assert worst * (1.0 - 1e-12) <= proof.bound <= worst * (1.0 + 1.1e-4) + 2e-5
    if name == "peak_control":
        assert proof.bound == pytest.approx(1.0, abs=1e-12)


@pytest.mark.long
def test_three_uncertain_numbers_are_proved_up_to_a_corner() -> None:
    case = three_numbers()
    worst = float(simulated(case, points(case.family, np.random.default_rng(1), 500)).max())
    assert worst == pytest.approx(0.1, abs=1e-6)
    proof = prove_limit(at_most(case, worst + 1e-3), budget=400)
    assert proof.verdict is Verdict.PROVED
    assert prove_limit(at_most(case, 3.0, "peak_control"), budget=400).verdict is Verdict.PROVED
    refuted = prove_limit(at_most(case, worst - 1e-4))
    assert refuted.theta == (1.25, 3.1, 0.4)


@pytest.mark.parametrize("distance", [0.02, pytest.param(0.001, marks=pytest.mark.long)])
def test_a_rate_is_proved_for_every_dead_time_where_none_is_the_worst(distance: float) -> None:
    case = at_most(three_numbers(), 1.0, "peak_rate_per_s")
    worst = float(simulated(case, points(case.family, np.random.default_rng(1), 500)).max())
    assert prove_limit(at_most(case, worst * (1.0 + distance)), budget=400).verdict is Verdict.PROVED
    assert prove_limit(at_most(case, worst * (1.0 - distance)), budget=400).verdict is Verdict.REFUTED


def test_lower_limits_are_proved_and_refuted() -> None:
    case = case_of(lag(1.0, (1.0, 2.0)), GAINS, 0.2, STEP)
    least = float(simulated(at_most(case, 0.0, "iae"), np.linspace(1.0, 2.0, 501)[:, None]).min())
    for limit, verdict in ((least - 1e-4, Verdict.PROVED), (least + 1e-4, Verdict.REFUTED)):
        proof = prove_limit(replace(case, limit=Limit("iae", Relation.AT_LEAST, limit)))
        assert proof.verdict is verdict
    assert proof.theta is not None


def test_an_undershoot_is_that_of_the_trajectory() -> None:
    # a zero in the right half plane: the output first goes the wrong way
    family = transfer_function([-0.5, 1.0], [1.0, (1.8, 2.2), 1.0])
    case = case_of(family, ft.FoPi(0.5, 0.3, 0.9), 0.1, STEP)
    found = prove_limit(at_most(case, 0.5, "undershoot"))
    assert found.verdict is Verdict.PROVED
    assert found.bound is not None
    refuted = prove_limit(at_most(case, 0.01, "undershoot"))
    assert refuted.verdict is Verdict.REFUTED
    assert refuted.value is not None
    assert 0.01 < refuted.value <= found.bound
    at_rest = replace(case, scenario=ScenarioSpec("load", 12.0, (Knot(0.0, 0.0),), (Knot(0.0, 1.0),)))
    assert "step of the reference" in prove_limit(at_most(at_rest, 0.5, "undershoot")).message


def test_a_single_plant_is_decided_at_once() -> None:
    case = case_of(lag(1.0, 1.5), GAINS, 0.2, STEP)
    value = float(simulated(case, np.zeros((1, 0)))[0])
    assert prove_limit(at_most(case, value + 1e-5)).examined == 1
    proof = prove_limit(at_most(case, value - 1e-5))
    assert (proof.verdict, proof.theta) == (Verdict.REFUTED, ())


def test_a_limit_that_is_met_exactly_needs_no_tolerance() -> None:
    case = case_of(lag(1.0, (1.0, 2.0)), ft.FoPi(3.0, 0.5, 0.9), 0.2, STEP, (-1.0, 1.0))
    proof = prove_limit(at_most(case, 1.0, "peak_control"), tolerance=0.0)
    assert proof.verdict is Verdict.PROVED


def test_a_budget_that_is_spent_is_said() -> None:
    proof = prove_limit(at_most(three_numbers(), 0.1001), budget=5)
    assert proof.verdict is Verdict.UNDECIDED
    assert "budget of 5 boxes is spent" in proof.message
    assert proof.examined == 5


def test_the_actuators_rate_limit_must_not_be_reached() -> None:
    case = case_of(lag(1.0, (1.0, 1.2)), GAINS, 0.2, replace(STEP, rate_per_s=1e3))
    assert prove_limit(at_most(case, 1.0)).verdict is Verdict.PROVED
    slow = replace(case, scenario=replace(STEP, rate_per_s=0.5))
    proof = prove_limit(at_most(slow, 1.0), budget=20)
    assert proof.verdict is Verdict.UNDECIDED
    assert "rate limit" in proof.message


def _refused() -> list[tuple[TimeDomainCase, str]]:
    case = case_of(lag(1.0, (1.0, 2.0)), GAINS, 0.2, STEP)
    limited = case_of(lag(1.0, (1.0, 2.0)), GAINS, 0.2, STEP, (-5.0, 5.0))
    second = case_of(transfer_function([1.0], [1.0, (1.0, 2.0), 1.0]), GAINS, 0.2, STEP)
    late = case_of(transfer_function([0.1, 0.5, 1.0], [1.0, 2.0, 1.0], (0.1, 0.2)), GAINS, 0.2, STEP)
    either = case_of(transfer_function([1.0], [(-0.5, 0.5), 1.0]), GAINS, 0.2, STEP)
    above = replace(STEP, initial_output=1.0)
    single = Runtime.of(some_sections(), Precision.FLOAT32)
    return [
        (at_most(case, 1.0, "saturation_time_s"), "saturation_time_s has none"),
        (replace(at_most(case, 1.0, "acceleration_m_s2"), measurement_unit="bar"), "needs a measured velocity"),
        (replace(case, scenario=replace(STEP, quantum=0.1)), "quantum"),
        (replace(case, scenario=replace(STEP, duration_s=1e4)), "50001 samples"),
        (replace(limited, scenario=replace(STEP, duration_s=500.0)), "2501 samples are more than 2000 with output"),
        (replace(case, limit=Limit("overshoot", Relation.EQUALS, 1.0)), "equals"),
        (replace(case, delay_samples=1e5), "delay of more than"),
        (replace(case, controller=single), "float64"),
        (at_most(second, 1.0, "peak_rate_per_s"), "rates of plants of order 2"),
        (late, "direct path are not continuous"),
        (either, "differ in their order"),
        (replace(second, scenario=replace(above, before="free")), "needs plants of first order"),
        (replace(late, family=transfer_function([1.0, 0.0], [1.0, 2.0, 1.0]), scenario=above), "P(0) may be 0"),
        (
            replace(second, family=transfer_function([1.0], [1.0, 2.0, (-0.1, 0.1)]), scenario=above),
            "others have none",
        ),
    ]


def some_sections() -> Sections:
    return filter_of(GAINS, 0.2)


@pytest.mark.parametrize("number", range(14))
def test_what_has_no_method_says_why(number: int) -> None:
    case, reason = _refused()[number]
    assert reason in why_no_method(case)
    proof = prove_limit(case)
    assert (proof.verdict, proof.method, proof.boxes) == (Verdict.UNDECIDED, "", ())
    assert proof.message == f"no method: {why_no_method(case)}"


@pytest.mark.parametrize(("tolerance", "budget"), [(-1.0, 10), (float("nan"), 10), (1e-6, 0)])
def test_bad_numbers_are_refused(tolerance: float, budget: int) -> None:
    with pytest.raises(DomainError, match="tolerance"):
        prove_limit(brake_ramp(), tolerance, budget)


@pytest.mark.thinned(slow=["saturated", "three"])
@pytest.mark.parametrize("make", [brake_ramp, saturated_throttle, three_numbers])
def test_a_controller_that_limits_its_rate_has_no_method(make: Callable[[], TimeDomainCase]) -> None:
    case = make()
    slow = replace(case, controller=replace(case.controller, most_change=0.01))
    proof = prove_limit(slow)
    assert proof.verdict is Verdict.UNDECIDED
    assert proof.message == "no method: an output rate limit is not modelled in this proof"
    # nor is the proof of the loop without it one of this
    decided = prove_limit(case, budget=100)
    if decided.verdict is not Verdict.UNDECIDED:
        assert recheck_limit(case, decided) == ()
        (problem,) = recheck_limit(slow, decided)
        assert problem == "nothing can be proved: an output rate limit is not modelled in this proof"
