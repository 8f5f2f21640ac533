"""Enclosures over boxes, against the formulas written down anew in plain complex arithmetic and its differences."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from cases.plants import lag, lag_gain_and_delay, pole, transfer_function
from flint import acb, arb, ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, with_interval
from fopi_tune.proof.balls.loop import BallLoop, LoopEnclosure

#: relative; the oracle's own rounding, enlarged by cancellation in polynomials and in 1 + L
ROUNDING = 1e-9
#: relative; a fourth-order difference quotient with steps of 1e-3 to 4e-3 errs by this at most
DIFFERENCE = 1e-5


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


# --- the oracle ----------------------------------------------------------------------------------------------------

Theta = tuple[float, ...]


def member(family: PlantFamily, theta: Theta) -> tuple[list[float], list[float], float]:
    """Numerator, denominator and dead time of one plant, from the models' definitions."""
    p = {name: number.nominal for name, number in family.parameters.items()}
    p |= dict(zip(family.uncertain_names, theta, strict=True))
    if family.model == "lag":
        return [p["static_gain"]], [p["time_constant_s"], 1.0], p["dead_time_s"]
    if family.model == "pole":
        return [p["gain"]], [1.0, p["pole_rad_s"]], p["dead_time_s"]
    numerator = [value for name, value in p.items() if name.startswith("numerator")]
    return numerator, [value for name, value in p.items() if name.startswith("denominator")], p["dead_time_s"]


def controller(gains: FoPi, u: float) -> complex:
    return gains.kp + gains.ki * (1j * math.exp(u)) ** -gains.alpha


def gain(loop: BallLoop, u: float, theta: Theta) -> complex:
    numerator, denominator, dead_time = member(loop.family, theta)
    s = 1j * math.exp(u)
    p = complex(np.polyval(numerator, s) / np.polyval(denominator, s))
    return controller(loop.gains, u) * p * cmath.exp(-s * dead_time)


def characteristic(loop: BallLoop, u: float, theta: Theta) -> complex:
    numerator, denominator, dead_time = member(loop.family, theta)
    s = 1j * math.exp(u)
    n = complex(np.polyval(numerator, s)) * cmath.exp(-s * dead_time)
    return complex(np.polyval(denominator, s)) + controller(loop.gains, u) * n


def responses(loop: BallLoop, u: float, theta: Theta) -> dict[str, complex]:
    value = gain(loop, u, theta)
    return {
        "gain": value,
        "sensitivity": 1.0 / (1.0 + value),
        "complementary": value / (1.0 + value),
        "control_sensitivity": controller(loop.gains, u) / (1.0 + value),
    }


def first_difference(log_ratio: Callable[[float, float], complex], h: float) -> complex:
    """f'(0) from ln of ratios, f(a) - f(b); fourth order."""
    return (8.0 * log_ratio(h, -h) - log_ratio(2.0 * h, -2.0 * h)) / (12.0 * h)


def second_difference(log_ratio: Callable[[float, float], complex], h: float) -> complex:
    """f''(0), fourth order."""

    def around(step: float) -> complex:
        return log_ratio(step, 0.0) + log_ratio(-step, 0.0)

    return (16.0 * around(h) - around(2.0 * h)) / (12.0 * h**2)


def moved(theta: Theta, axis: int, step: float) -> Theta:
    return (*theta[: axis - 1], theta[axis - 1] + step, *theta[axis:])


def derivatives(loop: BallLoop, u: float, theta: Theta) -> dict[str, list[complex]]:
    """d/du, d/dtheta, d2/du2 and d2/du dtheta of ln L by differences."""

    def along(axis: int, u0: float = u) -> Callable[[float, float], complex]:
        def at(step: float) -> complex:
            return gain(loop, u0 + step, theta) if axis == 0 else gain(loop, u0, moved(theta, axis, step))

        return lambda a, b: cmath.log(at(a) / at(b))

    steps = [1e-3 * max(abs(value), 0.1) for value in theta]
    gradient = [first_difference(along(k), h) for k, h in enumerate(steps, 1)]
    mixed = []
    for k, h in enumerate(steps, 1):

        def change(step: float, k: int = k, h: float = h) -> complex:
            return first_difference(along(k, u + step), h)

        mixed.append((8.0 * (change(2e-3) - change(-2e-3)) - (change(4e-3) - change(-4e-3))) / 24e-3)
    return {
        "log_slope": [first_difference(along(0), 1e-3)],
        "log_gradient": gradient,
        "log_curvature": [second_difference(along(0), 2e-3)],
        "log_slope_gradient": mixed,
    }


def enclosed(at: LoopEnclosure) -> dict[str, list[acb]]:
    return {
        "log_slope": [at.log_slope],
        "log_gradient": at.log_gradient,
        "log_curvature": [at.log_curvature],
        "log_slope_gradient": at.log_slope_gradient,
    }


def encloses(ball: acb, value: complex, tolerance: float) -> bool:
    radius = arb(0, tolerance)
    return bool((ball + acb(radius, radius)).contains(acb(value)))


# --- random loops --------------------------------------------------------------------------------------------------


def random_loop(rng: np.random.Generator) -> BallLoop:
    """Any model with up to three uncertain numbers, either sign, kp = 0 and ki = 0 among them."""

    def number(value: float, uncertain: bool) -> float | tuple[float, float]:
        low, high = rng.uniform(0.01, 0.4, 2)
        return (value - low * abs(value), value + high * abs(value)) if uncertain else value

    def signed(least: float, most: float) -> float:
        return float(rng.choice([-1.0, 1.0], p=[0.25, 0.75]) * 10.0 ** rng.uniform(least, most))

    delay = rng.choice([0.0, 0.2, 1.3])
    dead_time = (0.0, float(delay)) if delay and rng.random() < 0.4 else float(delay)
    uncertain = (rng.random(4) < 0.5).tolist()
    model = rng.integers(0, 3)
    if model == 0:
        family = lag(number(signed(-1, 1), uncertain[0]), number(10.0 ** rng.uniform(-1, 1), uncertain[1]), dead_time)
    elif model == 1:
        p = float(rng.uniform(-1.0, 1.5))
        family = pole(number(signed(-1, 1), uncertain[0]), (p - 0.3, p + 0.2) if uncertain[1] else p, dead_time)
    else:
        degree = int(rng.integers(1, 4))
        roots = -(10.0 ** rng.uniform(-1, 1, degree)) * rng.choice([-1.0, 1.0], degree, p=[0.2, 0.8])
        denominator = [number(float(c), k == 1 and uncertain[1]) for k, c in enumerate(np.poly(roots))]
        top = [signed(-0.5, 0.5) for _ in range(int(rng.integers(1, degree + 2)))]
        numerator = [number(c, k == 0 and uncertain[0]) for k, c in enumerate(top)]
        family = transfer_function(numerator, denominator, dead_time)
    kp, ki = (float(rng.choice([0.0, 1.0, -1.0], p=[0.15, 0.7, 0.15]) * 10.0 ** rng.uniform(-1, 1)) for _ in range(2))
    return BallLoop(FoPi(kp if kp or ki else 1.0, ki, float(rng.uniform(0.02, 1.98))), family)


def random_box(rng: np.random.Generator, loop: BallLoop, tails: bool) -> Box:
    centre, width = float(rng.uniform(-4.0, 4.0)), float(10.0 ** rng.uniform(-4.0, -0.3))
    choices = [(centre - 0.5 * width, centre + 0.5 * width), (-math.inf, centre - 4.0), (centre + 4.0, math.inf)]
    box: Box = (choices[int(rng.integers(0, 3)) if tails else 0],)
    for low, high in loop.family_box:
        a, b = sorted(rng.uniform(low, high, 2).tolist())
        box += ((a, b),) if rng.random() < 0.5 else ((a, min(high, a + 1e-3 * (b - a))),)
    return box


def random_place(rng: np.random.Generator, box: Box) -> tuple[float, Theta]:
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
    rng = np.random.default_rng(101)
    finite = 0
    for _ in range(250):
        loop = random_loop(rng)
        box = random_box(rng, loop, tails=True)
        ball = getattr(loop.over(box), name)
        finite += ball.is_finite()
        for _ in range(6):
            u, theta = random_place(rng, box)
            value = responses(loop, u, theta)[name]
            assert encloses(ball, value, ROUNDING * abs(value)), (loop, box, u, theta)
    # Where L is unbounded in a tail, and where a wide box holds a pole, there is no finite enclosure.
    assert finite > 120


def test_one_over_the_loop_is_enclosed_where_the_loop_has_no_end() -> None:
    rng = np.random.default_rng(102)
    finite = 0
    for _ in range(150):
        loop = random_loop(rng)
        box = with_interval(random_box(rng, loop, tails=False), 0, (-math.inf, float(rng.uniform(-6.0, -2.0))))
        ball = loop.over(box).inverse_gain
        finite += ball.is_finite()
        for _ in range(4):
            u, theta = random_place(rng, box)
            value = 1.0 / gain(loop, u, theta)
            assert encloses(ball, value, ROUNDING * abs(value)), (loop, box, u, theta)
    assert finite > 75


def test_a_single_place_has_its_response_to_the_last_digits() -> None:
    rng = np.random.default_rng(103)
    for _ in range(100):
        loop = random_loop(rng)
        u, theta = random_place(rng, random_box(rng, loop, tails=False))
        at = loop.over(((u, u), *((value, value) for value in theta)))
        for name, value in responses(loop, u, theta).items():
            ball = getattr(at, name)
            assert abs(complex(ball.mid()) - value) < ROUNDING * abs(value), (loop, u, theta, name)
            # 64 bits are 5e-20; a polynomial near its root and 1 + L near 0 lose some of them, T = 1 - S is about 1's
            assert float(ball.rad()) < 1e-12 * abs(value) + 1e-17, (loop, u, theta, name)


def test_the_integral_alone_bounds_t_and_one_minus_s_down_to_frequency_zero() -> None:
    loop = BallLoop(FoPi(0.5, 0.6, 0.8), lag(1.0, (1.0, 2.0)))
    over = loop.over(((-math.inf, -40.0), (1.0, 2.0)))
    # |S| <= 2 |s^alpha|/ki at such low frequency: e^-32/0.3
    assert over.sensitivity.abs_upper() < 1e-13
    assert abs(over.complementary - 1).abs_upper() < 1e-13
    assert abs(over.control_sensitivity - 1).abs_upper() < 1e-12


def test_the_high_tail_shows_that_the_loop_dies_out_under_any_dead_time() -> None:
    loop = BallLoop(FoPi(0.5, 0.6, 0.8), lag_gain_and_delay())
    over = loop.over(((25.0, math.inf), *loop.family_box))
    assert over.gain.abs_upper() < 1e-9
    assert abs(over.sensitivity - 1).abs_upper() < 1e-9


def test_a_box_without_any_end_in_frequency_is_refused() -> None:
    loop = BallLoop(FoPi(1.0, 0.0, 1.0), lag())
    with pytest.raises(ValueError, match="cut it first"):
        loop.over(((-math.inf, math.inf),))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", ["log_slope", "log_gradient", "log_curvature", "log_slope_gradient"])
def test_every_member_of_a_box_has_its_derivative_inside_the_enclosure(name: str) -> None:
    rng = np.random.default_rng(104)
    finite, compared = 0, 0
    for _ in range(150):
        loop = random_loop(rng)
        box = random_box(rng, loop, tails=False)
        balls = enclosed(loop.over(box))[name]
        u, theta = random_place(rng, box)
        for ball, value in zip(balls, derivatives(loop, u, theta)[name], strict=True):
            finite, compared = finite + ball.is_finite(), compared + 1
            assert encloses(ball, value, DIFFERENCE * (1.0 + abs(value))), (loop, box, u, theta)
    assert finite > 0.8 * compared > 50


def test_derivatives_at_a_single_place_are_those_of_the_formula() -> None:
    rng = np.random.default_rng(105)
    compared = 0
    for _ in range(150):
        loop = random_loop(rng)
        u, theta = random_place(rng, random_box(rng, loop, tails=False))
        # over a box without a width the derivatives along the plants are left out
        balls = enclosed(loop.enclosure((u, u), loop.plant([arb(value) for value in theta])))
        for name, values in derivatives(loop, u, theta).items():
            for ball, value in zip(balls[name], values, strict=True):
                assert abs(complex(ball.mid()) - value) < DIFFERENCE * (1.0 + abs(value)), (loop, u, theta, name)
                compared += 1
    assert compared > 500


def test_the_controllers_slope_and_the_characteristic_are_those_of_the_formula() -> None:
    rng = np.random.default_rng(106)
    for _ in range(100):
        loop = random_loop(rng)
        u, theta = random_place(rng, random_box(rng, loop, tails=False))
        at = loop.over(((u, u), *((value, value) for value in theta)))
        c = [controller(loop.gains, u + step) for step in (-1e-5, 1e-5)]
        # second-order differences with steps of 1e-5 err by 1e-10 f''' and by rounding, 1e-16/1e-5
        assert abs(complex(at.controller_slope.mid()) - cmath.log(c[1] / c[0]) / 2e-5) < 1e-6, loop
        f = [characteristic(loop, u + step, theta) for step in (-1e-5, 0.0, 1e-5)]
        numerator, denominator, _ = member(loop.family, theta)
        s = math.exp(u)
        # the terms of F, of which rounding is a part
        size = np.polyval(np.abs(denominator), s) + abs(controller(loop.gains, u)) * np.polyval(np.abs(numerator), s)
        assert abs(complex(at.characteristic.mid()) - f[1]) < ROUNDING * size, (loop, u, theta)
        slope = (f[2] - f[0]) / 2e-5
        assert abs(complex(at.characteristic_slope.mid()) - slope) < 1e-7 * (1.0 + s) ** 2 * size, (loop, u, theta)


def test_the_uncertain_dead_time_has_no_derivative_in_the_high_tail() -> None:
    loop = BallLoop(FoPi(1.0, 0.5, 0.5), lag(1.0, 1.0, (0.1, 0.2)))
    assert not loop.over(((3.0, math.inf), (0.1, 0.2))).log_gradient[0].is_finite()
