"""A PID in balls, against its formula in mpmath: values, derivatives, both ends of the axis and bounds next to them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
import pytest
from cases.plants import lag, transfer_function
from cases.random_pids import mirrored, pid_for, plants_of, uncertain
from flint import acb, arb, ctx

from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.proof.balls.box import Box, ball_of
from fopi_tune.proof.balls.controllers import FoPiStructure
from fopi_tune.proof.balls.loop import BallLoop

#: relative; the oracle has 40 digits, its differences 15; values go through doubles
EXACT = 1e-13


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64), mpmath.workdps(40):
        yield


# --- the oracle ----------------------------------------------------------------------------------------------------


def controller(pid: Pid, s: Any) -> Any:
    return pid.kp + pid.ki / s + pid.kd * s / (pid.derivative_filter_time_constant_s * s + 1)


def log_controller_derivative(pid: Pid, u: float, order: int) -> complex:
    return complex(mpmath.diff(lambda v: mpmath.log(controller(pid, 1j * mpmath.exp(v))), u, order))


def gain(loop: BallLoop, u: float, theta: tuple[float, ...]) -> mpmath.mpc:
    plant = loop.family.member(np.array(theta, dtype=float))
    s = 1j * mpmath.exp(mpmath.mpf(u))
    top, bottom = (mpmath.fsum(c * s**k for k, c in enumerate(x[::-1])) for x in (plant.numerator, plant.denominator))
    assert isinstance(loop.gains, Pid)
    return controller(loop.gains, s) * top / bottom * mpmath.exp(-s * plant.dead_time_s)


def responses(loop: BallLoop, u: float, theta: tuple[float, ...]) -> dict[str, complex]:
    value = gain(loop, u, theta)
    assert isinstance(loop.gains, Pid)
    c = controller(loop.gains, 1j * mpmath.exp(mpmath.mpf(u)))
    found = {"gain": value, "sensitivity": 1 / (1 + value), "complementary": value / (1 + value)}
    return {name: complex(v) for name, v in (found | {"control_sensitivity": c / (1 + value)}).items()}


def encloses(ball: acb, value: complex, tolerance: float) -> bool:
    radius = arb(0, tolerance)
    return bool((ball + acb(radius, radius)).contains(acb(value)))


# --- random loops --------------------------------------------------------------------------------------------------


def random_loop(rng: np.random.Generator) -> BallLoop:
    plants = plants_of(rng)
    pid = pid_for(rng, plants)
    if rng.random() < 0.25:
        plants, pid = mirrored(plants, pid)
    return BallLoop(pid, uncertain(rng, plants))


def random_box(rng: np.random.Generator, loop: BallLoop, tails: bool) -> Box:
    centre, width = float(rng.uniform(-5.0, 6.0)), float(10.0 ** rng.uniform(-4.0, -0.3))
    choices = [(centre - 0.5 * width, centre + 0.5 * width), (-math.inf, centre - 3.0), (centre + 3.0, math.inf)]
    box: Box = (choices[int(rng.integers(3)) if tails else 0],)
    for low, high in loop.family_box:
        a, b = sorted(rng.uniform(low, high, 2).tolist())
        box += ((a, b),)
    return box


def random_place(rng: np.random.Generator, box: Box) -> tuple[float, tuple[float, ...]]:
    """Anywhere in a box, a third of the coordinates at its ends; thirty units into a tail."""
    place = []
    for low, high in box:
        a, b = (high - 30.0 if math.isinf(low) else low), (low + 30.0 if math.isinf(high) else high)
        near = a if math.isinf(high) else b
        place.append(float(near if rng.random() < 0.33 else rng.uniform(a, b)))
    return place[0], tuple(place[1:])


# --- enclosures ----------------------------------------------------------------------------------------------------


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", ["gain", "sensitivity", "complementary", "control_sensitivity"])
def test_every_member_of_a_box_has_its_response_inside_the_enclosure(name: str) -> None:
    rng = np.random.default_rng(211)
    finite = 0
    for _ in range(200):
        loop = random_loop(rng)
        box = random_box(rng, loop, tails=True)
        ball = getattr(loop.over(box), name)
        finite += ball.is_finite()
        for _ in range(5):
            u, theta = random_place(rng, box)
            value = responses(loop, u, theta)[name]
            # the plants' coefficients of the oracle are rounded to doubles
            assert encloses(ball, value, 1e-9 * abs(value)), (loop, box, u, theta)
    # in a low tail L has no end, and a wide box may hold a pole
    assert finite > 100


def test_the_controller_at_one_frequency_is_that_of_the_formula_with_its_derivatives() -> None:
    rng = np.random.default_rng(212)
    for _ in range(150):
        loop = random_loop(rng)
        assert isinstance(loop.gains, Pid)
        u = float(rng.uniform(-9.0, 9.0))
        at = loop.controller_on((u, u))
        slope, curvature = (log_controller_derivative(loop.gains, u, order) for order in (1, 2))
        value = complex(controller(loop.gains, 1j * mpmath.exp(mpmath.mpf(u))))
        assert abs(complex(at.c.mid()) - value) < EXACT * abs(value), (loop, u)
        assert abs(complex(at.controller_slope.mid()) - slope) < EXACT * (1.0 + abs(slope)), (loop, u)
        assert abs(complex(at.controller_curvature.mid()) - curvature) < EXACT * (1.0 + abs(curvature)), (loop, u)
        # 64 bits are 5e-20; next to a zero of C some are lost
        assert float(at.controller_curvature.rad()) < 1e-14 * (1.0 + abs(curvature))
        c, s = loop.controller(arb(u))
        assert abs(complex(c.mid()) - value) < EXACT * abs(value)
        assert abs(complex(s.mid()) - slope) < EXACT * (1.0 + abs(slope))


def test_derivatives_over_an_interval_enclose_those_inside() -> None:
    rng = np.random.default_rng(213)
    finite = 0
    for _ in range(150):
        loop = random_loop(rng)
        assert isinstance(loop.gains, Pid)
        low = float(rng.uniform(-6.0, 6.0))
        interval = low, low + float(10.0 ** rng.uniform(-3.0, -0.3))
        at, (c, slope) = loop.controller_on(interval), loop.controller(ball_of(interval))
        finite += at.controller_curvature.is_finite()
        for _ in range(3):
            u = float(rng.uniform(*interval))
            value = complex(controller(loop.gains, 1j * mpmath.exp(mpmath.mpf(u))))
            first, second = (log_controller_derivative(loop.gains, u, order) for order in (1, 2))
            for ball, inside in (
                (at.c, value), (c, value), (at.controller_slope, first), (slope, first),
                (at.controller_curvature, second),
            ):  # fmt: skip
                assert encloses(ball, inside, EXACT * (1.0 + abs(inside))), (loop, interval, u)
    # a wide interval may hold a zero of C next to the axis
    assert finite > 120


def test_the_slope_of_l_is_that_of_its_formula() -> None:
    rng = np.random.default_rng(214)
    for _ in range(60):
        loop = random_loop(rng)
        u, theta = random_place(rng, random_box(rng, loop, tails=False))
        at = loop.over(((u, u), *((value, value) for value in theta)))
        for order, ball in ((1, at.log_slope), (2, at.log_curvature)):
            value = complex(mpmath.diff(lambda v: mpmath.log(gain(loop, v, theta)), u, order))  # noqa: B023
            # the plants' coefficients of the oracle are rounded to doubles
            assert abs(complex(ball.mid()) - value) < 1e-9 * (1.0 + abs(value)), (loop, u, theta)


def test_over_a_wide_interval_at_an_asymptote_the_slope_is_that_of_the_asymptote() -> None:
    """Without the dominating power taken out the slope over (5, 5.5) would be 1 +- 1 in the place of 1 +- 0.04."""
    pid = Pid(1.0, 1.0, 1.0, 1e-6)
    loop = BallLoop(pid, lag())
    for interval, slope in (((-9.0, -8.0), -1.0), ((5.0, 5.5), 1.0), ((20.0, 21.0), 0.0)):
        assert abs(loop.controller_on(interval).controller_slope - slope).abs_upper() < 0.05
        assert abs(loop.controller_on(interval).controller_curvature).abs_upper() < 0.05


# --- the ends of the axis ------------------------------------------------------------------------------------------


def test_the_control_sensitivity_tends_to_the_direct_gain() -> None:
    pid = Pid(0.5, 0.6, 0.3, 0.1)
    over = BallLoop(pid, lag(1.0, (1.0, 2.0), 0.4)).over(((30.0, math.inf), (1.0, 2.0)))
    assert abs(over.c - 3.5).abs_upper() < 1e-11
    assert abs(over.gain).abs_upper() < 1e-11
    assert abs(over.control_sensitivity - 3.5).abs_upper() < 1e-10


def test_the_integral_alone_bounds_the_loop_down_to_frequency_zero() -> None:
    over = BallLoop(Pid(0.5, 0.6, 9.0, 0.1), lag(1.0, (1.0, 2.0))).over(((-math.inf, -40.0), (1.0, 2.0)))
    # |S| <= 2 |s|/ki
    assert over.sensitivity.abs_upper() < 1e-16
    assert abs(over.control_sensitivity - 1).abs_upper() < 1e-15


def test_without_an_integral_the_low_end_is_kp() -> None:
    over = BallLoop(Pid(0.5, 0.0, 9.0, 0.1), lag(2.0, 1.0)).over(((-math.inf, -40.0),))
    assert over.x is None
    assert abs(over.gain - 1).abs_upper() < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_bounds_next_to_the_ends_hold_in_the_right_half_plane(seed: int) -> None:
    rng = np.random.default_rng([215, seed])
    for _ in range(40):
        loop = random_loop(rng)
        pid, structure = loop.gains, loop.structure
        assert isinstance(pid, Pid)
        for _ in range(5):
            u, angle = float(rng.uniform(-6.0, 6.0)), float(rng.uniform(-0.5, 0.5)) * math.pi
            s = mpmath.exp(u) * mpmath.expj(angle if rng.random() < 0.7 else math.copysign(0.5 * math.pi, angle))
            near, far = s * mpmath.mpf(rng.uniform()), s / mpmath.mpf(rng.uniform(0.01, 1.0))
            c_near = controller(pid, near) * (near if pid.ki else 1)
            moved = abs(c_near - float(structure.at_zero))
            assert moved <= float(structure.change_near_zero(u).upper()) * (1.0 + 1e-12) + 1e-15, (pid, u)
            c_far = controller(pid, far) - (pid.kp + mpmath.mpf(pid.kd) / pid.derivative_filter_time_constant_s)
            assert abs(c_far) <= float(structure.change_near_infinity(u).upper()) * (1.0 + 1e-12), (pid, u)


def test_bounds_next_to_the_ends_are_not_much_larger_than_needed() -> None:
    pid = Pid(2.0, 0.5, 3.0, 0.2)
    structure = BallLoop(pid, lag()).structure
    for u in (-5.0, 0.0, 3.0):
        s = math.exp(u)
        assert float(structure.change_near_zero(u)) < 2.1 * abs(complex(controller(pid, 1j * s)) * 1j * s - 0.5)
        # along the real axis both terms of C - C(inf) have one sign or the other
        assert float(structure.change_near_infinity(u)) < 2.1 * max(
            abs(complex(controller(pid, point) - 17.0)) for point in (1j * s, complex(s))
        )


def test_a_derivative_of_0_is_the_pi_itself() -> None:
    ours, pi = BallLoop(Pid(1.2, 0.7, 0.0, 0.1), lag((1.0, 2.0))), BallLoop(FoPi(1.2, 0.7, 1.0), lag((1.0, 2.0)))
    assert isinstance(ours.structure, FoPiStructure)
    box: Box = ((-0.3, 0.2), (1.0, 2.0))
    assert str(ours.over(box).gain) == str(pi.over(box).gain)


def test_a_derivative_that_all_but_vanishes_is_close_to_the_pi() -> None:
    ours, pi = BallLoop(Pid(1.2, 0.7, 1e-13, 0.1), lag((1.0, 2.0))), BallLoop(FoPi(1.2, 0.7, 1.0), lag((1.0, 2.0)))
    for box in (((-0.3, 0.2), (1.0, 2.0)), ((-math.inf, -4.0), (1.0, 2.0)), ((4.0, math.inf), (1.0, 2.0))):
        near, far = ours.over(box).sensitivity, pi.over(box).sensitivity
        assert near.overlaps(far)
        assert float(near.rad()) < 1.2 * float(far.rad()) + 1e-12


def test_a_direct_path_passes_on_what_the_filter_leaves_of_the_derivative() -> None:
    over = BallLoop(Pid(0.5, 0.6, 0.3, 0.1), transfer_function([0.2, 1.0], [1.0, 1.0])).over(((60.0, math.inf),))
    # (kp + kd/Tf) 0.2, all of them doubles
    assert abs(over.gain - 0.7).abs_upper() < 1e-15
