"""What no gains can beat, in floats:  branch and bound on cells of (alpha, psi), the gain eliminated (compiled).

On a cell with centre C0 the loops are L = k L0 (1 + d), |d| <= r at each frequency.  A kappa = ln k is impossible for
the whole cell where every such loop violates a requirement, or fails to beat the objective's target, for instance
where with x = k |L0|, c = cos arg L0

    |S| > M :    (1 - r^2) x^2 + 2 (c + r/M) x + 1 - M^-2 < 0   and   x r < 1/M
    |T| > M :    (1 - q^2) x^2 + 2 c x + 1 < 0 ,                q = (1 - r)/M - r > 0                               (1)

(|C S| as |T| with M |P|); for margins where all loops of a run of frequencies are too close to -1 at |L| = 1; for
stability where every loop has the same number of unstable poles.  A cell is discarded when all kappa are impossible.
It is a check in floats on a grid of frequencies, not a proof; `fopi_tune.optimum` proves.

Source: derived; the squares of the responses and Nyquist's count, over a disc of loops.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CS,
    DELAY_MARGIN,
    GAIN_MARGIN,
    IAE,
    KI,
    LOOP_GAIN,
    NOTHING,
    PHASE_MARGIN,
    S,
    T,
    compiled,
    order_by_first,
)
from fopi_tune.design.global_search.intervals import negative_interval
from fopi_tune.design.global_search.rays import BEYOND, forbid, whole_turns

_PI = math.pi
#: columns of a cell
ALPHA_LOW, ALPHA_HIGH, PSI_LOW, PSI_HIGH, QUADRANT, KAPPA = range(6)
#: rad of psi that a unit of alpha counts as when a cell is cut
_SHAPE = 0.6


@compiled
def _fill_cell(cell, signs, table, work):
    """The centre's loops into the scratch arrays, and r of each column into `high` (inf at the ends of the axis)."""
    m, n = table.gain.shape
    alpha, reach = 0.5 * (cell[ALPHA_LOW] + cell[ALPHA_HIGH]), 0.5 * (cell[ALPHA_HIGH] - cell[ALPHA_LOW])
    psi, turn = 0.5 * (cell[PSI_LOW] + cell[PSI_HIGH]), 0.5 * (cell[PSI_HIGH] - cell[PSI_LOW])
    c, s = math.cos(psi) * signs[0], math.sin(psi) * signs[1]
    slope_c, slope_s = -math.sin(psi) * signs[0], math.cos(psi) * signs[1]
    largest = min(1.0, abs(math.sin(psi)) + turn)
    cosine, sine = math.cos(0.5 * _PI * alpha), math.sin(0.5 * _PI * alpha)
    negative = s < 0 or (s == 0 and c < 0)
    for j in range(1, n - 1):
        v = table.v[j]
        x = math.exp(-alpha * v)
        real, imag = c + s * x * cosine, -s * x * sine
        square = real * real + imag * imag
        size = math.sqrt(square)
        moved = x * (math.exp(math.sqrt(v * v + 0.25 * _PI * _PI) * reach) - 1.0)
        turned = math.sqrt((slope_c + slope_s * x * cosine) ** 2 + (slope_s * x * sine) ** 2)
        r = turn * turned + 0.5 * turn * turn * math.sqrt(1.0 + x * x) + largest * moved
        work.high[j] = r / size
        log_c = math.log(size)
        angle = math.atan2(-imag, -real) - _PI if negative else math.atan2(imag, real)
        for i in range(m):
            work.gain[i, j] = log_c + table.gain[i, j]
            work.phase[i, j] = angle + table.phase[i, j]
    work.high[0] = work.high[n - 1] = np.inf


@compiled
def _band_cell(kind, limit, i, j, r, table, work):
    """The kappa at which every loop of the cell exceeds an upper limit: (low, high), low > high if there are none."""
    inverse = math.exp(-limit)
    cosine = math.cos(work.phase[i, j])
    g = work.gain[i, j]
    if kind == S:
        low, high = negative_interval(1.0 - r * r, cosine + r * inverse, 1.0 - inverse * inverse)
        high = min(high, inverse / r) if r > 0.0 else high
    else:
        if kind == CS:
            inverse *= math.exp(-table.gain[i, j])
        q = (1.0 - r) * inverse - r
        if q <= 0.0:
            return 1.0, 0.0
        low, high = negative_interval(1.0 - q * q, cosine, 1.0)
    if high <= low:
        return 1.0, 0.0
    return (math.log(low) - g if low > 0.0 else -BEYOND), (math.log(high) - g if high < np.inf else BEYOND)


@compiled
def _too_close(kind, limit, i, j, table, work):
    """Whether every loop of the cell is closer to -1 at a column than a margin's limit."""
    r = work.high[j]
    if not r < 1.0:
        return False
    if j >= table.alias[i]:
        return True
    room, lag = math.asin(r), (work.phase[i, j] + _PI) % (2.0 * _PI)
    if kind == PHASE_MARGIN:
        return min(lag, 2.0 * _PI - lag) + room < limit
    return lag - room > 0.0 and lag + room < limit * table.omega[j]


@compiled
def _margin_cell(kind, limit, i, table, work, count):
    """Forbid the kappa at which every loop has a crossover that is too close to -1."""
    n, low, high = work.gain.shape[1], np.inf, -np.inf
    for j in range(1, n):
        if j < n - 1 and _too_close(kind, limit, i, j, table, work):
            r = work.high[j]
            low = min(low, -work.gain[i, j] - math.log(1.0 - r))
            high = max(high, -work.gain[i, j] - math.log(1.0 + r))
        elif high > -np.inf:
            count = forbid(work, count, low, BEYOND if j == n - 1 and table.delay[i] > 0.0 else high)
            low, high = np.inf, -np.inf
    return count


@compiled
def _passages_cell(i, cell, signs, table, work):
    """Passages of -180 deg as (smallest ln|L0|, largest, turns), found between columns where all loops agree; number.

    They are left in `allowed` (smallest, largest) and `cross_turn[i]`; turns of 0 stand for places that are unclear.
    """
    n, count = work.gain.shape[1], 0
    sine = math.sin(0.5 * (cell[PSI_LOW] + cell[PSI_HIGH])) * signs[1]
    lead = sine if sine != 0.0 else signs[0]
    level = whole_turns(table.start_phase[i] - (_PI if lead < 0 else 0.0))
    large = sine != 0.0 or table.low_slope[i] < 0.0
    smallest, largest, unclear = (BEYOND, BEYOND, False) if large else (-BEYOND, BEYOND, True)
    stop = min(n - 1, table.alias[i])
    for j in range(1, stop):
        r = work.high[j]
        clear, here = False, 0.0
        if r < 1.0:
            room = math.asin(r)
            here = math.floor((work.phase[i, j] - room + _PI) / (2.0 * _PI))
            clear = here == math.floor((work.phase[i, j] + room + _PI) / (2.0 * _PI))
            low, high = work.gain[i, j] + math.log(1.0 - r), work.gain[i, j] + math.log(1.0 + r)
        else:
            low, high = -BEYOND, BEYOND
        if j > 1:
            smallest, largest = min(smallest, low), max(largest, high)
        if not clear:
            unclear = True
            continue
        if (here != level or unclear) and count < work.cross_turn.shape[1]:
            work.allowed[count, 0], work.allowed[count, 1] = smallest, largest
            work.cross_turn[i, count] = here - level
            count += 1
        level, unclear, smallest, largest = here, False, low, high
    if unclear and count < work.cross_turn.shape[1]:
        work.allowed[count, 0], work.allowed[count, 1] = smallest, largest
        work.cross_turn[i, count] = 0.0
        count += 1
    return count


@compiled
def _unstable_cell(i, passages, table, work, count):
    """Forbid the kappa at which every loop of the cell is unstable."""
    ends = np.empty(2 * passages + 2)
    ends[0], ends[1] = -BEYOND, BEYOND
    for r in range(passages):
        ends[2 + 2 * r], ends[3 + 2 * r] = -work.allowed[r, 1], -work.allowed[r, 0]
    ends.sort()
    for e in range(len(ends) - 1):
        kappa = 0.5 * (ends[e] + ends[e + 1])
        if ends[e + 1] - ends[e] < 1e-12:
            continue
        z, clear = float(table.unstable[i]), True
        for r in range(passages):
            if kappa > -work.allowed[r, 0]:
                z -= 2.0 * work.cross_turn[i, r]
            elif kappa > -work.allowed[r, 1]:
                clear = False
        if clear and abs(z) > 0.75:
            count = forbid(work, count, ends[e], ends[e + 1])
    if table.delay[i] > 0.0:
        low = BEYOND
        for j in range(table.alias[i], work.gain.shape[1] - 1):
            if work.high[j] < 1.0:
                low = min(low, -work.gain[i, j] - math.log(1.0 - work.high[j]))
        count = forbid(work, count, low, BEYOND)
    return count


@compiled
def _row_cell(q, i, passages, table, rows, work, count):
    """Forbid what violates row q with plant i for the whole cell; equalities of a crossover and of |L| count too."""
    kind, side, limit = rows.kind[q], rows.side[q], rows.limit[q]
    first, last, n = max(rows.first[q], 1), min(rows.last[q], work.gain.shape[1] - 2), work.gain.shape[1]
    if kind in (S, T, CS):
        if side <= 0:
            return count
        # neighbouring columns overlap: their union is one interval
        union_low, union_high = 0.0, -np.inf
        for j in range(first, last + 1):
            if work.high[j] < 1.0 and j < table.alias[i]:
                low, high = _band_cell(kind, limit, i, j, work.high[j], table, work)
                if high <= low:
                    continue
                if low <= union_high and high >= union_low:
                    union_low, union_high = min(low, union_low), max(high, union_high)
                else:
                    count = forbid(work, count, union_low, union_high)
                    union_low, union_high = low, high
        count = forbid(work, count, union_low, union_high)
    elif kind == LOOP_GAIN:
        low, high = -BEYOND, BEYOND
        for j in range(first, last + 1):
            if side >= 0 and work.high[j] < 1.0:
                high = min(high, limit - work.gain[i, j] - math.log(1.0 - work.high[j]))
            if side <= 0:
                low = max(low, limit - work.gain[i, j] - math.log(1.0 + work.high[j]))
        count = forbid(work, count, -BEYOND, low)
        count = forbid(work, count, high, BEYOND)
    elif kind in (PHASE_MARGIN, DELAY_MARGIN):
        if side <= 0:
            count = _margin_cell(kind, limit - (1e-9 if side == 0 else 0.0), i, table, work, count)
    elif kind == GAIN_MARGIN and side < 0:
        for r in range(passages):
            if work.cross_turn[i, r] != 0.0:
                count = forbid(work, count, -limit - work.allowed[r, 0], -work.allowed[r, 1])
    elif kind == CROSSOVER:
        most, top = -np.inf, BEYOND
        for j in range(first, n - 1):
            most = max(most, work.gain[i, j] + math.log(1.0 + work.high[j]))
            if side >= 0 and work.high[j] < 1.0 and j > first:
                top = min(top, -work.gain[i, j] - math.log(1.0 - work.high[j]))
        count = forbid(work, count, top, BEYOND)
        if side <= 0:
            count = forbid(work, count, -BEYOND, -most)
        if side == 0 and work.high[first] < 1.0:
            count = forbid(work, count, -work.gain[i, first] - math.log(1.0 - work.high[first]), BEYOND)
    return count


@compiled
def _kappa_of_cell(code, target, cell, signs, table, box):
    """The kappa that the ranges of the gains and the objective's target leave in the cell: (low, high)."""
    low, high = -BEYOND, BEYOND
    most = max(cell[ALPHA_LOW] * box.log_omega, cell[ALPHA_HIGH] * box.log_omega) - box.log_gain
    least = min(cell[ALPHA_LOW] * box.log_omega, cell[ALPHA_HIGH] * box.log_omega) - box.log_gain
    sines, cosines = math.sin(cell[PSI_LOW]), math.cos(cell[PSI_HIGH])
    sine, cosine = math.sin(cell[PSI_HIGH]), math.cos(cell[PSI_LOW])
    kp = (box.kp_low, box.kp_high) if signs[0] > 0 else (-box.kp_high, -box.kp_low)
    ki = (box.ki_low, box.ki_high) if signs[1] > 0 else (-box.ki_high, -box.ki_low)
    if code == KI and signs[1] > 0:
        ki = (max(ki[0], -target), ki[1])
    if kp[0] > 0.0:
        low = max(low, math.log(kp[0] / cosine) if cosine > 0.0 else BEYOND)
    if ki[0] > 0.0:
        low = max(low, math.log(ki[0]) - math.log(sine) - most if sine > 0.0 else BEYOND)
    if cosines > 1e-12:
        high = min(high, math.log(kp[1] / cosines) if kp[1] > 0.0 else -BEYOND)
    if sines > 1e-12:
        high = min(high, math.log(ki[1]) - math.log(sines) - least if ki[1] > 0.0 else -BEYOND)
    if code == IAE and signs[0] > 0 and signs[1] > 0:
        h = math.exp(max(cell[ALPHA_LOW] * box.log_horizon, cell[ALPHA_HIGH] * box.log_horizon))
        at = min(max(math.atan(h), cell[PSI_LOW]), cell[PSI_HIGH])
        controller = math.cos(at) + math.sin(at) * h
        for i in range(table.gain.shape[0]):
            p = table.error_gain[i]
            if p > 0.0:
                needed = (p * math.exp(-target) - 1.0) / (controller * p)
                low = max(low, math.log(needed) if needed > 0.0 else -BEYOND)
    return low, high


@compiled
def kappa_left(code, target, cell, signs, table, rows, box, work):
    """A kappa that may meet everything and beat the target somewhere in the cell; NOTHING if there is none."""
    low, high = _kappa_of_cell(code, target, cell, signs, table, box)
    if low >= high:
        return NOTHING
    _fill_cell(cell, signs, table, work)
    count = 0
    for i in range(table.gain.shape[0]):
        passages = _passages_cell(i, cell, signs, table, work)
        count = _unstable_cell(i, passages, table, work, count)
        for q in range(len(rows.kind)):
            if i == 0 or not (rows.nominal[q] or rows.side[q] == 0):
                count = _row_cell(q, i, passages, table, rows, work, count)
    order = order_by_first(work.forbidden, count)
    reached, best, width = low, NOTHING, 0.0
    for r in range(count + 1):
        begin = work.forbidden[order[r], 0] if r < count else high
        begin = min(begin, high)
        if begin - reached > width:
            best, width = 0.5 * (max(reached, begin - 2.0) + begin), begin - reached
        if r < count:
            reached = max(reached, work.forbidden[order[r], 1])
        if reached >= high:
            break
    return best


@compiled
def branch(code, target, quadrants, most, table, rows, box, work):
    """Discard cells until none is left or `most` were looked at: (cells that are left, cells looked at, share left).

    Args:
        code, target: of the objective; gains that do not cost less than the target are discarded.
        quadrants: the signs of kp and ki, shape (k, 2).
        most: cells.
        table, rows, box, work: as in `allowed_intervals`; `rows` with the objective's own.
    """
    cells = np.zeros((2 * most + 8, 6))
    first, last = 0, 0
    for z in range(len(quadrants)):
        low, high = 0.0, 0.5 * _PI
        if box.ki_low == 0.0 and box.ki_high == 0.0:
            high = 0.0
        if box.kp_low == 0.0 and box.kp_high == 0.0:
            low = 0.5 * _PI
        cells[last] = np.array((box.alpha_low, box.alpha_high, low, high, float(z), 0.0))
        last += 1
    looked, share, whole = 0, 0.0, max(box.alpha_high - box.alpha_low, 1e-9) * 0.5 * _PI * len(quadrants)
    while first < last and looked < most:
        cell = cells[first].copy()
        first += 1
        looked += 1
        kappa = kappa_left(code, target, cell, quadrants[int(cell[QUADRANT])], table, rows, box, work)
        if kappa == NOTHING:
            continue
        cell[KAPPA] = kappa
        wide = (cell[ALPHA_HIGH] - cell[ALPHA_LOW]) * _SHAPE > cell[PSI_HIGH] - cell[PSI_LOW]
        low, high = (ALPHA_LOW, ALPHA_HIGH) if wide else (PSI_LOW, PSI_HIGH)
        middle = 0.5 * (cell[low] + cell[high])
        cells[last] = cell
        cells[last, high] = middle
        cells[last + 1] = cell
        cells[last + 1, low] = middle
        last += 2
    for r in range(first, last):
        share += max(cells[r, ALPHA_HIGH] - cells[r, ALPHA_LOW], 1e-9) * (cells[r, PSI_HIGH] - cells[r, PSI_LOW])
    return cells[first:last].copy(), looked, share / whole
