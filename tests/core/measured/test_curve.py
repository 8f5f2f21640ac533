"""Curves between measured points, against SciPy's and against the plants that were sampled."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.measured import INTEGRATOR, LAG, NEGATIVE, PLANTS, UNSTABLE, curve, response
from scipy.interpolate import PchipInterpolator

from fopi_tune.core.measured.curve import Curve, LowEnd
from fopi_tune.errors import DomainError

_DB = 20.0 / math.log(10.0)


def _random_curve(seed: int, points: int) -> Curve:
    chance = np.random.default_rng(seed)
    omega = np.cumsum(chance.uniform(0.1, 2.0, points))
    return Curve(omega, chance.normal(size=points), 0.3 * chance.normal(size=points))


@pytest.mark.parametrize("seed", range(5))
def test_values_and_slopes_are_those_of_scipys_monotone_cubics(seed: int) -> None:
    found = _random_curve(seed, 5 + 7 * seed)
    at = np.linspace(found.u[0], found.u[-1], 201)
    value, slope = found.log_and_slope_at(at)
    for mine, rise, y in ((value.real, slope.real, found.log_gain), (value.imag, slope.imag, found.phase_rad)):
        other = PchipInterpolator(found.u, y)
        np.testing.assert_allclose(mine, other(at), rtol=0, atol=1e-12)
        np.testing.assert_allclose(rise, other.derivative()(at), rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_curve_stays_between_two_neighbours(seed: int) -> None:
    found = _random_curve(seed, 30)
    at = np.linspace(found.u[0], found.u[-1], 2000)
    gain = found.log_at(at).real
    k = np.clip(np.searchsorted(found.u, at, side="right") - 1, 0, 28)
    low, high = (
        np.minimum(found.log_gain[k], found.log_gain[k + 1]),
        np.maximum(found.log_gain[k], found.log_gain[k + 1]),
    )
    assert np.all((gain >= low - 1e-12) & (gain <= high + 1e-12))


@pytest.mark.parametrize("name", ["lag", "two", "resonance", "unstable"])
def test_the_estimated_error_bounds_the_true_one(name: str) -> None:
    found = curve(PLANTS[name], 0.01, 10.0, 61)
    omega = np.geomspace(0.01, 10.0, 5001)
    off = np.log(response(PLANTS[name], omega)) - found.log_at(np.log(omega))
    estimate = found.interpolation_error
    assert np.abs(off.real).max() * _DB <= estimate.gain_db
    assert np.degrees(np.abs(np.remainder(off.imag + np.pi, 2 * np.pi) - np.pi).max()) <= estimate.phase_deg


def test_an_error_is_asked_for_up_to_a_frequency() -> None:
    found = curve(LAG, 0.01, 100.0, 41)
    assert found.interpolation_error_up_to(1.0).phase_deg < 0.1 * found.interpolation_error.phase_deg


@pytest.mark.parametrize(
    ("plant", "end"),
    [
        (LAG, LowEnd(0, False)),
        (INTEGRATOR, LowEnd(-1, False)),
        (UNSTABLE, LowEnd(0, True)),
        (NEGATIVE, LowEnd(0, True)),
    ],
)
def test_the_lowest_frequencies_tell_integrators_and_sign(plant: object, end: LowEnd) -> None:
    assert curve(plant).low_end == end  # type: ignore[arg-type]


def test_a_band_that_begins_beyond_the_corner_tells_nothing() -> None:
    assert curve(LAG, 0.4, 100.0, 61).low_end is None


def test_wrapped_phases_are_unwrapped_and_whole_turns_do_not_matter() -> None:
    found = curve(LAG)
    turned = Curve(found.omega_rad_s, found.log_gain, np.mod(found.phase_rad, 2 * np.pi) + 6 * np.pi)
    np.testing.assert_allclose(turned.phase_rad, found.phase_rad, atol=1e-9)


def test_further_dead_time_turns_the_phase_alone() -> None:
    found = curve(LAG, 0.1, 10.0, 61)
    later = Curve(found.omega_rad_s, found.log_gain, found.phase_rad, 0.25)
    u = np.log(np.array([0.3, 2.0]))
    np.testing.assert_allclose(later.log_at(u) - found.log_at(u), -0.25j * np.exp(u), atol=1e-12)


def test_steps_of_the_phase_that_could_go_either_way_are_listed() -> None:
    omega = np.arange(1.0, 9.0)
    phase = np.where(omega > 4.0, -2.8, 0.0)
    assert Curve(omega, np.zeros(8), phase).ambiguous_steps == ((4.0, 5.0),)
    assert Curve(omega, np.zeros(8), 0.5 * phase).ambiguous_steps == ()


@pytest.mark.parametrize(
    ("omega", "gain", "told"),
    [
        ([1.0, 2.0, 3.0, 4.0], [0.0] * 4, "at least 5"),
        ([1.0, 2.0, 2.0, 4.0, 5.0], [0.0] * 5, "increase"),
        ([0.0, 1.0, 2.0, 3.0, 4.0], [0.0] * 5, "greater than 0"),
        ([1.0, 2.0, 3.0, 4.0, 5.0], [0.0, math.nan, 0.0, 0.0, 0.0], "not finite"),
        ([1.0, 2.0, 3.0, 4.0, 5.0], [0.0] * 4, "one length"),
    ],
)
def test_what_is_no_response_is_refused(omega: list[float], gain: list[float], told: str) -> None:
    with pytest.raises(DomainError, match=told):
        Curve(np.array(omega), np.array(gain), np.zeros(len(omega)))
