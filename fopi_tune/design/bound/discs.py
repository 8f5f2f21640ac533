"""What no gains can beat, in floats:  branch and bound on cells of (shape, psi), the gain eliminated (compiled).

On a cell with centre C0 the loops are L = k L0 (1 + d), |d| <= r at each frequency.  A kappa = ln k is impossible for
the whole cell where every such loop violates a requirement, or fails to beat the objective's target, for instance
where with x = k |L0|, c = cos arg L0

    |S| > M :    (1 - r^2) x^2 + 2 (c + r/M) x + 1 - M^-2 < 0   and   x r < 1/M
    |T| > M :    the same in y = 1/(x (1 - r^2)) ,                                                                  (1)

(|C S| as |T| with M |P|, |P S| as |S| with M/|P|; 1/L lies in the disc around 1/(L0 (1 - r^2)) whose radius is the r-th
part of that); for margins where all loops of a run of frequencies are too close to -1 at |L| = 1; for stability where
every loop has the same number of unstable poles.  A cell is discarded when all kappa are impossible.  It is a check in
floats on a grid of frequencies, not a proof; `fopi_tune.optimum` proves.

Source: derived; the squares of the responses and Nyquist's count, over a disc of loops.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.cells import fill_cell
from fopi_tune.design.bound.columns import DOWN, PSI_HIGH, PSI_LOW, ROOM, SHAPE_LOW, UP
from fopi_tune.design.bound.derivative_cells import end_of_cell
from fopi_tune.design.bound.gain_ranges import kappa_of_cell
from fopi_tune.design.bound.margins import forbid_interval, forbid_too_close, gains_at_end, margin_range
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CS,
    DELAY_MARGIN,
    GAIN_MARGIN,
    LOOP_GAIN,
    PHASE_MARGIN,
    PS,
    S,
    T,
    compiled,
    order_by_first,
)
from fopi_tune.design.global_search.intervals import negative_interval
from fopi_tune.design.global_search.rays import BEYOND, whole_turns

_PI = math.pi


@compiled
def _band_cell(of_inverse, inverse, r, cosine, g):
    """The kappa at which every loop of the cell exceeds an upper limit M = 1/inverse: (low, high), low > high if none.

    1/L, of which |T| and |C S| are functions, lies in the disc around 1/(L0 (1 - r^2)) with the r-th part as radius.
    """
    low, high = negative_interval(1.0 - r * r, cosine + r * inverse, 1.0 - inverse * inverse)
    if r > 0.0:
        high = min(high, inverse / r)
    if high <= low:
        return 1.0, 0.0
    first, last = (math.log(low) if low > 0.0 else -BEYOND), (math.log(high) if high < np.inf else BEYOND)
    if not of_inverse:
        return max(first - g, -BEYOND), min(last - g, BEYOND)
    shrunk = math.log(1.0 - r * r)
    return (-last - shrunk - g if last < BEYOND else -BEYOND), (-first - shrunk - g if first > -BEYOND else BEYOND)


@compiled
def _is_negative_at_end(i, cell, signs, table):
    """Whether L of every loop of the cell is real and negative at Nyquist's frequency; never in continuous time."""
    sign = end_of_cell(cell, signs, table.sampling.derivative)[2]
    turned = (table.phase[i, -1] + (0.0 if sign < 0 else _PI)) % (2.0 * _PI)
    return table.sampling.half > 0.0 and sign != 0.0 and min(turned, 2.0 * _PI - turned) < 1e-9


@compiled
def _passages_cell(i, cell, signs, table, work, slopes):
    """Passages of -180 deg as (smallest ln|L0|, largest, turns), found between columns where all loops agree; number.

    They are left in `allowed` (smallest, largest) and `cross_turn[i]`; turns of 0 stand for places that are unclear.
    """
    n, count = work.gain.shape[1], 0
    sine = math.sin(0.5 * (cell[PSI_LOW] + cell[PSI_HIGH])) * signs[1]
    lead = sine if sine != 0.0 else signs[0]
    if sine == 0.0 and table.sampling.derivative > 0.0 and cell[SHAPE_LOW] == 0.5 * _PI:
        lead = signs[2]
    level = whole_turns(table.start_phase[i] - (_PI if lead < 0 else 0.0))
    large = sine != 0.0 or table.low_slope[i] < 0.0
    smallest, largest, unclear = (BEYOND, BEYOND, False) if large else (-BEYOND, BEYOND, True)
    stop = min(n - 1, table.alias[i])
    for j in range(1, stop):
        clear, here = False, 0.0
        if slopes[ROOM, j] < _PI:
            room = slopes[ROOM, j]
            here = math.floor((work.phase[i, j] - room + _PI) / (2.0 * _PI))
            clear = here == math.floor((work.phase[i, j] + room + _PI) / (2.0 * _PI))
        low = max(work.gain[i, j] + slopes[DOWN, j], -BEYOND)
        high = min(work.gain[i, j] + slopes[UP, j], BEYOND)
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
def _sort(values):
    """Ascending, by insertion: the few numbers are nearly in order."""
    for k in range(1, len(values)):
        value, r = values[k], k
        while r > 0 and values[r - 1] > value:
            values[r] = values[r - 1]
            r -= 1
        values[r] = value


@compiled
def _unstable_cell(i, cell, signs, passages, table, work, slopes, count):
    """Forbid the kappa at which every loop of the cell is unstable."""
    ends = np.empty(2 * passages + 2)
    ends[0], ends[1] = -BEYOND, BEYOND
    for r in range(passages):
        ends[2 + 2 * r], ends[3 + 2 * r] = -work.allowed[r, 1], -work.allowed[r, 0]
    _sort(ends)
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
            count = forbid_interval(work.forbidden, count, ends[e], ends[e + 1])
    if _is_negative_at_end(i, cell, signs, table):
        # 1 + L(z) changes its sign between z = -1 and -inf
        count = forbid_interval(work.forbidden, count, -gains_at_end(i, cell, signs, table)[0], BEYOND)
    if table.delay[i] > 0.0:
        low = BEYOND
        for j in range(table.alias[i], work.gain.shape[1] - 1):
            if work.high[j] < 1.0:
                low = min(low, -work.gain[i, j] - slopes[DOWN, j])
        count = forbid_interval(work.forbidden, count, low, BEYOND)
    return count


@compiled
def _row_cell(q, i, passages, cell, signs, table, rows, work, slopes, count):
    """Forbid what violates row q with plant i for the whole cell; equalities of a crossover and of |L| count too."""
    kind, side, limit = rows.kind[q], rows.side[q], rows.limit[q]
    first, last, n = max(rows.first[q], 1), min(rows.last[q], work.gain.shape[1] - 2), work.gain.shape[1]
    if kind in (S, T, CS, PS):
        if side < 0:
            return count
        if kind in (T, CS) and cell[PSI_LOW] > 0.0 and rows.first[q] == 0 and table.low_slope[i] <= 0.0:
            # T -> 1 and C S -> 1/P as omega -> 0
            value = 0.0 if kind == T else -table.gain[i, 0]
            if value > limit and (kind == T or table.low_slope[i] == 0.0):
                return forbid_interval(work.forbidden, count, -BEYOND, BEYOND)
        # neighbouring columns overlap: their union is one interval
        union_low, union_high, inverse, least = 0.0, -np.inf, math.exp(-limit), -BEYOND
        most = BEYOND
        for j in range(first, last + 1):
            scaled = inverse if rows.tilt[q] == 0.0 else inverse * math.exp(-rows.tilt[q] * table.log_omega[j])
            if kind == CS:
                scaled *= math.exp(table.filter_gain[j] - table.gain[i, j])
            elif kind == PS:
                scaled *= math.exp(table.plant_gain[i, j])
            if work.high[j] < 1.0:
                cosine = work.real[i, j] / work.square[i, j]
                low, high = _band_cell(kind in (T, CS), scaled, work.high[j], cosine, work.gain[i, j])
                if high <= low:
                    continue
                if low <= union_high and high >= union_low:
                    union_low, union_high = min(low, union_low), max(high, union_high)
                else:
                    count = forbid_interval(work.forbidden, count, union_low, union_high)
                    union_low, union_high = low, high
                continue
            if scaled > 1.0 and kind in (S, PS):
                # |1 + L| <= 1 + |L|, |1 + 1/L| <= 1 + 1/|L|
                least = max(least, math.log(scaled - 1.0) - work.gain[i, j] - slopes[UP, j])
            elif scaled > 1.0:
                most = min(most, -math.log(scaled - 1.0) - work.gain[i, j] - slopes[DOWN, j])
        count = forbid_interval(work.forbidden, count, union_low, union_high)
        count = forbid_interval(work.forbidden, count, -BEYOND, least)
        count = forbid_interval(work.forbidden, count, most, BEYOND)
    elif kind == LOOP_GAIN:
        low, high = -BEYOND, BEYOND
        for j in range(first, last + 1):
            here = limit + rows.tilt[q] * table.log_omega[j] - work.gain[i, j]
            if side >= 0:
                high = min(high, here - slopes[DOWN, j])
            if side <= 0:
                low = max(low, here - slopes[UP, j])
        count = forbid_interval(work.forbidden, count, -BEYOND, low)
        count = forbid_interval(work.forbidden, count, high, BEYOND)
    elif kind in (PHASE_MARGIN, DELAY_MARGIN):
        if side <= 0:
            count = forbid_too_close(kind, limit - (1e-9 if side == 0 else 0.0), i, table, work, slopes, count)
        if side < 0 and kind == DELAY_MARGIN and table.sampling.half > 0.0:
            # no delay is borne
            count = forbid_interval(work.forbidden, count, -gains_at_end(i, cell, signs, table)[0], BEYOND)
        if side >= 0:
            low, high = margin_range(kind, limit, i, cell, signs, table, work, slopes)
            count = forbid_interval(work.forbidden, count, -BEYOND, low)
            count = forbid_interval(work.forbidden, count, high, BEYOND)
    elif kind == GAIN_MARGIN and side < 0:
        for r in range(passages):
            if work.cross_turn[i, r] != 0.0:
                count = forbid_interval(work.forbidden, count, -limit - work.allowed[r, 0], -work.allowed[r, 1])
        if _is_negative_at_end(i, cell, signs, table):
            count = forbid_interval(work.forbidden, count, -limit - gains_at_end(i, cell, signs, table)[0], BEYOND)
    elif kind == CROSSOVER:
        most, top = -np.inf, BEYOND
        for j in range(first, n - 1):
            most = max(most, work.gain[i, j] + slopes[UP, j])
            if side >= 0 and j > first:
                top = min(top, -work.gain[i, j] - slopes[DOWN, j])
        count = forbid_interval(work.forbidden, count, top, BEYOND)
        if side <= 0:
            count = forbid_interval(work.forbidden, count, -BEYOND, -most)
        if side == 0:
            count = forbid_interval(work.forbidden, count, -work.gain[i, first] - slopes[DOWN, first], BEYOND)
    return count


@compiled
def kappa_left(code, target, cell, signs, table, filters, rows, box, work, slopes):
    """The kappa that may meet everything and beat the target somewhere in the cell: their number; they are in `found`.

    Args:
        code, target: of the objective; gains that do not cost less than the target count as impossible.
        cell: its ranges, as the columns say.
        signs: of kp, ki and kd.
        table, rows, box, work: as in `allowed_intervals`; `rows` with the objective's own.
        filters: of the cell, of `filters_over`.
        slopes: scratch for the slopes of `cells`, shape (SLOPES, n).
    """
    low, high = kappa_of_cell(code, target, cell, signs, table, filters, box)
    if low >= high:
        return 0
    fill_cell(cell, signs, table, filters, work, slopes)
    count = 0
    for i in range(table.gain.shape[0]):
        passages = _passages_cell(i, cell, signs, table, work, slopes)
        count = _unstable_cell(i, cell, signs, passages, table, work, slopes, count)
        for q in range(len(rows.kind)):
            if i == 0 or not (rows.nominal[q] or rows.side[q] == 0):
                count = _row_cell(q, i, passages, cell, signs, table, rows, work, slopes, count)
    order = order_by_first(work.forbidden, count)
    reached, found = low, 0
    for r in range(count + 1):
        begin = min(work.forbidden[order[r], 0], high) if r < count else high
        if begin > reached:
            place = found if found < len(work.found) else found - 1
            work.found[place, 1] = begin
            if place == found:
                work.found[place, 0] = reached
                found += 1
        if r < count:
            reached = max(reached, work.forbidden[order[r], 1])
        if reached >= high:
            break
    return found
