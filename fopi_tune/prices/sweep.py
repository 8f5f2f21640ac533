"""The trade-off curve (Pareto front) of objective against one limit:  a design's gains -> Tradeoff.

The sweep goes outwards from the user's limit, and every point starts from its neighbour.  Relaxing a limit enlarges the
feasible set, so the objective cannot become worse.  A point that is worse than its tighter neighbour is solved again
from there; if that does not help, the neighbour's gains are its result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.terms.numbers import plain_number, whole_number
from fopi_tune.errors import DomainError
from fopi_tune.prices.feasible_end import end_of
from fopi_tune.prices.limit import MovableLimit
from fopi_tune.prices.prober import Probe, Prober, is_no_worse
from fopi_tune.prices.result import FeasibleEnd, Tradeoff
from fopi_tune.results.stamp import stamp
from fopi_tune.spec.model import DesignSpec

_SOLVER = "ipopt"
_MOST_POINTS = 10_000
#: relative; an objective that is worse by more than this is solved for again
_NOISE = 1e-7


@dataclass(frozen=True)
class SweepRange:
    """The limits of a sweep.

    Args:
        start: the lowest, public unit; None: the infeasible end, or as far from the user's limit on the other side.
        stop: the highest, likewise.
        points: their number.
    """

    start: float | None = None
    stop: float | None = None
    points: int = 50


def sweep(
    spec: DesignSpec, movable: MovableLimit, gains: FoPi, wanted: SweepRange, objective_quantity: str
) -> Tradeoff:
    """Move one limit over a range; solve and check the spec at every point.

    Args:
        spec: the user's.
        movable: one of its limits.
        gains: of the design with the user's limit.
        wanted: the range, which `check_range` has passed.
        objective_quantity: the objective in words.

    Raises:
        DomainError: there is nothing between the ends, or the design does not pass the check.
    """
    prober = Prober.of(movable, gains)
    sides = [end_of(prober, way) for way in ((-1, 1) if movable.tightens == 0 else (movable.tightens,))]
    ends, lasts = tuple(end for end, _ in sides), [last for _, last in sides]
    limits = _limits(movable, wanted, ends)
    probes = _swept(prober, limits)
    if movable.tightens:
        probes = monotone(prober, probes, lasts[0])
    stamped = stamp(spec.text_sha256, _SOLVER)
    points = tuple(prober.point(probe) for probe in probes)
    return Tradeoff(movable, spec, prober.point(prober.base), points, ends, objective_quantity, stamped)


def check_range(movable: MovableLimit, wanted: SweepRange) -> None:
    """Refuse a range that makes no sense, before anything is designed.

    Args:
        movable: the limit that is swept.
        wanted: its range.

    Raises:
        DomainError: an end or the number of points makes no sense.
    """
    if not 2 <= whole_number("`points`", wanted.points) <= _MOST_POINTS:
        raise DomainError(f"`points` = {wanted.points} must lie between 2 and {_MOST_POINTS}; 50 is usual")
    for argument, value in (("`start`", wanted.start), ("`stop`", wanted.stop)):
        if value is None:
            continue
        if not math.isfinite(plain_number(argument, value)):
            raise DomainError(f"{argument} = {value!r} is no finite number")
        problem = movable.quantity.check_limit(value)
        if problem:
            raise DomainError(f"{argument} = {value:g}: a limit of {movable.quantity_name} {problem}")
    if wanted.start is not None and wanted.stop is not None and wanted.start >= wanted.stop:
        raise DomainError(f"`start` = {wanted.start:g} must be smaller than `stop` = {wanted.stop:g}")


def _limits(movable: MovableLimit, wanted: SweepRange, ends: Sequence[FeasibleEnd]) -> list[float]:
    """The limits of the sweep, rising: by default from the infeasible end to as far on the other side of the user's."""
    reached = {end.way: end.feasible if end.infeasible is not None else movable.default_end(end.way) for end in ends}
    for way in (-1, 1):
        if way not in reached:
            least = abs(movable.default_end(way) - movable.limit) * 0.1
            away = movable.limit + way * max(abs(reached[-way] - movable.limit), least)
            reached[way] = away if movable.quantity.check_limit(away) is None else 0.5 * movable.limit
    low = wanted.start if wanted.start is not None else reached[-1]
    high = wanted.stop if wanted.stop is not None else reached[1]
    if low >= high:
        raise DomainError(
            f"there is nothing between {low:g} and {high:g}: with one of `start` and `stop` the other end is where "
            "the limits that can be met end; give both"
        )
    return [float(v) for v in np.linspace(low, high, wanted.points)]


def _swept(prober: Prober, rising: Sequence[float]) -> list[Probe]:
    """Probe outwards from the user's limit in both directions."""
    above = [v for v in rising if v >= prober.knob.limit]
    below = [v for v in rising if v < prober.knob.limit][::-1]
    found: list[Probe] = []
    for side in (above, below):
        near = prober.base
        for limit in side:
            probe = prober.probe(limit, near)
            found.append(probe)
            near = probe if probe.is_met else near
    return sorted(found, key=lambda probe: probe.limit)


def monotone(prober: Prober, probes: Sequence[Probe], tightest: Probe) -> list[Probe]:
    """Make the objective monotone: from the tightest limit on, no point is worse than the one before it."""
    order = sorted((*probes, tightest), key=lambda probe: -probe.limit * prober.knob.tightens)
    better: list[Probe] = []
    before: Probe | None = None
    for probe in order:
        now = probe if before is None else _no_worse_than(prober, probe, before)
        before = now if now.is_met else before
        if probe is not tightest:
            better.append(now)
    return sorted(better, key=lambda probe: probe.limit)


def _no_worse_than(prober: Prober, probe: Probe, tighter: Probe) -> Probe:
    """The point itself, or a better one from its tighter neighbour's gains, or those gains."""
    kept = prober.kept(probe.limit, tighter)
    if not kept.is_met or is_no_worse(prober, probe, kept):
        return probe
    here, bar = probe.objective, kept.objective
    if here is None or bar is None or abs(here - bar) > _NOISE * abs(bar):
        again = prober.from_neighbour(probe.limit, tighter)
        if again is not None and is_no_worse(prober, again, kept):
            return again
    return kept
