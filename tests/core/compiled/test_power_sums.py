"""Sums of powers of omega: value, branch, derivatives, their bounds and ends, against NumPy on dense grids."""

from __future__ import annotations

import numpy as np
import pytest
from cases.random_fopids import orders

from fopi_tune.core.bode_form import BodeForm
from fopi_tune.core.compiled.power_sums import corners, ends, table_of

U = np.linspace(-60.0, 60.0, 60_001)
ROWS = np.zeros(len(U), dtype=np.intp)


def random_sum(seed: int) -> tuple[list[float], list[float]]:
    """Exponents and coefficients of a controller's numerator, of any signs; a third of the terms are not there."""
    rng = np.random.default_rng([seed, 71])
    alpha, mu = orders(rng)
    coefficients = rng.choice([1.0, -1.0, 0.0], 5, p=[0.5, 0.25, 0.25]) * 10.0 ** rng.uniform(-2.0, 2.0, 5)
    coefficients[0] = coefficients[0] or 1.0
    return [0.0, alpha, 1.0, 1.0 + alpha, alpha + mu], coefficients.tolist()


def form_of(exponents: list[float], coefficients: list[float]) -> BodeForm:
    lead, first, table = table_of(exponents, coefficients)
    none, zero = np.zeros((1, 0)), np.zeros(1)
    scale, phase = np.array([np.log(abs(lead))]), np.array([0.0 if lead > 0.0 else np.pi])
    return BodeForm(scale, zero + first, phase + 0.5 * np.pi * first, none, none, none, none, zero, table[None])


def dense(exponents: list[float], coefficients: list[float], u: np.ndarray) -> np.ndarray:
    log_s = u + 0.5j * np.pi
    return np.asarray(sum(c * np.exp(e * log_s) for e, c in zip(exponents, coefficients, strict=True)))


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(60))
def test_the_logarithm_is_followed_from_low_frequency_on(seed: int) -> None:
    exponents, coefficients = random_sum(seed)
    form, wanted = form_of(exponents, coefficients), dense(exponents, coefficients, U)
    found = form.value(ROWS, U)
    np.testing.assert_allclose(np.exp(found), wanted, rtol=1e-11)
    # the grid follows the phase where G is not next to 0
    steps = np.angle(wanted[1:] / wanted[:-1])
    clear = np.abs(steps) < 2.0
    np.testing.assert_allclose(np.diff(found.imag)[clear], steps[clear], atol=1e-9)
    assert found.imag[0] == pytest.approx(float(form.phase0[0]), abs=1e-3)
    slope = form.derivative(ROWS, U)
    np.testing.assert_allclose(form.value_and_derivative(ROWS, U)[1], slope, rtol=1e-12, atol=1e-12)
    near = np.abs(slope) < 20.0
    np.testing.assert_allclose(slope[near], np.gradient(found, U)[near], rtol=2e-2, atol=2e-2)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(60))
def test_ends_and_corners_are_those_of_the_first_and_the_last_term(seed: int) -> None:
    exponents, coefficients = random_sum(seed)
    form = form_of(exponents, coefficients)
    low, high = (float(part[0]) for part in corners(form.sums, 1e-9))
    exponent, size, phase = (float(part[0]) for part in ends(form.sums))
    if not np.isfinite(low):
        assert exponent == 0.0
        return
    # four terms of 1e-9 each, beside the rounding of exponentials of large numbers
    far = np.array([low - 1.0, high + 1.0])
    found = form.value(ROWS[:2], far)
    first = form.scale[0] + 1j * form.phase0[0]
    assert found[0] == pytest.approx(complex(first + form.slope0[0] * far[0]), abs=1e-8 + 1e-14 * abs(far[0]))
    last = first + size + 1j * phase + (form.slope0[0] + exponent) * far[1]
    assert found[1] == pytest.approx(complex(last), abs=1e-8 + 1e-14 * abs(far[1]))
    assert (form.slope_end()[0], form.end()[0][0], form.end()[1][0]) == pytest.approx(
        (form.slope0[0] + exponent, form.scale[0] + size, form.phase0[0] + phase)
    )


@pytest.mark.thinned(7)
@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("h", [0.003, 0.1, 0.7])
def test_no_second_derivative_inside_a_cell_exceeds_its_bound(seed: int, h: float) -> None:
    form = form_of(*random_sum(seed))
    centres = np.linspace(-8.0, 8.0, 81)
    rows = ROWS[: len(centres)]
    bound = form.curvature_bound(rows, centres - h, centres + h)
    step = 1e-4 * h
    for part in np.linspace(-0.99, 0.99, 21):
        u = centres + part * h
        # differences of slopes, which are exact to rounding
        second = (form.derivative(rows, u + step) - form.derivative(rows, u - step)) / (2.0 * step)
        slack = 1e-13 * (1.0 + np.abs(form.derivative(rows, u))) / step
        assert np.all(np.abs(second) <= bound * (1.0 + 1e-6) + slack)


def test_a_bound_on_a_short_cell_is_not_much_larger_than_the_second_derivative() -> None:
    form = form_of([0.0, 0.6, 1.4], [1.0, 2.0, 3.0])
    u, h = np.linspace(-3.0, 3.0, 13), 1e-3
    rows = ROWS[: len(u)]
    second = (form.derivative(rows, u + h) - form.derivative(rows, u - h)) / (2.0 * h)
    assert np.all(form.curvature_bound(rows, u - h, u + h) < 3.0 * np.abs(second) + 1.0)


def test_the_inverse_has_the_negative_logarithm() -> None:
    form = form_of(*random_sum(3))
    np.testing.assert_array_equal((-form).value(ROWS, U), -form.value(ROWS, U))
    np.testing.assert_array_equal((-form).end(), tuple(-part for part in form.end()))


def test_equal_powers_are_one_term_and_vanish_where_they_cancel() -> None:
    # kp Tf + kd = 0 with mu = 1
    _, _, table = table_of([0.0, 0.5, 1.0, 1.5, 1.5], [1.0, 2.0, 0.3, 0.6, -0.6])
    assert ends(table[None])[0][0] == 1.0
