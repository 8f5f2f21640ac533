"""Branch and bound on cells of (shape, psi), the gain eliminated (compiled).

The discs leave intervals of kappa = ln k of a cell.  On each of them the linear rows are asked what they leave; a cell
that is left shrinks to that, and is cut in two unless it became much smaller.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.columns import (
    KAPPA,
    PSI_HIGH,
    PSI_IMAG,
    PSI_LOW,
    PSI_REAL,
    QUADRANT,
    SHAPE_HIGH,
    SHAPE_IMAG,
    SHAPE_LOW,
    SHAPE_REAL,
    SLOPES,
    SPREAD,
)
from fopi_tune.design.bound.crossings import crossing_rows
from fopi_tune.design.bound.discs import kappa_left
from fopi_tune.design.bound.gain_ranges import box_rows, order_over
from fopi_tune.design.bound.integrals import filters_over
from fopi_tune.design.bound.polygon import what_is_left
from fopi_tune.design.bound.tangents import band_rows
from fopi_tune.design.global_search.compiled import compiled, entry
from fopi_tune.design.global_search.responses import copy_into

_PI = math.pi
#: neper; a cell whose loops change by more near |L| = 1 is not linearised
_LARGEST_SPREAD = 0.6
#: neper; intervals of kappa are looked at in pieces at least this long, and at most so many of them
_PIECE, _MOST_PIECES = 0.1, 10
#: a cell that shrinks to less than this part is looked at again before it is cut
_MUCH_SMALLER = 0.3
#: of the directions' tangent: wider cells are cut at their geometric mean
_WIDE = 8.0
_MOST_ROWS = 48
#: columns with |ln|L|| below this count as near |L| = 1
_NEAR = 1.5


@compiled
def _spreads_near_crossover(kappa, cell, work, slopes):
    """(how much ln L changes over the cell near |L| = 1, the parts of shape and psi in it)."""
    least, by_shape, by_psi = np.inf, 0.0, 0.0
    for j in range(1, work.gain.shape[1] - 1):
        if abs(work.gain[0, j] + kappa) < _NEAR:
            least = min(least, slopes[SPREAD, j])
            by_shape = max(by_shape, slopes[SHAPE_REAL, j] ** 2 + slopes[SHAPE_IMAG, j] ** 2)
            by_psi = max(by_psi, slopes[PSI_REAL, j] ** 2 + slopes[PSI_IMAG, j] ** 2)
    if by_shape + by_psi == 0.0:
        by_shape, by_psi = 2.0, 1.0
    half_shape, half_psi = cell[SHAPE_HIGH] - cell[SHAPE_LOW], cell[PSI_HIGH] - cell[PSI_LOW]
    return least, math.sqrt(by_shape) * half_shape, math.sqrt(by_psi) * half_psi


@compiled
def _linearised(code, target, pieces, found, cell, signs, table, filters, rows, box, work, slopes, lin, left):
    """Whether the linear rows leave anything of the cell; `left` is then where, in units of its half-widths."""
    shape, psi = 0.5 * (cell[SHAPE_LOW] + cell[SHAPE_HIGH]), 0.5 * (cell[PSI_LOW] + cell[PSI_HIGH])
    half, whole, x = np.empty(3), np.empty(4), np.empty(3)
    half[1], half[2] = 0.5 * (cell[SHAPE_HIGH] - cell[SHAPE_LOW]), 0.5 * (cell[PSI_HIGH] - cell[PSI_LOW])
    whole[0] = whole[2] = 1.0
    whole[1] = whole[3] = -1.0
    c, third = math.cos(psi) * signs[0], shape
    if table.sampling.derivative > 0.0:
        c, third = math.cos(psi) * math.cos(shape) * signs[0], math.cos(psi) * math.sin(shape) * signs[2]
    for r in range(found):
        low, high = work.found[r, 0], work.found[r, 1]
        number = max(1, math.ceil((high - low) / pieces))
        half[0] = 0.5 * (high - low) / number
        for t in range(number):
            kappa = low + (2 * t + 1) * half[0]
            k = math.exp(kappa)
            x[0], x[1], x[2] = k * c, k * math.sin(psi) * signs[1], third
            if table.sampling.derivative > 0.0:
                x[2] *= k
            count = box_rows(code, target, kappa, cell, half, signs, table, filters, box, lin, 0)
            if count >= 0:
                count = band_rows(kappa, half, table, rows, work, slopes, lin, count)
            if count >= 0:
                count = crossing_rows(
                    code, target, x, signs, kappa, half, table, filters, rows, work, slopes, lin, count
                )
            if count >= 0 and what_is_left(lin, count, left):
                whole[0], whole[1] = min(whole[0], left[0]), max(whole[1], left[1])
                whole[2], whole[3] = min(whole[2], left[2]), max(whole[3], left[3])
                cell[KAPPA] = kappa
    copy_into(whole, left)
    return whole[0] <= whole[1]


@compiled
def _middle(low, high):
    """Where directions are cut: half-way, or at the geometric mean of a wide range of their tangent."""
    first, last = math.tan(low), math.tan(min(high, 0.5 * _PI - 1e-9))
    if high >= 0.5 * _PI - 1e-9 and first > 1.0:
        return math.atan(_WIDE * first)
    if low == 0.0 and last < 1.0:
        return math.atan(last / _WIDE)
    if first > 0.0 and last / first > _WIDE:
        return math.atan(math.sqrt(first * last))
    return 0.5 * (low + high)


@entry
def branch(code, target, quadrants, cells, number, most, table, rows, box, work):
    """Discard cells until none is left or `most` were looked at: (first that is left, behind the last one, looked).

    Args:
        code, target: of the objective; gains that do not cost less than the target are discarded.
        quadrants: the signs of kp, ki and kd, shape (k, 3).
        cells: to begin with, and room for `2 * most` more; those that are left lie between the two returned indices.
        number: of cells to begin with.
        most: cells.
        table, rows, box, work: as in `allowed_intervals`; `rows` with the objective's own.
    """
    first, last, looked = 0, number, 0
    slopes, lin, left = np.empty((SLOPES, work.gain.shape[1])), np.empty((_MOST_ROWS, 5)), np.empty(4)
    cell = np.empty(cells.shape[1])
    while first < last and looked < most:
        copy_into(cells[first], cell)
        first += 1
        looked += 1
        signs = quadrants[int(cell[QUADRANT])]
        alpha, reach = order_over(cell, table.sampling)
        filters = filters_over(alpha, reach, table.sampling)
        found = kappa_left(code, target, cell, signs, table, filters, rows, box, work, slopes)
        if found == 0:
            continue
        total, longest = 0.0, 0.0
        for r in range(found):
            length = work.found[r, 1] - work.found[r, 0]
            total += length
            if length > longest:
                longest, cell[KAPPA] = (
                    length,
                    max(work.found[r, 0], work.found[r, 1] - 2.0) * 0.5 + 0.5 * work.found[r, 1],
                )
        spread, by_shape, by_psi = _spreads_near_crossover(cell[KAPPA], cell, work, slopes)
        piece = max(_PIECE, spread)
        if spread < _LARGEST_SPREAD and total / piece + found <= _MOST_PIECES:
            if not _linearised(
                code, target, piece, found, cell, signs, table, filters, rows, box, work, slopes, lin, left
            ):
                continue
            for low, high, k in ((SHAPE_LOW, SHAPE_HIGH, 0), (PSI_LOW, PSI_HIGH, 2)):
                middle, half = 0.5 * (cell[low] + cell[high]), 0.5 * (cell[high] - cell[low])
                cell[low], cell[high] = middle + half * left[k], middle + half * left[k + 1]
            by_shape *= 0.5 * (left[1] - left[0])
            by_psi *= 0.5 * (left[3] - left[2])
            if 0.25 * (left[1] - left[0]) * (left[3] - left[2]) < _MUCH_SMALLER:
                copy_into(cell, cells[last])
                last += 1
                continue
        low, high = (SHAPE_LOW, SHAPE_HIGH) if by_shape > by_psi else (PSI_LOW, PSI_HIGH)
        halved = low == SHAPE_LOW and table.sampling.derivative == 0.0
        middle = 0.5 * (cell[low] + cell[high]) if halved else _middle(cell[low], cell[high])
        copy_into(cell, cells[last])
        copy_into(cell, cells[last + 1])
        cells[last, high] = middle
        cells[last + 1, low] = middle
        last += 2
    return first, last, looked
