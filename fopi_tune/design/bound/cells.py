"""A cell of (shape, psi):  the centre's loops, and how much those of the whole cell differ from them (compiled).

The shape is alpha, or theta of a controller with a derivative (`derivative_cells`).  Each change is bounded twice, by a
disc around C0 and by the slopes of ln C0 with what they leave of it.

Source: derived; Taylor's formula with its remainder.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.columns import (
    DOWN,
    PSI_HIGH,
    PSI_IMAG,
    PSI_LOW,
    PSI_REAL,
    ROOM,
    SHAPE_HIGH,
    SHAPE_IMAG,
    SHAPE_LOW,
    SHAPE_REAL,
    bound_changes,
    is_far,
    leave_ends_open,
    write_loops,
)
from fopi_tune.design.bound.derivative_cells import fill_with_derivative
from fopi_tune.design.bound.integrals import (
    ANGLE,
    BEND,
    CHANGE,
    F_IMAG,
    F_REAL,
    F_SIZE,
    GAIN_CHANGE,
    HIGHEST,
    INTEGRALS,
    LOWEST,
    RATE,
    RATE_IMAG,
    RATE_REAL,
    integral_over,
)
from fopi_tune.design.global_search.compiled import compiled

_PI = math.pi


@compiled
def fill_cell(cell, signs, table, filters, work, slopes):
    """Slopes, and into the scratch the centre's loops and r of each column (`high`; inf at the ends of the axis)."""
    if table.sampling.derivative > 0.0:
        fill_with_derivative(cell, signs, table, work, slopes)
    else:
        _fill_fractional(cell, signs, table, filters, work, slopes)
    leave_ends_open(work, slopes)


@compiled
def _fill_fractional(cell, signs, table, filters, work, slopes):
    """`fill_cell` of c + s q.

    With q = (j omega)^-alpha, on samples F, lambda = -d ln q/d alpha and mu = d2 ln q/d alpha2, which is 0 in
    continuous time, and f = ln C0, C0 = c + s q over the half-widths of the cell:

        f_alpha = -lambda s q/C0,   f_psi = (c' + s' q)/C0,   f_alpha alpha = lambda^2 s q c/C0^2 + mu s q/C0,
        |f_alpha psi| = |lambda q/C0^2|,   f_psi psi = -(1 + q^2)/C0^2                                              (1)

    Source: derived; Taylor's formula.
    """
    n = table.gain.shape[1]
    alpha, reach = 0.5 * (cell[SHAPE_LOW] + cell[SHAPE_HIGH]), 0.5 * (cell[SHAPE_HIGH] - cell[SHAPE_LOW])
    psi, turn = 0.5 * (cell[PSI_LOW] + cell[PSI_HIGH]), 0.5 * (cell[PSI_HIGH] - cell[PSI_LOW])
    c, s = math.cos(psi) * signs[0], math.sin(psi) * signs[1]
    slope_c, slope_s = -math.sin(psi) * signs[0], math.cos(psi) * signs[1]
    largest, product = min(1.0, abs(math.sin(psi)) + turn), min(0.5, 0.5 * abs(math.sin(2.0 * psi)) + turn)
    sines, cosines = (
        (math.sin(cell[PSI_LOW]), math.sin(cell[PSI_HIGH])),
        (math.cos(cell[PSI_HIGH]), math.cos(cell[PSI_LOW])),
    )
    negative = s < 0 or (s == 0 and c < 0)
    same, sampled, q = signs[0] == signs[1], table.sampling.half > 0.0, np.empty(INTEGRALS)
    for j in range(1, n - 1):
        integral_over(alpha, reach, table.v[j], filters, q)
        x, rate = q[F_SIZE], q[RATE]
        real, imag = c + s * q[F_REAL], s * q[F_IMAG]
        square = real * real + imag * imag
        size = math.sqrt(square)
        grown = math.exp(q[CHANGE])
        moved = x * (grown - 1.0)
        turned_real, turned_imag = slope_c + slope_s * q[F_REAL], slope_s * q[F_IMAG]
        turned = math.sqrt(turned_real * turned_real + turned_imag * turned_imag)
        r = (turn * turned + 0.5 * turn * turn * math.sqrt(1.0 + x * x) + largest * moved) / size
        # f_psi = (c' + s' q)/C0 and s q/C0
        slopes[PSI_REAL, j] = (turned_real * real + turned_imag * imag) / square
        slopes[PSI_IMAG, j] = (turned_imag * real - turned_real * imag) / square
        part_real, part_imag = (
            s * (q[F_REAL] * real + q[F_IMAG] * imag) / square,
            s * (q[F_IMAG] * real - q[F_REAL] * imag) / square,
        )
        slopes[SHAPE_REAL, j] = -(q[RATE_REAL] * part_real - q[RATE_IMAG] * part_imag)
        slopes[SHAPE_IMAG, j] = -(q[RATE_REAL] * part_imag + q[RATE_IMAG] * part_real)
        rest = np.inf
        if not is_far(r):
            x_most = math.exp(q[GAIN_CHANGE]) * x
            slope = x_most / (square * (1.0 - r) * (1.0 - r))
            bend = math.sqrt(
                (1.0 + q[F_REAL] * q[F_REAL] - q[F_IMAG] * q[F_IMAG]) ** 2 + (2.0 * q[F_REAL] * q[F_IMAG]) ** 2
            )
            bend = (bend + x * x * (grown * grown - 1.0)) / (square * (1.0 - r) * (1.0 - r))
            rest = (
                0.5 * rate * rate * product * slope * reach * reach
                + 0.5 * q[BEND] * largest * x_most / (size * (1.0 - r)) * reach * reach
                + rate * slope * reach * turn
                + 0.5 * bend * turn * turn
            )
        work.high[j] = bound_changes(j, r, rest, reach, turn, slopes)
        if is_far(r):
            # far from the corner of C0 one term leads, C0 = lead (1 + t), however far alpha moves the other one
            change = math.exp(q[GAIN_CHANGE])
            least, most = x / change * sines[0], x * change * sines[1]
            t, lead, room = 2.0, 0.0, 0.0
            if least > cosines[1]:
                t, lead, room = cosines[1] / least, least, q[ANGLE]
            elif most < cosines[0]:
                t, lead = most / cosines[0], cosines[0]
            if t < 1.0:
                slopes[DOWN, j] = max(slopes[DOWN, j], math.log(lead * (1.0 - t) / size))
                slopes[ROOM, j] = min(slopes[ROOM, j], room + 2.0 * math.asin(t))
        lowest, highest = q[LOWEST], max(q[HIGHEST], 0.0)
        if same and highest - lowest < _PI:
            # both terms lie between the angles of q: so does their sum, which is no shorter than they allow
            turned = math.atan2(imag * signs[0], real * signs[0])
            slopes[ROOM, j] = min(slopes[ROOM, j], max(highest - turned, turned - lowest))
            longest, apart = max(cosines[0], x * math.exp(-q[GAIN_CHANGE]) * sines[0]), max(highest, -lowest)
            if apart > 0.5 * _PI:
                longest *= math.sin(apart)
            if longest > 0.0:
                slopes[DOWN, j] = max(slopes[DOWN, j], math.log(longest / size))
        angle = math.atan2(-imag, -real) - _PI if negative else math.atan2(imag, real)
        if sampled and angle > (-0.5 * _PI if negative else 0.5 * _PI):
            # as in `fill_ray`
            angle -= 2.0 * _PI
        write_loops(j, real, imag, angle, table, work)
