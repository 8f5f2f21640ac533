"""A list of slips in the closed forms of the lag, each of which a short battery of claims notices."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable, Iterator
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from cases.plants import lag
from cases.thinned import thinned
from flint import ctx
from numpy.typing import NDArray

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response
from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims import lag as original
from fopi_tune.proof.claims import lag_response as original_response
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity
from fopi_tune.proof.claims.crossings import EveryCrossover, EveryPhaseCrossover

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Rows = NDArray[np.intp]
EVERYWHERE: Interval = (-math.inf, math.inf)
PLAIN = BallLoop(FoPi(0.45, 0.6, 1.1), lag(1.3, (1.0, 2.2), 0.35))
TWICE_NEGATIVE = BallLoop(FoPi(-0.45, -0.6, 1.1), lag(-1.3, (1.0, 2.2), 0.35))
#: their worst time constants lie inside the range
WIDE = BallLoop(FoPi(0.45, 0.6, 1.1), lag(1.3, (0.2, 6.0), 0.35))
NEGATIVE = BallLoop(FoPi(0.3, 0.5, 1.3), lag(-1.3, (0.2, 6.0), 0.2))
#: crosses |L| = 1 beyond -180 deg, so that a lead is the shortest way to -1
LATE = BallLoop(FoPi(0.45, 0.6, 1.1), lag(1.3, (1.0, 2.2), 3.0))
S, T, CS, _, PS = Response
MIDDLE, LOW, HIGH = (-1.5, 0.7), (-0.6, -0.2), (0.2, 0.6)
BOUNDS = [
    *((PLAIN, response, upper, MIDDLE) for response in Response for upper in (True, False)),
    *((WIDE, response, True, band) for response in (S, T, CS) for band in (LOW, HIGH)),
    *((NEGATIVE, response, False, band) for response in (S, CS) for band in (LOW, HIGH)),
    (PLAIN, S, True, EVERYWHERE),
]
#: neper, radian or second; how far from the worst value the battery's claims are
HAIR = 1e-7
#: boxes; the true claims of the battery take a third of it at most
BUDGET = 500
#: a claim of the general kind, and whether it is true
Question = tuple[Claim, bool]


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


# --- the battery ---------------------------------------------------------------------------------------------------


def numbers(loop: BallLoop) -> tuple[float, float]:
    """Static gain and dead time."""
    return loop.family.parameters["static_gain"].nominal, loop.family.parameters["dead_time_s"].nominal


def controller(loop: BallLoop, u: Array) -> Complex:
    return np.asarray(loop.gains.kp + loop.gains.ki * (1j * np.exp(u)) ** -loop.gains.alpha, dtype=complex)


def loop_response(loop: BallLoop, u: Array, tau: Array) -> Complex:
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


def bound(loop: BallLoop, response: Response, level: float, upper: bool, band: Interval = EVERYWHERE) -> Bound:
    return Bound(loop, response, level, upper, (band, *loop.family_box), -0.3)


def peak(function: Callable[[Array, Array], Array], u: Interval, tau: Interval) -> float:
    """The largest value over a rectangle: a grid, then ever smaller ones around its best place, down to 1e-10 of it."""
    low, high = np.array([u, tau]).T
    width = (high - low) / np.array([400, 20])
    grid = np.stack(np.meshgrid(np.linspace(*u, 401), np.geomspace(*tau, 65)), axis=-1).reshape(-1, 2)
    pattern = np.stack(np.meshgrid(*(2 * [np.linspace(-1.0, 1.0, 9)])), axis=-1).reshape(-1, 2)
    best, place = -math.inf, low
    for _ in range(60):
        values = function(grid[:, 0], grid[:, 1])
        if values.max() > best:
            best, place = float(values.max()), grid[np.argmax(values)]
        grid, width = np.clip(place + width * pattern, low, high), 0.7 * width
    return best


def around(claim_at: Callable[[float], Claim], worst: float, upper: bool) -> list[Question]:
    """True by a hair, false by a hair, and false by far."""
    out = 1.0 if upper else -1.0
    return [(claim_at(worst + out * HAIR), True), (claim_at(worst - out * HAIR), False), (claim_at(worst - out), False)]


def questions_about_bounds() -> Iterator[Question]:
    for loop, response, upper, band in BOUNDS:

        def value(
            u: Array, tau: Array, loop: BallLoop = loop, response: Response = response, up: bool = upper
        ) -> Array:
            return log_response(loop, response, u, tau) * (1.0 if up else -1.0)

        def claim(level: float, loop=loop, response=response, up: bool = upper, band=band) -> Claim:
            return bound(loop, response, level, up, band)

        worst = peak(value, (max(band[0], -6.0), min(band[1], 4.0)), loop.family_box[0])
        yield from around(claim, worst if upper else -worst, upper)


def highest_over_tau(loop: BallLoop, values: Callable[[Loops, Array], tuple[Rows, Array]]) -> float:
    """The largest value at a crossing: on a grid of time constants, then on two finer ones around its best place."""
    low, high = tau = loop.family_box[0]
    best = -math.inf
    for _ in range(3):
        places = np.linspace(*tau, 201)
        row, value = values(Loops.of(loop.gains, Plants.members(loop.family, places[:, None])), places)
        k = int(np.argmax(value))
        best, step = max(best, float(value[k])), (tau[1] - tau[0]) / 100.0
        tau = max(low, places[row[k]] - step), min(high, places[row[k]] + step)
    return best


def questions_about_crossings() -> Iterator[Question]:
    for loop in (PLAIN, TWICE_NEGATIVE, WIDE, NEGATIVE, LATE):
        domain, evaluator = (EVERYWHERE, *loop.family_box), CrossingEvaluator(loop)
        for quantity in (CrossingQuantity.PHASE_MARGIN, CrossingQuantity.DELAY_MARGIN):
            for upper, sign in ((True, 1.0), (False, -1.0)):

                def values(
                    loops: Loops, tau: Array, loop: BallLoop = loop, quantity: CrossingQuantity = quantity, sign=sign
                ) -> tuple[Rows, Array]:
                    row, omega = (found := gain_crossovers(loops)).row, found.omega_rad_s
                    angle = np.angle(-loop_response(loop, np.log(omega), tau[row]))
                    of_delay = quantity is CrossingQuantity.DELAY_MARGIN
                    return row, sign * (np.mod(angle, 2.0 * np.pi) / omega if of_delay else np.abs(angle))

                def claim(
                    level: float, loop=loop, quantity=quantity, up=upper, domain=domain, evaluator=evaluator
                ) -> Claim:
                    return EveryCrossover(loop, quantity, level, up, domain, -0.3, evaluator)

                yield from around(claim, sign * highest_over_tau(loop, values), upper)
    for loop in (PLAIN, TWICE_NEGATIVE, WIDE):

        def log_gains(loops: Loops, _: Array) -> tuple[Rows, Array]:
            found = phase_crossovers(loops)
            return found.row, np.where(found.gain < 1.0, np.log(found.gain), -np.inf)

        def apart(level: float, loop=loop) -> Claim:
            return EveryPhaseCrossover(loop, level, ((-3.0, 2.5), *loop.family_box), -0.3)

        yield from around(apart, -highest_over_tau(loop, log_gains), False)


@cache
def battery() -> list[Question]:
    return [*questions_about_bounds(), *questions_about_crossings()]


def is_caught(module: Any) -> bool:
    """Whether a claim of the battery is answered wrongly, or a true one not at all."""
    return any(search(module.closed_form(claim), BUDGET).shown is not true for claim, true in battery())


# --- the slips -----------------------------------------------------------------------------------------------------

T_LINE = "(m2, zero), linear, (distance - size, d_distance - slope)"
#: what a slip would change, and into what
SLIPS = [
    ("return acb(cosine, -sine)", "return acb(cosine, sine)"),
    ("acb(0, -turn)", "acb(0, turn)"),
    ("2 * size * self.log_slope.real", "-2 * size * self.log_slope.real"),
    ("2 * size * self.c_slope.real", "-2 * size * self.c_slope.real"),
    # the quadratics (1)
    ("2 * (real * self.slope.real + imag * self.slope.imag)", "-2 * (real * self.slope.real + imag * self.slope.imag)"),
    ("(m2 * square - size, m2 * d_square - slope)", "(m2 * square + size, m2 * d_square + slope)"),
    ("(m2 * square - size, m2 * d_square - slope)", "(m2 * square - size, m2 * d_square + slope)"),
    ("= one + g.real, d_one + slope.real", "= one - g.real, d_one - slope.real"),
    ("m2 * (a * a + b * b)", "m2 * (a * a - b * b)"),
    ("2 * m2 * (a * da + b * db)", "2 * m2 * (a * da - b * db)"),
    ("linear = m2 * b, m2 * db", "linear = -m2 * b, -m2 * db"),
    ("linear = m2 * b, m2 * db", "linear = m2 * b, -m2 * db"),
    ("(m2 - 1, zero), linear", "(m2 + 1, zero), linear"),
    ("linear, (distance - square, d_distance - d_square)", "linear, (distance + square, d_distance + d_square)"),
    ("linear, (distance - square, d_distance - d_square)", "linear, (distance - square, -d_distance - d_square)"),
    (T_LINE, "(m2, zero), linear, (distance + size, d_distance + slope)"),
    (T_LINE, "(m2, zero), linear, (distance - size, d_distance + slope)"),
    ("(m2 - size, -slope), linear", "(m2 + size, slope), linear"),
    ("(m2 - size, -slope), linear", "(m2 - size, slope), linear"),
    ("constant = distance - square * size", "constant = distance + square * size"),
    ("((-value, -slope) for value, slope in found)", "((value, slope) for value, slope in found)"),
    ("(a * x + 2 * b) * x + c", "(a * x - 2 * b) * x + c"),
    ("(a * x + 2 * b) * x + c", "(a * x + 2 * b) * x - c"),
    ("(da + 2 * rate * a) * x * x", "(da - 2 * rate * a) * x * x"),
    ("2 * (db + rate * b) * x + dc", "2 * (db - rate * b) * x + dc"),
    ("2 * (db + rate * b) * x + dc", "2 * (db + rate * b) * x - dc"),
    ("a * c - b * b", "a * c + b * b"),
    ("da * c + a * dc - 2 * b * db", "da * c - a * dc - 2 * b * db"),
    ("da * c + a * dc - 2 * b * db", "da * c + a * dc + 2 * b * db"),
    ("qa <= 0 or", "qa >= 0 or"),
    ("qb + qa * scaled.ends[0] >= 0", "qb - qa * scaled.ends[0] >= 0"),
    ("qb + qa * scaled.ends[1] <= 0", "qb - qa * scaled.ends[1] <= 0"),
    # gain crossovers (2)
    ("y = centre.g_squared[0] - 1", "y = centre.g_squared[0] + 1"),
    ("y - x * x + (square_slope", "y + x * x + (square_slope"),
    ("(square_slope - 2 * wide * wide) * shift", "(square_slope + 2 * wide * wide) * shift"),
    ("apart > 0 if upper else apart < 0", "apart < 0 if upper else apart > 0"),
    ("root = (square - 1).sqrt()", "root = (square + 1).sqrt()"),
    ("angle_from_minus_one(centre.g) - y.sqrt().atan()", "angle_from_minus_one(centre.g) + y.sqrt().atan()"),
    ("angle_from_minus_one(centre.g) - y.sqrt().atan()", "-angle_from_minus_one(centre.g) - y.sqrt().atan()"),
    ("lag_to_minus_one(angle_from_minus_one(centre.g)", "(angle_from_minus_one(centre.g)"),
    ("value = lag = at_centre + slope * shift", "value = lag = at_centre + 0 * slope * shift"),
    ("over.log_slope.imag - over.log_slope.real / root", "over.log_slope.imag + over.log_slope.real / root"),
    ("slope = (slope - lag * over.stretch)", "slope = (slope + lag * over.stretch)"),
    ("at_centre / centre.frequency + slope", "at_centre / over.frequency + slope"),
    ("(self.general.quantity, value, lag, [slope])", "(self.general.quantity, lag, value, [slope])"),
    # phase crossovers (3)
    ("at.imag - centre.x(upper) * at.real", "at.imag + centre.x(upper) * at.real"),
    ("slope.imag - over.x(upper) * (slope.real", "slope.imag + over.x(upper) * (slope.real"),
    ("(slope.real + over.g.real)", "(slope.real - over.g.real)"),
    ("((False, 1), (True, -1))", "((False, -1), (True, 1))"),
    ("smallest = (-arb(self.general.level)).exp()", "smallest = arb(self.general.level).exp()"),
    ("or size > 1 + x2", "or size > 1 - x2"),
    ("smallest * smallest * (1 + x1 * x1)", "smallest * smallest * (1 + x2 * x2)"),
    ("if real > -smallest or", "if real > -1 / smallest or"),
    ("or real < -1:", "or real < 1:"),
]  # fmt: skip


def test_the_battery_is_answered_without_a_mistake() -> None:
    assert not is_caught(original)
    answers = [true for _, true in battery()]
    assert len(answers) == 3 * sum(answers) > 100


@pytest.mark.thinned(4)
@pytest.mark.parametrize(("old", "new"), thinned(SLIPS))
def test_a_slip_in_a_sign_is_caught(old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = [inspect.getsource(module) for module in (original_response, original)]
    assert sum(source.count(old) for source in sources) == 1, "this line was rewritten: bring the slip up to date"
    values, mutant = ModuleType("lag_response_with_a_slip"), ModuleType("lag_with_a_slip")
    for module, source in zip((values, mutant), sources, strict=True):
        # dataclasses look their module up by name, and the closed forms are to find the slip in their values
        monkeypatch.setitem(sys.modules, module.__name__, module)
        with_slip = source.replace(old, new).replace(original_response.__name__, values.__name__)
        exec(compile(with_slip, module.__name__, "exec"), module.__dict__)
    assert is_caught(mutant)
