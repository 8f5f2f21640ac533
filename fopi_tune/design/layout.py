"""One task as the vectors of the compiled problem:  start, bounds and parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import gain_crossovers, phase_crossovers
from fopi_tune.design.compile import ALPHA, DEPTH, FIRST_GIVE, KI, KP, WORST, Block, Problem, SlotKind, pack_parameters
from fopi_tune.design.sides import GUARD, Bound
from fopi_tune.quantities.base import Where
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import ControllerSpec

#: a gain the spec leaves open is searched this far, in the plant's own scale
OPEN_GAIN = 1e4
_V_CAP = 40.0
#: how far (in ln omega) a peak may move in one solve
_PEAK_REACH = 0.7
#: crossovers with more margin than this are no danger to stability
_SAFE_MARGIN_RAD = 0.5
#: a smallest slack of so many neper or radian is no limit at all
_DEPTH_CAP = 15.0
#: no objective's natural value lies outside: e^100 is beyond any gain
_WORST_CAP = 100.0

#: bounds of a slot's rows by name
RowBounds = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Slot:
    """One slot in use: its plant, its frequency (at first, and how far it may go), its sheet of the phase, its rows."""

    theta: tuple[float, ...]
    v: float
    near: float
    rows: RowBounds
    v_low: float = -_V_CAP
    v_high: float = _V_CAP


class Mode(Enum):
    """What a solve is for."""

    OBJECTIVE = "the spec's objective"
    FEASIBILITY = "the smallest sum of what requirements have to give"


@dataclass(frozen=True)
class Point:
    """A point of play: a plant, and for frequency functions a frequency.  `side` None belongs to the objective."""

    side: int | None
    theta: tuple[float, ...]
    omega_rad_s: float


@dataclass(frozen=True)
class MarginPlant:
    """A plant whose gain margin is in play: at the level that is asked for, or at a phase crossover itself."""

    side: int
    theta: tuple[float, ...]
    crossing: bool


@dataclass(frozen=True)
class Task:
    """What to solve.

    Args:
        points: fixed (side, plant, frequency) cuts of frequency functions and members of the objective.
        peaks: the same, moving with the plant's own peak; the frequency is where it is looked for.
        plants: plants whose gain crossovers are in play; the nominal one first.
        margin_plants: plants of gain margins in play.
        limits: of all sides, natural units.
        mode: what for.
        active: requirements that count; others are dropped.
        giving: requirements that may give in an elastic solve.
        trust: kp and ki may move this many times their own size, alpha a quarter of it: cuts that are not yet in
        play cannot
            hold them back.
    """

    points: tuple[Point, ...]
    peaks: tuple[Point, ...]
    plants: tuple[tuple[float, ...], ...]
    margin_plants: tuple[MarginPlant, ...]
    limits: tuple[float, ...]
    mode: Mode
    active: frozenset[int]
    giving: frozenset[int] = frozenset()
    trust: float = 4.0


class TooManySlotsError(Exception):
    """A block of the compiled problem is too small for the task; it is compiled again, larger."""


class Layout:
    """The vectors of one solve."""

    def __init__(self, problem: Problem, box: ControllerSpec, start: FoPi, task: Task) -> None:
        self.problem, self.box, self.start, self.task = problem, box, start, task
        self.x0 = np.zeros(problem.n_variables)
        self.lbx = np.zeros(problem.n_variables)
        self.ubx = np.zeros(problem.n_variables)
        self.lbg = np.full(problem.n_rows, -np.inf)
        self.ubg = np.full(problem.n_rows, np.inf)
        self.p = np.zeros(problem.n_parameters)
        self.width = len(problem.family.uncertain_names) + 1

    def fill(self, worst: float) -> None:
        """All vectors, from the task."""
        self._gains()
        self._head(worst)
        nominal = tuple(self.problem.family.nominal_point.tolist())
        for b, block in enumerate(self.problem.blocks):
            for slot in range(block.capacity):
                self._place(b, slot, nominal, 0.0, 0.0)
            slots = self._slots(block)
            if len(slots) > block.capacity:
                raise TooManySlotsError
            for i, slot in enumerate(slots):
                self._place(b, i, slot.theta, slot.v, slot.near)
                self._open(b, block, i, slot)

    def _gains(self) -> None:
        scale, box = self.problem.scale, self.box
        self.x0[:3] = scale.scaled(self.start)
        for i, gain, factor in ((KP, box.kp, scale.gain), (ALPHA, box.alpha, 1.0)):
            self.lbx[i] = max(gain.min * factor, -OPEN_GAIN)
            self.ubx[i] = min(gain.max * factor, OPEN_GAIN)
        # ki' = ki g_s omega_s^-alpha: its bounds move with alpha, so those that bind are a row's.
        ki = box.ki
        orders = (box.alpha.min, box.alpha.max)
        factors = [scale.gain * scale.omega_rad_s**-a for a in orders]
        self.lbx[KI] = max(min(ki.min * f for f in factors), -OPEN_GAIN)
        self.ubx[KI] = min(max(ki.max * f for f in factors), OPEN_GAIN)
        self.ki_scale = max(abs(self.start.ki), 1e-9 * scale.omega_rad_s**self.start.alpha / scale.gain)
        if not box.alpha.is_fixed:
            self.lbg[0], self.ubg[0] = ki.min / self.ki_scale, ki.max / self.ki_scale
        self.x0[:3] = np.clip(self.x0[:3], self.lbx[:3], self.ubx[:3])
        self.box_low, self.box_high = self.lbx[:3].copy(), self.ubx[:3].copy()
        size = np.abs(self.x0[:2])
        reach = np.append(size + 0.25 * max(float(size.max()), 0.1), 0.25) * self.task.trust
        self.lbx[:3] = np.maximum(self.lbx[:3], self.x0[:3] - reach)
        self.ubx[:3] = np.minimum(self.ubx[:3], self.x0[:3] + reach)

    def on_trust_bound(self, x: Array) -> bool:
        """Whether a gain stopped where this solve, not the box, ended."""
        room = 1e-4 * (self.ubx[:3] - self.lbx[:3])
        low = (x[:3] < self.lbx[:3] + room) & (self.lbx[:3] > self.box_low)
        high = (x[:3] > self.ubx[:3] - room) & (self.ubx[:3] < self.box_high)
        return bool((low | high).any())

    def _head(self, worst: float) -> None:
        problem, task = self.problem, self.task
        elastic = task.mode is Mode.FEASIBILITY
        objective = problem.objective
        named = objective not in (ObjectiveKind.KI, ObjectiveKind.DEPTH) and not elastic
        spread = objective in (ObjectiveKind.PHASE_MARGIN_SPREAD, ObjectiveKind.CROSSOVER_SPREAD)
        self.lbx[WORST] = -_WORST_CAP if named and not spread else 0.0
        self.ubx[WORST] = _WORST_CAP if named else 0.0
        integral = not (self.box.ki.is_fixed and self.box.ki.min == 0.0)
        if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK and named and integral:
            # |C S| tends to 1/|P(0)| under integral action, at frequencies that no cut reaches.
            self.lbx[WORST] = max(self.lbx[WORST], problem.control_floor)
        self.x0[WORST] = worst if named else 0.0
        deep = objective is ObjectiveKind.DEPTH and not elastic
        self.lbx[DEPTH], self.ubx[DEPTH] = (-1.0, _DEPTH_CAP) if deep else (0.0, 0.0)
        for k, side in enumerate(problem.sides):
            if elastic and side.requirement in task.giving:
                self.ubx[FIRST_GIVE + 2 * k] = np.inf
                self.ubx[FIRST_GIVE + 2 * k + 1] = np.inf if side.bound is Bound.EQUAL else 0.0
                self.x0[FIRST_GIVE + 2 * k] = 0.1
        weights = {
            "worst": 1.0 if named else 0.0,
            "ki": 1.0 if objective is ObjectiveKind.KI and not elastic else 0.0,
            "depth": 1.0 if deep else 0.0,
            "give": 1.0 if elastic else 0.0,
            "ki_scale": self.ki_scale,
        }
        head = pack_parameters(np.array(task.limits), weights)
        self.p[: len(head)] = head

    def _place(self, b: int, slot: int, theta: tuple[float, ...], v: float, near: float) -> None:
        block = self.problem.blocks[b]
        width = self.width + (0 if block.has_frequency else 1)
        first = self.problem.first_parameter[b] + slot * width
        self.p[first : first + self.width] = (*theta, near)
        if block.has_frequency:
            i = self.problem.first_frequency[b] + slot
            self.x0[i] = self.lbx[i] = self.ubx[i] = v
        else:
            self.p[first + self.width] = v

    def _open(self, b: int, block: Block, place: int, slot: Slot) -> None:
        if block.has_frequency:
            i = self.problem.first_frequency[b] + place
            self.lbx[i], self.ubx[i] = min(slot.v, slot.v_low), max(slot.v, slot.v_high)
        first = self.problem.first_row[b] + place * len(block.rows)
        for j, name in enumerate(block.rows):
            if name in slot.rows:
                self.lbg[first + j], self.ubg[first + j] = slot.rows[name]

    def _slots(self, block: Block) -> list[Slot]:
        """(theta, v, phase_near, bounds of rows) of the block's slots in use."""
        if block.kind is SlotKind.CROSSING:
            return self._crossing_slots()
        if block.kind in (SlotKind.LEVEL, SlotKind.PHASE):
            return self._margin_slots(block)
        side = block.sides[0] if block.sides else None
        if (side is not None and not self._counts(side)) or (side is None and self.task.mode is Mode.FEASIBILITY):
            return []
        log_s = math.log(self.problem.scale.omega_rad_s)
        bound = (0.0, np.inf)
        if side is not None and self.problem.sides[side].bound is Bound.EQUAL:
            bound = (0.0, 0.0)
        rows = {name: (0.0, 0.0) if name == "equation" else bound for name in block.rows}
        chosen = self.task.peaks if block.kind is SlotKind.PEAK else self.task.points
        slots = []
        for point in chosen:
            if point.side == side:
                v = float(np.clip(math.log(point.omega_rad_s) - log_s, -600.0, 600.0))
                slots.append(Slot(point.theta, v, 0.0, rows, v - _PEAK_REACH, v + _PEAK_REACH))
        return slots

    def _counts(self, side: int) -> bool:
        return self.problem.sides[side].requirement in self.task.active or (
            self.problem.sides[side].requirement == GUARD
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
        log_s = math.log(self.problem.scale.omega_rad_s)
        slots = []
        asked = self._asks_for_crossovers()
        for row, theta in enumerate(task.plants):
            mine = np.flatnonzero(crossings.row == row)
            if not len(mine) and not asked:
                continue
            if not len(mine):
                # No crossover to start from: ask for one where the spec's own frequency scale is.
                near = float(loops.log_response(np.array([row]), np.array([log_s]))[0].imag)
                near += self.problem.scale.omega_rad_s * float(plants.dead_time_s[row])
                slots.append(Slot(theta, 0.0, near, self._crossing_bounds(theta == nominal, True, True)))
                continue
            smallest = mine[np.argmin(crossings.phase_rad[mine])]
            if not asked and crossings.phase_rad[smallest] + np.pi > _SAFE_MARGIN_RAD:
                continue
            for i in sorted(mine, key=lambda i: i != smallest):
                omega = float(crossings.omega_rad_s[i])
                near = float(crossings.phase_rad[i]) + omega * float(plants.dead_time_s[row])
                bounds = self._crossing_bounds(theta == nominal, i == mine[-1], i == smallest)
                slots.append(Slot(theta, math.log(omega) - log_s, near, bounds))
        return slots

    def _asks_for_crossovers(self) -> bool:
        """Whether anything that counts needs a crossover; a guard alone must not force one to exist."""
        kinds = (Where.GAIN_CROSSOVERS, Where.HIGHEST_GAIN_CROSSOVER)
        asked = any(side.where in kinds and side.requirement in self.task.active for side in self.problem.sides)
        spread = self.problem.objective in (ObjectiveKind.PHASE_MARGIN_SPREAD, ObjectiveKind.CROSSOVER_SPREAD)
        return asked or self.problem.needs_crossover or (spread and self.task.mode is Mode.OBJECTIVE)

    def _crossing_bounds(self, nominal: bool, highest: bool, smallest: bool) -> RowBounds:
        """Which rows of a crossing's slot count, and as what."""
        bounds = {"equation": (0.0, 0.0)}
        elastic = self.task.mode is Mode.FEASIBILITY
        if not nominal and not elastic and self.problem.objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
            bounds["spread up"] = (0.0, np.inf)
            bounds["spread down"] = (0.0, np.inf) if smallest else (-np.inf, np.inf)
        for k, side in enumerate(self.problem.sides):
            at_crossing = side.where in (Where.GAIN_CROSSOVERS, Where.HIGHEST_GAIN_CROSSOVER)
            if not at_crossing or not self._counts(k) or (side.nominal and not nominal):
                continue
            decides = highest if side.where is Where.HIGHEST_GAIN_CROSSOVER else smallest
            if decides:
                bounds[f"side {k}"] = (0.0, 0.0) if side.bound is Bound.EQUAL else (0.0, np.inf)
            elif side.where is Where.GAIN_CROSSOVERS and side.bound is Bound.LOWER:
                bounds[f"side {k}"] = (0.0, np.inf)
            elif side.where is Where.GAIN_CROSSOVERS and side.bound is Bound.EQUAL:
                # The smallest equals the limit, so the others lie above: limit - value <= 0.
                bounds[f"side {k}"] = (-np.inf, 0.0)
        return bounds

    def _margin_slots(self, block: Block) -> list[Slot]:
        k = block.sides[0]
        if not self._counts(k):
            return []
        side, log_s = self.problem.sides[k], math.log(self.problem.scale.omega_rad_s)
        slots = []
        for plant in self.task.margin_plants:
            if plant.side != k or plant.crossing is not (block.kind is SlotKind.PHASE):
                continue
            theta = plant.theta
            plants = Plants.members(self.problem.family, np.array([theta]).reshape(1, -1))
            loops = Loops.of(self.start, plants)
            found = phase_crossovers(loops)
            small = np.flatnonzero((found.gain <= 1.0) & np.isfinite(found.omega_rad_s))
            if not len(small) and plant.crossing and side.bound is Bound.LOWER:
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
            row = (0.0, 0.0) if side.bound is Bound.EQUAL else (0.0, np.inf)
            rows = {"equation": (0.0, 0.0), f"side {k}": row}
            ends = _between_neighbours(np.log(found.omega_rad_s) - log_s, v) if plant.crossing else (-_V_CAP, _V_CAP)
            slots.append(Slot(theta, v, near, rows, *ends))
        return slots

    def open_gains_at_bound(self, x: Array) -> tuple[str, ...]:
        """What the solver pushed to the end of what is searched: gains left open by the spec, or the slack itself."""
        scale, names = self.problem.scale, []
        reach = 0.5 * OPEN_GAIN
        if (x[KP] > reach and self.box.kp.max * scale.gain > OPEN_GAIN) or (
            x[KP] < -reach and self.box.kp.min * scale.gain < -OPEN_GAIN
        ):
            names.append("kp")
        if (x[KI] > reach and self.box.ki.max == math.inf) or (x[KI] < -reach and self.box.ki.min == -math.inf):
            names.append("ki")
        if x[DEPTH] > 0.999 * _DEPTH_CAP:
            names.append("the smallest slack")
        return tuple(names)


def _between_neighbours(crossings: Array, v: float) -> tuple[float, float]:
    """Half-way to the crossings on either side: a slot must not slip to one where less is asked."""
    below, above = crossings[crossings < v - 1e-9], crossings[crossings > v + 1e-9]
    low = 0.5 * (v + float(below.max())) if len(below) else -_V_CAP
    high = 0.5 * (v + float(above.min())) if len(above) and np.isfinite(above.min()) else _V_CAP
    return low, high
