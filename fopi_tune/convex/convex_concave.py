"""One alpha:  convex-concave steps from a start to a point that no step improves.

Every round makes the rows at the current gains, solves a convex problem within a trust region, and looks at the gains
it leads to with the exact crossings and peaks of `core/`.  Where they are better they are the next; where only the
requirements' curvature spoils them (the objective fell, a limit is missed) the next rows are made there, which is a
Newton step back; otherwise the trust region shrinks.  Without any room the step is the one that misses least.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fopi_tune.convex.cone_constraints import constraints_at
from fopi_tune.convex.evaluate import OBJECTIVE, ConstraintPoints, Evaluation, evaluate
from fopi_tune.convex.limits import Task
from fopi_tune.convex.program import Program, Step
from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

#: a limit is met when it is missed by less than this, natural units
TOLERANCE = 2e-7
#: a smaller improvement (natural units) is none
NO_GAIN = 1e-8
_SMALLEST_TRUST, _LARGEST_TRUST = 1e-7, 4.0
_MOST_ROUNDS = 60
#: parts of what a step promised that came true: below the first it is not taken, below the second the trust region
#: shrinks, above the third it may grow
_POOR, _FAIR, _GOOD = 0.05, 0.3, 0.7
_SHRINK = 0.4
#: a miss costs so many times what the rows' multipliers say
_SAFETY = 2.0
#: places of earlier rounds that are kept
_MEMORY = 60


@dataclass
class Members:
    """The plants in play, the nominal one first; the exchange adds to them."""

    task: Task
    points: Array
    plants: Plants = field(init=False)

    def __post_init__(self) -> None:
        self.plants = Plants.members(self.task.spec.plant, self.points)

    @classmethod
    def of(cls, task: Task) -> Members:
        """The nominal plant and the box's corners."""
        points = task.spec.plant.corners(64)
        _, first = np.unique(points, axis=0, return_index=True)
        return cls(task, points[np.sort(first)])

    def add(self, points: Array) -> int:
        """Take these plants in, unless they are there already; returns how many are new."""
        width = np.maximum(self.task.spec.plant.high - self.task.spec.plant.low, 1e-300)
        new = 0
        for point in points:
            if np.min(np.max(np.abs(self.points - point) / width, axis=1, initial=0.0)) > 1e-9:
                self.points, new = np.concatenate([self.points, point[None, :]]), new + 1
        if new:
            self.plants = Plants.members(self.task.spec.plant, self.points)
        return new


@dataclass(frozen=True)
class LocalResult:
    """The end of the steps at one alpha."""

    evaluation: Evaluation
    rounds: int

    @property
    def gains(self) -> FoPi:
        """The controller."""
        return self.evaluation.gains

    @property
    def feasible(self) -> bool:
        """Whether every limit is met on the plants in play."""
        return self.evaluation.violation <= TOLERANCE


def is_better(one: Evaluation, other: Evaluation, by: float = 0.0) -> bool:
    """Whether one is better than the other: met before missed, then the objective, else missed by less."""
    if one.violation <= TOLERANCE and other.violation <= TOLERANCE:
        return one.cost < other.cost - by
    if one.violation <= TOLERANCE or other.violation <= TOLERANCE:
        return one.violation <= TOLERANCE
    return one.violation < other.violation


@dataclass(frozen=True)
class _Move:
    """A step; whether it aims at the objective; and by how much the objective, else the violation, is to fall."""

    step: Step
    aims: bool
    promised: float


def _reduction_ratio(here: Evaluation, there: Evaluation, move: _Move, promised: float, penalty: float) -> float:
    """Which part of what was promised came true."""
    if not np.isfinite(there.violation):
        return -np.inf
    if not move.aims:
        return (here.violation - there.violation) / promised
    if not np.isfinite(there.cost):
        return -np.inf
    if not np.isfinite(here.cost):
        return 1.0
    return (here.cost - there.cost + penalty * (here.violation - there.violation)) / promised


@dataclass
class ConvexConcaveProcedure:
    """The steps, and what they keep between one alpha and the next: the compiled problems and earlier places."""

    task: Task
    members: Members
    program: Program
    memory: ConstraintPoints | None = None

    def run(self, start: FoPi, enough: float = NO_GAIN) -> LocalResult:
        """Improve gains at their alpha until no step promises more than `enough` (natural units)."""
        here = best = evaluate(self.task, start, self.members.plants)
        if not np.isfinite(here.violation):
            return LocalResult(here, 0)
        trust, penalty, rounds = 1.0, 1.0, 0
        while rounds < _MOST_ROUNDS and trust > _SMALLEST_TRUST:
            rounds += 1
            move = self._move(here, trust)
            if move is None:
                break
            penalty = max(penalty, _SAFETY * move.step.price)
            promised = move.promised + (penalty * here.violation if move.aims else 0.0)
            if promised < (enough if here.violation <= TOLERANCE else NO_GAIN):
                break
            there = self._moved(here, move.step)
            kept = _reduction_ratio(here, there, move, promised, penalty)
            if kept < _POOR and move.aims and there.violation > TOLERANCE and np.isfinite(there.cost):
                # the requirements' curvature may be all that spoils it: a second step, with rows made there
                again = self._move(there, trust)
                corrected = self._moved(there, again.step) if again is not None else there
                if (second := _reduction_ratio(here, corrected, move, promised, penalty)) > kept:
                    there, kept = corrected, second
            size = float(np.abs(move.step.d / self._reach(here, 1.0)).max())
            if kept > _POOR:
                here = there
                best = here if is_better(here, best) else best
            if kept < _FAIR:
                trust = _SHRINK * min(trust, max(size, 1e-12))
            elif kept > _GOOD and size > 0.9 * trust:
                trust = min(2.0 * trust, _LARGEST_TRUST)
        return LocalResult(best, rounds)

    def _move(self, here: Evaluation, trust: float) -> _Move | None:
        """The step that the objective asks for or, where the rows leave no room, the one that misses least."""
        rows = constraints_at(self.task, here, self.members.plants, self._remembered(here))
        low, high = self._bounds(here, trust)
        price, weight = self._price(here.gains)
        step = self.program.step(rows, low, high, price, weight)
        if step is not None:
            used = 0.0 if self.task.objective is ObjectiveKind.KI else weight * step.value
            return _Move(step, True, -float(price @ step.d) - used)
        step = self.program.restore(rows, low, high)
        return None if step is None else _Move(step, False, here.violation - step.value)

    def _price(self, gains: FoPi) -> tuple[Array, float]:
        if self.task.objective is ObjectiveKind.KI:
            return np.array([0.0, self.task.ki_cost(gains)[1] * self.task.unit(gains.alpha)[1]]), 1e-6
        return np.zeros(2), 1.0

    def _reach(self, here: Evaluation, trust: float) -> Array:
        size = np.abs(self.task.scaled(here.gains))
        return trust * (size + 0.25 * max(float(size.max()), 0.02))

    def _bounds(self, here: Evaluation, trust: float) -> tuple[Array, Array]:
        x, reach = self.task.scaled(here.gains), self._reach(here, trust)
        low, high = self.task.box(here.gains.alpha)
        return np.minimum(np.maximum(low - x, -reach), 0.0), np.maximum(np.minimum(high - x, reach), 0.0)

    def _moved(self, here: Evaluation, step: Step) -> Evaluation:
        x = self.task.scaled(here.gains) + step.d
        return evaluate(self.task, self.task.gains(x, here.gains.alpha), self.members.plants)

    def _remembered(self, here: Evaluation) -> ConstraintPoints:
        """The places of now, and those of frequency functions of earlier rounds; the oldest are forgotten."""
        bands = [k for k, limit in enumerate(self.task.limits) if limit.where is EvaluatedAt.BAND]
        peaks = self.task.objective in (ObjectiveKind.SENSITIVITY_PEAK, ObjectiveKind.CONTROL_SENSITIVITY_PEAK)
        kept = np.isin(here.points.limit, [*bands, *([OBJECTIVE] if peaks else [])])
        now = here.points.take(np.flatnonzero(kept & (np.abs(here.points.u) < 99.0)))
        points = here.points if self.memory is None else ConstraintPoints.joined([here.points, self.memory])
        near = now.take(np.argsort(now.slack)[:12])
        memory = near if self.memory is None else ConstraintPoints.joined([near, self.memory])
        self.memory = memory.take(np.arange(min(len(memory), _MEMORY)))
        return points
