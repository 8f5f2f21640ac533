"""The certified root finder, polynomial roots, and the bounds both rest on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.bode_form import BodeForm
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.roots import Curvature, find_roots, polynomial_roots
from fopi_tune.errors import DomainError

ONE = np.array([0])


def constant_bound(bound: float) -> Curvature:
    def curvature(rows: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        return np.full(len(low), bound)

    return curvature


# --- polynomial roots ----------------------------------------------------------------------------------------------


def test_polynomial_roots_are_those_of_numpy() -> None:
    rng = np.random.default_rng(1)
    table = rng.normal(size=(40, 5))
    for row, roots in zip(table, polynomial_roots(table), strict=True):
        np.testing.assert_allclose(np.sort_complex(roots), np.sort_complex(np.roots(row)), rtol=1e-10, atol=1e-12)


def test_leading_zeros_are_roots_at_infinity_and_trailing_zeros_exact_zeros() -> None:
    table = [[0.0, 0.0, 1.0, 2.0, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 3.0]]
    roots = polynomial_roots(np.array(table))
    assert np.isinf(roots[0]).sum() == 2
    assert (roots[0] == 0.0).sum() == 1
    assert roots[0][np.isfinite(roots[0]) & (roots[0] != 0.0)] == pytest.approx([-2.0])
    assert np.all(roots[1] == 0.0)
    assert np.all(np.isinf(roots[2]))


def test_a_constant_has_no_roots() -> None:
    assert polynomial_roots(np.array([[3.0], [4.0]])).shape == (2, 0)


def test_roots_over_twenty_four_decades_are_all_accurate() -> None:
    roots = np.array([-1e-12, -1e-4, -3.0, -1e7, -1e12])
    found = np.sort(polynomial_roots(np.array([np.poly(roots)], dtype=float))[0].real)
    np.testing.assert_allclose(found, np.sort(roots), rtol=1e-9)


# --- the root finder -----------------------------------------------------------------------------------------------


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=6, unique=True))
def test_every_root_of_a_polynomial_is_found_once(roots: list[float]) -> None:
    distinct = np.sort(np.array(roots))
    if np.any(np.diff(distinct) < 1e-3):
        return
    p = np.poly(distinct)
    d, dd = np.polyder(p), np.polyder(p, 2)
    bound = float(np.abs(dd) @ 3.5 ** np.arange(len(dd) - 1, -1, -1)) if len(dd) else 0.0

    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.polyval(p, u), np.polyval(d, u)

    rows, found = find_roots(function, constant_bound(bound), ONE, np.array([-3.5]), np.array([3.5]))
    assert len(found) == len(distinct)
    # Rounding of the expanded polynomial, at most 7 * 3.5^6 * 1e-16, over the slope at the root.
    slope = np.abs(np.polyval(d, distinct))
    assert np.all(np.abs(found - distinct) <= 1e-11 / slope + 1e-14)
    assert np.all(rows == 0)


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5, 1e-6])
def test_a_close_pair_of_roots_is_found(gap: float) -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (u - 0.3) ** 2 - 0.25 * gap**2, 2.0 * (u - 0.3)

    _, found = find_roots(function, constant_bound(2.0), ONE, np.array([-10.0]), np.array([10.0]))
    np.testing.assert_allclose(found, [0.3 - 0.5 * gap, 0.3 + 0.5 * gap], atol=1e-15 / gap + 1e-15)


@pytest.mark.parametrize("place", [0.3, 0.0, 1.0 / 3.0, -7.123])
def test_a_touching_point_is_returned_once(place: float) -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (u - place) ** 2, 2.0 * (u - place)

    _, found = find_roots(function, constant_bound(2.0), ONE, np.array([-10.0]), np.array([10.0]))
    # f < 1e-12 within 1e-6 of the touching point.
    assert found == pytest.approx([place], abs=1e-6)


def test_a_function_that_lies_on_its_level_does_not_cross_it() -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(u), np.zeros_like(u)

    assert len(find_roots(function, constant_bound(0.0), ONE, np.array([-9.0]), np.array([9.0]))[1]) == 0


@pytest.mark.parametrize("edge", [0.0, 3.0, -3.0, 1.5])
def test_a_root_on_the_edge_between_two_cells_is_found_once(edge: float) -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return u - edge, np.ones_like(u)

    _, found = find_roots(function, constant_bound(0.0), ONE, np.array([-6.0]), np.array([6.0]))
    assert found == pytest.approx([edge], abs=1e-15)


def test_all_levels_of_a_period_are_found_for_rising_and_falling_functions() -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        factor = np.where(rows == 0, 1.0, -2.0)
        return factor * u, factor + 0.0 * u

    rows = np.array([0, 1])
    got, found = find_roots(function, constant_bound(0.0), rows, np.full(2, -3.6), np.full(2, 3.7), period=1.0)
    np.testing.assert_allclose(found[got == 0], np.arange(-3, 4), atol=1e-14)
    np.testing.assert_allclose(found[got == 1], 0.5 * np.arange(-7, 8), atol=1e-14)


def test_oscillations_between_the_first_cells_are_not_missed() -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.sin(100.0 * u), 100.0 * np.cos(100.0 * u)

    _, found = find_roots(function, constant_bound(1e4), ONE, np.array([0.01]), np.array([10.0]))
    np.testing.assert_allclose(found, np.arange(1, 319) * math.pi / 100.0, rtol=1e-13)


def test_too_many_roots_are_refused_with_a_reason() -> None:
    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.sin(1e7 * u), 1e7 * np.cos(1e7 * u)

    with pytest.raises(DomainError, match="too often"):
        find_roots(function, constant_bound(1e14), ONE, np.array([0.0]), np.array([10.0]))


def test_the_polish_needs_few_evaluations() -> None:
    calls = 0

    def function(rows: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal calls
        calls += 1
        return np.expm1(u - 0.7), np.exp(u - 0.7)

    find_roots(function, constant_bound(30.0), ONE, np.array([-4.0]), np.array([4.0]))
    # About 10 rounds of cells and 7 Newton steps; a bisection would take 50.
    assert calls < 30


# --- the logarithmic form ------------------------------------------------------------------------------------------


def random_loops(seed: int) -> Loops:
    rng = np.random.default_rng(seed)
    order, m = int(rng.integers(1, 5)), 3
    numerator = rng.normal(size=(m, int(rng.integers(1, order + 2)))) * 10.0 ** rng.uniform(-2, 2)
    denominator = rng.normal(size=(m, order + 1))
    if rng.random() < 0.3:
        denominator[:, -1] = 0.0
    plants = Plants(numerator, denominator, rng.choice([0.0, 0.5], m))
    return Loops(rng.normal(size=m), rng.normal(size=m), rng.uniform(0.05, 1.95, m), plants)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.integers(0, 1_000_000), st.floats(-6.0, 6.0), st.floats(1e-6, 4.0))
def test_the_curvature_bound_bounds_the_second_derivative(seed: int, low: float, width: float) -> None:
    loops = random_loops(seed)
    log = loops.log
    rows = np.arange(3)
    bound = log.curvature_bound(rows, np.full(3, low), np.full(3, low + width))
    gain_bound = log.gain_curvature_bound(rows, np.full(3, low), np.full(3, low + width))
    for u in np.linspace(low, low + width, 41):
        # d2/du2 ln(1 + w) = nu^2 w/(1 + w)^2, written down anew; the dead time adds -j L e^u.
        w = np.exp(log.nu * (u - log.corner)) * np.exp(1j * log.psi)
        second = (log.sign * log.nu**2 * w / (1.0 + w) ** 2).sum(axis=1) - 1j * log.delay * np.exp(u)
        assert np.all(np.abs(second) <= bound * (1.0 + 1e-9))
        assert np.all(np.abs(second.real) <= gain_bound * (1.0 + 1e-9))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 1_000_000), st.floats(-6.0, 6.0))
def test_the_factors_agree_with_the_response_and_its_differences(seed: int, u: float) -> None:
    loops = random_loops(seed)
    rows, at = np.arange(3), np.full(3, u)
    s = 1j * math.exp(u)
    c = loops.kp + loops.ki * s**-loops.alpha
    pairs = zip(loops.plants.numerator, loops.plants.denominator, strict=True)
    p = [np.polyval(n, s) / np.polyval(d, s) for n, d in pairs]
    expected = c * np.array(p) * np.exp(-s * loops.plants.dead_time_s)
    value = np.exp(loops.log.value(rows, at))
    # The factors' roots are good to 1e-16 of their condition; draws close to a root of L are relative to |L|.
    np.testing.assert_allclose(np.abs(value - expected) / np.abs(expected), 0.0, atol=1e-8)
    np.testing.assert_allclose(np.exp(loops.log_response(rows, at)), expected, rtol=1e-11)
    h = 1e-6
    difference = (loops.log.value(rows, at + h) - loops.log.value(rows, at - h)) / (2.0 * h)
    second = loops.log.curvature_bound(rows, at - h, at + h)
    # Central difference: h^2 f'''/6 (f''' at most of the size of f''^1.5 near a root) and rounding 1e-16 * |f| / h.
    np.testing.assert_allclose(
        np.abs(loops.log.derivative(rows, at) - difference) / (1.0 + second) ** 1.5, 0.0, atol=1e-7
    )


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 1_000_000))
def test_the_unwrapped_phase_is_continuous_and_starts_at_its_asymptote(seed: int) -> None:
    loops = random_loops(seed)
    log = loops.log
    u = np.linspace(-12.0, 3.0, 10_001)
    for row in range(3):
        rows = np.full(len(u), row)
        factors = log.value(rows, u).imag
        # A jump of a turn would be 6.28; a root within 1e-3 of the axis turns the phase by 3.14 in some steps.
        assert np.max(np.abs(np.diff(factors))) < 3.2
        np.testing.assert_allclose(np.unwrap(factors), factors, atol=1e-9)
        far = -600.0 / max(1.0, 5.0 * log.nu.max())
        at_zero = log.value(np.array([row]), np.array([far]))[0]
        assert at_zero.imag == pytest.approx(log.phase0[row], abs=2.0 * math.exp(0.05 * far) + 1e-6)


def test_exponents_beyond_double_precision_neither_overflow_nor_lose_the_asymptote() -> None:
    # (1 + 1e300 w): at w = 1e5 the ratio is 1e305.
    form = BodeForm(
        np.zeros(1), np.zeros(1), np.zeros(1), np.ones((1, 1)), np.ones((1, 1)),
        np.array([[-300.0 * math.log(10.0)]]), np.full((1, 1), 0.5 * math.pi), np.zeros(1),
    )  # fmt: skip
    value, slope = form.value_and_derivative(ONE, np.array([math.log(1e3)]))
    assert value[0].real == pytest.approx(303.0 * math.log(10.0), rel=1e-14)
    assert slope[0] == pytest.approx(1.0, rel=1e-14)


def test_the_product_and_the_inverse_are_sums_and_negatives_of_logarithms() -> None:
    loops = random_loops(5)
    rows, u = np.arange(3), np.full(3, 0.4)
    product = loops.plants.log + loops.log_controller
    np.testing.assert_allclose(
        product.value(rows, u), loops.plants.log.value(rows, u) + loops.log_controller.value(rows, u), rtol=1e-13
    )
    np.testing.assert_allclose((-product).value(rows, u), -product.value(rows, u), rtol=1e-13)
    np.testing.assert_allclose(product.undelayed().value(rows, u).real, product.value(rows, u).real, rtol=1e-13)


@pytest.mark.parametrize("coefficients", [[5e-324, 1.0], [1e-200, 1e200, 1.0]])
def test_coefficients_whose_quotient_overflows_are_refused(coefficients: list[float]) -> None:
    with pytest.raises(DomainError, match="differ by more than a floating-point number can hold"):
        polynomial_roots(np.array([coefficients]))
