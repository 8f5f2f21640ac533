"""Linear rows of what is read at crossings:  margins, their spreads, and the spread of the crossover (compiled).

`implicit` has what is read at a crossing that every loop of the box has, as linear functions with a rest.  An upper
limit and a spread need that there is no other crossing; else an upper limit can only be exceeded at all of them.

Source: derived.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.columns import DOWN, PSI_IMAG, REST, ROOM, SHAPE_IMAG, UP
from fopi_tune.design.bound.implicit import (
    AT,
    BY_KAPPA,
    BY_PSI,
    BY_SHAPE,
    DV_ERROR,
    DV_KAPPA,
    DV_PSI,
    DV_SHAPE,
    ERROR,
    REACH,
    SAFE,
    SIZE,
    STEP,
    VALUE,
    implicit,
)
from fopi_tune.design.bound.margins import bulge, lag_exceeds
from fopi_tune.design.bound.polygon import add_limit, add_row
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CROSSOVER_SPREAD,
    DELAY_MARGIN,
    GAIN_MARGIN,
    MARGIN_SPREAD,
    PHASE_MARGIN,
    compiled,
)
from fopi_tune.design.global_search.controllers import controller_of
from fopi_tune.design.global_search.responses import copy_into, crossing_near, loop_at, undelayed_phase
from fopi_tune.design.global_search.samples import log_omega_of, stretch_of

_PI = math.pi
#: ln of how far from a known crossover the table is trusted to show no other one
_AROUND_KNOWN = 0.5


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
        if j == n - 2:
            # |L| does not fall at the end of the axis, where -1 may be on it
            return False
        room = slopes[ROOM, j]
        here = math.floor((work.phase[i, j] - room + _PI) / (2.0 * _PI))
        if not room < 3.0 or here != math.floor((work.phase[i, j] + room + _PI) / (2.0 * _PI)):
            return False
        if table.v[j] < out[AT]:
            return False
        below = below or j >= table.alias[i]
    return not below


@compiled
def _exceeds(kind, limit, i, kappa, half, table, work, slopes):
    """Whether the angle to -1 (of a delay margin: the lag over omega) exceeds a limit at all crossovers of all loops.

    Loops of the box whose |L| touches 1 again far below their highest crossover have margins there as well.
    """
    n, last_low, last_high = work.gain.shape[1], -np.inf, np.inf
    for j in range(1, n - 1):
        low = work.gain[i, j] + kappa - half[0] + slopes[DOWN, j]
        high = work.gain[i, j] + kappa + half[0] + slopes[UP, j]
        if j == 1 and not low > 0.0:
            return False
        if j > 1:
            more = bulge(work.gain[i], table.v, j)
            may_cross = min(low, last_low) - more <= 0.0 <= max(high, last_high) + more
            if may_cross and not lag_exceeds(kind, limit, i, j - 1, j, table, work, slopes):
                return False
        last_low, last_high = low, high
    # nor does anything cross beyond the end of the axis
    return last_high < 0.0


@compiled
def _add(lin, count, way, out, add, limit):
    """way (value + add of (1)) <= way limit, as a row."""
    at = out[VALUE] + add
    return add_limit(lin, count, way, at, out[BY_KAPPA], out[BY_SHAPE], out[BY_PSI], limit, out[ERROR])


@compiled
def _size(out):
    return abs(out[BY_KAPPA]) + abs(out[BY_SHAPE]) + abs(out[BY_PSI]) + out[ERROR]


@compiled
def _margin_rows(kind, side, limit, alone, half_step, out, moved, lin, count):
    """Rows of a phase or delay margin whose lag to -1 is y of `out`; `half_step` is 0, on samples omega_s Ts/2."""
    reach = _size(out)
    low, high = out[VALUE] - reach, out[VALUE] + reach
    if low <= -_PI or high >= _PI:
        return count
    if kind == DELAY_MARGIN:
        if low <= 0.0:
            return count
        # lag - limit omega(v), of which omega(v + dv) = omega + omega' dv + at most omega' dv^2 e^D/2
        omega = limit * math.exp(log_omega_of(out[AT], half_step))
        slope = omega * stretch_of(out[AT], half_step)
        copy_into(out, moved)
        moved[VALUE] -= omega
        for a, b in ((BY_KAPPA, DV_KAPPA), (BY_SHAPE, DV_SHAPE), (BY_PSI, DV_PSI)):
            moved[a] -= slope * out[b]
        moved[ERROR] += slope * (out[DV_ERROR] + 0.5 * out[REACH] ** 2 * math.exp(out[REACH]))
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
    out[BY_KAPPA], out[BY_SHAPE], out[BY_PSI] = 0.0, slopes[SHAPE_IMAG, j] * half[1], slopes[PSI_IMAG, j] * half[2]
    out[ERROR], out[AT], out[REACH] = slopes[REST, j], table.v[j], 0.0
    out[DV_KAPPA] = out[DV_SHAPE] = out[DV_PSI] = out[DV_ERROR] = 0.0


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
        for k in (VALUE, BY_KAPPA, BY_SHAPE, BY_PSI):
            apart[k] = side * other[k] - nominal_side * first[k]
        apart[ERROR] = other[ERROR] + first[ERROR]
        count = _add(lin, count, 1.0, apart, 0.0, target)
        return _add(lin, count, -1.0, apart, 0.0, -target)
    # ln|L_i| at the nominal crossover is ln|P_i/P_0| there, a function of v alone
    gap = np.empty(5)
    v, d = first[AT], first[REACH]
    places = (v, v - STEP, v + STEP, v - d, v + d)
    for r in range(5):
        gap[r] = loop_at(x, two, places[r], 0.0)[0] - loop_at(x, one, places[r], 0.0)[0]
    slope = 0.5 * (gap[2] - gap[1]) / STEP
    bend = SAFE * max(abs(gap[3] - gap[0] + slope * d), abs(gap[4] - gap[0] - slope * d))
    a0, a1, a2 = slope * first[DV_KAPPA], slope * first[DV_SHAPE], slope * first[DV_PSI]
    rest = bend + abs(slope) * first[DV_ERROR]
    count = add_row(lin, count, a0, a1, a2, target - gap[0] + rest)
    if count < 0:
        return count
    return add_row(lin, count, -a0, -a1, -a2, target + gap[0] + rest)


@compiled
def crossing_rows(code, target, x, signs, kappa, half, table, filters, rows, work, slopes, lin, count):
    """Rows of margins and spreads at all crossings that every loop of the box has."""
    n, x, half_step = work.gain.shape[1], controller_of(x, table.sampling), table.sampling.half
    spread = code in (MARGIN_SPREAD, CROSSOVER_SPREAD)
    out, first, other = np.empty(SIZE), np.empty(SIZE), np.empty(SIZE)
    nominal_alone, deepest = False, 0.0
    for q in range(len(rows.kind)):
        if rows.kind[q] == GAIN_MARGIN:
            deepest = max(deepest, rows.limit[q] + 0.1)
    for i in range(table.gain.shape[0]):
        for q in range(len(rows.kind)):
            kind, side = rows.kind[q], rows.side[q]
            asked = kind in (PHASE_MARGIN, DELAY_MARGIN) and (side >= 0 if i == 0 else side > 0 and not rows.nominal[q])
            if asked and _exceeds(kind, rows.limit[q], i, kappa, half, table, work, slopes):
                return -1
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
                        PHASE_MARGIN, rows.side[q], rows.limit[q], nominal_alone, half_step, out, other, lin, count
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
                near = undelayed_phase(i, j, table, work)
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
                    of_gain, x, signs, table.members[i], half, v, near, offset, table.v[1], table.v[n - 2], filters, out
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
                        count = _margin_rows(kind, side, limit, alone, half_step, out, other, lin, count)
                    elif not of_gain and kind == GAIN_MARGIN:
                        reach = _size(out)
                        if side <= 0 and out[VALUE] + reach < 0.0:
                            count = _add(lin, count, 1.0, out, 0.0, -limit)
                        if side >= 0 and _is_alone(False, i, kappa, half, out, -limit, table, work, slopes):
                            count = _add(lin, count, -1.0, out, 0.0, -limit)
                    if count < 0:
                        return count
    return count
