"""Linear rows of what is read at crossings:  margins, their spreads, and the spread of the crossover (compiled).

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

from fopi_tune.design.bound.cells import ALPHA_IMAG, DOWN, PSI_IMAG, REST, ROOM, UP
from fopi_tune.design.bound.polygon import add_row
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CROSSOVER_SPREAD,
    DELAY_MARGIN,
    GAIN_MARGIN,
    MARGIN_SPREAD,
    PHASE_MARGIN,
    compiled,
)
from fopi_tune.design.global_search.responses import copy_into, crossing_near, loop_at

_PI = math.pi
#: what (1) says: y at the crossing (three slopes over the box's half-widths), its rest, v0, D, y_v, y_vv's part, m_v's
VALUE, BY_KAPPA, BY_ALPHA, BY_PSI, ERROR, AT, REACH, DV_KAPPA, DV_ALPHA, DV_PSI, DV_ERROR = range(11)
SIZE = 11
_STEP = 1e-4
_LONGEST = 1.0
#: ln of how far from a known crossover the table is trusted to show no other one
_AROUND_KNOWN = 0.5
#: what differences at the ends of a reach are multiplied by to bound what lies between
_SAFE = 1.5


@compiled
def _controller_slopes(x, signs, half, v, slopes):
    """f_alpha and f_psi (real, imaginary) at v, and what they leave of f over the half-widths."""
    alpha, k = x[2], math.sqrt(x[0] * x[0] + x[1] * x[1])
    c, s = x[0] / k, x[1] / k
    q_size = math.exp(-alpha * v)
    q = complex(q_size * math.cos(0.5 * _PI * alpha), -q_size * math.sin(0.5 * _PI * alpha))
    turned = complex(v, 0.5 * _PI)
    value = c + s * q
    part = s * q / value
    by_alpha = -turned * part
    # c' = -sin psi sign_p, s' = cos psi sign_i
    by_psi = (-abs(s) * signs[0] + abs(c) * signs[1] * q) / value
    square = abs(value) ** 2
    log_size = abs(turned)
    radius = abs(by_alpha) * half[1] + abs(by_psi) * half[2]
    slopes[0], slopes[1], slopes[2], slopes[3] = by_alpha.real, by_alpha.imag, by_psi.real, by_psi.imag
    if radius > 0.5:
        slopes[4] = np.inf
        return
    grown = math.exp(abs(v) * half[1]) / (1.0 - radius) ** 4
    product = min(0.5, abs(c * s) + half[2])
    slopes[4] = grown * (
        0.5 * log_size * log_size * product * q_size / square * half[1] ** 2
        + log_size * q_size / square * half[1] * half[2]
        + 0.5
        * (abs(1.0 + q * q) + q_size * q_size * (math.exp(2.0 * log_size * half[1]) - 1.0))
        / square
        * half[2] ** 2
    )


@compiled
def implicit(of_gain, x, signs, plant, half, v, near, offset, low_v, high_v, out):
    """(1) at the crossing near v: whether there is one in the whole box; y is the phase + offset, or ln|L|.

    Args:
        of_gain: whether the crossing is one of |L| = 1; else one of phase + offset = 0.
        x: kp', ki', alpha of the box's centre.
        signs: of kp and ki.
        plant: its 19 coefficients.
        half: half-widths of kappa, alpha and psi.
        v, near: where the centre's crossing is, and the phase's branch there.
        offset: added to the phase.
        low_v, high_v: the range of the grid.
        out: what (1) says.
    """
    slopes, above, under = np.empty(5), np.empty(5), np.empty(5)
    _controller_slopes(x, signs, half, v, slopes)
    if not slopes[4] < 0.3:
        return False
    gain, phase, _ = loop_at(x, plant, v, near)
    gain_up, phase_up, _ = loop_at(x, plant, v + _STEP, near)
    gain_down, phase_down, _ = loop_at(x, plant, v - _STEP, near)
    gain_v, phase_v = 0.5 * (gain_up - gain_down) / _STEP, 0.5 * (phase_up - phase_down) / _STEP
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
        _controller_slopes(x, signs, half, v + reach, above)
        _controller_slopes(x, signs, half, v - reach, under)
        both = _SAFE * max(slopes[4], above[4], under[4])
        for part in range(2):
            by_alpha = max(abs(above[part] - slopes[part]), abs(under[part] - slopes[part])) * half[1]
            by_psi = max(abs(above[2 + part] - slopes[2 + part]), abs(under[2 + part] - slopes[2 + part])) * half[2]
            rest = both + _SAFE * (by_alpha + by_psi + (gain_bend if part == 0 else phase_bend))
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
    out[BY_KAPPA], out[BY_ALPHA], out[BY_PSI] = y[0] - ratio * m[0], y[1] - ratio * m[1], y[2] - ratio * m[2]
    out[ERROR] = rest_y + abs(ratio) * rest_m
    out[AT], out[REACH] = v - m0 / m_v, reach
    out[DV_KAPPA], out[DV_ALPHA], out[DV_PSI], out[DV_ERROR] = -m[0] / m_v, -m[1] / m_v, -m[2] / m_v, rest_m / abs(m_v)
    return True


@compiled
def _is_alone(of_gain, i, kappa, half, out, level, table, work, slopes):
    """Whether no loop of the box has another crossing (of the phase: none with |L| between level and 1)."""
    n = work.gain.shape[1]
    below = False
    for j in range(1, n - 1):
        if abs(table.v[j] - out[AT]) < out[REACH]:
            continue
        g = work.gain[i, j] + kappa
        if of_gain:
            if not (g - half[0] + slopes[DOWN, j] > 0.0 or g + half[0] + slopes[UP, j] < 0.0):
                return False
            if (g < 0.0) != (table.v[j] > out[AT]):
                return False
            continue
        if g + half[0] + slopes[UP, j] < level or g - half[0] + slopes[DOWN, j] > 0.0:
            continue
        room = slopes[ROOM, j]
        here = math.floor((work.phase[i, j] - room + _PI) / (2.0 * _PI))
        if not room < 3.0 or here != math.floor((work.phase[i, j] + room + _PI) / (2.0 * _PI)):
            return False
        if table.v[j] < out[AT]:
            return False
        below = below or j >= table.alias[i]
    return not below


@compiled
def _add(lin, count, way, out, add, limit):
    """way (value + add of (1)) <= way limit, as a row."""
    if count < 0:
        return count
    return add_row(
        lin,
        count,
        way * out[BY_KAPPA],
        way * out[BY_ALPHA],
        way * out[BY_PSI],
        way * (limit - out[VALUE] - add) + out[ERROR],
    )


@compiled
def _size(out):
    return abs(out[BY_KAPPA]) + abs(out[BY_ALPHA]) + abs(out[BY_PSI]) + out[ERROR]


@compiled
def _margin_rows(kind, side, limit, alone, out, moved, lin, count):
    """Rows of a phase or delay margin whose lag to -1 is y of `out`."""
    reach = _size(out)
    low, high = out[VALUE] - reach, out[VALUE] + reach
    if low <= -_PI or high >= _PI:
        return count
    if kind == DELAY_MARGIN:
        if low <= 0.0:
            return count
        # lag - limit omega e^dv, of which e^dv = 1 + dv + at most dv^2 e^D/2
        omega = limit * math.exp(out[AT])
        copy_into(out, moved)
        moved[VALUE] -= omega
        for a, b in ((BY_KAPPA, DV_KAPPA), (BY_ALPHA, DV_ALPHA), (BY_PSI, DV_PSI)):
            moved[a] -= omega * out[b]
        moved[ERROR] += omega * (out[DV_ERROR] + 0.5 * out[REACH] ** 2 * math.exp(out[REACH]))
        if side <= 0:
            count = _add(lin, count, -1.0, moved, 0.0, 0.0)
        if side >= 0 and alone:
            count = _add(lin, count, 1.0, moved, 0.0, 0.0)
        return count
    if side <= 0:
        above, under = high >= limit, low <= -limit
        if above != under or not above:
            # |lag| >= limit on the one side that the box reaches
            count = _add(lin, count, 1.0 if under else -1.0, out, 0.0, -limit if under else limit)
    if side >= 0 and alone:
        count = _add(lin, count, 1.0, out, 0.0, limit)
        count = _add(lin, count, -1.0, out, 0.0, -limit)
    return count


@compiled
def _at_known_crossover(j, half, table, work, slopes, out):
    """(1) of the nominal plant where an equality says its crossover:  the phase there, mod 360 deg in (-180, 180]."""
    phase = work.phase[0, j] + _PI
    out[VALUE] = phase - 2.0 * _PI * math.floor(phase / (2.0 * _PI) + 0.5)
    out[BY_KAPPA], out[BY_ALPHA], out[BY_PSI] = 0.0, slopes[ALPHA_IMAG, j] * half[1], slopes[PSI_IMAG, j] * half[2]
    out[ERROR], out[AT], out[REACH] = slopes[REST, j], table.v[j], 0.0
    out[DV_KAPPA] = out[DV_ALPHA] = out[DV_PSI] = out[DV_ERROR] = 0.0


@compiled
def _needs(kind, rows, i):
    for q in range(len(rows.kind)):
        if rows.kind[q] == kind and (i == 0 or not (rows.nominal[q] or rows.side[q] == 0)):
            return True
    return False


@compiled
def _spread_rows(code, target, x, one, two, first, other, apart, lin, count):
    """Rows of a spread between the nominal plant's only crossing `first` and another plant's `other`."""
    if code == MARGIN_SPREAD:
        reach = max(_size(first), _size(other))
        if abs(first[VALUE]) <= reach or abs(other[VALUE]) <= reach:
            return count
        side, nominal_side = math.copysign(1.0, other[VALUE]), math.copysign(1.0, first[VALUE])
        for k in (VALUE, BY_KAPPA, BY_ALPHA, BY_PSI):
            apart[k] = side * other[k] - nominal_side * first[k]
        apart[ERROR] = other[ERROR] + first[ERROR]
        count = _add(lin, count, 1.0, apart, 0.0, target)
        return _add(lin, count, -1.0, apart, 0.0, -target)
    # ln|L_i| at the nominal crossover is ln|P_i/P_0| there, a function of v alone
    gap = np.empty(5)
    v, d = first[AT], first[REACH]
    places = (v, v - _STEP, v + _STEP, v - d, v + d)
    for r in range(5):
        gap[r] = loop_at(x, two, places[r], 0.0)[0] - loop_at(x, one, places[r], 0.0)[0]
    slope = 0.5 * (gap[2] - gap[1]) / _STEP
    bend = _SAFE * max(abs(gap[3] - gap[0] + slope * d), abs(gap[4] - gap[0] - slope * d))
    a0, a1, a2 = slope * first[DV_KAPPA], slope * first[DV_ALPHA], slope * first[DV_PSI]
    rest = bend + abs(slope) * first[DV_ERROR]
    count = add_row(lin, count, a0, a1, a2, target - gap[0] + rest)
    if count < 0:
        return count
    return add_row(lin, count, -a0, -a1, -a2, target + gap[0] + rest)


@compiled
def crossing_rows(code, target, x, signs, kappa, half, table, rows, work, slopes, lin, count):
    """Rows of margins and spreads at all crossings that every loop of the box has."""
    n = work.gain.shape[1]
    spread = code in (MARGIN_SPREAD, CROSSOVER_SPREAD)
    out, first, other = np.empty(SIZE), np.empty(SIZE), np.empty(SIZE)
    nominal_alone, deepest = False, 0.0
    for q in range(len(rows.kind)):
        if rows.kind[q] == GAIN_MARGIN:
            deepest = max(deepest, rows.limit[q] + 0.1)
    for i in range(table.gain.shape[0]):
        asks_phase = _needs(PHASE_MARGIN, rows, i) or _needs(DELAY_MARGIN, rows, i)
        asks_gain = _needs(GAIN_MARGIN, rows, i)
        if spread and i > 0 and nominal_alone and code == CROSSOVER_SPREAD:
            count = _spread_rows(code, target, x, table.members[0], table.members[i], first, first, other, lin, count)
            if count < 0:
                return count
        stop = min(n - 2, table.alias[i])
        known = -1
        for q in range(len(rows.kind)):
            if i == 0 and rows.kind[q] == CROSSOVER and rows.side[q] == 0:
                known = rows.first[q]
        if known > 0 and slopes[REST, known] < np.inf:
            _at_known_crossover(known, half, table, work, slopes, out)
            out[REACH] = _AROUND_KNOWN
            nominal_alone = _is_alone(True, 0, kappa, half, out, 0.0, table, work, slopes)
            out[REACH] = 0.0
            copy_into(out, first)
            for q in range(len(rows.kind)):
                if rows.kind[q] == PHASE_MARGIN:
                    count = _margin_rows(
                        PHASE_MARGIN, rows.side[q], rows.limit[q], nominal_alone, out, other, lin, count
                    )
                    if count < 0:
                        return count
        for j in range(1, stop):
            for of_gain in (True, False):
                asks = asks_phase or (spread and (i == 0 or code == MARGIN_SPREAD)) if of_gain else asks_gain
                if not asks:
                    continue
                if of_gain:
                    a, b, level = work.gain[i, j] + kappa, work.gain[i, j + 1] + kappa, 0.0
                else:
                    level = math.floor(0.5 * (work.phase[i, j] + work.phase[i, j + 1] + 2.0 * _PI) / (2.0 * _PI) + 0.5)
                    a, b = work.phase[i, j] + _PI - 2.0 * _PI * level, work.phase[i, j + 1] + _PI - 2.0 * _PI * level
                if (a > 0.0) == (b > 0.0) or a == b:
                    continue
                if not of_gain:
                    # without a say where |L| is far above 1, or below all limits
                    largest = max(work.gain[i, j] + slopes[UP, j], work.gain[i, j + 1] + slopes[UP, j + 1])
                    smallest = min(work.gain[i, j] + slopes[DOWN, j], work.gain[i, j + 1] + slopes[DOWN, j + 1])
                    if largest + kappa + half[0] < -deepest or smallest + kappa - half[0] > 0.0:
                        continue
                v = table.v[j] + a / (a - b) * (table.v[j + 1] - table.v[j])
                near = work.phase[i, j] + table.omega[j] * table.delay[i]
                if of_gain:
                    v = crossing_near(0, 0.0, x, table.members[i], v, near)
                    phase = loop_at(x, table.members[i], v, near)[1]
                    level = math.floor(
                        (phase + _PI) / (2.0 * _PI) + (0.5 if not _needs(DELAY_MARGIN, rows, i) else 0.0)
                    )
                else:
                    v = crossing_near(1, 2.0 * _PI * level - _PI, x, table.members[i], v, near)
                offset = _PI - 2.0 * _PI * level
                if not table.v[1] < v < table.v[n - 2]:
                    continue
                if not implicit(
                    of_gain, x, signs, table.members[i], half, v, near, offset, table.v[1], table.v[n - 2], out
                ):
                    continue
                alone = of_gain and _is_alone(True, i, kappa, half, out, 0.0, table, work, slopes)
                if of_gain and spread and i == 0 and known < 0:
                    copy_into(out, first)
                    nominal_alone = alone
                if of_gain and code == MARGIN_SPREAD and i > 0 and alone and nominal_alone:
                    count = _spread_rows(
                        code, target, x, table.members[0], table.members[i], first, out, other, lin, count
                    )
                    if count < 0:
                        return count
                for q in range(len(rows.kind)):
                    kind, side, limit = rows.kind[q], rows.side[q], rows.limit[q]
                    if i > 0 and (rows.nominal[q] or side == 0):
                        continue
                    if of_gain and kind in (PHASE_MARGIN, DELAY_MARGIN):
                        count = _margin_rows(kind, side, limit, alone, out, other, lin, count)
                    elif not of_gain and kind == GAIN_MARGIN:
                        reach = _size(out)
                        if side <= 0 and out[VALUE] + reach < 0.0:
                            count = _add(lin, count, 1.0, out, 0.0, -limit)
                        if side >= 0 and _is_alone(False, i, kappa, half, out, -limit, table, work, slopes):
                            count = _add(lin, count, -1.0, out, 0.0, -limit)
                    if count < 0:
                        return count
    return count
