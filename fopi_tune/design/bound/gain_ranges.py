"""What the ranges of the gains, and objectives that are functions of the gains alone, leave of a cell (compiled).

Gains are k e^base times sines and cosines of psi, with a derivative of theta too.  ln sin and ln cos are concave: below
their tangents, above their chords.

Source: derived.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.columns import PSI_HIGH, PSI_LOW, SHAPE_HIGH, SHAPE_LOW
from fopi_tune.design.bound.integrals import (
    H_BEND,
    H_CHANGE,
    H_LARGEST,
    H_RATE,
    H_SLOPE,
    H_VALUE,
    real_integral_over,
)
from fopi_tune.design.bound.polygon import add_limit
from fopi_tune.design.global_search.compiled import IAE, KI, compiled
from fopi_tune.design.global_search.rays import BEYOND

_PI = math.pi
#: the smallest ln k that is looked at
_LEAST_KAPPA = -30.0
#: a sine or cosine whose logarithm has no chord
_VANISHING = 1e-9


@compiled
def order_over(cell, sampling):
    """(centre, half-width) of the integral's order; beside a derivative it is 1."""
    if sampling.derivative > 0.0:
        return 1.0, 0.0
    return 0.5 * (cell[SHAPE_LOW] + cell[SHAPE_HIGH]), 0.5 * (cell[SHAPE_HIGH] - cell[SHAPE_LOW])


@compiled
def _signed(sign, low, high):
    """The range of a gain's size."""
    return (low, high) if sign > 0 else (-high, -low)


@compiled
def _narrowed(low, high, gain, least, most):
    """[low, high] of kappa where k times a number between `least` and `most` may lie in a gain's range."""
    if gain[0] > gain[1]:
        return 1.0, 0.0
    if gain[0] > 0.0:
        low = max(low, math.log(gain[0] / most) if most > 0.0 else BEYOND)
    if least > 0.0:
        high = min(high, math.log(gain[1] / least) if gain[1] > 0.0 else -BEYOND)
    return low, high


@compiled
def derivative_at_real(filter_time, log_s):
    """D at a real s."""
    s = math.exp(log_s)
    return s / (filter_time * s + 1.0)


@compiled
def _largest_sum(a, b, low, high):
    """The largest a cos(x) + b sin(x) for low <= x <= high, within [0, 90 deg]; b >= 0 where it lies between."""
    at = min(max(math.atan2(b, a), low), high)
    return max(
        a * math.cos(low) + b * math.sin(low),
        a * math.cos(high) + b * math.sin(high),
        a * math.cos(at) + b * math.sin(at),
    )


@compiled
def kappa_of_cell(code, target, cell, signs, table, filters, box):
    """The kappa that the ranges of the gains and the objective's target leave in the cell: (low, high)."""
    low, high = _LEAST_KAPPA, BEYOND
    alpha, reach = order_over(cell, table.sampling)
    turn = reach * abs(box.log_omega)
    unit = math.exp(alpha * box.log_omega - box.log_gain)
    c_low, c_high = math.cos(cell[PSI_HIGH]), math.cos(cell[PSI_LOW])
    first_low, first_high = 1.0, 1.0
    if table.sampling.derivative > 0.0:
        first_low, first_high = math.cos(cell[SHAPE_HIGH]), math.cos(cell[SHAPE_LOW])
        kd = _signed(signs[2], box.kd_low, box.kd_high)
        least, most = math.sin(cell[SHAPE_LOW]), math.sin(cell[SHAPE_HIGH])
        low, high = _narrowed(low, high, kd, c_low * least, c_high * most)
    low, high = _narrowed(
        low, high, _signed(signs[0], box.kp_low, box.kp_high), c_low * first_low, c_high * first_high
    )  # fmt: skip
    ki = _signed(signs[1], box.ki_low, box.ki_high)
    if code == KI:
        ki = (max(ki[0], -target), ki[1]) if signs[1] > 0 else (1.0, 0.0)
    least, most = unit * math.exp(-turn) * math.sin(cell[PSI_LOW]), unit * math.exp(turn) * math.sin(cell[PSI_HIGH])
    low, high = _narrowed(low, high, ki, least, most)
    if code == IAE and signs[0] == signs[1] and low < high:
        real = np.empty(6)
        real_integral_over(alpha, reach, -box.log_horizon, filters, real)
        rest = 1.0
        if table.sampling.derivative > 0.0:
            d = derivative_at_real(table.sampling.derivative, -box.log_horizon)
            rest = _largest_sum(1.0, d * signs[0] * signs[2], cell[SHAPE_LOW], cell[SHAPE_HIGH])
        controller = _largest_sum(rest, real[H_LARGEST], cell[PSI_LOW], cell[PSI_HIGH])
        for i in range(table.gain.shape[0]):
            p = table.error_gain[i] * signs[0]
            if p > 0.0 and controller > 0.0:
                needed = (p * math.exp(-target) - 1.0) / (controller * p)
                low = max(low, math.log(needed) if needed > 0.0 else -BEYOND)
    return low, high


@compiled
def _logs(of_sine, low, high):
    """ln sin or ln cos over a range:  at its middle, the tangent's change over half of it, and both of the chord."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    sine, cosine = math.sin(middle), math.cos(middle)
    value, first, last = cosine, math.cos(low), math.cos(high)
    slope = -sine / cosine if cosine > 0.0 else 0.0
    if of_sine:
        value, first, last = sine, math.sin(low), math.sin(high)
        slope = cosine / sine if sine > 0.0 else 0.0
    at = math.log(value) if value > 0.0 else -np.inf
    if min(first, last) <= _VANISHING:
        return at, slope * half, -np.inf, 0.0
    first, last = math.log(first), math.log(last)
    return at, slope * half, 0.5 * (first + last), 0.5 * (last - first)


@compiled
def _gain_rows(gain, base, a0, a1, psi_part, shape_part, lin, count):
    """Rows of a gain whose ln is base + a0 + a1 and what `_logs` says of its parts; `shape_part` counts with a1."""
    at, chord = base + psi_part[0] + shape_part[0], base + psi_part[2] + shape_part[2]
    if gain[0] > 0.0 and at > -np.inf:
        count = add_limit(lin, count, -1.0, at, a0, a1 + shape_part[1], psi_part[1], math.log(gain[0]), 0.0)
    if gain[1] > 0.0 and chord > -np.inf:
        count = add_limit(lin, count, 1.0, chord, a0, a1 + shape_part[3], psi_part[3], math.log(gain[1]), 0.0)
    return count


@compiled
def box_rows(code, target, kappa, cell, half, signs, table, filters, box, lin, count):
    """Rows of the gains' ranges and of the objectives that are functions of the gains alone."""
    alpha, reach = order_over(cell, table.sampling)
    with_derivative = table.sampling.derivative > 0.0
    cosines = _logs(False, cell[PSI_LOW], cell[PSI_HIGH])
    sines = _logs(True, cell[PSI_LOW], cell[PSI_HIGH])
    first, none = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    if with_derivative:
        first = _logs(False, cell[SHAPE_LOW], cell[SHAPE_HIGH])
        third = _logs(True, cell[SHAPE_LOW], cell[SHAPE_HIGH])
        kd = _signed(signs[2], box.kd_low, box.kd_high)
        count = _gain_rows(kd, kappa, half[0], 0.0, cosines, third, lin, count)
    kp = _signed(signs[0], box.kp_low, box.kp_high)
    count = _gain_rows(kp, kappa, half[0], 0.0, cosines, first, lin, count)
    ki = _signed(signs[1], box.ki_low, box.ki_high)
    if code == KI:
        ki = (max(ki[0], -target), ki[1])
    base = kappa + alpha * box.log_omega - box.log_gain
    count = _gain_rows(ki, base, half[0], box.log_omega * reach, sines, none, lin, count)
    if code != IAE or signs[0] != signs[1]:
        return count
    if with_derivative:
        return _error_rows_with_derivative(target, kappa, cell, half, signs, table, filters, box, lin, count)
    return _error_rows(target, kappa, cell, half, signs, table, filters, box, lin, count)


@compiled
def _needed_rows(target, log_c, a0, a1, a2, rest, signs, table, lin, count):
    """Rows of ln C at the horizon's s, at least what the target needs of it with each plant."""
    for i in range(table.gain.shape[0]):
        p = table.error_gain[i] * signs[0]
        if p > 0.0:
            needed = (p * math.exp(-target) - 1.0) / p
            if needed > 0.0:
                count = add_limit(lin, count, -1.0, log_c, a0, a1, a2, math.log(needed), rest)
    return count


@compiled
def _error_rows(target, kappa, cell, half, signs, table, filters, box, lin, count):
    """C0 = cos(psi) + sin(psi) h, h = s^-alpha or F at a real s, and the derivatives of ln C0 as in `cells` (1)."""
    alpha, psi = 0.5 * (cell[SHAPE_LOW] + cell[SHAPE_HIGH]), 0.5 * (cell[PSI_LOW] + cell[PSI_HIGH])
    sine, cosine, real = math.sin(psi), math.cos(psi), np.empty(6)
    real_integral_over(alpha, half[1], -box.log_horizon, filters, real)
    h, grown, rate = real[H_VALUE], math.exp(real[H_CHANGE]), real[H_RATE]
    value = cosine + sine * h
    by_alpha, by_psi = real[H_SLOPE] * sine * h / value, (cosine * h - sine) / value
    least = min(
        math.cos(cell[PSI_LOW]) + math.sin(cell[PSI_LOW]) * h / grown,
        math.cos(cell[PSI_HIGH]) + math.sin(cell[PSI_HIGH]) * h / grown,
    )
    inverse = 1.0 / (least * least)
    rest = (
        0.5
        * inverse
        * (
            rate * rate * min(0.5, sine * cosine + half[2]) * h * grown * half[1] ** 2
            + real[H_BEND] * min(1.0, sine + half[2]) * least * h * grown * half[1] ** 2
            + 2.0 * rate * h * grown * half[1] * half[2]
        )
    )
    log_c = kappa + math.log(value)
    return _needed_rows(
        target, log_c, half[0], by_alpha * half[1], by_psi * half[2], rest, signs, table, lin, count
    )  # fmt: skip


@compiled
def _error_rows_with_derivative(target, kappa, cell, half, signs, table, filters, box, lin, count):
    """C0 = c M + s h at a real s, M = cos(theta) + d sin(theta), and the derivatives of ln C0 as in `derivative_cells`.

    ln C0 is concave in psi, and in theta where C0 > 0 and d M > 0:  only the mixed term adds to the tangents.
    """
    theta, psi = 0.5 * (cell[SHAPE_LOW] + cell[SHAPE_HIGH]), 0.5 * (cell[PSI_LOW] + cell[PSI_HIGH])
    real = np.empty(6)
    real_integral_over(1.0, 0.0, -box.log_horizon, filters, real)
    h, d = real[H_VALUE], derivative_at_real(table.sampling.derivative, -box.log_horizon) * signs[0] * signs[2]
    m, slope = math.cos(theta) + d * math.sin(theta), d * math.cos(theta) - math.sin(theta)
    c, s, most = math.cos(psi), math.sin(psi), math.sqrt(1.0 + d * d)
    value = c * m + s * h
    # |M| and |M'| are at most `most`, and so is how fast M changes
    least_m = min(
        math.cos(cell[SHAPE_LOW]) + d * math.sin(cell[SHAPE_LOW]),
        math.cos(cell[SHAPE_HIGH]) + d * math.sin(cell[SHAPE_HIGH]),
    )
    least = min(
        math.cos(cell[PSI_LOW]) * least_m + math.sin(cell[PSI_LOW]) * h,
        math.cos(cell[PSI_HIGH]) * least_m + math.sin(cell[PSI_HIGH]) * h,
    )
    if value <= 0.0 or least_m <= 0.0 or least <= 0.0:
        return count
    rest = most * h / (least * least) * half[1] * half[2]
    log_c, by_theta, by_psi = kappa + math.log(value), c * slope / value, (c * h - s * m) / value
    return _needed_rows(
        target, log_c, half[0], by_theta * half[1], by_psi * half[2], rest, signs, table, lin, count
    )  # fmt: skip
