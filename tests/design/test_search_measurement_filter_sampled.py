"""Designs on samples with a measurement filter: the error by simulation, and a brute force by SciPy's transforms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import bilinear, cont2discrete

import fopi_tune as ft
from fopi_tune.core.loops import Plants
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital.implementation import designed_implementation, runtime_of
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Actuator, Mode, Scenario, Signals
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

TS, TIME_S, TAU = 0.1, 0.25, 1.5
CONTROLLERS = {
    "pi": "structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}",
    "fopi": "structure: fopi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: 0.8",
    "pid": "structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20}, "
    "derivative_filter_time_constant_s: 0.1",
    "fopid": "structure: fopid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: 0.9, kd: {min: 0, max: 20}, "
    "mu: 0.7, derivative_filter_time_constant_s: 0.1",
}


def spec_of(structure: str, order: int, objective: str, asked: str) -> DesignSpec:
    return parse_spec(
        "schema: 1\nname: filtered\n"
        f"plant: {{model: lag, static_gain: {{min: 0.8, max: 1.2}}, time_constant_s: {TAU}}}\n"
        f"controller: {{{CONTROLLERS[structure]}, "
        f"measurement_filter: {{order: {order}, time_constant_s: {TIME_S}}}}}\n"
        f"requirements: {asked}\nobjective: {objective}\n"
        f"digital: {{sample_time_s: {TS}, design: sampled, delay_samples: 1}}\n"
    )


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("structure", CONTROLLERS)
@pytest.mark.thinned(2)
def test_the_discounted_error_is_that_of_a_simulated_step_of_the_load(structure: str, order: int) -> None:
    horizon = 2.0
    spec = spec_of(
        structure, order, f"{{minimize: iae_disturbance, horizon_s: {horizon}}}", "[{sensitivity_db: {at_most: 5}}]"
    )
    found = ft.tune(spec, proof=False)
    assert found.gains is not None
    implementation = designed_implementation(spec, found.gains)
    assert implementation is not None
    count, errors = round(30.0 * horizon / TS), []
    signals = Signals(np.zeros(count), np.ones(count))
    for gain in (0.8, 1.2):
        plant = Plants(np.array([[gain]]), np.array([[TAU, 1.0]]), np.zeros(1))
        run = Scenario(TS, signals, actuator=Actuator(delay_samples=1.0))
        y = simulate([Mode(runtime_of(implementation.sections, spec), plant)], run).output[0]
        # Ts times the sum of the discounted samples
        errors.append(abs(TS * float(np.sum(y * np.exp(-np.arange(count) * TS / horizon)))))
    assert found.objective == pytest.approx(max(errors), rel=1e-6)


def _peaks(kp: float, ki: float, order: int, gain: float) -> tuple[float, float]:
    """Largest |C F S| and |S| in dB by transforms of SciPy; inf of an unstable loop."""
    divisor = [TIME_S, 1.0] if order == 1 else [TIME_S**2 / 2, TIME_S, 1.0]
    b, a = (np.asarray(row) for row in bilinear([1.0], divisor, 1.0 / TS))
    held: Any = cont2discrete(([gain], [TAU, 1.0]), TS, "zoh")
    top, bottom = np.atleast_1d(np.squeeze(held[0])), np.asarray(held[1])
    # kp + ki Ts/2 (z + 1)/(z - 1), and z^-1 of the computing delay
    c, d = np.array([kp + 0.5 * ki * TS, 0.5 * ki * TS - kp]), np.array([1.0, -1.0])
    numerator = np.polymul(np.polymul(c, b), top)
    denominator = np.polymul(np.polymul(np.polymul(d, a), bottom), [1.0, 0.0])
    if np.abs(np.roots(np.polyadd(denominator, numerator))).max() >= 1.0:
        return math.inf, math.inf
    z = np.exp(1j * np.geomspace(1e-4, 1.0, 2500) * math.pi)
    terms = np.polyval(c, z) / np.polyval(d, z) * np.polyval(b, z) / np.polyval(a, z)
    difference = 1.0 + np.polyval(numerator, z) / np.polyval(denominator, z)
    noise, sensitivity = (
        20.0 * math.log10(float(np.abs(each).max())) for each in (terms / difference, 1.0 / difference)
    )
    return noise, sensitivity


@pytest.mark.parametrize("order", [1, 2])
def test_no_gains_of_a_scan_beat_a_design_on_samples_whose_noise_gain_is_limited(order: int) -> None:
    limit = 6.0
    asked = f"[{{sensitivity_db: {{at_most: 5}}}}, {{control_sensitivity_db: {{at_most: {limit}}}}}]"
    spec = spec_of("pi", order, "{maximize: ki}", asked)
    found = ft.tune(spec, proof=False)
    assert found.gains is not None
    noise = found.requirements[1].result
    assert noise is not None
    assert noise.achieved == pytest.approx(limit, abs=1e-4), "the limit decides"

    def is_met(kp: float, ki: float) -> bool:
        each = [_peaks(kp, ki, order, gain) for gain in (0.8, 1.2)]
        return max(a for a, _ in each) <= limit and max(b for _, b in each) <= 5.0

    assert is_met(found.gains.kp * 0.9999, found.gains.ki * 0.9999)
    for kp in np.linspace(0.2, 3.0, 40):
        assert not is_met(float(kp), 1.002 * found.gains.ki), kp


def test_a_filter_that_samples_cannot_make_is_refused() -> None:
    spec = spec_of("pi", 1, "{maximize: ki}", "[{sensitivity_db: {at_most: 5}}]")
    fast = MeasurementFilter(1, 0.04)
    with pytest.raises(ft.DomainError, match="below half the sample time"):
        ft.tune(replace(spec, controller=replace(spec.controller, measurement_filter=fast)), proof=False)
