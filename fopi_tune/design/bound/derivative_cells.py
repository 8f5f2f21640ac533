"""A cell of controllers with a derivative:  C0 = c M(theta) + s I over ranges of (theta, psi) (compiled).

With c = cos(psi), s = sin(psi), the gains' signs p, i and d, I the integral times i, D = j omega/(1 + j omega Tf),

    M = p cos(theta) + d sin(theta) D ,   M' = dM/d theta ,   M'' = -M ,   M^2 + M'^2 = 1 + D^2 ,   f = ln C0:
    f_theta = c M'/C0 ,   f_psi = (c I - s M)/C0 ,   f_theta theta = -c (c (1 + D^2) + s M I)/C0^2 ,
    f_theta psi = -M' I/C0^2 ,   f_psi psi = -(M^2 + I^2)/C0^2 .                                                    (1)

Source: derived; Taylor's formula.
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
    write_loops,
)
from fopi_tune.design.global_search.compiled import compiled
from fopi_tune.design.global_search.controllers import FILTER, GAIN, controller_of, filter_at

_PI = math.pi
#: what `terms_over` tells: C0 and its slopes of (1) times C0, the disc's radius times |C0|, and |C0|^2 times what the
#: slopes leave of f, but for how much smaller |C0| becomes
V_REAL, V_IMAG, THETA_REAL, THETA_IMAG, P_REAL, P_IMAG, RADIUS, LEFT, MOVED, M_SIZE, I_SIZE, D_ANGLE, D_SIZE = range(13)
TERMS = 13


@compiled
def derivative_at(filter_time, omega):
    """D at j omega: (real, imaginary)."""
    part = omega / (1.0 + (omega * filter_time) ** 2)
    return part * omega * filter_time, part


@compiled
def terms_over(theta, reach, psi, turn, signs, controller, omega, out):
    """Write (1) at the centre of ranges, and how far the rest of them is from it.

    Args:
        theta, reach, psi, turn: centres and half-widths of both ranges.
        signs: of kp, ki and kd.
        controller: what `controller_of` makes of any gains.
        omega: of s = j omega.
        out: shape (TERMS,).
    """
    real, imag = filter_at(controller, omega)
    integral = complex(real, imag) * signs[1]
    real, imag = derivative_at(controller[FILTER], omega)
    derivative, rise = complex(real, imag), signs[2] * complex(real, imag)
    cosine, sine = math.cos(theta), math.sin(theta)
    m, slope = signs[0] * cosine + rise * sine, rise * cosine - signs[0] * sine
    c, s = math.cos(psi), math.sin(psi)
    value, by_theta, by_psi = c * m + s * integral, c * slope, c * integral - s * m
    size, m_size, slope_size = abs(integral), abs(m), abs(slope)
    # |M|^2 is at most this for every theta
    square = 1.0 + derivative * derivative
    most = math.sqrt(0.5 * (1.0 + abs(derivative) ** 2 + abs(square)))
    bend = 0.5 * most * reach * reach
    moved = slope_size * reach + bend
    m_most, slope_most = min(most, m_size + moved), min(most, slope_size + m_size * reach + bend)
    c_most, s_most = math.cos(max(psi - turn, 0.0)), math.sin(min(psi + turn, 0.5 * _PI))
    out[V_REAL], out[V_IMAG] = value.real, value.imag
    out[THETA_REAL], out[THETA_IMAG] = by_theta.real, by_theta.imag
    out[P_REAL], out[P_IMAG] = by_psi.real, by_psi.imag
    out[RADIUS] = (
        turn * abs(by_psi)
        + 0.5 * turn * turn * math.sqrt(m_size * m_size + size * size)
        + c_most * min(moved, 2.0 * most)
    )
    out[LEFT] = (
        0.5 * c_most * (c_most * abs(square) + s_most * m_most * size) * reach * reach
        + slope_most * size * reach * turn
        + 0.5 * (abs(m * m + integral * integral) + (m_most + m_size) * moved) * turn * turn
    )
    out[MOVED], out[M_SIZE], out[I_SIZE] = moved, m_size, size
    out[D_ANGLE], out[D_SIZE] = math.atan2(derivative.imag, derivative.real), abs(derivative)


@compiled
def _zeros_begin(cell, signs, controller):
    """The least omega at which a controller of the cell can be 0; inf where none can.

    C = 0 at s = j omega where Re C = kp + Tf ki e^g and Im C = kd omega/(1 + (omega Tf)^2) - ki e^g/omega vanish, which
    needs ki and kd of one sign and kp of the other one.
    """
    if signs[0] == signs[1] or signs[1] != signs[2]:
        return np.inf
    filter_time, integral = controller[FILTER], controller[GAIN]
    part = filter_time * integral
    # |kp|, |ki| and |kd| at the ends of the ranges
    least_p, most_p = (
        math.cos(cell[PSI_HIGH]) * math.cos(cell[SHAPE_HIGH]),
        math.cos(cell[PSI_LOW]) * math.cos(cell[SHAPE_LOW]),
    )
    least_i, most_i = math.sin(cell[PSI_LOW]), math.sin(cell[PSI_HIGH])
    if part * most_i < least_p or part * least_i > most_p:
        return np.inf
    rest = math.cos(cell[PSI_LOW]) * math.sin(cell[SHAPE_HIGH]) - least_i * integral * filter_time * filter_time
    return math.sqrt(least_i * integral / rest) if rest > 0.0 else np.inf


@compiled
def _where_one_term_leads(j, cell, out, size, slopes):
    """Bounds of a wide cell where the integral is larger than all the rest, or smaller."""
    c_low, c_high = math.cos(cell[PSI_HIGH]), math.cos(cell[PSI_LOW])
    s_low, s_high = math.sin(cell[PSI_LOW]), math.sin(cell[PSI_HIGH])
    m_least, m_most = out[M_SIZE] - out[MOVED], out[M_SIZE] + out[MOVED]
    t, lead, room = 2.0, 0.0, 0.0
    if s_low * out[I_SIZE] > c_high * m_most:
        lead = s_low * out[I_SIZE]
        t = c_high * m_most / lead
    elif m_least > 0.0 and c_low * m_least > s_high * out[I_SIZE]:
        lead, room = c_low * m_least, math.asin(out[MOVED] / out[M_SIZE])
        t = s_high * out[I_SIZE] / lead
    if t < 1.0:
        slopes[DOWN, j] = max(slopes[DOWN, j], math.log(lead * (1.0 - t) / size))
        slopes[ROOM, j] = min(slopes[ROOM, j], room + 2.0 * math.asin(t))


@compiled
def _where_all_add(j, cell, out, sign, size, slopes):
    """Bounds where all gains have one sign: the terms lie between the angles of I and D, and so does their sum."""
    highest = out[D_ANGLE] if cell[SHAPE_HIGH] > 0.0 else 0.0
    lowest = -0.5 * _PI if cell[PSI_HIGH] > 0.0 else 0.0
    angle = math.atan2(sign * out[V_IMAG], sign * out[V_REAL])
    slopes[ROOM, j] = min(slopes[ROOM, j], max(highest - angle, angle - lowest))
    c_low = math.cos(cell[PSI_HIGH])
    longest = max(
        math.sin(cell[PSI_LOW]) * out[I_SIZE],
        c_low * math.cos(cell[SHAPE_HIGH]),
        c_low * math.sin(cell[SHAPE_LOW]) * out[D_SIZE],
    )
    if highest - lowest > 0.5 * _PI:
        longest *= math.sin(highest - lowest)
    if longest > 0.0:
        slopes[DOWN, j] = max(slopes[DOWN, j], math.log(longest / size))


@compiled
def fill_with_derivative(cell, signs, table, work, slopes):
    """`fill_cell` of (1)."""
    theta, reach = 0.5 * (cell[SHAPE_LOW] + cell[SHAPE_HIGH]), 0.5 * (cell[SHAPE_HIGH] - cell[SHAPE_LOW])
    psi, turn = 0.5 * (cell[PSI_LOW] + cell[PSI_HIGH]), 0.5 * (cell[PSI_HIGH] - cell[PSI_LOW])
    c, s = math.cos(psi), math.sin(psi) * signs[1]
    first, third = c * math.cos(theta) * signs[0], c * math.sin(theta) * signs[2]
    x, out = controller_of(np.array((first, s, third)), table.sampling), np.empty(TERMS)
    lead = s if s != 0.0 else (third if first == 0.0 else first)
    sign = -1.0 if lead < 0.0 else 1.0
    # on which side of 0 the locus passes, as in `fill_controller`
    by_left = s != 0.0 and sign * (first + x[FILTER] * s * x[GAIN]) < 0.0
    begin, same = _zeros_begin(cell, signs, x), signs[0] == signs[1] == signs[2]
    for j in range(1, table.gain.shape[1] - 1):
        omega = math.exp(table.v[j])
        terms_over(theta, reach, psi, turn, signs, x, omega, out)
        real, imag = out[V_REAL], out[V_IMAG]
        square = max(real * real + imag * imag, 1e-60)
        size = math.sqrt(square)
        slopes[SHAPE_REAL, j] = (out[THETA_REAL] * real + out[THETA_IMAG] * imag) / square
        slopes[SHAPE_IMAG, j] = (out[THETA_IMAG] * real - out[THETA_REAL] * imag) / square
        slopes[PSI_REAL, j] = (out[P_REAL] * real + out[P_IMAG] * imag) / square
        slopes[PSI_IMAG, j] = (out[P_IMAG] * real - out[P_REAL] * imag) / square
        r = out[RADIUS] / size
        rest = np.inf if is_far(r) else out[LEFT] / (square * (1.0 - r) * (1.0 - r))
        work.high[j] = bound_changes(j, r, rest, reach, turn, slopes)
        if is_far(r):
            _where_one_term_leads(j, cell, out, size, slopes)
        if same:
            _where_all_add(j, cell, out, sign, size, slopes)
        if omega >= begin:
            # loops whose zero passed the axis are a whole turn apart
            slopes[ROOM, j] = np.inf
        angle = math.atan2(sign * imag, sign * real)
        if by_left and angle > 0.0:
            angle -= 2.0 * _PI
        write_loops(j, real, imag, angle if lead > 0.0 else angle - _PI, table, work)


@compiled
def slopes_with_derivative(x, signs, half, v, slopes):
    """f_theta and f_psi of (1) at v, and what they leave of f over the half-widths, as `controller_slopes` has them."""
    c = math.sqrt(x[0] * x[0] + x[2] * x[2])
    theta, psi = math.atan2(abs(x[2]), abs(x[0])), math.atan2(abs(x[1]), c)
    out = np.empty(TERMS)
    terms_over(theta, half[1], psi, half[2], signs, x, math.exp(v), out)
    value = complex(out[V_REAL], out[V_IMAG])
    by_theta, by_psi = complex(out[THETA_REAL], out[THETA_IMAG]) / value, complex(out[P_REAL], out[P_IMAG]) / value
    slopes[0], slopes[1], slopes[2], slopes[3] = by_theta.real, by_theta.imag, by_psi.real, by_psi.imag
    r = out[RADIUS] / abs(value)
    slopes[4] = np.inf if is_far(r) else out[LEFT] / (abs(value) * (1.0 - r)) ** 2


@compiled
def end_of_cell(cell, signs, filter_time):
    """(least |C0| as omega tends to infinity, the largest, its sign or 0 where that is not one of all).

    There I vanishes and M is p cos(theta) + d sin(theta)/Tf; without a derivative, for which Tf is 0, it is p.
    """
    c_low, c_high = math.cos(cell[PSI_HIGH]), math.cos(cell[PSI_LOW])
    if filter_time == 0.0:
        return c_low, c_high, signs[0]
    first = signs[0] * math.cos(cell[SHAPE_LOW]) + signs[2] * math.sin(cell[SHAPE_LOW]) / filter_time
    last = signs[0] * math.cos(cell[SHAPE_HIGH]) + signs[2] * math.sin(cell[SHAPE_HIGH]) / filter_time
    least, most, sign = min(abs(first), abs(last)), max(abs(first), abs(last)), math.copysign(1.0, first)
    if signs[0] == signs[2]:
        if cell[SHAPE_LOW] < math.atan(1.0 / filter_time) < cell[SHAPE_HIGH]:
            most = math.sqrt(1.0 + 1.0 / (filter_time * filter_time))
    elif first * last <= 0.0:
        least, sign = 0.0, 0.0
    return c_low * least, c_high * most, sign
