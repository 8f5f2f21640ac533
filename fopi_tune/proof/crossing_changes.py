"""Where in a family the number of crossings changes:  margins jump there, and a sample can miss what lies between.

ln|L| and arg L have turning points over u = ln omega; the number of gain (phase) crossovers changes where a turning
point's ln|L| passes 0 (its phase passes -180 deg mod 360).  With +1 for a maximum and -1 for a minimum,

    signature = sum +-1 [ln|L| > 0] ,    sum +-1 floor((arg L + pi)/2 pi)                                          (1)

changes exactly there, not when turning points are born in pairs.  The distance of the nearest turning point from its
line is continuous, and leads to narrow parts of the box that lie between the places of a sample.

Source: derived; between two turning points a function passes a level once at most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.logform import Array, Complex, LogForm, Rows
from fopi_tune.core.loops import Loops
from fopi_tune.proof.sample import LoopFunction, Sample, evaluate
from fopi_tune.proof.worst_case import find_worst_case

#: np.real or np.imag
Part = Callable[[Complex], Array]

_MOST_EDGES = 48
_HALVINGS = 36
#: far more than there are turning points of the gain
_BOTH_IN_ONE = 4096.0
#: a slope of ln f below this is rounding, or one that turns nothing
_FLAT = 1e-9
#: a slope this small is 0 but for rounding, and an interval (in u) this narrow is a place
_TURNED, _NARROW = 1e-10, 1e-11
#: a turning point this close to its line touches it
_TOUCHES = 1e-8
#: one this close may touch it somewhere near
_NEARLY = 1e-4


@dataclass(frozen=True)
class SamplePair:
    """A family's sample for what is continuous over the box, and a denser one for what jumps with the crossings."""

    base: Sample

    @cached_property
    def refined(self) -> Sample:
        """The sample with places on both sides of every change."""
        return refine_at_crossing_changes(self.base)


def refine_at_crossing_changes(sample: Sample) -> Sample:
    """The sample and, on both sides of every change of the number of crossings it can find, one more place."""
    if sample.x.shape[1] == 0:
        return sample
    signatures, distances = _signatures(sample.loops)
    if not np.isfinite(distances).any():
        return sample  # no turning point near a line anywhere: nothing can change
    more = _both_sides(sample, sample.x, signatures, *sample.edges)
    criterion: LoopFunction = lambda loops: (-_signatures(loops)[1], np.zeros(len(loops)))  # noqa: E731
    nearest = find_worst_case(sample, criterion, ceiling=-_TOUCHES, floor=-10.0 * _NEARLY)
    touching = nearest.candidates
    if nearest.value > -_NEARLY and len(touching):
        more = np.concatenate([more, *(_around(sample, x) for x in touching)])
    return sample.with_more(more)


def _both_sides(sample: Sample, x: Array, signatures: Array, first: Rows, second: Rows) -> Array:
    """Places on both sides of a change along edges whose ends differ, shape (k, p)."""
    differ = np.flatnonzero(signatures[first] != signatures[second])
    if len(differ) > _MOST_EDGES:
        differ = differ[np.linspace(0, len(differ) - 1, _MOST_EDGES).astype(int)]
    if not len(differ):
        return np.zeros((0, x.shape[1]))
    a, b, here = x[first[differ]], x[second[differ]], signatures[first[differ]]
    for _ in range(_HALVINGS):
        middle = 0.5 * (a + b)
        same = (_signatures(sample.loops_at(middle))[0] == here)[:, None]
        a, b = np.where(same, middle, a), np.where(same, b, middle)
    return np.concatenate([a, b])


def _around(sample: Sample, x: Array) -> Array:
    """Of places at 1/2, 1/4, ... of the spacing around x, those with neighbours that have another signature."""
    p = len(x)
    steps = sample.spacing * 0.5 ** np.arange(1, 31)
    lines = np.concatenate([sign * steps[:, None] * np.eye(p)[k] for k in range(p) for sign in (1.0, -1.0)])
    places = np.clip(x + lines, 0.0, 1.0)
    signatures, _ = _signatures(sample.loops_at(places))
    change = signatures[1:] != signatures[:-1]
    return places[np.append(change, False) | np.append(False, change)]


def _signatures(loops: Loops) -> tuple[Array, Array]:
    """Formula (1), both numbers in one, and the distance of the nearest turning point from its line; shapes (m,)."""
    return evaluate(loops, _signatures_at_once)


def _signatures_at_once(loops: Loops) -> tuple[Array, Array]:
    m, log = len(loops), loops.log
    gains, phases, distance = np.zeros(m), np.zeros(m), np.full(m, np.inf)
    # |e^{-j omega L}| = 1: the dead time bends only the phase.
    rows, u, maximum = _turning_points(log.undelayed(), np.real)
    gain = loops.log_response(rows, u).real
    np.add.at(gains, rows, np.where(maximum, 1.0, -1.0) * (gain > 0))
    np.minimum.at(distance, rows, np.abs(gain))
    rows, u, maximum = _turning_points(log, np.imag)
    turns = (loops.log_response(rows, u).imag + np.pi) / (2.0 * np.pi)
    np.add.at(phases, rows, np.where(maximum, 1.0, -1.0) * np.floor(turns))
    np.minimum.at(distance, rows, 2.0 * np.pi * np.abs(turns - np.round(turns)))
    # A flat end is a turning point in the limit.
    end_gain, _ = log.end()
    for flat, gain in ((log.slope0 == 0, log.scale), (np.abs(log.slope_end()) < 1e-12, end_gain)):
        gains += flat & (gain > 0)
        distance = np.minimum(distance, np.where(flat, np.abs(gain), np.inf))
    return gains + _BOTH_IN_ONE * phases, distance


def _turning_points(log: LogForm, part: Part) -> tuple[Rows, Array, NDArray[np.bool_]]:
    """Rows, u and whether it is a maximum, of the turning points of ln|f| or arg f."""
    u = _places(log)
    rows = np.repeat(np.arange(len(u)), u.shape[1])
    u = u.ravel()
    slope = part(log.derivative(rows, u))
    steep = np.abs(slope) > _FLAT
    rows, u, slope = rows[steep], u[steep], slope[steep]
    turns = np.flatnonzero((rows[1:] == rows[:-1]) & ((slope[1:] > 0) != (slope[:-1] > 0)))
    rows, ends, slopes = rows[turns], (u[turns], u[turns + 1]), (slope[turns], slope[turns + 1])
    return rows, _sign_change(lambda u: part(log.derivative(rows, u)), ends, slopes), slopes[0] > 0


def _sign_change(slope: Callable[[Array], Array], ends: tuple[Array, Array], slopes: tuple[Array, Array]) -> Array:
    """Where slopes change their sign between two ends, shape (n,): secants (Illinois), every third step a halving."""
    (a, b), (at_a, at_b) = ends, slopes
    x, kept_b, kept_a = 0.5 * (a + b), np.zeros(len(a), dtype=bool), np.zeros(len(a), dtype=bool)
    for step in range(3 * _HALVINGS):
        secant = b - at_b * (b - a) / (at_b - at_a)
        x = 0.5 * (a + b) if step % 3 == 2 else np.clip(secant, a, b)
        at_x = slope(x)
        if np.all((np.abs(at_x) < _TURNED) | (b - a < _NARROW)):
            break
        same = (at_x > 0) == (slopes[0] > 0)
        # an end that stays twice counts half, so that the next secant passes the root
        at_a, at_b = np.where(same, at_x, at_a * np.where(kept_a, 0.5, 1.0)), np.where(same, at_b, at_x)
        at_b = np.where(same & kept_b, 0.5 * at_b, at_b)
        a, b, kept_a, kept_b = np.where(same, x, a), np.where(same, b, x), ~same, same
    return x


def _places(log: LogForm) -> Array:
    """Where to look for turning points, sorted, shape (m, n): evenly between the asymptotes, crowded around corners.

    A factor's resonance is as wide as its ray's angle from -1; the crowd begins far inside.
    """
    low, high = (np.clip(end, -600.0, 600.0)[:, None] for end in log.corners())
    even = low + (high - low) * np.linspace(0.0, 1.0, 120)
    corner = np.where(np.isfinite(log.corner), log.corner, 0.0)
    width = np.maximum(np.pi - np.abs(log.psi), 1e-9)
    apart = np.outer(np.array([-1.0, 1.0]), 3.0 ** np.arange(-2, 5)).ravel()
    crowd = corner[:, :, None] + np.minimum(width, 0.1)[:, :, None] * apart
    return np.sort(np.concatenate([even, crowd.reshape(len(corner), -1)], axis=1), axis=1)
