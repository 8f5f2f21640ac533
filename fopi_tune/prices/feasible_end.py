"""Where limits become infeasible:  the farthest limit that can be met, and the nearest that no start meets.

How far the limit can be turned is a design problem of its own, in which the requirement gives and nothing else does.
Its answer is a guess (a local optimum): it is tried from both sides, and where it is wrong, growing steps and halves
bracket the end, each from the gains of the last limit that is met.  Beyond the bracket every start is tried before the
limit is called infeasible; gains that one of them finds carry the search on.
"""

from __future__ import annotations

from fopi_tune.prices.limit import MovableLimit
from fopi_tune.prices.prober import Probe, Prober
from fopi_tune.prices.result import FeasibleEnd

#: the bracket's width, as a part of the range
WIDTH = 1e-3
#: how far inside and outside of a guess is looked, as a part of that width
_BESIDE = 0.4
#: the first step without a guess, as a part of the usual way
_STEP = 0.02
_MOST_BRACKETS, _MOST_TRIALS = 6, 60


def end_of(prober: Prober, way: int) -> tuple[FeasibleEnd, Probe]:
    """Where the limits that can be met end in one direction.

    Args:
        prober: of the limit.
        way: 1 up, -1 down.

    Returns:
        The end, no farther than the limit is turned at the most, and the last limit that is met.
    """
    last, failed = prober.base, None
    for _ in range(_MOST_BRACKETS):
        last, failed = _bracketed(prober, way, last)
        if failed is None:
            return FeasibleEnd(way, last.limit, None), last
        outside = prober.from_all_starts(failed)
        if not outside.is_met:
            break
        last = outside
    return FeasibleEnd(way, last.limit, failed), last


def _bracketed(prober: Prober, way: int, last: Probe) -> tuple[Probe, float | None]:
    """The last limit that is met from neighbours' gains, and one close behind that is not; None where none is."""
    knob, failed = prober.knob, None
    cap, step = knob.reach(way), _STEP * (knob.usual(way) - knob.limit)
    trials = _around_guess(prober, cap, way, last)
    for _ in range(_MOST_TRIALS):
        if last.limit == cap or (failed is not None and abs(failed - last.limit) <= _width(knob, last.limit, way)):
            break
        if trials:
            trial = trials.pop(0)
        else:
            trial, step = (last.limit + step, 2.0 * step) if failed is None else (0.5 * (last.limit + failed), step)
        trial = min(trial, cap) if way > 0 else max(trial, cap)
        if (trial - last.limit) * way <= 0.0 or (failed is not None and (failed - trial) * way <= 0.0):
            continue
        tried = prober.unmoved(trial, last) or prober.from_neighbour(trial, last)
        if tried is not None and tried.is_met:
            last = tried
        else:
            failed = trial
    return last, failed


def _around_guess(prober: Prober, cap: float, way: int, last: Probe) -> list[float]:
    """Just inside and just outside of how far the limit can be turned, as the solver sees it from the last gains."""
    far = prober.warm.farthest(prober.knob.at(cap), last.gains, prober.knob.index)
    if far is None:
        return []
    beside = way * _BESIDE * _width(prober.knob, far[0], way)
    return [far[0] - beside, far[0] + beside]


def _width(knob: MovableLimit, limit: float, way: int) -> float:
    """The bracket's width when the sweep goes so far."""
    return 2.0 * WIDTH * max(abs(limit - knob.limit), 0.1 * abs(knob.usual(way) - knob.limit))
