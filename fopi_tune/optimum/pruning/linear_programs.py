"""Weights of sums of linear bounds, for many boxes at once, in floating point.

For every box the largest value over weights w >= 0, sum w = 1, of

    sum_r w_r c_r  -  sum_i |sum_r w_r g_ri|  ,                                                                    (1)

by the simplex method:  |.| is the least p + n with  sum_r w_r g_ri = p - n ,  p, n >= 0 .  Results are suggestions,
each of which is tested in ball arithmetic.

Source: Dantzig's rule; the bases are k + 1 of the weights, p and n, and begin at a single row.
"""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array, Rows

#: steps, and the least pivot and reduced cost
_MOST_STEPS, _PIVOT, _OPTIMAL = 40, 1e-8, 1e-10


def best_weights(middle: Array, slopes: Array) -> tuple[Array, Array]:
    """Maximise (1) for n boxes with m rows and k coordinates.

    Args:
        middle: c, shape (n, m); -1e9 or less counts as no row.
        slopes: g, shape (n, m, k).

    Returns:
        The values, shape (n,), and the weights, shape (n, m), of which at most k + 1 are above 0.
    """
    n, m, k = slopes.shape
    every: Rows = np.arange(n)
    unit = np.broadcast_to(np.eye(k), (n, k, k))
    # columns: rows' weights, p, n; the last equation is the sum of the weights
    columns = np.zeros((n, m + 2 * k, k + 1))
    columns[:, :m, :k], columns[:, :m, k] = slopes, 1.0
    columns[:, m : m + k, :k], columns[:, m + k :, :k] = -unit, unit
    worth = np.concatenate([middle, np.full((n, 2 * k), -1.0)], axis=1)
    first = np.argmax(middle - np.abs(slopes).sum(axis=2), axis=1)
    lead = slopes[every, first]
    basis: Rows = np.concatenate(
        [np.where(lead >= 0.0, m + np.arange(k), m + k + np.arange(k)), first[:, None]], axis=1
    )
    values = np.concatenate([np.abs(lead), np.ones((n, 1))], axis=1)
    going: Rows = every
    for _ in range(_MOST_STEPS):
        own = columns[going[:, None], basis[going]]
        duals = np.linalg.solve(own, np.take_along_axis(worth[going], basis[going], axis=1)[:, :, None])[:, :, 0]
        gains = worth[going] - np.einsum("nmk,nk->nm", columns[going], duals)
        entering = np.argmax(gains, axis=1)
        more = gains[np.arange(len(going)), entering] > _OPTIMAL
        going, own, entering = going[more], own[more], entering[more]
        if not len(going):
            break
        turned = np.linalg.solve(own.transpose(0, 2, 1), columns[going, entering][:, :, None])[:, :, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(turned > _PIVOT, np.maximum(values[going], 0.0) / turned, np.inf)
        leaving = np.argmin(ratio, axis=1)
        rows = np.arange(len(going))
        step = ratio[rows, leaving]
        bounded = np.isfinite(step)
        going, leaving, entering = going[bounded], leaving[bounded], entering[bounded]
        step, turned = step[bounded], turned[bounded]
        values[going] -= step[:, None] * turned
        values[going, leaving] = step
        basis[going, leaving] = entering
    weights = np.zeros((n, m + 2 * k))
    np.put_along_axis(weights, basis, np.maximum(values, 0.0), axis=1)
    weights = weights[:, :m]
    sums = np.abs(np.einsum("nm,nmk->nk", weights, slopes)).sum(axis=1)
    return np.einsum("nm,nm->n", weights, np.maximum(middle, -1e9)) - sums, weights
