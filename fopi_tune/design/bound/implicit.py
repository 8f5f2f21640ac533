"""The crossing that all loops of a box have near one of the centre's, and what is read there (compiled).

A function m(z, v), ln|L| or the phase's distance from a passage of -180 deg, vanishes at a crossing.  Around a point v0
close to it, for all z of a box and |dv| <= D with rest terms rho of second order,

    m0 + m_z dz + m_v dv + rho_m = 0 ,    y = y0 + y_z dz + y_v dv + rho_y
    =>  y = y0 - (y_v/m_v) m0 + (y_z - (y_v/m_v) m_z) dz + rho ,    |rho| <= |rho_y| + |y_v/m_v| |rho_m| .           (1)

Every loop of the box has such a crossing where |m_v| D exceeds |m0| and all that the box adds.  The derivatives in v
are differences of the plant's exact response.

Source: derived; the implicit function's derivative.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.derivative_cells import slopes_with_derivative
from fopi_tune.design.bound.integrals import (
    BEND,
    CHANGE,
    F_IMAG,
    F_REAL,
    F_SIZE,
    GAIN_CHANGE,
    INTEGRALS,
    RATE,
    RATE_IMAG,
    RATE_REAL,
    integral_over,
)
from fopi_tune.design.global_search.compiled import compiled
from fopi_tune.design.global_search.controllers import FILTER
from fopi_tune.design.global_search.responses import loop_at

#: what (1) says: y at the crossing (three slopes over the box's half-widths), its rest, v0, D, y_v, y_vv's part, m_v's
VALUE, BY_KAPPA, BY_SHAPE, BY_PSI, ERROR, AT, REACH, DV_KAPPA, DV_SHAPE, DV_PSI, DV_ERROR = range(11)
SIZE = 11
#: of differences in v
STEP = 1e-4
#: what differences at the ends of a reach are multiplied by to bound what lies between
SAFE = 1.5
_LONGEST = 1.0


@compiled
def controller_slopes(x, signs, half, v, filters, q, slopes):
    """f_shape and f_psi (real, imaginary) at v, and what they leave of f over the half-widths, as in `cells`."""
    if len(x) > 3 and x[FILTER] > 0.0:
        slopes_with_derivative(x, signs, half, v, slopes)
        return
    k = math.sqrt(x[0] * x[0] + x[1] * x[1])
    c, s = x[0] / k, x[1] / k
    integral_over(x[2], half[1], v, filters, q)
    value, integral = complex(c + s * q[F_REAL], s * q[F_IMAG]), complex(q[F_REAL], q[F_IMAG])
    by_shape = -complex(q[RATE_REAL], q[RATE_IMAG]) * (s * integral / value)
    # c' = -sin psi sign_p, s' = cos psi sign_i
    by_psi = (-abs(s) * signs[0] + abs(c) * signs[1] * integral) / value
    square, rate = abs(value) ** 2, q[RATE]
    radius = abs(by_shape) * half[1] + abs(by_psi) * half[2]
    slopes[0], slopes[1], slopes[2], slopes[3] = by_shape.real, by_shape.imag, by_psi.real, by_psi.imag
    if radius > 0.5:
        slopes[4] = np.inf
        return
    grown = math.exp(q[GAIN_CHANGE]) / (1.0 - radius) ** 4
    product, largest = min(0.5, abs(c * s) + half[2]), min(1.0, abs(s) + half[2])
    slopes[4] = grown * (
        0.5 * rate * rate * product * q[F_SIZE] / square * half[1] ** 2
        + 0.5 * q[BEND] * largest * q[F_SIZE] / abs(value) * half[1] ** 2
        + rate * q[F_SIZE] / square * half[1] * half[2]
        + 0.5
        * (abs(1.0 + integral * integral) + q[F_SIZE] ** 2 * (math.exp(2.0 * q[CHANGE]) - 1.0))
        / square
        * half[2] ** 2
    )


@compiled
def implicit(of_gain, x, signs, plant, half, v, near, offset, low_v, high_v, filters, out):
    """(1) at the crossing near v: whether there is one in the whole box; y is the phase + offset, or ln|L|.

    Args:
        of_gain: whether the crossing is one of |L| = 1; else one of phase + offset = 0.
        x: kp', ki' and alpha, or kd', of the box's centre, as `controller_of` completes them.
        signs: of kp, ki and kd.
        plant: its 21 coefficients.
        half: half-widths of kappa, of alpha or theta, and of psi.
        v, near: where the centre's crossing is, and the phase's branch there.
        offset: added to the phase.
        low_v, high_v: the range of the grid.
        filters: of the box, of `filters_over`.
        out: what (1) says.
    """
    slopes, above, under, q = np.empty(5), np.empty(5), np.empty(5), np.empty(INTEGRALS)
    controller_slopes(x, signs, half, v, filters, q, slopes)
    if not slopes[4] < 0.3:
        return False
    gain, phase, _ = loop_at(x, plant, v, near)
    gain_up, phase_up, _ = loop_at(x, plant, v + STEP, near)
    gain_down, phase_down, _ = loop_at(x, plant, v - STEP, near)
    gain_v, phase_v = 0.5 * (gain_up - gain_down) / STEP, 0.5 * (phase_up - phase_down) / STEP
    phase += offset
    g = (half[0], slopes[0] * half[1], slopes[2] * half[2])
    p = (0.0, slopes[1] * half[1], slopes[3] * half[2])
    m0, m, m_v = (gain, g, gain_v) if of_gain else (phase, p, phase_v)
    y0, y, y_v = (phase, p, phase_v) if of_gain else (gain, g, gain_v)
    if abs(m_v) < 1e-3:
        return False
    needed = abs(m0) + abs(m[0]) + abs(m[1]) + abs(m[2]) + slopes[4]
    reach, rest_m, rest_y = 1.1 * needed / abs(m_v) + 1e-4, 0.0, 0.0
    for _ in range(5):
        if reach > _LONGEST or v - reach < low_v or v + reach > high_v:
            return False
        gain_up, phase_up, _ = loop_at(x, plant, v + reach, near)
        gain_down, phase_down, _ = loop_at(x, plant, v - reach, near)
        gain_bend = max(abs(gain_up - gain - gain_v * reach), abs(gain_down - gain + gain_v * reach))
        phase_bend = max(
            abs(phase_up + offset - phase - phase_v * reach), abs(phase_down + offset - phase + phase_v * reach)
        )
        controller_slopes(x, signs, half, v + reach, filters, q, above)
        controller_slopes(x, signs, half, v - reach, filters, q, under)
        both = SAFE * max(slopes[4], above[4], under[4])
        for part in range(2):
            by_shape = max(abs(above[part] - slopes[part]), abs(under[part] - slopes[part])) * half[1]
            by_psi = max(abs(above[2 + part] - slopes[2 + part]), abs(under[2 + part] - slopes[2 + part])) * half[2]
            rest = both + SAFE * (by_shape + by_psi + (gain_bend if part == 0 else phase_bend))
            if (part == 0) == of_gain:
                rest_m = rest
            else:
                rest_y = rest
        if abs(m_v) * reach > needed + rest_m:
            break
        reach *= 1.5
    if not abs(m_v) * reach > needed + rest_m:
        return False
    ratio = y_v / m_v
    out[VALUE] = y0 - ratio * m0
    out[BY_KAPPA], out[BY_SHAPE], out[BY_PSI] = y[0] - ratio * m[0], y[1] - ratio * m[1], y[2] - ratio * m[2]
    out[ERROR] = rest_y + abs(ratio) * rest_m
    out[AT], out[REACH] = v - m0 / m_v, reach
    out[DV_KAPPA], out[DV_SHAPE], out[DV_PSI], out[DV_ERROR] = -m[0] / m_v, -m[1] / m_v, -m[2] / m_v, rest_m / abs(m_v)
    return True
