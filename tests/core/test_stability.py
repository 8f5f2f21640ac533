"""Closed-loop stability against oracles that share nothing with it: polynomial roots, and the winding number of F(s).

F(s) = s^alpha D(s) + (kp s^alpha + ki) N(s) e^{-Ls} has no poles and, right of the imaginary axis, exactly the
closed loop's poles as zeros.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import Plant
from fopi_tune.core.stability import is_stable, unstable_closed_loop_poles

#: Poles this close (rad of arg s, or of arg w) to the axis are nobody's certain knowledge in double precision.
NEAR_AXIS = 1e-6


@dataclass(frozen=True)
class Case:
    """One random loop; polynomials in descending powers."""

    kp: float
    ki: float
    alpha: float
    numerator: np.ndarray
    denominator: np.ndarray
    dead_time_s: float = 0.0

    def count(self) -> float:
        plants = Plants(self.numerator[None], self.denominator[None], np.array([self.dead_time_s]))
        loops = Loops(np.array([self.kp]), np.array([self.ki]), np.array([self.alpha]), plants)
        return float(unstable_closed_loop_poles(loops)[0])


def count(controller: FoPi, plant: Plant) -> float:
    return float(unstable_closed_loop_poles(Loops.of(controller, Plants.of(plant)))[0])


def stable(controller: FoPi, plant: Plant) -> bool:
    return bool(is_stable(Loops.of(controller, Plants.of(plant)))[0])


def random_roots(rng: np.random.Generator, number: int, integrators: float) -> np.ndarray:
    """Real, complex (damping down to 0.001) and zero roots over three decades, a quarter of them on the right."""
    roots: list[complex] = []
    while len(roots) < number:
        side = -1.0 if rng.random() < 0.75 else 1.0
        size = 10.0 ** rng.uniform(-1.5, 1.5)
        if number - len(roots) >= 2 and rng.random() < 0.5:
            zeta = 10.0 ** rng.uniform(-3, 0)
            root = size * (side * zeta + 1j * math.sqrt(1.0 - zeta**2))
            roots += [root, root.conjugate()]
        elif rng.random() < integrators:
            roots.append(0.0)
        else:
            roots.append(side * size)
    return np.array(roots)


def random_case(rng: np.random.Generator, alpha: float, strictly_proper: bool = False) -> Case:
    order = int(rng.integers(1, 6))
    zeros = random_roots(rng, int(rng.integers(0, order + (not strictly_proper))), 0.0)
    poles = random_roots(rng, order, 0.2)
    gain = 10.0 ** rng.uniform(-2, 2) * rng.choice([-1, 1])
    kp, ki = (rng.choice([0, 1, -1], p=[0.1, 0.7, 0.2]) * 10.0 ** rng.uniform(-2, 2) for _ in range(2))
    if kp == 0.0 and ki == 0.0:
        kp = 1.0
    return Case(kp, ki, alpha, gain * np.atleast_1d(np.real(np.poly(zeros))), np.real(np.poly(poles)))


def spread(coefficients: np.ndarray, q: int) -> np.ndarray:
    """The polynomial in w = s^(1/q)."""
    wide = np.zeros((len(coefficients) - 1) * q + 1)
    wide[::q] = coefficients
    return wide


def poles_by_commensurate_roots(case: Case, p: int, q: int) -> int | None:
    """Zeros of F with |arg w| < pi/(2q), w = s^(1/q), alpha = p/q; None when one is too close to the line to tell."""
    numerator, denominator = spread(case.numerator, q), spread(case.denominator, q)
    if case.ki == 0.0:
        f = np.polyadd(denominator, case.kp * numerator)
    else:
        controller = np.zeros(p + 1)
        controller[0], controller[-1] = case.kp, controller[-1] + case.ki
        f = np.polyadd(np.concatenate([denominator, np.zeros(p)]), np.polymul(controller, numerator))
    roots = np.roots(f)
    angle = np.abs(np.angle(roots))
    if np.any(np.abs(angle - 0.5 * np.pi / q) < NEAR_AXIS) or np.any(roots == 0.0):
        return None
    return int(np.sum(angle < 0.5 * np.pi / q))


def assert_counts_agree(p: int, q: int, cases: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    decided = stable_loops = 0
    for _ in range(cases):
        case = random_case(rng, p / q)
        expected = poles_by_commensurate_roots(case, p, q)
        if expected is None:
            continue
        assert case.count() == expected, case
        decided += 1
        stable_loops += expected == 0
    assert decided > 0.95 * cases
    assert stable_loops > 0.05 * cases


def test_an_ordinary_pi_agrees_with_the_roots_of_the_closed_loop_polynomial() -> None:
    assert_counts_agree(1, 1, cases=500, seed=1)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("p", "q"), [(1, 2), (3, 2), (4, 5), (6, 5), (1, 3), (9, 20), (19, 10)])
def test_a_commensurate_order_agrees_with_the_roots_in_the_fractional_power(p: int, q: int) -> None:
    assert_counts_agree(p, q, cases=120, seed=10 * p + q)


@pytest.mark.long
@pytest.mark.parametrize(("p", "q"), [(1, 1), (1, 2), (3, 2), (4, 5), (6, 5), (1, 3), (5, 3), (9, 20), (19, 10)])
def test_many_loops_agree_with_polynomial_roots(p: int, q: int) -> None:
    assert_counts_agree(p, q, cases=3000, seed=100 * p + q)


def poles_by_winding(case: Case) -> int | None:
    """-1/pi times the turn of W = F/(s + sigma)^(n + alpha) from omega = 0 to inf; W tends to a constant at both ends.

    Only for strictly proper loops.  None when the path passes too close to 0 to be followed.
    """
    alpha = case.alpha if case.ki != 0.0 else 0.0
    n = len(case.denominator) - 1
    sigma = max(1.0, float(np.max(np.abs(np.roots(case.denominator)))))

    def w(omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = 1j * omega
        power = s**alpha
        integral = case.ki if case.ki != 0.0 else 0.0
        low = power * np.polyval(case.denominator, s)
        loop = (case.kp * power + integral) * np.polyval(case.numerator, s) * np.exp(-s * case.dead_time_s)
        return (low + loop) / (s + sigma) ** (n + alpha), np.abs(loop) / np.maximum(np.abs(low), 1e-300)

    # Small orders become integrators only at absurdly low frequencies.
    start = -min(280.0, 9.0 + 10.0 / case.alpha)
    omega = np.logspace(start, 9.0, int(150 * (9.0 - start)))
    if case.dead_time_s > 0.0:
        large = omega[w(omega)[1] > 0.01].max(initial=0.0)
        turns = np.arange(0.1, large * case.dead_time_s + 1.0, 0.1) / case.dead_time_s
        if len(turns) > 200_000:
            return None
        omega = np.unique(np.concatenate([omega, turns]))
    for _ in range(60):
        value = w(omega)[0]
        step = np.angle(value[1:] / value[:-1])
        coarse = np.abs(step) > 0.3
        if not coarse.any():
            turn = step.sum() / np.pi
            # The ends of the grid leave far less than half a turn; anything else means the path was lost.
            return round(-turn) if abs(turn - round(turn)) < 0.05 else None
        omega = np.sort(np.concatenate([omega, 0.5 * (omega[1:] + omega[:-1])[coarse]]))
    return None


def assert_windings_agree(cases: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    decided = 0
    for _ in range(cases):
        drawn = random_case(rng, rng.uniform(0.05, 1.95), strictly_proper=True)
        delay = 10.0 ** rng.uniform(-2, 1)
        case = Case(drawn.kp, drawn.ki, drawn.alpha, drawn.numerator, drawn.denominator, delay)
        expected = poles_by_winding(case)
        if expected is None:
            continue
        assert case.count() == expected, case
        decided += 1
    assert decided > 0.8 * cases


def test_loops_with_dead_time_agree_with_the_winding_number_of_their_characteristic_function() -> None:
    assert_windings_agree(cases=120, seed=5)


@pytest.mark.long
def test_many_loops_with_dead_time_agree_with_the_winding_number() -> None:
    assert_windings_agree(cases=2000, seed=6)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 1.0, 1.7])
def test_the_winding_oracle_agrees_with_polynomial_roots_where_both_apply(alpha: float) -> None:
    rng = np.random.default_rng(int(100 * alpha))
    p, q = round(20 * alpha), 20
    for _ in range(10):
        case = random_case(rng, alpha, strictly_proper=True)
        by_roots, by_winding = poles_by_commensurate_roots(case, p, q), poles_by_winding(case)
        assert by_roots is None or by_winding is None or by_roots == by_winding


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.floats(1e-3, 1e3), st.floats(0.01, 20.0))
def test_an_integrator_with_dead_time_is_stable_while_k_times_l_is_below_half_pi(delay: float, kl: float) -> None:
    # s + k e^{-Ls}: pairs cross at k L = pi/2 + 2 pi i.
    if min(abs(kl - (0.5 + 2 * i) * math.pi) for i in range(5)) < 1e-6:
        return
    expected = 2 * math.ceil((kl - 0.5 * math.pi) / (2.0 * math.pi)) if kl > 0.5 * math.pi else 0
    assert count(FoPi(kl / delay, 0.0, 1.0), Plant((1.0,), (1.0, 0.0), delay)) == expected
    assert count(FoPi(0.0, kl / delay, 1.0), Plant((1.0,), (1.0,), delay)) == expected


@pytest.mark.parametrize("alpha", [0.2, 0.5, 1.0, 1.5, 1.9])
def test_a_pure_fractional_integral_with_dead_time_has_its_closed_form_limit(alpha: float) -> None:
    # ki omega^-alpha = 1 and -alpha pi/2 - omega L = -pi at the limit.
    omega = math.pi * (1.0 - 0.5 * alpha)
    limit = omega**alpha
    plant = Plant((1.0,), (1.0,), 1.0)
    assert stable(FoPi(0.0, 0.999999 * limit, alpha), plant)
    assert count(FoPi(0.0, 1.000001 * limit, alpha), plant) == 2


def test_simc_pi_is_stable_and_becomes_unstable_with_its_gain_times_the_gain_margin() -> None:
    plant = Plant((1.0,), (1.0, 0.0), 1.0)
    assert stable(FoPi(0.5, 0.0625, 1.0), plant)
    # arg(jw 8 + 1) - w = 0 beyond the origin gives w = 1.48870, gain margin 2.9577.
    omega = 1.4887
    for _ in range(50):
        omega = math.atan(8.0 * omega)
    margin = omega**2 / (0.0625 * math.hypot(1.0, 8.0 * omega))
    assert stable(FoPi(0.5 * margin * 0.99999, 0.0625 * margin * 0.99999, 1.0), plant)
    assert count(FoPi(0.5 * margin * 1.00001, 0.0625 * margin * 1.00001, 1.0), plant) == 2


@pytest.mark.parametrize(
    ("controller", "plant", "expected"),
    [
        (FoPi(2.0, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)), 0),
        (FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)), 1),
        (FoPi(2.0, 0.1, 0.8), Plant((1.0,), (1.0, -1.0)), 0),
        (FoPi(-2.0, -0.1, 0.8), Plant((-1.0,), (1.0, -1.0)), 0),
        (FoPi(2.0, -0.1, 0.8), Plant((1.0,), (1.0, -1.0)), 1),
        # two unstable poles, (s - 1)^2 + 4 (s + 1): s^2 + 2 s + 5
        (FoPi(4.0, 0.0, 1.0), Plant((1.0, 1.0), (1.0, -2.0, 1.0)), 0),
        (FoPi(1.0, 0.0, 1.0), Plant((1.0, 1.0), (1.0, -2.0, 1.0)), 2),
        (FoPi(-2.0, -0.1, 0.8), Plant((-1.0,), (1.0, 1.0)), 0),
        (FoPi(1.0, 1.0, 0.5), Plant((1.0,), (1.0, 0.0, 0.0)), 2),
        (FoPi(0.1, 0.05, 0.5), Plant((1.0,), (1.0, 0.0, 1.0)), 2),
        (FoPi(0.2, -0.05, 0.5), Plant((1.0,), (1.0, 0.0, 1.0)), 1),
        (FoPi(2.0, 0.0, 0.5), Plant((1.0,), (1.0,)), 0),
        (FoPi(-2.0, 0.0, 0.5), Plant((1.0,), (1.0,)), 0),
        # 1 - 2 + 1/s: the algebraic loop leaves a pole at s = 1
        (FoPi(-2.0, 1.0, 1.0), Plant((1.0,), (1.0,)), 1),
    ],
)
def test_small_loops_have_the_pole_counts_of_hand_calculation(controller: FoPi, plant: Plant, expected: int) -> None:
    assert count(controller, plant) == expected


@pytest.mark.parametrize(
    ("controller", "plant"),
    [
        (FoPi(1.0, 0.0, 1.0), Plant((1.0,), (1.0, 0.0, 0.0))),
        (FoPi(1.0, 1.0, 1.0), Plant((1.0,), (1.0, 1.0, 0.0))),
        (FoPi(-1.0, 0.0, 1.0), Plant((1.0,), (1.0, 1.0))),
        (FoPi(-1.0, 0.0, 1.0), Plant((1.0, 2.0), (1.0, 1.0))),
        (FoPi(0.5 * math.pi, 0.0, 1.0), Plant((1.0,), (1.0, 0.0), 1.0)),
    ],
)
def test_a_loop_through_minus_one_is_not_stable(controller: FoPi, plant: Plant) -> None:
    assert count(controller, plant) == math.inf
    assert not stable(controller, plant)


@pytest.mark.parametrize("gain", [1.0, 1.0 + 1e-15, 1.5, -1.0, -3.0])
def test_a_direct_path_of_at_least_one_around_a_dead_time_has_infinitely_many_unstable_poles(gain: float) -> None:
    assert count(FoPi(gain, 0.1, 0.7), Plant((1.0, 2.0), (1.0, 1.0), 0.5)) == math.inf
    assert count(FoPi(gain, 0.1, 0.7), Plant((1.0,), (1.0,), 0.5)) == math.inf


def test_a_direct_path_below_one_around_a_dead_time_can_be_stable() -> None:
    assert stable(FoPi(0.9, 0.1, 0.7), Plant((1.0, 1.0), (1.0, 2.0), 0.5))


@pytest.mark.parametrize(
    ("ki", "numerator", "denominator"),
    [
        (0.3, (1.0, 0.0), (1.0, 2.0, 1.0)),
        (0.3, (1.0, 0.0), (1.0, 1.0, 0.0)),
        (0.0, (1.0, 0.0), (1.0, 1.0, 0.0)),
        (0.3, (1.0, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0)),
    ],
)
def test_a_mode_on_the_axis_that_the_loop_cannot_move_is_not_stable(
    ki: float, numerator: tuple[float, ...], denominator: tuple[float, ...]
) -> None:
    assert not stable(FoPi(1.0, ki, 0.7), Plant(numerator, denominator))


def test_an_unstable_mode_hidden_by_a_cancelling_zero_is_counted() -> None:
    assert count(FoPi(1.0, 0.5, 0.7), Plant((1.0, -1.0), (1.0, 0.0, -1.0))) == 1


def test_a_gain_that_only_touches_one_does_not_upset_the_count() -> None:
    # A resonance whose peak is exactly 1: |L| <= 1 everywhere, the closed loop is stable for a static controller.
    zeta = 0.1
    peak = 1.0 / (2.0 * zeta * math.sqrt(1.0 - zeta**2))
    for gain in (1.0 - 1e-13, 1.0, 1.0 + 1e-13, 1.0 - 1e-15):
        assert count(FoPi(gain / peak, 0.0, 1.0), Plant((1.0,), (1.0, 2.0 * zeta, 1.0))) == 0
    # The same touch above a low-frequency part with |L| > 1.
    assert count(FoPi(1.0 / peak, 1e-3, 1.0), Plant((1.0,), (1.0, 2.0 * zeta, 1.0))) == 0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.integers(0, 10_000), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.sampled_from([0.01, 0.5, 1.0, 1.3, 1.999])
)
def test_the_count_depends_neither_on_the_unit_of_time_nor_on_that_of_gain(
    seed: int, log_time: float, log_gain: float, alpha: float
) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, alpha, strictly_proper=True)
    case = Case(case.kp, case.ki, alpha, case.numerator, case.denominator, rng.choice([0.0, 0.7]))
    time, gain = 10.0**log_time, 10.0**log_gain
    n, m = len(case.denominator) - 1, len(case.numerator) - 1
    scaled = Case(
        case.kp / gain,
        case.ki / gain / time**alpha,
        alpha,
        case.numerator * gain * time ** np.arange(m, -1.0, -1.0),
        case.denominator * time ** np.arange(n, -1.0, -1.0),
        case.dead_time_s * time,
    )
    assert scaled.count() == case.count()


@pytest.mark.parametrize("order", [4, 8, 12])
def test_a_multiple_lag_with_a_proportional_controller_has_its_closed_form_limit(order: int) -> None:
    # (s + 1)^n + k is marginal at k = (1/cos(pi/n))^n.
    limit = math.cos(math.pi / order) ** -order
    plant = Plant((1.0,), tuple(np.poly([-1.0] * order)))
    assert stable(FoPi(limit * 0.999999, 0.0, 1.0), plant)
    assert count(FoPi(limit * 1.000001, 0.0, 1.0), plant) == 2


def test_coefficients_over_twenty_four_decades_are_counted_right() -> None:
    # 1/((1e-12 s + 1)(s + 1e-12)) with kp only: stable for any positive gain, unstable below -1e-12.
    plant = Plant((1.0,), (1e-12, 1.0, 1e-12))
    assert stable(FoPi(1e6, 0.0, 1.0), plant)
    assert count(FoPi(-2e-12, 0.0, 1.0), plant) == 1


def test_rows_of_a_batch_do_not_influence_each_other() -> None:
    rng = np.random.default_rng(3)
    cases = [random_case(rng, float(rng.uniform(0.1, 1.9))) for _ in range(60)]
    cases = [c for c in cases if len(c.denominator) == 4 and len(c.numerator) <= 4]
    numerators = np.array([np.concatenate([np.zeros(4 - len(c.numerator)), c.numerator]) for c in cases])
    plants = Plants(numerators, np.array([c.denominator for c in cases]), np.zeros(len(cases)))
    kp, ki, alpha = (np.array([getattr(c, name) for c in cases]) for name in ("kp", "ki", "alpha"))
    loops = Loops(kp, ki, alpha, plants)
    assert len(cases) > 5
    assert unstable_closed_loop_poles(loops).tolist() == [c.count() for c in cases]
