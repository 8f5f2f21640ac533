"""Problem -> Candidate:  scan, polish of every basin, recheck, multipliers."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.stability import is_stable
from fopi_tune.design.bracket import bracket_of, excluded_share
from fopi_tune.design.constraints import STABILITY_GUARD, Bound
from fopi_tune.design.global_search.basins import WORTH, Basin, scan_box
from fopi_tune.design.global_search.compiled import DEPTH, ENDLESS, KI
from fopi_tune.design.global_search.polish import MEETS, Polish, Polished
from fopi_tune.design.global_search.problem import SAME_COST, Problem
from fopi_tune.design.global_search.structures import LARGEST_GAIN
from fopi_tune.design.infeasible import MET, explain, has_wrong_sign, nearest_of
from fopi_tune.design.measured.polish import polish_of
from fopi_tune.design.measured.problem import MeasuredProblem
from fopi_tune.digital.implementation import nominal_crossover
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

_log = logging.getLogger(__name__)
_BASINS = 3
#: factor on the distance between rays where gains close to the optimum are known
_COARSE = 2.0
#: of spreads, which an equality and a narrow region leave far from their minimum on the scan's rays
_WORTH_OF_SPREADS = 0.4
#: of the cost (or of 0.05): more than the scan's table is inexact by
_WORSE = 2e-4
#: radii of the polish when its result is worse than the scan's
_NEARER = (0.1, 0.03)
#: of objectives that are a largest member: from natural units to public ones
_PUBLIC_UNIT = {
    ObjectiveKind.PHASE_MARGIN_SPREAD: math.degrees(1.0),
    ObjectiveKind.CROSSOVER_SPREAD: 1.0 / NEPER_PER_DB,
    ObjectiveKind.SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
    ObjectiveKind.LOAD_SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
}
#: a term smaller than this part of the other one, in scaled gains, may be better left out
_VANISHING = 0.05
#: index of kd among the numbers of a controller
_DERIVATIVE = 2
#: brackets that are made, and the part by which gains from the last one have to be better for another
_MOST_BRACKETS, _BETTER = 3, 1e-4
_ONLY_WITHOUT_INTEGRAL = (
    "only ki = 0 gives every plant of the family a stable loop; "
    "the plant's gain is negative, so allow negative kp and ki"
)
#: filters that are exact at a crossover, one after the other
_MOST_CROSSOVERS = 8
#: of the largest gain: a derivative with which a search goes on from gains without one
_FIRST_DERIVATIVE = 0.05
#: multipliers beyond this say only that limits coincide
_NO_PRICE = 1e5


@dataclass(frozen=True)
class Neighbour:
    """A spec that was designed, from which others that differ in their limits are started.

    Args:
        spec: the spec.
        gains: its gains.
    """

    spec: DesignSpec
    gains: FoPi


def search(problem: Problem, start: FoPi | None = None, bracket: bool = False) -> Candidate:
    """The best gains of the whole box, or why there are none.

    Args:
        problem: with at least one free gain.
        start: gains close to the optimum.
        bracket: whether to bound what anything else can reach, and to polish where the bound leaves room; not where
            the filter depends on the crossover, nor where integral and derivative have orders.
    """
    polish, best = at_own_crossover(*best_from(problem, start))
    problem = polish.problem
    if best is None or (problem.code == DEPTH and best.cost > MEETS):
        excluded = share_in_words(excluded_share(problem)) if bracket and problem.has_bound else ""
        return explain(problem, excluded, _nearest(polish), polish.counts)
    if problem.code == KI and best.x[1] == 0.0 and problem.box.ki_high > 0.0 and has_wrong_sign(problem):
        nothing = tuple(None for _ in problem.spec.requirements)
        return Candidate(Status.INFEASIBLE, None, nothing, (), _ONLY_WITHOUT_INTEGRAL, polish.counts.solves)
    if not bracket or not problem.has_bound:
        return candidate_of(polish, best)
    best, gap = beyond_doubt(polish, best)
    return replace(candidate_of(polish, best), gap=gap)


def beyond_doubt(polish: Polish, best: Polished) -> tuple[Polished, float | None]:
    """The best gains once gains in cells that the bound cannot discard were polished too, and the gap it closes."""
    for _ in range(_MOST_BRACKETS):
        bracket = bracket_of(polish, best.cost, best.x)
        if bracket is None:
            return best, None
        before = best.cost
        _log.debug("bracket: gap %.3g, %d starts in what is left", bracket.gap, len(bracket.starts))
        for start in bracket.starts:
            if polish.problem.structure.are_apart(start.gains, best.x):
                found = polish.run(start.gains, hopeless=before, rival=best)
                if found is not None and found.cost < best.cost and _is_stable(polish.problem, found):
                    best = found
        if best.cost >= before - _BETTER * max(abs(before), 0.05):
            return best, bracket.gap if math.isfinite(bracket.gap) else None
    return best, None


def share_in_words(excluded: float) -> str:
    """How completely the box was searched."""
    if excluded >= 1.0:
        return "the whole box was excluded, in floating point"
    return f"{math.floor(100.0 * excluded):d} % of the box was excluded, and nothing was found in the rest"


def best_from(problem: Problem, start: FoPi | None = None) -> tuple[Polish, Polished | None]:
    """`best_of_box` of a problem whose filter, on samples, is exact at the crossover of the start."""
    if start is not None and not start.is_zero and problem.needs_crossover:
        problem = problem.exact_at(nominal_crossover(problem.spec, start))
    polish = polish_of(problem)
    return polish, best_of_box(polish, start)


def at_own_crossover(polish: Polish, best: Polished | None) -> tuple[Polish, Polished | None]:
    """The optimum with a filter that is exact at the crossover of the gains themselves, by a fixed point."""
    problem = polish.problem
    for count in range(_MOST_CROSSOVERS if problem.needs_crossover else 0):
        if best is None:
            break
        gains = problem.gains(best.x)
        crossover = nominal_crossover(problem.spec, gains)
        if problem.is_exact_at(crossover):
            break
        problem = problem.exact_at(crossover)
        polish = polish_of(problem, polish.counts)
        # the first filter was exact at a guess: another basin may now be the best
        found = polish.run(best.x, _NEARER[0]) if count else None
        best = found or best_of_box(polish, gains)
    return polish, best


def best_of_box(polish: Polish, start: FoPi | None = None) -> Polished | None:
    """The best local optimum of the scan's basins, and of a start."""
    best: Polished | None = None
    if start is not None and not start.is_zero:
        best = polish.run(inside(polish.problem, polish.problem.scale.scaled(start)))
        if best is not None and not _is_stable(polish.problem, best):
            best = None
    scan = scan_box(polish.problem, _BASINS, 1.0 if best is None else _COARSE)
    _log.debug("scan: basins of cost %s", [float(f"{basin.cost:.4g}") for basin in scan.basins])
    # a basin about a local optimum that is known has nothing else
    known = None if best is None or not best.settled else best.x
    new = [basin for basin in scan.basins if known is None or polish.problem.structure.are_apart(basin.gains, known)]
    return _with_derivative(polish, polish_basins(polish, new, best) or _along_valley(polish, new))


def _along_valley(polish: Polish, basins: Sequence[Basin]) -> Polished | None:
    """The best gains on the way from gains that meet everything, next to basins from which the polish found none.

    Two equalities leave a narrow valley, whose end may be where a crossing appears at once: from beyond it a step for
    the objective and the equalities together leads away.
    """
    nearest = _nearest(polish)
    if nearest is None or nearest.cost > MET:
        return None
    problem, best = polish.problem, None
    question = polish_of(problem.missing(problem.every_requirement, frozenset()), polish.counts)
    for basin in basins:
        near = question.run(basin.gains)
        found = polish.walk(near.x) if near is not None and near.cost <= MEETS else None
        if found is not None and (best is None or found.cost < best.cost) and _is_stable(problem, found):
            best = found
    return best


def _nearest(polish: Polish) -> Polished | None:
    """`nearest_of` the problem, found once."""
    if not polish.nearest:
        polish.nearest = (nearest_of(polish.problem, polish.counts),)
    return polish.nearest[0]


def _with_derivative(polish: Polish, best: Polished | None) -> Polished | None:
    """The same gains, or better ones with a derivative: where that is 0 nothing depends on its order."""
    problem = polish.problem
    mu, kd = problem.spec.controller.mu, problem.spec.controller.kd
    if best is None or mu is None or best.x[_DERIVATIVE] != 0.0:
        return best
    size, last = _FIRST_DERIVATIVE * problem.structure.size(best.x), best
    signs = [sign for sign, end in ((1.0, kd.max), (-1.0, -kd.min)) if end > 0.0]
    for sign, order in product(signs, sorted({mu.min, mu.max})):
        x = last.x.copy()
        x[_DERIVATIVE], x[-1] = sign * size, order
        found = polish.run(inside(problem, x))
        if found is not None and found.cost < best.cost - SAME_COST and _is_stable(problem, found):
            best = found
    return best


def inside(problem: Problem, x: Array) -> Array:
    """Scaled gains inside the ranges."""
    return problem.scale.scaled(problem.gains(x))


def polish_basins(polish: Polish, basins: Sequence[Basin], best: Polished | None = None) -> Polished | None:
    """The best local optimum of basins, those left out that are clearly worse than one that is known."""
    for basin in basins:
        worth = (_WORTH_OF_SPREADS if polish.is_spread else WORTH) * max(abs(basin.cost), 0.05)
        if best is not None and (basin.cost > best.cost + worth or _is_floor(polish.problem, best, basin)):
            continue
        found = polish.run(basin.gains, rival=best)
        _log.debug("polish: cost %s, %d solves so far", None if found is None else found.cost, polish.counts.solves)
        for radius in _NEARER if found is not best else ():
            x = basin.gains if found is None else found.x
            if found is not None and found.settled:
                if radius != _NEARER[0] or not _has_left(polish.problem, found, basin):
                    break
                x = basin.gains
            elif found is not None and (best is not None and found.cost > best.cost + worth):
                break
            if found is not None and _is_floor(polish.problem, found, basin):
                break
            nearer = polish.run(x, radius, rival=found)
            if nearer is not None and (found is None or nearer.cost < found.cost):
                found = nearer
        if found is best or (polish.problem.structure.has_orders and _is_known(best, found)):
            continue
        found = _on_axis(polish, found)
        if found is not None and (best is None or found.cost < best.cost) and _is_stable(polish.problem, found):
            best = found
    return best


def _has_left(problem: Problem, found: Polished, basin: Basin) -> bool:
    """Whether the first step led out of a basin to a worse optimum than the basin's gains on the scan's table."""
    worse = found.cost > basin.cost + _WORSE * max(abs(basin.cost), 0.05)
    return worse and problem.structure.are_apart(found.x, basin.gains)


def _is_known(best: Polished | None, found: Polished | None) -> bool:
    """Whether gains are the best ones that are known, without a better cost."""
    if best is None or found is None:
        return False
    return found.cost >= best.cost - SAME_COST and not np.any(np.abs(found.x - best.x) > 1e-3 * (1.0 + np.abs(best.x)))


def _is_floor(problem: Problem, best: Polished, basin: Basin) -> bool:
    """Whether nothing better than gains that were polished is near a basin, as the objective is a limit there.

    So exactly has a basin the same value only where no gains change it.
    """
    at_floor = problem.is_at_floor(best.cost, best.x) and basin.gains[1] != 0.0
    return at_floor or abs(basin.cost - best.cost) <= SAME_COST


def _on_axis(polish: Polish, found: Polished | None) -> Polished | None:
    """The same or better gains without a term that nearly vanishes."""
    if found is None:
        return None
    problem = polish.problem
    ranges = [problem.spec.controller.ranges[name] for name in problem.structure.names]
    for k in problem.structure.gains:
        others = problem.structure.size(np.where(np.arange(len(found.x)) == k, 0.0, found.x))
        if ranges[k].min <= 0.0 <= ranges[k].max and 0.0 < abs(found.x[k]) < _VANISHING * others:
            x = found.x.copy()
            x[k] = 0.0
            # a derivative that gains nothing is held at 0
            without = polish_of(problem.without_derivative(), polish.counts) if k == _DERIVATIVE else polish
            other = without.run(x)
            if other is not None and other.cost <= found.cost + (SAME_COST if k == _DERIVATIVE else 0.0):
                found = other
    return found


def _is_stable(problem: Problem, found: Polished) -> bool:
    if isinstance(problem, MeasuredProblem):
        return problem.is_stable(problem.gains(found.x))
    try:
        return bool(is_stable(problem.loops(problem.gains(found.x), problem.fine_points[0])).all())
    except DomainError:
        # |L| stays on 1 over a whole range, or both gains are 0.
        return False


def candidate_of(polish: Polish, best: Polished) -> Candidate:
    """The answer for a feasible spec."""
    problem = polish.problem
    status, message = Status.SOLVED, ""
    grown = grown_without_end(problem, best)
    if grown:
        status = Status.UNBOUNDED
        verb = "grow" if len(grown) > 1 else "grows"
        message = f"{' and '.join(grown)} {verb} without limit while the objective still improves"
    return Candidate(
        status, problem.gains(best.x), multipliers_of(problem, best), (), message,
        polish.counts.solves, best.rounds, best.cuts, objective=public_objective(problem, best.cost),
    )  # fmt: skip


def grown_without_end(problem: Problem, best: Polished) -> tuple[str, ...]:
    """Names of what reached the end of the search's range: gains that the spec leaves open, or the smallest slack."""
    ranges, far = problem.spec.controller.ranges, 0.99 * LARGEST_GAIN
    names = [
        name
        for name, value in zip(problem.structure.names, best.x[: problem.structure.linear], strict=False)
        if (math.isinf(ranges[name].max) and value > far) or (math.isinf(ranges[name].min) and -value > far)
    ]
    if problem.code == DEPTH and problem.free is None and -best.cost > ENDLESS - 1e-6:
        names.append("the smallest slack")
    return tuple(names)


def public_objective(problem: Problem, cost: float) -> float:
    """The objective's value of a cost, in its public unit; without one the depth."""
    if problem.objective in (ObjectiveKind.KI, ObjectiveKind.DEPTH):
        return -cost
    if problem.objective is ObjectiveKind.IAE_DISTURBANCE:
        # the cost is ln of the error P/(1 + C P) in scaled numbers
        return problem.error_unit * math.exp(min(cost, 600.0))
    return (cost - problem.peak_offset) * _PUBLIC_UNIT[problem.objective]


def multipliers_of(problem: Problem, best: Polished) -> tuple[float | None, ...]:
    """d objective/d limit in public units, positive where relaxing gains."""
    unit = _PUBLIC_UNIT.get(problem.objective, 1.0)
    if problem.objective is ObjectiveKind.IAE_DISTURBANCE:
        unit = public_objective(problem, best.cost)
    totals: list[float | None] = [None] * len(problem.spec.requirements)
    if np.isnan(best.prices).any():
        return tuple(totals)
    for k, constraint in enumerate(problem.constraints):
        if constraint.requirement == STABILITY_GUARD:
            continue
        price = float(best.prices[k]) * constraint.natural_per_public() * unit
        if constraint.quantity.name == "delay_margin_s":
            # times of the rows are in 1/omega_s
            price *= problem.scale.omega_rad_s
        gain = abs(price) if constraint.bound is Bound.EQUAL else -constraint.bound.value * price
        totals[constraint.requirement] = max(totals[constraint.requirement] or 0.0, gain, 0.0)
    # Limits that leave no room between them have no price: the solver's numbers grow without bound.
    return tuple(None if total is not None and total > _NO_PRICE else total for total in totals)
