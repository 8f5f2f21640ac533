"""Linear rows of a cell at one kappa:  what loops that meet the requirements satisfy to second order (compiled).

With z = (kappa, shape, psi) around the centre of a box, epsilon = dkappa + f_shape dshape + f_psi dpsi + rest is how
much ln L changes, |epsilon| <= E.  With X = L (for |S|, and |P S| with M/|P|) or 1/L (for |T|, and |C S| with M |P|),
sigma = +1 or -1,

    ln|1 + X| <= ln|1 + X0| + sigma Re(s epsilon) + B E^2/2 ,   s = X0/(1 + X0) ,
    B = |X0| e^E/(|1 + X0| - |X0| (e^E - 1))^2 ,                                                                    (1)

so that |.| <= M, that is ln|1 + X| >= -ln M, becomes a linear row with an error of second order in the box's size.
Rows are scaled to the box's half-widths, as `polygon` needs them.

Source: derived; ln(1 + e^u) has the second derivative s (1 - s).
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.columns import (
    DOWN,
    GROWN,
    PSI_IMAG,
    PSI_REAL,
    REST,
    SHAPE_IMAG,
    SHAPE_REAL,
    SPREAD,
    UP,
)
from fopi_tune.design.bound.polygon import add_limit
from fopi_tune.design.global_search.compiled import CROSSOVER, CS, LOOP_GAIN, PS, T, compiled

#: an E, and e^E, beyond which (1) is not worth its time
_MOST_CHANGE, _MOST_GROWTH = 1.0, 2.8


@compiled
def _gain_row(way, limit, g, j, half, slopes, lin, count):
    """ln|L| at most (way 1) or at least (-1) a limit at a column where it is g at the centre."""
    if not slopes[SPREAD, j] < _MOST_CHANGE:
        return count
    a1, a2 = slopes[SHAPE_REAL, j] * half[1], slopes[PSI_REAL, j] * half[2]
    return add_limit(lin, count, way, g, half[0], a1, a2, limit, slopes[REST, j])


@compiled
def _band_row(sigma, side, bound, size, real, imag, grown, j, half, slopes, lin, count):
    """(1) at a column, both ways for an equality.

    Args:
        sigma: 1 for X = L, -1 for X = 1/L.
        side: of the limit.
        bound: that |1 + X| is compared with.
        size, real, imag: of X0.
        grown: e^E.
        j, half, slopes: the column, the half-widths, the cell's slopes.
        lin, count: the rows.
    """
    square = 1.0 + 2.0 * real + size * size
    # |1 + X| changes by no more than this
    change = size * (grown - 1.0)
    if side > 0 and square > (bound + change) * (bound + change):
        return count
    far = math.sqrt(max(square, 1e-200))
    least = far - change
    if least <= 0.0:
        return count
    reach = half[0] + slopes[SPREAD, j]
    rest = size / far * slopes[REST, j] + 0.5 * size * grown / (least * least) * reach * reach
    a, b = sigma * (real + size * size) / square, sigma * imag / square
    a1 = (a * slopes[SHAPE_REAL, j] - b * slopes[SHAPE_IMAG, j]) * half[1]
    a2 = (a * slopes[PSI_REAL, j] - b * slopes[PSI_IMAG, j]) * half[2]
    value, limit = math.log(far), math.log(bound)
    for way in (1.0, -1.0):
        # an upper limit of the quantity is a lower one of ln|1 + X|
        if way * side <= 0:
            count = add_limit(lin, count, way, value, a * half[0], a1, a2, limit, rest)
    return count


@compiled
def _excess_beyond(kappa, first, i, half, work, slopes):
    """By how much ln|L| of a loop at a later column can exceed that at the first one, where it can exceed 0."""
    most = 0.0
    for j in range(first + 1, work.gain.shape[1] - 1):
        if work.gain[i, j] + kappa + half[0] + slopes[UP, j] >= 0.0:
            change = abs(slopes[SHAPE_REAL, j] - slopes[SHAPE_REAL, first]) * half[1]
            change += abs(slopes[PSI_REAL, j] - slopes[PSI_REAL, first]) * half[2]
            change += slopes[REST, j] + slopes[REST, first]
            most = max(most, work.gain[i, j] - work.gain[i, first] + change)
    return most


@compiled
def band_rows(kappa, half, table, rows, work, slopes, lin, count):
    """Rows of all bands, and of the crossover's limits."""
    n, k, wide = work.gain.shape[1], math.exp(kappa), math.exp(half[0])
    for i in range(work.gain.shape[0]):
        for q in range(len(rows.kind)):
            kind, side, limit = rows.kind[q], rows.side[q], rows.limit[q]
            if i > 0 and (rows.nominal[q] or side == 0):
                continue
            first, last = max(rows.first[q], 1), min(rows.last[q], n - 2)
            upper, lower = side >= 0, side <= 0
            if kind < LOOP_GAIN:
                inverse = math.exp(-limit)
                for j in range(first, last + 1):
                    grown = wide * slopes[GROWN, j]
                    if count < 0 or not grown < _MOST_GROWTH:
                        continue
                    size, real = k * work.square[i, j], k * work.real[i, j]
                    imag = k * (work.controller[1, j] * table.imag[i, j] + work.controller[2, j] * table.real[i, j])
                    bound, sigma = inverse, 1.0
                    if rows.tilt[q] != 0.0:
                        bound *= math.exp(-rows.tilt[q] * table.log_omega[j])
                    if kind in (T, CS):
                        part = 1.0 / (size * size)
                        size, real, imag, sigma = 1.0 / size, real * part, -imag * part, -1.0
                    if kind == CS:
                        bound *= math.exp(table.filter_gain[j] - table.gain[i, j])
                    elif kind == PS:
                        bound *= math.exp(table.plant_gain[i, j])
                    count = _band_row(sigma, side, bound, size, real, imag, grown, j, half, slopes, lin, count)
                continue
            if kind == CROSSOVER:
                # |L| < 1 beyond an upper limit; above a lower one it exceeds 1 somewhere
                limit, last = 0.0, n - 2
                if side < 0:
                    more = _excess_beyond(kappa, first, i, half, work, slopes)
                    lower, limit = more < np.inf, -more
            elif kind != LOOP_GAIN:
                continue
            for j in range(first, last + 1):
                g = work.gain[i, j] + kappa - rows.tilt[q] * table.log_omega[j]
                if upper and count >= 0 and g + half[0] + slopes[UP, j] > limit:
                    count = _gain_row(1.0, limit, g, j, half, slopes, lin, count)
                here = lower and count >= 0 and (kind == LOOP_GAIN or j == first)
                if here and g - half[0] + slopes[DOWN, j] < limit:
                    count = _gain_row(-1.0, limit, g, j, half, slopes, lin, count)
            if count < 0:
                return count
    return count
