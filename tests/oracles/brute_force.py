"""A reference optimiser:  spec -> best gains, by scanning the closed form and refining with small linear programs.

With crossover omega_c, phase margin phi and alpha given for the nominal plant P, the gains are closed form (PAPER.md,
section 3):  X = e^{j(phi - pi)}/P(j omega_c),
ki = -Im X omega_c^alpha / sin(alpha pi/2),  kp = Re X - ki omega_c^-alpha cos(alpha pi/2).
So (ln omega_c, phi, alpha) parametrise every controller whose nominal loop has a crossover, and the spec's nominal
equalities and a fixed alpha just remove unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from oracles.brute_loops import Evaluation, Gains, Loops
from scipy.optimize import linprog

from fopi_tune.spec.model import DesignSpec, Relation

#: natural units; a reference point may miss a requirement by no more than this
FEASIBLE = 1e-7


@dataclass(frozen=True)
class Best:
    """The best point found: infeasible when `violation` (natural units, the smallest found) exceeds FEASIBLE."""

    gains: Gains
    objective: float
    violation: float

    @property
    def feasible(self) -> bool:
        return self.violation <= FEASIBLE


class Chart:
    """(ln omega_c, phi, alpha), some of them fixed by the spec -> gains."""

    def __init__(self, spec: DesignSpec, loops: Loops):
        self.loops = loops
        roots = np.abs(np.concatenate([loops.poles[0], loops.zeros[0]]))
        own = np.concatenate([roots, 1 / loops.delay[loops.delay > 0]])
        bounds: dict[str, tuple[float, float]] = {}
        for r in spec.requirements:
            if r.quantity in ("crossover_rad_s", "phase_margin_deg"):
                low, high = bounds.get(r.quantity, (0.0, np.inf))
                bounds[r.quantity] = max(low, r.lower), min(high, r.upper)
            own = np.append(own, [w for w in (r.from_rad_s, r.to_rad_s) if 0 < w < np.inf])
        own = own[own > 0] if np.any(own > 0) else np.array([1.0])
        low, high = bounds.get("crossover_rad_s", (0.0, np.inf))
        alpha = spec.controller.alpha
        self.low = np.array([np.log(low or min(own.min(), high) / 300), 0.02, alpha.min])
        self.high = np.array([np.log(high if np.isfinite(high) else max(own.max(), low) * 300), 3.12, alpha.max])
        for k, name in enumerate(("crossover_rad_s", "phase_margin_deg")):
            exact = [r.limits[0] for r in spec.requirements if r.quantity == name and r.relation is Relation.EQUALS]
            if exact:
                self.low[k] = self.high[k] = np.radians(exact[0]) if k else np.log(exact[0])
        self.free = np.flatnonzero(self.low < self.high)

    def gains(self, x) -> Gains:
        at = self.low.copy()
        at[self.free] = x
        omega, phi, alpha = np.exp(at[0]), at[1], at[2]
        s = 1j * omega
        p = self.loops._plant(np.array([0]), s)[0] * np.exp(-s * self.loops.delay[0])
        x = np.exp(1j * (phi - np.pi)) / p
        ki = -x.imag * omega**alpha / np.sin(alpha * np.pi / 2)
        return Gains(float(x.real - ki * omega**-alpha * np.cos(alpha * np.pi / 2)), float(ki), float(alpha))


def brute_force(spec: DesignSpec, scan: int = 3000, per_axis: int | None = None) -> Best:
    """The best feasible gains, or those that violate least.

    Local optima differ most in alpha, so where alpha is free the best gains are first found for each alpha of a grid,
    every alpha starting from its own scan and from its neighbours' answers.

    Args:
        spec: the problem.
        scan: points of the scan.
        per_axis: members along each axis of the family's box.
    """
    loops = Loops(spec, per_axis)
    chart = Chart(spec, loops)
    if not len(chart.free):
        e = loops.evaluate(chart.gains([]))
        return Best(chart.gains([]), float(e.objective.max()), e.violation)
    corners = Loops(spec, per_axis=2, density=30)
    begins = _scan(spec, chart, scan)
    if len(chart.free) > 1:
        begins = _profile(corners, chart, begins)
    rough = sorted((_refined(corners, chart, x, 1e-4) for x in begins), key=lambda pair: _rank(pair[1]))
    return min((_refined(loops, chart, x, 1e-8)[1] for x, _ in rough[:2]), key=_rank)


def _rank(best: Best) -> tuple[float, float]:
    return max(best.violation, FEASIBLE), best.objective


def _scan(spec: DesignSpec, chart: Chart, scan: int) -> list[np.ndarray]:
    """The two most promising points of a dense grid at every alpha, judged on corner plants and coarse frequencies."""
    coarse = Loops(spec, per_axis=2, density=24, exact=False)
    n = len(chart.free)
    side = round(scan ** (1 / n)) if n > 1 else 400
    axes = [np.linspace(chart.low[k], chart.high[k], side) for k in chart.free]
    points = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    found = [coarse.evaluate(chart.gains(x)) for x in points]
    violation = np.array([e.violation for e in found])
    objective = np.array([e.objective.max() for e in found])
    # A point a cell's width short of feasible may lead to the best one.
    rankings = [np.lexsort((objective, np.maximum(violation, t))) for t in (1e-6, np.quantile(violation, 0.01) + 0.05)]
    if n == 1 or chart.free[-1] != 2:
        return [points[i] for i in dict.fromkeys(i for ranking in rankings for i in ranking[: 4 * n : n])]
    groups = [[r[points[r, -1] == alpha][0] for r in rankings] for alpha in axes[-1]]
    return [points[i] for group in groups for i in dict.fromkeys(group)]


def _profile(loops: Loops, chart: Chart, begins: list[np.ndarray]) -> list[np.ndarray]:
    """Of the best points at each alpha, up and down the grid of alphas, the best few."""
    if chart.free[-1] != 2:
        return begins
    best: dict[float, tuple[np.ndarray, Best]] = {}
    alphas = sorted({float(x[-1]) for x in begins})
    for sweep in (alphas, alphas[::-1]):
        neighbour: list[np.ndarray] = []
        for alpha in sweep:
            starts = neighbour + ([x for x in begins if x[-1] == alpha] if sweep is alphas else [])
            tries = [_refined(loops, chart, np.append(x[:-1], alpha), 1e-3, hold_alpha=True) for x in starts]
            tries += [best[alpha]] if alpha in best else []
            best[alpha] = min(tries, key=lambda pair: _rank(pair[1]))
            neighbour = [best[alpha][0]]
    ranked = sorted(alphas, key=lambda a: _rank(best[a][1]))
    gap = 1.5 * (alphas[-1] - alphas[0]) / len(alphas)
    chosen: list[float] = []
    for alpha in ranked:
        if all(abs(alpha - other) > gap for other in chosen) and len(chosen) < 4:
            chosen.append(alpha)
    return [best[alpha][0] for alpha in chosen]


def _merit(e: Evaluation, weight: float) -> float:
    return float(e.objective.max()) + weight * e.violation


def _refined(loops: Loops, chart: Chart, x, finest: float, hold_alpha: bool = False) -> tuple[np.ndarray, Best]:
    """Sequential linear programs with a trust region on  max objective + weight * max violation."""
    low, high = chart.low[chart.free], chart.high[chart.free]
    span = high - low
    if hold_alpha:
        low, high = np.append(low[:-1], x[-1]), np.append(high[:-1], x[-1])
    e = loops.evaluate(chart.gains(x))
    weight = 30.0 * (np.ptp(e.objective) + abs(e.objective.max()) + 1e-12)
    radius, slopes = 0.1, None
    for _ in range(150):
        if radius < finest:
            break
        if slopes is None:
            slopes = _slopes(loops, chart, x, span * (high > low), len(_rows(e)))
        bounds = np.clip((low - x) / span, -radius, 0.0), np.clip((high - x) / span, 0.0, radius)
        improved = None
        step, rows = _step(e, _rows(e), slopes, weight, bounds), _rows(e)
        for _ in range(3):  # the first try, then corrections for the curvature it met
            trial = np.clip(x + step * span, low, high)
            there = loops.evaluate(chart.gains(trial))
            if _merit(there, weight) < _merit(e, weight) - 1e-13 * abs(_merit(e, weight)):
                improved = trial, there
                break
            if len(_rows(there)) != len(rows):
                break
            step = _step(e, _rows(there) - slopes @ step, slopes, weight, bounds)
        if improved is None:
            radius *= 0.3
        else:
            (x, e), slopes, radius = improved, None, min(0.3, radius * 2)
    return x, Best(chart.gains(x), float(e.objective.max()), e.violation)


def _slopes(loops: Loops, chart: Chart, x, span, n: int) -> np.ndarray:
    """Central differences of every row along every free coordinate, in spans."""
    slopes = np.zeros((n, len(x)))
    h = 1e-5
    for k in np.flatnonzero(span):
        d = np.zeros(len(x))
        d[k] = h * span[k]
        up, down = (_rows(loops.evaluate(chart.gains(x + sign * d))) for sign in (1, -1))
        if len(up) == len(down) == n:
            slopes[:, k] = (up - down) / (2 * h)
    return slopes


def _step(e: Evaluation, rows, slopes, weight, bounds) -> np.ndarray:
    """d minimising the linearised merit:  t + weight v,  f + F d <= t,  g + G d <= v,  |d| <= radius."""
    n_f, size = len(e.objective), max(1e-12, float(np.abs(e.objective).max()))
    is_f = np.arange(len(rows)) < n_f
    scale = np.where(is_f, size, 1.0)
    table = np.column_stack([slopes / scale[:, None], -1.0 * is_f, -1.0 * ~is_f])
    near = is_f & (rows > rows[:n_f].max() - 0.5 * size) | ~is_f & (rows > -0.5)  # others cannot become active
    keep = near & np.isfinite(table).all(axis=1) & np.isfinite(rows)
    cost = [0.0] * slopes.shape[1] + [1.0, weight / size]
    limits = [*zip(*bounds, strict=True), (None, None), (0, None)]
    found = linprog(cost, A_ub=table[keep], b_ub=-(rows / scale)[keep], bounds=limits, method="highs")
    return found.x[:-2] if found.status == 0 else np.zeros(slopes.shape[1])


def _rows(e: Evaluation) -> np.ndarray:
    return np.concatenate([e.objective, e.excess, e.equalities, -e.equalities])


def _best(loops: Loops, candidates: list[Gains]) -> Best:
    found = [(g, loops.evaluate(g)) for g in candidates]
    g, e = min(found, key=lambda pair: (pair[1].violation, pair[1].objective.max()))
    return Best(g, float(e.objective.max()), e.violation)
