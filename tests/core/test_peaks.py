"""Global extremes of |S|, |T|, |CS|, |PS| and |L| against dense scans, limits and closed forms."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.peaks import Response, Tilt, extremes, log_response_at
from fopi_tune.core.plant import Plant
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.digital import sections_of
from fopi_tune.spec.model import DigitalSpec

S, T, CS, L, PS = (
    Response.SENSITIVITY,
    Response.COMPLEMENTARY_SENSITIVITY,
    Response.CONTROL_SENSITIVITY,
    Response.LOOP_GAIN,
    Response.LOAD_SENSITIVITY,
)


def found(
    controller: FoPi, plant: Plant, response: Response, low: float = 0.0, high: float = math.inf, largest: bool = True
) -> tuple[float, float]:
    result = extremes(Loops.of(controller, Plants.of(plant)), response, low, high, largest)
    return float(result.value[0]), float(result.omega_rad_s[0])


def direct(controller: FoPi, plant: Plant, response: Response, omega: np.ndarray) -> np.ndarray:
    """ln of the response, written down anew."""
    s = 1j * omega
    c = controller.kp + controller.ki * s**-controller.alpha
    p = np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)
    loop = c * p
    value = {S: 1.0 / (1.0 + loop), T: loop / (1.0 + loop), CS: c / (1.0 + loop), PS: p / (1.0 + loop), L: loop}[
        response
    ]
    return np.log(np.abs(value))


def scanned(controller: FoPi, plant: Plant, response: Response, low: float, high: float, sign: float) -> float:
    """The largest sign * ln on a dense grid, refined around its best few points."""
    grid = np.linspace(math.log(low), math.log(high), 20_001)
    if plant.dead_time_s > 0.0:
        turns = np.arange(low, min(high, 300.0 / plant.dead_time_s), 0.01 / plant.dead_time_s)
        grid = np.unique(np.concatenate([grid, np.log(turns)]))
    value = sign * direct(controller, plant, response, np.exp(grid))
    best = float(value.max())
    for k in np.argsort(value)[-20:]:
        a, b = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
        for _ in range(4):
            fine = np.linspace(a, b, 101)
            inner = sign * direct(controller, plant, response, np.exp(fine))
            q = int(np.argmax(inner))
            best = max(best, float(inner[q]))
            a, b = fine[max(q - 1, 0)], fine[min(q + 1, 100)]
    return sign * best


def random_loop(rng: np.random.Generator, delayed: bool) -> tuple[FoPi, Plant]:
    order = int(rng.integers(1, 5))
    poles: list[complex] = []
    while len(poles) < order:
        size = 10.0 ** rng.uniform(-1, 1)
        if order - len(poles) >= 2 and rng.random() < 0.6:
            zeta = 10.0 ** rng.uniform(-3, 0)
            poles += [size * (-zeta + 1j * math.sqrt(1 - zeta**2)), size * (-zeta - 1j * math.sqrt(1 - zeta**2))]
        else:
            poles.append(rng.choice([-size, -size, -size, size, 0.0]))
    zeros = rng.choice([-1, -1, 1], int(rng.integers(0, order + 1))) * 10.0 ** rng.uniform(-1, 1)
    numerator = np.atleast_1d(np.real(np.poly(zeros))) * 10.0 ** rng.uniform(-1, 1)
    gains = 10.0 ** rng.uniform(-1, 1, 2) * rng.choice([1, 1, 1, -1], 2)
    delay = 10.0 ** rng.uniform(-2, 0) if delayed else 0.0
    plant = Plant(tuple(numerator.tolist()), tuple(np.real(np.poly(poles)).tolist()), delay)
    return FoPi(gains[0], gains[1], rng.uniform(0.1, 1.9)), plant


def assert_scans_agree(loops: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for k in range(loops):
        controller, plant = random_loop(rng, delayed=bool(k % 2))
        low, high = 10.0 ** rng.uniform(-3, 0), 10.0 ** rng.uniform(0.1, 2)
        for response in Response:
            for largest in (True, False):
                value, omega = found(controller, plant, response, low, high, largest)
                expected = scanned(controller, plant, response, low, high, 1.0 if largest else -1.0)
                # Never beyond the truth by more than rounding, never short of what the scan saw.  The factors' roots
                # cost 1e-8 at a resonance of damping 1e-3.
                assert value == pytest.approx(expected, abs=2e-7), (controller, plant, response, largest, low, high)
                assert low * (1 - 1e-12) <= omega <= high * (1 + 1e-12)
                at = direct(controller, plant, response, np.array([omega]))[0]
                assert at == pytest.approx(value, abs=2e-7)


@pytest.mark.long
def test_bands_of_random_loops_agree_with_dense_scans() -> None:
    assert_scans_agree(10, seed=1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 8))
def test_bands_of_many_random_loops_agree_with_dense_scans(seed: int) -> None:
    assert_scans_agree(200, seed)


def test_all_frequencies_are_at_least_as_extreme_as_any_band() -> None:
    rng = np.random.default_rng(9)
    for k in range(8):
        controller, plant = random_loop(rng, delayed=bool(k % 2))
        for response in Response:
            for largest in (True, False):
                sign = 1.0 if largest else -1.0
                everywhere = sign * found(controller, plant, response, largest=largest)[0]
                band = sign * scanned(controller, plant, response, 1e-4, 1e4, sign)
                assert everywhere >= band - 2e-7, (controller, plant, response, largest)


# --- the load's response ---------------------------------------------------------------------------------------------


def test_a_proportional_gain_on_an_integrator_leaves_the_inverse_gain_of_a_slow_load() -> None:
    # P S = 1/(s + kp)
    assert found(FoPi(2.5, 0.0, 1.0), Plant((1.0,), (1.0, 0.0)), PS) == (pytest.approx(-math.log(2.5), abs=1e-12), 0.0)


def test_a_pi_that_cancels_a_lag_leaves_a_load_with_its_closed_form_peak() -> None:
    # P = k/(tau s + 1), C = kp (1 + 1/(tau s)):  P S = k tau s/((tau s + 1)(tau s + k kp)), largest at sqrt(k kp)/tau
    k, tau, kp = 2.0, 3.0, 1.4
    value, omega = found(FoPi(kp, kp / tau, 1.0), Plant((k,), (tau, 1.0)), PS)
    # the search divides cells until their bound is within 1e-10 of the best value
    assert value == pytest.approx(math.log(k / (1.0 + k * kp)), abs=1e-9)
    assert omega == pytest.approx(math.sqrt(k * kp) / tau, rel=1e-4)


def test_the_loads_response_vanishes_at_both_ends_behind_an_integral_and_a_lag() -> None:
    for dead_time_s in (0.0, 0.7):
        value, omega = found(FoPi(1.0, 0.5, 1.2), Plant((1.0,), (2.0, 1.0), dead_time_s), PS, largest=False)
        assert value == -math.inf
        assert omega in (0.0, math.inf)


# --- closed forms and published numbers ----------------------------------------------------------------------------


def test_simc_pi_has_its_published_maximum_sensitivity() -> None:
    value, _ = found(FoPi(0.5, 0.0625, 1.0), Plant((1.0,), (1.0, 0.0), 1.0), S)
    assert math.exp(value) == pytest.approx(1.7035, abs=5e-5)


def test_the_published_throttle_gains_have_the_recomputed_sensitivity() -> None:
    value, omega = found(FoPi(0.09, 0.025, 0.8), Plant((4.39,), (1.0, 0.1746)), S, high=0.035)
    assert 20.0 * value / math.log(10.0) == pytest.approx(-20.246, abs=5e-4)
    assert omega == pytest.approx(0.035, rel=1e-12)


@pytest.mark.parametrize("zeta", [0.5, 0.1, 1e-2, 1e-3, 1e-5])
def test_a_resonance_of_any_sharpness_has_its_closed_form_peak(zeta: float) -> None:
    # The open loop: 1/(2 zeta sqrt(1 - zeta^2)) at sqrt(1 - 2 zeta^2).
    value, omega = found(FoPi(1.0, 0.0, 1.0), Plant((1.0,), (1.0, 2 * zeta, 1.0)), L, 1e-3, 1e3)
    # A root of relative error 1e-16 moves a damping of 1e-5 by 1e-11 relative.
    assert value == pytest.approx(-math.log(2 * zeta * math.sqrt(1 - zeta**2)), abs=1e-9)
    assert omega == pytest.approx(math.sqrt(1 - 2 * zeta**2), abs=1e-4 * zeta)


@pytest.mark.parametrize("zeta", [0.3, 0.01, 1e-4])
def test_the_closed_loop_of_an_integrating_plant_has_its_closed_form_peak(zeta: float) -> None:
    # k/(s (s + a)): T = wn^2/(s^2 + 2 zeta wn s + wn^2)
    wn = 3.0
    value, _ = found(FoPi(wn**2, 0.0, 1.0), Plant((1.0,), (1.0, 2 * zeta * wn, 0.0)), T)
    assert value == pytest.approx(-math.log(2 * zeta * math.sqrt(1 - zeta**2)), abs=1e-8)


@pytest.mark.parametrize("response", [S, T])
def test_a_proportional_loop_with_dead_time_has_its_peak_at_the_phase_crossover_region(response: Response) -> None:
    controller, plant = FoPi(0.9, 0.0, 1.0), Plant((1.0,), (1.0,), 2.0)
    # |1 + 0.9 e^{-2jw}| is 0.1 at every odd multiple of pi/2.
    peak = {S: -math.log(0.1), T: math.log(0.9) - math.log(0.1)}[response]
    assert found(controller, plant, response)[0] == pytest.approx(peak, abs=1e-9)
    assert found(controller, plant, response, 0.1, 2.0)[0] == pytest.approx(peak, abs=1e-9)
    assert found(controller, plant, response, 0.1, 2.0)[1] == pytest.approx(math.pi / 2.0, rel=1e-5)


# --- limits --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [0.1, 0.55, 1.0, 1.5])
def test_an_integral_makes_s_vanish_t_one_and_cs_one_over_the_static_gain_at_low_frequency(alpha: float) -> None:
    controller, plant = FoPi(0.5, 0.2, alpha), Plant((2.5,), (3.0, 1.0))
    assert found(controller, plant, S, high=1e-20, largest=False) == (-math.inf, 0.0)
    value, omega = found(controller, plant, T, high=1e-300)
    assert (value, omega) == (pytest.approx(0.0, abs=1e-9), 0.0)
    loops = Loops.of(controller, Plants.of(plant))
    row = np.array([0])
    assert log_response_at(loops, T, row, np.array([1e-90]))[0] == pytest.approx(0.0, abs=1e-7)
    assert log_response_at(loops, CS, row, np.array([1e-90]))[0] == pytest.approx(-math.log(2.5), abs=1e-7)


def test_a_well_damped_loop_has_its_largest_t_at_zero_frequency_and_it_is_one() -> None:
    value, omega = found(FoPi(0.3, 1.0 / 3.0, 1.0), Plant((1.0,), (0.9, 1.0)), T)
    assert value == pytest.approx(0.0, abs=1e-12)
    assert omega == 0.0


def test_a_strictly_proper_loop_has_s_one_and_cs_kp_at_high_frequency() -> None:
    controller, plant = FoPi(4.0, 0.1, 0.5), Plant((1.0,), (1.0, 1.0))
    proportional = FoPi(4.0, 0.0, 0.5)
    assert found(proportional, plant, S) == (pytest.approx(0.0, abs=1e-12), math.inf)
    value, omega = found(proportional, plant, CS)
    assert value == pytest.approx(math.log(4.0), abs=1e-9)
    assert omega == math.inf
    assert found(controller, plant, T, largest=False) == (-math.inf, math.inf)
    assert found(controller, plant, L) == (math.inf, 0.0)


def test_a_biproper_plant_has_its_limit_at_high_frequency() -> None:
    # 1 + kp P(inf) = 1 + 2 * 3
    value, omega = found(FoPi(2.0, 1.0, 0.5), Plant((3.0, 1.0), (1.0, 4.0)), S, 1e6)
    assert value == pytest.approx(-math.log(7.0), abs=2e-3)
    assert found(FoPi(2.0, 0.0, 0.5), Plant((3.0, 12.0), (1.0, 4.0)), S)[0] == pytest.approx(-math.log(7.0), abs=1e-9)
    assert omega > 0.0


def test_a_direct_path_around_a_dead_time_has_its_limit_superior() -> None:
    controller, plant = FoPi(0.5, 0.1, 1.0), Plant((1.0, 1.0), (1.0, 2.0), 0.5)
    assert found(controller, plant, S) == (pytest.approx(math.log(2.0), abs=1e-9), math.inf)
    assert found(FoPi(1.0, 0.5, 1.0), Plant((1.0, 2.0), (1.0, 1.0), 0.5), S) == (math.inf, math.inf)


def test_a_static_plant_under_proportional_control_is_flat() -> None:
    for response, expected in ((S, -math.log(3.0)), (T, math.log(2 / 3)), (CS, math.log(2 / 3)), (L, math.log(2.0))):
        for largest in (True, False):
            value, _ = found(FoPi(2.0, 0.0, 1.0), Plant((1.0,), (1.0,)), response, largest=largest)
            assert value == pytest.approx(expected, abs=1e-12)


def test_a_zero_at_the_origin_keeps_s_at_one_or_gives_its_limit() -> None:
    controller, plant = FoPi(1.0, 0.0, 0.8), Plant((1.0, 0.0), (1.0, 2.0, 1.0))
    # L = jw/(1 + jw)^2 is 1/2 at w = 1.
    value, omega = found(controller, plant, S, largest=False)
    assert (value, omega) == (pytest.approx(-math.log(1.5), abs=1e-9), pytest.approx(1.0, rel=1e-4))
    assert found(controller, plant, T, largest=True)[0] == pytest.approx(-math.log(3.0), abs=1e-9)
    assert found(FoPi(1.0, 1.0, 0.8), plant, CS) == (math.inf, 0.0)
    # alpha = 1: L(0) = ki * 1, a finite limit
    value, omega = found(FoPi(1e-9, 3.0, 1.0), plant, T, high=1e-6)
    assert (value, omega) == (pytest.approx(math.log(0.75), abs=1e-8), 0.0)


def test_a_loop_through_minus_one_has_an_enormous_sensitivity() -> None:
    assert found(FoPi(8.0, 0.0, 1.0), Plant((1.0,), (1.0, 3.0, 3.0, 1.0)), S)[0] > 18.0
    assert found(FoPi(-1.0, 0.0, 1.0), Plant((1.0,), (1.0, 1.0)), S) == (math.inf, 0.0)


# --- bands ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("low", "high"), [(1e-12, 1e-9), (1e7, 1e9), (0.0, 1e-9), (1e9, math.inf), (2.0, 2.0)])
def test_a_band_in_a_tail_or_a_single_point_takes_its_ends(low: float, high: float) -> None:
    controller, plant = FoPi(0.5, 0.6, 0.55), Plant((1.0,), (2.35, 1.0))
    for response in Response:
        ends = np.array([max(low, 1e-30), min(high, 1e30)])
        values = direct(controller, plant, response, ends)
        top = found(controller, plant, response, low, high)
        bottom = found(controller, plant, response, low, high, largest=False)
        assert low <= top[1] * (1 + 1e-12)
        assert top[1] <= high * (1 + 1e-12)
        if low > 0.0 and high < math.inf:
            # Monotone in the tails.
            assert top[0] == pytest.approx(values.max(), abs=1e-9)
            assert bottom[0] == pytest.approx(values.min(), abs=1e-9)
        else:
            assert top[0] >= values.max() - 1e-9
            assert bottom[0] <= values.min() + 1e-9


def test_a_sharp_peak_just_outside_the_band_is_left_out() -> None:
    plant = Plant((1.0,), (1.0, 2e-4, 1.0))
    inside = found(FoPi(0.01, 0.0, 1.0), plant, L, 0.9, 1.1)[0]
    outside = found(FoPi(0.01, 0.0, 1.0), plant, L, 1.01, 1.1)
    assert inside == pytest.approx(math.log(0.01 / 2e-4), abs=1e-6)
    assert outside[1] == pytest.approx(1.01, rel=1e-12)
    assert outside[0] < inside - 3.0


@pytest.mark.parametrize("high", [1e-4, 0.02, 0.3, 5.0])
def test_many_rows_give_what_each_gives_alone(high: float) -> None:
    rng = np.random.default_rng(4)
    tau = rng.uniform(0.5, 5.0, 30)
    plants = Plants(np.ones((30, 1)), np.stack([tau, np.ones(30)], axis=1), rng.choice([0.0, 0.4], 30))
    loops = Loops(rng.uniform(0.1, 2, 30), rng.uniform(0.1, 2, 30), rng.uniform(0.3, 1.4, 30), plants)
    together = extremes(loops, S, 0.0, high)
    for row in range(30):
        alone = extremes(loops.take(np.array([row])), S, 0.0, high)
        assert together.value[row] == pytest.approx(alone.value[0], abs=1e-9)


# --- dead time and extremes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [1.0, 100.0, 1e4, 1e6])
def test_a_dead_time_long_against_the_lag_is_searched_in_reasonable_time(delay: float) -> None:
    controller, plant = FoPi(0.1, 0.5 / delay, 1.0), Plant((1.0,), (1.0, 1.0), delay)
    start = time.process_time()
    value, omega = found(controller, plant, S)
    # 10 ms measured; tails that are not closed take minutes
    assert time.process_time() - start < 10.0
    expected = scanned(controller, plant, S, 0.01 / delay, 100.0 / delay, 1.0)
    assert value == pytest.approx(expected, abs=1e-8)
    assert 0.1 < omega * delay < 10.0


def test_thousands_of_turns_below_the_crossover_still_give_the_peak() -> None:
    controller, plant = FoPi(3.0, 0.005, 1.0), Plant((1.0,), (1.0, 1.0), 1e4)
    value, omega = found(controller, plant, S)
    assert value == pytest.approx(direct(controller, plant, S, np.array([omega]))[0], abs=1e-6)
    # Near the crossover sqrt 8 the phase takes every value within 6e-4 rad/s.
    assert omega == pytest.approx(math.sqrt(8.0), rel=1e-3)
    near = np.linspace(0.998 * omega, 1.002 * omega, 400_001)
    # Sharp: one turn is 45 grid points, so that the scan falls short of the peak itself.
    assert value >= direct(controller, plant, S, near).max() - 1e-9


@pytest.mark.parametrize("alpha", [0.01, 0.1, 1.9, 1.999])
@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_extreme_orders_give_no_warning_and_agree_with_a_scan(alpha: float, delay: float) -> None:
    controller, plant = FoPi(0.5, 0.5, alpha), Plant((1.0,), (1.0, 1.0), delay)
    for response in Response:
        value, _ = found(controller, plant, response, 1e-3, 1e2)
        assert value == pytest.approx(scanned(controller, plant, response, 1e-3, 1e2, 1.0), abs=1e-8)
        assert not math.isnan(found(controller, plant, response)[0])
        assert not math.isnan(found(controller, plant, response, largest=False)[0])


@pytest.mark.parametrize(
    "plant",
    [
        Plant((1.0,), (1.0, 0.0, 1.0)),
        Plant((1.0, 0.0, 1.0), (1.0, 2.0, 1.0)),
        Plant((1.0,), (1.0, 0.0, 0.0)),
        Plant((1.0,), tuple(np.poly([-1.0] * 12))),
        Plant((1e12,), (1e-12, 1.0, 1e12)),
        Plant((1.0, 0.0, 1.0), (1.0, 2.0, 1.0, 0.0), 0.2),
    ],
)
def test_awkward_plants_give_no_warning_and_no_nan(plant: Plant) -> None:
    for response in Response:
        for largest in (True, False):
            assert not math.isnan(found(FoPi(0.7, 0.3, 0.6), plant, response, largest=largest)[0])


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.floats(-9.0, 9.0), st.floats(-6.0, 6.0))
def test_the_units_of_time_and_gain_change_no_peak_of_s_and_t(seed: int, log_time: float, log_gain: float) -> None:
    rng = np.random.default_rng(seed)
    controller, plant = random_loop(rng, delayed=bool(seed % 2))
    unit, gain = 10.0**log_time, 10.0**log_gain
    n, m = len(plant.denominator) - 1, len(plant.numerator) - 1
    scaled = Plant(
        tuple((np.array(plant.numerator) * gain * unit ** np.arange(m, -1.0, -1.0)).tolist()),
        tuple((np.array(plant.denominator) * unit ** np.arange(n, -1.0, -1.0)).tolist()),
        plant.dead_time_s * unit,
    )
    other = FoPi(controller.kp / gain, controller.ki / gain / unit**controller.alpha, controller.alpha)
    for response, offset in ((S, 0.0), (T, 0.0), (CS, -math.log(gain))):
        value, _ = found(controller, plant, response, 1e-2, 1e2)
        again, _ = found(other, scaled, response, 1e-2 / unit, 1e2 / unit)
        # The two searches may stop 1e-10 apart; a damping of 1e-3 enlarges the roots' rounding.
        assert again == pytest.approx(value + offset, abs=1e-7)


# --- along a line over ln omega ---------------------------------------------------------------------------------------


def test_extremes_along_a_line_agree_with_dense_scans() -> None:
    rng = np.random.default_rng(21)
    for k in range(6):
        controller, plant = random_loop(rng, delayed=bool(k % 2))
        low, high = 10.0 ** rng.uniform(-2, 0), 10.0 ** rng.uniform(0.1, 1.5)
        tilt = Tilt(float(rng.uniform(-2.0, 2.0)), low)
        grid = np.geomspace(low, high, 40_001)
        for response in Response:
            values = direct(controller, plant, response, grid) - tilt.power * np.log(grid / low)
            for largest in (True, False):
                loops = Loops.of(controller, Plants.of(plant))
                result = extremes(loops, response, low, high, largest, tilt)
                best = float(values.max() if largest else values.min())
                # a grid of 2e-4 in u stops short of a peak; that of a resonance of damping 1e-3 bends by 1e6
                short = (float(result.value[0]) - best) * (1.0 if largest else -1.0)
                assert -2e-7 <= short < 2e-2, (controller, plant, response, largest)
                omega = float(result.omega_rad_s[0])
                at = direct(controller, plant, response, np.array([omega]))[0] - tilt.power * math.log(omega / low)
                assert at == pytest.approx(float(result.value[0]), abs=2e-7)


def test_extremes_along_a_line_agree_with_dense_scans_on_samples() -> None:
    rng = np.random.default_rng(22)
    for k in range(4):
        tau, late = float(rng.uniform(0.5, 3.0)), float(rng.uniform(0.0, 0.4))
        implementation = Implementation(sections_of(FoPi(1.2, 0.8, 0.8), DigitalSpec(0.2)), 0.0)
        plants = Plants(np.ones((1, 1)), np.array([[tau, 1.0]]), np.array([late]))
        loops = SampledLoops.implemented(FoPi(1.2, 0.8, 0.8), implementation, plants)
        low, high = 0.05, 15.0
        tilt = Tilt(float(rng.uniform(-2.0, 2.0)), low)
        grid = np.geomspace(low, high, 20_001)
        for response in Response:
            values = log_response_at(loops, response, np.zeros(len(grid), dtype=int), grid)
            values = values - tilt.power * np.log(grid / low)
            for largest in (True, False):
                result = extremes(loops, response, low, high, largest, tilt)
                best = float(values.max() if largest else values.min())
                short = (float(result.value[0]) - best) * (1.0 if largest else -1.0)
                # a grid of 3e-4 in u stops 1e-7 short of peaks that bend by 10
                assert -1e-9 <= short < 1e-6, (k, response, largest)
