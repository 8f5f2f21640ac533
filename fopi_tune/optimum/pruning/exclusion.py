"""Exclusion tests:  a reason why every controller of a box fails a condition, and its test in ball arithmetic.

A margin is a distance of a stable loop from -1, so what a test says of a margin may be false of unstable loops: those
fail the condition anyway.  With b = 180 deg + arg L modulo a turn,

    phase margin    min |b|          delay margin    min (b mod 360 deg)/omega

over all gain crossovers:  at most the value at any crossover, and at least a lower bound over all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.core.peaks import Response
from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Condition, Test
from fopi_tune.optimum.pruning.crossings import GainCrossovers
from fopi_tune.optimum.pruning.instability import is_unstable
from fopi_tune.optimum.pruning.loop_gain_bounds import LoopGainBounds, gain_ratio_stays_beyond
from fopi_tune.optimum.pruning.mean_value_forms import LoopBracket, MeanValueForm
from fopi_tune.optimum.pruning.response_bounds import lower_bound, quadratic
from fopi_tune.proof.balls.box import Interval

_ZERO = arb(0)


@dataclass(frozen=True)
class Reason:
    """Why every controller of a box fails.

    Args:
        condition: which one it fails, a place in `Conditions.every`.
        point: the plant's uncertain numbers.
        omega: frequencies in rad/s: where a response is read (0: its limit there, of `gain_spread` any frequency), or
            the ends of a bracket; of `spread` the first bracket is of the smaller margin, the others are of the larger
            one; of `gain_spread` it is of the nominal plant, and
            a single one is where |L0| > 1; of instability there are several.
        above: of `spread`, the plant's margin is the larger one.
    """

    condition: int
    point: tuple[float, ...] = ()
    omega: tuple[float, ...] = ()
    above: bool = False


def is_excluded(problem: Problem, controllers: ControllerBox, reason: Reason) -> bool:
    """Whether every controller of a box fails a condition, for this reason."""
    condition = problem.conditions.every[reason.condition]
    return is_about_members(problem, condition, reason) and _TESTS[condition.test](
        problem, controllers, condition, reason
    )


def is_about_members(problem: Problem, condition: Condition, reason: Reason) -> bool:
    """Whether a reason names a plant of the family, and as many frequencies as its condition is read at."""
    no_plant = condition.test in (Test.GAIN, Test.LOWER_CROSSOVER)
    if not no_plant and not problem.has_member(reason.point, condition.nominal):
        return False
    if len(reason.omega) not in _FREQUENCIES[condition.test]:
        return False
    if condition.test in (Test.RESPONSE, Test.GAIN_SPREAD) and reason.omega == (0.0,):
        return True
    return all(math.isfinite(omega) and 0.0 < omega <= problem.highest_rad_s for omega in reason.omega)


def response_quadratic(
    problem: Problem, condition: Condition, reason: Reason
) -> tuple[acb, tuple[arb, acb, arb]] | None:
    """ln s and the quadratic of a response, or of a disturbance's error:  T |P/(1 + C P)| < level at s = 1/T.

    The latter is |S| with 1/M = T |P|/level.  Of a spread of |L| that of |L0| at a frequency from which on the ratio
    of the plants is too large.  None where the reason names no frequency of the condition's.
    """
    if condition.test is Test.GAIN_SPREAD:
        # with |L0| > 1 there is a higher crossover, where the ratio is too large
        (omega,) = reason.omega
        stays = problem.gain_vanishes and gain_ratio_stays_beyond(problem, reason.point, omega, condition.level)
        if not stays or problem.crossover_rad_s is not None:
            return None
        log_s, p = problem.response(problem.nominal, omega)
        return log_s, quadratic(Response.LOOP_GAIN, p, arb(1), True)
    if condition.test is Test.DISTURBANCE:
        if not condition.level > 0:
            return None
        log_s, p = problem.real_response(reason.point, condition.horizon_s)
        return log_s, quadratic(Response.SENSITIVITY, p, problem.squared_error_limit(condition, p), True)
    low, high = condition.band_rad_s
    if not reason.omega or not max(low, 5e-324) <= reason.omega[0] <= high or condition.response is None:
        return None
    log_s, p = problem.response(reason.point, reason.omega[0])
    return log_s, quadratic(condition.response, p, problem.squared_limit(condition, reason.omega[0]), condition.upper)


def _response(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    if condition.test is Test.RESPONSE and not reason.omega:  # |S| -> 1 as omega -> inf, whatever the gains
        is_decreasing = condition.response is Response.SENSITIVITY and condition.upper and problem.gain_vanishes
        return is_decreasing and math.isinf(condition.band_rad_s[1]) and bool(condition.level < 0)
    if reason.omega == (0.0,):
        return controllers.has_integral and is_broken_at_zero(problem, condition, reason.point)
    found = response_quadratic(problem, condition, reason)
    if found is None:
        return False
    log_s, q = found
    return bool(lower_bound(q, controllers.taylor_model(log_s), controllers.half) > 0)


def is_broken_at_zero(problem: Problem, condition: Condition, point: tuple[float, ...]) -> bool:
    """Whether no gains with an integral meet a limit of a response next to frequency 0.

    Whatever they are, |T| -> 1 and |C S| -> 1/|P| as omega -> 0, where P is neither 0 nor infinite.
    """
    plant = problem.plant(point)
    size = abs(plant.gain.value * plant.numerator[-1].value / plant.denominator[-1].value)
    if condition.test is not Test.RESPONSE or condition.band_rad_s[0] != 0.0 or not size.is_finite() or not size > 0:
        return False
    if condition.response is Response.COMPLEMENTARY_SENSITIVITY:
        value = _ZERO
    elif condition.response is Response.CONTROL_SENSITIVITY:
        value = -size.log()
    else:
        return False
    return bool(value > condition.level if condition.upper else value < condition.level)


def _gain(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    low, high = controllers.gain_range(condition.name)
    if condition.upper:
        return bool(low > condition.level)
    most = getattr(problem.spec.controller, condition.name).max
    if condition.of_objective and most < high:  # gains beyond the range are none
        high = arb(most)
    # better than a level is strictly better
    return bool(high <= condition.level if condition.of_objective else high < condition.level)


def _margin(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """A crossover is too close to -1; or every crossover is too far from it, or there is none."""
    if condition.rate is not None:
        return _delay_margin(problem, controllers, condition, condition.rate, reason)
    crossovers, brackets = GainCrossovers.of(problem, controllers, reason.point), brackets_of(reason)
    if not brackets:
        return condition.upper and crossovers.are_in(())
    at = LoopBracket.of(problem, controllers, reason.point, problem.u_interval(brackets[0]))
    if at is None:
        return False
    b = at.angle
    if condition.upper:
        return all(x.lower > condition.level for x in b.distances) and crossovers.are_in(brackets)
    near = condition.level > arb.pi() or all(x.upper < condition.level for x in (b, -b))
    return near and crossovers.has_one_in(brackets[0])


def _delay_margin(
    problem: Problem, controllers: ControllerBox, condition: Condition, rate: arb, reason: Reason
) -> bool:
    """The same of the lag to -1 less rate omega; where |L| does not fall below 1, the delay margin is 0.

    The lag modulo a turn is at least any that is less than a turn, and at most any that is not negative.
    """
    crossovers, brackets = GainCrossovers.of(problem, controllers, reason.point), brackets_of(reason)
    if not brackets:
        return condition.upper and crossovers.are_in((), falls=True)
    at = LoopBracket.of(problem, controllers, reason.point, problem.u_interval(brackets[0]))
    if at is None:
        return False
    lag, excess = at.lag(), at.lag(rate)
    if condition.upper:
        return excess.lower > 0 and lag.upper < 2 * arb.pi() and crossovers.are_in(brackets, falls=True)
    return excess.upper < 0 and lag.lower >= 0 and crossovers.has_one_in(brackets[0])


def _spread(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """The difference of two margins: of one a crossover must exist, of the other all must be known."""
    if not reason.omega:
        return bool(condition.level <= 0)
    small, large = spread_plants(problem, reason)
    first, *others = brackets_of(reason)
    smaller = LoopBracket.of(problem, controllers, small, problem.u_interval(first))
    if smaller is None:
        return False
    for bracket in others:
        larger = LoopBracket.of(problem, controllers, large, problem.u_interval(bracket))
        if larger is None or not _are_apart(larger.angle, smaller.angle, condition.level):
            return False
    has_one = GainCrossovers.of(problem, controllers, small).has_one_in(first)
    return has_one and GainCrossovers.of(problem, controllers, large).are_in(others)


def spread_plants(problem: Problem, reason: Reason) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The plants with the smaller and the larger margin of a spread's reason."""
    return (problem.nominal, reason.point) if reason.above else (reason.point, problem.nominal)


def _are_apart(larger: MeanValueForm, smaller: MeanValueForm, level: arb) -> bool:
    """Whether |b| of one is larger than |b| of another by at least the level, for the same controller."""
    return all(x.minus(y).lower >= level for x in larger.distances for y in (smaller, -smaller))


def _gain_margin(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """Im L changes its sign in the bracket, Re L < 0 there, and  -level < ln|L| < 0  where Im L = 0."""
    if not sign_changes(problem, controllers, reason):
        return False
    at = LoopBracket.of(problem, controllers, reason.point, problem.u_interval((reason.omega[0], reason.omega[1])))
    found = None if at is None else at.gain_where_negative
    return found is not None and bool(found.upper < 0) and bool(found.lower > -condition.level)


def sign_changes(problem: Problem, controllers: ControllerBox, reason: Reason) -> bool:
    """Whether Im L changes its sign in the bracket, for every controller."""
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
    return signs[0] * signs[1] < 0


def _crossover(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """|L| < 1 at and above the lowest crossover that is allowed."""
    lowest = math.nextafter(float(condition.level.lower()), -math.inf)
    crossovers, omega = GainCrossovers.of(problem, controllers, reason.point), math.nextafter(math.exp(lowest), 0.0)
    if not omega < problem.highest_rad_s:
        return True
    low = problem.u_interval((omega, omega))[0]
    if omega > 0.0 and crossovers.sign_of_log_gain(omega) < 0 and crossovers.are_below_unless_at(omega):
        return True
    return crossovers.bounds.has_no_crossover(low, math.inf, only_below=True)


def _gain_spread(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """At the nominal crossover |L0| = 1, so that |L| = |P/P0| for another plant."""
    if not reason.omega:
        return bool(condition.level <= 0)
    if len(reason.omega) == 2:
        apart = gain_ratio(problem, controllers, reason)
        return apart is not None and (apart.lower >= condition.level or apart.upper <= -condition.level)
    (omega,) = reason.omega
    if omega == 0.0:
        ratio = problem.constant_gain_ratio(reason.point)
        return ratio is not None and bool(abs(ratio.log()) >= condition.level)
    if problem.crossover_rad_s is None:
        found = response_quadratic(problem, condition, reason)
        return found is not None and bool(
            lower_bound(found[1], controllers.taylor_model(found[0]), controllers.half) > 0
        )
    if omega != problem.crossover_rad_s:
        return False
    ratio = problem.response(reason.point, omega)[1] / problem.response(problem.nominal, omega)[1]
    return bool(abs(abs(ratio).log()) >= condition.level)


def gain_ratio(problem: Problem, controllers: ControllerBox, reason: Reason) -> MeanValueForm | None:
    """ln|P/P0| at the highest nominal crossover, which is in the bracket; None where that is not known."""
    (bracket,) = brackets_of(reason)
    u = problem.u_interval(bracket)
    at = LoopBracket.of(problem, controllers, problem.nominal, u)
    if at is None or not GainCrossovers.of(problem, controllers, problem.nominal).highest_is_in(bracket):
        return None
    sides = [
        (problem.plant_enclosure(point, (at.u, at.u)), problem.plant_enclosure(point, u))
        for point in (reason.point, problem.nominal)
    ]
    (own, over), (nominal, over_nominal) = sides
    value, along = abs(own.gain / nominal.gain).log(), (over.log_slope - over_nominal.log_slope).real
    return at.along_crossovers(value, along) if value.is_finite() and along.is_finite() else None


def _stability(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """One plant's loop is unstable for every controller."""
    delay_s = _ZERO if condition.rate is None else condition.rate
    return delay_s >= 0 and is_unstable(problem, controllers, reason.point, brackets_of(reason), delay_s)


def brackets_of(reason: Reason) -> list[Interval]:
    """The brackets of frequencies that a reason names."""
    return list(zip(reason.omega[::2], reason.omega[1::2], strict=True))


def _lower_crossover(problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason) -> bool:
    """No crossover of the nominal plant below the fixed one has the required phase margin, by lag or by lead.

    Then the fixed crossover must have it: psi or -psi equals that margin (modulo 360 deg), and such controllers are
    contained in the other roots of the search.
    """
    if problem.crossover_rad_s is None or not problem.margin_is_fixed:
        return False
    u = problem.u_interval((problem.crossover_rad_s, problem.crossover_rad_s))[1]
    return LoopGainBounds.of(problem, controllers, problem.nominal).has_no_margin_below(u, condition.level)


#: how many frequencies a reason names
_FREQUENCIES = {
    Test.RESPONSE: (0, 1),
    Test.DISTURBANCE: (0,),
    Test.MARGIN: (0, 2),
    Test.GAIN_MARGIN: (2,),
    Test.CROSSOVER: (0,),
    Test.SPREAD: (0, 4, 6, 8),
    Test.GAIN_SPREAD: (0, 1, 2),
    Test.GAIN: (0,),
    Test.STABILITY: (0, 2, 4, 6),
    Test.LOWER_CROSSOVER: (0,),
}
_TESTS = {
    Test.RESPONSE: _response,
    Test.DISTURBANCE: _response,
    Test.MARGIN: _margin,
    Test.GAIN_MARGIN: _gain_margin,
    Test.CROSSOVER: _crossover,
    Test.SPREAD: _spread,
    Test.GAIN_SPREAD: _gain_spread,
    Test.GAIN: _gain,
    Test.STABILITY: _stability,
    Test.LOWER_CROSSOVER: _lower_crossover,
}
