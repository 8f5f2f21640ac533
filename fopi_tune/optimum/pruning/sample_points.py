"""Sample points:  frequencies and plants at which a condition may be violated."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Condition, Test
from fopi_tune.optimum.pruning.crossover_suggestions import suggestions
from fopi_tune.optimum.pruning.exclusion import Reason, is_broken_at_zero, is_excluded, response_quadratic
from fopi_tune.optimum.pruning.screen import Boxes, gains_at
from fopi_tune.proof.balls.box import Box

#: (frequency or None, plant) of a worst case of a verification
WorstCasePoint = tuple[float | None, tuple[float, ...]]

_FREQUENCIES = 36
#: factor by which the first grid exceeds the range of the plants' corner frequencies
_BEYOND = 30.0
#: frequencies closer than this (relative) are merged
_GRAIN = 2e-3
_MOST_CORNERS = 16
_MOST_INSIDE = 81
#: a condition within this distance of its limit, neper, gets a new sample
_NEAR = 0.05
#: frequencies at which plants are compared, steps to where they are too far apart, and relative room for the proof
_FINE, _HALVINGS, _ROOM = 400, 30, 1e-6


def plants_to_try(problem: Problem, places: list[WorstCasePoint]) -> list[tuple[float, ...]]:
    """The nominal plant, the corners, and those that a verification names."""
    corners = [tuple(point) for point in problem.family.corners(_MOST_CORNERS).tolist()]
    return list(dict.fromkeys([problem.nominal, *corners, *(point for _, point in places)]))


def first_reasons(problem: Problem, points: list[tuple[float, ...]], places: list[WorstCasePoint]) -> list[Reason]:
    """A grid of frequencies with every plant, for each condition that is read at one frequency."""
    found: list[Reason] = []
    for k, condition in enumerate(problem.conditions.every):
        own = [problem.nominal] if condition.nominal else points
        if condition.test is Test.DISTURBANCE:
            found += [Reason(k, point) for point in own]
        elif condition.test is Test.RESPONSE:
            low, high = condition.band_rad_s
            least, most = max(low, 1e-12), min(high, 1e12, problem.highest_rad_s)
            named = {omega for omega, _ in places if omega is not None and least <= omega <= most}
            grid = sorted({*_grid(problem, low, high), *named})
            found += [Reason(k, point, (omega,)) for omega, point in product(grid, own)]
    return list(dict.fromkeys(found))


def spread_reasons(problem: Problem, points: list[tuple[float, ...]]) -> list[Reason]:
    """Of each plant the lowest frequency from which on its gain is too far from the nominal one's, if there is one."""
    if problem.crossover_rad_s is not None or problem.is_on_samples:
        return []
    corners = _corner_frequencies(problem.family)
    grid = np.geomspace(corners.min() / _BEYOND, corners.max() * _BEYOND, _FINE)
    found: list[Reason] = []
    for k, condition in enumerate(problem.conditions.every):
        if condition.test is not Test.GAIN_SPREAD or not condition.level > 0:
            continue
        level = float(condition.level.mid())
        for point in points:
            plants = Plants.members(problem.family, np.array([point, problem.nominal], dtype=float))

            def apart(omega: Array, plants: Plants = plants) -> Array:
                rows = np.zeros(len(omega), dtype=np.intp)
                return np.abs(np.log(np.abs(plants.response(rows, omega) / plants.response(rows + 1, omega))))

            inside = np.flatnonzero(~(apart(grid) > level))
            if not len(inside) or inside[-1] == len(grid) - 1:
                continue
            low, high = grid[inside[-1]], grid[inside[-1] + 1]
            for _ in range(_HALVINGS):
                middle = math.sqrt(low * high)
                low, high = (low, middle) if apart(np.array([middle]))[0] > level else (middle, high)
            reason = Reason(k, point, (float(high) * (1.0 + _ROOM),))
            if response_quadratic(problem, condition, reason) is not None:
                found.append(reason)
    return found


def constant_reasons(problem: Problem, points: list[tuple[float, ...]]) -> list[Reason]:
    """Reasons independent of the controller: limits at 0 and infinity, a spread is not negative, or is known."""
    found: list[Reason] = []
    for k, condition in enumerate(problem.conditions.every):
        spread = condition.test in (Test.SPREAD, Test.GAIN_SPREAD)
        high = condition.response is Response.SENSITIVITY and math.isinf(condition.band_rad_s[1])
        if condition.test is Test.RESPONSE and condition.band_rad_s[0] == 0.0:
            own = [problem.nominal] if condition.nominal else points
            found += [Reason(k, point, (0.0,)) for point in own if is_broken_at_zero(problem, condition, point)]
        if (spread and condition.level <= 0) or (high and condition.upper and condition.level < 0):
            found.append(Reason(k, problem.nominal))
        elif condition.test is Test.GAIN_SPREAD and problem.crossover_rad_s is None:
            found += [Reason(k, point, (0.0,)) for point in points if problem.constant_gain_ratio(point) is not None]
        elif condition.test is Test.GAIN_SPREAD and problem.crossover_rad_s is not None:
            found += [Reason(k, point, (problem.crossover_rad_s,)) for point in points if point != problem.nominal]
    return found


def meets_conditions(problem: Problem, centre: Array, points: list[tuple[float, ...]]) -> bool:
    """Whether one controller, shape (1, k), meets every condition, in floating point and for these plants."""
    gains = gains_at(problem.parametrization, centre)
    if gains.is_zero[0]:
        return False
    for condition in problem.conditions.every:
        if condition.test is Test.GAIN:
            value, level = gains.named(condition.name)[0], float(condition.level.mid())
            if value > level if condition.upper else value < level:
                return False
    if any(
        is_excluded(problem, problem.parametrization.controllers(_point(centre)), r)
        for r in constant_reasons(problem, points)
    ):
        return False
    loops, plants = _loops(problem, centre, points)
    for k, condition in enumerate(problem.conditions.every):
        if condition.test is Test.DISTURBANCE:
            controllers = problem.parametrization.controllers(_point(centre))
            if any(is_excluded(problem, controllers, Reason(k, point)) for point in points):
                return False
        if condition.test is Test.RESPONSE:
            excess, _ = _excesses(condition, loops, plants, 1)
            if excess is None or np.nanmax(excess) > 0.0:
                return False
    fixed = problem.margin_is_fixed  # the coordinates already satisfy a fixed nominal margin
    return not any(
        suggestion.excess > 0.0
        for suggestion in suggestions(problem, Boxes(centre, centre), points)
        if not (fixed and problem.conditions.every[suggestion.reason.condition].nominal)
    )


def _point(centre: Array) -> Box:
    return tuple((value, value) for value in centre[0].tolist())


def typical_frequency_rad_s(family: PlantFamily) -> float:
    """The geometric mean of the plants' corner frequencies, rad/s."""
    return float(np.exp(np.log(_corner_frequencies(family)).mean()))


def _corner_frequencies(family: PlantFamily) -> Array:
    """|poles|, |zeros| and 1/dead times of the corner plants, rad/s; 1 without any."""
    plants = Plants.members(family, family.corners(_MOST_CORNERS))
    sizes = [np.abs(roots[np.isfinite(roots) & (roots != 0)]) for roots in (plants.poles, plants.zeros)]
    own = np.concatenate([*sizes, 1.0 / plants.dead_time_s[plants.dead_time_s > 0]])
    return own if len(own) else np.ones(1)


def _grid(problem: Problem, low: float, high: float) -> list[float]:
    own = _corner_frequencies(problem.family)
    first, last = float(own.min()) / _BEYOND, float(own.max()) * _BEYOND
    if problem.spec.controller.has_derivative:
        # beyond the filter's corner C is kp + kd/Tf
        last = max(last, _BEYOND / problem.spec.controller.derivative_filter_time_constant_s)
    if problem.measurement_filter is not None:
        last = max(last, _BEYOND / problem.measurement_filter.time_constant_s)
    if problem.crossover_rad_s is not None:
        first, last = min(first, problem.crossover_rad_s / _BEYOND), max(last, problem.crossover_rad_s * _BEYOND)
    first, last, high = max(first, low), min(last, high, problem.highest_rad_s), min(high, problem.highest_rad_s)
    if low > 0.0 and first > last:
        first = last = low
    if first > last:
        first = last = high
    count = max(1, round(_FREQUENCIES * min(1.0, math.log(last / first) / math.log(_BEYOND**2) + 0.1)))
    grid = np.geomspace(first, last, count) if last > first else np.array([first])
    return [min(max(float(omega), low), high) for omega in grid]


def further_reasons(problem: Problem, centres: Array, points: list[tuple[float, ...]]) -> list[Reason]:
    """The worst frequency and plant of every condition on a response, for controllers that were not discarded."""
    centres = centres[~gains_at(problem.parametrization, centres).is_zero]
    if problem.is_on_samples and len(centres) > 1:
        several = (further_reasons(problem, centre[None], points) for centre in centres)
        return list(dict.fromkeys(reason for found in several for reason in found))
    if not len(centres):
        return []
    loops, plants = _loops(problem, centres, points)
    found: list[Reason] = []
    for k, condition in enumerate(problem.conditions.every):
        if condition.test is Test.RESPONSE:
            found += _worst(problem, k, condition, loops, plants, len(centres))
    return found


def _loops(problem: Problem, centres: Array, points: list[tuple[float, ...]]) -> tuple[Loops, Array]:
    """Every controller with every plant, those of a coarse grid too."""
    inside = _inside(problem)
    plants = np.array([*points, *inside], dtype=float).reshape(len(points) + len(inside), -1)
    return gains_at(problem.parametrization, centres).loops(problem, plants), plants


def _inside(problem: Problem) -> list[tuple[float, ...]]:
    """Plants of a coarse grid."""
    low, high = problem.family.low, problem.family.high
    count = len(low)
    if count == 0 or 3**count > _MOST_INSIDE:
        return []
    sides = [(a, 0.5 * (a + b), b) for a, b in zip(low.tolist(), high.tolist(), strict=True)]
    return list(product(*sides))


def _excesses(condition: Condition, loops: Loops, plants: Array, count: int) -> tuple[Array | None, Array]:
    """Violation of a condition by each controller (rows) and plant (columns), neper, and its frequency."""
    assert condition.response is not None
    try:
        at = extremes(loops, condition.response, *condition.band_rad_s, condition.upper, condition.tilt)
    except DomainError:
        return None, plants
    level = float(condition.level.mid())
    excess = ((at.value - level) * (1.0 if condition.upper else -1.0)).reshape(count, -1)
    omega = at.omega_rad_s.reshape(count, -1)
    return (excess[:, :1], omega[:, :1]) if condition.nominal else (excess, omega)


def _worst(problem: Problem, k: int, condition: Condition, loops: Loops, plants: Array, count: int) -> list[Reason]:
    excess, omega = _excesses(condition, loops, plants, count)
    if excess is None:
        return []
    low, high = condition.band_rad_s
    found = []
    best = np.argmax(np.where(np.isfinite(excess), excess, -np.inf), axis=1)
    for row, plant in enumerate(best.tolist()):
        where = float(omega[row, plant])
        if not excess[row, plant] > -_NEAR or not 0.0 < where < problem.highest_rad_s:
            continue
        rounded = math.exp(round(math.log(where) / _GRAIN) * _GRAIN)
        rounded = min(max(rounded, low), high, problem.highest_rad_s)
        found.append(Reason(k, tuple(plants[plant].tolist()), (rounded,)))
    return found
