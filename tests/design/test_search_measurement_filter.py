"""Designs with a measurement filter:  against plants that hold it, and against a brute force where |C S| is asked."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.proof import verify
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

TIME_S = 0.15
#: denominators of (s + 1)^3, and of it times 1 + sT and 1 + sT + s^2 T^2/2
BARE = np.array([1.0, 3.0, 3.0, 1.0])
HELD = {1: np.polymul(BARE, [TIME_S, 1.0]), 2: np.polymul(BARE, [TIME_S**2 / 2, TIME_S, 1.0])}
STRUCTURES = {
    "pi": "kp: {min: 0}, ki: {min: 0}",
    "fopi": "kp: {min: 0}, ki: {min: 0}, alpha: {min: 0.5, max: 1.3}",
    "pid": "kp: {min: 0}, ki: {min: 0}, kd: {min: 0}, derivative_filter_time_constant_s: 0.1",
    "fopid": "kp: {min: 0}, ki: {min: 0}, kd: {min: 0}, alpha: 0.9, mu: 0.8, derivative_filter_time_constant_s: 0.1",
}
ASKED = "[{sensitivity_db: {at_most: 4}}, {phase_margin_deg: {at_least: 50}}, {gain_margin_db: {at_least: 8}}]"


def spec_of(
    structure: str,
    order: int | None,
    objective: str,
    asked: str = ASKED,
    denominator: np.ndarray = BARE,
    more: str = "",
) -> DesignSpec:
    """A spec for the plant of three lags, the slowest uncertain in its gain."""
    used = "" if order is None else f", measurement_filter: {{order: {order}, time_constant_s: {TIME_S}}}"
    coefficients = ", ".join(repr(float(number)) for number in denominator)
    return parse_spec(
        f"schema: 1\nname: filtered\n"
        f"plant: {{model: transfer_function, numerator: [{{min: 0.8, max: 1.2}}], denominator: [{coefficients}], "
        f"dead_time_s: 0.1}}\n"
        f"controller: {{structure: {structure}, {STRUCTURES[structure]}{used}}}\n"
        f"requirements: {asked}\nobjective: {objective}\n{more}"
    )


@pytest.mark.parametrize("objective", ["{maximize: ki}", "{minimize: sensitivity_peak_db}"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.thinned(6)
def test_gains_are_those_for_a_plant_that_holds_the_filter(structure: str, order: int, objective: str) -> None:
    asked = ASKED if "ki" in objective else "[{crossover_rad_s: {at_least: 0.4}}]"
    found = ft.tune(spec_of(structure, order, objective, asked), proof=False)
    wanted = ft.tune(spec_of(structure, None, objective, asked, HELD[order]), proof=False)
    assert found.gains is not None
    assert wanted.gains is not None
    assert found.objective == pytest.approx(wanted.objective, rel=2e-5)
    assert found.gap == wanted.gap
    # a minimum is flat: its gains are less well known than its value
    room = 1e-4 if "ki" in objective else 2e-2
    assert found.gains.ki == pytest.approx(wanted.gains.ki, rel=room)
    assert found.gains.kp == pytest.approx(wanted.gains.kp, rel=room)


@pytest.mark.parametrize("order", [1, 2])
def test_the_discounted_error_has_no_filter_in_it(order: int) -> None:
    spec = spec_of("pi", order, "{minimize: iae_disturbance, horizon_s: 3.0}")
    found = ft.tune(spec, proof=False)
    assert found.gains is not None
    s = 1.0 / 3.0
    controller = float(found.gains(complex(s)).real)

    def error(gain: float) -> float:
        plant = gain / float(np.polyval(BARE, s)) * math.exp(-0.1 * s)
        return abs(3.0 * plant / (1.0 + controller * plant))

    assert found.objective == pytest.approx(max(error(0.8), error(1.2)), rel=1e-9)
    # the same gains are the best ones for the plant that holds the filter, whose error is smaller by F(1/T)
    other = ft.tune(
        spec_of("pi", None, "{minimize: iae_disturbance, horizon_s: 3.0}", denominator=HELD[order]), proof=False
    )
    at = float(MeasurementFilter(order, TIME_S)(complex(s)).real)
    assert found.objective is not None
    assert other.objective == pytest.approx(found.objective * at, rel=1e-5)


def _largest_noise_gain(kp: float, ki: float, order: int, gain: float) -> tuple[float, float]:
    """Largest |C F S| and |S| in dB by formulas of this test on a dense grid; inf of an unstable loop."""
    divisor = [TIME_S, 1.0] if order == 1 else [TIME_S**2 / 2, TIME_S, 1.0]
    loop = np.polyadd(np.polymul([1.0, 0.0], HELD[order]), gain * np.array([kp, ki]))
    if np.roots(loop).real.max() >= 0.0:
        return math.inf, math.inf
    s = 1j * np.geomspace(1e-2, 1e3, 4000)
    top = np.polyval([kp, ki], s) / s / np.polyval(divisor, s)
    difference = 1.0 + top * gain / np.polyval(BARE, s)
    noise, sensitivity = (20.0 * math.log10(float(np.abs(each).max())) for each in (top / difference, 1.0 / difference))
    return noise, sensitivity


@pytest.mark.parametrize("order", [1, 2])
def test_a_limit_of_the_noise_gain_holds_the_filter(order: int) -> None:
    asked = "[{sensitivity_db: {at_most: 5}}, {control_sensitivity_db: {at_most: 3.0}}]"
    spec = spec_of("pi", order, "{maximize: ki}", asked)
    late = replace(spec.plant.parameters["dead_time_s"], nominal=0.0, min=0.0, max=0.0)
    spec = replace(spec, plant=replace(spec.plant, parameters={**spec.plant.parameters, "dead_time_s": late}))
    found = ft.tune(spec, proof=False)
    assert found.gains is not None
    noise = found.requirements[1].result
    assert noise is not None
    assert noise.achieved == pytest.approx(3.0, abs=1e-4), "the limit decides"

    def is_met(kp: float, ki: float) -> bool:
        each = [_largest_noise_gain(kp, ki, order, gain) for gain in (0.8, 1.2)]
        return max(a for a, _ in each) <= 3.0 and max(b for _, b in each) <= 5.0

    assert is_met(found.gains.kp * 0.9999, found.gains.ki * 0.9999)
    best = found.gains.ki
    for kp in np.linspace(0.3, 2.5, 45):
        assert not is_met(float(kp), 1.002 * best), kp


def test_the_smallest_noise_gain_is_found_with_the_filter() -> None:
    spec = spec_of("pi", 2, "{minimize: control_sensitivity_peak_db}", "[{crossover_rad_s: {at_least: 0.5}}]")
    found = ft.tune(spec, proof=False)
    assert found.gains is not None
    assert found.objective is not None
    assert verify(spec, found.gains).objective == pytest.approx(found.objective, rel=1e-6)
    for dp in (-0.02, 0.0, 0.02):
        for di in (-0.02, 0.0, 0.02):
            other = replace(found.gains, kp=found.gains.kp * (1.0 + dp), ki=found.gains.ki * (1.0 + di))
            seen = verify(spec, other)
            assert not seen.all_met or (seen.objective or 0.0) >= found.objective - 1e-5


def test_a_plant_and_filter_of_too_high_an_order_are_refused() -> None:
    spec = spec_of("pi", 2, "{maximize: ki}", denominator=np.poly([-1.0] * 7))
    with pytest.raises(ft.DomainError, match="exceeds 6 beside a measurement filter of order 2"):
        ft.tune(spec, proof=False)


@pytest.mark.parametrize("order", [1, 2])
def test_a_gain_margin_that_only_the_filter_makes_finite_is_no_contradiction(order: int) -> None:
    lag = parse_spec(
        "schema: 1\nname: lag\nplant: {model: lag, static_gain: 1, time_constant_s: 1}\n"
        f"controller: {{structure: pi, kp: {{min: 0}}, ki: {{min: 0}}, measurement_filter: "
        f"{{order: {order}, time_constant_s: 0.2}}}}\n"
        "requirements: [{gain_margin_db: {at_most: 30}}, {phase_margin_deg: {at_least: 40}}]\n"
        "objective: {maximize: ki}\n"
    )
    assert ft.tune(lag, proof=False).status == ft.Status.SOLVED
    without = replace(lag, controller=replace(lag.controller, measurement_filter=None))
    assert "never reaches" in ft.tune(without, proof=False).message
