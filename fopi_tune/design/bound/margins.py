"""The kappa at which the margins of all loops of a cell are too small, or those of some may be small (compiled).

Margins are read where |L| = 1, in general between two columns of the table.  Between neighbouring columns with distance
h a function stays, but for terms of higher order, within

    h^2/8 |its largest second difference there|                                                                     (1)

of its chord.

Source: derived; Taylor's formula.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.bound.columns import DOWN, ROOM, UP
from fopi_tune.design.bound.derivative_cells import end_of_cell
from fopi_tune.design.global_search.compiled import DELAY_MARGIN, PHASE_MARGIN, compiled
from fopi_tune.design.global_search.rays import BEYOND

_PI = math.pi


@compiled
def forbid_interval(forbidden, count, low, high):
    """Append an interval of kappa to the forbidden ones; returns their new number."""
    if high > low and count < len(forbidden):
        forbidden[count, 0], forbidden[count, 1] = low, high
        return count + 1
    return count


@compiled
def gains_at_end(i, cell, signs, table):
    """(the least ln|L0| of the cell at the upper end of the axis, where the integral has vanished, and the largest)."""
    least, most, _ = end_of_cell(cell, signs, table.sampling.derivative)
    gain = table.gain[i, -1]
    return (
        gain + (math.log(least) if least > 1e-12 else -BEYOND),
        gain + (math.log(most) if most > 1e-12 else -BEYOND),
    )


@compiled
def _too_close(kind, limit, phase, room):
    """Whether every loop of the cell is closer to -1 at a column than an angle, or lags by less."""
    if not room < _PI:
        return False
    lag = (phase + _PI) % (2.0 * _PI)
    if kind == PHASE_MARGIN:
        return min(lag, 2.0 * _PI - lag) + room < limit
    return lag - room > 0.0 and lag + room < limit


@compiled
def forbid_too_close(kind, limit, i, table, work, slopes, count):
    """Forbid the kappa at which every loop has a crossover that is too close to -1."""
    n, low, high = work.gain.shape[1], np.inf, -np.inf
    for j in range(1, n):
        close = False
        if j < n - 1:
            angle = limit if kind == PHASE_MARGIN else limit * table.omega[j]
            close = j >= table.alias[i] and slopes[ROOM, j] < _PI
            close = close or _too_close(kind, angle, work.phase[i, j], slopes[ROOM, j])
        if close:
            low = min(low, -work.gain[i, j] - slopes[DOWN, j])
            high = max(high, -work.gain[i, j] - slopes[UP, j])
        elif high > -np.inf:
            count = forbid_interval(work.forbidden, count, low, BEYOND if j == n - 1 and table.delay[i] > 0.0 else high)
            low, high = np.inf, -np.inf
    return count


@compiled
def bulge(y, v, j):
    """How far a function may leave its chord from column j - 1 to j:  h^2/8 times its largest second difference (1)."""
    n, bend = len(v), 0.0
    for k in (j - 1, j):
        if 1 < k < n - 2:
            left, right = (y[k] - y[k - 1]) / (v[k] - v[k - 1]), (y[k + 1] - y[k]) / (v[k + 1] - v[k])
            bend = max(bend, abs(right - left) / (0.5 * (v[k + 1] - v[k - 1])))
    return 0.125 * bend * (v[j] - v[j - 1]) ** 2


@compiled
def lag_exceeds(kind, limit, i, first, last, table, work, slopes):
    """Whether the lag to -1 of every loop of the cell exceeds a limit from one column to itself or to the next one.

    The phase lies between its values at the two columns but for (1), and their lags are counted from one turn; a phase
    margin's limit holds for the lead as well.  Nothing is known where the dead time turns too fast for the table.
    """
    if last > table.alias[i] or not (slopes[ROOM, first] < _PI and slopes[ROOM, last] < _PI):
        return False
    more = bulge(work.phase[i], table.v, last) if first < last else 0.0
    low = min(work.phase[i, first] - slopes[ROOM, first], work.phase[i, last] - slopes[ROOM, last]) - more + _PI
    high = max(work.phase[i, first] + slopes[ROOM, first], work.phase[i, last] + slopes[ROOM, last]) + more + _PI
    turn = 2.0 * _PI * math.floor(low / (2.0 * _PI))
    if kind == PHASE_MARGIN:
        return low - turn > limit and high - turn < 2.0 * _PI - limit
    return low - turn > limit * table.omega[last] and high - turn < 2.0 * _PI


@compiled
def margin_range(kind, limit, i, cell, signs, table, work, slopes):
    """The kappa at which a loop of the cell may have a crossover no farther from -1 than a limit: (low, high)."""
    n, low, high = work.gain.shape[1], BEYOND, -BEYOND
    for j in range(1, n):
        # a crossover between columns j - 1 and j, or beyond the ends of the table
        first, last = max(j - 1, 1), min(j, n - 2)
        if lag_exceeds(kind, limit, i, first, last, table, work, slopes):
            continue
        more = bulge(work.gain[i], table.v, last) if first < last else 0.0
        for k in (first, last):
            low = min(low, -work.gain[i, k] - slopes[UP, k] - more)
            high = max(high, -work.gain[i, k] - slopes[DOWN, k] + more)
        low, high = (-BEYOND if j == 1 else low), (BEYOND if j == n - 1 else high)
    if kind == DELAY_MARGIN and abs(table.high_slope[i]) < 1e-9:
        # where |L| does not fall below 1 at the end no delay is borne
        low, high = min(low, -gains_at_end(i, cell, signs, table)[1]), BEYOND
    return low, high
