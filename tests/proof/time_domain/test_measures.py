"""Measures of enclosures are those of simulations, by the same definitions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.plants import lag
from cases.time_domain_cases import at_most, case_of, random_case, simulated

import fopi_tune as ft
from fopi_tune.proof.balls.box import point_box
from fopi_tune.proof.time_domain import TimeDomainCase, why_no_method
from fopi_tune.proof.time_domain.enclosure import Enclosure
from fopi_tune.proof.time_domain.measures import PROVABLE, MeasureRange, measure_range
from fopi_tune.spec.model import Knot, ScenarioSpec

SIMULATED = [name for name in PROVABLE if name != "undershoot"]


def range_at(case: TimeDomainCase, plant: tuple[float, ...]) -> MeasureRange:
    found = Enclosure(case).trajectory(point_box(plant))
    assert found is not None
    return measure_range(case, found)


def agree(case: TimeDomainCase, plant: tuple[float, ...]) -> None:
    for name in SIMULATED:
        own = at_most(case, 1.0, name)
        if why_no_method(own):
            continue
        value = float(simulated(own, np.array([plant]))[0]) * own.per_unit
        found = range_at(own, plant)
        if np.isinf(value):
            assert found.high == np.inf
            continue
        slack = 1e-8 * max(1.0, abs(value))
        assert found.low - slack <= value <= found.high + slack, name
        assert found.high - found.low <= slack, name


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(400, 418))
def test_every_measure_of_random_scenarios(seed: int) -> None:
    case = random_case(seed)
    agree(case, tuple(case.family.nominal_point.tolist()))


# fractions of a sample that division by the sample time gives exactly: where control and load arrive together, rounding
# must not tell them apart
@pytest.mark.thinned(4)
@pytest.mark.parametrize("late", [0.0, 0.05, 0.25])
@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0])
def test_rates_where_control_and_load_arrive_at_different_times(late: float, delay: float) -> None:
    scenario = ScenarioSpec("s", 9.0, (Knot(0.0, 1.0),), (Knot(2.0, -0.8), Knot(4.0, 0.5, 1.0)))
    case = case_of(lag(1.0, (1.0, 1.5), late), ft.FoPi(0.9, 0.6, 0.9), 0.2, scenario, delay_samples=delay)
    agree(case, (1.2,))


def test_loads_begin_steps_only_where_the_output_had_settled() -> None:
    gains = ft.FoPi(0.9, 0.7, 1.0)
    for at_s in (0.4, 1.0, 3.0, 12.0):
        reference = (Knot(0.0, 1.0), Knot(20.0, 0.5))
        scenario = ScenarioSpec("s", 30.0, reference, (Knot(at_s, 0.3),), settling_band=0.05)
        agree(case_of(lag(1.0, (1.0, 1.5)), gains, 0.2, scenario), (1.3,))


def test_what_is_judged_from_a_time_on() -> None:
    scenario = ScenarioSpec("s", 12.0, (Knot(0.0, 1.0, 3.0), Knot(8.0, 0.0)), judged_from_s=1.5)
    case = case_of(lag(1.0, (1.0, 1.5), (0.2, 0.3)), ft.FoPi(0.9, 0.7, 1.0), 0.2, scenario)
    for late in (0.2, 0.25, 0.3):
        agree(case, (1.3, late))
    agree(replace(case, scenario=replace(scenario, judged_from_s=11.0)), (1.3, 0.25))


def test_what_the_last_sample_begins_does_not_count() -> None:
    scenario = ScenarioSpec("s", 6.0, (Knot(0.0, 0.1), Knot(5.9, 50.0)))
    for late in (0.0, 0.05):
        case = case_of(lag(1.0, (1.0, 1.5), late), ft.FoPi(0.9, 0.7, 1.0), 0.2, scenario)
        assert case.run.signals.reference[-2] < 1.0 < case.run.signals.reference[-1]
        agree(case, (1.3,))
