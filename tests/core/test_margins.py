"""Margins against closed forms and published numbers; `test_margins_second_opinion.py` has other tools' opinions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError

LAG = Plant((1.0,), (1.0, 1.0))


def loops_of(controller: FoPi, plant: Plant) -> Loops:
    return Loops.of(controller, Plants.of(plant))


# --- published and closed-form numbers -----------------------------------------------------------------------------


def test_the_published_throttle_gains_have_the_recomputed_margins() -> None:
    found = margins(FoPi(0.09, 0.025, 0.8), Plant((4.39,), (1.0, 0.1746)))
    # PAPER.md section 7 prints four digits.
    assert found.crossover_rad_s == pytest.approx(0.4649, abs=5e-5)
    assert found.phase_margin_deg == pytest.approx(87.76, abs=5e-3)
    assert found.gain_margin_db == math.inf


@pytest.mark.parametrize(("gain", "crossover", "margin"), [(1.0, 0.00838, 141.0), (10.0, 0.7052, 95.75)])
def test_the_published_brake_gains_have_the_recomputed_margins(gain: float, crossover: float, margin: float) -> None:
    found = margins(FoPi(0.07, 0.11, 0.45), Plant((gain,), (2.25, 1.0)))
    assert found.crossover_rad_s == pytest.approx(crossover, rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(margin, abs=0.06)


def test_the_brake_meets_the_claimed_point_with_another_gain_and_lag() -> None:
    found = margins(FoPi(0.07, 0.11, 0.45), Plant((10.80,), (2.525, 1.0)))
    # The gain and the lag are printed to four digits; so is what follows.
    assert found.crossover_rad_s == pytest.approx(0.7, rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(93.0, abs=0.05)


def test_the_unit_gain_brake_meets_the_specification_with_the_recomputed_gains() -> None:
    found = margins(FoPi(0.3501, 0.4013, 0.8), Plant((1.0,), (2.25, 1.0)))
    assert found.crossover_rad_s == pytest.approx(0.3, rel=3e-4)
    assert found.phase_margin_deg == pytest.approx(90.0, abs=0.02)


@pytest.mark.parametrize(
    ("tau", "crossover", "margin"), [(1.6, 0.4855, 106.5), (2.35, 0.4, 100.0), (3.1, 0.3444, 95.6)]
)
def test_the_reference_brake_design_has_its_margins_over_the_lag(tau: float, crossover: float, margin: float) -> None:
    found = margins(FoPi(0.3976732, 0.6527344, 0.55), Plant((1.0,), (tau, 1.0)))
    assert found.crossover_rad_s == pytest.approx(crossover, abs=6e-5)
    assert found.phase_margin_deg == pytest.approx(margin, abs=0.06)


def test_the_reference_throttle_design_has_its_margins() -> None:
    found = margins(FoPi(0.0918608, 0.0224688, 0.8), Plant((4.39,), (1.0, 0.1746)))
    # Seven digits are printed.
    assert found.crossover_rad_s == pytest.approx(0.46, rel=2e-6)
    assert found.phase_margin_deg == pytest.approx(90.0, abs=2e-4)


def test_the_four_lag_loop_has_its_open_loop_value() -> None:
    loops = loops_of(FoPi(0.82274734724854, -0.45472580052281, 1.0), Plant((1.0,), (1.0, 4.0, 6.0, 4.0, 1.0)))
    value = loops.response(np.array([0]), np.array([0.8]))[0]
    assert abs(value) == pytest.approx(0.37180, abs=5e-6)
    assert math.degrees(np.angle(value)) == pytest.approx(-120.0, abs=5e-4)


def test_a_closed_form_design_gives_back_its_crossover_and_phase_margin() -> None:
    # PAPER.md sec. 3: X = e^{j(pm - pi)}/G(j wc), ki = -Im X wc^alpha / sin(alpha pi/2), kp = Re X - ki wc^-alpha cos
    rng = np.random.default_rng(11)
    for _ in range(50):
        alpha, omega, pm = rng.uniform(0.2, 1.8), 10.0 ** rng.uniform(-3, 3), math.radians(rng.uniform(10, 120))
        tau, delay = 10.0 ** rng.uniform(-1, 1) / omega, rng.uniform(0, 1) / omega
        x = np.exp(1j * (pm - math.pi)) * (1j * omega * tau + 1.0) * np.exp(1j * omega * delay)
        ki = -x.imag * omega**alpha / math.sin(0.5 * math.pi * alpha)
        kp = x.real - ki * omega**-alpha * math.cos(0.5 * math.pi * alpha)
        crossings = gain_crossovers(loops_of(FoPi(kp, ki, alpha), Plant((1.0,), (tau, 1.0), delay)))
        near = np.argmin(np.abs(crossings.omega_rad_s / omega - 1.0))
        # kp and ki carry rounding errors that a small sin(alpha pi/2) or slope enlarges.
        assert crossings.omega_rad_s[near] == pytest.approx(omega, rel=1e-9)
        assert crossings.angle_from_minus_one_rad[near] == pytest.approx(pm, abs=1e-9)


def test_the_gain_margin_is_infinite_for_a_lag_without_dead_time() -> None:
    for alpha in (0.1, 0.45, 0.8, 1.0):
        found = margins(FoPi(0.5, 0.6, alpha), LAG)
        assert found.gain_margin_db == math.inf
        assert found.gain_margin_rad_s is None
        assert found.gain_reduction_margin_db == -math.inf


def test_an_integrator_with_dead_time_has_its_textbook_margins() -> None:
    k, delay = 0.7, 1.3
    found = margins(FoPi(k, 0.0, 1.0), Plant((1.0,), (1.0, 0.0), delay))
    assert found.gain_margin_db == pytest.approx(20 * math.log10(0.5 * math.pi / (k * delay)), rel=1e-12)
    assert found.gain_margin_rad_s == pytest.approx(0.5 * math.pi / delay, rel=1e-12)
    assert found.phase_margin_deg == pytest.approx(90.0 - math.degrees(k * delay), rel=1e-12)
    assert found.delay_margin_s == pytest.approx(0.5 * math.pi / k - delay, rel=1e-12)


def test_three_equal_lags_have_their_textbook_gain_margin_and_phase_slope() -> None:
    found = margins(FoPi(4.0, 0.0, 1.0), Plant((1.0,), (1.0, 3.0, 3.0, 1.0)))
    assert found.gain_margin_db == pytest.approx(20 * math.log10(2.0), rel=1e-12)
    assert found.gain_margin_rad_s == pytest.approx(math.sqrt(3.0), rel=1e-12)
    omega = math.sqrt(4.0 ** (2.0 / 3.0) - 1.0)
    slope = -3.0 * omega / (1.0 + omega**2)
    assert found.phase_slope_deg_per_decade == pytest.approx(math.degrees(slope) * math.log(10.0), rel=1e-9)


def test_an_unstable_plant_has_its_margins_once_the_loop_is_stable() -> None:
    # L(j sqrt 3) = 2/(j sqrt 3 - 1) = e^{-j 120 deg}; s - 1 + k is stable for k > 1, and L(0) = -2
    found = margins(FoPi(2.0, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)))
    assert found.crossover_rad_s == pytest.approx(math.sqrt(3.0), rel=1e-12)
    assert found.phase_margin_deg == pytest.approx(60.0, abs=1e-10)
    assert found.delay_margin_s == pytest.approx(math.pi / 3.0 / math.sqrt(3.0), rel=1e-12)
    assert found.gain_reduction_margin_db == pytest.approx(-20.0 * math.log10(2.0), rel=1e-12)


def test_two_unstable_poles_leave_the_margin_that_is_seen_from_minus_one() -> None:
    # 4 (s + 1)/(s - 1)^2: |L| = 1 at sqrt 15, where arg L = 3 atan(omega) - 360 deg
    found = margins(FoPi(4.0, 0.0, 1.0), Plant((1.0, 1.0), (1.0, -2.0, 1.0)))
    assert found.crossover_rad_s == pytest.approx(math.sqrt(15.0), rel=1e-12)
    expected = math.degrees(3.0 * math.atan(math.sqrt(15.0))) - 180.0
    assert found.phase_margin_deg == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("controller", [FoPi(-2.0, -0.1, 0.8), FoPi(-2.0, 0.0, 0.8), FoPi(0.0, -0.3, 1.5)])
def test_two_negative_signs_are_none(controller: FoPi) -> None:
    plus = FoPi(-controller.kp, -controller.ki, controller.alpha)
    for denominator in ((1.0, 1.0), (1.0, 2.0, -3.0), (1.0, 1.0, 0.0)):
        assert margins(controller, Plant((-1.0,), denominator, 0.1)) == margins(plus, Plant((1.0,), denominator, 0.1))


# --- what a margin is a distance to ----------------------------------------------------------------------------------


def test_the_margin_is_the_angle_on_the_nearer_side_of_minus_one() -> None:
    # k s^2/(s^2 + 2 zeta s + 1) rises through |L| = 1 where (k^2 - 1) x^2 + (2 - 4 zeta^2) x = 1, x = omega^2, and
    # turns there from 180 deg toward 0: a lead of atan2(2 zeta omega, 1 - x) brings it to -1
    k, zeta = 2.0, 0.3
    b = 1.0 - 2.0 * zeta**2
    x = (math.sqrt(b**2 + k**2 - 1.0) - b) / (k**2 - 1.0)
    lead = math.degrees(math.atan2(2.0 * zeta * math.sqrt(x), 1.0 - x))
    found = margins(FoPi(k, 0.0, 1.0), Plant((1.0, 0.0, 0.0), (1.0, 2.0 * zeta, 1.0)))
    assert found.stable
    assert found.crossover_rad_s == pytest.approx(math.sqrt(x), rel=1e-12)
    assert found.phase_margin_deg == pytest.approx(lead, rel=1e-12)
    assert found.angles_from_minus_one_deg == pytest.approx((-lead,), rel=1e-12)
    # |L| tends to 2: no dead time at all is borne
    assert found.delay_margin_s == 0.0
    assert found.delay_margin_rad_s == math.inf


def test_whole_turns_of_the_phase_are_no_part_of_the_margin() -> None:
    # 2 zeta g s/(s^2 + 2 zeta s + 1) e^{-2 pi s} runs once round a circle on [0, g], turned by 360 deg omega: with
    # g = 2 the resonance has +-60 deg where |L| = 1, at omega = sqrt(1 + 3 zeta^2) -+ zeta sqrt 3
    zeta, g = 0.01, 2.0
    found = margins(FoPi(2.0 * zeta * g, 0.0, 1.0), Plant((1.0, 0.0), (1.0, 2.0 * zeta, 1.0), 2.0 * math.pi))
    middle, apart = math.sqrt(1.0 + 3.0 * zeta**2), zeta * math.sqrt(3.0)
    at = (middle - apart, middle + apart)
    # the phases are 60 - 360 at[0] and -60 - 360 at[1] deg, both near -360 +- 60
    below, above = 60.0 - 360.0 * (at[0] - 1.0), -60.0 - 360.0 * (at[1] - 1.0)
    assert found.stable
    assert found.gain_crossovers_rad_s == pytest.approx(at, rel=1e-12)
    assert found.angles_from_minus_one_deg == pytest.approx((below - 180.0, above + 180.0), abs=1e-8)
    assert found.phase_margin_deg == pytest.approx(180.0 - max(below, -above), abs=1e-8)
    assert found.delay_margin_s == pytest.approx(math.radians(above + 180.0) / at[1], rel=1e-9)
    assert found.delay_margin_rad_s == pytest.approx(at[1], rel=1e-12)


def test_a_loop_with_less_than_unit_gain_everywhere_has_infinite_margins() -> None:
    found = margins(FoPi(0.5, 0.0, 1.0), LAG)
    assert found.stable
    assert found.crossover_rad_s is None
    assert found.phase_slope_deg_per_decade is None
    assert found.gain_crossovers_rad_s == found.angles_from_minus_one_deg == ()
    assert (found.phase_margin_deg, found.delay_margin_s, found.gain_margin_db) == (math.inf, math.inf, math.inf)
    assert (found.phase_margin_rad_s, found.delay_margin_rad_s, found.gain_margin_rad_s) == (None, None, None)


@pytest.mark.parametrize(("kp", "reduction"), [(3.0, 0.0), (-3.0, 1.0 / 3.0)])
def test_a_loop_with_more_than_unit_gain_everywhere_bears_no_dead_time(kp: float, reduction: float) -> None:
    # kp (s + 2)/(s + 1): s (1 + kp) + 1 + 2 kp has one sign; |L| falls from 6 to 3, and -3 is a limit of L
    found = margins(FoPi(kp, 0.0, 1.0), Plant((1.0, 2.0), (1.0, 1.0)))
    assert found.stable
    assert found.crossover_rad_s is None
    assert found.phase_margin_deg == math.inf
    assert found.delay_margin_s == 0.0
    assert found.delay_margin_rad_s == math.inf
    assert found.gain_reduction_margin_db is not None
    assert 10.0 ** (found.gain_reduction_margin_db / 20.0) == pytest.approx(reduction, rel=1e-12)


def test_a_loop_that_ends_above_unit_gain_bears_no_dead_time_though_it_crosses() -> None:
    # 0.7 (2 s + 1)/(s + 1): |L|^2 = 1 at x = (1 - 0.49)/(1.96 - 1)
    found = margins(FoPi(0.7, 0.0, 1.0), Plant((2.0, 1.0), (1.0, 1.0)))
    omega = math.sqrt(0.51 / 0.96)
    assert found.gain_crossovers_rad_s == pytest.approx((omega,), rel=1e-12)
    angle = 180.0 - math.degrees(math.atan(2.0 * omega) - math.atan(omega))
    assert found.phase_margin_deg == pytest.approx(angle, rel=1e-12)
    assert found.delay_margin_s == 0.0


@pytest.mark.parametrize(
    ("controller", "plant", "crossover", "angle"),
    [
        # k/s^1.9 s: arg L = -171 - 90 deg
        (FoPi(0.0, 1.0, 1.9), Plant((1.0,), (1.0, 0.0)), 1.0, -81.0),
        # 1/(s - 1) with half the gain it takes never crosses; with sqrt 2 of the wrong sign: -1.414/(j - 1) at 1 rad/s
        (FoPi(-math.sqrt(2.0), 0.0, 1.0), Plant((1.0,), (1.0, -1.0)), 1.0, -135.0),
        # on the critical point: (s + 1)^3 = -8 at j sqrt 3, and 1/s^2
        (FoPi(8.0, 0.0, 1.0), Plant((1.0,), (1.0, 3.0, 3.0, 1.0)), math.sqrt(3.0), 0.0),
        (FoPi(1.0, 0.0, 1.0), Plant((1.0,), (1.0, 0.0, 0.0)), 1.0, 0.0),
    ],
)
def test_an_unstable_loop_has_no_margin_but_its_crossings_are_told(
    controller: FoPi, plant: Plant, crossover: float, angle: float
) -> None:
    found = margins(controller, plant)
    assert not found.stable
    assert found.crossover_rad_s == pytest.approx(crossover, rel=1e-9)
    assert found.angles_from_minus_one_deg == pytest.approx((angle,), abs=1e-7)
    none = (found.phase_margin_deg, found.delay_margin_s, found.gain_margin_db, found.gain_reduction_margin_db)
    assert none == (None,) * 4
    assert (found.phase_margin_rad_s, found.delay_margin_rad_s, found.gain_margin_rad_s) == (None,) * 3


def test_an_unstable_loop_without_crossover_has_no_margin_either() -> None:
    found = margins(FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)))
    assert not found.stable
    assert found.phase_margin_deg is found.delay_margin_s is found.gain_margin_db is None


# --- touching, and the ends of the axis ------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [0.1, 0.5, 1.0])
def test_a_phase_that_only_touches_minus_180_deg_sets_a_gain_margin(k: float) -> None:
    # k (s^2 + 6 s + 16)/(s (s^2 + 1.5 s + 1)): Im L (j omega) is a multiple of (omega^2 - 4)^2, and L(2j) = -2 k.
    # Routh: 6 (k - 1/2)^2 > 0, so that only the gain at which L(2j) = -1 is not stable
    found = margins(FoPi(0.0, k, 1.0), Plant((1.0, 6.0, 16.0), (1.0, 1.5, 1.0)))
    assert found.stable == (k != 0.5)
    if k < 0.5:
        # a touching point is located to half the digits, and |L| moves with it
        assert found.gain_margin_rad_s == pytest.approx(2.0, rel=1e-6)
        assert found.gain_margin_db == pytest.approx(20.0 * math.log10(0.5 / k), abs=1e-5)
        assert found.gain_reduction_margin_db == -math.inf
    if k > 0.5:
        assert found.gain_margin_db == math.inf
        assert found.gain_reduction_margin_db == pytest.approx(20.0 * math.log10(0.5 / k), abs=1e-5)


def test_a_gain_that_only_touches_one_is_a_crossover() -> None:
    # s/(s^2 + s + 1) is 1 at 1 rad/s and smaller elsewhere: half a turn, or pi seconds, from -1
    found = margins(FoPi(1.0, 0.0, 1.0), Plant((1.0, 0.0), (1.0, 1.0, 1.0)))
    assert found.crossover_rad_s == pytest.approx(1.0, rel=1e-7)
    assert found.phase_margin_deg == pytest.approx(180.0, abs=1e-5)
    assert found.delay_margin_s == pytest.approx(math.pi, rel=1e-7)


def test_an_all_pass_has_the_gain_margin_of_its_limit() -> None:
    # 0.5 (1 - s)/(1 + s): |L| = 1/2 everywhere, L -> -1/2
    found = margins(FoPi(0.5, 0.0, 1.0), Plant((-1.0, 1.0), (1.0, 1.0)))
    assert (found.phase_margin_deg, found.delay_margin_s) == (math.inf, math.inf)
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), rel=1e-12)
    assert found.gain_margin_rad_s == math.inf


@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_a_negative_constant_is_as_far_from_minus_one_as_its_gain(delay: float) -> None:
    found = margins(FoPi(-0.5, 0.0, 1.0), Plant((1.0,), (1.0,), delay))
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), rel=1e-12)
    assert found.phase_margin_deg == found.delay_margin_s == math.inf
    large = margins(FoPi(-2.0, 0.0, 1.0), Plant((1.0,), (1.0,)))
    assert (large.gain_margin_db, large.delay_margin_s) == (math.inf, 0.0)
    assert large.gain_reduction_margin_db == pytest.approx(-20.0 * math.log10(2.0), rel=1e-12)


# --- special cases ---------------------------------------------------------------------------------------------------


def test_no_controller_is_an_error() -> None:
    with pytest.raises(DomainError, match="kp = ki = 0"):
        margins(FoPi(0.0, 0.0, 1.0), LAG)


@pytest.mark.parametrize("kp", [1.0, 2.0, 0.5])
def test_a_loop_of_a_constant_has_no_crossings(kp: float) -> None:
    found = margins(FoPi(kp, 0.0, 1.0), Plant((1.0,), (1.0,)))
    assert found.gain_crossovers_rad_s == ()
    assert found.gain_margin_db == math.inf


@pytest.mark.parametrize("excess", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_a_peak_a_hair_above_one_gives_its_close_pair_of_crossovers(excess: float) -> None:
    # |1/((jw)^2 + 2 zeta jw + 1)|^2 k^2 = 1: w^2 = 1 - 2 zeta^2 -+ sqrt(k^2 - 4 zeta^2 (1 - zeta^2))
    zeta = 0.05
    k = 2.0 * zeta * math.sqrt(1.0 - zeta**2) * (1.0 + excess)
    found = margins(FoPi(k, 0.0, 1.0), Plant((1.0,), (1.0, 2.0 * zeta, 1.0))).gain_crossovers_rad_s
    root = math.sqrt(k**2 - (2.0 * zeta) ** 2 * (1.0 - zeta**2))
    expected = [math.sqrt(1.0 - 2.0 * zeta**2 - root), math.sqrt(1.0 - 2.0 * zeta**2 + root)]
    assert len(found) == 2
    # Rounding of |L| (1e-15) moves a root by 1e-15 over the slope, which vanishes with the pair's distance.
    assert found == pytest.approx(expected, rel=1e-14 / root)
    below = k / (1.0 + excess) * (1.0 - excess)
    assert margins(FoPi(below, 0.0, 1.0), Plant((1.0,), (1.0, 2.0 * zeta, 1.0))).gain_crossovers_rad_s == ()


# --- dead time -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [1.0, 100.0, 1e4, 1e6])
def test_a_dead_time_long_against_the_lag_still_has_its_first_crossing(delay: float) -> None:
    found = margins(FoPi(0.1, 0.5 / delay, 1.0), Plant((1.0,), (1.0, 1.0), delay))
    omega = found.gain_margin_rad_s
    assert omega is not None
    c = 0.1 + 0.5 / delay / (1j * omega)
    assert np.angle(c) - math.atan(omega) - omega * delay == pytest.approx(-math.pi, abs=1e-9)
    assert found.gain_margin_db == pytest.approx(-20 * math.log10(abs(c) / math.hypot(1.0, omega)), rel=1e-9)


def test_a_static_plant_with_dead_time_lists_its_first_crossings_and_its_limit() -> None:
    loops = loops_of(FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0,), 100.0))
    found = phase_crossovers(loops)
    assert found.omega_rad_s[0] == pytest.approx(math.pi / 100.0, rel=1e-12)
    assert found.omega_rad_s[-1] == math.inf
    np.testing.assert_allclose(found.gain, 0.5, rtol=1e-12)
    assert margins(FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0,), 100.0)).gain_margin_db == pytest.approx(6.0206, abs=1e-4)


def test_a_gain_that_rises_to_its_limit_around_a_dead_time_has_the_margin_of_the_limit() -> None:
    # |(s + 1)/(s + 2)| rises from 1/2 to 1: no finite crossing is the worst.
    found = margins(FoPi(0.5, 0.0, 1.0), Plant((1.0, 1.0), (1.0, 2.0), 0.5))
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), rel=1e-12)
    assert found.gain_margin_rad_s == math.inf


def test_a_gain_that_falls_to_its_limit_around_a_dead_time_has_a_finite_worst_crossing() -> None:
    found = margins(FoPi(0.5, 0.0, 1.0), Plant((1.0, 2.0), (1.0, 4.0 / 3.0), 0.5))
    assert found.gain_margin_rad_s is not None
    assert math.isfinite(found.gain_margin_rad_s)


def test_millions_of_turns_are_refused_with_a_reason() -> None:
    with pytest.raises(DomainError, match="dead time"):
        margins(FoPi(30.0, 1e-3, 0.5), Plant((1.0,), (1.0, 1.0), 1e7))


# --- invariances and extremes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [0.01, 0.1, 1.9, 1.999])
def test_extreme_orders_have_their_closed_form_crossover(alpha: float) -> None:
    # |ki (jw)^-alpha/(jw)| = 1: w = ki^(1/(1 + alpha)), arg L = -90 - 90 alpha; stable if alpha < 1
    found = margins(FoPi(0.0, 3.0, alpha), Plant((1.0,), (1.0, 0.0)))
    assert found.crossover_rad_s == pytest.approx(3.0 ** (1.0 / (1.0 + alpha)), rel=1e-12)
    assert found.angles_from_minus_one_deg == pytest.approx((90.0 - 90.0 * alpha,), abs=1e-9)
    assert found.stable == (alpha < 1.0)
    assert found.phase_margin_deg == (pytest.approx(90.0 - 90.0 * alpha, abs=1e-9) if alpha < 1.0 else None)


def test_coefficients_over_many_decades_keep_the_crossover() -> None:
    # (1e12)/((1e-12 s + 1)(s + 1e12)) with kp = 2: w where |1 + jw 1e-12| = sqrt 2 each ... |L| = 2/(1 + (w 1e-12)^2)
    found = margins(FoPi(2.0, 0.0, 1.0), Plant((1e12,), (1e-12, 2.0, 1e12)))
    assert found.crossover_rad_s == pytest.approx(1e12, rel=1e-9)
    assert found.phase_margin_deg == pytest.approx(90.0, abs=1e-7)


def test_an_undamped_plant_has_finite_crossovers_and_no_warning() -> None:
    controller, plant = FoPi(0.1, 0.05, 0.5), Plant((1.0,), (1.0, 0.0, 1.0))
    omega = np.array(margins(controller, plant).gain_crossovers_rad_s)
    assert len(omega) == 3
    size = np.abs(0.1 + 0.05 * (1j * omega) ** -0.5) / np.abs(1.0 - omega**2)
    np.testing.assert_allclose(size, 1.0, rtol=1e-10)
