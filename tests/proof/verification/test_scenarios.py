"""Requirements on scenarios checked over the family: the worst plant, inside the box too, its time, the tolerance."""

from __future__ import annotations

import numpy as np
import pytest
from cases.scenario_designs import DESIGNS, parsed
from oracles.scenario_gains import drawn, grid, measured

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.proof import Verification, verify
from fopi_tune.simulation.measures import scenario_of
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec.model import DesignSpec

TEXT = """
schema: 1
name: checked
plant: {plant}
controller: {{kp: {{min: 0, max: 9}}, ki: {{min: 0, max: 9}}, alpha: {{min: 0.5, max: 1.4}}}}
digital: {{sample_time_s: 0.2, poles: 5{digital}}}
scenarios:
  - {{name: step, duration_s: 20, reference: [{{at_s: 1, value: 1}}]{more}}}
  - {{name: load, duration_s: 20, reference: [{{at_s: 0, value: 0}}], load: [{{at_s: 0, value: 1}}]}}
requirements:
{requirements}
"""
LAG = "{model: lag, static_gain: 1.0, time_constant_s: {nominal: 2.25, min: 0.6, max: 6}}"
#: lightly damped, so that the worst plant lies inside
RESONANT = (
    "{model: transfer_function, numerator: [1], denominator: [1, 0.6, {nominal: 1, min: 0.6, max: 1.6}], "
    "dead_time_s: 0.1}"
)
TWO = "{model: lag, static_gain: {min: 0.8, max: 1.25}, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: 0.3}"
GAINS = FoPi(1.2, 0.6, 0.9)


def spec_of(*requirements: str, plant: str = LAG, digital: str = "", more: str = "") -> DesignSpec:
    listed = "\n".join(f"  - {{{each}}}" for each in requirements)
    return parsed(TEXT.format(plant=plant, requirements=listed, digital=digital, more=more))


def checked(spec: DesignSpec, gains: FoPi = GAINS, tolerance: float = 1e-6) -> Verification:
    return verify(spec, gains, tolerance, designed_implementation(spec, gains))


MEASURES = (
    "iae",
    "overshoot",
    "peak_rate_per_s",
    "peak_control",
    "rise_time_s",
    "settling_time_s",
    "ise",
    "undershoot",
)


@pytest.mark.thinned(slow=["resonant"])
@pytest.mark.parametrize("plant", [LAG, RESONANT, TWO], ids=["lag", "resonant", "two numbers"])
def test_no_plant_of_a_dense_sample_is_worse(plant: str) -> None:
    limits = [f"{name}: {{at_most: 1}}, scenario: step" for name in MEASURES]
    limits += [f"{name}: {{at_least: 1}}, scenario: step" for name in ("iae", "rise_time_s", "peak_control")]
    spec = spec_of(*limits, plant=plant, more=", settling_band: 0.25")
    gains = FoPi(0.2, 0.25, 0.95) if plant == RESONANT else GAINS
    points = np.concatenate([grid(spec, 60 if plant == TWO else 4001), drawn(spec, 500, seed=2)])
    for result in checked(spec, gains).measures:
        values = measured(spec, gains, "step", result.requirement.measure, points)
        side = 1.0 if result.requirement.relation.value == "at_most" else -1.0
        best = float((side * values).max()) * side
        assert np.isfinite(best)
        assert side * result.achieved >= side * best - 1e-7 * abs(best), result.requirement
        # and it is reached by the plant that is named
        there = measured(spec, gains, "step", result.requirement.measure, np.array(result.worst.point)[None, :])
        assert there[0] == pytest.approx(result.achieved, rel=1e-12)
        assert result.worst.plant == pytest.approx(
            dict(zip(spec.plant.uncertain_names, result.worst.point, strict=True))
        )
        assert result.plants > 1000


def test_the_worst_plant_lies_inside_the_box() -> None:
    spec, gains = spec_of("overshoot: {at_most: 0.1}, scenario: step", plant=RESONANT), FoPi(0.2, 0.25, 0.95)
    (result,) = checked(spec, gains).measures
    ends = [float(measured(spec, gains, "step", "overshoot", np.array([[x]]))[0]) for x in (0.6, 1.0, 1.6)]
    (inside,) = result.worst.point
    assert 0.6 <= inside <= 1.6
    assert result.achieved >= max(ends)
    fine = np.linspace(0.6, 1.6, 20001)
    values = measured(spec, gains, "step", "overshoot", fine[:, None])
    assert result.achieved == pytest.approx(values.max(), abs=1e-9)
    assert abs(fine[int(values.argmax())] - inside) < 1e-3


def test_the_worst_scenario_of_a_requirement_on_all() -> None:
    spec = spec_of("iae: {at_most: 3}", "iae: {at_most: 3}, scenario: step", "iae: {at_most: 3}, scenario: load")
    every, step, load = checked(spec).measures
    assert every.achieved == max(step.achieved, load.achieved)
    assert every.scenario == ("step" if step.achieved > load.achieved else "load")
    least = spec_of("iae: {at_least: 0.1}")
    (found,) = checked(least).measures
    assert (
        found.achieved
        == min(float(measured(least, GAINS, name, "iae", grid(least, 801)).min()) for name in ("step", "load"))
        or found.achieved < 10.0
    )


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("measure", "unit"),
    [
        ("iae", None),
        ("overshoot", 1.0),
        pytest.param("peak_control", None, marks=pytest.mark.long),
        pytest.param("peak_rate_per_s", None, marks=pytest.mark.long),
    ],
)
def test_a_limit_may_be_missed_by_the_tolerance_and_no_more(measure: str, unit: float | None) -> None:
    spec = spec_of(f"{measure}: {{at_most: 7}}, scenario: step")
    achieved = checked(spec).measures[0].achieved
    size = achieved if unit is None else unit
    for by, met in ((0.5e-4, True), (2e-4, False), (-1e-3, True)):
        limit = achieved - by * size
        moved = spec_of(f"{measure}: {{at_most: {limit!r}}}, scenario: step")
        found = checked(moved, tolerance=1e-4)
        assert found.measures[0].is_met is met
        assert found.all_met is met
        # a score of 1 is the limit
        wanted = 1.0 + (achieved - limit) / (abs(limit) if unit is None else unit)
        assert found.measures[0].score == pytest.approx(wanted, abs=1e-9)


def test_a_settling_time_has_no_tolerance_of_a_sample() -> None:
    band = ", settling_band: 0.25"
    spec = spec_of("settling_time_s: {at_most: 20}, scenario: step", more=band)
    achieved = checked(spec).measures[0].achieved
    assert np.isfinite(achieved)
    for limit, met in ((achieved, True), (achieved - 0.2, False), (achieved - 1e-4, False)):
        moved = spec_of(f"settling_time_s: {{at_most: {limit!r}}}, scenario: step", more=band)
        assert checked(moved, tolerance=0.1).measures[0].is_met is met


def test_what_never_settles_is_missed_without_a_number() -> None:
    spec = spec_of("settling_time_s: {at_most: 9}, scenario: step", "rise_time_s: {at_most: 9}, scenario: step")
    for result in checked(spec, FoPi(0.05, 0.001, 1.0)).measures:
        assert result.achieved == np.inf
        assert result.is_met is False
        assert result.time_s is None


def test_an_unstable_loop_misses_everything() -> None:
    spec = spec_of("iae: {at_most: 9}", "overshoot: {at_most: 9}", plant=TWO)
    found = checked(spec, FoPi(90.0, 90.0, 1.0))
    assert not found.stability.stable
    assert not found.all_met


def test_an_output_that_does_not_stay_finite_misses_lower_limits_too() -> None:
    spec = spec_of("iae: {at_least: 1}", "peak_control: {at_least: 1}", plant=TWO)
    assert [result.is_met for result in checked(spec, FoPi(1e12, 1e12, 1.0)).measures] == [False, False]


POINTWISE = ("acceleration_m_s2", "peak_rate_per_s", "peak_jerk_per_s2", "overshoot", "undershoot", "peak_control")


@pytest.mark.thinned(2)
@pytest.mark.parametrize("measure", POINTWISE)
def test_the_time_is_when_the_worst_plant_has_the_value(measure: str) -> None:
    spec = spec_of(f"{measure}: {{at_most: 1}}, scenario: step", digital=", measurement_unit: m/s")
    (result,) = checked(spec).measures
    implementation = designed_implementation(spec, GAINS)
    assert implementation is not None
    run = scenario_of(spec.scenarios[0], implementation, 0)
    plants = Plants.members(spec.plant, np.array(result.worst.point)[None, :])
    traces = simulate([Mode(Runtime.of(implementation.sections, Precision.FLOAT64, None), plants)], run)
    assert result.time_s is not None
    k = round(result.time_s / 0.2)
    assert traces.time_s[k] == pytest.approx(result.time_s)
    there = {
        "acceleration_m_s2": max(abs(traces.rate[0, k]), abs(traces.rate_after[0, k])),
        "peak_rate_per_s": max(abs(traces.rate[0, k]), abs(traces.rate_after[0, k])),
        "peak_jerk_per_s2": abs(np.diff(traces.output[0], 2)[k - 2]) / 0.04,
        "overshoot": traces.output[0, k] - 1.0,
        "undershoot": -traces.output[0, k],
        "peak_control": abs(traces.applied[0, k]),
    }[measure]
    assert result.achieved == pytest.approx(max(there, 0.0) if measure == "undershoot" else there, rel=1e-9, abs=1e-12)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("measure", ["iae", "ise", "settling_time_s", "rise_time_s", "final_error"])
def test_no_single_sample_decides_a_sum_or_a_time(measure: str) -> None:
    assert checked(spec_of(f"{measure}: {{at_most: 20}}, scenario: step")).measures[0].time_s is None


def test_noise_and_quantisation_are_left_out() -> None:
    plain = checked(spec_of("iae: {at_most: 9}, scenario: step")).measures[0]
    noisy = checked(spec_of("iae: {at_most: 9}, scenario: step", more=", noise_std: 0.5")).measures[0]
    assert (noisy.achieved, noisy.worst.point) == (plain.achieved, plain.worst.point)


def test_limits_of_the_control_count() -> None:
    free = checked(spec_of("peak_control: {at_most: 9}, scenario: step")).measures[0]
    limited = checked(spec_of("peak_control: {at_most: 9}, scenario: step", digital=", output_limits: [-1, 1.05]"))
    assert free.achieved > 1.1
    assert limited.measures[0].achieved == pytest.approx(1.05)


def test_a_family_of_one_plant() -> None:
    spec = spec_of("iae: {at_most: 9}, scenario: step", plant="{model: lag, static_gain: 1, time_constant_s: 2}")
    (result,) = checked(spec).measures
    assert (result.plants, result.worst.plant, result.worst.point) == (1, {}, ())


@pytest.mark.parametrize("name", ["brake_step", pytest.param("lgd", marks=pytest.mark.long)])
def test_the_objective_is_the_worst_plants(name: str) -> None:
    spec = DESIGNS[name].spec
    known = DESIGNS[name].gains
    assert known is not None
    gains = FoPi(*known)
    found = checked(spec, gains)
    assert spec.objective is not None
    assert spec.objective.scenario is not None
    values = measured(spec, gains, spec.objective.scenario, "iae", drawn(spec, 3000, seed=5))
    assert found.objective is not None
    assert found.objective_worst is not None
    assert values.max() <= found.objective + 1e-9
    there = np.array(found.objective_worst.point)[None, :]
    assert measured(spec, gains, spec.objective.scenario, "iae", there)[0] == pytest.approx(found.objective, rel=1e-12)


def test_a_spec_without_scenarios_has_none() -> None:
    spec = parsed(
        "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\nobjective: {maximize: ki}\n"
    )
    assert verify(spec, GAINS).measures == ()
