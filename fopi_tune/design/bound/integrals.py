"""The integral of a cell's controllers over its range of alpha:  s^-alpha, or the filter F of samples (compiled).

With l = ln F(alpha) at one frequency, lambda = -dl/d alpha at the centre and |d2l/d alpha2| <= mu over the whole range,

    |l(alpha) - l(centre)| <= max of both ends + mu reach^2/8 ,    |dl/d alpha| <= |lambda| + mu reach .            (1)

In continuous time l = -alpha ln(j omega): lambda = ln(j omega), mu = 0, and (1) holds with equality.  On samples

    dl/d alpha = g' + sum of +- d w ,   d2l/d alpha2 = g'' + sum of +- (d^2 w (1 - w) + d' w) ,   w = z/(s + z) ,   (2)

over zeros (+) and poles (-), d and d' the derivatives of ln z, and |w (1 - w)| = z omega/(z^2 + omega^2) at
s = j omega.  Narrow ranges take mu from both ends and the centre, with a factor; wide ones the sum of the terms'
largest sizes.  With alpha zeros rise and poles fall in every method, so that arg F falls.

Source: derived; the error of linear interpolation, and (2) of `global_search/samples.py`.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import compiled
from fopi_tune.design.global_search.controllers import CORNERS, GAIN, controller_of, filter_at, integral_at_real

_PI = math.pi
#: rows of a cell's integral at each frequency: F and |F| at the centre, lambda, the largest |dl/d alpha|, mu, how much
#: l and its real part change at most, and the smallest and the largest arg F
F_REAL, F_IMAG, F_SIZE, RATE_REAL, RATE_IMAG, RATE, BEND, CHANGE, GAIN_CHANGE, ANGLE, LOWEST, HIGHEST = range(12)
INTEGRALS = 12
#: what is known at a real s: F at the centre, its largest value, d ln F/d alpha, and as above
H_VALUE, H_LARGEST, H_SLOPE, H_RATE, H_BEND, H_CHANGE = range(6)
#: relative to alpha, of central differences
_STEP = 1e-4
#: what values at both ends and the centre of a narrow range are multiplied by to bound what lies between
_SAFE = 1.5
#: half-width of alpha up to which a range is narrow
_NARROW = 0.2


@compiled
def filters_over(alpha, reach, sampling):
    """The controller's numbers at the least alpha, the centre and the largest, shape (3, 3, numbers).

    Along the second axis:  the numbers themselves, and the first and second derivative of their ln with respect to
    alpha.  In continuous time there are none, and the array is empty.
    """
    if sampling.half == 0.0:
        return np.empty((3, 3, 0))
    x = np.array((1.0, 1.0, alpha))
    found = np.empty((3, 3, CORNERS + len(sampling.corners)))
    for t in range(3):
        x[2] = alpha + (t - 1) * reach
        here, step = x[2], _STEP * x[2]
        at = controller_of(x, sampling)
        x[2] = here + step
        above = controller_of(x, sampling)
        x[2] = here - step
        below = controller_of(x, sampling)
        for k in range(len(at)):
            found[t, 0, k] = at[k]
            if k < GAIN:
                continue
            up, down = math.log(above[k] / at[k]), math.log(at[k] / below[k])
            found[t, 1, k], found[t, 2, k] = 0.5 * (up + down) / step, (up - down) / (step * step)
    return found


@compiled
def _angle(real, imag):
    """arg F between -3/2 pi and pi/2."""
    angle = math.atan2(imag, real)
    return angle - 2.0 * _PI if angle > 0.5 * _PI else angle


@compiled
def _bend(largest, spread, most, reach):
    """mu from the largest second derivative at three alphas, how much they differ, and the terms' largest sizes."""
    return most if reach > _NARROW else min(most, _SAFE * largest + spread)


@compiled
def integral_over(alpha, reach, v, filters, out):
    """Write the rows of a cell's integral at s = j e^v.

    Args:
        alpha, reach: the range's centre and half-width.
        v: the frequency.
        filters: of `filters_over`.
        out: shape (INTEGRALS,).
    """
    if filters.shape[2] == 0:
        size = math.exp(-alpha * v)
        out[F_REAL], out[F_IMAG] = size * math.cos(0.5 * _PI * alpha), -size * math.sin(0.5 * _PI * alpha)
        out[F_SIZE], out[RATE_REAL], out[RATE_IMAG], out[BEND] = size, v, 0.5 * _PI, 0.0
        out[RATE] = math.sqrt(v * v + 0.25 * _PI * _PI)
        out[CHANGE], out[GAIN_CHANGE], out[ANGLE] = out[RATE] * reach, abs(v) * reach, 0.5 * _PI * reach
        out[LOWEST], out[HIGHEST] = -0.5 * _PI * (alpha + reach), -0.5 * _PI * (alpha - reach)
        return
    omega = math.exp(v)
    square = omega * omega
    real, imag = filter_at(filters[1, 0], omega)
    size, angle = math.sqrt(real * real + imag * imag), _angle(real, imag)
    # the second derivative at the three alphas, and the sum of its terms' largest sizes
    bends, most, middle = np.empty((3, 2)), 0.0, np.zeros(2)
    for t in range(3):
        bends[t, 0], bends[t, 1] = filters[t, 2, GAIN], 0.0
        most = max(most, _SAFE * abs(filters[t, 2, GAIN]))
    middle[0] = filters[1, 1, GAIN]
    sign = 1.0
    for k in range(CORNERS, filters.shape[2]):
        bump, weight, first, second = 0.0, 0.0, 0.0, 0.0
        for t in range(3):
            z, d, more = filters[t, 0, k], filters[t, 1, k], filters[t, 2, k]
            inverse = 1.0 / (z * z + square)
            part, mixed = z * z * inverse, z * omega * inverse
            bends[t, 0] += sign * (d * d * 2.0 * mixed * mixed + more * part)
            bends[t, 1] += sign * (d * d * mixed * (2.0 * part - 1.0) - more * mixed)
            if t == 1:
                middle[0] += sign * d * part
                middle[1] -= sign * d * mixed
            bump, weight = max(bump, mixed), max(weight, part)
            first, second = max(first, d * d), max(second, abs(more))
        if (filters[0, 0, k] - omega) * (filters[2, 0, k] - omega) < 0.0:
            bump = 0.5
        most += first * bump + second * math.sqrt(weight)
        sign = -sign
    largest = spread = 0.0
    for t in range(3):
        largest = max(largest, math.sqrt(bends[t, 0] ** 2 + bends[t, 1] ** 2))
        spread = max(spread, math.sqrt((bends[t, 0] - bends[1, 0]) ** 2 + (bends[t, 1] - bends[1, 1]) ** 2))
    bend = _bend(largest, spread, most, reach)
    out[F_REAL], out[F_IMAG], out[F_SIZE], out[BEND] = real, imag, size, bend
    out[RATE_REAL], out[RATE_IMAG] = -middle[0], -middle[1]
    out[RATE] = math.sqrt(middle[0] ** 2 + middle[1] ** 2) + bend * reach
    change, gain_change = 0.0, 0.0
    out[LOWEST] = out[HIGHEST] = angle
    for t in (0, 2):
        if reach == 0.0:
            break
        real, imag = filter_at(filters[t, 0], omega)
        gain, turned = math.log(math.sqrt(real * real + imag * imag) / size), _angle(real, imag)
        change = max(change, math.sqrt(gain * gain + (turned - angle) ** 2))
        gain_change = max(gain_change, abs(gain))
        out[LOWEST], out[HIGHEST] = min(out[LOWEST], turned), max(out[HIGHEST], turned)
    beyond = 0.125 * bend * reach * reach
    out[CHANGE], out[GAIN_CHANGE] = change + beyond, gain_change + beyond
    out[ANGLE] = max(out[HIGHEST] - angle, angle - out[LOWEST])


@compiled
def real_integral_over(alpha, reach, log_s, filters, out):
    """Write what is known of a cell's integral at a real s.

    Args:
        alpha, reach: the range's centre and half-width.
        log_s: ln s.
        filters: of `filters_over`.
        out: shape (6,).
    """
    if filters.shape[2] == 0:
        out[H_VALUE], out[H_SLOPE], out[H_RATE], out[H_BEND] = math.exp(-alpha * log_s), -log_s, abs(log_s), 0.0
        out[H_CHANGE] = abs(log_s) * reach
        out[H_LARGEST] = math.exp(-alpha * log_s + out[H_CHANGE])
        return
    s, value = math.exp(log_s), integral_at_real(filters[1, 0], log_s)
    largest = spread = most = highest = change = slope = 0.0
    bends = np.empty(3)
    for t in range(3):
        bends[t] = filters[t, 2, GAIN]
        most = max(most, _SAFE * abs(bends[t]))
        here = integral_at_real(filters[t, 0], log_s)
        highest, change = max(highest, here), max(change, abs(math.log(here / value)))
    slope, sign = filters[1, 1, GAIN], 1.0
    for k in range(CORNERS, filters.shape[2]):
        bump, weight, first, second = 0.0, 0.0, 0.0, 0.0
        for t in range(3):
            d, more, w = filters[t, 1, k], filters[t, 2, k], filters[t, 0, k] / (s + filters[t, 0, k])
            bends[t] += sign * (d * d * w * (1.0 - w) + more * w)
            slope += sign * d * w if t == 1 else 0.0
            bump, weight = max(bump, w * (1.0 - w)), max(weight, w)
            first, second = max(first, d * d), max(second, abs(more))
        if (filters[0, 0, k] - s) * (filters[2, 0, k] - s) < 0.0:
            bump = 0.25
        most += first * bump + second * weight
        sign = -sign
    for t in range(3):
        largest, spread = max(largest, abs(bends[t])), max(spread, abs(bends[t] - bends[1]))
    bend = _bend(largest, spread, most, reach)
    beyond = 0.125 * bend * reach * reach
    out[H_VALUE], out[H_SLOPE], out[H_RATE], out[H_BEND] = value, slope, abs(slope) + bend * reach, bend
    out[H_CHANGE], out[H_LARGEST] = change + beyond, highest * math.exp(beyond)
