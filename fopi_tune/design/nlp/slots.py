"""A task, and the slots of the compiled problem that it puts in play at given gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import STABILITY_GUARD, Bound
from fopi_tune.design.loop_grid import numbers_at
from fopi_tune.design.margin_sides import sides_of
from fopi_tune.design.nlp import ends
from fopi_tune.design.nlp.compile import Problem
from fopi_tune.design.nlp.rows import Block, SlotKind
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

_V_CAP = 40.0
#: how far (in ln omega) a peak may move in one solve
_PEAK_REACH = 0.7
#: rad; from here on a dead time makes ripples that lie close to each other
_FEW_TURNS = 7.0
#: objectives that are the largest value of a response
PEAKS_OF = {
    ObjectiveKind.SENSITIVITY_PEAK: Response.SENSITIVITY,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: Response.CONTROL_SENSITIVITY,
}
#: crossovers with more margin than this are no danger to stability
_SAFE_MARGIN_RAD = 0.5

#: bounds of a slot's rows by name
RowBounds = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Slot:
    """One slot in use.

    Args:
        theta: its plant.
        v: its frequency at first.
        near: its branch of the phase.
        rows: its rows.
        v_low, v_high: how far its frequency may go.
        side: on which side of -1 a gain crossover must stay.
        end: of a limit, its plant as `fopi_tune.design.nlp.ends` wants it.
    """

    theta: tuple[float, ...]
    v: float
    near: float
    rows: RowBounds
    v_low: float = -_V_CAP
    v_high: float = _V_CAP
    side: float = 1.0
    end: tuple[float, ...] = (0.0,) * ends.WIDTH


class Mode(Enum):
    """What a solve is for."""

    OBJECTIVE = "the spec's objective"
    FEASIBILITY = "the smallest sum of what requirements have to give"


@dataclass(frozen=True)
class Point:
    """A cut: a plant and a frequency; 0 and inf are limits.  `constraint` None belongs to the objective."""

    constraint: int | None
    theta: tuple[float, ...]
    omega_rad_s: float

    @property
    def is_limit(self) -> bool:
        """Whether it is at an end of the frequency axis."""
        return not 0.0 < self.omega_rad_s < math.inf


@dataclass(frozen=True)
class MarginPlant:
    """A plant whose gain margin is in play: at the level that is asked for, or at a phase crossover itself."""

    constraint: int
    theta: tuple[float, ...]
    crossing: bool


@dataclass(frozen=True)
class Task:
    """What to solve.

    Args:
        points: fixed (constraint, plant, frequency) cuts of frequency functions and members of the objective.
        peaks: the same, moving with the plant's own peak; the frequency is where it is looked for.
        plants: plants whose gain crossovers are in play; the nominal one first.
        margin_plants: plants of gain margins in play.
        limits: of all constraints, natural units.
        mode: what for.
        active: requirements that count; others are dropped.
        relaxed: requirements that are relaxed in an elastic solve.
        trust_radius: kp and ki may move this many times their own size, alpha a quarter of it: cuts that are not yet in
            play cannot hold them back.
        endless_margins: whether a plant that has no gain crossover may stay without one where all that is asked of it
            is margins that are at least so large.
    """

    points: tuple[Point, ...]
    peaks: tuple[Point, ...]
    plants: tuple[tuple[float, ...], ...]
    margin_plants: tuple[MarginPlant, ...]
    limits: tuple[float, ...]
    mode: Mode
    active: frozenset[int]
    relaxed: frozenset[int] = frozenset()
    trust_radius: float = 4.0
    endless_margins: bool = False


@dataclass(frozen=True)
class SlotsInPlay:
    """The slots that a task needs, started from the crossings of the loops at given gains.

    `integral` is whether ki is anything but 0.
    """

    problem: Problem
    task: Task
    start: FoPi
    integral: bool = True

    def of(self, block: Block) -> list[Slot]:
        """(theta, v, phase_near, bounds of rows) of the block's slots in use."""
        if block.kind is SlotKind.CROSSING:
            return self._crossing_slots()
        if block.kind in (SlotKind.LEVEL, SlotKind.PHASE):
            return self._margin_slots(block)
        constraint = block.constraints[0] if block.constraints else None
        if (constraint is not None and not self._counts(constraint)) or (
            constraint is None and self.task.mode is Mode.FEASIBILITY
        ):
            return []
        log_s = math.log(self.problem.scale.omega_rad_s)
        bound = (0.0, np.inf)
        if constraint is not None and self.problem.constraints[constraint].bound is Bound.EQUAL:
            bound = (0.0, 0.0)
        rows = {name: (0.0, 0.0) if name == "equation" else bound for name in block.rows}
        if block.kind is SlotKind.LIMIT:
            return self._limit_slots(constraint, rows)
        chosen = self.task.peaks if block.kind is SlotKind.PEAK else self.task.points
        mine = [point for point in chosen if point.constraint == constraint and not point.is_limit]
        reaches = peak_reaches(self.problem.family, mine)
        slots = []
        for point, reach in zip(mine, reaches, strict=True):
            v = float(np.clip(math.log(point.omega_rad_s) - log_s, -600.0, 600.0))
            slots.append(Slot(point.theta, v, 0.0, rows, v - reach, v + reach))
        return slots

    def _limit_slots(self, constraint: int | None, rows: RowBounds) -> list[Slot]:
        """A slot for every cut at an end of the frequency axis."""
        problem, slots = self.problem, []
        peak = PEAKS_OF.get(problem.objective)
        points = [point for point in self.task.points if point.constraint == constraint and point.is_limit]
        plants = _plants_of(problem.family, points)
        for row, point in enumerate(points):
            end, scale, asked = point.omega_rad_s, problem.scale, None
            if constraint is not None:
                limited = problem.constraints[constraint]
                asked = ends.asked_of(limited, plants, row, scale, end, self.integral, self.start.kp)
            elif peak is not None:
                asked = ends.end_of(plants, row, scale, end, self.integral, peak, True)
            if asked is not None:
                slots.append(Slot(point.theta, 0.0, 0.0, rows, end=asked.parameters))
        return slots

    def _counts(self, constraint: int) -> bool:
        return self.problem.constraints[constraint].requirement in self.task.active or (
            self.problem.constraints[constraint].requirement == STABILITY_GUARD
        )

    def _crossing_slots(self) -> list[Slot]:
        """A slot for every gain crossover of every plant in play; the nominal plant's smallest margin comes first."""
        family, task = self.problem.family, self.task
        if not task.plants:
            return []
        nominal = tuple(family.nominal_point.tolist())
        plants = Plants.members(family, np.array(task.plants).reshape(len(task.plants), -1))
        loops = Loops.of(self.start, plants)
        crossings = gain_crossovers(loops)
        sides = sides_of(loops, crossings)
        numbers = numbers_at(loops, crossings.row, crossings.u, sides.side, sides.angle_rad)
        log_s = math.log(self.problem.scale.omega_rad_s)
        slots = []
        asked = self._asks_for_crossovers()
        for row, theta in enumerate(task.plants):
            mine = np.flatnonzero(crossings.row == row)
            if not len(mine):
                if (asked and not self._may_be_endless(theta == nominal)) or not sides.stable[row]:
                    slots.append(self._new_crossing(theta, loops.take(np.array([row]))))
                continue
            smallest = mine[np.argmin(numbers.phase_margin_rad[mine])]
            if not asked and numbers.phase_margin_rad[smallest] > _SAFE_MARGIN_RAD:
                continue
            deciding = {
                k: mine[np.argmin(constraint.quantity.natural(numbers)[mine])]
                for k, constraint in enumerate(self.problem.constraints)
                if constraint.where is EvaluatedAt.GAIN_CROSSOVERS
            }
            for i in sorted(mine, key=lambda i: i != smallest):
                omega = float(crossings.omega_rad_s[i])
                near = float(sides.angle_rad[i]) - np.pi + omega * float(plants.dead_time_s[row])
                bounds = self._crossing_bounds(
                    theta == nominal, i == mine[-1], i == smallest, {k for k, d in deciding.items() if d == i}
                )
                slots.append(Slot(theta, math.log(omega) - log_s, near, bounds, side=float(sides.side[i])))
        return slots

    def _new_crossing(self, theta: tuple[float, ...], loop: Loops) -> Slot:
        """A crossover where the spec's own frequency scale is, of a plant that has none to start from."""
        omega = self.problem.scale.omega_rad_s
        phase = float(loop.log_response(np.array([0]), np.array([math.log(omega)]))[0].imag)
        # With |L| > 1 below it, it is on the stable side where the unwrapped phase is within (-180, 180 deg).
        turns = max(math.ceil(phase / (2.0 * np.pi)), 0)
        phase -= 2.0 * np.pi * turns
        side = -1.0 if turns and phase < -np.pi else 1.0
        near = phase + omega * float(loop.plants.dead_time_s[0])
        nominal = theta == tuple(self.problem.family.nominal_point.tolist())
        bounds = self._crossing_bounds(nominal, True, True, set(range(len(self.problem.constraints))))
        return Slot(theta, 0.0, near, bounds, side=side)

    def _asks_for_crossovers(self) -> bool:
        """Whether anything that counts needs a crossover; a guard alone must not force one to exist."""
        kinds = (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)
        asked = any(
            constraint.where in kinds and constraint.requirement in self.task.active
            for constraint in self.problem.constraints
        )
        spread = self.problem.objective in (ObjectiveKind.PHASE_MARGIN_SPREAD, ObjectiveKind.CROSSOVER_SPREAD)
        return asked or self.problem.needs_crossover or (spread and self.task.mode is Mode.OBJECTIVE)

    def _may_be_endless(self, nominal: bool) -> bool:
        """Whether a plant meets all that is asked of its crossovers when it has none."""
        kinds = (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)
        return self.task.endless_margins and all(
            constraint.quantity.is_margin and constraint.bound is Bound.LOWER
            for k, constraint in enumerate(self.problem.constraints)
            if constraint.where in kinds and self._counts(k) and (nominal or not constraint.nominal)
        )

    def _crossing_bounds(self, nominal: bool, highest: bool, smallest: bool, decides_for: set[int]) -> RowBounds:
        """Which rows of a crossing's slot count, and as what.

        Args:
            nominal: whether the plant is the nominal one.
            highest: whether it is the plant's highest crossing.
            smallest: whether the phase margin is smallest there.
            decides_for: constraints whose quantity is smallest there.
        """
        bounds = {"equation": (0.0, 0.0)}
        elastic = self.task.mode is Mode.FEASIBILITY
        if not nominal and not elastic and self.problem.objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
            bounds["spread up"] = (0.0, np.inf)
            bounds["spread down"] = (0.0, np.inf) if smallest else (-np.inf, np.inf)
        for k, constraint in enumerate(self.problem.constraints):
            at_crossing = constraint.where in (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)
            if not at_crossing or not self._counts(k) or (constraint.nominal and not nominal):
                continue
            decides = highest if constraint.where is EvaluatedAt.HIGHEST_GAIN_CROSSOVER else k in decides_for
            if decides:
                bounds[f"constraint {k}"] = (0.0, 0.0) if constraint.bound is Bound.EQUAL else (0.0, np.inf)
            elif constraint.where is EvaluatedAt.GAIN_CROSSOVERS and constraint.bound is Bound.LOWER:
                bounds[f"constraint {k}"] = (0.0, np.inf)
            elif constraint.where is EvaluatedAt.GAIN_CROSSOVERS and constraint.bound is Bound.EQUAL:
                # The smallest equals the limit, so the others lie above: limit - value <= 0.
                bounds[f"constraint {k}"] = (-np.inf, 0.0)
        return bounds

    def _margin_slots(self, block: Block) -> list[Slot]:
        k = block.constraints[0]
        if not self._counts(k):
            return []
        constraint, log_s = self.problem.constraints[k], math.log(self.problem.scale.omega_rad_s)
        slots = []
        for plant in self.task.margin_plants:
            if plant.constraint != k or plant.crossing is not (block.kind is SlotKind.PHASE):
                continue
            theta = plant.theta
            plants = Plants.members(self.problem.family, np.array([theta]).reshape(1, -1))
            loops = Loops.of(self.start, plants)
            found = phase_crossovers(loops)
            small = np.flatnonzero((found.gain <= 1.0) & np.isfinite(found.omega_rad_s))
            if not len(small) and plant.crossing and constraint.bound is Bound.LOWER:
                continue
            turn = 0.0
            v = 0.0
            if len(small):
                worst = small[np.argmax(found.gain[small])]
                turn = float(np.round((found.phase_rad[worst] + np.pi) / (2 * np.pi)))
                v = math.log(found.omega_rad_s[worst]) - log_s
            if block.kind is SlotKind.LEVEL:
                level = gain_crossovers(loops, np.array([-self.task.limits[k]]))
                if len(level.row):
                    nearest = np.argmin(np.abs(np.log(level.omega_rad_s) - log_s - v)) if len(small) else -1
                    v = math.log(level.omega_rad_s[nearest]) - log_s
            omega = self.problem.scale.omega_rad_s * math.exp(v)
            near = float(loops.log_response(np.array([0]), np.array([math.log(omega)]))[0].imag)
            near += omega * float(plants.dead_time_s[0]) - 2 * np.pi * turn
            row = (0.0, 0.0) if constraint.bound is Bound.EQUAL else (0.0, np.inf)
            rows = {"equation": (0.0, 0.0), f"constraint {k}": row}
            ends = _between_neighbours(np.log(found.omega_rad_s) - log_s, v) if plant.crossing else (-_V_CAP, _V_CAP)
            slots.append(Slot(theta, v, near, rows, *ends))
        return slots


def peak_reaches(family: PlantFamily, peaks: Sequence[Point]) -> Array:
    """How far in ln omega each peak may move in one solve: with a dead time not to the next ripple."""
    turn = _plants_of(family, peaks).dead_time_s * np.array([peak.omega_rad_s for peak in peaks])
    return np.where(turn <= _FEW_TURNS, _PEAK_REACH, np.minimum(_PEAK_REACH, np.pi / np.maximum(turn, 1.0)))


def _plants_of(family: PlantFamily, points: Sequence[Point]) -> Plants:
    return Plants.members(family, np.array([point.theta for point in points]).reshape(len(points), len(family.low)))


def _between_neighbours(crossings: Array, v: float) -> tuple[float, float]:
    """Half-way to the crossings on either side: a slot must not slip to one where less is asked."""
    below, above = crossings[crossings < v - 1e-9], crossings[crossings > v + 1e-9]
    low = 0.5 * (v + float(below.max())) if len(below) else -_V_CAP
    high = 0.5 * (v + float(above.min())) if len(above) and np.isfinite(above.min()) else _V_CAP
    return low, high
