"""The closed forms of the lag against their definitions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from cases.plants import lag, pole
from flint import arb, ctx
from numpy.typing import NDArray

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response
from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims import lag as original
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity, angle_from_minus_one
from fopi_tune.proof.claims.crossings import EveryCrossover
from fopi_tune.proof.claims.existence import SomeCrossover
from fopi_tune.proof.claims.lag import LagBound, closed_form
from fopi_tune.proof.claims.lag_response import LagResponse

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
EVERYWHERE: Interval = (-math.inf, math.inf)


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


# --- the definition ------------------------------------------------------------------------------------------------


def numbers(loop: BallLoop) -> tuple[float, float]:
    """Static gain and dead time."""
    return loop.family.parameters["static_gain"].nominal, loop.family.parameters["dead_time_s"].nominal


def controller(loop: BallLoop, u: Array) -> Complex:
    """C(j e^u)."""
    return np.asarray(loop.gains.kp + loop.gains.ki * (1j * np.exp(u)) ** -loop.gains.alpha, dtype=complex)


def loop_response(loop: BallLoop, u: Array, tau: Array) -> Complex:
    """L."""
    gain, dead_time = numbers(loop)
    s = 1j * np.exp(u)
    return np.asarray(controller(loop, u) * gain * np.exp(-s * dead_time) / (tau * s + 1.0), dtype=complex)


def log_response(loop: BallLoop, response: Response, u: Array, tau: Array) -> Array:
    c, value = controller(loop, u), loop_response(loop, u, tau)
    if response is Response.LOOP_GAIN:
        return np.log(np.abs(value))
    top = {
        Response.SENSITIVITY: np.ones_like(value),
        Response.COMPLEMENTARY_SENSITIVITY: value,
        Response.CONTROL_SENSITIVITY: c,
        Response.LOAD_SENSITIVITY: value / c,
    }
    return np.log(np.abs(top[response] / (1.0 + value)))


def random_loop(rng: np.random.Generator) -> BallLoop:
    kp, ki = (float(rng.choice([0.0, 1.0, -1.0], p=[0.1, 0.7, 0.2]) * 10.0 ** rng.uniform(-1, 1)) for _ in range(2))
    gain = float(rng.choice([-1.0, 1.0], p=[0.25, 0.75]) * 10.0 ** rng.uniform(-0.7, 0.7))
    tau = float(10.0 ** rng.uniform(-1, 1))
    family = lag(gain, (0.7 * tau, 1.4 * tau), float(rng.choice([0.0, 0.3, 1.0])))
    return BallLoop(FoPi(kp if kp or ki else 1.0, ki, float(rng.uniform(0.1, 1.9))), family)


def bound(loop: BallLoop, response: Response, level: float, upper: bool, band: Interval = EVERYWHERE) -> Bound:
    return Bound(loop, response, level, upper, (band, *loop.family_box), -0.3)


def at(form: Any, u: float) -> Any:
    """G at one frequency, as the closed forms see it."""
    return LagResponse(form.general.loop, arb(u), form._plant, form._tau)


@pytest.mark.parametrize("response", list(Response))
@pytest.mark.parametrize("upper", [True, False])
def test_the_quadratic_is_negative_exactly_where_the_bound_is_broken(response: Response, upper: bool) -> None:
    rng = np.random.default_rng(501)
    outcomes = []
    for _ in range(150):
        loop, level, u = random_loop(rng), float(rng.uniform(-1.5, 1.5)), float(rng.uniform(-3.0, 3.0))
        form = closed_form(bound(loop, response, level, upper))
        assert isinstance(form, LagBound)
        quadratic = form._quadratic(at(form, u))
        for x in (10.0 ** rng.uniform(-2, 2, 4)).tolist():
            tau = np.array([x * math.exp(-u)])
            slack = (level - float(log_response(loop, response, np.array([u]), tau)[0])) * (1.0 if upper else -1.0)
            value = original._end(quadratic, arb(x))
            # closer than that the double's own rounding could decide
            if abs(slack) > 1e-9:
                assert (value > 0) if slack > 0 else (value < 0), (loop, level, u, x)
                outcomes.append(slack > 0)
    assert 60 < sum(outcomes) < len(outcomes) - 60


@pytest.mark.parametrize("response", list(Response))
def test_the_quadratics_derivatives_are_those_of_its_values(response: Response) -> None:
    rng = np.random.default_rng(502)
    for _ in range(60):
        loop, u = random_loop(rng), float(rng.uniform(-2.0, 1.0))
        form = closed_form(bound(loop, response, float(rng.uniform(-1.0, 1.0)), bool(rng.random() < 0.5)))
        assert isinstance(form, LagBound)
        here, h = at(form, u), 1e-5
        before, after = at(form, u - h), at(form, u + h)
        q, q_before, q_after = (form._quadratic(place) for place in (here, before, after))
        # h^2 times third derivatives, which are a few times (x + |G|)^2 and (1 + |turn|)^3
        size = float(q[0][0].abs_upper() + q[1][0].abs_upper() + q[2][0].abs_upper() + here.x(True) ** 2) ** 2
        for upper in (False, True):
            change = original._end(q_after, after.x(upper)) - original._end(q_before, before.x(upper))
            assert abs(change / (2 * h) - original._end_slope(q, here.x(upper))).abs_upper() < 1e-6 * (1 + size)
        change = original._discriminant(q_after) - original._discriminant(q_before)
        assert abs(change / (2 * h) - original._discriminant_slope(q)).abs_upper() < 1e-6 * (1 + size)


def test_a_gain_crossover_lies_where_formula_2_says_and_has_its_angle_from_minus_one() -> None:
    rng = np.random.default_rng(503)
    seen = 0
    for _ in range(80):
        loop = random_loop(rng)
        tau = float(rng.uniform(loop.family.low[0], loop.family.high[0]))
        form = closed_form(bound(loop, Response.LOOP_GAIN, 0.0, True))
        found = gain_crossovers(Loops.of(loop.gains, Plants.members(loop.family, np.array([[tau]]))))
        for omega in found.omega_rad_s.tolist():
            g = at(form, math.log(omega))
            x = (g.g_squared[0] - 1).sqrt()
            # a crossover is known to 1e-12 in ln omega; where |L| is flat, x and the phase to less
            assert float(x.mid()) == pytest.approx(omega * tau, rel=1e-8, abs=1e-6)
            # b = arg(-L), modulo a turn
            angle = float((angle_from_minus_one(g.g) - x.atan()).mid())
            apart = np.exp(1j * angle) + complex(loop_response(loop, np.log(omega), np.array(tau)))
            assert abs(apart) < 1e-6, (loop, omega, tau)
            seen += 1
    assert seen > 50


def test_a_phase_crossover_lies_where_formula_3_says_and_has_its_gain() -> None:
    rng = np.random.default_rng(504)
    seen = 0
    for _ in range(80):
        loop = random_loop(rng)
        tau = float(rng.uniform(loop.family.low[0], loop.family.high[0]))
        form = closed_form(bound(loop, Response.LOOP_GAIN, 0.0, True))
        found = phase_crossovers(Loops.of(loop.gains, Plants.members(loop.family, np.array([[tau]]))))
        inner = found.omega_rad_s > 0.0  # at an end of the axis there is no u
        places = zip(found.omega_rad_s[inner].tolist(), found.gain[inner].tolist(), strict=True)
        for omega, gain in list(places)[:5]:
            g = at(form, math.log(omega)).g
            assert float(g.real.mid()) == pytest.approx(-gain, rel=1e-9)
            assert float((g.imag / g.real).mid()) == pytest.approx(omega * tau, rel=1e-9)
            seen += 1
    assert seen > 50


def test_only_a_lag_with_nothing_but_its_time_constant_uncertain_has_a_closed_form() -> None:
    gains = FoPi(0.5, 0.5, 0.8)
    for family in (lag(1.0, 2.0), lag((1.0, 2.0), 2.0), lag(1.0, (1.0, 2.0), (0.1, 0.2)), pole(1.0, (0.5, 1.0))):
        claim = bound(BallLoop(gains, family), Response.SENSITIVITY, 1.0, True)
        assert closed_form(claim) is claim
    loop = BallLoop(gains, lag(1.0, (1.0, 2.0)))
    evaluator, domain = CrossingEvaluator(loop), (EVERYWHERE, (1.0, 2.0))
    for quantity in (CrossingQuantity.PHASE_SLOPE, CrossingQuantity.CROSSOVER):
        claim = EveryCrossover(loop, quantity, 0.0, True, domain, 0.0, evaluator)
        assert closed_form(claim) is claim
    one = Bound(loop, Response.SENSITIVITY, 1.0, True, (EVERYWHERE, (1.5, 1.5)), 0.0)
    some = SomeCrossover(loop, CrossingQuantity.PHASE_MARGIN, 1.0, True, domain, 0.0, evaluator)
    assert closed_form(one) is one
    assert closed_form(some) is some
