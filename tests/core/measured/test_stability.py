"""Nyquist's count from a measured band, against that of the plants that were sampled; and what leaves it open."""

from __future__ import annotations

import numpy as np
import pytest
from cases.measured import INTEGRATOR, LAG, NEGATIVE, PLANTS, TWO, curve, unstable_poles

from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.measured.curve import Curve
from fopi_tune.core.measured.loops import MeasuredLoop
from fopi_tune.core.measured.stability import count_unstable_poles
from fopi_tune.core.stability import unstable_closed_loop_poles


@pytest.mark.parametrize("name", PLANTS)
def test_the_count_is_that_of_the_sampled_plant(name: str) -> None:
    plant, known = PLANTS[name], curve(PLANTS[name])
    chance, counts = np.random.default_rng(7), set[float]()
    sign = -1.0 if plant is NEGATIVE else 1.0
    for _ in range(40):
        kp, ki = sign * 10.0 ** chance.uniform(-1.0, 1.3, 2)
        kd, alpha = 10.0 ** chance.uniform(-2.0, 0.0), float(chance.uniform(0.4, 1.6))
        gains = FoPi(kp, ki, alpha) if chance.random() < 0.7 else Pid(kp, ki, sign * kd, 0.05)
        exact = float(unstable_closed_loop_poles(Loops.of(gains, Plants.of(plant)))[0])
        found = count_unstable_poles(MeasuredLoop(gains, known, known.band_rad_s), unstable_poles(plant))
        assert found.unstable == exact, (gains, found)
        counts.add(exact)
    assert len(counts) > 1, "the gains show one case alone"


def test_gains_of_the_wrong_sign_are_unstable() -> None:
    known = curve(NEGATIVE)
    assert count_unstable_poles(MeasuredLoop(FoPi(1.0, 1.0, 1.0), known, known.band_rad_s), 0).unstable == 1.0


def _reason(gains: FoPi, known: Curve, poles: int | None = 0) -> str:
    found = count_unstable_poles(MeasuredLoop(gains, known, known.band_rad_s), poles)
    assert found.unstable is None
    return found.reason


def test_without_the_number_of_unstable_poles_nothing_is_decided() -> None:
    assert "write unstable_poles: 0 for a stable plant" in _reason(FoPi(1.0, 1.0, 1.0), curve(LAG), None)


def test_a_loop_that_is_large_where_the_measurement_ends_is_left_open() -> None:
    assert "measure up to higher frequencies" in _reason(FoPi(5.0, 1.0, 1.0), curve(TWO, 0.01, 2.0, 61))


def test_a_crossover_below_the_band_is_left_open() -> None:
    assert "the gain crossover lies below" in _reason(FoPi(0.01, 0.001, 1.0), curve(INTEGRATOR, 0.1, 100.0, 61))


def test_a_band_that_begins_too_high_is_left_open() -> None:
    assert "measure from lower frequencies" in _reason(FoPi(1.0, 1.0, 1.0), curve(LAG, 0.4, 100.0, 61))


def test_a_phase_that_may_turn_either_way_is_left_open_where_the_loop_is_large() -> None:
    known = curve(LAG, 0.01, 100.0, 41)
    turned = np.where(known.omega_rad_s > 0.2, known.phase_rad - 2.9, known.phase_rad)
    jumping = Curve(known.omega_rad_s, known.log_gain, turned)
    assert "measure more frequencies there" in _reason(FoPi(2.0, 2.0, 1.0), jumping)
    # below |L| = 1 the phase decides nothing
    assert count_unstable_poles(MeasuredLoop(FoPi(0.02, 0.02, 1.0), jumping, (0.01, 100.0)), 0).unstable is not None


def test_a_loop_through_minus_one_is_unstable() -> None:
    # P = -1 at every frequency with the gain 1 would stay on |L| = 1: a flat response that falls off
    omega = np.geomspace(0.01, 100.0, 81)
    gain = np.where(omega < 1.0, 0.5, 0.5 - 2.0 * np.log(np.maximum(omega, 1.0)))
    flat = Curve(omega, gain, np.full(81, -np.pi))
    found = count_unstable_poles(MeasuredLoop(FoPi(1.0, 0.0, 1.0), flat, (0.01, 100.0)), 0)
    assert found.unstable == np.inf


def test_a_number_of_poles_that_the_measured_phase_contradicts_is_said() -> None:
    omega = np.geomspace(0.01, 100.0, 200)
    response = 1.0 / (1j * omega - 1.0)
    phase = np.asarray(np.angle(response), dtype=float)
    known, gains = Curve(omega, np.log(np.abs(response)), phase), FoPi(3.0, 0.2, 1.0)
    assert count_unstable_poles(MeasuredLoop(gains, known, known.band_rad_s), 1).unstable == 0.0
    assert _reason(gains, known, 0).startswith("unstable_poles: 0 contradicts the measured phase")
    assert "at least 1: correct the number" in _reason(gains, known, 0)
