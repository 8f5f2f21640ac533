"""Exclusion tests:  a reason why every controller of a box fails a condition, and its test in ball arithmetic.

A condition on a response at one frequency of one plant says that C stays outside a disc, or inside, or on one side of
a line:

    q(C) = a |C|^2 + 2 Re(b C) + c <= 0 ,      P the plant, M the limit

    |S|   <= M    -|P|^2 |C|^2 - 2 Re(P C) - 1 + 1/M^2
    |T|   <= M    (1 - M^2) |P|^2 |C|^2 - 2 M^2 Re(P C) - M^2
    |C S| <= M    (1 - M^2 |P|^2) |C|^2 - 2 M^2 Re(P C) - M^2
    |L|   <= M    |P|^2 |C|^2 - M^2                                                                                (1)

and the opposite for >=.  With the Taylor model of `fopi_tune.optimum.parametrization` and w = a conj(C_c) + b,

    q >= q(C_c) - 2 sum |Re(w C_i)| h_i - 2 |w| r - max(-a, 0) (sum |C_i| h_i + r)^2 .                       (2)

Values at a crossover are bounded where |L| = 1 after adding a multiple of ln|L|, which is 0 there, as in
`fopi_tune.proof.claims.crossings`.

Source: derived; (1) is each response's limit squared and written out, (2) a lower bound over the Taylor model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.core.peaks import Response
from fopi_tune.optimum.parametrization import BoxLoop, ControllerBox, TaylorModel
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Condition, Test, rolls_off
from fopi_tune.optimum.pruning.loop_gain_bounds import LoopGainBounds
from fopi_tune.optimum.pruning.mean_value_forms import crossing_angle, crossing_gain
from fopi_tune.proof.balls.box import log_interval, point_box
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.poles import NoPoleAtTheEnds, count_unstable_poles

_ZERO = arb(0)
#: |S| of an unstable box must stay below this, neper, to tell that all its loops are unstable; and boxes for that
_LARGEST_SENSITIVITY = 6.0
_STABILITY_BUDGET = 300
#: steps in u by which a bracket is widened where |L| decreases
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003)


@dataclass(frozen=True)
class Reason:
    """Why every controller of a box fails.

    Args:
        condition: which one it fails, a place in `Conditions.every`.
        point: the plant's uncertain numbers.
        omega: frequencies in rad/s: where a response is read, or the ends of a bracket (of `spread` a second bracket,
            of the nominal plant).
        above: of `spread`, the plant's margin is the larger one.
    """

    condition: int
    point: tuple[float, ...] = ()
    omega: tuple[float, ...] = ()
    above: bool = False


def is_excluded(problem: Problem, controllers: ControllerBox, reason: Reason) -> bool:
    """Whether every controller of a box fails a condition, for this reason."""
    condition = problem.conditions.every[reason.condition]
    no_plant = condition.test in (Test.GAIN, Test.LOWER_CROSSOVER)
    if not no_plant and not problem.has_member(reason.point, condition.nominal):
        return False
    if len(reason.omega) not in _FREQUENCIES[condition.test]:
        return False
    if not all(math.isfinite(omega) and omega > 0.0 for omega in reason.omega):
        return False
    return _TESTS[condition.test](problem, controllers, condition, reason)


def quadratic(response: Response, p: acb, limit: arb, upper: bool) -> tuple[arb, acb, arb]:
    """a, b and c of (1), from M^2."""
    size = abs(p) ** 2
    if response is Response.SENSITIVITY:
        found = -size, -p, 1 / limit - 1
    elif response is Response.LOOP_GAIN:
        found = size, acb(0), -limit
    else:
        first = size if response is Response.COMPLEMENTARY_SENSITIVITY else arb(1)
        found = first - limit * size, -limit * p, -limit
    return found if upper else (-found[0], -found[1], -found[2])


def lower_bound(q: tuple[arb, acb, arb], taylor_model: TaylorModel, half: tuple[arb, ...]) -> arb:
    """The bound (2)."""
    a, b, c = q
    middle = taylor_model.middle
    w = a * middle.conjugate() + b
    value = a * abs(middle) ** 2 + 2 * (b * middle).real + c
    pairs = list(zip(taylor_model.slopes, half, strict=True))
    value = value - 2 * sum((abs((w * slope).real) * h for slope, h in pairs), abs(w) * taylor_model.remainder)
    if not a >= 0:
        reach = sum((abs(slope) * h for slope, h in pairs), taylor_model.remainder)
        value = value - abs(a) * reach**2
    return value


def _response(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    low, high = condition.band_rad_s
    if not reason.omega:  # |S| -> 1 as omega -> inf, whatever the gains
        is_decreasing = condition.response is Response.SENSITIVITY and condition.upper and rolls_off(problem.family)
        return is_decreasing and math.isinf(high) and bool(condition.level < 0)
    (omega,) = reason.omega
    if not low <= omega <= high or condition.response is None:
        return False
    log_s, p = problem.response(reason.point, omega)
    q = quadratic(condition.response, p, (2 * condition.level).exp(), condition.upper)
    return bool(lower_bound(q, controllers.taylor_model(log_s), controllers.half) > 0)


def _disturbance(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """T |P/(1 + C P)| >= level:  |S| with 1/M = T |P|/level, at s = 1/T."""
    log_s, p = problem.real_response(reason.point, condition.horizon_s)
    limit = (condition.level / (condition.horizon_s * abs(p))) ** 2
    q = quadratic(Response.SENSITIVITY, p, limit, True)
    return bool(condition.level > 0 and lower_bound(q, controllers.taylor_model(log_s), controllers.half) > 0)


def _gain(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    taylor_model = controllers.gain_taylor_model(condition.name)
    reach = sum(
        (abs(s.real) * h for s, h in zip(taylor_model.slopes, controllers.half, strict=True)), taylor_model.remainder
    )
    middle = taylor_model.middle.real
    if condition.upper:
        return bool(middle - reach > condition.level)
    # better than a level is strictly better
    low = middle + reach
    return bool(low <= condition.level if condition.of_objective else low < condition.level)


def _sign_of_log_gain(problem: Problem, controllers: ControllerBox, point: tuple[float, ...], omega: float) -> int:
    """1 where |L| > 1 for every controller, -1 where |L| < 1, else 0."""
    log_s, p = problem.response(point, omega)
    taylor_model = controllers.taylor_model(log_s)
    if lower_bound(quadratic(Response.LOOP_GAIN, p, arb(1), True), taylor_model, controllers.half) > 0:
        return 1
    return -1 if lower_bound(quadratic(Response.LOOP_GAIN, p, arb(1), False), taylor_model, controllers.half) > 0 else 0


def _some_crossing(
    problem: Problem, controllers: ControllerBox, point: tuple[float, ...], ends: tuple[float, float]
) -> bool:
    """Whether every controller has a gain crossover between two frequencies."""
    known = problem.crossover_rad_s
    if known is not None and point == problem.nominal and ends[0] <= known <= ends[1]:
        return True
    return (
        ends[0] < ends[1]
        and _sign_of_log_gain(problem, controllers, point, ends[0])
        * _sign_of_log_gain(problem, controllers, point, ends[1])
        < 0
    )


def _no_other_crossing(
    problem: Problem, controllers: ControllerBox, point: tuple[float, ...], ends: tuple[float, float] | None
) -> bool:
    """Whether no controller has a gain crossover outside two frequencies; without them, whether none has any."""
    bounds = LoopGainBounds.of(problem, controllers, point)
    if ends is None:
        return bounds.has_no_crossover(-math.inf, math.inf)
    low, high = math.log(ends[0]) + 1e-12, math.log(ends[1]) - 1e-12
    if not low < high:
        return False
    # next to the bracket values do not settle the cells, but where |L| decreases it cannot return to 1
    if _sign_at_end(problem, controllers, point, ends, bounds, 0) > 0:
        low -= next((step for step in _STEPS if bounds.is_decreasing((low - step, low + 2e-12))), 0.0)
    if _sign_at_end(problem, controllers, point, ends, bounds, 1) < 0:
        high += next((step for step in _STEPS if bounds.is_decreasing((high - 2e-12, high + step))), 0.0)
    return bounds.has_no_crossover(-math.inf, low) and bounds.has_no_crossover(high, math.inf)


def _sign_at_end(
    problem: Problem,
    controllers: ControllerBox,
    point: tuple[float, ...],
    ends: tuple[float, float],
    bounds: LoopGainBounds,
    end: int,
) -> int:
    """The sign of ln|L| at an end of a bracket, for every controller; 0 where it is not known."""
    known = problem.crossover_rad_s
    if known is not None and point == problem.nominal and ends[0] < known < ends[1]:
        # |L| = 1 at the fixed crossover, and |L| decreases from there
        u, far = math.log(known), math.log(ends[end])
        span = (far - 1e-12, u + 1e-12) if end == 0 else (u - 1e-12, far + 1e-12)
        if bounds.is_decreasing(span):
            return -1 if end else 1
    return _sign_of_log_gain(problem, controllers, point, ends[end])


def _margin(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """A crossover has too small a margin; or every crossover has too large a margin, or there is none."""
    if not reason.omega:
        return _no_other_crossing(problem, controllers, reason.point, None)
    ends = reason.omega[0], reason.omega[1]
    found = crossing_angle(problem, controllers, reason.point, ends, condition.rate)
    if found is None:
        return False
    if condition.upper:
        return bool(found.lower > condition.level) and _no_other_crossing(problem, controllers, reason.point, ends)
    return bool(found.upper < condition.level) and _some_crossing(problem, controllers, reason.point, ends)


def _spread(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """The difference of two margins: of one a crossover must exist, of the other no second one may exist."""
    if not reason.omega:
        return bool(condition.level <= 0)
    ends, others = (reason.omega[0], reason.omega[1]), (reason.omega[2], reason.omega[3])
    nominal = problem.nominal
    own = crossing_angle(problem, controllers, reason.point, ends, None)
    other = crossing_angle(problem, controllers, nominal, others, None)
    if own is None or other is None:
        return False
    # a margin is at most the value at any crossover, and at least a lower bound over all of them
    if reason.above:
        apart = own.minus(other)
        exist = _some_crossing(problem, controllers, nominal, others)
        return (
            exist
            and bool(apart.lower >= condition.level)
            and _no_other_crossing(problem, controllers, reason.point, ends)
        )
    apart = other.minus(own)
    exist = _some_crossing(problem, controllers, reason.point, ends)
    return exist and bool(apart.lower >= condition.level) and _no_other_crossing(problem, controllers, nominal, others)


def _gain_margin(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """Im L changes its sign in the bracket, Re L < 0 there, and  -level < ln|L| < 0  where Im L = 0."""
    ends = reason.omega[0], reason.omega[1]
    if not ends[0] < ends[1]:
        return False
    signs = []
    for omega in ends:
        log_s, p = problem.response(reason.point, omega)
        taylor_model = controllers.taylor_model(log_s)
        reach = sum((abs((p * s).imag) * h for s, h in zip(taylor_model.slopes, controllers.half, strict=True)), _ZERO)
        value, reach = (p * taylor_model.middle).imag, reach + abs(p) * taylor_model.remainder
        signs.append(1 if value > reach else -1 if value < -reach else 0)
    if signs[0] * signs[1] >= 0:
        return False
    found = crossing_gain(problem, controllers, reason.point, ends)
    return found is not None and bool(found.upper < 0) and bool(found.lower > -condition.level)


def _crossover(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """|L| < 1 at and above the lowest crossover that is allowed."""
    low = math.nextafter(float(condition.level.lower()), -math.inf)
    return LoopGainBounds.of(problem, controllers, reason.point).has_no_crossover(low, math.inf, only_below=True)


def _gain_spread(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """At the fixed nominal crossover |L0| = 1, so that |L| = |P/P0| for another plant."""
    if not reason.omega:
        return bool(condition.level <= 0)
    (omega,) = reason.omega
    if omega != problem.crossover_rad_s:
        return False
    ratio = problem.response(reason.point, omega)[1] / problem.response(problem.nominal, omega)[1]
    return bool(abs(abs(ratio).log()) >= condition.level)


def _stability(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """One loop is unstable, and over the box 1 + L has no zero on the axis, so that no pole crosses it."""
    loop, centre = BoxLoop.of(controllers, problem.family), BoxLoop.of(controllers, problem.family, whole=False)
    if loop is None or centre is None:
        return False
    if not count_unstable_poles(centre, reason.point, 0.0):
        return False
    domain = ((-math.inf, math.inf), *point_box(reason.point))
    if NoPoleAtTheEnds(loop, domain, 0.0).examine(domain).leaf is None:
        return False
    return search(Bound(loop, Response.SENSITIVITY, _LARGEST_SENSITIVITY, True, domain, 0.0), _STABILITY_BUDGET).shown


def _lower_crossover(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """No crossover of the nominal plant below the fixed one has the required phase margin.

    Then the fixed crossover must have it: psi equals that margin (modulo 360 deg), and such controllers are contained
    in the other root of the search.
    """
    if problem.crossover_rad_s is None or not problem.margin_is_fixed:
        return False
    u = log_interval(problem.crossover_rad_s, problem.crossover_rad_s)[1]
    return LoopGainBounds.of(problem, controllers, problem.nominal).has_no_margin_below(u, condition.level)


#: how many frequencies a reason names
_FREQUENCIES = {
    Test.RESPONSE: (0, 1),
    Test.DISTURBANCE: (0,),
    Test.MARGIN: (0, 2),
    Test.GAIN_MARGIN: (2,),
    Test.CROSSOVER: (0,),
    Test.SPREAD: (0, 4),
    Test.GAIN_SPREAD: (0, 1),
    Test.GAIN: (0,),
    Test.STABILITY: (0,),
    Test.LOWER_CROSSOVER: (0,),
}
_TESTS = {
    Test.RESPONSE: _response,
    Test.DISTURBANCE: _disturbance,
    Test.MARGIN: _margin,
    Test.GAIN_MARGIN: _gain_margin,
    Test.CROSSOVER: _crossover,
    Test.SPREAD: _spread,
    Test.GAIN_SPREAD: _gain_spread,
    Test.GAIN: _gain,
    Test.STABILITY: _stability,
    Test.LOWER_CROSSOVER: _lower_crossover,
}
