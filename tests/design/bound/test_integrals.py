"""What is said of s^-alpha and of filters over a range of alpha, beside values at many alphas of the range."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fopi_tune.core.bode_form import Complex
from fopi_tune.design.bound.integrals import (
    ANGLE,
    BEND,
    CHANGE,
    F_IMAG,
    F_REAL,
    F_SIZE,
    GAIN_CHANGE,
    H_BEND,
    H_CHANGE,
    H_LARGEST,
    H_RATE,
    H_SLOPE,
    H_VALUE,
    HIGHEST,
    INTEGRALS,
    LOWEST,
    RATE,
    RATE_IMAG,
    RATE_REAL,
    filters_over,
    integral_over,
    real_integral_over,
)
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import NO_SAMPLES, Sampling
from fopi_tune.design.global_search.controllers import controller_of, filter_at, integral_at_real
from fopi_tune.design.global_search.samples import Samples
from fopi_tune.spec.model import DigitalSpec

FILTERS: dict[str, dict[str, Any]] = {
    "oustaloup": {},
    "five poles": {"poles": 5},
    "three poles": {"poles": 3},
    "modified": {"method": "modified_oustaloup"},
    "matched": {"rule": "matched"},
    "prewarped": {"prewarp": "crossover"},
}


def sampling_of(options: dict[str, Any] | None) -> Sampling:
    """A filter over six decades of frequency at 2 rad/s; None for s^-alpha."""
    if options is None:
        return NO_SAMPLES
    digital = DigitalSpec(sample_time_s=0.1, band_rad_s=(1e-3, 1e3), design="sampled", **options)
    return Samples(digital, Scale(2.0, 1.0, np.ones(1)), 1.5).sampling


def log_integral(alpha: float, v: float, sampling: Sampling) -> complex:
    """ln F, its angle between -3/2 pi and pi/2."""
    if sampling.half == 0.0:
        return -alpha * complex(v, 0.5 * math.pi)
    real, imag = filter_at(controller_of(np.array([1.0, 1.0, alpha]), sampling), math.exp(v))
    angle = math.atan2(imag, real)
    return complex(math.log(math.hypot(real, imag)), angle - (2.0 * math.pi if angle > 0.5 * math.pi else 0.0))


def ranges(draws: np.random.Generator, count: int) -> list[tuple[float, float]]:
    """Centres and half-widths, wide and narrow."""
    found = []
    for _ in range(count):
        alpha = float(draws.uniform(0.3, 1.7))
        reach = min(float(10.0 ** draws.uniform(-4.0, -0.2)), alpha - 0.1, 1.98 - alpha)
        found.append((alpha, reach))
    return found


def second(values: Complex, step: float) -> Complex:
    return (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2


@pytest.mark.parametrize("name", [None, *FILTERS])
def test_an_integral_and_its_derivatives_stay_inside_what_is_said_of_a_range(name: str | None) -> None:
    sampling = sampling_of(None if name is None else FILTERS[name])
    draws, out = np.random.default_rng(4), np.empty(INTEGRALS)
    for alpha, reach in ranges(draws, 40):
        v = float(draws.uniform(-9.0, 6.0))
        integral_over(alpha, reach, v, filters_over(alpha, reach, sampling), out)
        alphas = np.linspace(alpha - reach, alpha + reach, 41)
        logs: Complex = np.array([log_integral(float(a), v, sampling) for a in alphas])
        centre, step = logs[20], alphas[1] - alphas[0]
        assert complex(out[F_REAL], out[F_IMAG]) == pytest.approx(np.exp(centre), rel=1e-9)
        assert out[F_SIZE] == pytest.approx(abs(np.exp(centre)), rel=1e-9)
        # differences over 1e-4 are exact to about 1e-8
        near = np.array([log_integral(alpha + d, v, sampling) for d in (-1e-4, 1e-4)])
        assert complex(out[RATE_REAL], out[RATE_IMAG]) == pytest.approx(-(near[1] - near[0]) / 2e-4, rel=1e-6, abs=1e-7)
        room = 1.0 + 1e-9
        assert np.abs(logs - centre).max() <= out[CHANGE] * room + 1e-12
        assert np.abs((logs - centre).real).max() <= out[GAIN_CHANGE] * room + 1e-12
        assert np.abs((logs - centre).imag).max() <= out[ANGLE] * room + 1e-12
        assert out[LOWEST] - 1e-9 <= logs.imag.min()
        assert logs.imag.max() <= out[HIGHEST] + 1e-9
        assert np.abs(np.diff(logs) / step).max() <= out[RATE] * room + 1e-9 / step
        if step > 1e-3:
            # rounding: 1e-14/step^2
            assert np.abs(second(logs, step)).max() <= out[BEND] * room + 1e-7
        # what a quadratic rest has to cover
        rest = np.abs(logs - centre + complex(out[RATE_REAL], out[RATE_IMAG]) * (alphas - alpha))
        assert (rest <= 0.5 * out[BEND] * (alphas - alpha) ** 2 * room + 1e-11).all()


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", [None, *FILTERS])
def test_the_same_at_a_real_frequency(name: str | None) -> None:
    sampling = sampling_of(None if name is None else FILTERS[name])
    draws, out = np.random.default_rng(5), np.empty(6)
    for alpha, reach in ranges(draws, 40):
        log_s = float(draws.uniform(-9.0, 3.0))
        real_integral_over(alpha, reach, log_s, filters_over(alpha, reach, sampling), out)
        alphas = np.linspace(alpha - reach, alpha + reach, 41)
        logs = np.array([
            math.log(integral_at_real(controller_of(np.array([1.0, 1.0, a]), sampling), log_s)) for a in alphas
        ])  # fmt: skip
        step = alphas[1] - alphas[0]
        assert math.log(out[H_VALUE]) == pytest.approx(logs[20], abs=1e-9)
        assert logs.max() <= math.log(out[H_LARGEST]) + 1e-9
        assert np.abs(logs - logs[20]).max() <= out[H_CHANGE] * (1.0 + 1e-9) + 1e-9
        assert np.abs(np.diff(logs) / step).max() <= out[H_RATE] * (1.0 + 1e-9) + 1e-9 / step
        rest = np.abs(logs - logs[20] - out[H_SLOPE] * (alphas - alpha))
        assert (rest <= 0.5 * out[H_BEND] * (alphas - alpha) ** 2 * (1.0 + 1e-9) + 1e-9).all()


def test_a_range_of_no_width_changes_nothing() -> None:
    out = np.empty(INTEGRALS)
    for sampling in (NO_SAMPLES, sampling_of({})):
        integral_over(1.1, 0.0, 0.3, filters_over(1.1, 0.0, sampling), out)
        assert out[CHANGE] == out[GAIN_CHANGE] == out[ANGLE] == 0.0
        assert out[LOWEST] == out[HIGHEST]
