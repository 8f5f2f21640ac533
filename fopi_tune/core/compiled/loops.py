"""Responses of loops at one frequency, in scalars (compiled).

The numbers are those of `BodeForm`, its formulas (1) to (3), with one logarithm and one arc tangent a point instead of
one a factor: of factors with a sign of +-1 the product is taken, and the whole turns of its phase are counted as it is
multiplied up.  The bound of the curvature is that of `BodeForm.gain_curvature_bound`.

This module imports Numba: import it where it is needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from fopi_tune.core.compiled.kept import kept, sources

#: as in `bode_form`
_EXPONENT_CAP, _BOUND_CAP = 700.0, math.exp(300.0)
#: |u| and |corner| up to which e^u and e^-corner are multiplied
NEAR_ONE = 300.0
#: of a sum of cancelling second derivatives
_ROUNDING = 1e-14
#: as in `sampled_loops`
_U_CAP = 600.0


class Terms(NamedTuple):
    """m functions in Bode form, as in `BodeForm.terms`.

    Fields: `whole`, shape (4, m), `factors`, shape (7, m, K), and `sums`, shape (F m, 6, n), the F factors of
    `power_sums.py` of all rows in turn; (0, 6, 5) where there are none.
    """

    whole: Any
    factors: Any
    sums: Any


class Direct(NamedTuple):
    """What m loops are computed from directly.

    Fields: `gains`, shape (6, m), kp, ki, alpha, kd, Tf and mu of a continuous loop, kd 0 without a derivative;
    `sections`, shape (2, n), poles - 1 and residues of a digital controller, and its `feedthrough`; polynomials of
    shapes (m, a) and (m, b); `late`, shape (m,), the dead time in s, on samples the delay in samples; `sampled`,
    whether the loop is one on samples.
    """

    gains: Any
    sections: Any
    feedthrough: float
    numerator: Any
    denominator: Any
    late: Any
    sampled: bool


#: compiled into what calls it
inner: Any = njit(error_model="numpy")
_SOURCES = sources(Path(__file__).parent.glob("*.py"))


def entry(function: Callable[..., Any]) -> Any:
    """What Python calls: compiled, and kept in Numba's cache where there is one."""
    return kept(function, _SOURCES, error_model="numpy")


@inner
def power_of(factors, r, k, u, omega):
    """ln|w| of a factor at u, and the smaller one of |w| and 1/|w|; `omega` is e^u, or 0 where that is far from 1."""
    x = min(max(factors[0, r, k] * (u - factors[1, r, k]), -_EXPONENT_CAP), _EXPONENT_CAP)
    if omega > 0.0 and factors[6, r, k] > 0.0:
        ratio = omega * factors[6, r, k]
        return x, (1.0 / ratio if x > 0.0 else ratio)
    return x, math.exp(-abs(x))


@inner
def frequency_of(u):
    """e^u where that and its products with corners stay finite, else 0."""
    return math.exp(u) if abs(u) < NEAR_ONE else 0.0


@inner
def power_sum_at(sums, r, u, h):
    """ln G of (1) in `power_sums.py` at u, its derivative and bounds on [u - h, u + h].

    Returns:
        ln|G| and arg G, their slopes; the second derivatives of both; bounds of the absolute values of the second and
        of the third derivative of ln G, 0 where h is.
    """
    most, k = -np.inf, 0
    for j in range(sums.shape[2]):
        size = sums[r, 1, j] + sums[r, 0, j] * u
        if size > most:
            most, k = size, j
    largest = sums[r, 0, k]
    real = imag = first_real = first_imag = second_real = second_imag = 0.0
    steep = bent = twisted = others = 0.0
    for j in range(sums.shape[2]):
        size = math.exp(sums[r, 1, j] + sums[r, 0, j] * u - most)
        if size == 0.0:
            continue
        d = sums[r, 0, j] - largest
        x, y = size * sums[r, 2, j], size * sums[r, 3, j]
        real, imag = real + x, imag + y
        first_real, first_imag = first_real + d * x, first_imag + d * y
        second_real, second_imag = second_real + d * d * x, second_imag + d * d * y
        if h > 0.0 and j != k:
            far = size * math.exp(min(abs(d) * h, _EXPONENT_CAP))
            others += far
            d = abs(d)
            steep, bent, twisted = steep + d * far, bent + d * d * far, twisted + d * d * d * far
    square = max(real * real + imag * imag, 1e-300)
    below = 0
    while below < sums.shape[2] - 1 and u > sums[r, 4, below]:
        below += 1
    angle = math.atan2(imag, real)
    angle += 2.0 * math.pi * np.round(((sums[r, 5, below] + 0.5) * math.pi - angle) / (2.0 * math.pi))
    m_real = (first_real * real + first_imag * imag) / square
    m_imag = (first_imag * real - first_real * imag) / square
    bend = (second_real * real + second_imag * imag) / square - m_real * m_real + m_imag * m_imag
    twist = (second_imag * real - second_real * imag) / square - 2.0 * m_real * m_imag
    bound = third = 0.0
    if h > 0.0:
        # |G| by the segment of its tangent, or by what the other terms leave of the largest
        along = -(real * first_real + imag * first_imag) / max(first_real**2 + first_imag**2, 1e-300)
        along = min(max(along, -h), h)
        least = math.hypot(real + along * first_real, imag + along * first_imag) - 0.5 * bent * h * h
        least = max(least, 1.0 - others)
        if least > 0.0:
            p, q, t = steep / least, bent / least, twisted / least
            bound, third = q + p * p, t + 3.0 * p * q + 2.0 * p * p * p
        else:
            bound = third = np.inf
    gain = most + 0.5 * math.log(square)
    return gain, angle, largest + m_real, m_imag, bend, twist, bound, third


@inner
def bode_at(terms, r, u, h):
    """ln f of function r at u, its derivative and what bounds its curvature on [u - h, u + h].

    With q = w/(1 + w) the derivatives of ln(1 + w) are nu q, nu^2 q (1 - q) and nu^3 q (1 - q) (1 - 2 q).  The second
    one at u, where the factors cancel, and a bound of the third bound the curvature on a short cell much better than
    the sum of the factors' own bounds, which serves on a long one.

    Returns:
        ln|f| and arg f, their slopes; bounds of the second derivative of ln|f|, of arg f, and of the absolute value of
        both.  The bounds are 0 where h is.
    """
    whole, factors = terms.whole, terms.factors
    gain, phase = whole[0, r] + whole[1, r] * u, whole[2, r]
    slope, turn, bound, third, bend, twist = whole[1, r], 0.0, 0.0, 0.0, 0.0, 0.0
    real, imag, top, bottom, turns = 1.0, 0.0, 1.0, 1.0, 0
    last_nu, wide, omega = -1.0, 1.0, frequency_of(u)
    for k in range(factors.shape[2]):
        nu, cosine, sine, sign = factors[0, r, k], factors[2, r, k], factors[3, r, k], factors[4, r, k]
        if sign == 0.0 or factors[1, r, k] == np.inf:
            continue
        x, small = power_of(factors, r, k, u, omega)
        along, across = 1.0 + small * cosine, small * sine
        square = along * along + across * across
        # (1 + w), or (1 + w)/|w| where |w| > 1
        if x > 0.0:
            gain += sign * x
            a, b, rho, q_real = small + cosine, sine, 1.0 / small, along / square
        else:
            a, b, rho, q_real = along, across, small, small * (small + cosine) / square
        q_imag, weight = across / square, factors[5, r, k]
        slope += weight * q_real
        turn += weight * q_imag
        if sign == 1.0 or sign == -1.0:
            if sign > 0.0:
                top *= square
            else:
                bottom *= square
                b = -b
            # adding 0 turns -0 into 0
            product_real, product_imag = real * a - imag * b, real * b + imag * a + 0.0
            if imag >= 0.0 and b >= 0.0:
                if product_imag < 0.0:
                    turns += 1
            elif imag < 0.0 and b < 0.0 and (product_imag > 0.0 or (product_imag == 0.0 and product_real < 0.0)):
                turns -= 1
            real, imag = product_real, product_imag
        else:
            gain += 0.5 * sign * math.log(square)
            phase += sign * math.atan2(b, a)
        if h > 0.0:
            weight *= nu
            bend += weight * (q_real - q_real * q_real + q_imag * q_imag)
            twist += weight * (q_imag - 2.0 * q_real * q_imag)
            if nu != last_nu:
                last_nu, wide = nu, math.exp(min(nu * h, _EXPONENT_CAP))
            high = min(max(rho * wide, 1.0 / _BOUND_CAP), _BOUND_CAP)
            low = min(max(rho / wide, 1.0 / _BOUND_CAP), _BOUND_CAP)
            # the point of the ray's piece that lies closest to -1 has |w| = -cos psi, or is an end of the piece
            closest = min(max(-cosine, low), high)
            distance = max((closest + cosine) * (closest + cosine) + sine * sine, 1e-300)
            own = abs(weight) * high / distance
            bound += own
            third += own * nu * (1.0 + high) / math.sqrt(distance)
    gain += 0.5 * math.log(top / bottom)
    phase += math.atan2(imag, real) + 2.0 * math.pi * turns
    for row in range(r, len(terms.sums), whole.shape[1]):
        sign = terms.sums[row, 4, -1]
        a, b, q_real, q_imag, x, along, own, across = power_sum_at(terms.sums, row, u, h)
        gain, phase, slope, turn = gain + sign * a, phase + sign * b, slope + sign * q_real, turn + sign * q_imag
        bend, twist, bound, third = bend + sign * x, twist + sign * along, bound + own, third + across
    turning, delay = 0.0, whole[3, r]
    if delay != 0.0:
        turned = delay * math.exp(u)
        phase -= turned
        turn -= turned
        twist -= turned
        turning = abs(delay) * math.exp(u + h)
    of_gain = of_phase = of_both = 0.0
    if h > 0.0:
        of_gain = min(bound, abs(bend) + third * h + _ROUNDING)
        of_phase = min(bound + turning, abs(twist) + (third + turning) * h + _ROUNDING)
        of_both = min(bound + turning, math.hypot(bend, twist) + (third + turning) * h + _ROUNDING)
    return gain, phase, slope, turn, of_gain, of_phase, of_both


@inner
def polynomial(coefficients, r, real, imag):
    """A row's polynomial, descending powers, at a complex number."""
    a, b = 0.0, 0.0
    for k in range(coefficients.shape[1]):
        a, b = a * real - b * imag + coefficients[r, k], a * imag + b * real
    return a, b


@inner
def controller_at(direct, r, u):
    """The controller, and the place s = j omega or delta = z - 1: four real numbers."""
    if not direct.sampled:
        power, angle = direct.gains[1, r] * math.exp(-direct.gains[2, r] * u), 0.5 * math.pi * direct.gains[2, r]
        real, imag, omega = direct.gains[0, r] + power * math.cos(angle), -power * math.sin(angle), math.exp(u)
        if direct.gains[3, r] != 0.0:
            # kd s/(Tf s + 1) = kd/(Tf + 1/s), and with another order s^(mu - 1) times that
            lag, filter_s = 1.0 / omega, direct.gains[4, r]
            factor = direct.gains[3, r] / (filter_s * filter_s + lag * lag)
            a, b = factor * filter_s, factor * lag
            if direct.gains[5, r] != 1.0:
                rest = direct.gains[5, r] - 1.0
                power, angle = math.exp(rest * u), 0.5 * math.pi * rest
                cosine, sine = power * math.cos(angle), power * math.sin(angle)
                a, b = a * cosine - b * sine, a * sine + b * cosine
            real, imag = real + a, imag + b
        return real, imag, 0.0, omega
    # delta = 2j nu/(1 - j nu) at nu = e^u, by 1/nu where that is the smaller one
    n = math.exp(-min(abs(u), _U_CAP))
    real, imag = -2.0 / (1.0 + n * n), 2.0 * n / (1.0 + n * n)
    if u < 0.0:
        real *= n * n
    a, b = direct.feedthrough, 0.0
    for k in range(direct.sections.shape[1]):
        x = real - direct.sections[0, k]
        factor = direct.sections[1, k] / (x * x + imag * imag)
        a += factor * x
        b -= factor * imag
    return a, b, real, imag


@inner
def loop_at(terms, direct, r, u, h):
    """As `bode_at` without the last bound, of a loop; its value from controller and polynomials where that is finite.

    Multiple roots, which a root finder resolves to a few digits only, do not spoil such a value.
    """
    gain, phase, slope, turn, of_gain, of_phase, _ = bode_at(terms, r, u, h)
    gain, phase = direct_at(direct, r, u, gain, phase)
    return gain, phase, slope, turn, of_gain, of_phase


@inner
def direct_at(direct, r, u, gain, phase):
    """ln|L| and arg L from controller and polynomials, on the branch of `phase`; what is given where not finite."""
    c_real, c_imag, s_real, s_imag = controller_at(direct, r, u)
    a, b = polynomial(direct.numerator, r, s_real, s_imag)
    c, d = polynomial(direct.denominator, r, s_real, s_imag)
    real, imag = a * c + b * d, b * c - a * d
    real, imag = c_real * real - c_imag * imag, c_real * imag + c_imag * real
    size = math.sqrt(c_real * c_real + c_imag * c_imag) * math.sqrt(a * a + b * b) / math.sqrt(c * c + d * d)
    if not 0.0 < size < np.inf or (real == 0.0 and imag == 0.0) or not math.isfinite(real) or not math.isfinite(imag):
        return gain, phase
    angle = math.atan2(imag, real)
    if direct.sampled:
        angle -= 2.0 * direct.late[r] * math.atan(math.exp(min(u, _EXPONENT_CAP)))
    else:
        angle -= direct.late[r] * s_imag
    turns = np.round((phase - angle) / (2.0 * math.pi))
    return math.log(size), angle + 2.0 * math.pi * turns


@entry
def values(terms, rows, u):
    """ln f and d ln f/du of functions in Bode form; rows and u of shape (n,)."""
    value, slope = np.empty(len(u), dtype=np.complex128), np.empty(len(u), dtype=np.complex128)
    for i in range(len(u)):
        gain, phase, rise, turn, _, _, _ = bode_at(terms, rows[i], u[i], 0.0)
        value[i], slope[i] = complex(gain, phase), complex(rise, turn)
    return value, slope


@entry
def loop_values(terms, direct, rows, u):
    """The same of loops, by `loop_at`."""
    value, slope = np.empty(len(u), dtype=np.complex128), np.empty(len(u), dtype=np.complex128)
    for i in range(len(u)):
        gain, phase, rise, turn, _, _ = loop_at(terms, direct, rows[i], u[i], 0.0)
        value[i], slope[i] = complex(gain, phase), complex(rise, turn)
    return value, slope


@inner
def slope_at(terms, r, u):
    """d ln|f|/du and d arg f/du of a function in Bode form."""
    factors, along, across, omega = terms.factors, terms.whole[1, r], 0.0, frequency_of(u)
    for k in range(factors.shape[2]):
        if factors[1, r, k] == np.inf:
            continue
        x, small = power_of(factors, r, k, u, omega)
        a, b = 1.0 + small * factors[2, r, k], small * factors[3, r, k]
        weight = factors[5, r, k] / (a * a + b * b)
        along += weight * (a if x > 0.0 else small * (small + factors[2, r, k]))
        across += weight * b
    for row in range(r, len(terms.sums), terms.whole.shape[1]):
        found = power_sum_at(terms.sums, row, u, 0.0)
        along, across = along + terms.sums[row, 4, -1] * found[2], across + terms.sums[row, 4, -1] * found[3]
    if terms.whole[3, r] != 0.0:
        across -= terms.whole[3, r] * math.exp(u)
    return along, across


@entry
def slopes(terms, rows, u):
    """d ln f/du of functions in Bode form; rows and u of shape (n,)."""
    slope = np.empty(len(u), dtype=np.complex128)
    for i in range(len(u)):
        along, across = slope_at(terms, rows[i], u[i])
        slope[i] = complex(along, across)
    return slope
