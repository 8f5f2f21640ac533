"""Loops with measured responses, against loops of the plants that were sampled and against dense evaluation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.measured import LAG, PLANTS, RESONANCE, TWO, curve

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.measured.loops import LoopPoints, MeasuredLoop
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.errors import DomainError

BAND = (1e-3, 1e3)


def _log_s(points: LoopPoints) -> Array:
    return -points.log_return_difference


@pytest.mark.parametrize("gains", [FoPi(1.0, 1.0, 0.8), FoPi(0.3, 2.0, 1.3), Pid(2.0, 1.0, 0.3, 0.05)])
@pytest.mark.parametrize("name", ["lag", "two", "integrator", "unstable"])
def test_crossings_and_the_peak_are_those_of_the_sampled_plant(name: str, gains: FoPi) -> None:
    loop = MeasuredLoop(gains, curve(PLANTS[name]), BAND)
    exact = Loops.of(gains, Plants.of(PLANTS[name]))
    # 60 points a decade: the interpolation is off by some 1e-5 neper
    np.testing.assert_allclose(np.exp(loop.gain_crossovers), gain_crossovers(exact).omega_rad_s, rtol=1e-4)
    crossings = phase_crossovers(exact)
    highest = crossings.omega_rad_s[(crossings.omega_rad_s > 2e-3) & (crossings.omega_rad_s < 50.0)]
    mine = np.exp(loop.phase_crossovers)
    np.testing.assert_allclose(mine[(mine > 2e-3) & (mine < 50.0)], highest, rtol=1e-3)
    peak, u = loop.extreme(_log_s, True, 0.0, math.inf)
    known = extremes(exact, Response.SENSITIVITY, 1e-3, 1e3)
    assert peak == pytest.approx(float(known.value[0]), abs=1e-3)
    assert math.exp(u) == pytest.approx(float(known.omega_rad_s[0]), rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_an_extreme_of_a_noisy_curve_is_that_of_a_dense_grid(seed: int) -> None:
    plain = curve(TWO, 0.01, 100.0, 81)
    chance = np.random.default_rng(seed)
    noisy = type(plain)(
        plain.omega_rad_s,
        plain.log_gain + 0.05 * chance.normal(size=81),
        plain.phase_rad + 0.05 * chance.normal(size=81),
    )
    loop = MeasuredLoop(FoPi(2.0, 1.5, 1.1), noisy, (0.01, 100.0))
    dense = loop.at(np.linspace(math.log(0.05), math.log(20.0), 400_001))
    for largest in (True, False):
        value, _ = loop.extreme(_log_s, largest, 0.05, 20.0)
        among = _log_s(dense)
        # the grid's distance squared times the curvature
        assert value == pytest.approx(float(among.max() if largest else among.min()), abs=1e-8)
    changes = np.flatnonzero(np.diff(np.sign(dense.log_gain)))
    inside = loop.gain_crossovers[(loop.gain_crossovers > dense.u[0]) & (loop.gain_crossovers < dense.u[-1])]
    np.testing.assert_allclose(inside, dense.u[changes], atol=2e-5)


def test_two_crossings_between_neighbouring_columns_are_found() -> None:
    plain = curve(RESONANCE, 0.1, 30.0, 60)
    unit = FoPi(1.0, 0.0, 1.0)
    top, _ = MeasuredLoop(unit, plain, (0.1, 30.0)).extreme(lambda points: points.log_gain, True, 1.0, 3.0)
    # 1e-7 neper of the resonance are above 1
    gains = FoPi(math.exp(-top + 1e-7), 0.0, 1.0)
    assert len(MeasuredLoop(gains, plain, (0.1, 30.0)).gain_crossovers) == 2
    assert len(MeasuredLoop(FoPi(math.exp(-top - 1e-7), 0.0, 1.0), plain, (0.1, 30.0)).gain_crossovers) == 0


def test_a_band_beside_the_grid_has_no_value_and_one_frequency_has_one() -> None:
    loop = MeasuredLoop(FoPi(1.0, 1.0, 1.0), curve(LAG, 0.1, 10.0, 61), (0.1, 10.0))
    assert math.isnan(loop.extreme(_log_s, True, 20.0, 30.0)[0])
    value, u = loop.extreme(_log_s, True, 0.7, 0.7)
    assert math.exp(u) == pytest.approx(0.7)
    assert value == pytest.approx(float(_log_s(loop.at(np.log([0.7])))[0]))


def test_a_dead_time_that_turns_too_often_is_refused() -> None:
    plain = curve(LAG, 0.1, 1e3, 61)
    late = type(plain)(plain.omega_rad_s, plain.log_gain, plain.phase_rad, 1e3)
    with pytest.raises(DomainError, match="turns the phase too often"):
        _ = MeasuredLoop(FoPi(1.0, 1.0, 1.0), late, (0.1, 1e3)).grid
