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
    DEPTH,
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
from fopi_tune.design.global_search.scan import (
    best_at_margins,
    best_of_shape,
    compass,
    pattern_search,
    scan_orders,
    scan_rays,
)
from fopi_tune.design.global_search.structures import FRACTIONAL, box_with_orders, directions_of, quadrants_of, ray_of
from fopi_tune.design.global_search.tables import DECADES_BEYOND

_SHAPES_WITH_TWO_EQUALITIES = 61
#: ln of how far from the grid's ends the frequency stays where both terms of the controller are equal
_INSIDE = 1.0
#: natural units; inequalities are relaxed by these where the coarse grid shows nothing that meets them
RELAXED = (0.0, 0.05, 0.3)
#: of flat minima: this part of the cost (or of 0.05) away from the best still counts
_NEARLY = 0.04
#: of the best cost (or of 0.05): a basin that is worse by more on the scan's table is not polished
WORTH = 0.03
_LEAST_STEP = 2e-3
_ROUNDS = 60
#: of free orders: taus, shapes, alphas and mus of the scan; four times as many find nothing better
_GRIDS = (11, 5, 7, 4)
#: basins of them, of objectives whose values take long fewer
_MOST_BASINS, _OF_A_DEPTH = 7, 3
#: of a search along an order of the integral, and of one from the best of them: evaluations, the part of a step that
#: ends it
_ALONG, _FROM_THERE = (60, 0.2), (200, 0.02)


@dataclass(frozen=True)
class Basin:
    """A start.

    Args:
        cost: on the scan's table.
        gains: the scaled numbers of the controller, shape (3,), with orders (5,).
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
    """Most and span of `ray_of`."""
    v = problem.scan_table.v
    most = float(min(-v[1], v[-2])) - _INSIDE
    span = max(0.25 * (float(max(-v[1], v[-2])) - math.log(10.0) * (DECADES_BEYOND + 3.0)), 1.0)
    return max(most, 1.0), span


def equalities_of(problem: Problem, rows: Rows) -> NDArray[np.int64]:
    """Indices of the equalities in the order in which they are solved.

    A crossover has one kappa a ray.  A slope of the phase comes before a margin: where both hold the margin's kappa is
    a double one (the phase touches its limit), which no change of sign shows.
    """
    equal = [k for k, c in enumerate(problem.constraints) if c.bound is Bound.EQUAL and not rows.soft[k]]
    first = {CROSSOVER: 0, PHASE_SLOPE: 1}
    return np.array(sorted(equal, key=lambda k: (first.get(int(rows.kind[k]), 2), k)), dtype=np.int64)


def scan_box(problem: Problem, most: int, coarse: float = 1.0, enough: float = -math.inf) -> Scan:
    """Scan the rays of the whole box.

    Args:
        problem: the problem.
        most: basins.
        coarse: factor on the distance between rays.
        enough: a cost; where rays have no more, no better ones are looked for.
    """
    if problem.structure.has_orders:
        return _scan_with_orders(problem, most, coarse)
    box = problem.box
    taus, fixed = directions_of(problem.box)
    quadrants, (most_ratio, span) = quadrants_of(problem.box), reach_of(problem)
    structure = problem.structure
    shapes = _shapes(problem, structure.step * coarse, structure.fewest)
    table, rays = problem.scan_table, 0
    work = work_for(table)
    for relaxed in RELAXED:
        rows = problem.rows(table, relaxed)
        equal = equalities_of(problem, rows)
        if len(equal) > 1 and not fixed:
            fractional = problem.structure == FRACTIONAL
            at_margin = fractional and coarse > 1.0 and [rows.kind[q] for q in equal] == [CROSSOVER, PHASE_MARGIN]
            pairs = _with_two_equalities(problem, rows, equal, taus, most, True) if at_margin else ()
            pairs = pairs or _with_two_equalities(problem, rows, equal, taus, most, False)
            rays += _SHAPES_WITH_TWO_EQUALITIES * (2 if at_margin else len(taus))
            if pairs:
                return Scan(pairs, relaxed, rays, 1.0)
            continue
        costs, kappas = scan_rays(
            problem.code, shapes, taus, quadrants, equal, most_ratio, span, table, rows, box, work
        )  # fmt: skip
        rays += costs.size
        if (costs < NOTHING).any():
            break
    else:
        return Scan((), RELAXED[-1], rays, 0.0)
    steps = (0.5 * (shapes[1] - shapes[0]) if len(shapes) > 1 else 0.0, 0.03)
    found: list[Basin] = []
    ends: list[tuple[int, float, float]] = []
    for value, z, i, j in _minima(costs)[: 3 * most]:
        if any(
            z == q and abs(shapes[i] - a) <= 2.0 * steps[0] and abs(taus[j] - b) <= 2.0 * steps[1] for q, a, b in ends
        ):
            # next to where another search ended, which ends there as well
            continue
        basin = Basin(value, _gains(problem, float(shapes[i]), float(taus[j]), float(kappas[z, i, j]), quadrants[z]))
        if value <= enough or problem.is_at_floor(value, basin.gains):
            _offer(problem, found, basin)
            continue
        shape, tau, value, kappa = compass(
            problem.code, np.array([shapes[i], taus[j], value + 1e-15]), np.array(steps), fixed, quadrants[z], equal,
            most_ratio, span, _LEAST_STEP, _ROUNDS, table, rows, box, work,
        )  # fmt: skip
        ends.append((z, shape, tau))
        if kappa == 0.0:
            kappa = kappas[z, i, j]
        _offer(problem, found, Basin(value, _gains(problem, shape, tau, kappa, quadrants[z])))
    found = sorted(found, key=lambda basin: basin.cost)[:most]
    if problem.code not in (KI, IAE) and len(shapes) > 3 and found[0].cost > enough:
        _offer_flat_valley(problem, found, costs, kappas, shapes, taus, quadrants)
    return Scan(tuple(found), relaxed, rays, float((costs < NOTHING).mean()))


def _shapes(problem: Problem, step: float, fewest: int) -> Array:
    low, high = problem.box.shape_low, problem.box.shape_high
    if low == high:
        return np.array([low])
    return np.linspace(low, high, max(fewest, int((high - low) / step) + 2))


def _gains(problem: Problem, shape: float, tau: float, kappa: float, signs: Array) -> Array:
    third, c, s = ray_of(shape, tau, signs, *reach_of(problem), problem.box, problem.scaled.sampling)
    return problem.structure.times(math.exp(kappa), np.array([c, s, third]))


def _minima(costs: Array) -> list[tuple[float, int, int, int]]:
    """Rays that are no worse than their eight neighbours, the best first."""
    padded = np.pad(costs, ((0, 0), (1, 1), (1, 1)), constant_values=NOTHING)
    rows, columns = costs.shape[1:]
    around = [
        padded[:, 1 + a : 1 + a + rows, 1 + b : 1 + b + columns] for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b
    ]
    z, i, j = np.nonzero((costs <= np.min(around, axis=0)) & (costs < NOTHING))
    return sorted((float(costs[a, b, c]), int(a), int(b), int(c)) for a, b, c in zip(z, i, j, strict=True))


def _offer(problem: Problem, found: list[Basin], new: Basin) -> None:
    """Add a basin, or replace its twin by it where it is better."""
    at = problem.structure.without_idle_orders(new.gains)

    def same(other: Basin) -> bool:
        there = problem.structure.without_idle_orders(other.gains)
        return bool(np.all((np.abs(at - there) < 0.02 + 0.05 * np.abs(there)) & ((at == 0.0) == (there == 0.0))))

    twins = [k for k, other in enumerate(found) if same(other)]
    if not twins:
        found.append(new)
    elif new.cost < found[twins[0]].cost:
        found[twins[0]] = new


def _offer_flat_valley(
    problem: Problem, found: list[Basin], costs: Array, kappas: Array, shapes: Array, taus: Array, quadrants: Array
) -> None:
    """One more start from each third of the shapes: minima of a largest value are flat along a valley."""
    best = found[0].cost
    for part in np.array_split(np.arange(len(shapes)), 3):
        z, i, j = np.unravel_index(np.argmin(costs[:, part, :]), costs[:, part, :].shape)
        value = float(costs[z, part[i], j])
        if value < best + _NEARLY * max(abs(best), 0.05):
            gains = _gains(problem, float(shapes[part[i]]), float(taus[j]), float(kappas[z, part[i], j]), quadrants[z])
            _offer(problem, found, Basin(value, gains))


def _with_two_equalities(
    problem: Problem, rows: Rows, equal: NDArray[np.int64], taus: Array, most: int, at_margin: bool
) -> tuple[Basin, ...]:
    """Minima over the shapes where two equalities leave one ray for each.

    With `at_margin` these are a crossover and the phase margin there; a margin that another crossover has is left out.
    """
    most_ratio, span = reach_of(problem)
    box, table = problem.box, problem.scan_table
    nominal = nominal_of(table)
    work, nominal_work = work_for(table), work_for(nominal)
    shapes = _shapes(problem, 9.0, _SHAPES_WITH_TWO_EQUALITIES // (2 if at_margin else 1))
    found: list[Basin] = []
    for signs in quadrants_of(problem.box):

        def best(shapes: Array, signs: Array = signs) -> Array:
            """Cost, kappa and tau of each shape."""
            if at_margin:
                return best_at_margins(
                    problem.code, shapes, signs, equal, most_ratio, span, table, rows, box, work
                )  # fmt: skip
            return np.array([best_of_shape(
                problem.code, shape, signs, taus, equal, most_ratio, span, table, rows, box, work, nominal, nominal_work
            ) for shape in shapes.tolist()])  # fmt: skip

        costs = best(shapes)[:, 0]
        padded = np.pad(costs, 1, constant_values=NOTHING)
        low = np.flatnonzero((costs <= np.minimum(padded[:-2], padded[2:])) & (costs < NOTHING))
        for i in low[np.argsort(costs[low])][:most]:
            shape, step = float(shapes[i]), 0.5 * float(shapes[1] - shapes[0]) if len(shapes) > 1 else 0.0
            value = float(costs[i])
            while step > 1e-3:
                near = np.clip([shape - step, shape + step], box.shape_low, box.shape_high)
                values = best(near)[:, 0]
                k = int(np.argmin(values))
                if values[k] < value:
                    shape, value = float(near[k]), float(values[k])
                else:
                    step *= 0.5
            value, kappa, tau = best(np.array([shape]))[0].tolist()
            if value < NOTHING:
                _offer(problem, found, Basin(float(value), _gains(problem, shape, tau, kappa, signs)))
    return tuple(sorted(found, key=lambda basin: basin.cost)[:most])


@dataclass(frozen=True)
class _Grids:
    """What is scanned: taus, shapes, alphas and mus."""

    axes: tuple[Array, Array, Array, Array]

    @classmethod
    def of(cls, problem: Problem, coarse: float) -> _Grids:
        """Those of a problem; an order without its term has one value."""
        box, controller = problem.box, problem.spec.controller
        count = [max(int(size / coarse), 2) for size in _GRIDS]
        taus, fixed = directions_of(problem.box)
        assert controller.mu is not None
        alphas = _evenly(
            controller.alpha.min, controller.alpha.max, 1 if box.ki_low == box.ki_high == 0.0 else count[2]
        )
        mus = _evenly(controller.mu.min, controller.mu.max, 1 if box.kd_low == box.kd_high == 0.0 else count[3])
        if not fixed:
            taus = np.concatenate([[-1.0], np.linspace(-0.96, 0.96, count[0] - 2), [1.0]])
        return cls((taus, _evenly(box.shape_low, box.shape_high, count[1]), alphas, mus))

    @property
    def steps(self) -> Array:
        """Half a grid's distance; 0 of one."""
        # the ends of tau are set apart
        return np.array([0.5 * float(np.median(np.diff(axis))) if len(axis) > 1 else 0.0 for axis in self.axes])

    @property
    def ends(self) -> tuple[Array, Array]:
        """The smallest and the largest values."""
        return np.array([axis[0] for axis in self.axes]), np.array([axis[-1] for axis in self.axes])

    @property
    def padded(self) -> tuple[Array, NDArray[np.int64]]:
        """As one array of rows, and their sizes."""
        sizes = [len(axis) for axis in self.axes]
        rows = [np.concatenate([axis, np.zeros(max(sizes) - len(axis))]) for axis in self.axes]
        return np.array(rows), np.array(sizes, dtype=np.int64)


def _evenly(low: float, high: float, count: int) -> Array:
    return np.array([0.5 * (low + high)]) if count == 1 or low == high else np.linspace(low, high, count)


def _scan_with_orders(problem: Problem, most: int, coarse: float) -> Scan:
    """`scan_box` where integral and derivative have orders.

    Valleys in the orders are narrow and curved: a search from the best ray of each alpha along it, then one in all.
    """
    grids, table, rays = _Grids.of(problem, coarse), problem.scan_table, 0
    quadrants, (most_ratio, span) = quadrants_of(problem.box), reach_of(problem)
    work, (padded, sizes), (low, high) = work_for(table), grids.padded, grids.ends
    for relaxed in RELAXED:
        rows = problem.rows(table, relaxed)
        equal = equalities_of(problem, rows)
        if len(equal) > 1 and len(grids.axes[0]) > 1:
            pairs = _orders_with_two_equalities(problem, rows, equal, grids, most)
            rays += int(np.prod(sizes))
            if pairs:
                return Scan(pairs, relaxed, rays, 1.0)
            continue
        costs, kappas = scan_orders(
            problem.code, padded, sizes, quadrants, equal, most_ratio, span, table, rows, problem.box, work
        )  # fmt: skip
        rays += costs.size
        if (costs < NOTHING).any():
            break
    else:
        return Scan((), RELAXED[-1], rays, 0.0)

    def search(start: Array, z: int, steps: Array, budget: tuple[int, float]) -> Array:
        return pattern_search(
            problem.code, start, steps, low, high, quadrants[z], equal, most_ratio, span, budget[1], budget[0],
            table, rows, problem.box, work,
        )  # fmt: skip

    columns: list[tuple[float, float, int, Array]] = []
    # of a fixed alpha each mu stands for itself
    each, steps = (2, [1.0, 1.0, 0.0, 1.0]) if len(grids.axes[2]) > 1 else (3, [1.0, 1.0, 0.0, 0.0])
    for place in np.ndindex(costs.shape[:each]):
        z, a, m, i, j = (*place, *np.unravel_index(np.argmin(costs[place]), costs.shape[each:]))
        value, kappa = float(costs[z, a, m, i, j]), float(kappas[z, a, m, i, j])
        if value < NOTHING:
            y = np.array([grids.axes[0][j], grids.axes[1][i], grids.axes[2][a], grids.axes[3][m], value + 1e-15])
            found = search(y, int(z), grids.steps * np.array(steps), _ALONG)
            columns.append((float(found[4]), float(found[5]) or kappa, int(z), found))
    columns.sort(key=lambda column: column[0])
    offered: list[Basin] = []
    count = _OF_A_DEPTH if problem.code == DEPTH else _MOST_BASINS
    for _, kappa, z, y in columns[:count]:
        found = search(y[:5], z, grids.steps, _FROM_THERE)
        at = _gains_with_orders(problem, found, float(found[5]) or kappa, quadrants[z])
        _offer(problem, offered, Basin(float(found[4]), at))
    return Scan(tuple(sorted(offered, key=lambda basin: basin.cost)), relaxed, rays, float((costs < NOTHING).mean()))


def _gains_with_orders(problem: Problem, y: Array, kappa: float, signs: Array) -> Array:
    tau, shape, alpha, mu = (float(value) for value in y[:4])
    sampling = problem.scaled.sampling._replace(order=alpha, rise=mu)
    box = box_with_orders(mu, problem.box)
    third, c, s = ray_of(shape, tau, signs, *reach_of(problem), box, sampling)
    return problem.structure.times(math.exp(kappa), np.array([c, s, third, alpha, mu]))


def _orders_with_two_equalities(
    problem: Problem, rows: Rows, equal: NDArray[np.int64], grids: _Grids, most: int
) -> tuple[Basin, ...]:
    """`_with_two_equalities` for every pair of orders: the best of each order of the integral."""
    most_ratio, span = reach_of(problem)
    work, nominal_work = work_for(problem.scan_table), work_for(nominal_of(problem.scan_table))
    taus, shapes, alphas, mus = grids.axes
    found: list[Basin] = []
    for signs in quadrants_of(problem.box):
        for alpha in alphas:
            best: tuple[float, Array, float] | None = None
            for mu in mus:
                sampling = problem.scaled.sampling._replace(order=float(alpha), rise=float(mu))
                table, box = problem.scan_table._replace(sampling=sampling), box_with_orders(float(mu), problem.box)
                for shape in shapes:
                    value, kappa, tau = best_of_shape(
                        problem.code, float(shape), signs, taus, equal, most_ratio, span, table, rows, box, work,
                        nominal_of(table), nominal_work,
                    )  # fmt: skip
                    if value < NOTHING and (best is None or value < best[0]):
                        best = value, np.array([tau, shape, alpha, mu]), kappa
            if best is not None:
                value, y, kappa = best
                _offer(problem, found, Basin(value, _gains_with_orders(problem, y, kappa, signs)))
    return tuple(sorted(found, key=lambda basin: basin.cost)[: 2 * most])
