"""Values of a ray's loops at one kappa, read off a table:  quantities, objectives, places of equalities (compiled).

They decide between rays and between starts, to the accuracy of the grid; `worst_case` has them exactly.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CROSSOVER_SPREAD,
    CS,
    CS_PEAK,
    DELAY_MARGIN,
    ENDLESS,
    GAIN_MARGIN,
    IAE,
    KI,
    LOOP_GAIN,
    MARGIN_SPREAD,
    NOTHING,
    PHASE_MARGIN,
    PHASE_SLOPE,
    PS,
    PS_PEAK,
    S_PEAK,
    S,
    T,
    compiled,
)
from fopi_tune.design.global_search.controllers import controller_at_real, controller_of, order_of
from fopi_tune.design.global_search.intervals import band_interval, excess, slope_at

_PI = math.pi
#: the slack of a quantity that a loop should have and has not
_MISSING = -3.0
#: natural units; a value this far from the equality's limit is another crossing's
_NEAR = 0.1


@compiled
def extreme_of_band(kind, largest, tilt, kappa, i, first, last, table, work):
    """The largest or smallest ln of |S|, |T|, |C S|, |P S| or |L| over columns, less tilt ln(omega/omega_s)."""
    k = math.exp(kappa)
    if kind == S and tilt == 0.0:
        low, high = np.inf, -np.inf
        for j in range(first, last + 1):
            square = 1.0 + k * (2.0 * work.real[i, j] + k * work.square[i, j])
            low, high = min(low, square), max(high, square)
        return -0.5 * math.log(max(low if largest else high, 1e-300))
    best = -np.inf if largest else np.inf
    for j in range(first, last + 1):
        if kind == LOOP_GAIN:
            value = work.square[i, j]
        else:
            value = 1.0 / max(1.0 + k * (2.0 * work.real[i, j] + k * work.square[i, j]), 1e-300)
            if kind == T:
                value *= work.square[i, j]
            elif kind == CS:
                value *= work.controller[1, j] ** 2 + work.controller[2, j] ** 2
                if table.filter_gain[j] != 0.0:
                    value *= math.exp(2.0 * table.filter_gain[j])
            elif kind == PS:
                value *= math.exp(2.0 * table.plant_gain[i, j])
        if tilt != 0.0:
            value *= math.exp(-2.0 * tilt * table.log_omega[j])
        best = max(best, value) if largest else min(best, value)
    if best <= 0.0:
        return -NOTHING
    return 0.5 * math.log(best) + (0.0 if kind in (S, PS) else kappa)


@compiled
def at_crossovers(kind, kappa, i, table, work):
    """The smallest angle or lag to -1 over all gain crossovers, or crossover or slope at the highest; else NOTHING."""
    n, best = work.gain.shape[1], NOTHING
    for j in range(n - 2, -1, -1):
        a, b = work.gain[i, j] + kappa, work.gain[i, j + 1] + kappa
        if (a > 0.0) == (b > 0.0):
            continue
        part = a / (a - b)
        log_omega = table.log_omega[j] + part * (table.log_omega[j + 1] - table.log_omega[j])
        if kind == CROSSOVER:
            return log_omega
        if kind in (PHASE_MARGIN, DELAY_MARGIN):
            if j >= table.alias[i]:
                return 0.0
            angle = work.phase[i, j] + part * (work.phase[i, j + 1] - work.phase[i, j]) + _PI
            lag = angle % (2.0 * _PI)
            value = min(lag, 2.0 * _PI - lag) if kind == PHASE_MARGIN else lag * math.exp(-log_omega)
            best = min(best, value)
        else:
            return slope_at(i, j, table, work) * (1.0 - part) + slope_at(i, j + 1, table, work) * part
    return best


@compiled
def measured(q, kappa, i, table, rows, work):
    """The value of row q's quantity for plant i, the side the row asks about; NOTHING where there is none."""
    kind = rows.kind[q]
    if kind <= LOOP_GAIN:
        largest, tilt = rows.side[q] >= 0, rows.tilt[q]
        return extreme_of_band(kind, largest, tilt, kappa, i, rows.first[q], rows.last[q], table, work)
    if kind == GAIN_MARGIN:
        best = NOTHING
        for r in range(work.cross_count[i]):
            g = work.cross_gain[i, r] + kappa
            if g <= 0.0:
                best = min(best, -g)
        return best
    return at_crossovers(kind, kappa, i, table, work)


@compiled
def slack(q, kappa, i, table, rows, work):
    """Of an inequality: how far inside, natural units; of an equality: the signed distance from the limit."""
    value = measured(q, kappa, i, table, rows, work)
    if value == NOTHING and (rows.kind[q] == CROSSOVER or rows.kind[q] == PHASE_SLOPE or rows.side[q] == 0):
        return _MISSING
    if rows.side[q] == 0:
        return (rows.limit[q] - value) * rows.scale[q]
    return rows.side[q] * (rows.limit[q] - value) * rows.scale[q]


@compiled
def depth(kappa, table, rows, work):
    """The smallest slack of the inequalities that count."""
    least = ENDLESS
    for q in range(len(rows.kind)):
        if not rows.in_depth[q]:
            continue
        for i in range(1 if rows.nominal[q] else table.gain.shape[0]):
            value = slack(q, kappa, i, table, rows, work)
            least = min(least, -abs(value) if rows.side[q] == 0 else value)
    return least


@compiled
def controller_at_horizon(third, c, s, table, box):
    """C0 of the ray at the horizon's s."""
    return controller_at_real(controller_of(np.array((c, s, third)), table.sampling), -box.log_horizon)


@compiled
def cost(code, kappa, third, c, s, table, rows, box, work):
    """What the objective makes of one kappa on the ray in the scratch arrays; smaller is better."""
    m, n = work.gain.shape
    if code == KI:
        return -s * math.exp(kappa + order_of(third, table.sampling) * box.log_omega - box.log_gain)
    if code == IAE:
        controller, worst = math.exp(kappa) * controller_at_horizon(third, c, s, table, box), 0.0
        for i in range(m):
            p = table.error_gain[i]
            worst = max(worst, abs(p / (1.0 + controller * p)))
        return math.log(worst) if worst > 0.0 else -NOTHING
    if code in (S_PEAK, CS_PEAK, PS_PEAK):
        worst, kind = -NOTHING, S if code == S_PEAK else CS if code == CS_PEAK else PS
        for i in range(m):
            worst = max(worst, extreme_of_band(kind, True, 0.0, kappa, i, 0, n - 1, table, work))
        return worst
    if code == MARGIN_SPREAD:
        nominal, worst = at_crossovers(PHASE_MARGIN, kappa, 0, table, work), 0.0
        if nominal == NOTHING:
            return NOTHING
        for i in range(1, m):
            worst = max(worst, abs(at_crossovers(PHASE_MARGIN, kappa, i, table, work) - nominal))
        return worst
    if code == CROSSOVER_SPREAD:
        at = at_crossovers(CROSSOVER, kappa, 0, table, work)
        if at == NOTHING:
            return NOTHING
        j = min(np.searchsorted(table.log_omega, at) - 1, n - 2)
        part, worst = (at - table.log_omega[j]) / (table.log_omega[j + 1] - table.log_omega[j]), 0.0
        for i in range(1, m):
            g = work.gain[i, j] + part * (work.gain[i, j + 1] - work.gain[i, j]) + kappa
            worst = max(worst, abs(g))
        return worst
    return -depth(kappa, table, rows, work)


@compiled
def _keep(q, kappa, count, table, rows, work, out):
    if count < len(out) and abs(measured(q, kappa, 0, table, rows, work) - rows.limit[q]) * rows.scale[q] < _NEAR:
        out[count] = kappa
        return count + 1
    return count


@compiled
def _keep_roots(kind, limit, j, count, table, work, out):
    """The one or two k with |S|, |T|, |C S| or |P S| = e^limit at a frequency."""
    low, high = band_interval(kind, limit, 0, j, table, work)
    for k in (low, high):
        if 0.0 < k < math.inf and low < high and count < len(out):
            out[count] = math.log(k)
            count += 1
    return count


@compiled
def equality_gains(q, table, rows, work, out):
    """The kappa with (limit = value) in row q for the nominal plant, on the ray in the scratch arrays; their number."""
    kind, limit, n, count = rows.kind[q], rows.limit[q], work.gain.shape[1], 0
    if kind == CROSSOVER:
        return _keep(q, -work.gain[0, rows.first[q]] - 1e-9, 0, table, rows, work, out)
    if kind == LOOP_GAIN:
        out[0] = limit - work.gain[0, rows.first[q]]
        return 1
    if kind < LOOP_GAIN:
        return _keep_roots(kind, limit, rows.first[q], 0, table, work, out)
    if kind == GAIN_MARGIN:
        for r in range(work.cross_count[0]):
            count = _keep(q, -limit - work.cross_gain[0, r], count, table, rows, work, out)
        return count
    last = 0.0
    for j in range(1, n - 1):
        if kind in (PHASE_MARGIN, DELAY_MARGIN):
            value = excess(kind, limit, 0, j, table, work)
        else:
            value = limit - slope_at(0, j, table, work)
        if j > 1 and (value < 0.0) != (last < 0.0) and abs(value - last) < 3.0:
            part = last / (last - value)
            g = work.gain[0, j - 1] + part * (work.gain[0, j] - work.gain[0, j - 1])
            count = _keep(q, -g, count, table, rows, work, out)
        last = value
    return count
