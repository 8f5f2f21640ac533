"""Where in a family the number of crossings changes.  Margins are discontinuous there, and a sample can miss it.

ln|L| and arg L have turning points over u = ln omega; the number of gain (phase) crossovers changes where a turning
point's ln|L| passes 0 (its phase passes -180 deg mod 360).  With +1 for a maximum and -1 for a minimum,

    signature = sum +-1 [ln|L| > 0] ,    sum +-1 floor((arg L + pi)/2 pi)                                          (1)

changes exactly there, and not where turning points appear in pairs.  The distance of the nearest turning point from
its threshold is a continuous function over the box.  Minimising it finds narrow regions between the sampled points.

Source: derived; between two turning points a function crosses a level at most once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array, BodeForm, Rows
from fopi_tune.core.loops import Loops
from fopi_tune.proof.verification.sample import LoopFunction, Sample, evaluate
from fopi_tune.proof.verification.worst_case import find_worst_case, loops_ahead

#: their name in `Loops.computed`
_SIGNATURES = "signatures"
_MOST_EDGES = 48
_HALVINGS = 36
#: factor that packs both signatures into one number; larger than any count of turning points
_BOTH_IN_ONE = 4096.0
#: slopes of ln f below this are rounding errors
_FLAT = 1e-9
#: a turning point this close to its threshold touches it
_TOUCHES = 1e-8
#: a turning point this close may touch it nearby
_NEARLY = 1e-4


@dataclass(frozen=True)
class SamplePair:
    """Two samples of a family: one for continuous functions, a refined one for functions that jump at crossing changes.

    Args:
        base: the sample of the box.
    """

    base: Sample

    @cached_property
    def refined(self) -> Sample:
        """The base sample and points on both sides of every change of the number of crossings."""
        return refine_at_crossing_changes(self.base)


def refine_at_crossing_changes(sample: Sample) -> Sample:
    """Add one point on each side of every change of the number of crossings that can be found."""
    if sample.x.shape[1] == 0:
        return sample
    signatures, distances = (found[: len(sample.x)] for found in _signatures(loops_ahead(sample)[0]))
    if not np.isfinite(distances).any():
        return sample  # no turning point near a threshold: the number of crossings is constant
    more = _both_sides(sample, sample.x, signatures, *sample.edges)
    criterion: LoopFunction = lambda loops: (-_signatures(loops)[1], np.zeros(len(loops)))  # noqa: E731
    nearest = find_worst_case(sample, criterion, ceiling=-_TOUCHES, floor=-10.0 * _NEARLY)
    touching = nearest.candidates
    if nearest.value > -_NEARLY and len(touching):
        more = np.concatenate([more, *(_around(sample, x) for x in touching)])
    return sample.with_more(more)


def _both_sides(sample: Sample, x: Array, signatures: Array, first: Rows, second: Rows) -> Array:
    """Points on both sides of a change, by bisection of edges whose ends differ, shape (k, p)."""
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
    """Points at 1/2, 1/4, ... of the spacing around x whose signature differs from that of a neighbour."""
    p = len(x)
    steps = sample.spacing * 0.5 ** np.arange(1, 31)
    lines = np.concatenate([sign * steps[:, None] * np.eye(p)[k] for k in range(p) for sign in (1.0, -1.0)])
    places = np.clip(x + lines, 0.0, 1.0)
    signatures, _ = _signatures(sample.loops_at(places))
    change = signatures[1:] != signatures[:-1]
    return places[np.append(change, False) | np.append(False, change)]


def _signatures(loops: Loops) -> tuple[Array, Array]:
    """Both signatures (1) packed into one number, and the distance of the nearest turning point from its threshold.

    Shapes (m,).
    """
    signatures, distances = evaluate(loops, _signatures_at_once)
    return signatures, distances


def _signatures_at_once(loops: Loops) -> tuple[Array, Array]:
    # the sample's own loops are asked twice
    if _SIGNATURES not in loops.computed:
        loops.computed[_SIGNATURES] = _computed_signatures(loops)
    return loops.computed[_SIGNATURES]


def _computed_signatures(loops: Loops) -> tuple[Array, Array]:
    from fopi_tune.core.compiled.turning_points import turning_points

    m, log = len(loops), loops.log
    gains, phases, distance = np.zeros(m), np.zeros(m), np.full(m, np.inf)
    found = turning_points(log.terms, _places(log), _FLAT)
    part, rows, u, maximum = found[:, 0], found[:, 1].astype(np.intp), found[:, 2], found[:, 3] > 0.0
    value = loops.log_response(rows, u)
    sign, of_gain, of_phase = np.where(maximum, 1.0, -1.0), part == 0.0, part == 1.0
    turns = (value.imag + np.pi) / (2.0 * np.pi)
    np.add.at(gains, rows[of_gain], (sign * (value.real > 0))[of_gain])
    np.add.at(phases, rows[of_phase], (sign * np.floor(turns))[of_phase])
    apart = np.where(of_gain, np.abs(value.real), 2.0 * np.pi * np.abs(turns - np.round(turns)))
    np.minimum.at(distance, rows, apart)
    # a flat asymptote counts as a turning point
    end_gain, _ = log.end()
    for flat, gain in ((log.slope0 == 0, log.scale), (np.abs(log.slope_end()) < 1e-12, end_gain)):
        gains += flat & (gain > 0)
        distance = np.minimum(distance, np.where(flat, np.abs(gain), np.inf))
    return gains + _BOTH_IN_ONE * phases, distance


def _places(log: BodeForm) -> Array:
    """Grid in u for turning points, sorted, shape (m, n): even between the asymptotes, dense around corner frequencies.

    The width of a factor's resonance is the angle of its ray from -1; the dense grid is much finer than that.
    """
    low, high = (np.clip(end, -600.0, 600.0)[:, None] for end in log.corners())
    even = low + (high - low) * np.linspace(0.0, 1.0, 120)
    corner = np.where(np.isfinite(log.corner), log.corner, 0.0)
    width = np.maximum(np.pi - np.abs(log.psi), 1e-9)
    apart = np.outer(np.array([-1.0, 1.0]), 3.0 ** np.arange(-2, 5)).ravel()
    crowd = corner[:, :, None] + np.minimum(width, 0.1)[:, :, None] * apart
    return np.sort(np.concatenate([even, crowd.reshape(len(corner), -1)], axis=1), axis=1)
