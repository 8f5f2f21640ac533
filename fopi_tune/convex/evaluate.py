"""Evaluate gains on given plants:  every limit and the objective, exactly, by the crossings and peaks of `core/`.

The result is a list of points (a limit, a plant, a frequency), at which the next convex problem has its constraints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.convex.limits import STABILITY_GUARD, Bound, Limit, Task
from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import stays_large
from fopi_tune.core.peaks import Extremes, Response, extremes, log_response_at
from fopi_tune.core.stability import unstable_poles_from
from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

#: `ConstraintPoints.limit` of points of the objective
OBJECTIVE = -1
#: points at omega -> 0 or infinity, or Nyquist's, are put at u = -100 or 100
_FAR = 100.0
#: natural units; the violation of a limit at crossovers by a loop that has none is larger than this
_NO_CROSSOVER = 1.0
#: natural units; added to the violation when a loop is unstable
_UNSTABLE = 10.0


@dataclass(frozen=True)
class ConstraintPoints:
    """Points at which a limit or the objective is evaluated; all of shape (n,).

    Args:
        limit: index of the limit, or OBJECTIVE.
        plant: row of the plants.
        u: the loops' coordinate of frequency, of quantities at crossings the crossing's.
        slack: natural units; of the objective, minus its value.
        missing: whether the plant has no such crossing; u is then where |L| is closest to 1.
        side: of gain crossovers, the side of -1 on which L belongs, 1 by lag and -1 by lead; see `sides_of_minus_one`.
    """

    limit: Rows
    plant: Rows
    u: Array
    slack: Array
    missing: NDArray[np.bool_]
    side: Array

    @classmethod
    def of(
        cls, limit: int, plant: Rows, u: Array, slack: Array, missing: bool = False, side: Array | None = None
    ) -> ConstraintPoints:
        """Points of one limit."""
        n = len(plant)
        clipped = np.clip(np.nan_to_num(u, nan=0.0), -_FAR, _FAR)
        sides = np.ones(n) if side is None else side
        return cls(np.full(n, limit, dtype=np.intp), plant, clipped, slack, np.full(n, missing), sides)

    @classmethod
    def joined(cls, parts: list[ConstraintPoints]) -> ConstraintPoints:
        """Concatenate."""
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def take(self, rows: Rows) -> ConstraintPoints:
        """Select rows."""
        return ConstraintPoints(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def __len__(self) -> int:
        return len(self.plant)


@dataclass(frozen=True)
class Evaluation:
    """The limits and the objective of one controller on some plants, the nominal one first.

    Args:
        gains: the controller.
        points: the worst points of each limit and of the objective, for each plant.
        violation: the largest of all limits, natural units; inf when both gains are 0.
        cost: the objective to be minimised, natural units.
        stable: whether the loop of every plant is stable.
    """

    gains: FoPi
    points: ConstraintPoints
    violation: float
    cost: float
    stable: bool

    def largest_violations(self, count: int) -> dict[int, float]:
        """The `count` limits with the largest violations, and these violations."""
        return dict(sorted(self._violations.items(), key=lambda pair: -pair[1])[:count])

    @property
    def _violations(self) -> dict[int, float]:
        violations: dict[int, float] = {}
        for k, slack in zip(self.points.limit.tolist(), self.points.slack.tolist(), strict=True):
            if k != OBJECTIVE:
                violations[k] = max(violations.get(k, -math.inf), -slack)
        return violations


def evaluate(task: Task, gains: FoPi, plants: Plants) -> Evaluation:
    """Evaluate every limit and the objective of one controller on these plants."""
    try:
        return _evaluate(task, gains, plants)
    except DomainError:
        # kp = ki = 0, or |L| = 1 over a whole range: the loop has no crossings.
        nothing = ConstraintPoints.of(OBJECTIVE, np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros(0))
        return Evaluation(gains, nothing, math.inf, math.inf, False)


def _evaluate(task: Task, gains: FoPi, plants: Plants) -> Evaluation:
    loops = task.kind.loops(gains, plants)
    crossings = gain_crossovers(loops)
    every_stable = unstable_poles_from(loops, crossings) < 0.5
    stable = bool(every_stable.all())
    evaluator = _Evaluator(task, loops, crossings, sides_of_minus_one(crossings, every_stable))
    parts = [part for k, limit in enumerate(task.limits) for part in evaluator.of(k, limit)]
    limits = ConstraintPoints.joined(parts)
    violation = max(0.0, float(-limits.slack.min(initial=math.inf)))
    objective = evaluator.objective(limits)
    cost = float(-objective.slack.min()) if len(objective) else task.ki_cost(gains)[0]
    violation += 0.0 if stable else _UNSTABLE
    return Evaluation(gains, ConstraintPoints.joined([limits, objective]), violation, cost, stable)


def nominal_violations(task: Task, gains: list[FoPi]) -> Array:
    """The largest violation of each of n controllers with the nominal plant, in one batch, shape (n,).

    In continuous time: of a loop on samples it is an estimate.

    Raises:
        DomainError: for one of them |L| = 1 over a whole range.
    """
    nominal = Plants.members(task.spec.plant, np.repeat(task.spec.plant.nominal_point[None, :], len(gains), axis=0))
    kp, ki, alpha = np.array([(g.kp, g.ki, g.alpha) for g in gains]).T
    loops = Loops(kp, ki, alpha, nominal)
    crossings = gain_crossovers(loops)
    stable = unstable_poles_from(loops, crossings) < 0.5
    evaluator = _Evaluator(task, loops, crossings, sides_of_minus_one(crossings, stable), all_nominal=True)
    limits = ConstraintPoints.joined([part for k, limit in enumerate(task.limits) for part in evaluator.of(k, limit)])
    violation = np.zeros(len(gains))
    np.maximum.at(violation, limits.plant, -limits.slack)
    return violation + np.where(stable, 0.0, _UNSTABLE)


def sides_of_minus_one(crossings: Crossings, stable: NDArray[np.bool_]) -> Array:
    """At each gain crossover the side of -1 on which L belongs: 1 where a lag brings it there, -1 where a lead does.

    That is where a stable loop has it.  Of an unstable loop the crossover nearest to -1 has to come over.

    Args:
        crossings: n gain crossovers.
        stable: shape (m,), whether each loop is.
    """
    side = np.where(crossings.angle_from_minus_one_rad >= 0.0, 1.0, -1.0)
    nearest = _first_of_row(crossings.row, crossings.phase_margin_rad)
    return np.where(nearest & ~stable[crossings.row], -side, side)


@dataclass(frozen=True)
class _Evaluator:
    task: Task
    loops: Loops
    crossings: Crossings
    side: Array
    all_nominal: bool = False

    def of(self, k: int, limit: Limit) -> list[ConstraintPoints]:
        """The worst points of one limit, for each plant."""
        first_alone = limit.nominal and not self.all_nominal
        rows = np.zeros(1, dtype=np.intp) if first_alone else np.arange(len(self.loops))
        if limit.where is EvaluatedAt.BAND:
            return [self._band(k, limit, rows)]
        if limit.where is EvaluatedAt.PHASE_CROSSOVERS:
            return self._gain_margin(k, limit, rows)
        return self._crossing(k, limit, rows)

    def _band(self, k: int, limit: Limit, rows: Rows) -> ConstraintPoints:
        loops, response = self.loops.take(rows), limit.response
        assert response is not None
        if limit.from_rad_s == limit.to_rad_s:
            omega = np.full(len(rows), limit.from_rad_s)
            found = Extremes(log_response_at(loops, response, np.arange(len(rows)), omega), omega)
        else:
            found = extremes(loops, response, limit.from_rad_s, limit.to_rad_s, limit.bound is Bound.UPPER)
        with np.errstate(divide="ignore"):
            return ConstraintPoints.of(k, rows, loops.u_of(found.omega_rad_s), limit.slack(found.value))

    def _crossing(self, k: int, limit: Limit, rows: Rows) -> list[ConstraintPoints]:
        c = self.crossings
        value = crossing_value(limit.quantity, c, self.side)
        mine = np.isin(c.row, rows)
        if limit.where is EvaluatedAt.HIGHEST_GAIN_CROSSOVER:
            mine &= _first_of_row(c.row, -c.u)
        elif limit.bound is not Bound.LOWER:
            mine &= _first_of_row(c.row, value)
        parts = [ConstraintPoints.of(k, c.row[mine], c.u[mine], limit.slack(value[mine]), side=self.side[mine])]
        lacking = np.setdiff1d(rows, c.row)
        if limit.requirement == STABILITY_GUARD or not len(lacking):
            return parts
        if limit.bound is Bound.LOWER and QUANTITIES[limit.quantity].is_margin:
            # without a crossover the margin is infinite; but a delay margin is 0 where |L| stays above 1
            bad = stays_large(self.loops.take(lacking)) if limit.quantity == "delay_margin_s" else lacking < 0
            lacking = lacking[bad]
            if not len(lacking):
                return parts
        top = extremes(self.loops.take(lacking), Response.LOOP_GAIN, 0.0, math.inf)
        bottom = extremes(self.loops.take(lacking), Response.LOOP_GAIN, 0.0, math.inf, largest=False)
        small = top.value < 0.0
        away = np.where(small, -top.value, bottom.value)
        with np.errstate(divide="ignore"):
            u = self.loops.u_of(np.where(small, top.omega_rad_s, bottom.omega_rad_s))
        return [*parts, ConstraintPoints.of(k, lacking, u, -_NO_CROSSOVER - away, missing=True)]

    def _gain_margin(self, k: int, limit: Limit, rows: Rows) -> list[ConstraintPoints]:
        c = phase_crossovers(self.loops.take(rows))
        plant, value = rows[c.row], -np.log(c.gain)
        mine = c.gain <= 1.0
        if limit.bound is not Bound.LOWER:
            ranked = np.where(mine, value, math.inf)
            mine &= _first_of_row(c.row, ranked)
            endless = np.setdiff1d(rows, plant[mine])
            if len(endless):
                nowhere = ConstraintPoints.of(
                    k, endless, np.zeros(len(endless)), np.full(len(endless), -math.inf), missing=True
                )
                return [ConstraintPoints.of(k, plant[mine], c.u[mine], limit.slack(value[mine])), nowhere]
        return [ConstraintPoints.of(k, plant[mine], c.u[mine], limit.slack(value[mine]))]

    def objective(self, limits: ConstraintPoints) -> ConstraintPoints:
        """The worst points of the objective, for each plant; none for ki."""
        kind, rows = self.task.objective, np.arange(len(self.loops))
        if kind is ObjectiveKind.DEPTH:
            counted = [k for k, limit in enumerate(self.task.limits) if counts_in_depth(limit)]
            inside = limits.take(np.flatnonzero(np.isin(limits.limit, counted)))
            if not len(inside):  # the only limits are gain margins, and all are infinite
                return ConstraintPoints.of(OBJECTIVE, rows[:1], np.zeros(1), np.array([math.inf]))
            return ConstraintPoints.of(OBJECTIVE, inside.plant, inside.u, inside.slack)
        if kind in PEAKS:
            found = extremes(self.loops, PEAKS[kind], 0.0, math.inf)
            with np.errstate(divide="ignore"):
                return ConstraintPoints.of(OBJECTIVE, rows, self.loops.u_of(found.omega_rad_s), -found.value)
        if kind is ObjectiveKind.IAE_DISTURBANCE:
            gain, loop, _ = at_inverse_horizon(self.task, self.loops)
            with np.errstate(divide="ignore"):
                return ConstraintPoints.of(OBJECTIVE, rows, np.zeros(len(rows)), np.log(np.abs((1.0 + loop) / gain)))
        if kind is ObjectiveKind.KI:
            return ConstraintPoints.of(OBJECTIVE, rows[:0], np.zeros(0), np.zeros(0))
        return self._spread(kind)

    def _spread(self, kind: ObjectiveKind) -> ConstraintPoints:
        c, rows = self.crossings, np.arange(len(self.loops))
        nominal = np.flatnonzero(c.row == 0)
        if not len(nominal) or len(np.unique(c.row)) < len(rows):
            return ConstraintPoints.of(OBJECTIVE, rows[:1], np.zeros(1), np.array([-math.inf]))
        if kind is ObjectiveKind.CROSSOVER_SPREAD:
            u = np.full(len(rows), c.u[nominal[-1]])
            return ConstraintPoints.of(OBJECTIVE, rows, u, -np.abs(self.loops.log_response(rows, u).real))
        value = crossing_value("phase_margin_deg", c, self.side)
        smallest = _first_of_row(c.row, value)
        apart, side = np.abs(value[smallest] - value[smallest][0]), self.side[smallest]
        return ConstraintPoints.of(OBJECTIVE, c.row[smallest], c.u[smallest], -apart, side=side)


PEAKS = {
    ObjectiveKind.SENSITIVITY_PEAK: Response.SENSITIVITY,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: Response.CONTROL_SENSITIVITY,
    ObjectiveKind.LOAD_SENSITIVITY_PEAK: Response.LOAD_SENSITIVITY,
}


def counts_in_depth(limit: Limit) -> bool:
    """Whether a limit's slack counts in the depth, the smallest slack as the objective."""
    return limit.requirement != STABILITY_GUARD and limit.bound is not Bound.EQUAL


def crossing_value(quantity: str, c: Crossings, side: Array) -> Array:
    """The values of a quantity at gain crossovers, natural units; margins by `sides_of_minus_one`."""
    if quantity == "crossover_rad_s":
        return np.log(c.omega_rad_s)
    if quantity == "phase_slope_deg_per_decade":
        return c.slope_rad * math.log(10.0)
    angle = c.angle_from_minus_one_rad
    if quantity == "delay_margin_s":
        return (angle + math.pi * (1.0 - side)) / c.omega_rad_s
    if quantity == "phase_margin_deg":
        return side * angle
    raise DomainError(f"the convex path does not read {quantity} at a gain crossover")


def at_inverse_horizon(task: Task, loops: Loops) -> tuple[Array, Array, Array]:
    """T P, C P and d(C P)/d(kp, ki), shape (m, 2), at s = 1/T of every loop: iae_disturbance is |T P/(1 + C P)|."""
    alpha = float(loops.alpha[0])
    gain, plant, integral = task.kind.discounted(loops.plants, alpha, task.horizon_s)
    return gain, (loops.kp + loops.ki * integral) * plant, plant[:, None] * np.array([1.0, integral])


def _first_of_row(rows: Rows, key: Array) -> NDArray[np.bool_]:
    """Which entry of every row has the smallest key."""
    chosen = np.zeros(len(rows), dtype=bool)
    order = np.lexsort((key, rows))
    _, first = np.unique(rows[order], return_index=True)
    chosen[order[first]] = True
    return chosen
