"""Compiled responses of loops against the sum of the factors' own logarithms, and their bounds against differences."""

from __future__ import annotations

import numpy as np
import pytest
from cases.random_loops import random_loop, random_sampled

from fopi_tune.core.bode_form import Array, BodeForm, Complex
from fopi_tune.core.compiled.loops import Direct, Terms, bode_at, entry
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.sampled_loops import SampledLoops

U = np.linspace(-25.0, 25.0, 501)
ROWS = np.zeros(len(U), dtype=np.int64)


def loops(seed: int) -> Loops:
    """One loop, continuous with and without a dead time or on samples."""
    rng = np.random.default_rng(seed)
    if seed % 3 == 2:
        plant, sections, delay = random_sampled(rng, proper=True)
        return SampledLoops.implemented(FoPi(1.0, 1.0, 1.0), Implementation(sections, delay), Plants.of(plant))
    loop = random_loop(rng, float(rng.uniform(0.3, 1.7)), 0.3 * (seed % 3))
    return Loops.of(loop.controller, Plants.of(loop.plant))


def by_factors(form: BodeForm, u: Array) -> Complex:
    """Formula (1) of `bode_form`: the sum of the factors' principal logarithms."""
    total = form.scale[0] + form.slope0[0] * u + 1j * (form.phase0[0] - form.delay[0] * np.exp(u))
    for sign, nu, corner, psi in zip(form.sign[0], form.nu[0], form.corner[0], form.psi[0], strict=True):
        if np.isfinite(corner):
            total = total + sign * np.log(1.0 + np.exp(nu * (u - corner) + 1j * psi))
    return np.asarray(total, dtype=complex)


@entry
def _bounds(terms, u, h):
    found = np.empty((len(u), 3))
    for i in range(len(u)):
        _, _, _, _, found[i, 0], found[i, 1], found[i, 2] = bode_at(terms, 0, u[i], h)
    return found


@pytest.mark.parametrize("seed", range(30))
def test_the_value_is_the_sum_of_the_factors_logarithms(seed: int) -> None:
    form = loops(seed).log
    wanted, got = by_factors(form, U), form.value(ROWS, U)
    # every factor's rounding, and that of the turns of a dead time
    assert got == pytest.approx(wanted, abs=1e-12 * (1.0 + np.abs(wanted).max()))


@pytest.mark.parametrize("seed", range(30))
def test_slopes_are_differences_of_values(seed: int) -> None:
    form, step = loops(seed).log, 1e-5
    differences = (by_factors(form, U + step) - by_factors(form, U - step)) / (2.0 * step)
    near = np.abs(differences) < 100.0
    # a lightly damped pair bends on a width of its damping, at least 3e-3: step^2/6 f''' of its slope
    assert form.derivative(ROWS, U)[near] == pytest.approx(differences[near], rel=2e-3, abs=1e-6)
    assert form.value_and_derivative(ROWS, U)[1] == pytest.approx(form.derivative(ROWS, U), rel=1e-9, abs=1e-12)


@pytest.mark.thinned(7)
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("h", [0.001, 0.03, 0.3, 2.0])
def test_no_second_difference_inside_a_cell_exceeds_its_bound(seed: int, h: float) -> None:
    form = loops(seed).log
    bounds, step = _bounds(form.terms, U, h), 0.02 * h
    for part in np.linspace(-0.9, 0.9, 13):
        u = U + part * h
        # second differences of slopes, which are exact to rounding: that over the step is what they are off by
        second = (form.derivative(ROWS, u + step) - form.derivative(ROWS, u - step)) / (2.0 * step)
        slack = 1e-13 * (1.0 + np.abs(form.derivative(ROWS, u))) / step
        assert np.all(np.abs(second.real) <= bounds[:, 0] * (1.0 + 1e-9) + slack)
        assert np.all(np.abs(second.imag) <= bounds[:, 1] * (1.0 + 1e-9) + slack)
        assert np.all(np.abs(second) <= bounds[:, 2] * (1.0 + 1e-9) + slack)


@pytest.mark.parametrize("seed", range(30))
def test_a_loops_value_is_that_of_its_response_on_the_branch_of_its_factors(seed: int) -> None:
    loop = loops(seed)
    omega = np.asarray(loop.omega_of(U))
    inside = (omega > 1e-6) & (omega < min(0.999 * loop.highest_rad_s, 1e3))
    value = loop.log_response(ROWS[inside], U[inside])
    wanted = loop.response(ROWS[inside], omega[inside])
    # a fractional power of a frequency and its logarithm are each rounded
    assert np.exp(value) == pytest.approx(wanted, rel=1e-9)
    assert np.abs(value.imag - by_factors(loop.log, U[inside]).imag).max() < 1.0


def test_the_tables_have_the_shapes_that_compiled_functions_take() -> None:
    loop = loops(0)
    assert isinstance(loop.log.terms, Terms)
    assert isinstance(loop.direct, Direct)
    assert loop.log.terms.whole.shape == (4, 1)
    assert loop.log.terms.factors.shape[:2] == (7, 1)
