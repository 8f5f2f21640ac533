"""The convex-concave procedure for one alpha:  from a start to gains that no step improves.

Every round linearises the constraints at the current gains, solves a convex problem within a trust region, and
evaluates the resulting gains exactly, by the crossings and peaks of `core/`.  The step is accepted by the ratio of
actual to predicted reduction of a merit function, the cost plus a penalty times the violation.  Where the cost fell but
a limit is violated, a second-order correction is tried: a step with the constraints linearised at the new gains.
Otherwise the trust region shrinks.  Where the convex problem is infeasible, the step minimises the violation.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fopi_tune.convex.cone_constraints import constraints_at
from fopi_tune.convex.evaluate import OBJECTIVE, PEAKS, ConstraintPoints, Evaluation, evaluate
from fopi_tune.convex.limits import Task
from fopi_tune.convex.program import Program, Step
from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

#: natural units; a limit counts as met when it is violated by less than this
TOLERANCE = 2e-7
#: natural units; smaller improvements are not pursued
NO_GAIN = 1e-8
_SMALLEST_TRUST_RADIUS, _LARGEST_TRUST_RADIUS = 1e-7, 4.0
_MOST_ROUNDS = 60
#: ratios of actual to predicted reduction: below the first a step is rejected, below the second the trust region
#: shrinks, above the third it may grow
_REJECTED, _FAIR, _GOOD = 0.05, 0.3, 0.7
_SHRINK = 0.4
#: the penalty of a violation, as a multiple of the sum of multipliers
_PENALTY_FACTOR = 2.0
#: points of earlier rounds that are kept
_MEMORY = 60


@dataclass
class Members:
    """The members of the family that are designed for, the nominal one first; the exchange adds to them."""

    task: Task
    points: Array
    plants: Plants = field(init=False)

    def __post_init__(self) -> None:
        self.plants = self.task.kind.plants(Plants.members(self.task.spec.plant, self.points))

    @classmethod
    def of(cls, task: Task) -> Members:
        """The nominal plant and the box's corners."""
        points = task.spec.plant.corners(64)
        _, first = np.unique(points, axis=0, return_index=True)
        return cls(task, points[np.sort(first)])

    def add(self, points: Array) -> int:
        """Add members, unless they are there already; returns how many are new."""
        width = np.maximum(self.task.spec.plant.high - self.task.spec.plant.low, 1e-300)
        new = 0
        for point in points:
            if np.min(np.max(np.abs(self.points - point) / width, axis=1, initial=0.0)) > 1e-9:
                self.points, new = np.concatenate([self.points, point[None, :]]), new + 1
        if new:
            self.plants = self.task.kind.plants(Plants.members(self.task.spec.plant, self.points))
        return new


@dataclass(frozen=True)
class LocalResult:
    """The result of the procedure at one alpha."""

    evaluation: Evaluation
    rounds: int

    @property
    def gains(self) -> FoPi:
        """The controller."""
        return self.evaluation.gains

    @property
    def feasible(self) -> bool:
        """Whether every limit is met on the current members."""
        return self.evaluation.violation <= TOLERANCE


def is_better(one: Evaluation, other: Evaluation, by: float = 0.0) -> bool:
    """Whether one is better: feasible before infeasible, then the smaller cost (by `by`) or the smaller violation."""
    if one.violation <= TOLERANCE and other.violation <= TOLERANCE:
        return one.cost < other.cost - by
    if one.violation <= TOLERANCE or other.violation <= TOLERANCE:
        return one.violation <= TOLERANCE
    return one.violation < other.violation


@dataclass(frozen=True)
class _Move:
    """A step.

    Args:
        step: of the convex problem.
        for_objective: whether it minimises the objective; else it minimises the violation.
        predicted: reduction of the one or the other, natural units.
    """

    step: Step
    for_objective: bool
    predicted: float


def _reduction_ratio(here: Evaluation, there: Evaluation, move: _Move, predicted: float, penalty: float) -> float:
    """The ratio of actual to predicted reduction of the merit function."""
    if not np.isfinite(there.violation):
        return -np.inf
    if not move.for_objective:
        return (here.violation - there.violation) / predicted
    if not np.isfinite(there.cost):
        return -np.inf
    if not np.isfinite(here.cost):
        return 1.0
    return (here.cost - there.cost + penalty * (here.violation - there.violation)) / predicted


@dataclass
class ConvexConcaveProcedure:
    """The procedure, with what is reused from one alpha to the next: compiled problems and earlier points."""

    task: Task
    members: Members
    program: Program
    memory: ConstraintPoints | None = None

    def run(self, start: FoPi, enough: float = NO_GAIN) -> LocalResult:
        """Improve gains at their alpha until no step predicts a reduction above `enough` (natural units)."""
        here = best = evaluate(self.task, start, self.members.plants)
        if not np.isfinite(here.violation):
            return LocalResult(here, 0)
        trust_radius, penalty, rounds = 1.0, 1.0, 0
        while rounds < _MOST_ROUNDS and trust_radius > _SMALLEST_TRUST_RADIUS:
            rounds += 1
            move = self._move(here, trust_radius)
            if move is None:
                break
            penalty = max(penalty, _PENALTY_FACTOR * move.step.multiplier_sum)
            predicted = move.predicted + (penalty * here.violation if move.for_objective else 0.0)
            if predicted < (enough if here.violation <= TOLERANCE else NO_GAIN):
                break
            there = self._moved(here, move.step)
            ratio = _reduction_ratio(here, there, move, predicted, penalty)
            if ratio < _REJECTED and move.for_objective and there.violation > TOLERANCE and np.isfinite(there.cost):
                # second-order correction: a second step, with the constraints linearised at the new gains
                again = self._move(there, trust_radius)
                corrected = self._moved(there, again.step) if again is not None else there
                if (second := _reduction_ratio(here, corrected, move, predicted, penalty)) > ratio:
                    there, ratio = corrected, second
            size = float(np.abs(move.step.d / self._region(here, 1.0)).max())
            if ratio > _REJECTED:
                here = there
                best = here if is_better(here, best) else best
            if ratio < _FAIR:
                trust_radius = _SHRINK * min(trust_radius, max(size, 1e-12))
            elif ratio > _GOOD and size > 0.9 * trust_radius:
                trust_radius = min(2.0 * trust_radius, _LARGEST_TRUST_RADIUS)
        return LocalResult(best, rounds)

    def _move(self, here: Evaluation, trust_radius: float) -> _Move | None:
        """The step for the objective or, where the constraints leave no room, the one that minimises the violation."""
        rows = constraints_at(self.task, here, self.members.plants, self._remembered(here))
        low, high = self._bounds(here, trust_radius)
        gradient, weight = self._gradient(here.gains)
        step = self.program.step(rows, low, high, gradient, weight)
        if step is not None:
            used = 0.0 if self.task.objective is ObjectiveKind.KI else weight * step.value
            return _Move(step, True, -float(gradient @ step.d) - used)
        step = self.program.restore(rows, low, high)
        return None if step is None else _Move(step, False, here.violation - step.value)

    def _gradient(self, gains: FoPi) -> tuple[Array, float]:
        if self.task.objective is ObjectiveKind.KI:
            return np.array([0.0, self.task.ki_cost(gains)[1] * self.task.unit(gains.alpha)[1]]), 1e-6
        return np.zeros(2), 1.0

    def _region(self, here: Evaluation, trust_radius: float) -> Array:
        size = np.abs(self.task.scaled(here.gains))
        return trust_radius * (size + 0.25 * max(float(size.max()), 0.02))

    def _bounds(self, here: Evaluation, trust_radius: float) -> tuple[Array, Array]:
        x, reach = self.task.scaled(here.gains), self._region(here, trust_radius)
        low, high = self.task.box(here.gains.alpha)
        return np.minimum(np.maximum(low - x, -reach), 0.0), np.maximum(np.minimum(high - x, reach), 0.0)

    def _moved(self, here: Evaluation, step: Step) -> Evaluation:
        x = self.task.scaled(here.gains) + step.d
        return evaluate(self.task, self.task.gains(x, here.gains.alpha), self.members.plants)

    def _remembered(self, here: Evaluation) -> ConstraintPoints:
        """The current points and those of frequency functions of earlier rounds, of which the oldest are dropped."""
        bands = [k for k, limit in enumerate(self.task.limits) if limit.where is EvaluatedAt.BAND]
        peaks = self.task.objective in PEAKS
        kept = np.isin(here.points.limit, [*bands, *([OBJECTIVE] if peaks else [])])
        now = here.points.take(np.flatnonzero(kept & (np.abs(here.points.u) < 99.0)))
        points = here.points if self.memory is None else ConstraintPoints.joined([here.points, self.memory])
        near = now.take(np.argsort(now.slack)[:12])
        memory = near if self.memory is None else ConstraintPoints.joined([near, self.memory])
        self.memory = memory.take(np.arange(min(len(memory), _MEMORY)))
        return points
