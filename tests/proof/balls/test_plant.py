"""Coefficients of plants by parameters over boxes: values, derivatives, and exact rational numbers."""

from __future__ import annotations

import numpy as np
import pytest
from cases.parametric_plants import family_of
from flint import arb

from fopi_tune.proof.balls.box import ball_of
from fopi_tune.proof.balls.plant import assemble

RANGES = {"a": (0.5, 2.0), "b": (-1.0, 1.5), "k": (3.0, 4.0)}
FAMILY = family_of(RANGES, ["k * a / 3", "k - b"], ["k + a", "(a - b)**2 + 0.1", "a**3 * b * k"], dead_time_s="a")


def values(point: tuple[float, float, float]) -> list[float]:
    """By hand: N, D and the dead time."""
    a, b, k = point
    return [k * a / 3.0, k - b, k + a, (a - b) ** 2 + 0.1, a**3 * b * k, a]


@pytest.mark.parametrize("width", [1.0, 0.1, 1e-6])
def test_every_member_of_a_box_and_its_derivatives_lie_in_the_balls(width: float) -> None:
    rng = np.random.default_rng(3)
    low, high = FAMILY.low, FAMILY.high
    start = low + rng.uniform(0.0, 1.0 - 0.999 * width, 3) * (high - low)
    end = np.minimum(start + width * (high - low), high)
    plant = assemble(FAMILY, [ball_of((float(x), float(y))) for x, y in zip(start, end, strict=True)])
    found = [*plant.numerator, *plant.denominator, plant.dead_time]
    for _ in range(20):
        point = start + rng.uniform(size=3) * (end - start)
        for ball, value in zip(found, values(tuple(point)), strict=True):
            assert ball.value.overlaps(arb(value, 1e-13 * abs(value)))
        for axis in range(3):
            # central differences of polynomials of up to third degree in one number
            step = 1e-4 * np.eye(3)[axis]
            up, down = values(tuple(point + step)), values(tuple(point - step))
            for ball, more, less in zip(found, up, down, strict=True):
                slope = (more - less) / 2e-4
                assert ball.gradient.get(axis + 1, arb(0)).overlaps(arb(slope, 1e-6 * (1.0 + abs(slope))))


def test_a_third_is_no_double() -> None:
    plant = assemble(FAMILY, [arb(1), arb(0), arb(3)])
    assert (plant.numerator[0].value * 3).overlaps(arb(3))
    assert plant.numerator[0].value.contains(1)
    assert plant.numerator[0].value.rad() < 1e-15


def test_coefficients_that_cancel_leave_a_lower_degree() -> None:
    family = family_of(RANGES, ["a - a", "k"], ["a", "b", "k"])
    assert len(assemble(family, [arb(1), arb(0), arb(3)]).numerator) == 1


def test_terms_that_cancel_do_not_widen_a_coefficient_that_is_monotone() -> None:
    # (2 b - 10)^2 from 16 to 49, its terms from -11 to 76; a radius has 30 bits
    family = family_of({"b": (1.5, 3.0)}, [1], [1, "(2*b - 10)**2"])
    ball = assemble(family, [ball_of((1.5, 3.0))]).denominator[1].value
    assert ball.contains(16)
    assert ball.contains(49)
    assert float(ball.lower()) == pytest.approx(16.0, abs=1e-6)
    assert float(ball.upper()) == pytest.approx(49.0, abs=1e-6)
