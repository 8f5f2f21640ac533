"""Starts of the search:  basins of the loop's requirements, and gains scattered over the box, simulated."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.global_search.basins import scan_box
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.numbers import Numbers
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.worst_plants import Family
from fopi_tune.errors import DomainError

#: gains that are scattered lie within this factor of the unit gains
_SPAN = 300.0
#: those whose loop is looked at, of all that are simulated
_LOOKED_AT = 40
_BASINS = 2
#: ln of gains, and order, by which starts differ
_APART, _APART_IN_ORDER = 0.7, 0.15
#: what a violation costs, in objectives
_PENALTY = 5.0


def starts_of(problem: ScenarioProblem, cuts: LoopCuts, count: int, scattered: int) -> list[FoPi]:
    """Distinct gains, the best first.

    Args:
        problem: the problem.
        cuts: of its loop.
        count: how many.
        scattered: gains that are simulated.
    """
    corners = Family(problem)
    ranked: list[tuple[float, FoPi]] = []
    for gains in scatter(problem, scattered):
        cost = _cost(corners, gains, problem.corners)
        if np.isfinite(cost):
            ranked.append((cost, gains))
    ranked = sorted(ranked, key=lambda each: each[0])[:_LOOKED_AT]
    for basin in scan_box(problem.scanned, _BASINS, 2.0).basins:
        gains = problem.loop.gains(basin.gains)
        ranked.append((_cost(corners, gains, problem.corners), gains))
    judged = []
    for cost, gains in ranked:
        found = cuts.look(gains)
        if found is not None and np.isfinite(cost):
            judged.append((cost + _PENALTY * max(abs(cost), 1.0) * cuts.violation(found), gains))
    kept: list[FoPi] = []
    for _, gains in sorted(judged, key=lambda each: each[0]):
        if all(_are_apart(problem.numbers, gains, other) for other in kept):
            kept.append(gains)
        if len(kept) == count:
            break
    return kept


def scatter(problem: ScenarioProblem, count: int) -> list[FoPi]:
    """Gains over the whole box, evenly in their logarithms about the unit gains, without a random number."""
    from scipy.stats import qmc

    numbers = problem.numbers
    n, linear, (low, high) = numbers.count, numbers.linear, numbers.box
    share = qmc.Sobol(n + linear, scramble=False).random(2 ** int(np.ceil(np.log2(count))))[1 : count + 1]
    found = []
    for row in share:
        x = low + row[:n] * (high - low)
        units = numbers.units(x)
        x[:linear] = [_between(row[k], row[n + k], low[k], high[k], units[k]) for k in range(linear)]
        if np.any(x[:linear] != 0.0):
            found.append(numbers.controller(x))
    return found


def gains_between(numbers: Numbers, share: Array) -> FoPi:
    """Gains at a point of the unit cube: evenly in their logarithms about the unit gains.

    Args:
        numbers: gives ranges and units.
        share: shape (n,); of a range that holds both signs the lower half is the negative one.
    """
    low, high = numbers.box
    x = low + share * (high - low)
    units = numbers.units(x)
    for k in range(numbers.linear):
        part, sign = float(share[k]), 0.0
        if low[k] < 0.0 < high[k]:
            part, sign = abs(2.0 * part - 1.0), 0.0 if part >= 0.5 else 1.0
        x[k] = _between(part, sign, low[k], high[k], units[k])
    return numbers.controller(x)


def _between(share: float, sign: float, low: float, high: float, unit: float) -> float:
    """A gain of a range, evenly in its logarithm; where the range holds both signs, of either."""
    if low == high:
        return low
    upwards = high > 0.0 and (low >= 0.0 or sign < high / (high - low))
    far, near = (high, max(low, 0.0)) if upwards else (-low, max(-high, 0.0))
    most = min(far, max(_SPAN * unit, 2.0 * near))
    least = max(near, min(unit / _SPAN, 0.5 * most))
    size = float(least * (most / least) ** share)
    return size if upwards else -size


def _cost(corners: Family, gains: FoPi, points: Array) -> float:
    """The objective on few plants and what limits are missed by; inf where there is no such loop."""
    problem = corners.problem
    try:
        values = corners.values(corners.controller(gains), points)
    except DomainError:
        return np.inf
    worst = {key: float(found.max()) for key, found in values.items()}
    aim = worst.pop(problem.objective.key) if problem.objective is not None else 1.0
    missed = max([0.0, *worst.values()])
    if not np.isfinite(missed) or not np.isfinite(aim):
        return np.inf
    return aim + _PENALTY * max(abs(aim), 1e-9) * min(missed, 1e3)


def _are_apart(numbers: Numbers, one: FoPi, other: FoPi) -> bool:
    a, b, linear = numbers.of(one), numbers.of(other), numbers.linear
    if np.any(np.abs(a[linear:] - b[linear:]) > _APART_IN_ORDER):
        return True
    a, b = a[:linear], b[:linear]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(np.log(np.abs(a) / np.abs(b)))
    return bool(np.any(np.sign(a) != np.sign(b)) or np.nanmax(ratio, initial=0.0) > _APART)
