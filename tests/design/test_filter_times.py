"""Time constants of filters that are designed with the gains, against scans of the times."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.terms.controller_spec import GainRange
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.spec.digests import digests_of

LAG = "{model: lag, static_gain: {min: 0.8, max: 1.2}, time_constant_s: 1, dead_time_s: 0.5}"
TRIPLE = "{model: transfer_function, numerator: [1], denominator: [1, 3, 3, 1]}"
PID = "structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20}"
LIMITS = "{sensitivity_db: {at_most: 4.5}}, {control_sensitivity_db: {at_most: 10}}"
#: the same with the smallest band
NARROW = "{sensitivity_db: {at_most: 4.5}}, {control_sensitivity_db: {at_most: -20}, from_rad_s: 30}"


def spec_of(
    times: str, plant: str = LAG, asked: str = LIMITS, aim: str = "minimize: iae_disturbance", more: str = ""
) -> ft.DesignSpec:
    return ft.parse_spec(
        f"schema: 1\nname: times\nplant: {plant}\ncontroller: {{{PID}, {times}}}\nrequirements: [{asked}]\n"
        f"objective: {{{aim}}}\n{more}"
    )


def of_derivative(time: str) -> str:
    return f"derivative_filter_time_constant_s: {time}"


def of_both(derivative: str, measurement: str) -> str:
    return f"{of_derivative(derivative)}, measurement_filter: {{order: 2, time_constant_s: {measurement}}}"


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("plant", "aim"),
    [(LAG, "minimize: iae_disturbance"), (TRIPLE, "maximize: ki"), (TRIPLE, "minimize: iae_disturbance")],
)
def test_no_time_of_a_scan_is_better(plant: str, aim: str) -> None:
    found = ft.tune(spec_of(of_derivative("{min: 0.02, max: 1}"), plant, aim=aim))
    assert found.status is ft.Status.SOLVED
    assert found.certificate is not None
    assert found.certificate.verdict.value == "proved"
    assert found.gap is None
    assert found.objective is not None
    sign = 1.0 if aim.startswith("minimize") else -1.0
    for time in np.geomspace(0.02, 1.0, 9).tolist():
        other = ft.tune(spec_of(of_derivative(repr(time)), plant, aim=aim), proof=False)
        if other.objective is not None:
            assert sign * (other.objective - found.objective) >= -1e-4 * abs(found.objective), time


def test_the_design_is_that_of_its_time() -> None:
    free = ft.tune(spec_of(of_derivative("{min: 0.02, max: 1}")), proof=False)
    assert isinstance(free.gains, Pid)
    time = free.gains.derivative_filter_time_constant_s
    assert 0.1 < time < 0.2
    fixed = ft.tune(spec_of(of_derivative(repr(time))), proof=False)
    assert fixed.objective == pytest.approx(free.objective, rel=1e-6)
    # the middle of the range is the objective's own scale, and nobody's answer
    middle = ft.tune(spec_of(of_derivative(repr(math.sqrt(0.02)))), proof=False)
    assert middle.objective is not None
    assert free.objective is not None
    assert middle.objective > free.objective + 1e-5


def test_the_time_of_the_measurements_filter_is_found_too() -> None:
    # the noise gain above 30 rad/s asks for a slow filter, the margin for a fast one
    gains = "structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}"
    used = "measurement_filter: {order: 1, time_constant_s: {min: 0.001, max: 2}}"
    spec = ft.parse_spec(
        f"schema: 1\nname: times\nplant: {LAG}\ncontroller: {{{gains}, {used}}}\nrequirements: [{NARROW}]\n"
        "objective: {maximize: ki}\n"
    )
    found = ft.tune(spec)
    assert found.status is ft.Status.SOLVED
    assert found.certificate is not None
    assert found.certificate.verdict.value == "proved"
    assert found.gains is not None
    assert found.gains.measurement_filter is not None
    time = found.gains.measurement_filter.time_constant_s
    assert 0.002 < time < 1.9
    assert found.objective is not None
    for factor in (0.8, 0.95, 1.05, 1.25):
        filtered = MeasurementFilter(1, factor * time)
        box = spec.controller.with_times_of(FoPi(1.0, 1.0, 1.0, measurement_filter=filtered))
        other = ft.tune(replace(spec, controller=box), proof=False)
        assert other.objective is None or other.objective <= found.objective * (1.0 + 1e-6)


@pytest.mark.long
def test_both_times_are_found() -> None:
    both = ft.tune(spec_of(of_both("{min: 0.02, max: 1}", "{min: 0.005, max: 0.5}"), asked=NARROW))
    assert both.status is ft.Status.SOLVED
    assert both.objective is not None
    for derivative in (0.02, 0.05, 0.14, 0.4, 1.0):
        for measurement in (0.005, 0.02, 0.05, 0.15, 0.5):
            other = ft.tune(spec_of(of_both(repr(derivative), repr(measurement)), asked=NARROW), proof=False)
            assert other.objective is None or other.objective >= both.objective * (1.0 - 1e-4)


def test_on_samples_the_time_is_that_of_the_loop_on_samples() -> None:
    digital = "digital: {sample_time_s: 0.05, design: sampled}\n"
    found = ft.tune(spec_of(of_derivative("{min: 0.025, max: 0.5}"), more=digital))
    assert found.status is ft.Status.SOLVED
    assert found.objective is not None
    for time in (0.03, 0.1, 0.3):
        other = ft.tune(spec_of(of_derivative(repr(time)), more=digital), proof=False)
        assert other.objective is None or other.objective >= found.objective * (1.0 - 1e-4)
    with pytest.raises(ft.SpecError, match=r"constant_s\.min: 0\.02 s is below half the sample time"):
        spec_of(of_derivative("{min: 0.02, max: 0.5}"), more=digital)


def test_where_no_time_has_gains_that_is_said_with_how_many_were_looked_at() -> None:
    found = ft.tune(spec_of(of_derivative("{min: 0.02, max: 1}"), asked="{crossover_rad_s: {at_least: 50}}"))
    assert found.status is ft.Status.INFEASIBLE
    assert found.message.startswith(
        "none of 9 filter times of the ranges has gains that meet everything; with "
        "derivative_filter_time_constant_s = 0.1414 s: "
    )


def test_a_time_at_the_end_of_its_range_is_said_and_there_is_no_bound() -> None:
    spec = spec_of(of_derivative("{min: 0.3, max: 0.35}"))
    found = ft.tune(spec, proof=False)
    name = "derivative_filter_time_constant_s is at the lower end of its range, 0.3 s: a wider range may"
    assert any(note.startswith(name) for note in found.notes)
    # the time of a derivative that is not there is at no end
    none = spec_of(of_derivative("{min: 0.02, max: 1}"), aim="maximize: ki")
    none = replace(none, controller=replace(none.controller, kd=GainRange(0.0, 0.0)))
    assert not any("time_constant" in note for note in ft.tune(none, proof=False).notes)
    assert found.gains is not None
    assert "there is no bound where a filter's time" in ft.certify_optimum(spec, found.gains).reason
    with pytest.raises(ft.DomainError, match="derivative_filter_time_constant_s has a range"):
        ft.tradeoff(spec, 1)


def test_gains_of_the_range_are_of_the_specs_structure_and_others_are_not() -> None:
    box = spec_of(of_both("{min: 0.02, max: 1}", "{min: 0.005, max: 0.5}")).controller
    used = MeasurementFilter(2, 0.1)
    assert box.has_structure_of(Pid(1.0, 1.0, 1.0, 0.5, measurement_filter=used))
    for other in (
        Pid(1.0, 1.0, 1.0, 0.5),
        Pid(1.0, 1.0, 1.0, 1.5, measurement_filter=used),
        Pid(1.0, 1.0, 1.0, 0.5, measurement_filter=MeasurementFilter(2, 0.6)),
        Pid(1.0, 1.0, 1.0, 0.5, measurement_filter=MeasurementFilter(1, 0.1)),
        FoPid(1.0, 1.0, 0.9, 1.0, 0.9, 0.5, measurement_filter=used),
        FoPi(1.0, 1.0, 1.0, measurement_filter=used),
    ):
        assert not box.has_structure_of(other)
    given = box.with_times_of(Pid(1.0, 1.0, 1.0, 0.5, measurement_filter=used))
    assert (given.derivative_filter_time_constant_s, given.measurement_filter, given.filter_times) == (0.5, used, None)


def test_a_design_of_a_time_is_proved_again_and_one_of_another_range_is_not_taken() -> None:
    spec = spec_of(of_derivative("{min: 0.02, max: 1}"))
    found = ft.tune(spec, proof=False)
    assert found.gains is not None
    check = ft.prove(spec, found.gains)
    assert check.certificate.verdict.value == "proved"
    with pytest.raises(ft.DomainError, match="another structure"):
        ft.prove(spec, Pid(1.0, 1.0, 0.1, 2.0))
    assert json.loads(json.dumps(found.to_dict()))["gains"]["derivative_filter_time_constant_s"] > 0.02
    other = spec_of(of_derivative("{min: 0.02, max: 2}"))
    assert digests_of(other)["controller"] != digests_of(spec)["controller"]
    # a number written as one is that number
    same = spec_of(of_derivative("{min: 0.1, max: 0.1}"))
    assert digests_of(same) == digests_of(spec_of(of_derivative("0.1")))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{min: 1, max: 0.1}", r"min 1\.0 is greater than max 0\.1; swap them"),
        ("{min: 0, max: 0.1}", "must be greater than 0"),
        ("{max: 0.1}", "min"),
        ("{nominal: 0.1, min: 0.05, max: 0.2}", "nominal"),
    ],
)
def test_a_range_of_times_that_is_none_is_told(text: str, said: str) -> None:
    with pytest.raises(ft.SpecError, match=said):
        spec_of(of_derivative(text))


def test_a_range_beside_gains_that_are_all_fixed_is_refused() -> None:
    text = "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 1}\n"
    text += "controller: {structure: pid, kp: 1, ki: 1, kd: 1, derivative_filter_time_constant_s: {min: 0.1, max: 1}}\n"
    with pytest.raises(ft.SpecError, match="every gain is fixed"):
        ft.parse_spec(f"{text}requirements: [{{sensitivity_db: {{at_most: 6}}}}]\n")
