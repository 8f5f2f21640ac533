"""Crossovers of loops:  every one, exactly.

    gain crossover     |L(j omega)| = 1
    phase crossover    arg L(j omega) = -180 deg (mod 360)

The phase is unwrapped from omega -> 0, where it is -90 deg alpha for the fractional integral, -90 deg per integrator of
the plant, and -180 deg for a negative sign and for every open-loop pole in the right half-plane.  Stability needs its
sheet; margins do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Rows, contiguous_rows
from fopi_tune.core.loops import Loops
from fopi_tune.core.roots import find_roots, merged

#: their names in `Loops.computed`
_CROSSOVERS, _PHASE_CROSSOVERS, _RANGE = "gain crossovers", "phase crossovers", "range of gain crossovers"
#: |u| never exceeds this: omega stays inside what a double can hold
_U_CAP = 600.0
#: |ln|L|| is clipped here in results, so that |L| stays finite
_GAIN_CAP = 700.0
#: rad; phase lag of a dead time below this is neglected
_SMALL_TURN = 1e-9
#: an exponent of omega this small is 0 but for rounding
_FLAT_SLOPE = 1e-12
#: neper; levels of |L| this close are not told apart, nor is an excess of 2^-30
_SAME_GAIN, _HALVINGS = 1e-9, 31
#: rad; a phase this close to 180 deg at an end of the axis is 180 deg
_HALF_TURN = 1e-9


@dataclass(frozen=True)
class Crossings:
    """Points where loops cross a line, sorted by row, then frequency; all of shape (n,).

    Args:
        row: which loop.
        u: the coordinate of the Bode form; see `Loops.omega_of`.
        omega_rad_s: the frequency.
        gain: |L| there.
        phase_rad: unwrapped arg L there.
        slope_rad: d arg L / d ln omega there.
    """

    row: Rows
    u: Array
    omega_rad_s: Array
    gain: Array
    phase_rad: Array
    slope_rad: Array

    @property
    def angle_from_minus_one_rad(self) -> Array:
        """180 deg + arg L in (-180 deg, 180 deg]: from -1 to L; positive where a lag of that angle brings L to -1."""
        return np.pi - np.mod(-self.phase_rad, 2.0 * np.pi)

    @property
    def phase_margin_rad(self) -> Array:
        """The smallest angle between L and -1, by lag or by lead, in [0, 180 deg]."""
        return np.abs(self.angle_from_minus_one_rad)

    @property
    def delay_margin_s(self) -> Array:
        """The additional dead time that brings this crossing to -1:  the lag to it, in [0, 360 deg), over omega."""
        return np.mod(np.pi + self.phase_rad, 2.0 * np.pi) / self.omega_rad_s


def _crossings(loops: Loops, rows: Rows, u: Array) -> Crossings:
    value, slope = loops.log_response_and_slope(rows, u)
    gain = np.exp(np.clip(value.real, -_GAIN_CAP, _GAIN_CAP))
    return Crossings(rows, u, loops.omega_of(u), gain, value.imag, slope.imag / loops.stretch(u))


def _crossover_range(loops: Loops) -> tuple[Array, Array]:
    """`_gain_range` of |L| = 1."""
    if _RANGE not in loops.computed:
        loops.computed[_RANGE] = _gain_range(loops, np.zeros(len(loops)))
    return loops.computed[_RANGE]


def _gain_range(loops: Loops, level: Array) -> tuple[Array, Array]:
    """An interval of u outside which |L| follows its asymptotes and does not cross e^level."""
    log = loops.log
    low, high = log.corners()
    rows = np.arange(len(loops))
    low, high = np.clip(low, -_U_CAP, _U_CAP), np.clip(high, -_U_CAP, _U_CAP)

    def distance(u: Array, slope: Array) -> Array:
        flat = np.abs(slope) < _FLAT_SLOPE
        return np.where(flat, 0.0, (level - loops.log_response(rows, u).real) / np.where(flat, 1.0, slope))

    # Beyond the corners the slope is constant to 1e-8, so this lands beyond the last possible crossing.
    low = low + np.minimum(1.01 * distance(low, log.slope0), 0.0) - 1.0
    high = high + np.maximum(1.01 * distance(high, log.slope_end()), 0.0) + 1.0
    return np.maximum(low, -_U_CAP), np.minimum(high, _U_CAP)


def gain_crossovers(loops: Loops, level: Array | None = None) -> Crossings:
    """Every frequency with |L| = e^level (level 0: the gain crossovers) of every loop.

    Args:
        loops: m loops.
        level: shape (m,), in neper; 0 when left out.

    Returns:
        The crossings; a loop without any has no row in it.
    """
    if level is None:
        # several requirements ask for them
        if _CROSSOVERS not in loops.computed:
            none = np.zeros(len(loops))
            found = _roots(loops, none, np.arange(len(loops)), *_crossover_range(loops))
            loops.computed[_CROSSOVERS] = _crossings(loops, *found)
        return loops.computed[_CROSSOVERS]
    low, high = _gain_range(loops, level)
    return _crossings(loops, *_roots(loops, level, np.arange(len(loops)), low, high))


def phase_crossovers(loops: Loops) -> Crossings:
    """Every phase crossover that stability or a gain margin can depend on.

    With a dead time there are infinitely many; those left out have a higher frequency and a smaller |L| than one that
    is listed.  Where |L| tends to a constant below 1, their gains may approach it from below; that limit is listed too,
    as a crossing at omega = inf.  The limits omega -> 0 and inf are listed where L tends to a negative number: there a
    gain of 1/|L| puts a closed-loop pole at s = 0, at infinity, or, on samples, at z = -1.

    Returns:
        The crossings; a loop whose phase never meets -180 deg (mod 360) has no row in it.
    """
    if _PHASE_CROSSOVERS not in loops.computed:
        loops.computed[_PHASE_CROSSOVERS] = _phase_crossovers(loops)
    return loops.computed[_PHASE_CROSSOVERS]


def _phase_crossovers(loops: Loops) -> Crossings:
    low, high = (end.copy() for end in _crossover_range(loops))
    delay = loops.plants.dead_time_s
    delayed = np.flatnonzero(delay > 0)
    inner = _phase_crossings(loops, np.setdiff1d(np.arange(len(loops)), delayed), low, high)
    crossings = _joined(inner, *negative_ends(loops))
    if not len(delayed):
        return crossings
    low[delayed] = np.minimum(low[delayed], np.log(_SMALL_TURN / delay[delayed]))
    # From the last gain crossover on, more than one turn of the phase holds at least one crossing with |L| < 1 ...
    gain = gain_crossovers(loops)
    last = np.full(len(loops), -np.inf)
    np.maximum.at(last, gain.row, np.log(gain.omega_rad_s))
    last = np.where(np.isfinite(last), last, low)
    factors = loops.log.sign.shape[1]
    # one sum of powers is a controller's, which turns no further than its factors; a plant's by half a turn for a term
    factors += max(len(loops.log.sums) // len(loops) - 1, 0) * loops.log.sums.shape[2]
    factor_turns = 2.0 * np.pi * (2.0 + factors)
    first_stop, stop = high.copy(), high.copy()
    first_stop[delayed] = np.log(np.exp(last[delayed]) + factor_turns / delay[delayed])
    found = _phase_crossings(loops, delayed, low, first_stop)
    # ... and nothing beyond the last frequency with a larger |L| than the largest such crossing can set the margin.
    largest = np.full(len(loops), -np.inf)
    small = found.gain < 1.0
    np.maximum.at(largest, found.row[small], np.log(found.gain[small]))
    known = delayed[np.isfinite(largest[delayed])]
    level = gain_crossovers(loops.take(known), largest[known] - _SAME_GAIN)
    stop[delayed] = -np.inf
    np.maximum.at(stop, known[level.row], np.log(level.omega_rad_s))
    further = np.flatnonzero(stop > first_stop)
    limits = _limit_crossings(loops)
    # Where |L| tends to a constant that none of them exceeds, it may still exceed that constant on its way.
    risen = limits.row[np.log(limits.gain) > largest[limits.row] - 2.0 * _SAME_GAIN]
    beyond = _phase_crossings(loops, further, first_stop, stop)
    return _joined(crossings, found, beyond, limits, *_above_limit(loops, risen, first_stop))


def _above_limit(loops: Loops, rows: Rows, start: Array) -> list[Crossings]:
    """Crossings about the largest |L| beyond `start` of loops with a dead time whose |L| tends to a smaller constant.

    With an excess e over the limit that |L| reaches, but not 2 e, what lies outside the range of |L| > limit e^e has a
    smaller |L| than what lies within.  So the first e, falling, whose range holds a crossing tells the largest.
    """
    found: list[Crossings] = []
    limit = loops.log.end()[0]

    def ranges(rows: Rows, excess: float) -> tuple[Rows, Array, Array]:
        level = gain_crossovers(loops.take(rows), limit[rows] + excess)
        row, u = rows[level.row], np.log(level.omega_rad_s)
        low, high = np.full(len(loops), np.inf), np.full(len(loops), -np.inf)
        np.minimum.at(low, row, np.maximum(u, start[row]))
        np.maximum.at(high, row, u)
        above = rows[loops.log_response(rows, start[rows]).real > limit[rows] + excess]
        low[above] = start[above]
        return rows[high[rows] > start[rows]], low, high

    left = ranges(rows, _SAME_GAIN)[0] if len(rows) else rows
    for excess in 0.5 ** np.arange(1.0, _HALVINGS):
        if not len(left):
            break
        there, low, high = ranges(left, float(excess))
        found.append(_phase_crossings(loops, there, low, high))
        left = np.setdiff1d(left, found[-1].row)
    return found


def negative_ends(loops: Loops) -> tuple[Crossings, Crossings]:
    """omega -> 0 and, without a dead time, omega -> inf of loops whose L tends to a negative number there."""
    log, end = loops.log, loops.log.end()
    first = np.flatnonzero((log.slope0 == 0) & _is_half_turn(log.phase0))
    flat = np.abs(log.slope_end()) < _FLAT_SLOPE
    last = np.flatnonzero(flat & (log.delay == 0) & _is_half_turn(end[1]))
    return (
        _end_crossings(first, -np.inf, 0.0, log.scale[first], log.phase0[first]),
        _end_crossings(last, np.inf, loops.highest_rad_s, end[0][last], end[1][last]),
    )


def _is_half_turn(phase: Array) -> NDArray[np.bool_]:
    return np.abs(np.mod(phase, 2.0 * np.pi) - np.pi) < _HALF_TURN


def _end_crossings(rows: Rows, u: float, omega_rad_s: float, log_gain: Array, phase: Array) -> Crossings:
    one = np.ones(len(rows))
    gain = np.exp(np.clip(log_gain, -_GAIN_CAP, _GAIN_CAP))
    return Crossings(rows, u * one, omega_rad_s * one, gain, phase, np.zeros(len(rows)))


def _limit_crossings(loops: Loops) -> Crossings:
    """The limit omega -> inf of loops with a dead time whose |L| tends to a constant in (0, 1)."""
    log = loops.log
    gain, _ = log.end()
    rows = np.flatnonzero((log.delay > 0) & (log.slope_end() >= -_FLAT_SLOPE) & (gain < 0))
    inf = np.full(len(rows), np.inf)
    return Crossings(rows, inf, inf, np.exp(gain[rows]), -inf, -inf)


def _phase_crossings(loops: Loops, rows: Rows, low: Array, high: Array) -> Crossings:
    return _crossings(loops, *_roots(loops, None, rows, low[rows], high[rows]))


def _roots(loops: Loops, level: Array | None, rows: Rows, low: Array, high: Array) -> tuple[Rows, Array]:
    """Every |L| = e^level, or without a level every arg L = -180 deg (mod 360), of these loops on these intervals."""
    if not len(rows):
        return rows, low
    from fopi_tune.core.compiled.roots import loop_roots

    levels, rows = np.zeros(len(loops)) if level is None else level, contiguous_rows(rows)
    complete, found = loop_roots(level is None, loops.log.terms, loops.direct, levels, rows, low, high)
    if not complete:
        # the same search, which ends by saying why
        def function(rows: Rows, u: Array) -> tuple[Array, Array]:
            value, slope = loops.log_response_and_slope(rows, u)
            return (value.imag + np.pi, slope.imag) if level is None else (value.real - levels[rows], slope.real)

        # |e^{-j omega L}| = 1: the dead time bends only the phase
        bound = loops.log.curvature_bound if level is None else loops.log.gain_curvature_bound
        return find_roots(function, bound, rows, low, high, None if level is not None else 2.0 * np.pi)
    touching = found[:, 2] > 0.0
    at = merged([(found[touching, 0], found[touching, 1])])
    row = np.concatenate([found[~touching, 0], at[0]]).astype(np.intp)
    u = np.concatenate([found[~touching, 1], at[1]])
    order = np.lexsort((u, row))
    return row[order], u[order]


def _joined(*parts: Crossings) -> Crossings:
    columns = [np.concatenate([getattr(part, n) for part in parts]) for n in Crossings.__dataclass_fields__]
    order = np.lexsort((columns[1], columns[0]))
    return Crossings(*(column[order] for column in columns))
