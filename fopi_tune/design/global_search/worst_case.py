"""The worst plants and frequencies of every row at given gains, the interior of the box included (compiled).

Every plant of a grid of the box offers its dips along the frequency.  Of dips that are neighbours in plant and
frequency the deepest stands for all (a watershed); its frequency is found by Newton's method and its plant, unless no
step leaves a vertex for a worse one, by a compass search whose every point has its own frequency.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CS,
    DELAY_MARGIN,
    DISCOUNTED_ERROR,
    GAIN_AT_REFERENCE,
    GAIN_MARGIN,
    LOOP_GAIN,
    PHASE_MARGIN,
    PS,
    S,
    T,
    compiled,
    entry,
    order_by_first,
)
from fopi_tune.design.global_search.controllers import controller_of
from fopi_tune.design.global_search.rays import alias_gain, fill_ray, find_passages, unstable_poles
from fopi_tune.design.global_search.responses import (
    AT_FIXED,
    AT_GAIN,
    AT_HORIZON,
    AT_INFINITY,
    AT_PEAK,
    AT_PHASE,
    AT_REFERENCE,
    copy_into,
    crossing_near,
    ripple_near,
    settle,
    undelayed_phase,
    value_at,
)
from fopi_tune.design.global_search.samples import plant_of

_PI = math.pi
#: columns of a finding, before the plant's point
ROW, SLACK, V, NEAR, MODE, TARGET = range(6)
FIELDS = 6
#: natural units: findings of a row this much less deep than its worst are left out
_LESS_DEEP = 0.25
_MOST_OF_A_ROW = 4
#: |v| within which dips are neighbours
_APART = 0.6
#: tan(omega Ts/2) beyond which responses are so flat that an equation of a peak does not hold its frequency
_AT_NYQUIST = 1e2
#: |ln|L|| beyond which |T| or |S| is 1, and a peak of it rounding: an equation of it holds nothing
_PLATEAU = 14.0
#: the plant is found to this part of the grid's spacing
_CLOSE = 2e-4


@entry
def inner_slack(side, limit, scale, value):
    """Of an inequality how far inside, of an equality minus the distance."""
    return -abs(limit - value) * scale if side == 0 else side * (limit - value) * scale


@compiled
def is_stable_on(table, work):
    """Whether every plant is stable with the gains whose ray (kappa = 0) is in the scratch arrays."""
    for i in range(table.gain.shape[0]):
        if abs(unstable_poles(i, 0.0, table, work)) > 0.25:
            return False
        if table.delay[i] > 0.0 and alias_gain(i, table, work) >= 0.0:
            return False
    return True


@compiled
def _offer(found, count, slack, i, j, v, mode, target):
    if count < len(found):
        found[count, 0], found[count, 1], found[count, 2] = slack, i, j
        found[count, 3], found[count, 4], found[count, 5] = v, mode, target
        return count + 1
    return count


@compiled
def _band_dips(q, i, x, table, rows, work, y, found, count):
    """Dips of a function of frequency over its band."""
    kind, side, n = rows.kind[q], rows.side[q], table.gain.shape[1]
    first, last = rows.first[q], rows.last[q]
    for j in range(first, last + 1):
        value = work.gain[i, j]
        if kind != LOOP_GAIN:
            square = max(1.0 + 2.0 * work.real[i, j] + work.square[i, j], 1e-300)
            if kind == S:
                value = -0.5 * math.log(square)
            elif kind == T:
                value += -0.5 * math.log(square)
            elif kind == PS:
                value = table.plant_gain[i, j] - 0.5 * math.log(square)
            else:
                value = work.controller[0, j] + table.filter_gain[j] - 0.5 * math.log(square)
        y[j] = inner_slack(side, rows.limit[q] + rows.tilt[q] * table.log_omega[j], rows.scale[q], value)
    for j in range(first, last + 1):
        left = j == first or y[j] <= y[j - 1]
        right = j == last or y[j] < y[j + 1]
        if not (left and right):
            continue
        v, mode, target = table.v[j], AT_PEAK, 0.0
        if first == last:
            mode = AT_FIXED
        elif j == 0:
            v, mode = table.v[1], AT_FIXED
        elif j == n - 1:
            v = table.v[n - 2]
            falls = kind == CS and work.gain[i, j] < -10.0 and table.sampling.half == 0.0  # not on samples
            mode = AT_INFINITY if falls and table.filter_gain[j] == 0.0 else AT_FIXED  # with a filter C S -> 0
        elif j >= table.alias[i]:
            target = 2.0 * _PI * round((work.phase[i, j] - _PI) / (2.0 * _PI)) + _PI
        count = _offer(found, count, y[j], i, j, v, mode, target)
    return count


@compiled
def _crossover_dips(q, i, table, rows, work, found, count):
    """Gain crossovers: all of them for a lower limit of a margin, else the smallest or the highest; -1 without any."""
    kind, side, n, first = rows.kind[q], rows.side[q], table.gain.shape[1], count
    least, margin = -1, kind in (PHASE_MARGIN, DELAY_MARGIN)
    if kind == DELAY_MARGIN and side < 0 and table.sampling.half > 0.0 and work.gain[i, n - 1] > 0.0:
        # |L| exceeds 1 at Nyquist's frequency: no delay is borne
        return -1
    for j in range(n - 2, -1, -1):
        a, b = work.gain[i, j], work.gain[i, j + 1]
        if (a > 0.0) == (b > 0.0):
            continue
        part = a / (a - b)
        v = table.v[j] + part * (table.v[j + 1] - table.v[j])
        log_omega = table.log_omega[j] + part * (table.log_omega[j + 1] - table.log_omega[j])
        phase = work.phase[i, j] + part * (work.phase[i, j + 1] - work.phase[i, j])
        lag = (phase + _PI) % (2.0 * _PI)
        value = log_omega
        if kind == PHASE_MARGIN:
            value = min(lag, 2.0 * _PI - lag)
        elif kind == DELAY_MARGIN:
            value = lag * math.exp(-log_omega)
        elif kind != CROSSOVER:
            a, b = max(j, 1), min(j + 1, n - 2)
            value = (work.phase[i, b] - work.phase[i, a]) / (table.log_omega[b] - table.log_omega[a]) * math.log(10.0)
        slack = inner_slack(side, rows.limit[q], rows.scale[q], value)
        if margin and side >= 0 and count > first:
            # an upper limit is about the smallest alone
            if value >= least:
                continue
            count = first
        least = value
        count = _offer(found, count, slack, i, j, v, AT_GAIN, 0.0)
        if not margin:
            break
    if count > first:
        return count
    return count if margin and side < 0 else -1


@compiled
def _phase_dips(q, i, table, rows, work, found, count):
    """Phase crossovers with |L| < 1, of an upper limit the one with the largest |L| alone; -1 without it."""
    side, n, first, largest = rows.side[q], table.gain.shape[1], count, -np.inf
    stop = min(n - 2, table.alias[i])
    for j in range(1, stop):
        before, after = work.phase[i, j] + _PI, work.phase[i, j + 1] + _PI
        level = math.floor(max(before, after) / (2.0 * _PI))
        if level == math.floor(min(before, after) / (2.0 * _PI)):
            continue
        part = (2.0 * _PI * level - before) / (after - before)
        gain = work.gain[i, j] + part * (work.gain[i, j + 1] - work.gain[i, j])
        v = table.v[j] + part * (table.v[j + 1] - table.v[j])
        if gain > 1e-9:
            continue
        if side >= 0 and count > first:
            if gain <= largest:
                continue
            count = first
        largest = max(largest, gain)
        slack = inner_slack(side, rows.limit[q], rows.scale[q], -gain)
        count = _offer(found, count, slack, i, j, v, AT_PHASE, 2.0 * _PI * level - _PI)
    for j, column in ((0, 1), (n - 1, n - 2)):
        # the limits omega -> 0 and inf where L is real and negative
        if j == n - 1 and table.delay[i] > 0.0:
            continue
        half = abs((work.phase[i, j] % (2.0 * _PI)) - _PI) < 1e-9
        gain = work.gain[i, j]
        if half and -20.0 < gain <= 1e-9 and (side < 0 or gain > largest):
            slack = inner_slack(side, rows.limit[q], rows.scale[q], -gain)
            if side >= 0:
                count = first
            largest = max(largest, gain)
            count = _offer(found, count, slack, i, column, table.v[column], AT_FIXED, 0.0)
    if table.delay[i] > 0.0:
        gain = alias_gain(i, table, work)
        for j in range(table.alias[i], n - 1):
            if work.gain[i, j] == gain and side < 0 and gain < 0.0:
                target = 2.0 * _PI * round((work.phase[i, j] - _PI) / (2.0 * _PI)) + _PI
                slack = inner_slack(side, rows.limit[q], rows.scale[q], -gain)
                count = _offer(found, count, slack, i, j, table.v[j], AT_PHASE, target)
                break
    return count if count > first or side < 0 else -1


@entry
def highest_crossover(x, table, work):
    """(v, near, whether there is one) of the nominal plant's highest gain crossover."""
    x = controller_of(x, table.sampling)
    for j in range(table.gain.shape[1] - 2, -1, -1):
        a, b = work.gain[0, j], work.gain[0, j + 1]
        if (a > 0.0) != (b > 0.0):
            v = table.v[j] + a / (a - b) * (table.v[j + 1] - table.v[j])
            near = undelayed_phase(0, j, table, work)
            return crossing_near(0, 0.0, x, table.members[0], v, near), near, True
    return 0.0, 0.0, False


@entry
def smallest_margin(x, table, work):
    """(margin, v, near) of the nominal plant's crossover that is closest to -1; margin negative without one."""
    x = controller_of(x, table.sampling)
    best, at, branch = -1.0, 0.0, 0.0
    for j in range(table.gain.shape[1] - 2, -1, -1):
        a, b = work.gain[0, j], work.gain[0, j + 1]
        if (a > 0.0) != (b > 0.0):
            v = table.v[j] + a / (a - b) * (table.v[j + 1] - table.v[j])
            near = undelayed_phase(0, j, table, work)
            v = crossing_near(0, 0.0, x, table.members[0], v, near)
            value = value_at(PHASE_MARGIN, x, table.members[0], v, near)
            if best < 0.0 or value < best:
                best, at, branch = value, v, near
    return best, at, branch


@compiled
def _worst_plant(
    kind, side, limit, scale, mode, x, point, plant, v, near, target, low_v, high_v, horizon, family, low, high,
    spacing, tilt,
):  # fmt: skip
    """Compass search over the box from a plant of the grid: (slack, v); `point` and `plant` are moved."""
    p = len(point)
    value, v = settle(kind, side, mode, x, plant, v, near, target, low_v, high_v, horizon, tilt)
    best = inner_slack(side, limit, scale, value)
    trial, other = point.copy(), plant.copy()
    inside = False
    for k in range(p):
        inside = inside or low[k] < point[k] < high[k]
    size = 0.5 if inside else 0.0
    if not inside:
        for k in range(p):
            copy_into(point, trial)
            trial[k] += (0.02 if point[k] == low[k] else -0.02) * spacing[k]
            plant_of(family, trial, other)
            value, _ = settle(kind, side, mode, x, other, v, near, target, low_v, high_v, horizon, tilt)
            if inner_slack(side, limit, scale, value) < best:
                size = 0.5
    while size > _CLOSE:
        moved = False
        for k in range(p):
            for way in (-1.0, 1.0):
                copy_into(point, trial)
                trial[k] = min(max(point[k] + way * size * spacing[k], low[k]), high[k])
                if trial[k] == point[k]:
                    continue
                plant_of(family, trial, other)
                value, at = settle(kind, side, mode, x, other, v, near, target, low_v, high_v, horizon, tilt)
                slack = inner_slack(side, limit, scale, value)
                if slack < best - 1e-13 and math.isfinite(slack) and abs(at - v) < _APART:
                    best, v, moved = slack, at, True
                    copy_into(trial, point)
                    copy_into(other, plant)
        if not moved:
            size *= 0.35
    return best, v


@entry
def worst_cases(x, table, rows, family, low, high, spacing, horizon, within, real_rows, known, work, out):
    """Findings of all rows at gains x, into `out`; their number, or -1 where a plant is unstable or has no value.

    Args:
        x: kp', ki', alpha.
        table: plants of the whole box, the nominal one first.
        rows: requirements first, then those of the objective.
        family, low, high, spacing, horizon: the plants' coefficients, the box and its grid's spacing, ln(T omega_s).
        within, real_rows: findings of requirements, the first so many rows, with a larger slack are left out.
        known: (v, near) of the crossover that gains at a reference are about; empty where it is the first plant's.
        work, out: scratch arrays, and room for findings, shape (most, 6 + p).
    """
    (m, n), p = table.gain.shape, table.points.shape[1]
    fill_ray(x[2], x[0], x[1], table, work)
    find_passages(x[2], x[0], x[1], table, work)
    if not is_stable_on(table, work):
        return -1
    reference, reference_near, there = highest_crossover(x, table, work)
    if len(known) > 0:
        reference, reference_near, there = known[0], known[1], True
    x, half = controller_of(x, table.sampling), table.sampling.half
    total = 0
    found, y = np.empty((12 * m + 64, 6)), np.empty(n)
    for q in range(len(rows.kind)):
        kind, side, count, begin = rows.kind[q], rows.side[q], 0, total
        for i in range(1 if rows.nominal[q] else m):
            if kind <= LOOP_GAIN:
                count = _band_dips(q, i, x, table, rows, work, y, found, count)
            elif kind == GAIN_MARGIN:
                count = _phase_dips(q, i, table, rows, work, found, count)
            elif kind == GAIN_AT_REFERENCE:
                if not there:
                    return -1
                value = value_at(kind, x, table.members[i], reference, reference_near)
                count = _offer(found, count, -abs(value), i, 0, reference, AT_REFERENCE, 0.0)
            elif kind == DISCOUNTED_ERROR:
                value, _ = settle(kind, side, AT_HORIZON, x, table.members[i], 0.0, 0.0, 0.0, 0.0, 0.0, horizon, 0.0)
                count = _offer(found, count, -value, i, 0, 0.0, AT_HORIZON, 0.0)
            else:
                count = _crossover_dips(q, i, table, rows, work, found, count)
            if count < 0:
                return -1
        order = order_by_first(found, count)
        for r in range(count):
            dip = found[order[r]]
            if total - begin >= _MOST_OF_A_ROW or total >= len(out):
                break
            if (dip[0] > found[order[0], 0] + _LESS_DEEP and total > begin) or (dip[0] > within and q < real_rows):
                break
            i, j, v, mode = int(dip[1]), int(dip[2]), dip[3], int(dip[4])
            belongs = False
            for t in range(r):
                other = found[order[t]]
                near_by = abs(other[3] - v) <= _APART
                for k in range(p):
                    distance = abs(table.points[int(other[1]), k] - table.points[i, k])
                    near_by = near_by and distance <= 1.01 * spacing[k]
                belongs = belongs or near_by
            if belongs:
                continue
            near = undelayed_phase(i, j, table, work) if j < n - 1 else work.phase[i, j]
            near = reference_near if kind == GAIN_AT_REFERENCE else near
            point, plant = table.points[i].copy(), table.members[i].copy()
            target, way = dip[5], float(side)
            if mode == AT_PEAK and target != 0.0:
                v = ripple_near(kind, way, x, plant, v, near, target, rows.tilt[q])
            low_v, high_v = max(rows.low_v[q], table.v[1]), min(rows.high_v[q], table.v[n - 2])
            limit, scale, tilt = rows.limit[q], rows.scale[q], rows.tilt[q]
            if kind == GAIN_AT_REFERENCE:
                # |ln|L|| is largest where ln|L| is, or where it is smallest
                way = 1.0 if value_at(kind, x, plant, v, near) > 0.0 else -1.0
                limit, scale = 0.0, 1.0
            if p > 0 and not rows.nominal[q]:
                best, v = _worst_plant(
                    kind, int(way), limit, scale, mode, x, point, plant, v, near, target, low_v, high_v, horizon,
                    family, low, high, spacing, tilt,
                )  # fmt: skip
            else:
                value, v = settle(kind, int(way), mode, x, plant, v, near, target, low_v, high_v, horizon, tilt)
                best = inner_slack(int(way), limit, scale, value)
            if kind <= LOOP_GAIN and j == 0:
                best = min(best, dip[0])  # the limit omega -> 0, which a slow integral approaches below the table
            flat = (kind == T and work.gain[i, j] > _PLATEAU) or (kind == S and work.gain[i, j] < -_PLATEAU)
            if not low_v + 1e-9 < v < high_v - 1e-9 or half * math.exp(v) > _AT_NYQUIST:
                flat = True
            if mode == AT_PEAK and flat:
                mode = AT_FIXED
            twin = False
            for t in range(begin, total):
                same = abs(out[t, V] - v) < 1e-4
                for k in range(p):
                    same = same and abs(out[t, FIELDS + k] - point[k]) <= 1e-3 * (high[k] - low[k])
                twin = twin or same
            if twin:
                continue
            out[total, ROW], out[total, SLACK], out[total, V] = q, best, v
            out[total, NEAR], out[total, MODE], out[total, TARGET] = near, mode, target
            for k in range(p):
                out[total, FIELDS + k] = point[k]
            total += 1
    return total
