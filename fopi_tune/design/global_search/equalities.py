"""The kappa of a ray at which an equality of the nominal plant holds, to the accuracy of a table (compiled)."""

from __future__ import annotations

import math

from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CS,
    DELAY_MARGIN,
    GAIN_MARGIN,
    LOOP_GAIN,
    PHASE_MARGIN,
    compiled,
)
from fopi_tune.design.global_search.intervals import band_interval, excess, slope_at
from fopi_tune.design.global_search.values import measured

#: natural units; a value this far from the equality's limit is another crossing's
_NEAR = 0.1


@compiled
def _keep(q, kappa, count, table, rows, work, out):
    if count < len(out) and abs(measured(q, kappa, 0, table, rows, work) - rows.limit[q]) * rows.scale[q] < _NEAR:
        out[count] = kappa
        return count + 1
    return count


@compiled
def _keep_roots(kind, limit, j, count, table, work, out):
    """The one or two k with |S|, |T| or |C S| = e^limit at a frequency."""
    low, high = band_interval(kind, limit, 0, j, table, work)
    for k in (low, high):
        if 0.0 < k < math.inf and low < high and count < len(out):
            out[count] = math.log(k)
            count += 1
    return count


@compiled
def equality_gains(q, table, rows, work, out):
    """The kappa with (limit = value) in row q for the nominal plant, on the ray in the scratch arrays; their number."""
    kind, limit, n, count = rows.kind[q], rows.limit[q], work.gain.shape[1], 0
    if kind == CROSSOVER:
        return _keep(q, -work.gain[0, rows.first[q]] - 1e-9, 0, table, rows, work, out)
    if kind == LOOP_GAIN:
        out[0] = limit - work.gain[0, rows.first[q]]
        return 1
    if kind <= CS:
        return _keep_roots(kind, limit, rows.first[q], 0, table, work, out)
    if kind == GAIN_MARGIN:
        for r in range(work.cross_count[0]):
            count = _keep(q, -limit - work.cross_gain[0, r], count, table, rows, work, out)
        return count
    last = 0.0
    for j in range(1, n - 1):
        if kind == PHASE_MARGIN or kind == DELAY_MARGIN:
            value = excess(kind, limit, 0, j, table, work)
        else:
            value = limit - slope_at(0, j, table, work)
        if j > 1 and (value < 0.0) != (last < 0.0) and abs(value - last) < 3.0:
            part = last / (last - value)
            g = work.gain[0, j - 1] + part * (work.gain[0, j] - work.gain[0, j - 1])
            count = _keep(q, -g, count, table, rows, work, out)
        last = value
    return count
