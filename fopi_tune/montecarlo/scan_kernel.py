"""Loops on a frequency grid (compiled):  values, what crosses |L| = 1 and the negative real axis, highest peaks.

Loops are the lanes: a point of the grid belongs to many of them, so that the controller is computed once a point.
Between neighbouring points a loop

    crosses |L| = 1                  where |L| - 1 changes its sign,
    crosses the negative real axis   where Im L changes its sign and x_1 y_2 - x_2 y_1 has the sign of y_1 - y_2 ,

that is where the straight line from x_1 + j y_1 to x_2 + j y_2 meets the real axis left of 0.  No logarithm and no
phase is needed for it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from fopi_tune.core.compiled import loops as compiled_loops
from fopi_tune.core.compiled.kept import kept, sources
from fopi_tune.core.compiled.loops import controller_at, polynomial

#: what a scan looks at
SENSITIVITY, COMPLEMENTARY_SENSITIVITY, CONTROL_SENSITIVITY, LOAD_SENSITIVITY, LOOP_GAIN = range(5)
#: local peaks of the grid that are refined, and the steps of each by golden-section search
_PEAKS, _BRACKETS = 3, 24
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: u is cut here, so that e^u and its square stay finite
_U_CAP = 300.0
#: squares between these neither overflow nor lose digits
_SMALL, _LARGE = 1e-280, 1e280

_inner: Any = njit(error_model="numpy")
_SOURCES = sources([Path(__file__), *Path(compiled_loops.__file__).parent.glob("*.py")])


class Scanned(NamedTuple):
    """Loops on samples, for compiled functions.

    Fields: `direct` of the loops, of which the controller and the delays are used; `filter_bottom`, 1/F in descending
    powers of w, shape (1, a); the polynomials of the plants alone, in delta; and `half_sample_s`, Ts/2.
    """

    direct: Any
    filter_bottom: Any
    numerator: Any
    denominator: Any
    half_sample_s: float


class Grid(NamedTuple):
    """Where loops are looked at.

    Fields: `u`, shape (g, n), ascending; `rows`, shape (m,), the loops' rows of it; `loop_real`, `loop_imag`, shape
    (m, n), what L is there; `log_controller`, shape (g, n), ln|C F|.
    """

    u: Any
    rows: Any
    loop_real: Any
    loop_imag: Any
    log_controller: Any


@_inner
def _log_size(real, imag):
    """ln of the absolute value of a complex number."""
    square = real * real + imag * imag
    if _SMALL < square < _LARGE:
        return 0.5 * math.log(square)
    return math.log(math.hypot(real, imag))


@_inner
def _quotient(a, b, c, d):
    """(a + jb)/(c + jd)."""
    square = c * c + d * d
    return (a * c + b * d) / square, (b * c - a * d) / square


@_inner
def _product(a, b, c, d):
    """(a + jb)(c + jd)."""
    return a * c - b * d, a * d + b * c


@_inner
def _filtered_controller(scanned, u):
    """C F, and delta = z - 1: four real numbers."""
    real, imag, s_real, s_imag = controller_at(scanned.direct, 0, u)
    if scanned.filter_bottom.shape[1] > 1:
        below = polynomial(scanned.filter_bottom, 0, 0.0, math.exp(min(u, _U_CAP)))
        real, imag = _quotient(real, imag, below[0], below[1])
    return real, imag, s_real, s_imag


@_inner
def _late(late, u):
    """z^-late at nu = e^u."""
    angle = -2.0 * late * math.atan(math.exp(min(u, _U_CAP)))
    return math.cos(angle), math.sin(angle)


@_inner
def _response(real, imag, log_controller, response):
    """ln of a response from L and ln|C F|."""
    log_loop = 0.0 if response in (SENSITIVITY, CONTROL_SENSITIVITY) else _log_size(real, imag)
    if response == LOOP_GAIN:
        return log_loop
    log_return = _log_size(1.0 + real, imag)
    if response == SENSITIVITY:
        return -log_return
    if response == COMPLEMENTARY_SENSITIVITY:
        return log_loop - log_return
    if response == CONTROL_SENSITIVITY:
        return log_controller - log_return
    return log_loop - log_controller - log_return


@_inner
def _tilted(scanned, u, tilt):
    """ln of what a tilt, (power, ln omega_0), takes from a response."""
    if tilt[0] == 0.0:
        return 0.0
    return tilt[0] * (math.log(math.atan(math.exp(u)) / scanned.half_sample_s) - tilt[1])


@_inner
def _value(scanned, r, u, response, sign, tilt):
    """A response of loop r at any u, times the sign, without its tilt."""
    c_real, c_imag, s_real, s_imag = _filtered_controller(scanned, u)
    a, b = polynomial(scanned.numerator, r, s_real, s_imag)
    c, d = polynomial(scanned.denominator, r, s_real, s_imag)
    real, imag = _quotient(a, b, c, d)
    real, imag = _product(real, imag, c_real, c_imag)
    l_real, l_imag = _late(scanned.direct.late[r], u)
    real, imag = _product(real, imag, l_real, l_imag)
    log_controller = 0.0
    if response in (CONTROL_SENSITIVITY, LOAD_SENSITIVITY):
        log_controller = _log_size(c_real, c_imag)
    return sign * (_response(real, imag, log_controller, response) - _tilted(scanned, u, tilt))


def _grid_of(scanned, u, rows):
    """The loops on a grid; `u` and `rows` as in `Grid`."""
    points = u.shape[1]
    controller = np.empty((4, u.shape[0], points))
    log_controller = np.empty(u.shape)
    for g in range(u.shape[0]):
        for k in range(points):
            found = _filtered_controller(scanned, u[g, k])
            for i in range(4):
                controller[i, g, k] = found[i]
            log_controller[g, k] = _log_size(found[0], found[1])
    loops = len(rows)
    loop_real, loop_imag = np.empty((loops, points)), np.empty((loops, points))
    factor = np.empty((2, points))
    work = np.empty((4, points))
    row, late = -1, -1.0
    # loops of equal delay one after the other: they share the controller with that delay
    for r in np.argsort(scanned.direct.late):
        if rows[r] != row or scanned.direct.late[r] != late:
            row, late = rows[r], scanned.direct.late[r]
            for k in range(points):
                real, imag = _late(late, u[row, k])
                factor[0, k], factor[1, k] = _product(real, imag, controller[0, row, k], controller[1, row, k])
        work[:] = 0.0
        for side in range(2):
            table = scanned.numerator if side == 0 else scanned.denominator
            for i in range(table.shape[1]):
                coefficient = table[r, i]
                for k in range(points):
                    a, b = work[2 * side, k], work[2 * side + 1, k]
                    x, y = controller[2, row, k], controller[3, row, k]
                    work[2 * side, k] = a * x - b * y + coefficient
                    work[2 * side + 1, k] = a * y + b * x
        for k in range(points):
            a, b = _quotient(work[0, k], work[1, k], work[2, k], work[3, k])
            loop_real[r, k], loop_imag[r, k] = _product(a, b, factor[0, k], factor[1, k])
    return Grid(u, rows, loop_real, loop_imag, log_controller)


@_inner
def _rises(x, y, x_next, y_next, of_phase):
    """1 where a line is crossed upwards, -1 downwards, 0 where it is not; of the phase or of the gain."""
    if of_phase:
        above, above_next = y > 0.0, y_next > 0.0
    else:
        # of the gain a square that overflows is above 1 all the same
        above, above_next = x_next * x_next + y_next * y_next > 1.0, x * x + y * y > 1.0
    if above == above_next or not math.isfinite(x + y + x_next + y_next):
        return 0
    if of_phase:
        # upwards in phase is downwards in Im L, left of 0
        across = x * y_next - x_next * y
        if (across <= 0.0) if above else (across >= 0.0):
            return 0
    return 1 if above else -1


def _crossings_of(grid, of_phase):
    """Row, column and direction of every crossing between a column and the next."""
    loops, points = grid.loop_real.shape
    count = 0
    found = np.empty((3, 4 * loops), dtype=np.int64)
    for r in range(loops):
        x, y = grid.loop_real[r], grid.loop_imag[r]
        for k in range(points - 1):
            rises = _rises(x[k], y[k], x[k + 1], y[k + 1], of_phase)
            if rises != 0:
                if count == found.shape[1]:
                    longer = np.empty((3, 2 * count), dtype=np.int64)
                    longer[:, :count] = found
                    found = longer
                found[0, count], found[1, count], found[2, count] = r, k, rises
                count += 1
    return found[0, :count], found[1, :count], found[2, :count] > 0


@_inner
def _golden(scanned, r, low, high, response, sign, tilt):
    """The largest value within a bracket, by golden-section search."""
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = _value(scanned, r, a, response, sign, tilt), _value(scanned, r, b, response, sign, tilt)
    for _ in range(_BRACKETS):
        if at_a > at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = _value(scanned, r, a, response, sign, tilt)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = _value(scanned, r, b, response, sign, tilt)
    return max(at_a, at_b)


def _extremes_of(scanned, grid, first, last, response, sign, tilt):
    """The largest value, times the sign, of a response over [first, last] in u; shape (m,)."""
    loops, points = grid.loop_real.shape
    best = np.empty(loops)
    places, values = np.empty(points + 2), np.empty(points + 2)
    tilts = np.zeros(grid.u.shape)
    if tilt[0] != 0.0:
        for g in range(grid.u.shape[0]):
            for k in range(points):
                tilts[g, k] = _tilted(scanned, grid.u[g, k], tilt)
    for r in range(loops):
        row, count = grid.rows[r], 1
        places[0], values[0] = first, _value(scanned, r, first, response, sign, tilt)
        for k in range(points):
            u = grid.u[row, k]
            if first < u < last:
                value = _response(grid.loop_real[r, k], grid.loop_imag[r, k], grid.log_controller[row, k], response)
                places[count], values[count] = u, sign * (value - tilts[row, k])
                count += 1
        places[count], values[count] = last, _value(scanned, r, last, response, sign, tilt)
        count += 1
        for k in range(count):
            if math.isnan(values[k]):
                values[k] = -np.inf
        best[r] = _refined(scanned, r, places[:count], values[:count], response, sign, tilt)
    return best


@_inner
def _refined(scanned, r, places, values, response, sign, tilt):
    """The largest of some values, and of what their highest local peaks rise to between the places."""
    count, best = len(values), -np.inf
    heights, peaks = np.full(_PEAKS, -np.inf), np.zeros(_PEAKS, dtype=np.int64)
    for k in range(count):
        best = max(best, values[k])
        left = values[k - 1] if k else -np.inf
        right = values[k + 1] if k + 1 < count else -np.inf
        if values[k] < left or values[k] < right or values[k] <= heights[_PEAKS - 1]:
            continue
        i = _PEAKS - 1
        while i > 0 and values[k] > heights[i - 1]:
            heights[i], peaks[i] = heights[i - 1], peaks[i - 1]
            i -= 1
        heights[i], peaks[i] = values[k], k
    for i in range(_PEAKS):
        if heights[i] > -np.inf:
            low, high = places[max(peaks[i] - 1, 0)], places[min(peaks[i] + 1, count - 1)]
            best = max(best, _golden(scanned, r, low, high, response, sign, tilt))
    return best


grid_of = kept(_grid_of, _SOURCES, nogil=True, error_model="numpy")
crossings_of = kept(_crossings_of, _SOURCES, nogil=True, error_model="numpy")
extremes_of = kept(_extremes_of, _SOURCES, nogil=True, error_model="numpy")
