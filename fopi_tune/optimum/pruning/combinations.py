"""Combinations of conditions:  no gains of a box meet all of several conditions, though some meet each.

Over a box of gains the violation of a condition is at least a linear function of the coordinates,
`fopi_tune.optimum.pruning.response_bounds.LinearBound`.  Gains that meet all conditions have none above 0, nor a sum
with weights that are not negative.  The box can be discarded where the least value of such a sum is above 0:

    sum_r w_r m_r  -  sum_i |sum_r w_r a_ri|  >  0 ,      m_r + sum_i a_ri t_i/h_i  the bound of condition r .      (1)

Where no gains of the box meet all bounds there are such weights, and no more of them above 0 than coordinates and one.
Single conditions discard boxes as small as the gap that is asked for, along the whole valley that one condition leaves;
sums discard boxes whose square is as small.

Source: derived; Farkas' lemma.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import arb

from fopi_tune.core.peaks import Response
from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Condition, Test
from fopi_tune.optimum.pruning.crossings import GainCrossovers
from fopi_tune.optimum.pruning.exclusion import (
    Reason,
    brackets_of,
    gain_ratio,
    is_about_members,
    response_quadratic,
    sign_changes,
    spread_plants,
)
from fopi_tune.optimum.pruning.mean_value_forms import LoopBracket, MeanValueForm
from fopi_tune.optimum.pruning.response_bounds import LinearBound, linear_bound, quadratic

#: reasons in a sum: there are at most three coordinates
MOST_REASONS = 8


@dataclass(frozen=True)
class Combination:
    """Conditions that no controller of a box meets together.

    Args:
        reasons: at which plant and frequencies each is read.
        weights: of each, finite and greater than 0.
    """

    reasons: tuple[Reason, ...]
    weights: tuple[float, ...]


def are_excluded_together(problem: Problem, controllers: ControllerBox, combination: Combination) -> bool:
    """Whether no controller of a box meets all conditions, by (1)."""
    total: LinearBound | None = None
    for reason, weight in zip(combination.reasons, combination.weights, strict=True):
        found = linear_bound_of(problem, controllers, reason) if 0.0 < weight < math.inf else None
        if found is None:
            return False
        found = found.scaled(arb(weight))
        total = found if total is None else total.plus(found)
    return total is not None and bool(total.lowest > 0)


def linear_bound_of(problem: Problem, controllers: ControllerBox, reason: Reason) -> LinearBound | None:
    """What a condition's violation is at least over a box; None where nothing linear is known of it."""
    condition = problem.conditions.every[reason.condition]
    if not is_about_members(problem, condition, reason):
        return None
    single = condition.test is Test.GAIN_SPREAD and len(reason.omega) == 1 and reason.omega != (0.0,)
    if condition.test in (Test.RESPONSE, Test.DISTURBANCE) or single:
        return _of_response(problem, controllers, condition, reason)
    if condition.test is Test.GAIN:
        return _of_gain(controllers, condition)
    if condition.test is Test.CROSSOVER:
        return _of_crossover(problem, controllers, condition, reason)
    if not reason.omega:
        return None
    if condition.test is Test.MARGIN:
        return _of_margin(problem, controllers, condition, reason)
    if condition.test is Test.SPREAD:
        return _of_spread(problem, controllers, condition, reason)
    if condition.test is Test.GAIN_SPREAD and len(reason.omega) == 2:
        return _of_gain_spread(problem, controllers, condition, reason)
    if condition.test is Test.GAIN_MARGIN:
        return _of_gain_margin(problem, controllers, condition, reason)
    return None


def _of_response(
    problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason
) -> LinearBound | None:
    found = response_quadratic(problem, condition, reason)
    if found is None:
        return None
    log_s, q = found
    return linear_bound(q, controllers.taylor_model(log_s), controllers.half)


def _of_gain(controllers: ControllerBox, condition: Condition) -> LinearBound:
    gain = controllers.gain_taylor_model(condition.name)
    sign = 1 if condition.upper else -1
    slopes = tuple(sign * slope.real * h for slope, h in zip(gain.slopes, controllers.half, strict=True))
    return LinearBound(sign * (gain.middle.real - condition.level) - gain.remainder, slopes)


def _of_crossover(
    problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason
) -> LinearBound | None:
    """|L| >= 1 at the lowest crossover that is allowed, where |L| only falls from there on."""
    low = math.nextafter(float(condition.level.exp().lower()), 0.0)
    if not low > 0.0 or not GainCrossovers.of(problem, controllers, reason.point).are_below_unless_at(low):
        return None
    log_s, p = problem.response(reason.point, low)
    q = quadratic(Response.LOOP_GAIN, p, arb(1), False)
    return linear_bound(q, controllers.taylor_model(log_s), controllers.half)


def _of_margin(
    problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason
) -> LinearBound | None:
    """At a crossover that every controller has, or at the only one."""
    crossovers, brackets = GainCrossovers.of(problem, controllers, reason.point), brackets_of(reason)
    at = LoopBracket.of(problem, controllers, reason.point, problem.u_interval(brackets[0]))
    if at is None:
        return None
    turn, rate = 2 * arb.pi(), condition.rate
    if rate is None:
        x, _ = at.angle.distances
        level = condition.level
        # |b| = x as far as it is near the level
        branch = x.upper < turn - level if condition.upper else x.lower > -level
    else:
        x, level = at.lag(rate), arb(0)
        branch = at.lag().upper < turn if condition.upper else at.lag().lower >= 0
    if not branch:
        return None
    if condition.upper:
        alone = crossovers.are_in(brackets, falls=rate is not None)
        return _violation(x, level, 1) if alone else None
    return _violation(x, level, -1) if crossovers.has_one_in(brackets[0]) else None


def _of_spread(
    problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason
) -> LinearBound | None:
    """The larger margin is that of the only crossover, the smaller one at most that of one that there is."""
    small, large = spread_plants(problem, reason)
    first, *others = brackets_of(reason)
    if len(others) != 1:
        return None
    smaller = LoopBracket.of(problem, controllers, small, problem.u_interval(first))
    larger = LoopBracket.of(problem, controllers, large, problem.u_interval(others[0]))
    if smaller is None or larger is None:
        return None
    x, y = larger.angle.distances[0], smaller.angle.distances[0]
    if not (x.upper <= arb.pi() and y.lower >= 0):
        return None
    has_one = GainCrossovers.of(problem, controllers, small).has_one_in(first)
    if not has_one or not GainCrossovers.of(problem, controllers, large).are_in(others):
        return None
    return _violation(x.minus(y), condition.level, 1)


def _of_gain_spread(
    problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason
) -> LinearBound | None:
    """|x| < level, by the sign that x has at the centre."""
    found = gain_ratio(problem, controllers, reason)
    if found is None:
        return None
    return _violation(found if found.middle.mid() >= 0 else -found, condition.level, 1)


def _of_gain_margin(
    problem: Problem, controllers: ControllerBox, condition: Condition, reason: Reason
) -> LinearBound | None:
    """ln|L| <= -level at a phase crossover that every controller has, with |L| < 1."""
    if not sign_changes(problem, controllers, reason):
        return None
    at = LoopBracket.of(problem, controllers, reason.point, problem.u_interval((reason.omega[0], reason.omega[1])))
    found = None if at is None else at.gain_where_negative
    return _violation(found, -condition.level, 1) if found is not None and found.upper < 0 else None


def _violation(form: MeanValueForm, level: arb, sign: int) -> LinearBound:
    """sign (value - level)."""
    slopes = tuple(sign * slope * h for slope, h in zip(form.slopes, form.half, strict=True))
    return LinearBound(sign * (form.at_centre - level), slopes)
