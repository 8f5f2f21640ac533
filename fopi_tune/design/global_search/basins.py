"""Problem -> basins:  the rays that are best among their neighbours, improved on the table, as starts of the polish."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.design.constraints import Bound
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    IAE,
    KI,
    NOTHING,
    PHASE_MARGIN,
    PHASE_SLOPE,
    Rows,
    nominal_of,
    work_for,
)
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.scan import best_at_margin, best_of_order, compass, direction, scan_rays
from fopi_tune.design.global_search.tables import DECADES_BEYOND

#: rays: orders this far apart, and so many directions
_ALPHA_STEP = 0.07
_FEWEST_ALPHAS = 7
_DIRECTIONS = 33
_ORDERS_WITH_TWO_EQUALITIES = 61
#: ln of how far from the grid's ends the frequency stays where both terms of the controller are equal
_INSIDE = 1.0
#: natural units; inequalities are relaxed by these where the coarse grid shows nothing that meets them
RELAXED = (0.0, 0.05, 0.3)
#: of flat minima: this part of the cost (or of 0.05) away from the best still counts
_NEARLY = 0.04
_LEAST_STEP = 2e-3
_ROUNDS = 60


@dataclass(frozen=True)
class Basin:
    """A start.

    Args:
        cost: on the scan's table.
        gains: scaled kp, ki and alpha, shape (3,).
    """

    cost: float
    gains: Array


@dataclass(frozen=True)
class Scan:
    """The scan of the whole box.

    Args:
        basins: the best first.
        relaxed: by how much inequalities were relaxed, natural units.
        rays: how many were looked at.
        allowed: the share of them on which something meets everything.
    """

    basins: tuple[Basin, ...]
    relaxed: float
    rays: int
    allowed: float


def reach_of(problem: Problem) -> tuple[float, float]:
    """Most and span of `direction`."""
    v = problem.scan_table.v
    most = float(min(-v[1], v[-2])) - _INSIDE
    span = max(0.25 * (float(max(-v[1], v[-2])) - math.log(10.0) * (DECADES_BEYOND + 3.0)), 1.0)
    return max(most, 1.0), span


def quadrants_of(problem: Problem) -> Array:
    """The signs of kp and ki that their ranges allow, shape (k, 2)."""
    box = problem.box
    kp = [sign for sign in (1.0, -1.0) if (box.kp_high > 0.0 if sign > 0 else box.kp_low < 0.0)] or [1.0]
    ki = [sign for sign in (1.0, -1.0) if (box.ki_high > 0.0 if sign > 0 else box.ki_low < 0.0)] or [1.0]
    return np.array([(a, b) for a in kp for b in ki])


def equalities_of(problem: Problem, rows: Rows) -> NDArray[np.int64]:
    """Indices of the equalities in the order in which they are solved.

    A crossover has one kappa a ray.  A slope of the phase comes before a margin: where both hold the margin's kappa is
    a double one (the phase touches its limit), which no change of sign shows.
    """
    equal = [k for k, c in enumerate(problem.constraints) if c.bound is Bound.EQUAL and not rows.soft[k]]
    first = {CROSSOVER: 0, PHASE_SLOPE: 1}
    return np.array(sorted(equal, key=lambda k: (first.get(int(rows.kind[k]), 2), k)), dtype=np.int64)


def directions_of(problem: Problem) -> tuple[Array, bool]:
    """The grid of tau, and whether it is a single one."""
    box = problem.box
    if box.ki_low == box.ki_high == 0.0:
        return np.array([-1.0]), True
    if box.kp_low == box.kp_high == 0.0:
        return np.array([1.0]), True
    return np.concatenate([[-1.0], np.linspace(-0.96, 0.96, _DIRECTIONS - 2), [1.0]]), False


def scan_box(problem: Problem, most: int, coarse: float = 1.0) -> Scan:
    """Scan the rays of the whole box.

    Args:
        problem: the problem.
        most: basins.
        coarse: factor on the distance between rays.
    """
    box = problem.box
    taus, fixed = directions_of(problem)
    quadrants, (most_ratio, span) = quadrants_of(problem), reach_of(problem)
    alphas = _orders(problem, _ALPHA_STEP * coarse, _FEWEST_ALPHAS)
    table, rays = problem.scan_table, 0
    work = work_for(table)
    for relaxed in RELAXED:
        rows = problem.rows(table, relaxed)
        equal = equalities_of(problem, rows)
        if len(equal) > 1 and not fixed:
            at_margin = coarse > 1.0 and [rows.kind[q] for q in equal] == [CROSSOVER, PHASE_MARGIN]
            pairs = _with_two_equalities(problem, rows, equal, taus, most, True) if at_margin else ()
            pairs = pairs or _with_two_equalities(problem, rows, equal, taus, most, False)
            rays += _ORDERS_WITH_TWO_EQUALITIES * (2 if at_margin else len(taus))
            if pairs:
                return Scan(pairs, relaxed, rays, 1.0)
            continue
        costs, kappas = scan_rays(
            problem.code, alphas, taus, quadrants, equal, most_ratio, span, table, rows, box, work
        )  # fmt: skip
        rays += costs.size
        if (costs < NOTHING).any():
            break
    else:
        return Scan((), RELAXED[-1], rays, 0.0)
    steps = (0.5 * (alphas[1] - alphas[0]) if len(alphas) > 1 else 0.0, 0.03)
    found: list[Basin] = []
    for value, z, i, j in _minima(costs)[: 3 * most]:
        alpha, tau, value, kappa = compass(
            problem.code, np.array([alphas[i], taus[j], value + 1e-15]), np.array(steps), fixed, quadrants[z], equal,
            most_ratio, span, _LEAST_STEP, _ROUNDS, table, rows, box, work,
        )  # fmt: skip
        if kappa == 0.0:
            kappa = kappas[z, i, j]
        _offer(found, Basin(value, _gains(alpha, tau, kappa, quadrants[z], most_ratio, span)))
    found = sorted(found, key=lambda basin: basin.cost)[:most]
    if problem.code not in (KI, IAE) and len(alphas) > 3:
        found += _flat_valley(problem, found[0].cost, costs, kappas, alphas, taus, quadrants)
    return Scan(tuple(found), relaxed, rays, float((costs < NOTHING).mean()))


def _orders(problem: Problem, step: float, fewest: int) -> Array:
    box = problem.box
    if box.alpha_low == box.alpha_high:
        return np.array([box.alpha_low])
    count = max(fewest, int((box.alpha_high - box.alpha_low) / step) + 2)
    return np.linspace(box.alpha_low, box.alpha_high, count)


def _gains(alpha: float, tau: float, kappa: float, signs: Array, most_ratio: float, span: float) -> Array:
    c, s = direction(alpha, tau, most_ratio, span)
    k = math.exp(kappa)
    return np.array([k * c * signs[0], k * s * signs[1], alpha])


def _minima(costs: Array) -> list[tuple[float, int, int, int]]:
    """Rays that are no worse than their eight neighbours, the best first."""
    padded = np.pad(costs, ((0, 0), (1, 1), (1, 1)), constant_values=NOTHING)
    rows, columns = costs.shape[1:]
    around = [
        padded[:, 1 + a : 1 + a + rows, 1 + b : 1 + b + columns] for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b
    ]
    z, i, j = np.nonzero((costs <= np.min(around, axis=0)) & (costs < NOTHING))
    return sorted((float(costs[a, b, c]), int(a), int(b), int(c)) for a, b, c in zip(z, i, j, strict=True))


def _offer(found: list[Basin], new: Basin) -> None:
    def same(other: Basin) -> bool:
        return bool(np.all(np.abs(new.gains - other.gains) < 0.02 + 0.05 * np.abs(other.gains)))

    twins = [k for k, other in enumerate(found) if same(other)]
    if not twins:
        found.append(new)
    elif new.cost < found[twins[0]].cost:
        found[twins[0]] = new


def _flat_valley(
    problem: Problem, best: float, costs: Array, kappas: Array, alphas: Array, taus: Array, quadrants: Array
) -> list[Basin]:
    """One more start from each third of the orders: minima of a largest value are flat along a valley."""
    most_ratio, span = reach_of(problem)
    more = []
    for part in np.array_split(np.arange(len(alphas)), 3):
        z, i, j = np.unravel_index(np.argmin(costs[:, part, :]), costs[:, part, :].shape)
        value = float(costs[z, part[i], j])
        if value < best + _NEARLY * max(abs(best), 0.05):
            gains = _gains(
                float(alphas[part[i]]), float(taus[j]), float(kappas[z, part[i], j]), quadrants[z], most_ratio, span
            )
            more.append(Basin(value, gains))
    return more


def _with_two_equalities(
    problem: Problem, rows: Rows, equal: NDArray[np.int64], taus: Array, most: int, at_margin: bool
) -> tuple[Basin, ...]:
    """Minima over alpha where two equalities leave one ray for each order.

    With `at_margin` these are a crossover and the phase margin there; a margin that another crossover has is left out.
    """
    most_ratio, span = reach_of(problem)
    box, table = problem.box, problem.scan_table
    nominal = nominal_of(table)
    work, nominal_work = work_for(table), work_for(nominal)
    alphas = _orders(problem, 1.0, _ORDERS_WITH_TWO_EQUALITIES // (2 if at_margin else 1))
    found: list[Basin] = []
    for signs in quadrants_of(problem):

        def best(alpha: float, signs: Array = signs) -> tuple[float, float, float]:
            if at_margin:
                return best_at_margin(
                    problem.code, alpha, signs, equal, most_ratio, span, table, rows, box, work
                )  # fmt: skip
            return best_of_order(
                problem.code, alpha, signs, taus, equal, most_ratio, span, table, rows, box, work, nominal, nominal_work
            )

        costs = np.array([best(alpha)[0] for alpha in alphas])
        padded = np.pad(costs, 1, constant_values=NOTHING)
        low = np.flatnonzero((costs <= np.minimum(padded[:-2], padded[2:])) & (costs < NOTHING))
        for i in low[np.argsort(costs[low])][:most]:
            alpha, step = float(alphas[i]), 0.5 * float(alphas[1] - alphas[0]) if len(alphas) > 1 else 0.0
            value = float(costs[i])
            while step > 1e-3:
                near = [min(max(alpha + d, box.alpha_low), box.alpha_high) for d in (-step, step)]
                values = [best(x)[0] for x in near]
                k = int(np.argmin(values))
                if values[k] < value:
                    alpha, value = near[k], values[k]
                else:
                    step *= 0.5
            value, kappa, tau = best(alpha)
            if value < NOTHING:
                _offer(found, Basin(float(value), _gains(alpha, tau, kappa, signs, most_ratio, span)))
    return tuple(sorted(found, key=lambda basin: basin.cost)[:most])
