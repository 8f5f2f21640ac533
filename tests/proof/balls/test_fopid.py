"""A derivative of any order in balls, against its formula in mpmath: values, derivatives and both ends."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
import pytest
from cases.plants import lag, transfer_function
from cases.random_fopids import fopid_for, mirrored
from cases.random_pids import plants_of, uncertain
from flint import acb, arb, ctx

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.proof.balls.box import Box, ball_of
from fopi_tune.proof.balls.controllers import FoPiStructure
from fopi_tune.proof.balls.fopid import FoPidStructure
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.pid import PidStructure

#: relative; the oracle has 40 digits, its differences 15; values go through doubles
EXACT = 1e-13
RESPONSES = ("gain", "sensitivity", "complementary", "control_sensitivity")


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64), mpmath.workdps(40):
        yield


def controller(found: FoPid, s: Any) -> Any:
    """C(s) on the principal branch, by logarithms of 40 digits."""
    log = mpmath.log(s)
    value = mpmath.mpf(found.kp) + mpmath.mpf(found.ki) * mpmath.exp(-mpmath.mpf(found.alpha) * log)
    top = mpmath.mpf(found.kd) * mpmath.exp(mpmath.mpf(found.mu) * log)
    return value + top / (mpmath.mpf(found.derivative_filter_time_constant_s) * s + 1)


def on_axis(u: float) -> Any:
    return 1j * mpmath.exp(mpmath.mpf(u))


def derivative(found: FoPid, u: float, order: int) -> complex:
    return complex(mpmath.diff(lambda v: mpmath.log(controller(found, 1j * mpmath.exp(v))), u, order))


def responses(loop: BallLoop, u: float, theta: tuple[float, ...]) -> dict[str, complex]:
    plant, s = loop.family.member(np.array(theta, dtype=float)), on_axis(u)
    top, bottom = (mpmath.fsum(c * s**k for k, c in enumerate(x[::-1])) for x in (plant.numerator, plant.denominator))
    assert isinstance(loop.gains, FoPid)
    c = controller(loop.gains, s)
    value = c * top / bottom * mpmath.exp(-s * plant.dead_time_s)
    found = (value, 1 / (1 + value), value / (1 + value), c / (1 + value))
    return {name: complex(each) for name, each in zip(RESPONSES, found, strict=True)}


def encloses(ball: acb, value: complex, tolerance: float) -> bool:
    radius = arb(0, tolerance)
    return bool((ball + acb(radius, radius)).contains(acb(value)))


def random_loop(rng: np.random.Generator) -> BallLoop:
    plants = plants_of(rng)
    found = fopid_for(rng, plants)
    if rng.random() < 0.25:
        plants, found = mirrored(plants, found)
    return BallLoop(found, uncertain(rng, plants))


def gains_of(loop: BallLoop) -> FoPid:
    assert isinstance(loop.gains, FoPid)
    return loop.gains


def test_every_member_of_a_box_has_its_responses_inside_the_enclosures() -> None:
    rng = np.random.default_rng(311)
    finite = 0
    for _ in range(250):
        loop = random_loop(rng)
        centre, width = float(rng.uniform(-5.0, 6.0)), float(10.0 ** rng.uniform(-4.0, -0.3))
        choices = [(centre - 0.5 * width, centre + 0.5 * width), (-math.inf, centre - 3.0), (centre + 3.0, math.inf)]
        box: Box = (choices[int(rng.integers(3))],)
        for low, high in loop.family_box:
            a, b = sorted(rng.uniform(low, high, 2).tolist())
            box += ((a, b),)
        over = loop.over(box)
        finite += over.sensitivity.is_finite()
        for _ in range(4):
            place = []
            for low, high in box:
                # thirty units into a tail, or an end of the box
                a, b = (high - 30.0 if math.isinf(low) else low), (low + 30.0 if math.isinf(high) else high)
                place.append(float((a if math.isinf(high) else b) if rng.random() < 0.33 else rng.uniform(a, b)))
            for name, value in responses(loop, place[0], tuple(place[1:])).items():
                # the plants' coefficients of the oracle are rounded to doubles
                assert encloses(getattr(over, name), value, 1e-9 * abs(value)), (loop, box, place, name)
    assert finite > 100


def test_the_controller_at_one_frequency_is_that_of_the_formula_with_its_derivatives() -> None:
    rng = np.random.default_rng(312)
    for _ in range(120):
        loop = random_loop(rng)
        found, u = gains_of(loop), float(rng.uniform(-9.0, 9.0))
        at, (c, s) = loop.controller_on((u, u)), loop.controller(arb(u))
        value, (slope, curvature) = complex(controller(found, on_axis(u))), (derivative(found, u, k) for k in (1, 2))
        for ball in (at.c, c):
            assert abs(complex(ball.mid()) - value) < EXACT * abs(value), (loop, u)
        for ball in (at.controller_slope, s):
            assert abs(complex(ball.mid()) - slope) < EXACT * (1.0 + abs(slope)), (loop, u)
        assert abs(complex(at.controller_curvature.mid()) - curvature) < EXACT * (1.0 + abs(curvature)), (loop, u)
        # 64 bits are 5e-20; next to a zero of C some are lost
        assert float(at.controller_curvature.rad()) < 1e-14 * (1.0 + abs(curvature))


def test_derivatives_over_an_interval_enclose_those_inside() -> None:
    rng = np.random.default_rng(313)
    finite = 0
    for _ in range(120):
        loop = random_loop(rng)
        found, low = gains_of(loop), float(rng.uniform(-6.0, 6.0))
        interval = low, low + float(10.0 ** rng.uniform(-3.0, -0.3))
        at, (c, slope) = loop.controller_on(interval), loop.controller(ball_of(interval))
        finite += at.controller_curvature.is_finite()
        for _ in range(3):
            u = float(rng.uniform(*interval))
            value = complex(controller(found, on_axis(u)))
            first, second = (derivative(found, u, order) for order in (1, 2))
            for ball, inside in (
                (at.c, value), (c, value), (at.controller_slope, first), (slope, first),
                (at.controller_curvature, second),
            ):  # fmt: skip
                assert encloses(ball, inside, EXACT * (1.0 + abs(inside))), (loop, interval, u)
    # a wide interval may hold a zero of C next to the axis
    assert finite > 90


def test_over_a_wide_interval_at_an_asymptote_the_slope_is_that_of_the_asymptote() -> None:
    loop = BallLoop(FoPid(1.0, 1.0, 0.8, 1.0, 0.7, 1e-6), lag())
    for interval, slope in (((-12.0, -11.0), -0.8), ((7.0, 7.5), 0.7), ((100.0, 101.0), 0.0)):
        assert abs(loop.controller_on(interval).controller_slope - slope).abs_upper() < 0.05
        assert abs(loop.controller_on(interval).controller_curvature).abs_upper() < 0.05


def test_at_the_ends_the_terms_of_the_controller_decide() -> None:
    found = FoPid(0.5, 0.6, 0.8, 0.3, 0.6, 0.1)
    over = BallLoop(found, lag(1.0, (1.0, 2.0), 0.4)).over(((60.0, math.inf), (1.0, 2.0)))
    # C -> kp, as (kd/Tf) omega^-0.4
    assert abs(over.control_sensitivity - 0.5).abs_upper() < 1e-9
    assert abs(over.gain).abs_upper() < 1e-20
    over = BallLoop(found, lag(1.0, (1.0, 2.0))).over(((-math.inf, -50.0), (1.0, 2.0)))
    # |S| <= 2 |s|^0.8/ki
    assert over.sensitivity.abs_upper() < 1e-16
    assert abs(over.control_sensitivity - 1).abs_upper() < 1e-15
    whole = FoPid(0.5, 0.6, 0.8, 0.3, 1.0, 0.1)
    over = BallLoop(whole, transfer_function([0.2, 1.0], [1.0, 1.0])).over(((70.0, math.inf),))
    assert abs(over.gain - 0.7).abs_upper() < 1e-15
    without = BallLoop(FoPid(0.5, 0.0, 0.8, 9.0, 0.6, 0.1), lag(2.0, 1.0)).over(((-math.inf, -80.0),))
    assert without.x is None
    assert abs(without.gain - 1).abs_upper() < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_bounds_next_to_the_ends_hold_in_the_right_half_plane(seed: int) -> None:
    rng = np.random.default_rng([315, seed])
    for _ in range(40):
        loop = random_loop(rng)
        found, structure = gains_of(loop), loop.structure
        kd, filter_s = mpmath.mpf(found.kd), found.derivative_filter_time_constant_s
        for _ in range(5):
            u, angle = float(rng.uniform(-6.0, 6.0)), float(rng.uniform(-0.5, 0.5)) * math.pi
            s = mpmath.exp(u) * mpmath.expj(angle if rng.random() < 0.7 else math.copysign(0.5 * math.pi, angle))
            near, far = s * mpmath.mpf(rng.uniform()), s / mpmath.mpf(rng.uniform(0.01, 1.0))
            c_near = controller(found, near) * (near ** mpmath.mpf(found.alpha) if found.ki else 1)
            moved = abs(c_near - float(structure.at_zero))
            assert moved <= float(structure.change_near_zero(u).upper()) * (1.0 + 1e-12) + 1e-15, (found, u)
            c_far = controller(found, far) - (found.kp + (kd / filter_s if found.mu == 1.0 else 0))
            assert abs(c_far) <= float(structure.change_near_infinity(u).upper()) * (1.0 + 1e-12), (found, u)


def test_special_cases_are_the_structures_that_they_are() -> None:
    plants, box = lag((1.0, 2.0)), ((-0.3, 0.2), (1.0, 2.0))
    without, fopi = BallLoop(FoPid(1.2, 0.7, 0.8, 0.0, 0.5, 0.1), plants), BallLoop(FoPi(1.2, 0.7, 0.8), plants)
    assert isinstance(without.structure, FoPiStructure)
    assert str(without.over(box).gain) == str(fopi.over(box).gain)
    same, pid = BallLoop(FoPid(1.2, 0.7, 1.0, 0.3, 1.0, 0.1), plants), BallLoop(Pid(1.2, 0.7, 0.3, 0.1), plants)
    assert type(same.structure) is PidStructure
    assert str(same.over(box).gain) == str(pid.over(box).gain)
    assert isinstance(BallLoop(FoPid(1.2, 0.7, 1.0, 0.3, 0.9, 0.1), plants).structure, FoPidStructure)


def test_orders_next_to_one_are_next_to_the_pid() -> None:
    plants, step = lag((1.0, 2.0)), 1e-12
    near, pid = BallLoop(FoPid(1.2, 0.7, 1.0, 0.3, 1.0 - step, 0.1), plants), BallLoop(Pid(1.2, 0.7, 0.3, 0.1), plants)
    for box in (((-0.3, 0.2), (1.0, 2.0)), ((-math.inf, -4.0), (1.0, 2.0)), ((4.0, 4.1), (1.0, 2.0))):
        one, other = near.over(box).sensitivity, pid.over(box).sensitivity
        assert one.overlaps(other)
        assert float(one.rad()) < 1.5 * float(other.rad()) + 1e-9
