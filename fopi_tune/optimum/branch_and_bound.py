"""Branch and bound over the gains:  proves that no gains meet a spec with an objective better than a level.

Batches of boxes are screened in floating point.  A box is discarded only when the suggested reason is confirmed in ball
arithmetic.  The remaining boxes are split along the axis with the largest variation.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.central_loops import Suggestion
from fopi_tune.optimum.pruning.combinations import Combination, are_excluded_together
from fopi_tune.optimum.pruning.conditions import Test
from fopi_tune.optimum.pruning.crossover_suggestions import suggestions
from fopi_tune.optimum.pruning.exclusion import Reason, is_excluded
from fopi_tune.optimum.pruning.joint_suggestions import combinations
from fopi_tune.optimum.pruning.sample_points import (
    WorstCasePoint,
    constant_reasons,
    first_reasons,
    further_reasons,
    meets_conditions,
    plants_to_try,
    spread_reasons,
)
from fopi_tune.optimum.pruning.screen import Boxes, LinearBounds, ScreeningResult, ScreeningSamples
from fopi_tune.optimum.tree import Node
from fopi_tune.proof.balls.box import centre_of

#: called with (boxes examined, boxes open) while a search runs
Progress = Callable[[int, int], None]

_BATCH = 256
#: ratios from which a suggestion is tested in ball arithmetic: of a Taylor model, and of rougher bounds
_SURE, _WORTH = 1.0 + 1e-9, 1.02
#: rounds between searches for new samples, and boxes used for them
_REFINE_EVERY, _REFINE_BOXES = 4, 24
#: box centres tried as controllers each time
_MOST_TRIED = 3
#: crossings of a box that are tested one by one
_MOST_CROSSINGS = 2
#: splits between attempts at claims that cost milliseconds
_COSTLY_EVERY = 3
#: a box whose widest side is this, on the parametrization's scale, is not split further
_NARROWEST = 2.0**-26
#: a side is split only if it is wider than this fraction of the widest side, both on that scale
_ASPECT = 0.1


class Termination(StrEnum):
    """How the search for one level ended; the value says why the level was not proved."""

    SHOWN = ""
    LIMIT = "the limit of time or boxes was reached"
    NARROW = "a box became too narrow to be cut: the requirements may just touch"
    BETTER = "gains were met with that seem to be better"

    @property
    def words(self) -> str:
        """Why."""
        return self.value


@dataclass
class Limits:
    """When to stop.

    Args:
        until: `time.monotonic()` at which to stop.
        boxes: the most boxes to look at.
    """

    until: float
    boxes: int

    @property
    def is_over(self) -> bool:
        """Whether the time limit is reached."""
        return time.monotonic() >= self.until


@dataclass
class BranchAndBound:
    """A search whose tree is kept from level to level.

    Args:
        problem: with the current level.
        roots: of the trees.
        boxes_examined: so far.
        better: coordinates of a controller that seems to meet every condition.
        tries_centres: whether such controllers are looked for.
    """

    problem: Problem
    roots: tuple[Node, ...]
    limits: Limits
    reasons: list[Reason]
    points: list[tuple[float, ...]]
    progress: Progress | None = None
    boxes_examined: int = 0
    better: tuple[float, ...] | None = None
    tries_centres: bool = True
    _open: list[Node] = field(default_factory=list)
    _of_level: list[Reason] = field(default_factory=list)
    _samples: ScreeningSamples | None = None
    _hits: dict[int, int] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, limits: Limits, places: list, progress: Progress | None = None) -> BranchAndBound:
        """A search with its first samples.

        Args:
            problem: with the first level.
            limits: of time and boxes.
            places: (frequency or None, plant) of the worst cases of a verification.
            progress: called while the search runs.
        """
        points = plants_to_try(problem, places)
        reasons = first_reasons(problem, points, places)
        return cls(problem, tuple(Node(box) for box in problem.roots), limits, reasons, points, progress)

    def show(self, problem: Problem) -> Termination:
        """Discard every box at the level of this problem.

        Boxes discarded for an earlier level stay discarded, unless their reason depends on the level and fails now.
        """
        self.problem = problem
        self._of_level = spread_reasons(problem, self.points)
        self._samples = ScreeningSamples.of(problem, (*self.reasons, *self._of_level))
        self._open = []
        for root in self.roots:
            for leaf in root.leaves():
                if leaf.reason is not None and self._still_holds(leaf):
                    continue
                leaf.reason = None
                self._open.append(leaf)
        rounds = 0
        while self._open:
            if self.limits.is_over or self.boxes_examined >= self.limits.boxes:
                return Termination.LIMIT
            batch, self._open = self._open[-_BATCH:], self._open[:-_BATCH]
            self.boxes_examined += len(batch)
            left = self._examined(batch)
            rounds += 1
            if left is None:
                return Termination.NARROW
            if self.progress is not None:
                self.progress(self.boxes_examined, len(self._open))
            if rounds % _REFINE_EVERY == 0 and left:
                self._refine([node for node, _ in left])
                if self.tries_centres and self._finds_better_controller(left):
                    return Termination.BETTER
        return Termination.SHOWN

    def learn(self, places: list[WorstCasePoint]) -> None:
        """Take the worst cases of a controller that only seemed to be better; where they are known, try no more."""
        self.better = None
        points = plants_to_try(self.problem, [*((None, point) for point in self.points), *places])
        reasons = first_reasons(self.problem, points, places) if len(points) > len(self.points) else []
        known = set(self.reasons)
        new = [reason for reason in reasons if reason not in known]
        self.tries_centres = bool(new) or len(points) > len(self.points)
        self.points, self.reasons = points, self.reasons + new

    def _finds_better_controller(self, left: list[tuple[Node, float]]) -> bool:
        """Whether the centre of a box that violates no sample meets every condition."""
        fixed, is_line = self.problem.margin_is_fixed, self.problem.is_line
        good = sorted((ratio, k) for k, (node, ratio) in enumerate(left) if ratio < 0.0 and is_line(node.box) == fixed)
        for _, k in good[:_MOST_TRIED]:
            centre = centre_of(left[k][0].box)
            if meets_conditions(self.problem, np.array([centre]), self.points):
                self.better = centre
                return True
        return False

    def _still_holds(self, leaf: Node) -> bool:
        reason, conditions = leaf.reason, self.problem.conditions.every
        assert reason is not None
        several = reason.reasons if isinstance(reason, Combination) else (reason,)
        if not any(conditions[each.condition].of_objective for each in several):
            return True
        controllers = self.problem.parametrization.controllers(leaf.box)
        if isinstance(reason, Combination):
            return are_excluded_together(self.problem, controllers, reason)
        return is_excluded(self.problem, controllers, reason)

    def _examined(self, batch: list[Node]) -> list[tuple[Node, float]] | None:
        """Discard what can be discarded and split the rest.

        Returns:
            The split boxes with their largest ratios; None when a box is too narrow to be split.
        """
        assert self._samples is not None
        boxes = _boxes(batch)
        found = self._samples.screen(self.problem.parametrization, boxes)
        axes, ratios = found.axis.copy(), found.ratio.copy()
        rows: list[int] = []
        for row, node in enumerate(batch):
            if found.ratio[row] > _SURE and self._discard(node, self._samples.reasons[int(found.reason[row])]):
                continue
            rows.append(row)
        rows = self._by_fixed_margin(batch, self._simple(batch, rows))
        if rows:
            rows = self._from_crossovers(batch, boxes, found, rows, axes, ratios)
        left = []
        for row in rows:
            node = batch[row]
            axis = self._axis(node, int(axes[row]))
            pieces = node.cut(axis) if axis >= 0 else None
            if pieces is None:
                self._open += [batch[other] for other in rows if batch[other].axis < 0]
                return None
            self._open += pieces
            left.append((node, float(ratios[row])))
        return left

    def _discard(self, node: Node, reason: Reason) -> bool:
        if not is_excluded(self.problem, self.problem.parametrization.controllers(node.box), reason):
            return False
        node.reason = reason
        return True

    def _simple(self, batch: list[Node], rows: list[int]) -> list[int]:
        """By conditions on the gains themselves."""
        implied = self.problem.parametrization.implied
        simple = [
            Reason(k)
            for k, condition in enumerate(self.problem.conditions.every)
            if condition.test is Test.GAIN and (condition.of_objective or condition.name not in implied)
        ] + constant_reasons(self.problem, self.points)
        return [row for row in rows if not any(self._discard(batch[row], reason) for reason in simple)]

    def _from_crossovers(
        self,
        batch: list[Node],
        boxes: Boxes,
        found: ScreeningResult,
        rows: list[int],
        axes: np.ndarray,
        ratios: np.ndarray,
    ) -> list[int]:
        """By one crossing, or by conditions that are not met together."""
        picked = np.array(rows)
        by_row: list[list[Suggestion]] = [[] for _ in rows]
        for suggestion in suggestions(self.problem, boxes.take(picked), self.points):
            by_row[suggestion.row].append(suggestion)
        left: list[int] = []
        for k, row in enumerate(rows):
            node = batch[row]
            own = sorted(by_row[k], key=lambda s: -s.ratio)
            if self.problem.margin_is_fixed and not self.problem.is_line(node.box):
                own = [s for s in own if not self._is_cover(s)]  # too expensive off the lines of the fixed margin
            by_row[k] = own
            sure = [s for s in own if s.ratio > _WORTH]
            cheap = [s for s in sure if not self._is_cover(s)][:_MOST_CROSSINGS]
            costly = [s for s in sure if self._is_cover(s)][:_MOST_CROSSINGS]
            if any(self._discard(node, s.reason) for s in (*cheap, *costly)):
                continue
            if own and own[0].axis >= 0 and own[0].ratio > ratios[row]:
                axes[row], ratios[row] = own[0].axis, own[0].ratio
            left.append(k)
        left = self._together(batch, boxes, found, rows, left, by_row)
        costly = [k for k in left if self._depth(batch[rows[k]]) % _COSTLY_EVERY == 0]
        gone = {k for k in costly if self._costly(batch[rows[k]], by_row[k])}
        return [rows[k] for k in left if k not in gone]

    def _together(
        self,
        batch: list[Node],
        boxes: Boxes,
        found: ScreeningResult,
        rows: list[int],
        left: list[int],
        by_row: list[list[Suggestion]],
    ) -> list[int]:
        """Discard boxes by conditions that are not met together; what is left of `left`, places in `rows`."""
        if not left:
            return left
        assert self._samples is not None
        picked = np.array([rows[k] for k in left])
        bounds = LinearBounds(found.bounds.middle[picked], found.bounds.slopes[picked])
        own = [by_row[k] for k in left]
        joint = combinations(self.problem, boxes.take(picked), self._samples.reasons, bounds, own)
        return [k for k, each in zip(left, joint, strict=True) if not self._discard_together(batch[rows[k]], each)]

    def _discard_together(self, node: Node, combination: Combination | None) -> bool:
        controllers = self.problem.parametrization.controllers(node.box)
        if combination is None or not are_excluded_together(self.problem, controllers, combination):
            return False
        node.reason = combination
        return True

    def _by_fixed_margin(self, batch: list[Node], rows: list[int]) -> list[int]:
        """Discard boxes in which no lower crossover can have the fixed nominal phase margin."""
        if not self.problem.margin_is_fixed:
            return rows
        place = next(k for k, c in enumerate(self.problem.conditions.every) if c.test is Test.LOWER_CROSSOVER)
        is_line = self.problem.is_line
        return [row for row in rows if is_line(batch[row].box) or not self._discard(batch[row], Reason(place))]

    def _is_cover(self, suggestion: Suggestion) -> bool:
        """Whether a claim covers the whole frequency axis, which is expensive."""
        condition = self.problem.conditions.every[suggestion.reason.condition]
        counted = condition.test is Test.STABILITY and suggestion.reason.omega
        covers = condition.test in (Test.CROSSOVER, Test.SPREAD, Test.GAIN_SPREAD)
        return covers or bool(counted) or (condition.test is Test.MARGIN and condition.upper)

    def _costly(self, node: Node, own: list[Suggestion]) -> bool:
        """A claim about the whole frequency axis."""
        unstable = [s for s in own if s.axis < 0 and s.ratio == 0.0]
        return not self.limits.is_over and any(self._discard(node, s.reason) for s in unstable)

    def _depth(self, node: Node) -> int:
        """Number of splits since the root, from the box's size."""
        root = next(root for root in self.roots if _is_inside(node.box, root.box))
        volume = 0.0
        for (a, b), (first, last) in zip(node.box, root.box, strict=True):
            if last > first and b > a:
                volume += np.log2((last - first) / (b - a))
        return round(volume)

    def _widths(self, node: Node) -> list[float]:
        """The box's sides, on a scale on which all of them matter alike."""
        return self.problem.parametrization.widths(node.box, self.problem.roots[0])

    def _axis(self, node: Node, wanted: int) -> int:
        """The requested axis, or the widest where that one is much narrower; -1 when all are too narrow."""
        widths = self._widths(node)
        widest = int(np.argmax(widths))
        if widths[widest] <= _NARROWEST:
            return -1
        return wanted if wanted >= 0 and widths[wanted] > _ASPECT * widths[widest] else widest

    def _refine(self, left: list[Node]) -> None:
        """Add samples where the centres of remaining boxes violate a condition most."""
        new = further_reasons(self.problem, _boxes(left[-_REFINE_BOXES:]).middle, self.points)
        known = set(self.reasons)
        new = [reason for reason in new if reason not in known]
        if new:
            self.reasons += new
            self._samples = ScreeningSamples.of(self.problem, (*self.reasons, *self._of_level))


def _boxes(nodes: list[Node]) -> Boxes:
    ends = np.array([node.box for node in nodes], dtype=float)
    return Boxes(ends[:, :, 0], ends[:, :, 1])


def _is_inside(box: tuple, root: tuple) -> bool:
    return all(first <= a and b <= last for (a, b), (first, last) in zip(box, root, strict=True))
