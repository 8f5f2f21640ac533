"""Suggestions of combinations:  conditions that no controller of a box seems to meet together.

As in `fopi_tune.optimum.pruning.screen`, these are suggestions, not proofs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.central_loops import Suggestion
from fopi_tune.optimum.pruning.combinations import MOST_REASONS, Combination
from fopi_tune.optimum.pruning.conditions import Test
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.pruning.linear_programs import best_weights
from fopi_tune.optimum.pruning.screen import Boxes, LinearBounds, gains_at

#: samples of one frequency that join for one box: those whose bound says most
_MOST_SAMPLES = 40
#: relative; values of sums below this are rounding, weights below this count as none
_LEAST_VALUE, _LEAST_WEIGHT = 1e-9, 1e-7
_NONE = -1e12
_TINY = 1e-300


def combinations(
    problem: Problem,
    boxes: Boxes,
    samples: tuple[Reason, ...],
    bounds: LinearBounds,
    crossings: Sequence[Sequence[Suggestion]],
) -> list[Combination | None]:
    """What seems to discard each of n boxes; None where nothing does.

    Args:
        problem: what the search is about.
        boxes: n boxes.
        samples: the samples of one frequency.
        bounds: of them, over these boxes.
        crossings: what the crossings of each box suggest.
    """
    gains, of_gains = _gain_bounds(problem, boxes)
    reasons, middles, slopes = _crossing_bounds(boxes, crossings)
    size = np.abs(bounds.slopes).sum(axis=2)
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(bounds.middle) & np.isfinite(size) & (bounds.middle > -size)
        worth = np.where(usable, bounds.middle / (size + _TINY), -np.inf)
    count = min(_MOST_SAMPLES, worth.shape[1])
    chosen = np.argpartition(-worth, count - 1, axis=1)[:, :count] if count else np.empty((len(boxes), 0), dtype=int)
    usable = np.take_along_axis(usable, chosen, axis=1)
    middle = np.where(usable, np.take_along_axis(bounds.middle, chosen, axis=1), _NONE)
    slope = np.where(usable[:, :, None], np.take_along_axis(bounds.slopes, chosen[:, :, None], axis=1), 0.0)
    middle = np.concatenate([middle, of_gains.middle, middles], axis=1)
    slope = np.concatenate([slope, of_gains.slopes, slopes], axis=1)
    known = np.where(middle > _NONE, np.abs(middle), 0.0)
    size = np.maximum(np.abs(slope).sum(axis=2), _LEAST_VALUE * known) + _TINY
    middle = np.where(middle > _NONE, middle / np.where(middle > _NONE, size, 1.0), _NONE)
    values, weights = best_weights(middle, slope / size[:, :, None])
    found: list[Combination | None] = []
    for row, value in enumerate(values.tolist()):
        if not value > _LEAST_VALUE:
            found.append(None)
            continue
        places = np.flatnonzero(weights[row] > _LEAST_WEIGHT)
        named = [
            samples[chosen[row, place]]
            if place < count
            else gains[place - count]
            if place < count + len(gains)
            else reasons[row][place - count - len(gains)]
            for place in places.tolist()
        ]
        each = [_short(weight) for weight in (weights[row, places] / size[row, places]).tolist()]
        found.append(Combination(tuple(named), tuple(each)) if 1 < len(named) <= MOST_REASONS else None)
    return found


def _short(weight: float) -> float:
    """Few digits are enough: any weights that are not negative do."""
    return float(f"{weight:.7g}")


def _gain_bounds(problem: Problem, boxes: Boxes) -> tuple[list[Reason], LinearBounds]:
    """Of the limits of the gains that a box need not keep by itself."""
    k = boxes.low.shape[1]
    implied = problem.parametrization.implied
    reasons: list[Reason] = []
    middles, slopes = [np.empty((len(boxes), 0))], [np.empty((len(boxes), 0, k))]
    for place, condition in enumerate(problem.conditions.every):
        if condition.test is not Test.GAIN or (condition.name in implied and not condition.of_objective):
            continue
        sign, name = (1.0 if condition.upper else -1.0), condition.name

        def gain(coordinates: Array, name: str = name, sign: float = sign) -> Array:
            return sign * gains_at(problem.parametrization, coordinates).named(name)

        centre, half = gain(boxes.middle), boxes.half
        rest, own = np.zeros(len(boxes)), []
        for t in range(k):
            step = half * (np.arange(k) == t)
            above, below = gain(boxes.middle + step), gain(boxes.middle - step)
            own.append(0.5 * (above - below))
            rest += np.abs(above + below - 2.0 * centre)
        reasons.append(Reason(place))
        middles.append((centre - sign * float(condition.level.mid()) - rest)[:, None])
        slopes.append(np.stack(own, axis=1)[:, None, :])
    return reasons, LinearBounds(np.concatenate(middles, axis=1), np.concatenate(slopes, axis=1))


def _crossing_bounds(
    boxes: Boxes, crossings: Sequence[Sequence[Suggestion]]
) -> tuple[list[list[Reason]], Array, Array]:
    """Reasons, middles and slopes of what the crossings suggest, filled up to the same number for each box."""
    linear = [[s for s in own if s.slopes] for own in crossings]
    most = max((len(own) for own in linear), default=0)
    middles, slopes = np.full((len(boxes), most), _NONE), np.zeros((len(boxes), most, boxes.low.shape[1]))
    for row, own in enumerate(linear):
        for place, suggestion in enumerate(own):
            middles[row, place] = suggestion.excess - suggestion.rest
            slopes[row, place] = suggestion.slopes
    return [[s.reason for s in own] for own in linear], middles, slopes
