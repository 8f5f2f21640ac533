"""The branch and bound of `core/peaks`, one loop after the other (compiled):  the same cells, the same extremes."""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.compiled.blocks import (
    BLOCK,
    FEWEST,
    GAIN,
    OF_BOTH,
    OF_GAIN,
    PHASE,
    SLOPE,
    TURN,
    bode_block,
)
from fopi_tune.core.compiled.loops import bode_at, entry, inner

_FIRST_CELLS, _PIECES = 24, 4
_SMALLEST_WIDTH, _TOLERANCE = 1e-10, 1e-10
#: ln|K| is clipped here
_GAIN_CAP = 300.0
_NO_LENGTH = 1e-200


@inner
def _distance_of_segment(x, y, dx, dy):
    """Distance from 0 of the segment from (x, y) - (dx, dy) to (x, y) + (dx, dy)."""
    square = dx * dx + dy * dy
    if square == np.inf:
        # far up the axis the square of a number is none any more: nothing is known
        return 0.0
    along = -(x * dx + y * dy) / square if math.sqrt(square) > _NO_LENGTH else -x
    along = min(max(along, -1.0), 1.0)
    return math.hypot(x + along * dx, y + along * dy)


@inner
def _term(gain, phase, rise, turn, gain_bound, bound, h):
    """Of a summand e^l: value, slope (four real numbers), bound of the curvature, smallest and largest value.

    Args:
        gain, phase, rise, turn, gain_bound, bound: of l at the middle of a cell, as of `bode_at`.
        h: half of the cell's width.
    """
    size = math.exp(min(gain, _GAIN_CAP))
    real, imag = size * math.cos(phase), size * math.sin(phase)
    reach = (abs(rise) + gain_bound * h) * h
    largest, smallest = math.exp(min(gain + reach, _GAIN_CAP)), math.exp(min(gain - reach, _GAIN_CAP))
    steep = math.hypot(rise, turn) + bound * h
    curvature = largest * (steep * steep + bound)
    if not math.isfinite(curvature):
        curvature = np.inf
    return real, imag, real * rise - imag * turn, real * turn + imag * rise, curvature, smallest, largest


#: without a second summand
_NO_TERM = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


#: of ln omega over u on samples: a bound of its second derivative, h (cos 2x - h) with h = sin 2x/(2x), 0 < x < pi/2
_LOG_OMEGA_BEND = 0.5


@inner
def _tilted(u, power, unit, reference):
    """power ln(omega/omega_0) at u, its slope, and a bound of its curvature."""
    if power == 0.0:
        return 0.0, 0.0, 0.0
    if not math.isfinite(unit):
        return power * (u - reference), power, 0.0
    # ln omega = ln x + ln(2/Ts), x = atan e^u
    n, x = math.exp(u), math.atan(math.exp(u))
    return power * (math.log(x) + unit - reference), power / ((n + 1.0 / n) * x), abs(power) * _LOG_OMEGA_BEND


@inner
def _term_at(terms, r, u, h, tilt):
    """`_term` of a function at u; zeros where there is no function."""
    if terms.whole.shape[1] == 0:
        return _NO_TERM
    gain, phase, rise, turn, of_gain, _, of_both = bode_at(terms, r, u, h)
    return _term(gain + tilt[0], phase, rise + tilt[1], turn, of_gain + tilt[2], of_both + tilt[2], h)


@inner
def _term_in(s, i, h, tilt):
    """`_term` of a place of a block."""
    return _term(
        s[GAIN, i] + tilt[0], s[PHASE, i], s[SLOPE, i] + tilt[1], s[TURN, i], s[OF_GAIN, i] + tilt[2],
        s[OF_BOTH, i] + tilt[2], h,
    )  # fmt: skip


@inner
def _value_and_bound(one, single, first, second, h, sign):
    """sign * (-ln|K|) at a cell's centre, and what it cannot exceed on the cell.

    Args:
        one: whether the constant 1 is a summand of K.
        single: whether `first` is the only summand otherwise.
        first, second: the summands, as of `_term`.
        h: half of the cell's width.
        sign: 1 or -1.
    """
    x, y, dx, dy, curvature, small, large = first
    other_small, other_large = small, large
    if one:
        x, other_small, other_large = x + 1.0, 1.0, 1.0
    elif not single:
        a, b, da, db, more, other_small, other_large = second
        x, y, dx, dy, curvature = x + a, y + b, dx + da, dy + db, curvature + more
    # |K| >= the smallest value of one summand less the largest of the other
    total, smallest = large + other_large, max(small - other_large, other_small - large)
    if not one and single:
        total, smallest = large, small
    size, dx, dy = math.hypot(x, y), dx * h, dy * h
    slack = 0.5 * curvature * h * h if h > 0.0 else 0.0
    if sign > 0.0:
        reached = max(max(_distance_of_segment(x, y, dx, dy) - slack, smallest), 0.0)
    else:
        reached = min(max(math.hypot(x + dx, y + dy), math.hypot(x - dx, y - dy)) + slack, total)
    value = -sign * math.log(size) if size > 0.0 else sign * np.inf
    return value, (-sign * math.log(reached) if reached > 0.0 else sign * np.inf)


@inner
def _examine(one, first, second, r, cells, count, sign, values, bounds, power, unit, reference):
    """Write value and bound of the first cells, those of a block together."""
    single = second.whole.shape[1] == 0
    for begin in range(0, count, BLOCK):
        n = min(BLOCK, count - begin)
        if n < FEWEST:
            for i in range(begin, begin + n):
                u, h = 0.5 * (cells[i, 0] + cells[i, 1]), 0.5 * (cells[i, 1] - cells[i, 0])
                tilt = _tilted(u, power, unit, reference)
                terms = _term_at(first, r, u, h, tilt), _term_at(second, r, u, h, tilt)
                values[i], bounds[i] = _value_and_bound(one, single, terms[0], terms[1], h, sign)
            continue
        s = bode_block(first, r, cells[begin:, 0], cells[begin:, 1], n)
        t = s if single else bode_block(second, r, cells[begin:, 0], cells[begin:, 1], n)
        for i in range(n):
            h = 0.5 * (cells[begin + i, 1] - cells[begin + i, 0])
            tilt = _tilted(0.5 * (cells[begin + i, 0] + cells[begin + i, 1]), power, unit, reference)
            other = _NO_TERM if single else _term_in(t, i, h, tilt)
            own = _term_in(s, i, h, tilt)
            values[begin + i], bounds[begin + i] = _value_and_bound(one, single, own, other, h, sign)


@entry
def branch_and_bound(one, first, second, low, high, sign, floor, most_cells, power=0.0, unit=np.nan, reference=0.0):
    """max over u of sign * (-ln|K (omega/omega_0)^power|) on [low, high], shapes (m,), its u, and the number of cells.

    Args:
        one: whether the constant 1 is a summand of K.
        first, second: the other summands in Bode form, `second` of 0 rows where there is none.
        low, high: shape (m,).
        sign: 1 or -1.
        floor: shape (m,); cells with a bound below it are dropped.
        power, unit, reference: of the factor; ln(2/Ts) on samples, else nan; ln omega_0.  With a power `one` is False.
        most_cells: of all rows; with more the number of cells is what was examined until then.
    """
    m, work = len(low), 0
    best, where = np.full(m, -np.inf), low.copy()
    cells, new = np.empty((256, 2)), np.empty((256, 2))
    for r in range(m):
        for end in range(2):
            u = low[r] if end == 0 else high[r]
            tilt = _tilted(u, power, unit, reference)
            terms = _term_at(first, r, u, 0.0, tilt), _term_at(second, r, u, 0.0, tilt)
            value, _ = _value_and_bound(one, second.whole.shape[1] == 0, terms[0], terms[1], 0.0, sign)
            if value > best[r]:
                best[r], where[r] = value, u
        count, wide = 1, _FIRST_CELLS
        cells[0, 0], cells[0, 1] = low[r], high[r]
        while count > 0:
            if wide * count > len(new):
                new = np.empty((2 * wide * count, 2))
            for i in range(count):
                for k in range(wide):
                    a, b = cells[i, 0], cells[i, 1]
                    new[wide * i + k, 0] = a + (b - a) * (k / wide)
                    new[wide * i + k, 1] = a + (b - a) * ((k + 1) / wide) if k < wide - 1 else b
            count, wide = wide * count, _PIECES
            work += count
            if work > most_cells:
                return best, where, work
            if len(cells) < count:
                cells = np.empty((2 * count, 2))
            # the best value of all decides
            values, bounds, level, at = np.empty(count), np.empty(count), -np.inf, 0.0
            _examine(one, first, second, r, new, count, sign, values, bounds, power, unit, reference)
            for i in range(count):
                if values[i] >= level:
                    level, at = values[i], 0.5 * (new[i, 0] + new[i, 1])
            if level > best[r]:
                best[r], where[r] = level, at
            kept = 0
            for i in range(count):
                enough = bounds[i] > max(best[r], floor[r]) + _TOLERANCE
                if enough and 0.5 * (new[i, 1] - new[i, 0]) > _SMALLEST_WIDTH:
                    cells[kept, 0], cells[kept, 1] = new[i, 0], new[i, 1]
                    kept += 1
            count = kept
    return best, where, work
