"""Where limits become infeasible:  the farthest limit that can be met, and the nearest that no start meets.

How far the limit can be turned is a design problem of its own, in which the requirement gives and nothing else does.  Its
answer is a guess (a local optimum), which is confirmed from both sides: gains that the check passes just inside, and no
feasible point from any start just outside.  Where that contradicts the guess, the bracket is found by steps and halved.
"""

from __future__ import annotations

from fopi_tune.tradeoff.knob import Knob
from fopi_tune.tradeoff.prober import Probe, Prober
from fopi_tune.tradeoff.result import End

#: the bracket's width, as a part of the range
WIDTH = 1e-3
#: how far inside and outside of a guess is looked
_BESIDE = 0.4
_MOST_GUESSES = 4
_MOST_STEPS = 60


def end_of(prober: Prober, way: int) -> tuple[End, Probe]:
    """Where the limits that can be met end in one direction.

    Args:
        prober: of the limit.
        way: 1 up, -1 down.

    Returns:
        The end, no farther than the limit is turned at the most, and the last limit that is met.
    """
    knob, last = prober.knob, prober.base
    cap = knob.reach(way)
    for _ in range(_MOST_GUESSES):
        guess = _guess(prober, cap, last)
        if guess is None:
            break
        beside = way * _BESIDE * WIDTH * _range(knob, guess, way)
        if (cap - guess) * way <= abs(beside):
            at_cap = prober.from_neighbour(cap, last)
            if at_cap is not None and at_cap.is_met:
                return End(way, cap, None), at_cap
        if (guess - beside - last.limit) * way > 0.0:
            inside = prober.from_neighbour(guess - beside, last)
            if inside is None or not inside.is_met:
                break
            last = inside
        outside = prober.probe(guess + beside, last)
        if not outside.is_met:
            return End(way, last.limit, outside.limit), last
        last = outside
    return _marched(prober, way, cap, last)


def _guess(prober: Prober, cap: float, last: Probe) -> float | None:
    """How far the limit can be turned, as the solver sees it from the last gains."""
    far = prober.warm.farthest(prober.knob.at(cap), last.gains, prober.knob.index)
    return None if far is None else far[0]


def _range(knob: Knob, limit: float, way: int) -> float:
    """The width of a sweep up to a limit."""
    return 2.0 * max(abs(limit - knob.limit), 0.1 * abs(knob.usual(way) - knob.limit))


def _marched(prober: Prober, way: int, cap: float, last: Probe) -> tuple[End, Probe]:
    """Growing steps until a limit is not met, then halves."""
    knob, failed = prober.knob, None
    step = 8.0 * WIDTH * _range(knob, last.limit, way)
    for _ in range(_MOST_STEPS):
        if failed is None:
            trial = last.limit + way * step
            trial, step = (min(trial, cap) if way > 0 else max(trial, cap)), 2.0 * step
        elif abs(failed - last.limit) <= WIDTH * _range(knob, last.limit, way):
            break
        else:
            trial = 0.5 * (last.limit + failed)
        tried = prober.probe(trial, last)
        if not tried.is_met:
            failed = trial
            continue
        last = tried
        if last.limit == cap:
            break
    return End(way, last.limit, failed), last
