"""Where a limit becomes infeasible:  the farthest limit that is met, and the nearest that is met from no start.

An elastic solve, in which this requirement alone is relaxed, estimates the farthest feasible limit.  It is a local
optimum, so limits just inside and just outside of it are tried.  Where it is wrong, growing steps and then bisection
bracket the end, each from the gains of the last limit that is met.  The limit at the outer end of the bracket is called
infeasible only after every start was tried; gains that one of them finds continue the search.
"""

from __future__ import annotations

from fopi_tune.prices.limit import MovableLimit
from fopi_tune.prices.prober import Probe, Prober
from fopi_tune.prices.result import FeasibleEnd

#: the bracket's width, relative to the range
WIDTH = 1e-3
#: distance of the trials inside and outside of the estimate, relative to that width
_BESIDE = 0.4
#: the first step without an estimate, relative to the default range
_STEP = 0.02
_MOST_BRACKETS, _MOST_TRIALS = 6, 60


def end_of(prober: Prober, way: int) -> tuple[FeasibleEnd, Probe]:
    """The end of the feasible limits in one direction.

    Args:
        prober: of the limit.
        way: 1 up, -1 down.

    Returns:
        The end, at most at the farthest limit that is tried, and the probe of the last limit that is met.
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
    """The last limit that is met from neighbours' gains, and a close one that is not, or None."""
    movable, failed = prober.knob, None
    cap, step = movable.farthest_limit(way), _STEP * (movable.default_end(way) - movable.limit)
    trials = _around_guess(prober, cap, way, last)
    for _ in range(_MOST_TRIALS):
        if last.limit == cap or (failed is not None and abs(failed - last.limit) <= _width(movable, last.limit, way)):
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
    """Limits just inside and just outside of the farthest feasible one, as estimated from the last gains."""
    far = prober.warm.farthest(prober.knob.at(cap), last.gains, prober.knob.index)
    if far is None:
        return []
    beside = way * _BESIDE * _width(prober.knob, far[0], way)
    return [far[0] - beside, far[0] + beside]


def _width(movable: MovableLimit, limit: float, way: int) -> float:
    """The bracket's width when the sweep ends at `limit`."""
    return 2.0 * WIDTH * max(abs(limit - movable.limit), 0.1 * abs(movable.default_end(way) - movable.limit))
