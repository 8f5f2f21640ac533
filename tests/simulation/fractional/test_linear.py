"""The reference simulators of the exact fractional loop: against closed forms, mpmath, scipy, and one another."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lti, step
from scipy.special import erfcx, gamma

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import Plant
from fopi_tune.core.stability import is_stable, unstable_closed_loop_poles
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.commensurate import commensurate_model, step_response
from fopi_tune.simulation.fractional.inversion import LineBounds, invert_on_bent_line, invert_on_hyperbola
from fopi_tune.simulation.fractional.linear import (
    LoopTransform,
    Signal,
    Stimulus,
    exact_response,
    response_and_error,
    response_by_steps,
    response_on_bent_line,
)
from fopi_tune.simulation.fractional.poles import principal_poles
from fopi_tune.simulation.fractional.quadrature import matrix_exponentials
from fopi_tune.simulation.fractional.time_stepping import InitialState, simulate_fractional

Array = NDArray[np.float64]
OUTPUT, CONTROL, LOAD = Signal.OUTPUT_AFTER_REFERENCE, Signal.CONTROL_AFTER_REFERENCE, Signal.OUTPUT_AFTER_LOAD
BRAKE = Plant((1.0,), (2.35, 1.0))
PAPER = FoPi(0.5, 0.6, 0.55)
TIMES = np.geomspace(1e-3, 1e4, 15)


def is_stable_loop(gains: FoPi, plant: Plant) -> bool:
    return bool(is_stable(Loops.of(gains, Plants.of(plant)))[0])


def random_loops(seed: int, wanted: int, delayed: bool, stable: bool = True) -> list[tuple[FoPi, Plant]]:
    """Loops with lags, integrators, undamped pairs, zeros on either side, direct paths and kp = 0 among them."""
    rng = np.random.default_rng(seed)
    loops: list[tuple[FoPi, Plant]] = []
    while len(loops) < wanted:
        denominator = np.poly(np.where(rng.random(2) < 0.2, 0.0, -(10 ** rng.uniform(-1, 1, 2))))
        if rng.random() < 0.5:
            omega, damping = 10 ** rng.uniform(-0.5, 0.5), rng.choice([0.0, 0.01, 0.1, 0.5])
            denominator = np.polymul([1.0, 10 ** rng.uniform(-1, 1)], [1.0, 2 * damping * omega, omega**2])
        zeros = rng.choice([-1.0, 1.0], rng.integers(0, len(denominator)), p=[0.8, 0.2])
        numerator = np.atleast_1d(np.poly(zeros * 10 ** rng.uniform(-1, 1, len(zeros)))) * 10 ** rng.uniform(-1, 1)
        dead_time = float(10 ** rng.uniform(-2, 0.5)) if delayed else 0.0
        kp = float(rng.choice([0.0, 1.0]) * 10 ** rng.uniform(-1.5, 0.5))
        alpha = float(rng.choice([1.0, rng.uniform(0.05, 1.95)]))
        gains = FoPi(kp, float(10 ** rng.uniform(-1.5, 0.5)), alpha)
        plant = Plant(tuple(numerator.tolist()), tuple(denominator.tolist()), dead_time)
        if is_stable_loop(gains, plant) == stable:
            loops.append((gains, plant))
    return loops


def loop_transform(gains: FoPi, plant: Plant, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """C P/(1 + C P)/s, written as in a textbook."""
    n, d = np.polyval(plant.numerator, s), np.polyval(plant.denominator, s)
    open_loop = (gains.kp + gains.ki * s**-gains.alpha) * n / d * np.exp(-plant.dead_time_s * s)
    return open_loop / (1.0 + open_loop) / s


# --- oracles: published numbers, closed forms, other tools -------------------------------------------------------


def test_the_papers_brake_answers_as_published() -> None:
    published = [0.7414991568, 0.8489558463, 0.9325752066, 0.9809026356]
    # the numbers have ten digits
    assert exact_response(PAPER, BRAKE, OUTPUT, [5, 20, 100, 1000]) == pytest.approx(published, abs=6e-11)


def test_a_half_order_lag_is_one_less_a_scaled_complementary_error_function() -> None:
    times = np.geomspace(1e-6, 1e6, 25)
    answer = invert_on_hyperbola(lambda s: 1 / (s * (s**0.5 + 1)), times)
    # 10 roundings of e^{mu (1 - sin phi)}
    assert answer.value == pytest.approx(1 - erfcx(np.sqrt(times)), rel=1e-12, abs=1e-15)
    assert invert_on_hyperbola(lambda s: 1 / (s * (s**0.5 + 1)), [1.0]).value[0] == pytest.approx(
        0.5724164238, abs=6e-11
    )


@pytest.mark.parametrize("beta", [0.1, 0.9, 1.5, 2.9])
def test_a_power_of_s_is_a_power_of_t(beta: float) -> None:
    times = np.array([1e-9, 1.0, 1e9])
    assert invert_on_hyperbola(lambda s: s**-beta, times).value == pytest.approx(
        times ** (beta - 1) / gamma(beta), rel=1e-12
    )


def test_named_poles_and_the_bent_line_both_give_a_damped_oscillation() -> None:
    times, poles = np.array([0.01, 1.0, 20.0, 300.0]), np.array([-0.01 + 3j, -0.01 - 3j])
    closed = np.exp(-0.01 * times) * np.sin(3 * times) / 3

    def transform(s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return 1 / ((s + 0.01) ** 2 + 9)

    assert invert_on_hyperbola(transform, times, poles, np.array([-1j / 6, 1j / 6])).value == pytest.approx(
        closed, abs=1e-12
    )
    # rounding of e^{7.3} on the line
    assert invert_on_bent_line(transform, times, LineBounds(0.0, 4.0)).value == pytest.approx(closed, abs=1e-11)


@pytest.mark.parametrize(
    "plant", [BRAKE, Plant((2.0,), (1.0, 0.4, 1.0)), Plant((-1.0, 1.0), (1.0, 3.0, 2.0)), Plant((1.0, 3.0), (2.0, 1.0))]
)
def test_an_ordinary_pi_is_the_rational_loop_of_scipy(plant: Plant) -> None:
    gains = FoPi(0.3, 0.2, 1.0)
    numerator = np.polymul([gains.kp, gains.ki], plant.numerator)
    denominator = np.polyadd(np.polymul([1.0, 0.0], plant.denominator), numerator)
    times = np.linspace(0.0, 40.0, 401)
    oracle = step(lti(numerator, denominator), T=times)[1]
    # scipy's own rounding over 400 steps
    assert exact_response(gains, plant, OUTPUT, times) == pytest.approx(oracle, abs=1e-9)


@pytest.mark.parametrize(
    ("gains", "plant", "time"),
    [
        (PAPER, BRAKE, 3.0),
        (FoPi(0.1, 0.7, 1.6), Plant((1.0,), (1.0, 1.5, 0.7)), 12.0),
        (FoPi(0.2, 0.3, 0.05), Plant((-0.5, 1.0), (1.0, 2.0, 1.0)), 4.0),
        (FoPi(0.2, 0.3, 1.3), Plant((1.0,), (1.0, 1.0), 0.5), 7.3),
    ],
)
def test_mpmath_agrees_at_twenty_digits(gains: FoPi, plant: Plant, time: float) -> None:
    def polynomial(coefficients: tuple[float, ...], s: Any) -> Any:
        return sum(c * s**k for k, c in enumerate(reversed(coefficients)))

    def transform(s: Any) -> Any:
        open_loop = (gains.kp + gains.ki * s**-gains.alpha) * polynomial(plant.numerator, s)
        open_loop *= mpmath.exp(-plant.dead_time_s * s) / polynomial(plant.denominator, s)
        return open_loop / (1 + open_loop) / s

    with mpmath.workdps(20):
        # de Hoog's method for the delayed loop, whose kinks limit it
        method, tolerance = ("dehoog", 1e-6) if plant.dead_time_s else ("talbot", 1e-12)
        oracle = float(mpmath.invertlaplace(transform, time, method=method))
    assert exact_response(gains, plant, OUTPUT, [time])[0] == pytest.approx(oracle, abs=tolerance)


def test_the_first_dead_times_of_an_integral_controller_are_powers_of_t() -> None:
    # kp = 0, P = e^{-s}: y = sum_k -(-ki)^k (t - k)^{k alpha}/Gamma(1 + k alpha)
    alpha, ki = 0.7, 0.4
    times = np.array([0.5, 0.999999, 1.0, 1.000001, 2.999999, 3.0, 3.000001, 5.5, 5.999999, 6.000001])
    closed = np.zeros_like(times)
    for k in range(1, 7):
        closed += np.where(
            times > k, -((-ki) ** k) * np.maximum(times - k, 0.0) ** (k * alpha) / gamma(1 + k * alpha), 0
        )
    assert exact_response(FoPi(0.0, ki, alpha), Plant((1.0,), (1.0,), 1.0), OUTPUT, times) == pytest.approx(
        closed, abs=1e-12
    )


def test_a_proportional_loop_around_a_pure_delay_jumps_at_every_dead_time() -> None:
    times = np.array([0.999999, 1.0, 1.5, 2.0, 2.5, 3.5, 50.5])
    closed = [0.0, 0.5, 0.5, 0.25, 0.25, 0.375, (0.5 + 0.5**51) / 1.5]
    assert exact_response(FoPi(0.5, 0.0, 0.5), Plant((1.0,), (1.0,), 1.0), OUTPUT, times) == pytest.approx(
        closed, abs=1e-12
    )


# --- one method against another ------------------------------------------------------------------------------------


@pytest.mark.thinned(2)
@pytest.mark.parametrize("signal", Signal)
def test_thirty_delayed_loops_are_answered_everywhere(signal: Signal) -> None:
    for gains, plant in random_loops(7, 10, delayed=True):
        answer = response_and_error(gains, plant, signal, TIMES)
        assert np.all(answer.error <= 1e-8 * np.abs(answer.value).max()), (gains, plant)


def test_steps_and_bent_line_meet_where_both_hold() -> None:
    # up to 6 dead times the response comes from the method of steps, then from the line: this line covers both
    for gains, plant in random_loops(8, 10, delayed=True):
        loop = LoopTransform(gains, plant, OUTPUT, Stimulus.STEP)
        times = plant.dead_time_s * np.array([4.5, 5.99, 6.0, 6.01, 8.0, 10.5])
        steps, beside = response_by_steps(loop, times), response_on_bent_line(loop, times)
        known = np.isfinite(beside.error)
        allowed = 10 * (steps.error + beside.error) + 1e-11
        assert np.all(np.abs(steps.value - beside.value)[known] <= allowed[known]), (gains, plant)


@pytest.mark.long
def test_thirty_loops_without_dead_time_agree_with_a_line_that_knows_no_poles() -> None:
    times = np.array([0.01, 0.3, 5.0, 60.0])
    for gains, plant in random_loops(9, 30, delayed=False):
        value = exact_response(gains, plant, OUTPUT, times)
        poles = principal_poles(gains, plant)
        beyond = 2.0 * float(np.abs(poles).max(initial=0.0)) + 1.0
        beside = invert_on_bent_line(
            lambda s, g=gains, p=plant: loop_transform(g, p, s), times, LineBounds(0.0, beyond)
        )
        assert value == pytest.approx(beside.value, abs=1e-10 * max(1.0, float(np.abs(value).max()))), (gains, plant)


def test_unstable_loops_without_dead_time_are_exact_too() -> None:
    times = np.array([0.1, 1.0, 4.0])
    for gains, plant in random_loops(10, 15, delayed=False, stable=False):
        value = exact_response(gains, plant, OUTPUT, times)
        poles = principal_poles(gains, plant)
        reach = LineBounds(float(poles.real.max(initial=0.0)), 2.0 * float(np.abs(poles).max(initial=0.0)) + 1.0)
        beside = invert_on_bent_line(lambda s, g=gains, p=plant: loop_transform(g, p, s), times, reach)
        assert value == pytest.approx(beside.value, abs=1e-9 * max(1.0, float(np.abs(value).max()))), (gains, plant)


def test_the_count_of_unstable_poles_is_nyquists() -> None:
    for gains, plant in random_loops(11, 15, delayed=False, stable=False):
        nyquist = unstable_closed_loop_poles(Loops.of(gains, Plants.of(plant)))[0]
        if math.isfinite(nyquist):
            assert (principal_poles(gains, plant).real > 0).sum() == nyquist, (gains, plant)


@pytest.mark.parametrize(("alpha", "states"), [(Fraction(4, 5), 9), (Fraction(9, 20), 29), (Fraction(3, 2), 5)])
def test_the_commensurate_model_has_the_papers_states_and_the_same_answer(alpha: Fraction, states: int) -> None:
    model = commensurate_model(0.5, 0.6, alpha, 1 / 2.35, 1 / 2.35)
    assert model.a.shape == (states, states)
    direct = exact_response(FoPi(0.5, 0.6, float(alpha)), BRAKE, OUTPUT, TIMES)
    assert step_response(model, TIMES).value == pytest.approx(direct, abs=1e-12)


def test_a_commensurate_model_that_makes_no_sense_is_refused() -> None:
    for alpha, ki in (
        (Fraction(2), 0.6),
        (Fraction(1, 2), 0.0),
        (Fraction(997, 1000), 0.6),
        (Fraction(1, 2), math.nan),
    ):
        with pytest.raises(DomainError):
            commensurate_model(0.5, ki, alpha, 1.0, 1.0)


# --- properties ------------------------------------------------------------------------------------------------------


def test_the_start_and_the_end_are_those_of_the_limit_theorems() -> None:
    biproper = Plant((3.0, 1.0), (2.0, 1.0))
    assert exact_response(PAPER, biproper, OUTPUT, [0.0])[0] == pytest.approx(0.75 / 1.75)
    assert exact_response(PAPER, biproper, CONTROL, [0.0, 1e-12])[1] == pytest.approx(0.5 / 1.75, abs=1e-5)
    assert exact_response(PAPER, BRAKE, OUTPUT, [0.0]) == [0.0]
    assert exact_response(PAPER, BRAKE, OUTPUT, [1e16])[0] == pytest.approx(1.0, abs=1e-8)
    assert exact_response(FoPi(0.5, 0.0, 1.0), BRAKE, OUTPUT, [1e6])[0] == pytest.approx(0.5 / 1.5, abs=1e-12)


@pytest.mark.parametrize("alpha", [0.3, 0.55, 0.8])
def test_the_tail_is_algebraic(alpha: float) -> None:
    # 1 - Y s ~ s^alpha/(ki P(0)), so e ~ t^-alpha/(ki P(0) Gamma(1 - alpha))
    left = 1 - exact_response(FoPi(0.5, 0.6, alpha), BRAKE, OUTPUT, [1e12])[0]
    first = 1e12**-alpha / (0.6 * gamma(1 - alpha))
    assert left == pytest.approx(first, rel=3 * 1e12**-alpha / 0.6 + 1e-13 / first)


def test_a_ramp_is_the_integral_of_a_step() -> None:
    for plant in (BRAKE, Plant((1.0,), (2.35, 1.0), 0.5)):
        nodes, weights = np.polynomial.legendre.leggauss(40)
        # from 4 s to 9 s, away from the kinks of the first dead times
        step_part = exact_response(PAPER, plant, OUTPUT, 6.5 + 2.5 * nodes) @ weights * 2.5
        ramp = exact_response(PAPER, plant, OUTPUT, [4.0, 9.0], Stimulus.RAMP)
        assert ramp[1] - ramp[0] == pytest.approx(step_part, abs=1e-7)


def test_scaling_time_scales_the_response() -> None:
    slow = exact_response(FoPi(0.5, 0.6 / 1000**0.55, 0.55), Plant((1.0,), (2350.0, 1.0), 500.0), OUTPUT, 1000 * TIMES)
    assert slow == pytest.approx(exact_response(PAPER, Plant((1.0,), (2.35, 1.0), 0.5), OUTPUT, TIMES), abs=1e-11)


def test_two_negative_signs_cancel() -> None:
    mirrored = exact_response(FoPi(-0.5, -0.6, 0.55), Plant((-1.0,), (2.35, 1.0)), OUTPUT, TIMES)
    assert mirrored == pytest.approx(exact_response(PAPER, BRAKE, OUTPUT, TIMES), abs=1e-14)


@pytest.mark.parametrize("alpha", [1e-3, 0.999999999, 1.000000001, 1.999])
def test_extreme_orders_are_answered(alpha: float) -> None:
    gains, plant = FoPi(0.5, 0.3, alpha), Plant((1.0,), (1.0, 2.0, 1.0))
    assert np.all(np.isfinite(exact_response(gains, plant, CONTROL, np.geomspace(1e-3, 30.0, 15))))


@pytest.mark.parametrize("dead_time", [0.0, 0.5])
def test_time_constants_twelve_decades_apart_are_answered(dead_time: float) -> None:
    plant = Plant((1e3,), tuple(np.polymul([1e-6, 1.0], [1e6, 1.0]).tolist()), dead_time)
    times = np.array([1e-7, 1e-3, 1.0, 1e3, 1e6, 1e9]) if not dead_time else np.array([0.6, 1.0, 4.0, 10.0, 1e3, 1e5])
    fast = exact_response(FoPi(1.0, 0.01, 0.5), plant, OUTPUT, times)
    if dead_time:
        one = Plant((1e3,), (1e6, 1.0), dead_time)
        # the fast lag of 1e-6 s shifts a slope of 1e-3 per second
        assert fast == pytest.approx(exact_response(FoPi(1.0, 0.01, 0.5), one, OUTPUT, times), abs=1e-8)
    assert np.all(np.diff(fast) > 0)


# --- refusals --------------------------------------------------------------------------------------------------------


def test_times_may_come_in_any_order_and_twice() -> None:
    shuffled = np.array([7.0, 0.0, 3.0, 7.0, 1e-3])
    for plant in (BRAKE, Plant((1.0,), (2.35, 1.0), 0.5)):
        alone = [exact_response(PAPER, plant, OUTPUT, [t])[0] for t in shuffled]
        assert exact_response(PAPER, plant, OUTPUT, shuffled) == pytest.approx(alone, abs=1e-12)


@pytest.mark.parametrize("times", [[-1.0], [math.nan], [math.inf], [[1.0]]])
def test_times_that_are_none_are_refused(times: object) -> None:
    with pytest.raises(DomainError, match="times_s"):
        exact_response(PAPER, BRAKE, OUTPUT, times)


def test_no_times_have_no_answers() -> None:
    assert exact_response(PAPER, Plant((1.0,), (1.0, 1.0), 1.0), OUTPUT, []).shape == (0,)


def test_an_unstable_delayed_loop_is_exact_for_some_dead_times_and_then_refused() -> None:
    gains, plant = FoPi(3.0, 1.0, 0.9), Plant((1.0,), (1.0, 1.0), 1.0)
    assert exact_response(gains, plant, OUTPUT, [1.5])[0] > 0
    with pytest.raises(DomainError, match="the loop is unstable"):
        exact_response(gains, plant, OUTPUT, [1e4])


def test_a_response_that_overflows_is_refused() -> None:
    with pytest.raises(DomainError, match="error of"):
        exact_response(FoPi(-3.0, -1.0, 0.9), BRAKE, OUTPUT, [1e4])


def test_a_loop_without_controller_or_without_answer_is_refused() -> None:
    with pytest.raises(DomainError, match="no controller"):
        exact_response(FoPi(0.0, 0.0, 0.5), BRAKE, OUTPUT, [1.0])
    with pytest.raises(DomainError, match="P\\(inf\\)"):
        exact_response(FoPi(-1.0, 0.5, 0.5), Plant((1.0, 2.0), (1.0, 1.0)), OUTPUT, [1.0])


def test_a_tolerance_looser_than_a_millionth_is_refused() -> None:
    with pytest.raises(DomainError, match="tolerance"):
        exact_response(PAPER, BRAKE, OUTPUT, [1.0], tolerance=1e-3)


# --- step by step ----------------------------------------------------------------------------------------------------


def orders(gains: FoPi, plant: Plant, signal: Signal = OUTPUT) -> Array:
    """Measured orders at t = 3, 5 and 8 s, from steps of 8/256 and 8/512 s, against the inverted transform."""
    errors = []
    for steps in (256, 512):
        at = steps * np.array([3, 5, 8]) // 8
        reference, load = (0.0, 1.0) if signal is LOAD else (1.0, 0.0)
        run = simulate_fractional(gains, plant, reference, 8.0 / steps, steps, load=load)
        seen = run.demand if signal is CONTROL else run.output
        errors.append(np.abs(seen[at] - exact_response(gains, plant, signal, run.time_s[at])))
    return np.log2(errors[0] / errors[1])


@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.55, 1.0, 1.4, 1.9])
def test_steps_are_of_second_order_for_every_alpha(alpha: float) -> None:
    # the error's next power of h is about h^(1 + 2 alpha) or h^3: 0.15 off at these steps
    assert orders(FoPi(0.5, 0.2, alpha), BRAKE) == pytest.approx(2.0, abs=0.15)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("signal", Signal)
@pytest.mark.parametrize("plant", [BRAKE, Plant((1.0,), (2.35, 1.0), 1.0), Plant((-0.2, 1.0), (1.0, 1.0, 1.0), 0.5)])
def test_steps_are_of_second_order_for_every_signal_with_and_without_dead_time(signal: Signal, plant: Plant) -> None:
    assert orders(FoPi(0.5, 0.3, 0.55), plant, signal) == pytest.approx(2.0, abs=0.15)


def test_a_direct_path_costs_order_down_to_one_plus_alpha() -> None:
    assert orders(FoPi(0.2, 0.3, 0.3), Plant((1.0, 1.0), (2.0, 1.0))) == pytest.approx(1.3, abs=0.1)


@pytest.mark.parametrize("lag_s", [1e-6, 1e6])
def test_a_lag_far_from_the_step_is_no_matter(lag_s: float) -> None:
    run = simulate_fractional(PAPER, Plant((1.0,), (lag_s, 1.0)), 1.0, 0.01, 800)
    exact = exact_response(PAPER, Plant((1.0,), (lag_s, 1.0)), OUTPUT, [2.0, 8.0])
    # the fast one acts as a direct path: order 1 + alpha at best
    assert run.output[[200, 800]] == pytest.approx(exact, rel=1e-3)
    assert run.output[[200, 800]] == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e7])
def test_the_matrix_exponential_is_scipys(scale: float) -> None:
    matrix = scale * np.array([[-1.0, 1.0, 0.0], [-3.0, 0.0, 1.0], [-2.0, 0.0, 0.0]])
    # 24 squarings of a stable matrix
    assert matrix_exponentials(matrix[None])[0] == pytest.approx(expm(matrix), abs=1e-9)


def test_held_references_and_loads_superpose() -> None:
    h, n = 0.01, 1000
    reference, load = np.zeros(n + 1), np.zeros(n + 1)
    reference[:300], reference[300:], load[550:] = 1.0, -0.5, 2.0
    run = simulate_fractional(PAPER, BRAKE, reference, h, n, load=load)
    at = np.array([200, 400, 600, 1000])
    t = run.time_s[at]
    exact = exact_response(PAPER, BRAKE, OUTPUT, t) - 1.5 * exact_response(PAPER, BRAKE, OUTPUT, np.maximum(t - 3.0, 0))
    exact += 2.0 * exact_response(PAPER, BRAKE, LOAD, np.maximum(t - 5.5, 0))
    # second order: (h/0.01)^2 times about 3e-6
    assert run.output[at] == pytest.approx(exact, abs=1e-5)


def test_a_continuous_reference_is_followed_as_a_ramp() -> None:
    run = simulate_fractional(PAPER, BRAKE, lambda t: t, 0.02, 500)
    assert run.output[-1] == pytest.approx(exact_response(PAPER, BRAKE, OUTPUT, [10.0], Stimulus.RAMP)[0], abs=2e-5)


def test_a_start_away_from_rest_is_a_step_seen_from_there() -> None:
    # a plant without control that stays where it is: from y0 = 1 to r = 1 + 1 is a unit step
    integrator = Plant((1.0,), (1.0, 0.0))
    away = simulate_fractional(PAPER, integrator, 2.0, 0.02, 400, start=InitialState(state=(1.0,)))
    rest = simulate_fractional(PAPER, integrator, 1.0, 0.02, 400)
    assert away.output - 1.0 == pytest.approx(rest.output, abs=1e-12)


def test_an_integral_to_start_with_holds_an_equilibrium() -> None:
    plant = Plant((1.0,), (2.35, 1.0), 0.5)
    run = simulate_fractional(PAPER, plant, 3.0, 0.1, 200, start=InitialState((3.0 / 2.35 * 2.35,), 3.0 / 0.6, 3.0))
    assert run.output == pytest.approx(3.0, abs=1e-12)
    assert run.control == pytest.approx(3.0, abs=1e-12)


def test_an_actuator_at_its_limit_is_an_open_loop() -> None:
    run = simulate_fractional(FoPi(50.0, 1.0, 0.5), BRAKE, 100.0, 0.05, 40, limits=(-0.3, 0.7))
    assert run.control == pytest.approx(0.7)
    assert run.output == pytest.approx(0.7 * -np.expm1(-run.time_s / 2.35), abs=1e-12)
    down = simulate_fractional(FoPi(50.0, 1.0, 0.5), BRAKE, -100.0, 0.05, 40, limits=(-0.3, 0.7))
    assert down.output == pytest.approx(-0.3 * -np.expm1(-run.time_s / 2.35), abs=1e-12)


def test_a_saturated_ordinary_pi_is_that_of_an_ode_solver() -> None:
    gains, limits = FoPi(2.0, 1.5, 1.0), (-0.2, 1.2)

    def slope(_t: float, state: Array) -> list[float]:
        y, integral = state
        control = min(max(2.0 * (1 - y) + 1.5 * integral, limits[0]), limits[1])
        return [(control - y) / 2.35, 1 - y]

    oracle = solve_ivp(slope, (0, 10), [0.0, 0.0], rtol=1e-10, atol=1e-12, max_step=0.01).y[0, -1]
    run = simulate_fractional(gains, BRAKE, 1.0, 0.01, 1000, limits=limits)
    assert run.control.max() == 1.2
    assert run.output[-1] == pytest.approx(oracle, abs=1e-5)


def test_saturation_keeps_second_order() -> None:
    ends = [
        simulate_fractional(FoPi(2.0, 1.5, 0.6), BRAKE, 1.0, 8.0 / n, n, limits=(-0.2, 1.2)).output[-1]
        for n in (200, 800, 3200)
    ]
    # the kink lies anywhere in its step, so that the ratio scatters about 16
    assert abs(ends[1] - ends[2]) < abs(ends[0] - ends[1]) / 8
    assert abs(ends[1] - ends[2]) < 1e-5


def test_a_direct_path_with_saturation_solves_its_algebraic_loop() -> None:
    run = simulate_fractional(FoPi(1.0, 0.5, 0.5), Plant((1.0, 1.0), (2.0, 1.0)), 1.0, 0.05, 100, limits=(-1.0, 0.4))
    # y(0+) = P(inf) 0.4
    assert run.output[0] == pytest.approx(0.2)
    assert run.demand[0] == pytest.approx(0.8)
    assert run.error == pytest.approx(1.0 - run.output)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step_s": 0.0}, "step_s"),
        ({"steps": 0}, "steps"),
        ({"step_s": 0.3}, "whole number of steps"),
        ({"limits": (1.0, -1.0)}, "limits"),
        ({"reference": np.ones(3)}, "reference"),
        ({"load": math.nan}, "load"),
        ({"start": InitialState(state=(1.0, 2.0))}, "start.state"),
        ({"gains": FoPi(-1.0, 0.5, 0.5), "plant": Plant((1.0,), (1.0,))}, "P\\(inf\\)"),
    ],
)
def test_a_simulation_that_makes_no_sense_is_refused(change: dict[str, object], message: str) -> None:
    plant = Plant((1.0,), (2.35, 1.0), 0.5)
    arguments = {"gains": PAPER, "plant": plant, "reference": 1.0, "step_s": 0.1, "steps": 10} | change
    with pytest.raises(DomainError, match=message):
        simulate_fractional(**arguments)  # pyright: ignore[reportArgumentType]
