"""Which k = e^kappa of a ray meet every requirement, as intervals of kappa (compiled).

With L0 = C0 P, a band's inequality at one frequency is a quadratic in k,

    |S|   <= M :   |L0|^2 k^2 + 2 Re L0 k + 1 - M^-2 >= 0
    |T|   <= M :   (1 - M^-2) |L0|^2 k^2 + 2 Re L0 k + 1 >= 0
    |C S| <= M :   (|L0|^2 - |C0|^2 M^-2) k^2 + 2 Re L0 k + 1 >= 0                                                  (1)
    |P S| <= M :   |L0|^2 k^2 + 2 Re L0 k + 1 - |P|^2 M^-2 >= 0

(with a measurement filter F, which is counted to P in L0, the M of |C S| is M/|F|; |P| in the last one has none)
violated inside one interval of k; along neighbouring frequencies that violate, the union of these intervals is one
interval again, from the smallest lower to the largest upper end.  A margin or another quantity of a crossover is read
where ln|L0| = -kappa, so that a run of frequencies that violate forbids the interval that -ln|L0| covers there.

Source: derived; the squares of the responses as quadratics in the gain.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CS,
    DELAY_MARGIN,
    END,
    GAIN_MARGIN,
    LOOP_GAIN,
    NOTHING,
    PHASE_MARGIN,
    PHASE_SLOPE,
    PS,
    S,
    compiled,
    order_by_first,
)
from fopi_tune.design.global_search.rays import BEYOND, alias_gain, fill_ray, find_passages, forbid, forbid_unstable

_PI = math.pi


@compiled
def negative_interval(a, b, c):
    """The k > 0 with a k^2 + 2 b k + c < 0: (low, high), low > high when there are none, high inf when all beyond."""
    d = b * b - a * c
    if c >= 0.0:
        if d < 0.0 or (a >= 0.0 and b >= 0.0):
            return 1.0, 0.0
        q = -b + math.sqrt(d)
        if q <= 0.0:
            return 1.0, 0.0
        return c / q, (q / a if a > 0.0 else np.inf)
    if a <= 0.0 and d < 0.0:
        return 0.0, np.inf
    root = math.sqrt(max(d, 0.0))
    if b > 0.0:
        return 0.0, -c / (b + root)
    return 0.0, ((-b + root) / a if a > 0.0 else np.inf)


@compiled
def band_interval(kind, limit, i, j, table, work):
    """Where (1) is violated at one frequency: interval of k."""
    if kind == CS:
        limit -= table.filter_gain[j]
    elif kind == PS:
        kind, limit = S, limit - table.plant_gain[i, j]
    return band_interval_of(
        kind, math.exp(-2.0 * limit), work.square[i, j], work.real[i, j], work.controller[1, j], work.controller[2, j]
    )


@compiled
def band_interval_of(kind, inverse, a, b, c_real, c_imag):
    """`band_interval` from numbers, with e^(-2 limit), |L0|^2, Re L0 and C0."""
    if kind == S:
        return negative_interval(a, b, 1.0 - inverse)
    if kind == CS:
        size = c_real * c_real + c_imag * c_imag
        return negative_interval(a - size * inverse, b, 1.0)
    return negative_interval(a * (1.0 - inverse), b, 1.0)


@compiled
def vertex(v, y, j):
    """The extreme value of the parabola through y[j - 1], y[j], y[j + 1]."""
    h, k = v[j] - v[j - 1], v[j + 1] - v[j]
    left, right = (y[j] - y[j - 1]) / h, (y[j + 1] - y[j]) / k
    a = (right - left) / (h + k)
    if a == 0.0 or not math.isfinite(a):
        return y[j]
    slope = left + a * h
    d = -0.5 * slope / a
    return y[j] + slope * d + a * d * d if -h <= d <= k else y[j]


@compiled
def _log(x):
    return math.log(x) if x > 1e-50 else -BEYOND


@compiled
def _extreme(v, y, j, first, last):
    """ln of y[j], an extreme, refined by a parabola in ln y where it lies inside a run."""
    if j <= first or j >= last or j < 2 or j > len(v) - 3:
        return _log(y[j])
    if not (0.0 < y[j - 1] < np.inf and 0.0 < y[j + 1] < np.inf and y[j] > 0.0):
        return _log(y[j])
    logs = np.array((math.log(y[j - 1]), math.log(y[j]), math.log(y[j + 1])))
    return vertex(v[j - 1 : j + 2], logs, 1)


@compiled
def forbid_band_above(kind, limit, tilt, i, first, last, table, work, count):
    """Forbid what exceeds an upper limit of |S|, |T|, |C S| or |P S| somewhere in the band."""
    begin, inverse = -1, math.exp(-2.0 * limit)
    own = S if kind == PS else kind
    for j in range(first, last + 2):
        low, high = 1.0, 0.0
        if j <= last:
            here = inverse if tilt == 0.0 else inverse * math.exp(-2.0 * tilt * table.log_omega[j])
            if kind == CS:
                here *= math.exp(2.0 * table.filter_gain[j])
            elif kind == PS:
                here *= math.exp(2.0 * table.plant_gain[i, j])
            low, high = band_interval_of(
                own, here, work.square[i, j], work.real[i, j], work.controller[1, j], work.controller[2, j]
            )
            work.low[j], work.high[j] = low, high
        if high > low:
            if begin < 0:
                begin = j
        elif begin >= 0:
            at_low = at_high = begin
            for t in range(begin + 1, j):
                if work.low[t] < work.low[at_low]:
                    at_low = t
                if work.high[t] > work.high[at_high]:
                    at_high = t
            lower = _extreme(table.v, work.low, at_low, begin, j - 1)
            upper = BEYOND if work.high[at_high] == np.inf else _extreme(table.v, work.high, at_high, begin, j - 1)
            count = forbid(work, count, lower, upper)
            begin = -1
    return count


@compiled
def range_of_band_below(kind, limit, tilt, i, first, last, table, work):
    """The kappa that stay above a lower limit of |S|, |T|, |C S| or |P S| in the whole band: (low, high)."""
    lower, upper = 0.0, np.inf
    for j in range(first, last + 1):
        low, high = band_interval(kind, limit + tilt * table.log_omega[j], i, j, table, work)
        if high <= low:
            return 1.0, 0.0
        lower, upper = max(lower, low), min(upper, high)
    return _log(lower), (BEYOND if upper == np.inf else _log(upper))


@compiled
def excess(kind, limit, i, j, table, work):
    """How far the angle (cosine) or the lag to -1 at a column lies beyond a limit; negative where it is smaller."""
    if j >= table.alias[i]:
        return -1.0
    return excess_of(kind, limit, math.cos(limit), work.real[i, j], work.square[i, j], work.phase[i, j], table.omega[j])


@compiled
def excess_of(kind, limit, cosine, real, square, phase, omega):
    """`excess` from numbers: to hand over tables for every column takes longer than all else."""
    if kind == PHASE_MARGIN:
        size = math.sqrt(square)
        return cosine + real / size if size > 0.0 else 0.0
    lag = (phase + _PI) % (2.0 * _PI)
    return lag - limit * omega


@compiled
def collect_runs(kind, limit, below, i, table, work):
    """Intervals of kappa whose crossover has an angle or lag below (above) a limit, into `allowed`; their number."""
    n, count, inside, low, high, last = work.gain.shape[1], 0, False, 0.0, 0.0, 0.0
    cosine = math.cos(limit)
    for j in range(n):
        e = -1.0
        if j < table.alias[i]:
            e = excess_of(kind, limit, cosine, work.real[i, j], work.square[i, j], work.phase[i, j], table.omega[j])
        now = (e < 0.0) == below
        at = -work.gain[i, j]
        if now != inside:
            edge = at
            if j > 0:
                part = last / (last - e)
                if abs(last - e) > 3.0:
                    # the lag jumps from 0 to a turn at -1 itself
                    a, b = last + limit * table.omega[j - 1], e + limit * table.omega[j]
                    part = a / (a + 2.0 * _PI - b) if a < b else (2.0 * _PI - a) / (2.0 * _PI - a + b)
                edge = -(work.gain[i, j - 1] + part * (work.gain[i, j] - work.gain[i, j - 1]))
            if now:
                low, high = min(edge, at), max(edge, at)
                if j == 0 and work.gain[i, 0] > END - 5.0:
                    low = -BEYOND
            elif count < len(work.allowed):
                work.allowed[count, 0], work.allowed[count, 1] = min(low, edge), max(high, edge)
                count += 1
            inside = now
        elif now:
            low, high = min(low, at), max(high, at)
        elif below and 1 < j < table.alias[i] and passes(work.phase[i, j - 1], work.phase[i, j]):
            count = _passage_between(kind, limit, i, j, count, table, work)
        last = e
    if inside and count < len(work.allowed):
        if work.gain[i, n - 1] < -END + 5.0 or table.delay[i] > 0.0:
            high = BEYOND
        work.allowed[count, 0], work.allowed[count, 1] = low, high
        count += 1
    return count


@compiled
def passes(a, b):
    """Whether a phase passes -180 deg (mod 360) between two values."""
    return math.floor((a + _PI) / (2.0 * _PI)) != math.floor((b + _PI) / (2.0 * _PI))


@compiled
def _passage_between(kind, limit, i, j, count, table, work):
    """Add what is too close to -1 where the phase passes it between columns j - 1 and j, both beyond the limit."""
    a, b = work.phase[i, j - 1] + _PI, work.phase[i, j] + _PI
    turn = math.floor(a / (2.0 * _PI))
    if turn == math.floor(b / (2.0 * _PI)) or count >= len(work.allowed):
        return count
    level = 2.0 * _PI * (turn if b < a else turn + 1)
    upper, lower = (limit, -limit) if kind == PHASE_MARGIN else (limit * table.omega[j], 0.0)
    first = min(max((a - level - upper) / (a - b), 0.0), 1.0)
    second = min(max((a - level - lower) / (a - b), 0.0), 1.0)
    step = work.gain[i, j] - work.gain[i, j - 1]
    x, y = -work.gain[i, j - 1] - first * step, -work.gain[i, j - 1] - second * step
    work.allowed[count, 0], work.allowed[count, 1] = min(x, y), max(x, y)
    return count + 1


@compiled
def collect_gain_margins(limit, i, table, work):
    """Intervals of kappa with a gain margin below a limit, into `allowed`; their number."""
    count = work.cross_count[i]
    for r in range(count):
        work.allowed[r, 0], work.allowed[r, 1] = -limit - work.cross_gain[i, r], -work.cross_gain[i, r]
    if table.delay[i] > 0.0:
        work.allowed[count, 0], work.allowed[count, 1] = -limit - alias_gain(i, table, work), BEYOND
        count += 1
    return count


@compiled
def forbid_outside(work, count, found):
    """Forbid all kappa outside of the union of the first `found` intervals of `allowed`."""
    order = order_by_first(work.allowed, found)
    reached = -BEYOND
    for r in range(found):
        count = forbid(work, count, reached, work.allowed[order[r], 0])
        reached = max(reached, work.allowed[order[r], 1])
    return forbid(work, count, reached, BEYOND)


@compiled
def forbid_slopes(side, limit, i, table, work, count):
    """Forbid the kappa whose highest crossover has a slope of the phase beyond a limit."""
    n = work.gain.shape[1]
    top = bottom = work.gain[i, n - 1]
    for j in range(n - 2, 0, -1):
        g = work.gain[i, j]
        if bottom <= g <= top:
            continue
        if side * (limit - slope_at(i, j, table, work)) < 0.0:
            near = top if g > top else bottom
            count = forbid(work, count, min(-g, -near), max(-g, -near))
        top, bottom = max(top, g), min(bottom, g)
    if side * (limit - slope_at(i, 1, table, work)) < 0.0:
        # crossovers below the grid, where the slope no longer changes
        count = forbid(work, count, -BEYOND, -top)
    return count


@compiled
def slope_at(i, j, table, work):
    """d arg L / d log10 omega by central differences."""
    a, b = max(j - 1, 1), min(j + 1, work.gain.shape[1] - 2)
    return (work.phase[i, b] - work.phase[i, a]) / (table.log_omega[b] - table.log_omega[a]) * math.log(10.0)


@compiled
def crossover_range(i, first, work):
    """The kappa with a gain crossover at or above a column: (low, high)."""
    largest, smallest = -np.inf, np.inf
    for j in range(first, work.gain.shape[1]):
        largest, smallest = max(largest, work.gain[i, j]), min(smallest, work.gain[i, j])
    low = -BEYOND if largest > END - 5.0 else -largest
    return low, (BEYOND if smallest < -END + 5.0 else -smallest)


@compiled
def forbid_row(q, i, table, rows, work, count):
    """Forbid what violates row q with plant i; returns the number of forbidden intervals."""
    kind, side, limit = rows.kind[q], rows.side[q], rows.limit[q]
    first, last = rows.first[q], rows.last[q]
    low, high = -BEYOND, BEYOND
    if kind < LOOP_GAIN:
        if side > 0:
            return forbid_band_above(kind, limit, rows.tilt[q], i, first, last, table, work, count)
        low, high = range_of_band_below(kind, limit, rows.tilt[q], i, first, last, table, work)
    elif kind == LOOP_GAIN:
        for j in range(first, last + 1):
            here = limit + rows.tilt[q] * table.log_omega[j] - work.gain[i, j]
            if side > 0:
                high = min(high, here)
            else:
                low = max(low, here)
    elif kind in (PHASE_MARGIN, DELAY_MARGIN, GAIN_MARGIN):
        if kind == GAIN_MARGIN:
            found = collect_gain_margins(limit, i, table, work)
        else:
            found = collect_runs(kind, limit, True, i, table, work)
        if kind == DELAY_MARGIN and abs(table.high_slope[i]) < 1e-9 and found < len(work.allowed):
            # |L| does not fall below 1 at the end: no delay is borne
            work.allowed[found, 0], work.allowed[found, 1] = -work.gain[i, work.gain.shape[1] - 1], BEYOND
            found += 1
        if side > 0:
            return forbid_outside(work, count, found)
        for r in range(found):
            count = forbid(work, count, work.allowed[r, 0], work.allowed[r, 1])
        return count
    elif kind == CROSSOVER:
        if side < 0:
            low, high = crossover_range(i, first, work)
        else:
            low, high = crossover_range(i, 0, work)
            above, below = crossover_range(i, first, work)
            count = forbid(work, count, above, below)
    elif kind == PHASE_SLOPE:
        low, high = crossover_range(i, 0, work)
        count = forbid_slopes(side, limit, i, table, work, count)
    if low >= high:
        return forbid(work, count, -BEYOND, BEYOND)
    count = forbid(work, count, -BEYOND, low)
    return forbid(work, count, high, BEYOND)


@compiled
def allowed_on_ray(low, high, table, rows, work):
    """`allowed_intervals` of the ray in the scratch arrays."""
    count = 0
    for i in range(table.gain.shape[0]):
        count = forbid_unstable(i, table, work, count)
        for q in range(len(rows.kind)):
            if rows.side[q] != 0 and not rows.soft[q] and (i == 0 or not rows.nominal[q]):
                count = forbid_row(q, i, table, rows, work, count)
    order = order_by_first(work.forbidden, count)
    found, reached = 0, low
    for r in range(count + 1):
        begin = work.forbidden[order[r], 0] if r < count else NOTHING
        if begin >= reached and found < len(work.found):
            end = min(begin, high)
            if end > reached or (low == high and end == reached):
                work.found[found, 0], work.found[found, 1] = reached, end
                found += 1
        if r < count:
            reached = max(reached, work.forbidden[order[r], 1])
        if reached > high or (reached == high and low != high):
            break
    return found


@compiled
def allowed_intervals(third, c, s, low, high, table, rows, work):
    """The kappa in [low, high] that are stable and meet all inequalities: their number; the intervals are in `found`.

    Args:
        third, c, s: the numbers of C0, as in `fill_ray`.
        low, high: the range of kappa; equal ends ask about one value.
        table: the plants, the nominal one first.
        rows: what is asked; equalities are not.
        work: scratch arrays; the ray's responses and passages are left there.
    """
    fill_ray(third, c, s, table, work)
    find_passages(third, c, s, table, work)
    return allowed_on_ray(low, high, table, rows, work)
