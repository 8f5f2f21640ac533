"""The search over alpha:  a scan, then refinement of the best brackets, without derivatives.

The best gains at one alpha come from `convex_concave`.  One alpha is better than another when it is feasible and has
the smaller cost, or has the smaller violation.  Within a bracket the next alpha is interpolated:

    all three feasible         the vertex of the parabola through three costs,
    one end infeasible         where the line through two violations is 0,
    the middle infeasible      where a line through two violations on one side is 0.

Every third step is a golden section of the larger part, so that the bracket shrinks in any case.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from fopi_tune.convex.convex_concave import NO_GAIN, TOLERANCE, ConvexConcaveProcedure, LocalResult, Members, is_better
from fopi_tune.convex.evaluate import evaluate
from fopi_tune.convex.limits import Task
from fopi_tune.convex.program import Program
from fopi_tune.convex.starts import starts
from fopi_tune.core.controller import FoPi

#: alphas of the first scan; every so many of them are solved from starts of their own, the others from their neighbours
_SCANNED, _ANCHORS = 13, 4
_STARTS, _STARTS_OF_ONE = 3, 5
#: natural units; costs this close belong to the same optimum
_SAME_OPTIMUM = 1e-3
_MOST_TRIES = 40
#: local minima over alpha that are refined, and how many while no feasible alpha is known
_MOST_VALLEYS, _MOST_INFEASIBLE_VALLEYS = 5, 2
_GOLDEN = 0.381966
#: natural units; a bracket in which no larger improvement is possible is finished
_FINISHED = 2e-8
_NARROWEST = 1e-10
#: the same at an alpha of the scan
_FINISHED_IN_SCAN = 1e-4


@dataclass
class AlphaSearch:
    """The best gains at every alpha that was tried."""

    task: Task
    members: Members
    known: dict[float, LocalResult] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.procedure = ConvexConcaveProcedure(self.task, self.members, Program(self.task.equalities))

    def best(self) -> LocalResult | None:
        """The best over all alphas; None when no start was usable."""
        found = [f for f in self.known.values() if np.isfinite(f.evaluation.violation)]
        return None if not found else _best_of(found)

    def scan(self) -> None:
        """Solve at alphas over the whole range, from starts and from the results at neighbouring alphas."""
        box = self.task.spec.controller.alpha
        alphas = [box.min] if box.is_fixed else np.linspace(box.min, box.max, _SCANNED).tolist()
        for i in range(0, len(alphas), _ANCHORS):
            self._from_starts(alphas[i], _STARTS_OF_ONE if box.is_fixed else _STARTS)
        for order in (alphas, alphas[::-1]):
            for here, there in zip(order[1:], order, strict=False):
                if self._may_improve(here, there):
                    self._from(here, [there], _FINISHED_IN_SCAN)

    def begin_at(self, gains: FoPi) -> None:
        """In place of the scan: solve from gains at their own alpha and a step of the scan on either side."""
        box = self.task.spec.controller.alpha
        x, step = self.task.scaled(gains), (box.max - box.min) / (_SCANNED - 1)
        for alpha in dict.fromkeys((gains.alpha, max(gains.alpha - step, box.min), min(gains.alpha + step, box.max))):
            self._offer(alpha, self.procedure.run(self.task.gains(x, alpha), _FINISHED_IN_SCAN))

    def _from_starts(self, alpha: float, most: int) -> None:
        """Solve from several starts; two with the same result are enough."""
        ends: list[LocalResult] = []
        for start in starts(self.task, self.members, alpha, most):
            ends.append(self.procedure.run(start.gains, _FINISHED_IN_SCAN))
            self._offer(alpha, ends[-1])
            if len(ends) == 2 and all(f.feasible for f in ends) and _same(*ends):
                return

    def reevaluate(self) -> None:
        """Solve again at all alphas from their own results, after members were added."""
        known, self.known = self.known, {}
        for alpha, found in known.items():
            again = evaluate(self.task, found.gains, self.members.plants)
            if (
                is_better(again, found.evaluation)
                or again.violation > TOLERANCE
                or again.cost > found.evaluation.cost + _FINISHED
            ):
                found = self.procedure.run(found.gains, _FINISHED_IN_SCAN)
            self._offer(alpha, replace(found, evaluation=evaluate(self.task, found.gains, self.members.plants)))

    def refine(self) -> None:
        """Refine the brackets that may contain the best alpha until no improvement is possible in them."""
        alphas = sorted(self.known)
        brackets = [self._bracket(alpha) for alpha in alphas]
        valleys = [b for b in brackets if all(_rank(self.known[b[1]]) <= _rank(self.known[end]) for end in b)]
        most = _MOST_VALLEYS if any(found.feasible for found in self.known.values()) else _MOST_INFEASIBLE_VALLEYS
        for low, middle, high in sorted(valleys, key=lambda b: _rank(self.known[b[1]]))[:most]:
            best = self.best()
            if best is not None and self._may_beat(best, low, middle, high):
                self._refine(low, middle, high)

    def _may_beat(self, best: LocalResult, low: float, middle: float, high: float) -> bool:
        """Whether the minimum in a bracket may be below the best known cost, extrapolating its slopes."""
        here = self.known[middle]
        if not here.feasible or not best.feasible:
            return not best.feasible
        falls = [
            abs(self.known[end].evaluation.cost - here.evaluation.cost)
            for end in (low, high)
            if self.known[end].feasible
        ]
        finite = [fall for fall in falls if np.isfinite(fall)]
        return here.evaluation.cost - max(finite, default=np.inf) <= best.evaluation.cost

    def _refine(self, first: float, middle: float, last: float) -> None:
        for alpha in dict.fromkeys((middle, first, last)):
            self._offer(alpha, self.procedure.run(self.known[alpha].gains))
        if first == last:
            return
        for count in range(_MOST_TRIES):
            within = [a for a in self.known if first <= a <= last]
            low, middle, high = self._bracket(min(within, key=lambda a: _rank(self.known[a])))
            low, high = max(low, first), min(high, last)
            if high - low < _NARROWEST or self._is_done(low, middle, high):
                return
            alpha = self._next_alpha(low, middle, high) if count % 3 != 2 else None
            if alpha is None or not low < alpha < high or min(abs(alpha - a) for a in self.known) < 0.1 * _NARROWEST:
                alpha = middle + _GOLDEN * (high - middle if high - middle > middle - low else low - middle)
            self._from(float(alpha), [low, middle, high])

    def _from(self, alpha: float, neighbours: Iterable[float], enough: float = NO_GAIN) -> None:
        """Solve at one alpha from the results at its neighbours, the best neighbour first."""
        tried = sorted((self.known[n] for n in dict.fromkeys(neighbours) if n in self.known), key=_rank)
        for found in tried[:2]:
            x = self.task.scaled(found.gains)
            run = self.procedure.run(self.task.gains(x, alpha), enough)
            self._offer(alpha, run)
            if run.feasible:
                break

    def _offer(self, alpha: float, found: LocalResult) -> None:
        if alpha not in self.known or is_better(found.evaluation, self.known[alpha].evaluation):
            self.known[alpha] = found

    def _may_improve(self, here: float, there: float) -> bool:
        """Whether starting from the result at `there` may improve the result at `here`."""
        if there not in self.known:
            return False
        return here not in self.known or is_better(self.known[there].evaluation, self.known[here].evaluation)

    def _bracket(self, middle: float) -> tuple[float, float, float]:
        below = [a for a in self.known if a < middle]
        above = [a for a in self.known if a > middle]
        return max(below, default=middle), middle, min(above, default=middle)

    def _is_done(self, low: float, middle: float, high: float) -> bool:
        at_ends = [self.known[a] for a in (low, high)]
        here = self.known[middle].evaluation
        if not self.known[middle].feasible:
            return False
        reach = [abs(f.evaluation.cost - here.cost) for f in at_ends if f.feasible]
        if len(reach) == 2:
            return max(reach) < _FINISHED
        if len(reach) == 1:
            # extrapolate the cost beyond the edge of feasibility
            inner, outer = (middle - low, high - middle) if at_ends[0].feasible else (high - middle, middle - low)
            return inner > 0.0 and reach[0] / inner * outer < _FINISHED and reach[0] < 1e3 * _FINISHED
        return False

    def _next_alpha(self, low: float, middle: float, high: float) -> float | None:
        feasible = [self.known[a].feasible for a in (low, middle, high)]
        if all(feasible):
            return self._vertex(low, middle, high)
        if not feasible[1]:
            return self._edge_from_infeasible(middle)
        side = 1 if not feasible[2] else -1
        return self._edge(middle, side)

    def _vertex(self, low: float, middle: float, high: float) -> float | None:
        if not low < middle < high:
            near, far = middle, high if low == middle else low
            return near + 0.1 * (far - near)
        a, b, c = (self.known[x].evaluation.cost for x in (low, middle, high))
        left, right = (b - a) / (middle - low), (c - b) / (high - middle)
        if right - left <= 0.0:
            return None
        vertex = 0.5 * (low + middle) - left * 0.5 * (high - low) / (right - left)
        least = 0.02 * min(middle - low, high - middle)
        if abs(vertex - middle) < least:
            return middle + (least if high - middle > middle - low else -least) * 3.0
        return vertex

    def _edge(self, middle: float, side: int) -> float | None:
        """Where the line through the two nearest violations beyond the edge of feasibility is 0."""
        beyond = sorted((a for a in self.known if (a - middle) * side > 0.0), key=lambda a: abs(a - middle))[:2]
        if len(beyond) < 2 or any(self.known[a].feasible for a in beyond):
            return None
        return _root_of_line(beyond, [self.known[a].evaluation.violation for a in beyond])

    def _edge_from_infeasible(self, middle: float) -> float | None:
        """Where a line through two violations on one side of an infeasible middle is 0; the nearer of both sides."""
        violations = {a: f.evaluation.violation for a, f in self.known.items()}
        left = sorted((a for a in violations if a <= middle), reverse=True)
        right = sorted(a for a in violations if a >= middle)
        candidates = []
        for side in (left, right):
            if len(side) >= 2 and violations[side[0]] < violations[side[1]]:
                candidates.append(_root_of_line(side[:2], [violations[a] for a in side[:2]]))
        inside = [c for c in candidates if c is not None]
        return min(inside, key=lambda c: abs(c - middle)) if inside else None


def _root_of_line(x: list[float], y: list[float]) -> float | None:
    if y[0] == y[1]:
        return None
    return x[0] - y[0] * (x[1] - x[0]) / (y[1] - y[0])


def _same(one: LocalResult, other: LocalResult) -> bool:
    return abs(one.evaluation.cost - other.evaluation.cost) < _SAME_OPTIMUM


def _rank(found: LocalResult) -> tuple[float, float]:
    return max(found.evaluation.violation, TOLERANCE), found.evaluation.cost


def _best_of(found: Iterable[LocalResult]) -> LocalResult:
    return min(found, key=_rank)
