"""Worst-case search over a family:  a dense sample, then pattern search from its several largest values.

A candidate is a point x with a window of half-width h around it.  Every round evaluates a pattern of points in all
windows together.  A window moves to a larger value on its rim and shrinks around one inside.  It has converged when
along every axis one of these holds:

    - x lies on the boundary of the box and the criterion decreases inwards, on two scales, or
    - the criterion varies by less than 1e-10 of its size within the window.

A maximum close to an end of a wide range may be lower on both scales of the sample; before the first round each
candidate on the boundary is compared with points at geometric distances from it, along each axis.

Discontinuities do not satisfy this; there the window shrinks until its width is that of rounding.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.loops import Loops
from fopi_tune.proof.verification.results import Place
from fopi_tune.proof.verification.sample import LoopFunction, Sample, evaluate

_MOST_CANDIDATES = 6
_MOST_ROUNDS = 80
#: distances from the boundary, in spacings of the sample
_NEXT_TO_THE_BOUNDARY = 0.5 ** np.arange(2.0, 10.0)
#: of a window, with one uncertain number
_SMALLER = 0.25
_CONVERGED = 1e-10
_ROUNDING = 1e-13
_NARROWEST = 1e-11
#: cells after which a search ends with the worst member so far, about 4 s; ordinary families take 1e3 to 1e6
_MOST_WORK = 4_000_000


@dataclass(frozen=True)
class WorstCase:
    """The worst member.

    Args:
        value: of the criterion; nan when a member has no value (no gain crossover).
        omega_rad_s: the frequency at which it is attained.
        x: shape (p,), the member's normalised point.
        candidates: shape (k, p), final points of all windows.
    """

    value: float
    omega_rad_s: float
    x: Array
    candidates: Array

    def place(self, sample: Sample) -> Place:
        """The member in the user's terms."""
        return place_of(sample, self.x, self.omega_rad_s)


@dataclass
class _Evaluated:
    """The criterion at points, each evaluated once.

    Args:
        sample: of the family.
        criterion: the criterion.
        work: spent so far.
        known: value and frequency by the point's bytes.
    """

    sample: Sample
    criterion: LoopFunction
    work: float = 0.0
    known: dict[bytes, tuple[float, float]] = field(default_factory=dict)

    def keep(self, ahead: Array, values: Array, omegas: Array) -> None:
        """Keep what is known of the places behind the sample's, and of the ends of its range."""
        sample = self.sample
        m, last = len(sample.x), sample.per_axis - 1
        for k, x in enumerate(ahead, m):
            self.known[x.tobytes()] = float(values[k]), float(omegas[k])
        for k in (0, last) if len(ahead) else ():
            self.known[sample.x[k].tobytes()] = float(values[k]), float(omegas[k])

    def at(self, x: Array) -> tuple[Array, Array]:
        """Values and frequencies at points of shape (n, p), both of shape (n,)."""
        keys = [row.tobytes() for row in x]
        new = {key: k for k, key in enumerate(keys) if key not in self.known}
        if new:
            values, omegas, *spent = evaluate(self.sample.loops_at(x[list(new.values())]), self.criterion)
            self.work += sum(float(part.sum()) for part in spent)
            self.known.update(zip(new, zip(values.tolist(), omegas.tolist(), strict=True), strict=True))
        found = np.array([self.known[key] for key in keys]).reshape(len(keys), 2)
        return found[:, 0], found[:, 1]


@dataclass(frozen=True)
class _Candidate:
    x: Array
    value: float
    omega: float
    width: float
    #: axes along which x is on the boundary and the criterion decreases inwards
    pinned: Array
    #: variation of the criterion in the window, pinned axes excluded
    spread: float
    done: bool = False


def find_worst_case(
    sample: Sample, criterion: LoopFunction, ceiling: float = np.inf, floor: float = -np.inf
) -> WorstCase:
    """Maximise a criterion over the box.

    Args:
        sample: starting points.
        criterion: to be maximised.
        ceiling: stop as soon as a value exceeds this.
        floor: discard windows that stay clearly below this; a result below it is not exact.

    The search ends early where its work is spent: loops with very many peaks or crossings.
    """
    loops, ahead = loops_ahead(sample)
    values, omegas, *spent = evaluate(loops, criterion)
    evaluated = _Evaluated(sample, criterion, sum(float(part.sum()) for part in spent))
    evaluated.keep(ahead, values, omegas)
    values, omegas = values[: len(sample.x)], omegas[: len(sample.x)]
    missing = np.isnan(values)
    k = sample.nominal if missing[sample.nominal] else int(np.argmax(np.where(missing, np.inf, values)))
    first = WorstCase(float(values[k]), float(omegas[k]), sample.x[k], sample.x[k][None, :])
    if sample.x.shape[1] == 0 or not np.isfinite(first.value) or first.value > ceiling:
        return first
    finite = values[np.isfinite(values)]
    scale = max(float(np.abs(finite).max()), 1e-300)
    if len(finite) == len(values) and np.ptp(finite) <= _ROUNDING * scale:
        return first
    active = [_start(sample, values, omegas, int(row)) for row in _distinct_peaks(sample, values)]
    active = _moved_inwards(evaluated, active, scale)
    finished: list[_Candidate] = []
    for count in range(_MOST_ROUNDS):
        trial = [_unique(c.x + c.width * _pattern(len(c.x), count)) for c in active]
        new_values, new_omegas = evaluated.at(np.concatenate(trial))
        if np.isnan(new_values).any():
            row = int(np.argmax(np.isnan(new_values)))
            x = np.concatenate(trial)[row]
            return WorstCase(np.nan, np.nan, x, x[None, :])
        parts = zip(active, trial, _parts(trial), strict=True)
        moved = [_step(c, t, new_values[part], new_omegas[part], sample.spacing, scale) for c, t, part in parts]
        finished += [c for c in moved if c.done]
        best = max(c.value for c in moved + finished)
        if best > ceiling or evaluated.work > _MOST_WORK:
            return _result(moved + finished)
        active = [c for c in moved if not c.done and c.value + 2.0 * c.spread >= max(best, floor)]
        if not active:
            return _result(finished or moved)
    return _result(finished + active)


def _next_to_boundary(sample: Sample, candidates: list[_Candidate]) -> list[Array]:
    """Points at geometric distances from each candidate on the boundary, along each axis that leads inwards."""
    trial = []
    for c in candidates:
        inwards = np.where(c.x == 0.0, 1.0, np.where(c.x == 1.0, -1.0, 0.0))
        axes = np.diag(inwards)[inwards != 0.0]
        steps = c.x + (_NEXT_TO_THE_BOUNDARY * sample.spacing)[:, None, None] * axes
        trial.append(steps.reshape(-1, len(c.x)))
    return trial


def loops_ahead(sample: Sample) -> tuple[Loops, Array]:
    """The loops of a sample's places and, behind them, of those that most searches then ask for; and these places.

    With one uncertain number most searches end at an end of its range: what is asked next to it, and about it in the
    first two rounds, costs less together with the sample.
    """
    if sample.x.shape[1] != 1:
        return sample.loops, np.zeros((0, sample.x.shape[1]))
    ahead = _about_ends(sample.spacing)
    return sample.loops_at(np.concatenate([sample.x, ahead])), ahead


@lru_cache
def _about_ends(spacing: float) -> Array:
    """Places next to both ends of one range, and the first two patterns about these; shape (k, 1)."""
    steps = _NEXT_TO_THE_BOUNDARY * spacing
    patterns = np.concatenate([spacing * factor * _pattern(1, 0)[:, 0] for factor in (1.0, _SMALLER)])
    places = np.concatenate([steps, 1.0 - steps, patterns, 1.0 + patterns])
    return _unique(places[(places > 0.0) & (places < 1.0)][:, None])


def _moved_inwards(evaluated: _Evaluated, candidates: list[_Candidate], scale: float) -> list[_Candidate]:
    """Candidates on the boundary, moved to a larger value next to it along one axis."""
    trial = _next_to_boundary(evaluated.sample, candidates)
    if not any(len(t) for t in trial):
        return candidates
    values, omegas = evaluated.at(np.concatenate(trial))
    moved = []
    for c, points, part in zip(candidates, trial, _parts(trial), strict=True):
        found, where = values[part], omegas[part]
        best = np.where(np.isnan(found), -np.inf, found)
        k = int(np.argmax(best)) if len(best) else -1
        if k < 0 or best[k] <= c.value + _ROUNDING * scale:
            moved.append(c)
            continue
        width = float(np.abs(points[k] - c.x).max())
        moved.append(replace(c, x=points[k], value=float(found[k]), omega=float(where[k]), width=width))
    return moved


def _parts(trial: list[Array]) -> list[slice]:
    """Where each of some arrays is in all of them together."""
    ends = list(itertools.accumulate((len(t) for t in trial), initial=0))
    return [slice(a, b) for a, b in itertools.pairwise(ends)]


def place_of(sample: Sample, x: Array, omega_rad_s: float) -> Place:
    """A place of the box and a frequency in the user's terms; nan is no frequency."""
    point = sample.points(x[None, :])[0]
    omega = None if np.isnan(omega_rad_s) else float(omega_rad_s)
    return Place(omega, sample.family.describe(point), tuple(point.tolist()))


def _result(candidates: list[_Candidate]) -> WorstCase:
    best = max(candidates, key=lambda c: c.value)
    return WorstCase(best.value, best.omega, best.x, np.array([c.x for c in candidates]))


def _start(sample: Sample, values: Array, omegas: Array, row: int) -> _Candidate:
    p = sample.x.shape[1]
    return _Candidate(
        sample.x[row], float(values[row]), float(omegas[row]), sample.spacing, np.zeros(p, dtype=bool), np.inf
    )


def _distinct_peaks(sample: Sample, values: Array) -> Rows:
    """Rows of local maxima, the largest first; of close ones only the largest."""
    n, p = sample.per_axis, sample.x.shape[1]
    peak = np.ones(len(values), dtype=bool)
    if n:
        grid = values[: n**p].reshape((n,) * p)
        around = grid
        for axis in range(p):
            padded = np.full([k + 2 * (j == axis) for j, k in enumerate(around.shape)], -np.inf)
            inner = np.moveaxis(padded, axis, 0)
            inner[1:-1] = np.moveaxis(around, axis, 0)
            largest = np.maximum(np.maximum(inner[:-2], inner[1:-1]), inner[2:])
            around = np.moveaxis(largest, 0, axis)
        peak[: n**p] = (grid >= around).ravel()
        for row in range(n**p, len(values)):
            near = np.abs(sample.x[: n**p] - sample.x[row]).max(axis=1) <= sample.spacing
            peak[row] = values[row] > values[: n**p][near].max()
    peak &= values > -np.inf
    rows = np.flatnonzero(peak)
    chosen: list[int] = []
    for row in rows[np.argsort(-values[rows], kind="stable")]:
        distance = np.abs(sample.x[chosen] - sample.x[row]).max(axis=1) if chosen else np.array([np.inf])
        if distance.min() > 0.75 * sample.spacing:
            chosen.append(int(row))
        if len(chosen) == _MOST_CANDIDATES:
            break
    return np.array(chosen, dtype=np.intp)


def _pattern(p: int, count: int) -> Array:
    """Points to evaluate in a window, in half-widths."""
    if p <= 3:
        return _pattern_of_grid(p)
    axes = np.concatenate([np.eye(p), -np.eye(p)])
    scattered = np.random.default_rng(count).uniform(-1.0, 1.0, size=(24, p))
    return np.concatenate([axes, 0.5 * axes, scattered])


@lru_cache
def _pattern_of_grid(p: int) -> Array:
    steps = np.linspace(-1.0, 1.0, {1: 9, 2: 5, 3: 3}[p])
    pattern = np.array(list(itertools.product(steps, repeat=p)))
    return pattern[np.abs(pattern).max(axis=1) > 0]


def _unique(x: Array) -> Array:
    inside = np.minimum(np.maximum(x, 0.0), 1.0)
    return np.unique(inside)[:, None] if x.shape[1] == 1 else np.unique(inside, axis=0)


def _step(c: _Candidate, trial: Array, values: Array, omegas: Array, spacing: float, scale: float) -> _Candidate:
    """The candidate after one round."""
    k = int(np.argmax(values))
    smaller = c.width * (_SMALLER if len(c.x) == 1 else 0.5)
    if values[k] > c.value + _ROUNDING * scale:
        reached = (np.abs(trial[k] - c.x) > 0.99 * c.width) & (trial[k] > 0.0) & (trial[k] < 1.0)
        width = min(2.0 * c.width, spacing) if reached.any() else smaller
        moved = replace(c, x=trial[k], value=float(values[k]), omega=float(omegas[k]), width=width)
        free_again = np.zeros(len(c.x), dtype=bool)
        return replace(moved, pinned=free_again, spread=float(values[k] - values.min()), done=width < _NARROWEST)
    displaced = np.abs(trial - c.x) > 1e-3 * c.width
    at_end = (c.x == 0.0) | (c.x == 1.0)
    falls = np.array([bool(np.all(values[displaced[:, axis]] < c.value)) for axis in range(len(c.x))])
    pinned = at_end & falls
    free = ~displaced[:, pinned].any(axis=1)
    spread = max(float(c.value - values[free].min()), 0.0) if free.any() else 0.0
    settled = bool(np.all(pinned == c.pinned)) and spread <= _CONVERGED * scale
    return replace(c, width=smaller, pinned=pinned, spread=spread, done=settled or smaller < _NARROWEST)
