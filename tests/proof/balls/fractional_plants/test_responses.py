"""Balls of loops with fractional plants hold what a dense evaluation has inside their boxes, tails included."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.random_fractional import family_of, random_controller, random_sides
from flint import acb
from oracles.fractional_loops import FractionalMembers

from fopi_tune.core.controller import FoPi
from fopi_tune.core.fractional_plants.orders import Orders
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.proof.balls.fractional_plants.responses import FractionalLoopEnclosure, least_gap
from fopi_tune.proof.balls.loop import BallLoop

STEP = 1e-5


def holds(ball: acb, value: complex, room: float) -> bool:
    """Whether a ball, widened by the error of a difference, holds a number."""
    parts = ((ball.real, value.real), (ball.imag, value.imag))
    return all(abs(float(part.mid()) - number) <= float(part.rad()) + room for part, number in parts)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(40))
def test_values_and_derivatives_inside_a_box_are_inside_its_balls(seed: int) -> None:
    rng = np.random.default_rng([seed, 3])
    family, gains = family_of(random_sides(rng), 0.2, 0.1, 2), random_controller(rng)
    loop, members = BallLoop(gains, family), FractionalMembers(family, gains)  # pyright: ignore[reportArgumentType]
    low, width = float(rng.uniform(-3.0, 3.0)), float(10.0 ** rng.uniform(-3.0, -1.0))
    box = ((low, low + width), *zip(family.low.tolist(), family.high.tolist(), strict=True))
    over = loop.over(box)
    assert isinstance(over, FractionalLoopEnclosure)
    for _ in range(5):
        u, point = low + width * rng.random(), family.low + rng.random(2) * (family.high - family.low)

        def log_gain(u: float, point: np.ndarray) -> complex:
            return complex(np.log(members.loop(point).joined.gain(np.array([math.exp(u)]))[0]))

        def change(one: complex, other: complex) -> complex:
            found = one - other
            return complex(found.real, (found.imag + math.pi) % (2.0 * math.pi) - math.pi)

        value = np.exp(log_gain(u, point))
        if not over.gain.is_finite():
            continue
        assert holds(over.gain, value, 1e-12 * abs(value))
        assert holds(over.sensitivity, 1.0 / (1.0 + value), 1e-12 / abs(1.0 + value))
        slope = change(log_gain(u + STEP, point), log_gain(u - STEP, point)) / (2.0 * STEP)
        # an error of a central difference: the third derivative times STEP^2/6, and rounding over STEP
        assert holds(over.log_slope, slope, 1e-6 * (1.0 + abs(slope)))
        for axis, gradient in enumerate(over.log_gradient):
            move = np.zeros(2)
            move[axis] = STEP * point[axis]
            along = change(log_gain(u, point + move), log_gain(u, point - move)) / (2.0 * move[axis])
            assert holds(gradient, along, 1e-6 * (1.0 + abs(along)))


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("filtered", [False, True])
def test_tails_hold_all_frequencies_beyond_their_end(seed: int, filtered: bool) -> None:
    rng = np.random.default_rng([seed, 4])
    family = family_of(random_sides(rng))
    used = MeasurementFilter(2, 0.3) if filtered else None
    gains = FoPi(float(rng.uniform(0.1, 3.0)), float(rng.uniform(0.1, 3.0)), 0.7, measurement_filter=used)
    loop, members = BallLoop(gains, family), FractionalMembers(family, gains)  # pyright: ignore[reportArgumentType]
    for tail in ((-math.inf, -5.0), (5.0, math.inf)):
        over = loop.over((tail,))
        for u in (abs(tail[0] if tail[1] > 0 else tail[1]) * np.array([1.0, 1.5, 4.0])) * (1 if tail[1] > 0 else -1):
            omega = np.array([math.exp(u)])
            value = complex(members.loop(np.zeros(0)).joined.gain(omega)[0])
            value *= complex(used(1j * omega)[0]) if used else 1.0
            plant = value / complex(gains(1j * omega)[0])
            # C S and P S have C with its filter and P without it
            found = (over.sensitivity, 1.0 / (1.0 + value)), (over.complementary, value / (1.0 + value))
            found += (
                (over.control_sensitivity, value / plant / (1.0 + value)),
                (over.load_sensitivity, plant / (1.0 + value)),
            )
            for ball, wanted in found:
                if ball.is_finite():
                    assert holds(ball, wanted, 1e-12 * abs(wanted))


def test_terms_grow_apart_as_slowly_as_their_orders_are_close() -> None:
    assert least_gap(Orders((0.0,), (0.5, 0.3, 0.0))) == pytest.approx(0.2)
    assert least_gap(Orders((0.0,), (2.0, 0.0))) == 1.0
