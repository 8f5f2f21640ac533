"""The controller over an interval of frequencies is shared by boxes of plants, at one precision."""

from __future__ import annotations

import pytest
from cases.plants import lag
from flint import ctx

import fopi_tune as ft
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.digital.oustaloup import oustaloup
from fopi_tune.digital.transforms import tustin
from fopi_tune.proof.balls.box import ball_of
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.sampled import SampledBallLoop

GAINS = ft.FoPi(1.2, 0.7, 0.8)
NUMBERS = {
    "static_gain": Uncertain.between(0.8, 1.2),
    "time_constant_s": Uncertain.between(1.5, 2.5),
    "dead_time_s": Uncertain.between(0.1, 0.3),
}
FAMILY = PlantFamily(lag(1.0, 2.0, 0.2).model, NUMBERS)
SECTIONS = tustin(GAINS, oustaloup(GAINS.alpha, 3, (1e-3, 30.0)), 0.1)
LOOPS = {
    "continuous": BallLoop(GAINS, FAMILY),
    "on samples": SampledBallLoop(GAINS, FAMILY, Implementation(SECTIONS, 1.0)),
}
#: inner intervals and both tails
INTERVALS = ((-1.0, -0.5), (0.3, 0.3), (-float("inf"), -5.0), (4.0, float("inf")))
WHOLE, POINT = ((0.8, 1.2), (1.5, 2.5), (0.1, 0.15)), ((0.9, 0.9), (2.0, 2.0), (0.12, 0.12))
#: the time constant alone has a width
FACE = ((0.8, 0.8), (1.5, 2.5), (0.15, 0.15))


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("u", INTERVALS)
def test_boxes_of_one_interval_share_the_controller_and_their_loops_are_those_without_sharing(
    name: str, u: tuple[float, float]
) -> None:
    loop = LOOPS[name]
    for box in (WHOLE, FACE, POINT):
        found = loop.over((u, *box))
        assert found.at is loop.controller_on(u)
        alone = loop.new_controller_on(u)
        assert str(found.c) == str(alone.c)
        fresh = type(found)(loop, alone, loop.plants(box))  # pyright: ignore[reportArgumentType]
        assert str(fresh.gain) == str(found.gain)
        assert str(fresh.sensitivity) == str(found.sensitivity)


@pytest.mark.parametrize("name", LOOPS)
def test_another_precision_has_its_own_controller(name: str) -> None:
    loop = LOOPS[name]
    with ctx.workprec(64):
        short = loop.controller_on(INTERVALS[0])
    with ctx.workprec(128):
        long = loop.controller_on(INTERVALS[0])
        assert long is not short
        assert long.s.imag.overlaps(short.s.imag)


@pytest.mark.parametrize("name", LOOPS)
def test_derivatives_along_axes_without_a_width_are_left_out_and_the_others_unchanged(name: str) -> None:
    loop = LOOPS[name]
    u = INTERVALS[0]
    found = loop.over((u, *FACE))
    whole = loop.enclosure(u, loop.plant([ball_of(side) for side in FACE]))
    assert str(found.gain) == str(whole.gain)
    assert found.log_gradient[0].is_zero()
    assert not whole.log_gradient[0].is_zero()
    assert str(found.log_gradient[1]) == str(whole.log_gradient[1])
