"""Time constants of filters that are designed with the gains:  an outer search over the times, a design at each.

At given times the design finds the best gains of the whole box.  Its objective v is continuous in the logarithms of the
times where the spec stays feasible, and has kinks: it is looked at on a grid, and a compass search goes on from the
best point of each basin, with steps that are halved until they are a part `_FINEST` of a time.  Nothing bounds what
lies between the points of the grid.

Source: Kolda, Lewis and Torczon, Optimization by direct search, SIAM Review 45 (2003), for the compass search.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

from fopi_tune.core.controller import FoPi
from fopi_tune.core.terms.filter_times import TIME_NAMES, FilterTimes
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import ControllerSpec, DesignSpec, Sense

#: places of the grid along each time: of one, and of both
_PLACES = {1: 9, 2: 5}
#: places from which steps begin
_MOST_BASINS = 3
#: where steps end, of ln time
_FINEST = 1e-4
#: relative; a step that gains less is none
_GAIN = 1e-9

#: a spec whose times are given, and gains to start from -> its design
Designer = Callable[[DesignSpec, FoPi | None], Candidate]
#: a place in the unit square of the logarithms of the times
Place = tuple[float, ...]


def design_with_filter_times(spec: DesignSpec, start: FoPi | None, designer: Designer) -> Candidate:
    """The best gains and times.

    Args:
        spec: a filter's time has a range.
        start: gains with times in the ranges, close to the optimum, or None.
        designer: finds the gains at given times.

    Returns:
        The candidate of the best times.  Where no times of the grid have gains, that of the times in the middle.
    """
    times = spec.controller.filter_times
    assert times is not None
    search = _Search(spec, times, designer)
    near = None if start is None or not spec.controller.has_structure_of(start) else search.place_of(start)
    sides = len(times.ranges)
    if near is None or search.cost(near, start) == math.inf:
        ticks = [k / (_PLACES[sides] - 1) for k in range(_PLACES[sides])]
        for place in product(ticks, repeat=sides):
            search.cost(place)
    step = 1.0 / (_PLACES[sides] - 1)
    begins = search.lowest(step)
    if not begins:
        return search.infeasible()
    for place in begins:
        _compass(search, place, 0.5 * step)
    return search.best()


@dataclass
class _Search:
    """The designs at the times that were looked at.

    Args:
        spec: the spec.
        times: the ranges.
        designer: finds the gains at given times.
        known: cost and design at each place; infinite where nothing is solved.
    """

    spec: DesignSpec
    times: FilterTimes
    designer: Designer
    known: dict[Place, tuple[float, Candidate]] = field(default_factory=dict)

    def cost(self, place: Place, start: FoPi | None = None) -> float:
        """The objective at a place, smaller is better; infinite where the design is not solved."""
        if place not in self.known:
            found = self.designer(replace(self.spec, controller=self.controller_at(place)), start)
            solved = found.status in (Status.SOLVED, Status.UNBOUNDED) and found.objective is not None
            self.known[place] = (self._cost(found) if solved else math.inf), found
        return self.known[place][0]

    def _cost(self, found: Candidate) -> float:
        assert found.objective is not None
        if found.status is Status.UNBOUNDED:
            return -math.inf
        objective = self.spec.objective
        return -found.objective if objective is None or objective.sense is Sense.MAXIMIZE else found.objective

    def controller_at(self, place: Place) -> ControllerSpec:
        """The box with the times of a place."""
        box, shares = self.spec.controller, iter(place)
        filter_s, used = box.derivative_filter_time_constant_s, box.measurement_filter
        if self.times.derivative_s is not None:
            filter_s = _between(self.times.derivative_s, next(shares))
        if self.times.measurement_s is not None and used is not None:
            used = replace(used, time_constant_s=_between(self.times.measurement_s, next(shares)))
        return replace(box, derivative_filter_time_constant_s=filter_s, measurement_filter=used, filter_times=None)

    def place_of(self, gains: FoPi) -> Place:
        """The place of a controller's times."""
        box, used = self.spec.controller.with_times_of(gains), gains.measurement_filter
        seconds = box.derivative_filter_time_constant_s, 0.0 if used is None else used.time_constant_s
        sides = self.times.derivative_s, self.times.measurement_s
        return tuple(
            math.log(time / side[0]) / math.log(side[1] / side[0])
            for side, time in zip(sides, seconds, strict=True)
            if side is not None
        )

    def lowest(self, step: float) -> list[Place]:
        """The best places that have none next to them, at most `step` away, which is better; the best one first."""
        solved = sorted((place for place in self.known if self.known[place][0] < math.inf), key=self.cost)
        found: list[Place] = []
        for k, place in enumerate(solved):
            near = [other for other in solved[:k] if math.dist(place, other) <= step * (1.0 + 1e-9)]
            found += [] if near else [place]
        return found[:_MOST_BASINS]

    def best(self) -> Candidate:
        """The best design, with the work of all."""
        _, found = min(self.known.values(), key=lambda pair: pair[0])
        return replace(found, solves=sum(each.solves for _, each in self.known.values()), gap=None)

    def infeasible(self) -> Candidate:
        """That of the times in the middle, with what was looked at."""
        middle = min(self.known, key=lambda place: sum(abs(share - 0.5) for share in place))
        found = self.known[middle][1]
        box = self.controller_at(middle)
        used = box.measurement_filter
        seconds = box.derivative_filter_time_constant_s, 0.0 if used is None else used.time_constant_s
        both = dict(zip(TIME_NAMES, seconds, strict=True))
        told = " and ".join(f"{name} = {both[name]:.4g} s" for name in self.times.ranges)
        said = f"none of {len(self.known)} filter times of the ranges has gains that meet everything; with {told}: "
        return replace(found, message=said + found.message, gap=None)


def _between(side: tuple[float, float], share: float) -> float:
    # the ends themselves, without rounding
    if share in (0.0, 1.0):
        return side[int(share)]
    return math.exp((1.0 - share) * math.log(side[0]) + share * math.log(side[1]))


def _compass(search: _Search, place: Place, step: float) -> None:
    """Steps along each time, halved where none is better."""
    spans = [math.log(high / low) for low, high in search.times.ranges.values()]
    while step * max(spans) > _FINEST:
        cost, found = search.known[place]
        if cost == -math.inf:
            return
        better = cost - _GAIN * abs(cost)
        steps = [_moved(place, axis, sign * step) for axis in range(len(place)) for sign in (1.0, -1.0)]
        for there in steps:
            if search.cost(there, found.gains) < better:
                place = there
                break
        else:
            step *= 0.5


def _moved(place: Place, axis: int, step: float) -> Place:
    return (*place[:axis], min(max(place[axis] + step, 0.0), 1.0), *place[axis + 1 :])
