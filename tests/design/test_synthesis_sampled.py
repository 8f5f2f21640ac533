"""`design: sampled`: the true optimum of the loop on samples, its explanations and its prices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases.project import CONTINUOUS
from cases.random_sampled_specs import sampled_spec
from oracles.sampled_search import Reference, checked

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.design import design
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec, Sense

#: objectives that a stand-in in continuous time with moved limits reached on samples
STAND_IN = {
    "throttle": 0.02047296300519579,
    "pi_baseline": 8.63812822642376,
    "brake": 7.361582679017019,
    "brake_delay": 0.6622542580694774,
    "second_order": 0.4168830460385515,
    "lag_gain_and_delay": 0.8522612127985538,
}
#: relative, of an objective
OPTIMAL = 1e-4


def sampled(spec: DesignSpec, **options: object) -> DesignSpec:
    assert spec.digital is not None
    return replace(spec, digital=replace(spec.digital, design="sampled", **options))


def shipped(name: str, **options: object) -> DesignSpec:
    return sampled(ft.load_spec(CONTINUOUS / f"{name}.yaml"), **options)


def solved(spec: DesignSpec) -> tuple[Candidate, float]:
    """The design, verified on samples, and its objective as something to be minimised."""
    found = design(spec)
    assert found.status is Status.SOLVED, found.message
    assert found.gains is not None
    verified = checked(spec, found.gains)
    assert verified.all_met
    assert verified.objective is not None
    is_maximised = spec.objective is None or spec.objective.sense is Sense.MAXIMIZE
    return found, -verified.objective if is_maximised else verified.objective


@pytest.mark.thinned(slow=["lag_gain", "second_order"])
@pytest.mark.parametrize("name", STAND_IN)
def test_a_shipped_spec_is_no_worse_on_samples_than_by_a_stand_in(name: str) -> None:
    spec = shipped(name)
    _, cost = solved(spec)
    sign = -1.0 if spec.objective is not None and spec.objective.sense is Sense.MAXIMIZE else 1.0
    assert cost <= sign * STAND_IN[name] + 1e-6 * abs(STAND_IN[name])


RULES = [{"prewarp": "crossover"}, {"rule": "matched"}, {"method": "modified_oustaloup"}]


@pytest.mark.parametrize("rule", RULES)
def test_a_filter_that_is_exact_at_the_crossover_is_designed_for_its_own(rule: dict[str, str]) -> None:
    # verified with the filter that is made of the gains that were found
    _, cost = solved(shipped("brake_delay", sample_time_s=0.4, **rule))
    assert math.isfinite(cost)


@pytest.mark.long
@pytest.mark.parametrize("rule", RULES)
def test_no_gains_with_filters_of_their_own_are_better(rule: dict[str, str]) -> None:
    spec = shipped("brake_delay", sample_time_s=0.4, **rule)
    _, cost = solved(spec)
    other = Reference(spec, 300)
    reference, _ = other.search(generations=40, population=10)
    verified = checked(spec, reference)
    assert not verified.all_met or verified.objective is None or cost <= verified.objective * (1.0 + OPTIMAL)


def compared(text: str, generations: int, points: int) -> tuple[float | None, float | None]:
    """Objectives to be minimised of the design and of the reference, both verified; None without one."""
    spec = ft.parse_spec(text)
    tuned = ft.tune(spec, proof=False)
    sign = -1.0 if spec.objective is None or spec.objective.sense is Sense.MAXIMIZE else 1.0
    ours = sign * tuned.objective if tuned.status is Status.SOLVED and tuned.objective is not None else None
    gains, merit = Reference(tuned.spec, points).search(generations=generations)
    verified = checked(tuned.spec, gains) if merit < 40.0 else None
    if verified is None or not verified.all_met or verified.objective is None:
        return ours, None
    return ours, sign * verified.objective


def is_no_worse(ours: float | None, theirs: float | None) -> bool:
    return theirs is None or (ours is not None and ours <= theirs + OPTIMAL * max(abs(theirs), 1e-3))


@pytest.mark.parametrize(
    ("seed", "generations"), [(11, 6), *(pytest.param(seed, 40, marks=pytest.mark.long) for seed in (3, 11))]
)
def test_a_random_spec_is_designed_to_the_references_optimum(seed: int, generations: int) -> None:
    ours, theirs = compared(sampled_spec(seed), generations, 250)
    assert is_no_worse(ours, theirs), (ours, theirs)


@pytest.mark.long
def test_further_random_specs_are_designed_to_the_references_optimum() -> None:
    pairs = {seed: compared(sampled_spec(seed), 40, 250) for seed in range(100, 108)}
    assert sum(pair[1] is not None for pair in pairs.values()) >= 4
    assert {seed: pair for seed, pair in pairs.items() if not is_no_worse(*pair)} == {}


@pytest.mark.long
def test_what_clashes_on_samples_is_said_and_each_relaxation_is_enough() -> None:
    text = (
        "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: 2, dead_time_s: 0.4}\n"
        "requirements: [{crossover_rad_s: {at_least: 2.0}}, {phase_margin_deg: {at_least: 60}}]\n"
        "objective: {minimize: sensitivity_peak_db}\ndigital: {sample_time_s: 0.3, design: sampled}\n"
    )
    spec = ft.parse_spec(text)
    tuned = ft.tune(spec, proof=False)
    assert tuned.status is Status.INFEASIBLE
    assert {give.requirement for give in tuned.clash} == {0, 1}
    for give in tuned.clash:
        assert give.new_limit is not None
        rows = list(spec.requirements)
        rows[give.requirement] = replace(rows[give.requirement], limits=(give.new_limit,))
        assert ft.tune(replace(spec, requirements=tuple(rows)), proof=False).status is Status.SOLVED


def test_a_crossover_above_nyquists_frequency_has_no_solution() -> None:
    spec = shipped("throttle", sample_time_s=10.0)
    found = design(spec)
    assert found.status is Status.INFEASIBLE
    assert "Nyquist" in found.message
    assert [give.requirement for give in found.clash] == [0]


def test_an_upper_limit_of_the_crossover_above_nyquists_frequency_changes_nothing() -> None:
    text = (
        "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
        "controller: {kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: {min: 0.5, max: 1.3}}\n"
        "requirements: [{sensitivity_db: {at_most: 4}}, {crossover_rad_s: {at_most: LIMIT}}]\n"
        "objective: {maximize: ki}\ndigital: {sample_time_s: 0.3, design: sampled}\n"
    )
    found = [design(ft.parse_spec(text.replace("LIMIT", limit))) for limit in ("9", "100")]
    assert [each.status for each in found] == [Status.SOLVED] * 2
    assert found[0].gains is not None
    assert found[1].gains is not None
    assert found[1].gains.ki == pytest.approx(found[0].gains.ki, rel=1e-6)


def test_gains_that_grow_without_end_are_called_unbounded_on_samples() -> None:
    text = (
        "schema: 1\nname: x\nplant: {model: transfer_function, numerator: [0.1, 1], denominator: [1, 1]}\n"
        "controller: {kp: {min: 0}, ki: {min: 0}, alpha: {min: 0.5, max: 1}}\n"
        "requirements: [{sensitivity_db: {at_most: 40}}]\nobjective: {minimize: iae_disturbance}\n"
        "digital: {sample_time_s: 0.1, design: sampled}\n"
    )
    # behind a hold there is a delay: what grows without end in continuous time does not on samples
    assert design(ft.parse_spec(text)).status is Status.SOLVED
    assert design(ft.parse_spec(text.replace("sampled", "continuous"))).status is Status.UNBOUNDED


def test_a_filter_that_jumps_with_alpha_is_refused_by_name() -> None:
    with pytest.raises(ft.DomainError, match="method: fit"):
        design(shipped("brake", method="fit"))


def test_nyquists_frequency_counts_in_the_gain_margin() -> None:
    text = (
        "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: 1}\n"
        "controller: {kp: {min: 0, max: 50}, ki: 0, alpha: 1}\n"
        "requirements: [{gain_margin_db: {at_least: 9}}]\nobjective: {minimize: iae_disturbance}\n"
        "digital: {sample_time_s: 0.5, design: sampled}\n"
    )
    spec = ft.parse_spec(text)
    found, _ = solved(spec)
    assert found.gains is not None
    margin = checked(spec, found.gains).requirements[0]
    # without an integral the phase of a lag reaches -180 deg at Nyquist's frequency itself
    assert margin.achieved == pytest.approx(9.0, abs=1e-4)
    assert margin.worst.omega_rad_s == pytest.approx(math.pi / 0.5, rel=1e-3)


def test_a_refuted_place_of_the_loop_on_samples_is_looked_at_in_the_next_design() -> None:
    spec = shipped("second_order")
    point, omega = tuple(float(x) for x in 0.5 * (spec.plant.low + spec.plant.high)), 1.2345
    from fopi_tune.design.global_search.problem import Problem
    from fopi_tune.results.candidate import Violation

    problem = Problem.of(spec, (Violation(0, point, omega),))
    table = problem.fine_table
    assert np.abs(table.log_omega - math.log(omega / problem.scale.omega_rad_s)).min() < 1e-9
    assert np.abs(table.points - np.array(point)).max(axis=1).min() == 0.0


def test_gains_that_are_fixed_are_checked_on_samples() -> None:
    spec = shipped("brake_delay")
    gains = design(spec).gains
    assert isinstance(gains, FoPi)
    box = replace(spec.controller, **{n: ft_range(getattr(gains, n)) for n in ("kp", "ki", "alpha")})
    assert ft.tune(replace(spec, controller=box), proof=False).status is Status.SOLVED


def ft_range(value: float):
    from fopi_tune.spec.model import GainRange

    return GainRange(value, value)
