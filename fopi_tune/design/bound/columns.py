"""What is written for each frequency of a cell:  its centre's loops, and how much the others differ (compiled).

Source: derived; Taylor's formula with its remainder.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import compiled

#: columns of a cell; its shape is alpha, or theta of a controller with a derivative
SHAPE_LOW, SHAPE_HIGH, PSI_LOW, PSI_HIGH, QUADRANT, KAPPA = range(6)
#: rows of a cell's slopes at each column: those of f = ln C0, what they leave of f (second order), how much f changes
#: at most and e^that, how much ln|C0| rises and falls, and how much arg C0 turns
SHAPE_REAL, SHAPE_IMAG, PSI_REAL, PSI_IMAG, REST, SPREAD, GROWN, UP, DOWN, ROOM = range(10)
SLOPES = 10
#: a radius from which on the slopes say nothing
_MOST_RADIUS = 0.8
#: neper and radian: |C0| or its angle may be the same in a whole cell, and then only rounding tells loops apart
_ROUNDING = 1e-11


@compiled
def is_far(r):
    """Whether the loops of a cell differ too much for slopes."""
    return not r < _MOST_RADIUS


@compiled
def bound_changes(j, r, rest, reach, turn, slopes):
    """Bound the changes of C0 at a column by its disc and, unless that is too wide, by slopes and rest: the radius.

    Args:
        j: the column, at which the four slopes of f are known.
        r: the radius of the disc, relative to |C0|.
        rest: what the slopes leave of f.
        reach, turn: half-widths of shape and psi.
        slopes: the rest of the rows is written.
    """
    slopes[UP, j], slopes[DOWN, j], slopes[ROOM, j] = math.log(1.0 + r), -np.inf, np.inf
    slopes[REST, j] = slopes[SPREAD, j] = slopes[GROWN, j] = np.inf
    if r < 1.0:
        slopes[DOWN, j], slopes[ROOM, j] = math.log(1.0 - r), math.asin(r)
    if is_far(r):
        return r
    rest += _ROUNDING
    by_shape = math.sqrt(slopes[SHAPE_REAL, j] ** 2 + slopes[SHAPE_IMAG, j] ** 2)
    by_psi = math.sqrt(slopes[PSI_REAL, j] ** 2 + slopes[PSI_IMAG, j] ** 2)
    slopes[REST, j], slopes[SPREAD, j] = rest, by_shape * reach + by_psi * turn + rest
    slopes[GROWN, j] = math.exp(slopes[SPREAD, j])
    more = abs(slopes[SHAPE_REAL, j]) * reach + abs(slopes[PSI_REAL, j]) * turn + rest
    slopes[UP, j], slopes[DOWN, j] = min(slopes[UP, j], more), max(slopes[DOWN, j], -more)
    more = abs(slopes[SHAPE_IMAG, j]) * reach + abs(slopes[PSI_IMAG, j]) * turn + rest
    slopes[ROOM, j] = min(slopes[ROOM, j], more)
    return min(r, slopes[GROWN, j] - 1.0)


@compiled
def write_loops(j, real, imag, angle, table, work):
    """The centre's loops at a column: C0 and its angle, ln|L0|, arg L0, Re L0 and |L0|."""
    size = math.sqrt(real * real + imag * imag)
    log_c = math.log(size)
    work.controller[1, j], work.controller[2, j] = real, imag
    for i in range(table.gain.shape[0]):
        work.gain[i, j] = log_c + table.gain[i, j]
        work.phase[i, j] = angle + table.phase[i, j]
        work.real[i, j] = real * table.real[i, j] - imag * table.imag[i, j]
        work.square[i, j] = size * math.sqrt(table.real[i, j] ** 2 + table.imag[i, j] ** 2)


@compiled
def leave_ends_open(work, slopes):
    """Nothing is said at the ends of the axis."""
    last = work.gain.shape[1] - 1
    work.high[0] = work.high[last] = np.inf
    for j in (0, last):
        slopes[REST, j] = slopes[SPREAD, j] = slopes[UP, j] = slopes[ROOM, j] = slopes[GROWN, j] = np.inf
        slopes[DOWN, j] = -np.inf
