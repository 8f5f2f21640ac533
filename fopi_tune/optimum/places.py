"""Where to look:  frequencies and plants at which a condition may be broken."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import extremes
from fopi_tune.errors import DomainError
from fopi_tune.optimum.conditions import Condition, Test
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.refute import Reason
from fopi_tune.optimum.screen import gains_at

#: (frequency or None, plant) that a verification names
Place = tuple[float | None, tuple[float, ...]]

_FREQUENCIES = 36
#: how far beyond the plants' own frequencies the first ones reach
_BEYOND = 30.0
#: frequencies closer than this (relative) are one
_GRAIN = 2e-3
_MOST_CORNERS = 16
_MOST_INSIDE = 81
#: neper from its limit at which a condition is worth a new sample
_NEAR = 0.05


def plants_to_try(problem: Problem, places: list[Place]) -> list[tuple[float, ...]]:
    """The nominal plant, the corners, and those that a verification names."""
    corners = [tuple(point) for point in problem.family.corners(_MOST_CORNERS).tolist()]
    return list(dict.fromkeys([problem.nominal, *corners, *(point for _, point in places)]))


def first_reasons(problem: Problem, points: list[tuple[float, ...]], places: list[Place]) -> list[Reason]:
    """A grid of frequencies with every plant, for each condition that is read at one frequency."""
    found: list[Reason] = []
    for k, condition in enumerate(problem.conditions.every):
        own = [problem.nominal] if condition.nominal else points
        if condition.test is Test.DISTURBANCE:
            found += [Reason(k, point) for point in own]
        elif condition.test is Test.GAIN_SPREAD and problem.crossover_rad_s is not None:
            found += [Reason(k, point, (problem.crossover_rad_s,)) for point in own if point != problem.nominal]
        elif condition.test is Test.RESPONSE:
            low, high = condition.band_rad_s
            named = {omega for omega, _ in places if omega is not None and max(low, 1e-12) <= omega <= min(high, 1e12)}
            grid = sorted({*_grid(problem, low, high), *named})
            found += [Reason(k, point, (omega,)) for omega, point in product(grid, own)]
    return [reason for reason in dict.fromkeys(found) if not _needs_a_line(problem, reason)]


def _needs_a_line(problem: Problem, reason: Reason) -> bool:
    """What is known of all boxes alike is tested apart from the samples."""
    return problem.conditions.every[reason.condition].test is Test.GAIN_SPREAD


def _grid(problem: Problem, low: float, high: float) -> list[float]:
    plants = Plants.members(problem.family, problem.family.corners(_MOST_CORNERS))
    sizes = [np.abs(roots[np.isfinite(roots) & (roots != 0)]) for roots in (plants.poles, plants.zeros)]
    own = np.concatenate([*sizes, 1.0 / plants.dead_time_s[plants.dead_time_s > 0], [1.0] * (not sizes)])
    own = own if len(own) else np.ones(1)
    first, last = float(own.min()) / _BEYOND, float(own.max()) * _BEYOND
    if problem.crossover_rad_s is not None:
        first, last = min(first, problem.crossover_rad_s / _BEYOND), max(last, problem.crossover_rad_s * _BEYOND)
    first, last = max(first, low), min(last, high)
    if low > 0.0 and first > last:
        first = last = low
    if first > last:
        first = last = high
    count = max(1, round(_FREQUENCIES * min(1.0, math.log(last / first) / math.log(_BEYOND**2) + 0.1)))
    grid = np.geomspace(first, last, count) if last > first else np.array([first])
    return [min(max(float(omega), low), high) for omega in grid]


def further_reasons(problem: Problem, centres: Array, points: list[tuple[float, ...]]) -> list[Reason]:
    """The worst frequency and plant of every condition on a response, for controllers that were not discarded."""
    inside = _inside(problem)
    plants = np.array([*points, *inside], dtype=float).reshape(len(points) + len(inside), -1)
    kp, ki, alpha = (np.repeat(gain, len(plants)) for gain in gains_at(problem.chart, centres))
    usable = (kp != 0.0) | (ki != 0.0)
    rows = np.tile(np.arange(len(plants)), len(centres))
    loops = Loops(kp, ki, alpha, Plants.members(problem.family, plants).take(rows))
    found: list[Reason] = []
    for k, condition in enumerate(problem.conditions.every):
        if condition.test is Test.RESPONSE and usable.all():
            found += _worst(k, condition, loops, plants, len(centres))
    return found


def _inside(problem: Problem) -> list[tuple[float, ...]]:
    """Plants of a coarse grid."""
    low, high = problem.family.low, problem.family.high
    count = len(low)
    if count == 0 or 3**count > _MOST_INSIDE:
        return []
    sides = [(a, 0.5 * (a + b), b) for a, b in zip(low.tolist(), high.tolist(), strict=True)]
    return list(product(*sides))


def _worst(k: int, condition: Condition, loops: Loops, plants: Array, count: int) -> list[Reason]:
    assert condition.response is not None
    low, high = condition.band_rad_s
    try:
        at = extremes(loops, condition.response, low, high, condition.upper)
    except DomainError:
        return []
    level = float(condition.level.mid())
    excess = ((at.value - level) * (1.0 if condition.upper else -1.0)).reshape(count, -1)
    omega = at.omega_rad_s.reshape(count, -1)
    if condition.nominal:
        excess, omega = excess[:, :1], omega[:, :1]
    found = []
    best = np.argmax(np.where(np.isfinite(excess), excess, -np.inf), axis=1)
    for row, plant in enumerate(best.tolist()):
        where = float(omega[row, plant])
        if not excess[row, plant] > -_NEAR or not 0.0 < where < math.inf:
            continue
        rounded = math.exp(round(math.log(where) / _GRAIN) * _GRAIN)
        rounded = min(max(rounded, low), high)
        found.append(Reason(k, tuple(plants[plant].tolist()), (rounded,)))
    return found
