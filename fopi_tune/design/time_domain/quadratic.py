"""The convex problem of one step:  a Model and a Hessian -> the step, by Clarabel.

    minimise    t/scale + penalty s + d' H d/2        over the step d, |d_j| <= radius size_j, within the box
    subject to  aims + slopes d <= t,   rows + slopes d <= s,   s >= 0,
                sum_k |error_k + slope_k d| of each plant  <= t, or <= s of a row.                                  (1)

Of a sum, only the errors that may change their sign within the radius get an epigraph variable of their own; the others
are linear.

Source: the convex-composite step of Fletcher, Practical Methods of Optimization, 2nd ed., 1987, section 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.design.time_domain.model import Model, Sum

#: rows, and errors with a variable of their own, that a step takes
_MOST_ROWS, _MOST_SIGNS = 400, 600
_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class Step:
    """The solution of (1).

    Args:
        d: the step in kp, ki and alpha, shape (3,).
        expected: of t/scale + penalty s.
        slack: s.
        rows: places of the model's rows that were in the problem, and their multipliers.
        row_prices: shape (len(rows),).
        aim_prices: of the aims, shape (k,).
        sum_prices: of the sums, shape (len(model.sums),).
        signs: of each sum's errors in the Lagrangian, in [-1, 1].
    """

    d: Array
    expected: float
    slack: float
    rows: NDArray[np.int64]
    row_prices: Array
    aim_prices: Array
    sum_prices: Array
    signs: tuple[Array, ...]


def solve_step(
    model: Model, hessian: Array, sizes: Array, radius: float, low: Array, high: Array, scale: float, penalty: float
) -> Step | None:
    """The step of (1); None where the solver fails.

    Args:
        model: at the present gains.
        hessian: positive semidefinite, by d/sizes, shape (3, 3).
        sizes: of kp, ki and alpha, in which the radius counts, shape (3,).
        radius: of the region.
        low, high: ends of the gains' ranges, shape (3,).
        scale: of the objective.
        penalty: of s.
    """
    import clarabel
    from scipy import sparse

    slopes, aim_slopes = model.slopes * sizes, model.aim_slopes * sizes
    reach = model.values + radius * np.abs(slopes).sum(axis=1)
    kept = np.flatnonzero(reach > 0.0)
    if len(kept) > _MOST_ROWS:
        kept = kept[np.argsort(-reach[kept], kind="stable")[:_MOST_ROWS]]
    aim_reach = model.aims + radius * np.abs(aim_slopes).sum(axis=1)
    least = float((model.aims - radius * np.abs(aim_slopes).sum(axis=1)).max(initial=-np.inf))
    aims = np.flatnonzero(aim_reach >= least)
    if len(aims) > _MOST_ROWS:
        aims = aims[np.argsort(-aim_reach[aims], kind="stable")[:_MOST_ROWS]]
    loose = [_may_change_sign(each, sizes, radius) for each in model.sums]
    count = 5 + sum(map(len, loose))
    blocks: list[tuple[Array, Array]] = []

    # columns: d/sizes (3), t, s, then |error| of the loose errors
    top = np.zeros((len(aims), count))
    top[:, :3], top[:, 3] = aim_slopes[aims] / scale, -1.0
    blocks.append((top, -model.aims[aims] / scale))
    bottom = np.zeros((len(kept), count))
    bottom[:, :3], bottom[:, 4] = slopes[kept], -1.0
    blocks.append((bottom, -model.values[kept]))
    place = 5
    for each, free in zip(model.sums, loose, strict=True):
        factor = each.weight / (scale if each.row < 0 else 1.0)
        rest = np.ones(len(each.errors), dtype=bool)
        rest[free] = False
        signs = np.sign(each.errors[rest])
        row = np.zeros((1, count))
        row[0, :3] = factor * (signs @ (each.slopes[rest] * sizes))
        row[0, place : place + len(free)] = factor
        row[0, 3 if each.row < 0 else 4] = -1.0
        offset = each.offset / (scale if each.row < 0 else 1.0)
        blocks.append((row, np.array([-offset - factor * np.abs(each.errors[rest]).sum()])))
        place += len(free)
    dense = np.concatenate([block for block, _ in blocks])
    bounds = np.concatenate([bound for _, bound in blocks])
    parts, rhs, place = [sparse.csr_matrix(dense)], [bounds], 5
    for each, free in zip(model.sums, loose, strict=True):
        if len(free):
            part = sparse.csr_matrix(each.slopes[free] * sizes)
            own = sparse.csr_matrix((np.ones(len(free)), (range(len(free)), range(place, place + len(free)))),
                                    shape=(len(free), count))  # fmt: skip
            wide = sparse.hstack([part, sparse.csr_matrix((len(free), count - 3))])
            parts += [wide - own, -wide - own]
            rhs += [-each.errors[free], each.errors[free]]
            place += len(free)
    gains = np.array([model.gains.kp, model.gains.ki, model.gains.alpha])
    unit = sparse.identity(count, format="csr")
    parts += [unit[:3], -unit[:3], -unit[4:5]]
    rhs += [np.minimum(radius, (high - gains) / sizes), np.minimum(radius, (gains - low) / sizes), np.zeros(1)]
    quadratic = sparse.lil_matrix((count, count))
    quadratic[:3, :3] = np.triu(hessian)
    linear = np.zeros(count)
    linear[3], linear[4] = 1.0 if len(aims) or any(each.row < 0 for each in model.sums) else 0.0, penalty
    if linear[3] == 0.0:
        # nothing bounds t
        quadratic[3, 3] = 1.0
    every, all_bounds = sparse.csc_matrix(sparse.vstack(parts)), np.concatenate(rhs)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    cones = [clarabel.NonnegativeConeT(len(all_bounds))]
    found = clarabel.DefaultSolver(sparse.csc_matrix(quadratic), linear, every, all_bounds, cones, settings).solve()
    x, z = np.array(found.x), np.array(found.z)
    if not (np.isfinite(x).all() and np.isfinite(z).all()):
        return None
    a, b, c = len(aims), len(aims) + len(kept), len(aims) + len(kept) + len(model.sums)
    aim_prices = np.zeros(len(model.aims))
    aim_prices[aims] = z[:a]
    sum_prices, place, signs = z[b:c], c, []
    for each, free, price in zip(model.sums, loose, sum_prices, strict=True):
        sign, factor = np.sign(each.errors), each.weight / (scale if each.row < 0 else 1.0)
        n = len(free)
        sign[free] = (z[place : place + n] - z[place + n : place + 2 * n]) / max(price * factor, 1e-300)
        signs.append(np.clip(sign, -1.0, 1.0))
        place += 2 * n
    expected = float(x[3] + penalty * max(x[4], 0.0)) if linear[3] else float(penalty * max(x[4], 0.0))
    return Step(sizes * x[:3], expected, float(max(x[4], 0.0)), kept, z[a:b], aim_prices, sum_prices, tuple(signs))


def _may_change_sign(each: Sum, sizes: Array, radius: float) -> NDArray[np.int64]:
    """Places of the errors that may change their sign within the radius."""
    reach = radius * np.abs(each.slopes * sizes).sum(axis=1)
    free = np.flatnonzero(np.abs(each.errors) < reach)
    if len(free) > _MOST_SIGNS:
        free = np.sort(free[np.argsort(-reach[free], kind="stable")[:_MOST_SIGNS]])
    return free
