"""The search over alpha:  a scan, then the best bracket made smaller, without derivatives.

The best gains at one alpha come from `local.py`; an alpha is better than another when it meets all limits and has the
smaller cost, or misses them by less.  Within a bracket the next alpha is guessed from what is known,

    all met                 the vertex of the parabola through three costs,
    the edge of what can be met   where the line through two misses is 0,
    nothing met             where the lines through two misses on either side meet,

and every third time the larger part is cut by the golden section, so that the bracket shrinks whatever the guesses.
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

#: orders of the first scan; of every so many of them starts are looked for, the others begin at their neighbours
_SCANNED, _ANCHORS = 13, 4
_STARTS, _STARTS_OF_ONE = 3, 5
#: natural units; costs this near are those of one optimum
_SAME_END = 1e-3
_MOST_TRIES = 40
#: brackets that are looked into, and how many while no alpha is known that meets everything
_MOST_VALLEYS, _MOST_HOPELESS = 5, 2
_GOLDEN = 0.381966
#: natural units; a bracket that can hold no more improvement than this is done
_ENOUGH = 2e-8
_NARROWEST = 1e-10
#: the same within a scan's alpha
_ROUGHLY = 1e-4


@dataclass
class AlphaSearch:
    """The best gains at every alpha that was looked at."""

    task: Task
    members: Members
    known: dict[float, LocalResult] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.procedure = ConvexConcaveProcedure(self.task, self.members, Program(self.task.equalities))

    def best(self) -> LocalResult | None:
        """The best of all; None when no start was usable."""
        found = [f for f in self.known.values() if np.isfinite(f.evaluation.violation)]
        return None if not found else _best_of(found)

    def scan(self) -> None:
        """Look at alphas over the whole range, from starts and from each other's answers."""
        box = self.task.spec.controller.alpha
        alphas = [box.min] if box.is_fixed else np.linspace(box.min, box.max, _SCANNED).tolist()
        for i in range(0, len(alphas), _ANCHORS):
            self._from_starts(alphas[i], _STARTS_OF_ONE if box.is_fixed else _STARTS)
        for order in (alphas, alphas[::-1]):
            for here, there in zip(order[1:], order, strict=False):
                if self._may_teach(here, there):
                    self._from(here, [there], _ROUGHLY)

    def _from_starts(self, alpha: float, most: int) -> None:
        """The best of some starts; two that lead to the same end are enough."""
        ends: list[LocalResult] = []
        for start in starts(self.task, self.members, alpha, most):
            ends.append(self.procedure.run(start.gains, _ROUGHLY))
            self._offer(alpha, ends[-1])
            if len(ends) == 2 and all(f.feasible for f in ends) and _same(*ends):
                return

    def reevaluate(self) -> None:
        """Look once more, from their own answers, at all alphas: plants have joined."""
        known, self.known = self.known, {}
        for alpha, found in known.items():
            again = evaluate(self.task, found.gains, self.members.plants)
            if (
                is_better(again, found.evaluation)
                or again.violation > TOLERANCE
                or again.cost > found.evaluation.cost + _ENOUGH
            ):
                found = self.procedure.run(found.gains, _ROUGHLY)
            self._offer(alpha, replace(found, evaluation=evaluate(self.task, found.gains, self.members.plants)))

    def refine(self) -> None:
        """Make the brackets that may hold the best alpha smaller until they hold nothing better."""
        alphas = sorted(self.known)
        brackets = [self._bracket(alpha) for alpha in alphas]
        valleys = [b for b in brackets if all(_rank(self.known[b[1]]) <= _rank(self.known[end]) for end in b)]
        most = _MOST_VALLEYS if any(found.feasible for found in self.known.values()) else _MOST_HOPELESS
        for low, middle, high in sorted(valleys, key=lambda b: _rank(self.known[b[1]]))[:most]:
            best = self.best()
            if best is not None and self._may_beat(best, low, middle, high):
                self._refine(low, middle, high)

    def _may_beat(self, best: LocalResult, low: float, middle: float, high: float) -> bool:
        """Whether a valley's floor may lie below the best known, were its slopes to go on across the bracket."""
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
            alpha = self._guess(low, middle, high) if count % 3 != 2 else None
            if alpha is None or not low < alpha < high or min(abs(alpha - a) for a in self.known) < 0.1 * _NARROWEST:
                alpha = middle + _GOLDEN * (high - middle if high - middle > middle - low else low - middle)
            self._from(float(alpha), [low, middle, high])

    def _from(self, alpha: float, neighbours: Iterable[float], enough: float = NO_GAIN) -> None:
        """The best at one alpha from its neighbours' answers, the best neighbour first."""
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

    def _may_teach(self, here: float, there: float) -> bool:
        """Whether the answer at `there` may lead to a better one here."""
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
            return max(reach) < _ENOUGH
        if len(reach) == 1:
            # beyond the edge the cost would go on as it does on this side
            inner, outer = (middle - low, high - middle) if at_ends[0].feasible else (high - middle, middle - low)
            return inner > 0.0 and reach[0] / inner * outer < _ENOUGH and reach[0] < 1e3 * _ENOUGH
        return False

    def _guess(self, low: float, middle: float, high: float) -> float | None:
        feasible = [self.known[a].feasible for a in (low, middle, high)]
        if all(feasible):
            return self._vertex(low, middle, high)
        if not feasible[1]:
            return self._meeting(middle)
        side = 1 if not feasible[2] else -1
        edge = self._edge(middle, side)
        # a hair on this side of where nothing is missed any more
        return None if edge is None else edge

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
        """Where the misses beyond an edge, drawn on as a line, are 0."""
        beyond = sorted((a for a in self.known if (a - middle) * side > 0.0), key=lambda a: abs(a - middle))[:2]
        if len(beyond) < 2 or any(self.known[a].feasible for a in beyond):
            return None
        return _zero(beyond, [self.known[a].evaluation.violation for a in beyond])

    def _meeting(self, middle: float) -> float | None:
        """Where misses that fall from both sides meet, or reach 0."""
        misses = {a: f.evaluation.violation for a, f in self.known.items()}
        left = sorted((a for a in misses if a <= middle), reverse=True)
        right = sorted(a for a in misses if a >= middle)
        candidates = []
        for side in (left, right):
            if len(side) >= 2 and misses[side[0]] < misses[side[1]]:
                candidates.append(_zero(side[:2], [misses[a] for a in side[:2]]))
        inside = [c for c in candidates if c is not None]
        return min(inside, key=lambda c: abs(c - middle)) if inside else None


def _zero(x: list[float], y: list[float]) -> float | None:
    if y[0] == y[1]:
        return None
    return x[0] - y[0] * (x[1] - x[0]) / (y[1] - y[0])


def _same(one: LocalResult, other: LocalResult) -> bool:
    return abs(one.evaluation.cost - other.evaluation.cost) < _SAME_END


def _rank(found: LocalResult) -> tuple[float, float]:
    return max(found.evaluation.violation, TOLERANCE), found.evaluation.cost


def _best_of(found: Iterable[LocalResult]) -> LocalResult:
    return min(found, key=_rank)
