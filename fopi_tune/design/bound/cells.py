"""A cell of (alpha, psi):  the centre's loops, and how much those of the whole cell differ from them (compiled).

Each change is bounded twice, by a disc around C0 and by the slopes of ln C0 with what they leave of it.

Source: derived; Taylor's formula with its remainder.
"""

from __future__ import annotations

import math

import numpy as np

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
#: columns of a cell
ALPHA_LOW, ALPHA_HIGH, PSI_LOW, PSI_HIGH, QUADRANT, KAPPA = range(6)
#: rows of a cell's slopes at each column: those of f = ln C0, what they leave of f (second order), how much f changes
#: at most and e^that, how much ln|C0| rises and falls, and how much arg C0 turns
ALPHA_REAL, ALPHA_IMAG, PSI_REAL, PSI_IMAG, REST, SPREAD, GROWN, UP, DOWN, ROOM = range(10)
SLOPES = 10
#: a radius from which on the slopes say nothing
_MOST_RADIUS = 0.8
#: neper and radian: |C0| or its angle may be the same in a whole cell, and then only rounding tells loops apart
_ROUNDING = 1e-11


@compiled
def fill_cell(cell, signs, table, filters, work, slopes):
    """The centre's loops into the scratch arrays, r of each column into `high` (inf at the ends of the axis), and (1).

    With q = (j omega)^-alpha, on samples F, lambda = -d ln q/d alpha and mu = d2 ln q/d alpha2, which is 0 in
    continuous time, and f = ln C0, C0 = c + s q over the half-widths of the cell:

        f_alpha = -lambda s q/C0,   f_psi = (c' + s' q)/C0,   f_alpha alpha = lambda^2 s q c/C0^2 + mu s q/C0,
        |f_alpha psi| = |lambda q/C0^2|,   f_psi psi = -(1 + q^2)/C0^2                                              (1)

    Source: derived; Taylor's formula.
    """
    m, n = table.gain.shape
    alpha, reach = 0.5 * (cell[ALPHA_LOW] + cell[ALPHA_HIGH]), 0.5 * (cell[ALPHA_HIGH] - cell[ALPHA_LOW])
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
        slopes[UP, j], slopes[DOWN, j], slopes[ROOM, j] = math.log(1.0 + r), -np.inf, np.inf
        if r < 1.0:
            slopes[DOWN, j], slopes[ROOM, j] = math.log(1.0 - r), math.asin(r)
        # f_psi = (c' + s' q)/C0 and s q/C0
        slopes[PSI_REAL, j] = (turned_real * real + turned_imag * imag) / square
        slopes[PSI_IMAG, j] = (turned_imag * real - turned_real * imag) / square
        part_real, part_imag = (
            s * (q[F_REAL] * real + q[F_IMAG] * imag) / square,
            s * (q[F_IMAG] * real - q[F_REAL] * imag) / square,
        )
        slopes[ALPHA_REAL, j] = -(q[RATE_REAL] * part_real - q[RATE_IMAG] * part_imag)
        slopes[ALPHA_IMAG, j] = -(q[RATE_REAL] * part_imag + q[RATE_IMAG] * part_real)
        slopes[REST, j] = slopes[SPREAD, j] = slopes[GROWN, j] = np.inf
        if r < _MOST_RADIUS:
            x_most = math.exp(q[GAIN_CHANGE]) * x
            slope = x_most / (square * (1.0 - r) * (1.0 - r))
            bend = math.sqrt(
                (1.0 + q[F_REAL] * q[F_REAL] - q[F_IMAG] * q[F_IMAG]) ** 2 + (2.0 * q[F_REAL] * q[F_IMAG]) ** 2
            )
            bend = (bend + x * x * (grown * grown - 1.0)) / (square * (1.0 - r) * (1.0 - r))
            slopes[REST, j] = (
                0.5 * rate * rate * product * slope * reach * reach
                + 0.5 * q[BEND] * largest * x_most / (size * (1.0 - r)) * reach * reach
                + rate * slope * reach * turn
                + 0.5 * bend * turn * turn
                + _ROUNDING
            )
            by_alpha = math.sqrt(slopes[ALPHA_REAL, j] ** 2 + slopes[ALPHA_IMAG, j] ** 2)
            slopes[SPREAD, j] = by_alpha * reach + turned / size * turn + slopes[REST, j]
            slopes[GROWN, j] = math.exp(slopes[SPREAD, j])
            r = min(r, slopes[GROWN, j] - 1.0)
            more = abs(slopes[ALPHA_REAL, j]) * reach + abs(slopes[PSI_REAL, j]) * turn + slopes[REST, j]
            slopes[UP, j], slopes[DOWN, j] = min(slopes[UP, j], more), max(slopes[DOWN, j], -more)
            more = abs(slopes[ALPHA_IMAG, j]) * reach + abs(slopes[PSI_IMAG, j]) * turn + slopes[REST, j]
            slopes[ROOM, j] = min(slopes[ROOM, j], more)
        else:
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
        work.high[j] = r
        log_c = math.log(size)
        work.controller[1, j], work.controller[2, j] = real, imag
        angle = math.atan2(-imag, -real) - _PI if negative else math.atan2(imag, real)
        if sampled and angle > (-0.5 * _PI if negative else 0.5 * _PI):
            # as in `fill_ray`
            angle -= 2.0 * _PI
        for i in range(m):
            work.gain[i, j] = log_c + table.gain[i, j]
            work.phase[i, j] = angle + table.phase[i, j]
            work.real[i, j] = real * table.real[i, j] - imag * table.imag[i, j]
            work.square[i, j] = size * math.sqrt(table.real[i, j] ** 2 + table.imag[i, j] ** 2)
    work.high[0] = work.high[n - 1] = np.inf
    for j in (0, n - 1):
        slopes[REST, j] = slopes[SPREAD, j] = slopes[UP, j] = slopes[ROOM, j] = slopes[GROWN, j] = np.inf
        slopes[DOWN, j] = -np.inf
