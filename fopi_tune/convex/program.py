"""The convex problems, compiled once and solved many times (CVXPY, parametrised; CLARABEL).

With the constraints of `cone_constraints`, a trust region and the gains' ranges, for a step d of x,

    step       minimise  gradient . d + weight t    subject to  every row, every equality ,
    restore    minimise  v                          subject to  every row and equality, violated by at most v .

t is the change of the objective's largest member.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from fopi_tune.convex.cone_constraints import ConeConstraints
from fopi_tune.core.bode_form import Array

#: the largest number of rows; the others have more slack
CAPACITY = 40
#: the rows with the smallest slack of every limit are always included
_OF_EACH = 4
#: slack of an unused row
_ROOM = 1.0
#: natural units; the largest decrease of t in one step
_LARGEST_DECREASE = 3.0
_SOLVER_OPTIONS: dict[str, Any] = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}


@dataclass(frozen=True)
class Step:
    """A solution.

    Args:
        d: the step of x, shape (2,).
        value: t of `step`, v of `restore`.
        multiplier_sum: of `step`, the sum of the absolute multipliers of all rows and equalities.
    """

    d: Array
    value: float
    multiplier_sum: float = 0.0


class Program:
    """Both problems, compiled for a number of equalities."""

    def __init__(self, equalities: int) -> None:
        import cvxpy as cp

        n = CAPACITY
        self.count, self.solves = equalities, 0
        self.d: Any = cp.Variable(2)
        self.t: Any = cp.Variable()
        self.v: Any = cp.Variable(nonneg=True)
        t, v = self.t, self.v
        self.cone_re, self.cone_im, self.slope = cp.Parameter((n, 2)), cp.Parameter((n, 2)), cp.Parameter((n, 2))
        self.cone0, self.slack0 = cp.Parameter((2, n)), cp.Parameter(n)
        self.share, self.elastic = cp.Parameter(n), cp.Parameter(n)
        self.low, self.high, self.gradient = cp.Parameter(2), cp.Parameter(2), cp.Parameter(2)
        self.weight = cp.Parameter(nonneg=True)
        left = cp.vstack([self.cone_re @ self.d, self.cone_im @ self.d]) + self.cone0
        right = self.slope @ self.d + self.slack0
        box = [self.d >= self.low, self.d <= self.high]
        exact, near = [], []
        if equalities:
            self.equal_slope, self.distance = cp.Parameter((equalities, 2)), cp.Parameter(equalities)
            off = self.equal_slope @ self.d - self.distance
            exact, near = [off == 0], [off <= v, off >= -v]
        self.exact: list[Any] = exact
        self.cones: Any = cp.SOC(right + self.share * t, left, axis=0)
        self.step_problem = cp.Problem(
            cp.Minimize(self.gradient @ self.d + self.weight * t),
            [self.cones, t >= -_LARGEST_DECREASE, t <= 10.0 * _LARGEST_DECREASE, *box, *exact],
        )
        self.restore_problem = cp.Problem(cp.Minimize(v), [cp.SOC(right + self.elastic * v, left, axis=0), *box, *near])

    def step(self, rows: ConeConstraints, low: Array, high: Array, gradient: Array, weight: float) -> Step | None:
        """The optimal step; None when the constraints are infeasible or the solver fails."""
        self._fill(rows, low, high)
        self.gradient.value, self.weight.value = gradient, weight
        if not self._solved(self.step_problem):
            return None
        multipliers = np.asarray(self.cones.dual_value[0], dtype=float) * np.asarray(self.elastic.value)
        total = multipliers.sum() + sum(np.abs(np.asarray(c.dual_value, dtype=float)).sum() for c in self.exact)
        return Step(np.asarray(self.d.value, dtype=float), float(self.t.value), float(total))

    def restore(self, rows: ConeConstraints, low: Array, high: Array) -> Step | None:
        """The step with the smallest violation; None when the solver fails."""
        hard = rows.take(np.flatnonzero(rows.elastic > 0.0))
        self._fill(hard, low, high)
        if not self._solved(self.restore_problem):
            return None
        return Step(np.asarray(self.d.value, dtype=float), float(self.v.value))

    def _solved(self, problem: Any) -> bool:
        import cvxpy as cp

        self.solves += 1
        with warnings.catch_warnings():
            # "may be inaccurate": the solution is evaluated exactly in any case
            warnings.simplefilter("ignore")
            try:
                problem.solve(solver=cp.CLARABEL, **_SOLVER_OPTIONS)
            except cp.SolverError:
                return False
        return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE) and bool(np.all(np.isfinite(self.d.value)))

    def _fill(self, rows: ConeConstraints, low: Array, high: Array) -> None:
        rows = rows.tightest(CAPACITY, _OF_EACH)
        n = len(rows.slack0)
        empty = CAPACITY - n
        cone = np.concatenate([rows.cone, np.zeros((empty, 2))])
        cone0 = np.concatenate([rows.cone0, np.zeros(empty)])
        self.cone_re.value, self.cone_im.value = cone.real, cone.imag
        self.cone0.value = np.stack([cone0.real, cone0.imag])
        self.slope.value = np.concatenate([rows.slope, np.zeros((empty, 2))])
        self.slack0.value = np.concatenate([rows.slack0, np.full(empty, _ROOM)])
        self.share.value = np.concatenate([rows.share, np.zeros(empty)])
        self.elastic.value = np.concatenate([rows.elastic, np.zeros(empty)])
        self.low.value, self.high.value = low, high
        if self.count:
            # an equality without a point (no crossing to evaluate it at) is left out
            slopes, distances = np.zeros((self.count, 2)), np.zeros(self.count)
            k = min(self.count, len(rows.distance))
            slopes[:k], distances[:k] = rows.equal_slope[:k], rows.distance[:k]
            self.equal_slope.value, self.distance.value = slopes, distances
