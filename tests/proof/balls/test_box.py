"""Boxes, how they are cut, and first derivatives by duals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import Decimal, localcontext
from itertools import pairwise

import numpy as np
import pytest
from flint import arb, ctx

from fopi_tune.proof.balls.box import Box, ball_of, centre_of, log_interval, split, split_point
from fopi_tune.proof.balls.plant import Dual


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


# --- duals ---------------------------------------------------------------------------------------------------------


def test_duals_follow_the_differences_of_any_arithmetic() -> None:
    def formula(a, b, c):
        return (2.0 - a * b) / (c + 3.0 * a) - (-b) * (a - 1.5) + 1.0 / (b * c) + (c - a) / 4.0

    rng = np.random.default_rng(107)
    for _ in range(50):
        x = rng.uniform(0.5, 2.0, 3)
        found = formula(*(Dual(arb(float(value)), {axis: arb(1)}) for axis, value in enumerate(x)))
        assert float(found.value.mid()) == pytest.approx(formula(*x), rel=1e-13)
        for axis in range(3):
            step = 1e-5 * np.eye(3)[axis]
            # h^2 f''' and rounding over h, each about 1e-10
            expected = (formula(*(x + step)) - formula(*(x - step))) / 2e-5
            assert float(found.gradient[axis].mid()) == pytest.approx(expected, rel=1e-7, abs=1e-7)


def test_products_and_quotients_keep_their_rules() -> None:
    x, y = Dual(arb(3), {1: arb(1), 2: arb(5)}), Dual(arb(4), {2: arb(2), 3: arb(7)})
    product, quotient = x * y, x / y
    assert {axis: float(slope.mid()) for axis, slope in product.gradient.items()} == {1: 4.0, 2: 26.0, 3: 21.0}
    assert {axis: float(slope.mid()) for axis, slope in quotient.gradient.items()} == {
        1: 0.25,
        2: (5 * 4 - 3 * 2) / 16,
        3: -3 * 7 / 16,
    }
    assert Dual.of(2.5).gradient == {}


# --- boxes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high"), [(1.0, 10.0), (0.1, 1.0), (1.0 + 1e-12, 2.0), (0.3, 0.3), (1e-9, 1e9), (2e-308, 1e308), (7.0, 7.5)]
)
def test_outward_encloses_both_logarithms_tightly(low: float, high: float) -> None:
    first, last = log_interval(low, high)
    with localcontext() as context:
        context.prec = 60
        assert Decimal(first).exp() <= Decimal(low)
        assert Decimal(last).exp() >= Decimal(high)
    # a few units in the last place of the logarithm, or of 1
    for end, value in ((first, low), (last, high)):
        assert end == pytest.approx(math.log(value), rel=1e-14, abs=1e-14)


def test_outward_keeps_open_ends_open() -> None:
    assert log_interval(0.0, math.inf) == (-math.inf, math.inf)


def test_pieces_share_the_end_and_cover_the_box() -> None:
    rng = np.random.default_rng(108)
    sides = [(-math.inf, math.inf), (-math.inf, 2.0), (-1.0, math.inf), (0.25, 0.5), (1e-320, 1e-300), (-3.0, 1e17)]
    for side in sides:
        box: Box = (side, (1.0, 2.0))
        pieces: list[Box] = [box]
        for _ in range(40):
            k = int(rng.integers(0, len(pieces)))
            found = split(pieces[k], 0, 0.5)
            assert found is not None
            assert all(piece[1] == (1.0, 2.0) for piece in found)
            pieces[k : k + 1] = found
        assert pieces[0][0][0] == side[0]
        assert pieces[-1][0][1] == side[1]
        for before, after in pairwise(pieces):
            assert before[0][0] < before[0][1] == after[0][0]


def test_two_neighbouring_doubles_are_not_cut() -> None:
    assert split(((0.5, math.nextafter(0.5, 1.0)),), 0) is None
    assert split(((0.5, 0.5),), 0) is None


def test_an_axis_without_ends_is_cut_at_the_origin_and_a_tail_moves_outwards() -> None:
    assert split_point((-math.inf, math.inf), 0.7) == 0.7
    assert split_point((-math.inf, 2.0)) < 2.0
    assert split_point((2.0, math.inf)) > 2.0


def test_the_ball_of_an_interval_holds_its_ends_and_its_centre() -> None:
    rng = np.random.default_rng(109)
    for _ in range(200):
        low, high = sorted((rng.normal(size=2) * 10.0 ** rng.uniform(-9, 9)).tolist())
        ball, (centre,) = ball_of((low, high)), centre_of(((low, high),))
        assert all(ball.contains(arb(value)) for value in (low, centre, high))
        # the radius is rounded up to 30 bits
        assert float(ball.rad()) <= 0.5 * (high - low) * (1.0 + 1e-8) + 1e-18 * abs(high)
