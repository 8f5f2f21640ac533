"""Bode forms evaluated in portions:  the same numbers as one by one, in bounded memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from fopi_tune.core.bode_form import PORTION, Array, BodeForm, Complex, Rows

FACTORS = 24
FUNCTIONS: dict[str, Callable[[BodeForm, Rows, Array], Array | Complex]] = {
    "value": lambda form, rows, u: np.concatenate(form.value_and_derivative(rows, u)),
    "derivative": lambda form, rows, u: form.derivative(rows, u),
    "curvature": lambda form, rows, u: form.curvature_bound(rows, u - 0.1, u + 0.1),
}


def forms(rows: int) -> BodeForm:
    """Random products of factors of both signs, with dead time."""
    rng = np.random.default_rng(7)
    shape = (rows, FACTORS)
    return BodeForm(
        rng.normal(size=rows),
        rng.normal(size=rows),
        rng.normal(size=rows),
        rng.choice([-1.0, 1.0], size=shape),
        rng.uniform(0.1, 2.0, size=shape),
        rng.normal(scale=3.0, size=shape),
        rng.uniform(-3.0, 3.0, size=shape),
        rng.uniform(0.0, 1.0, size=rows),
    )


@pytest.mark.parametrize("name", list(FUNCTIONS))
@pytest.mark.parametrize("count", [0, 1, PORTION, PORTION + 1, 2 * PORTION + 17])
def test_points_in_portions_have_the_values_of_points_alone(name: str, count: int) -> None:
    form, rng = forms(50), np.random.default_rng(count)
    rows, u = rng.integers(0, 50, size=count).astype(np.intp), rng.normal(scale=3.0, size=count)
    found = FUNCTIONS[name](form, rows, u)
    parts = len(found) // count if count else 1
    assert found.shape == (parts * count,)
    for k in rng.integers(0, max(count, 1), size=min(count, 20)):
        alone = FUNCTIONS[name](form, rows[k : k + 1], u[k : k + 1])
        # vector and scalar instructions may round the last digit differently
        np.testing.assert_allclose(found[k::count], alone, rtol=1e-14)


@pytest.mark.parametrize("name", list(FUNCTIONS))
def test_the_memory_for_many_points_does_not_grow_with_the_number_of_factors(name: str) -> None:
    """200,000 points of 24 factors took 77 MB for each of several arrays."""
    form, count = forms(50), 200_000
    rows, u = np.arange(count) % 50, np.linspace(-5.0, 5.0, count)
    tracemalloc.start()
    try:
        FUNCTIONS[name](form, rows, u)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # two results of 16 bytes a point, twice while they are joined, and the portion's arrays
    assert peak < 60e6


def test_values_and_slopes_are_those_of_fifty_digits() -> None:
    """Far below and above every corner, and beside w = -1, where 1 + w is small."""
    form, rng = forms(20), np.random.default_rng(5)
    rows = rng.integers(0, 20, size=90).astype(np.intp)
    u = np.concatenate([rng.uniform(-600.0, 8.0, 30), rng.uniform(-10.0, 10.0, 30), np.zeros(30)])
    factor = rng.integers(0, FACTORS, size=90)
    beside = np.arange(90) >= 60
    form.psi[rows[beside], factor[beside]] = np.pi - rng.uniform(1e-9, 1e-3, 30)
    u[beside] = form.corner[rows, factor][beside] + rng.uniform(-1e-6, 1e-6, 30)
    values, slopes = form.value_and_derivative(rows, u)
    with mpmath.workdps(50):
        for value, slope, m, at in zip(values, slopes, rows, map(mpmath.mpf, u), strict=True):
            turn = 1j * form.delay[m] * mpmath.exp(at)
            nu = [mpmath.mpf(x) for x in form.nu[m]]
            w = [
                mpmath.exp(n * (at - c) + 1j * mpmath.mpf(p))
                for n, c, p in zip(nu, form.corner[m], form.psi[m], strict=True)
            ]
            parts = [s * mpmath.log(1 + x) for s, x in zip(form.sign[m], w, strict=True)]
            exact = form.scale[m] + form.slope0[m] * at + 1j * form.phase0[m] + mpmath.fsum(parts) - turn
            steep = mpmath.fsum(s * n * x / (1 + x) for s, n, x in zip(form.sign[m], nu, w, strict=True))
            # u, the corner and psi are rounded: beside -1 the slope magnifies that
            assert abs(value - exact) <= 1e-13 * (1 + abs(exact)) + 1e-14 * abs(steep)
            assert abs(slope - (form.slope0[m] + steep - turn)) <= 1e-13 * (1 + abs(steep) + abs(turn)) ** 2
