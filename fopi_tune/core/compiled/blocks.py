"""The numbers of `loops.py` at a block of places of one loop (compiled):  the same bits, several places at a time.

Every factor is applied to all places before the next one, in loops that processors run on vectors; what is added up is
added up in the same order as by `bode_at`.  Logarithms, exponentials and arc tangents are taken place by place.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.compiled.loops import (
    _BOUND_CAP,
    _EXPONENT_CAP,
    _ROUNDING,
    bode_at,
    direct_at,
    frequency_of,
    inner,
    power_of,
    power_sum_at,
    slope_at,
)

#: places of a block, and how many are faster together
BLOCK, FEWEST = 64, 7
#: places whose slopes alone are computed together
_LONG = 512
#: rows of a block: what `bode_at` returns, u and h, and what is on the way to it
GAIN, PHASE, SLOPE, TURN, OF_GAIN, OF_PHASE, OF_BOTH, U, H = range(9)
_OMEGA, _WIDE, _WIDE_OTHER, _SMALL, _X = range(9, 14)
_TOP, _BOTTOM, _REAL, _IMAG, _TURNS, _BEND, _TWIST, _BOUND, _THIRD = range(14, 23)
_ROWS = 23


@inner
def bode_block(terms, r, low, high, count, of_gain=True, of_phase=True):
    """`bode_at` of function r on cells, shape (_ROWS, BLOCK), of which the first `count` columns count.

    Args:
        terms: the functions.
        r: which.
        low, high: shape (n,), n >= count: the cells' ends, all of them with high > low.
        count: at most BLOCK.
        of_gain, of_phase: whether ln|f|, arg f and the bounds of their curvature are wanted, slopes always are; the
            bound of both where both are.
    """
    s = np.empty((_ROWS, BLOCK))
    whole, factors = terms.whole, terms.factors
    # two whole vectors at least, or the processor takes them one by one
    filled, near = min((count + 15) // 16 * 16, BLOCK), True
    for i in range(filled):
        j = min(i, count - 1)
        u, h = 0.5 * (low[j] + high[j]), 0.5 * (high[j] - low[j])
        s[U, i], s[H, i], s[_OMEGA, i] = u, h, frequency_of(u)
        near = near and s[_OMEGA, i] > 0.0
        s[_WIDE, i] = math.exp(min(h, _EXPONENT_CAP))
        s[GAIN, i], s[PHASE, i], s[SLOPE, i], s[TURN, i] = whole[0, r] + whole[1, r] * u, whole[2, r], whole[1, r], 0.0
        s[_TOP, i], s[_BOTTOM, i], s[_REAL, i], s[_IMAG, i], s[_TURNS, i] = 1.0, 1.0, 1.0, 0.0, 0.0
        s[_BEND, i], s[_TWIST, i], s[_BOUND, i], s[_THIRD, i] = 0.0, 0.0, 0.0, 0.0
    if not near:
        for i in range(count):
            found = bode_at(terms, r, s[U, i], s[H, i])
            for k in range(7):
                s[k, i] = found[k]
        return s
    last_nu = 1.0
    for k in range(factors.shape[2]):
        nu, corner, cosine, sine, sign = (
            factors[0, r, k], factors[1, r, k], factors[2, r, k], factors[3, r, k], factors[4, r, k]
        )  # fmt: skip
        if sign == 0.0 or corner == np.inf:
            continue
        inverse, weight = factors[6, r, k], factors[5, r, k]
        wide = _WIDE
        if nu != 1.0:
            wide = _WIDE_OTHER
            if nu != last_nu:
                for i in range(filled):
                    s[_WIDE_OTHER, i] = math.exp(min(nu * s[H, i], _EXPONENT_CAP))
                last_nu = nu
        if inverse > 0.0:
            for i in range(filled):
                ratio = s[_OMEGA, i] * inverse
                x = s[U, i] - corner
                s[_X, i] = x
                s[_SMALL, i] = 1.0 / ratio if x > 0.0 else ratio
        else:
            for i in range(filled):
                s[_X, i], s[_SMALL, i] = power_of(factors, r, k, s[U, i], s[_OMEGA, i])
        steep, size = weight * nu, abs(weight * nu)
        single = sign == 1.0 or sign == -1.0
        up = sign > 0.0
        for i in range(filled):
            x, small = s[_X, i], s[_SMALL, i]
            along, across = 1.0 + small * cosine, small * sine
            square = along * along + across * across
            over = x > 0.0
            s[GAIN, i] = s[GAIN, i] + sign * x if over else s[GAIN, i]
            rho = 1.0 / small if over else small
            q_real = (along if over else small * (small + cosine)) / square
            q_imag = across / square
            s[SLOPE, i] += weight * q_real
            s[TURN, i] += weight * q_imag
            s[_BEND, i] += steep * (q_real - q_real * q_real + q_imag * q_imag)
            s[_TWIST, i] += steep * (q_imag - 2.0 * q_real * q_imag)
            spread = s[wide, i]
            far = min(max(rho * spread, 1.0 / _BOUND_CAP), _BOUND_CAP)
            close = min(max(rho / spread, 1.0 / _BOUND_CAP), _BOUND_CAP)
            closest = min(max(-cosine, close), far)
            distance = max((closest + cosine) * (closest + cosine) + sine * sine, 1e-300)
            own = size * far / distance
            s[_BOUND, i] += own
            s[_THIRD, i] += own * nu * (1.0 + far) / math.sqrt(distance)
        if single:
            for i in range(filled):
                x, small = s[_X, i], s[_SMALL, i]
                along, across = 1.0 + small * cosine, small * sine
                square = along * along + across * across
                over = x > 0.0
                a = small + cosine if over else along
                b = sine if over else across
                b = b if up else -b
                s[_TOP, i] = s[_TOP, i] * square if up else s[_TOP, i]
                s[_BOTTOM, i] = s[_BOTTOM, i] if up else s[_BOTTOM, i] * square
                real, imag = s[_REAL, i], s[_IMAG, i]
                product_real, product_imag = real * a - imag * b, real * b + imag * a + 0.0
                rises = (imag >= 0.0) & (b >= 0.0) & (product_imag < 0.0)
                falls = (imag < 0.0) & (b < 0.0)
                falls = falls & ((product_imag > 0.0) | ((product_imag == 0.0) & (product_real < 0.0)))
                s[_TURNS, i] += (1.0 if rises else 0.0) - (1.0 if falls else 0.0)
                s[_REAL, i], s[_IMAG, i] = product_real, product_imag
        else:
            for i in range(count):
                x, small = s[_X, i], s[_SMALL, i]
                along, across = 1.0 + small * cosine, small * sine
                a, b = (small + cosine, sine) if x > 0.0 else (along, across)
                s[GAIN, i] += 0.5 * sign * math.log(along * along + across * across)
                s[PHASE, i] += sign * math.atan2(b, a)
    for i in range(count):
        _finish(terms, r, s, i, of_gain, of_phase)
    return s


@inner
def _finish(terms, r, s, i, of_gain, of_phase):
    """What `bode_at` does after its factors."""
    gain, phase = s[GAIN, i], s[PHASE, i]
    if of_gain:
        gain += 0.5 * math.log(s[_TOP, i] / s[_BOTTOM, i])
    if of_phase:
        phase += math.atan2(s[_IMAG, i], s[_REAL, i]) + 2.0 * math.pi * s[_TURNS, i]
    slope, turn, bound, third, bend, twist = (
        s[SLOPE, i], s[TURN, i], s[_BOUND, i], s[_THIRD, i], s[_BEND, i], s[_TWIST, i]
    )  # fmt: skip
    u, h = s[U, i], s[H, i]
    for row in range(r, len(terms.sums), terms.whole.shape[1]):
        sign = terms.sums[row, 4, -1]
        a, b, q_real, q_imag, x, along, own, across = power_sum_at(terms.sums, row, u, h)
        gain, phase, slope, turn = gain + sign * a, phase + sign * b, slope + sign * q_real, turn + sign * q_imag
        bend, twist, bound, third = bend + sign * x, twist + sign * along, bound + own, third + across
    turning, delay = 0.0, terms.whole[3, r]
    if delay != 0.0:
        turned = delay * math.exp(u)
        phase -= turned
        turn -= turned
        twist -= turned
        turning = abs(delay) * math.exp(u + h)
    s[GAIN, i], s[PHASE, i], s[SLOPE, i], s[TURN, i] = gain, phase, slope, turn
    s[OF_GAIN, i] = min(bound, abs(bend) + third * h + _ROUNDING)
    s[OF_PHASE, i] = min(bound + turning, abs(twist) + (third + turning) * h + _ROUNDING)
    if of_gain and of_phase:
        s[OF_BOTH, i] = min(bound + turning, math.hypot(bend, twist) + (third + turning) * h + _ROUNDING)


@inner
def slope_block(terms, r, u, slopes):
    """`slope_at` of function r at many places: written into `slopes`, shape (n, 2)."""
    s = np.empty((4, _LONG))
    factors = terms.factors
    for begin in range(0, len(u), _LONG):
        count, near = min(_LONG, len(u) - begin), True
        for i in range(count):
            s[0, i], s[1, i] = u[begin + i], frequency_of(u[begin + i])
            near = near and s[1, i] > 0.0
            s[2, i], s[3, i] = terms.whole[1, r], 0.0
        if not near:
            for i in range(count):
                slopes[begin + i, 0], slopes[begin + i, 1] = slope_at(terms, r, u[begin + i])
            continue
        for k in range(factors.shape[2]):
            corner, cosine, sine, inverse = factors[1, r, k], factors[2, r, k], factors[3, r, k], factors[6, r, k]
            if corner == np.inf:
                continue
            own = factors[5, r, k]
            if inverse > 0.0:
                for i in range(count):
                    ratio, over = s[1, i] * inverse, s[0, i] - corner > 0.0
                    small = 1.0 / ratio if over else ratio
                    a, b = 1.0 + small * cosine, small * sine
                    weight = own / (a * a + b * b)
                    s[2, i] += weight * (a if over else small * (small + cosine))
                    s[3, i] += weight * b
            else:
                for i in range(count):
                    x, small = power_of(factors, r, k, s[0, i], s[1, i])
                    a, b = 1.0 + small * cosine, small * sine
                    weight = own / (a * a + b * b)
                    s[2, i] += weight * (a if x > 0.0 else small * (small + cosine))
                    s[3, i] += weight * b
        for i in range(count):
            along, across = s[2, i], s[3, i]
            for row in range(r, len(terms.sums), terms.whole.shape[1]):
                found = power_sum_at(terms.sums, row, s[0, i], 0.0)
                sign = terms.sums[row, 4, -1]
                along, across = along + sign * found[2], across + sign * found[3]
            if terms.whole[3, r] != 0.0:
                across -= terms.whole[3, r] * math.exp(s[0, i])
            slopes[begin + i, 0], slopes[begin + i, 1] = along, across


@inner
def loop_block(terms, direct, r, low, high, count, is_phase):
    """`loop_at` of loop r on cells, as `bode_block`: of ln|L| or arg L, whichever is asked for, value and bound."""
    s = bode_block(terms, r, low, high, count, True, is_phase)
    if not direct.sampled or s[_OMEGA, 0] == 0.0 or s[_OMEGA, count - 1] == 0.0:
        for i in range(count):
            s[GAIN, i], s[PHASE, i] = direct_at(direct, r, s[U, i], s[GAIN, i], s[PHASE, i])
        return s
    filled, t = min((count + 15) // 16 * 16, BLOCK), np.empty((8, BLOCK))
    for i in range(filled):
        #  delta, as in `controller_at`
        n = math.exp(-abs(s[U, i]))
        real, imag = -2.0 / (1.0 + n * n), 2.0 * n / (1.0 + n * n)
        t[0, i], t[1, i] = real * (n * n) if s[U, i] < 0.0 else real, imag
        t[2, i], t[3, i], t[4, i], t[5, i], t[6, i], t[7, i] = direct.feedthrough, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(direct.sections.shape[1]):
        pole, residue = direct.sections[0, k], direct.sections[1, k]
        for i in range(filled):
            x, y = t[0, i] - pole, t[1, i]
            factor = residue / (x * x + y * y)
            t[2, i] += factor * x
            t[3, i] -= factor * y
    for k in range(direct.numerator.shape[1]):
        coefficient = direct.numerator[r, k]
        for i in range(filled):
            x, y, a, b = t[0, i], t[1, i], t[4, i], t[5, i]
            t[4, i], t[5, i] = a * x - b * y + coefficient, a * y + b * x
    for k in range(direct.denominator.shape[1]):
        coefficient = direct.denominator[r, k]
        for i in range(filled):
            x, y, a, b = t[0, i], t[1, i], t[6, i], t[7, i]
            t[6, i], t[7, i] = a * x - b * y + coefficient, a * y + b * x
    for i in range(filled):
        p, q, a, b, c, d = t[2, i], t[3, i], t[4, i], t[5, i], t[6, i], t[7, i]
        real, imag = a * c + b * d, b * c - a * d
        t[0, i], t[1, i] = p * real - q * imag, p * imag + q * real
        t[2, i] = math.sqrt(p * p + q * q) * math.sqrt(a * a + b * b) / math.sqrt(c * c + d * d)
    for i in range(count):
        s[GAIN, i], s[PHASE, i] = _direct(
            direct, r, is_phase, t[0, i], t[1, i], t[2, i], s[_OMEGA, i], s[GAIN, i], s[PHASE, i]
        )
    return s


@inner
def _direct(direct, r, is_phase, real, imag, size, nu, gain, phase):
    """What `direct_at` does after controller and polynomials, of a loop on samples."""
    if not 0.0 < size < np.inf or (real == 0.0 and imag == 0.0) or not math.isfinite(real) or not math.isfinite(imag):
        return gain, phase
    if not is_phase:
        return math.log(size), phase
    angle = math.atan2(imag, real) - 2.0 * direct.late[r] * math.atan(nu)
    return gain, angle + 2.0 * math.pi * np.round((phase - angle) / (2.0 * math.pi))
