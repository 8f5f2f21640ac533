"""The convex problem of one step:  a Model and a Hessian -> the step, by Clarabel on the rows that matter.

    minimise    t/scale + penalty s + d' H d/2        over the step d, |d_j| <= radius size_j, within the box
    subject to  aims + slopes d <= t,   rows + slopes d <= s,   s >= 0,
                sum_k |error_k + slope_k d| of each plant  <= t, or <= s of a row.                                  (1)

Of thousands of rows few matter: those that the solution violates are added until none does.  A sum is the largest of
the linear functions that its signs make; the one at the solution is added alike (Kelley's cutting planes).

Source: the convex-composite step of Fletcher, Practical Methods of Optimization, 2nd ed., 1987, section 14; Kelley,
J. SIAM 8, 1960.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.design.time_domain.model import Model

#: rows that are added at a time, rounds of it
_ADDED, _ROUNDS = 6, 60
#: of what the step promises, and absolute: rows that are violated by less are met
_MET, _EXACT = 1e-3, 1e-11
_TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class Step:
    """The solution of (1).

    Args:
        d: the step in the n numbers of the controller, shape (n,).
        expected: of t/scale + penalty s.
        slack: s.
        slope: of the Lagrangian's aims, rows and sums, as `lagrangian_slope` takes them.
        prices: of the model's rows, shape (r,); of its aims, (k,); of its sums.
        signs: of each sum's errors in the Lagrangian, in [-1, 1].
    """

    d: Array
    expected: float
    slack: float
    row_prices: Array
    aim_prices: Array
    sum_prices: Array
    signs: tuple[Array, ...]


def lagrangian_slope(model: Model, step: Step, scale: float) -> Array:
    """Of aims, rows and sums with the multipliers of a step, shape (n,)."""
    total = step.aim_prices @ model.aim_slopes / scale + step.row_prices @ model.slopes
    for each, price, signs in zip(model.sums, step.sum_prices, step.signs, strict=True):
        total = total + price * each.weight / (scale if each.row < 0 else 1.0) * (signs @ each.slopes)
    return np.asarray(total)


@dataclass(frozen=True, eq=False)
class _Cut:
    """a d <= b + t/scale (of an aim) or + s:  `place` is in the model's aims, rows or sums; signs of a sum."""

    a: Array
    b: float
    of_aim: bool
    kind: str
    place: int
    signs: Array | None = None


def solve_step(
    model: Model, hessian: Array, sizes: Array, radius: float, room: tuple[Array, Array], scale: float, penalty: float
) -> Step | None:
    """The step of (1); None where the solver fails.

    Args:
        model: at the present gains.
        hessian: positive semidefinite, by d/sizes, shape (n, n).
        sizes: of the n numbers of the controller, in which the radius counts, shape (n,).
        radius: of the region.
        room: from the numbers to the lower and the upper ends of their ranges, shapes (n,).
        scale: of the objective.
        penalty: of s.
    """
    n, (low, high) = len(sizes), room
    region = np.clip(-low / sizes, 0.0, radius), np.clip(high / sizes, 0.0, radius)
    pieces = _Pieces(model, sizes, scale)
    cuts = pieces.cuts_at(np.zeros(n), -np.inf, -np.inf, 0.0)
    has_aim = len(model.aims) > 0 or any(each.row < 0 for each in model.sums)
    x = z = np.zeros(0)
    for _ in range(_ROUNDS):
        solved = _solve(cuts, hessian, region, penalty, has_aim)
        if solved is None:
            return None
        x, z = solved
        d, t, s = x[:n], float(x[n]), float(x[n + 1])
        promised = (model.objective / scale - t if has_aim else 0.0) + penalty * (model.violation - s)
        new = pieces.cuts_at(d, t if has_aim else np.inf, max(s, 0.0), _MET * max(promised, 0.0) + _EXACT)
        if not new:
            break
        cuts += new
    rows, aims, sums = np.zeros(len(model.values)), np.zeros(len(model.aims)), np.zeros(len(model.sums))
    signs = [np.sign(each.errors) for each in model.sums]
    mixed = [np.zeros(len(each.errors)) for each in model.sums]
    for cut, price in zip(cuts, z, strict=False):
        if cut.signs is not None:
            sums[cut.place] += price
            mixed[cut.place] += price * cut.signs
        elif cut.of_aim:
            aims[cut.place] += price
        else:
            rows[cut.place] += price
    signs = [m / p if p > 0.0 else s for m, p, s in zip(mixed, sums, signs, strict=True)]
    slack = float(max(x[n + 1], 0.0))
    expected = float(x[n] if has_aim else 0.0) + penalty * slack
    return Step(sizes * x[:n], expected, slack, rows, aims, sums, tuple(signs))


class _Pieces:
    """The linear pieces of a model in steps by their sizes."""

    def __init__(self, model: Model, sizes: Array, scale: float) -> None:
        self.model, self.scale = model, scale
        self.slopes, self.aim_slopes = model.slopes * sizes, model.aim_slopes * sizes / scale
        self.aims = model.aims / scale
        self.sums = [
            (each.weight / (scale if each.row < 0 else 1.0), each.offset / (scale if each.row < 0 else 1.0),
             each.slopes * sizes) for each in model.sums
        ]  # fmt: skip

    def cuts_at(self, d: Array, t: float, s: float, met: float) -> list[_Cut]:
        """Those that a step violates by more than `met`, the worst ones first."""
        cuts: list[_Cut] = []
        for kind, values, slopes, level in (
            ("row", self.model.values, self.slopes, s),
            ("aim", self.aims, self.aim_slopes, t),
        ):
            excess = values + slopes @ d - level
            for place in _largest(excess, met):
                cuts.append(_Cut(slopes[place], -float(values[place]), kind == "aim", kind, place))
        for place, (each, (factor, offset, slopes)) in enumerate(zip(self.model.sums, self.sums, strict=True)):
            errors = each.errors + slopes @ d
            if factor * np.abs(errors).sum() + offset - (t if each.row < 0 else s) > met:
                signs = np.sign(errors)
                value = factor * float(signs @ each.errors) + offset
                cuts.append(_Cut(factor * (signs @ slopes), -value, each.row < 0, "sum", place, signs))
        return cuts


def _largest(excess: Array, met: float) -> NDArray[np.int64]:
    over = np.flatnonzero(excess > met)
    if len(over) > _ADDED:
        over = over[np.argpartition(-excess[over], _ADDED)[:_ADDED]]
    return over


def _solve(
    cuts: list[_Cut], hessian: Array, region: tuple[Array, Array], penalty: float, has_aim: bool
) -> tuple[Array, Array] | None:
    """(d/sizes, t, s) and the multipliers of the cuts."""
    import clarabel as clarabel_module
    from scipy import sparse

    # its compiled module has no type hints
    clarabel: Any = clarabel_module

    # d, then t and s
    n, count = len(hessian), len(cuts)
    rows = np.zeros((count + 2 * n + 1, n + 2))
    rhs = np.empty(len(rows))
    for k, cut in enumerate(cuts):
        rows[k, :n], rhs[k] = cut.a, cut.b
        rows[k, n if cut.of_aim else n + 1] = -1.0
    rows[count : count + 2 * n, :n] = np.vstack([-np.eye(n), np.eye(n)])
    rhs[count : count + 2 * n] = np.concatenate(region)
    rows[-1, n + 1], rhs[-1] = -1.0, 0.0
    quadratic = np.zeros((n + 2, n + 2))
    linear = np.append(np.zeros(n), [1.0 if has_aim else 0.0, penalty])
    quadratic[:n, :n] = np.triu(hessian)
    if not has_aim:
        # nothing bounds t
        quadratic[n, n] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    cones = [clarabel.NonnegativeConeT(len(rows))]
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic), linear, sparse.csc_matrix(rows), rhs, cones, settings
    ).solve()
    x, z = np.array(found.x), np.array(found.z)
    return (x, z[:count]) if np.isfinite(x).all() and np.isfinite(z).all() else None
