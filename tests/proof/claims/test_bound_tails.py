"""Claims over tails and wide boxes, each of which once took more boxes than there is room for, or was not shown."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from cases.plants import lag, pole, transfer_function
from flint import ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.peaks import Response
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity
from fopi_tune.proof.claims.crossings import EveryCrossover, EveryPhaseCrossover
from fopi_tune.proof.claims.lag import closed_form

EVERYWHERE = (-math.inf, math.inf)


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def margin(loop: BallLoop, level: float) -> EveryCrossover:
    domain = (EVERYWHERE, *loop.family_box)
    return EveryCrossover(loop, CrossingQuantity.PHASE_MARGIN, level, False, domain, 0.0, CrossingEvaluator(loop))


def test_a_dead_time_that_may_be_0_is_not_halved_for_ever() -> None:
    # `longest_axis`: relative_length((0, x)) is 1 whatever x, so that axis wins down to 5e-324
    plant = transfer_function([2.0, 3.0], [1.0, (11.0, 18.0), 53.0, 18.0], (0.0, 0.2))
    loop = BallLoop(FoPi(2.2, 0.88, 0.24), plant)
    assert search(margin(loop, 2.5), 4000).shown  # the true minimum is 2.9
    assert search(Bound(loop, Response.SENSITIVITY, 0.2, True, (EVERYWHERE, *loop.family_box), 0.0), 4000).shown


def test_a_tail_whose_plants_are_too_many_is_cut_along_them() -> None:
    # Bound.examine: slopes not finite in a tail -> _axis_of_gain -> 0 for ever, here at L(0) in [-0.96, -0.64]
    loop = BallLoop(FoPi(-0.8, 0.0, 1.0), lag((0.8, 1.2), 3.5))
    claim = Bound(loop, Response.SENSITIVITY, 4.0, True, (EVERYWHERE, *loop.family_box), 0.0)
    assert search(claim, 4000).shown  # |S| <= 1/(1 - 0.96) = e^3.22
    loop = BallLoop(FoPi(-1.0, 0.0, 1.0), pole(-1.0, (-0.8, -0.4), (0.1, 0.2)))
    claim = Bound(loop, Response.SENSITIVITY, 4.0, True, (EVERYWHERE, *loop.family_box), 0.0)
    assert search(claim, 4000).shown


def test_a_crossover_far_below_the_lags_corner_keeps_its_phase_margin() -> None:
    # (2) there: sqrt(|G|^2 - 1) = omega tau = 1e-9, of which 64 bits leave nothing; the general claim takes 31 boxes
    loop = BallLoop(FoPi(0.2, 0.5, 0.08), lag(0.35, (1.5, 5.0)))
    claim = margin(loop, math.radians(170.0))
    assert search(claim, 4000).shown
    assert search(closed_form(claim), 4000).shown


def test_a_direct_path_below_1_around_a_dead_time_is_below_1() -> None:
    # the unit disc is a square in acb: |n| grows by sqrt 2 in the high tail, and |L| = 0.8 is not below 1
    loop = BallLoop(FoPi(1.0, 0.0, 1.0), transfer_function([0.8, 2.0], [1.0, 1.0], 0.1))
    assert search(Bound(loop, Response.LOOP_GAIN, math.log(0.9), True, ((2.5, math.inf),), 0.0), 4000).shown
    assert search(margin(loop, math.radians(60.0)), 4000).shown


def test_the_closed_form_of_the_gain_margin_takes_no_more_boxes_than_the_general_one() -> None:
    # (3) has no exit where |L| < e^-level: high frequencies are cut until Re G and Im G settle each turn
    loop = BallLoop(FoPi(0.45, 0.6, 1.1), lag(1.3, (0.2, 6.0), 0.35))
    claim = EveryPhaseCrossover(loop, 0.98, (EVERYWHERE, *loop.family_box), -0.3)
    assert search(closed_form(claim), 20_000).boxes <= search(claim, 20_000).boxes


def test_the_size_of_a_delayed_loop_is_finite_in_a_tail_of_wide_time_constants() -> None:
    # LoopEnclosure.size divides by abs(d), whose ball holds 0 when tau's range is wide; d.abs_lower() is 0.2
    loop = BallLoop(FoPi(0.3, 0.5, 1.3), lag(1.3, (0.2, 6.0), 0.2))
    over = loop.over(((30.0, math.inf), (0.2, 6.0)))
    assert over.size < 1e-9
