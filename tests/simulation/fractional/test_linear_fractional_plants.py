"""Exact responses with fractional plants against mpmath's inversion of the same transform.

Talbot's method of mpmath with 60 nodes and 40 digits agrees with itself to 1e-10 on these loops.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from cases.random_fractional import Side, family_of, published, random_controller, random_sides

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.linear import Signal, exact_response, response_and_error
from fopi_tune.simulation.fractional.plant_sides import PowerSides, farthest_in_sector, farthest_zero, sides_of

#: of the response's size; what the estimate of the error may claim beside it is far less
CLOSE = 1e-6
TIMES = np.array([0.3, 1.1, 4.2])
NOMINAL = np.zeros(0)


def real(value: Any) -> float:
    """A number of mpmath."""
    return float(value)


def inverted(sides: tuple[Side, Side], gains: FoPi, late: float, signal: Signal, time: float) -> float:
    """The response by mpmath; with a dead time the terms (-L0)^k e^{-k L s} one by one, each free of delay."""

    def parts(s: Any) -> tuple[Any, Any]:
        n, d = (sum(c * s ** mp.mpf(e) for c, e in side) for side in sides)
        return gains.kp + gains.ki * s ** -mp.mpf(gains.alpha), n / d

    def first(s: Any) -> Any:
        c, p = parts(s)
        return {
            Signal.OUTPUT_AFTER_REFERENCE: c * p,
            Signal.CONTROL_AFTER_REFERENCE: c,
            Signal.OUTPUT_AFTER_LOAD: p,
        }[signal]

    def at(transform: Callable[[Any], Any], time: float) -> Any:
        return mp.invertlaplace(transform, time, method="talbot", degree=60)

    with mp.workdps(40):
        if not late:
            return real(at(lambda s: first(s) / (1 + mp.fprod(parts(s))) / s, time))
        start = 0 if signal is Signal.CONTROL_AFTER_REFERENCE else 1
        since = [(k, time - (k + start) * late) for k in range(math.floor(time / late) + 1 - start)]
        terms = (at(lambda s, k=k: first(s) * (-mp.fprod(parts(s))) ** k / s, left) for k, left in since)
        return real(mp.fsum(terms))


def stable_loop(seed: int, late: float) -> tuple[tuple[Side, Side], FoPi]:
    """Of random loops a stable one."""
    for salt in range(200):
        rng = np.random.default_rng([seed, salt, 5])
        sides, found = random_sides(rng), random_controller(rng)
        gains = FoPi(found.kp, found.ki, found.alpha)
        plants = Plants.members(family_of(sides, late), NOMINAL[None, :])
        resonant = (plants.corner_roots.imag > 0.0).any()
        if is_stable(Loops.of(gains, plants))[0] and not resonant:
            return sides, gains
    raise AssertionError("no stable loop")


@pytest.mark.thinned(5)
@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("late", [0.0, 0.52])
@pytest.mark.parametrize("signal", list(Signal))
def test_a_response_is_that_of_mpmath(seed: int, late: float, signal: Signal) -> None:
    sides, gains = stable_loop(seed, late)
    plant = family_of(sides, late).member(NOMINAL)
    found = response_and_error(gains, plant, signal, TIMES)
    wanted = np.array([inverted(sides, gains, late, signal, float(time)) for time in TIMES])
    size = float(np.abs(wanted).max())
    np.testing.assert_allclose(found.value, wanted, atol=CLOSE * size)
    assert float(found.error.max()) <= CLOSE * size


def test_the_published_plant_with_fopi_gains_settles_at_the_reference() -> None:
    gains = FoPi(0.05, 0.01, 0.9)
    plant = published().member(NOMINAL)
    times = np.array([1.0, 30.0, 3000.0])
    output = exact_response(gains, plant, Signal.OUTPUT_AFTER_REFERENCE, times)
    assert output[0] == 0.0
    sides: tuple[Side, Side] = ((66.16, 0.0),), ((12.72, 0.5), (1.0, 0.0))
    wanted = [inverted(sides, gains, 1.93, Signal.OUTPUT_AFTER_REFERENCE, time) for time in (30.0,)]
    np.testing.assert_allclose(output[1:2], wanted, atol=CLOSE)
    assert output[2] == pytest.approx(1.0, abs=0.02)


def test_a_first_order_lag_of_nearly_whole_order_answers_as_the_lag() -> None:
    # 1/(s^(1 + 1e-7) + 1) behind kp = 1:  (1 - e^(-2 t))/2, moved by the order about as much as that
    orders = (((1.0, 0.0),), ((1.0, 1.0000001), (1.0, 0.0)))
    plant = family_of(orders).member(NOMINAL)
    found = exact_response(FoPi(1.0, 0.0, 1.0), plant, Signal.OUTPUT_AFTER_REFERENCE, TIMES)
    np.testing.assert_allclose(found, 0.5 * (1.0 - np.exp(-2.0 * TIMES)), atol=1e-6)


def test_a_loop_that_is_unstable_or_has_a_derivative_is_answered_or_refused() -> None:
    unstable = family_of((((1.0, 0.0),), ((1.0, 1.5), (-1.0, 0.0)))).member(NOMINAL)
    found = response_and_error(FoPi(0.1, 0.0, 1.0), unstable, Signal.OUTPUT_AFTER_REFERENCE, TIMES)
    sides: tuple[Side, Side] = ((1.0, 0.0),), ((1.0, 1.5), (-1.0, 0.0))
    wanted = [inverted(sides, FoPi(0.1, 0.0, 1.0), 0.0, Signal.OUTPUT_AFTER_REFERENCE, float(t)) for t in TIMES]
    np.testing.assert_allclose(found.value, wanted, rtol=1e-6)
    with pytest.raises(DomainError):
        exact_response(FoPi(0.0, 0.0, 1.0), unstable, Signal.OUTPUT_AFTER_REFERENCE, TIMES)


def test_no_zero_of_a_sum_of_powers_is_farther_than_its_radius() -> None:
    # s^1.5 - 8: a zero at 4
    assert farthest_zero([(1.0, 1.5), (-8.0, 0.0)]) == pytest.approx(4.0)
    assert farthest_zero([(2.0, 0.5)]) == 0.0
    radius = farthest_zero([(1.0, 2.0), (3.0, 0.7), (-2.0, 0.0)])
    circle = radius * (1.0 + 1e-9) * np.exp(1j * np.linspace(-math.pi, math.pi, 1001))
    assert np.all(np.abs(circle**2.0) > np.abs(3.0 * circle**0.7 - 2.0))
    sides = sides_of(family_of((((1.0, 0.0),), ((1.0, 1.5), (-8.0, 0.0)))).member(NOMINAL))
    assert isinstance(sides, PowerSides)
    assert 4.0 < sides.rightmost_pole_rad_s < 4.3
    # s + 0.5 has its zero at 180 deg, beside the sector, and s^2 + 0.2 s + 1 nearly on the axis
    assert farthest_in_sector([(1.0, 1.0), (0.5, 0.0)]) == 0.0
    assert 1.0 < farthest_in_sector([(1.0, 2.0), (0.2, 1.0), (1.0, 0.0)]) < 1.1
    assert farthest_zero([(1.0, 2.0), (0.2, 1.0), (1.0, 0.0)]) > 1.1
