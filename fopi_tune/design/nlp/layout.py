"""One task as the vectors of the compiled problem:  start, bounds and parameters."""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.constraints import Bound
from fopi_tune.design.nlp.compile import Problem, pack_parameters
from fopi_tune.design.nlp.ends import WIDTH
from fopi_tune.design.nlp.rows import ALPHA, DEPTH, FIRST_RELAXATION, KI, KP, WORST, Block, SlotKind
from fopi_tune.design.nlp.slots import Mode, Slot, SlotsInPlay, Task
from fopi_tune.design.starts import has_no_integral
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import ControllerSpec

#: a gain the spec leaves open is searched this far, in the plant's own scale
OPEN_GAIN = 1e4
#: neper or radian; a smallest slack of this size counts as unbounded
_DEPTH_CAP = 15.0
#: no objective's natural value lies outside: e^100 is beyond any gain
_WORST_CAP = 100.0


class TooManySlotsError(Exception):
    """A block of the compiled problem has too few slots for the task; compile it again with more."""


class Layout:
    """Start, bounds and parameters of one solve."""

    def __init__(self, problem: Problem, box: ControllerSpec, start: FoPi, task: Task) -> None:
        self.problem, self.box, self.start, self.task = problem, box, start, task
        self.x0 = np.zeros(problem.n_variables)
        self.lbx = np.zeros(problem.n_variables)
        self.ubx = np.zeros(problem.n_variables)
        self.lbg = np.full(problem.n_rows, -np.inf)
        self.ubg = np.full(problem.n_rows, np.inf)
        self.p = np.zeros(problem.n_parameters)
        self.width = len(problem.family.uncertain_names) + 2

    def fill(self, worst: float) -> None:
        """All vectors, from the task."""
        self._gains()
        self._head(worst)
        nominal = tuple(self.problem.family.nominal_point.tolist())
        in_play = SlotsInPlay(self.problem, self.task, self.start, not has_no_integral(self.box))
        for b, block in enumerate(self.problem.blocks):
            for slot in range(block.capacity):
                self._place(b, slot, Slot(nominal, 0.0, 0.0, {}))
            slots = in_play.of(block)
            if len(slots) > block.capacity:
                raise TooManySlotsError
            for i, slot in enumerate(slots):
                self._place(b, i, slot)
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
        reach = np.append(size + 0.25 * max(float(size.max()), 0.1), 0.25) * self.task.trust_radius
        self.lbx[:3] = np.maximum(self.lbx[:3], self.x0[:3] - reach)
        self.ubx[:3] = np.minimum(self.ubx[:3], self.x0[:3] + reach)

    def on_trust_boundary(self, x: Array) -> bool:
        """Whether a gain lies on the boundary of the trust region (not of its own range)."""
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
        if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK and named and not has_no_integral(self.box):
            # With integral action |C S| tends to 1/|P(0)| as omega -> 0, below all cuts.
            self.lbx[WORST] = max(self.lbx[WORST], problem.control_floor)
        self.x0[WORST] = worst if named else 0.0
        deep = objective is ObjectiveKind.DEPTH and not elastic
        self.lbx[DEPTH], self.ubx[DEPTH] = (-1.0, _DEPTH_CAP) if deep else (0.0, 0.0)
        for k, constraint in enumerate(problem.constraints):
            if elastic and constraint.requirement in task.relaxed:
                self.ubx[FIRST_RELAXATION + 2 * k] = np.inf
                self.ubx[FIRST_RELAXATION + 2 * k + 1] = np.inf if constraint.bound is Bound.EQUAL else 0.0
                self.x0[FIRST_RELAXATION + 2 * k] = 0.1
        weights = {
            "worst": 1.0 if named else 0.0,
            "ki": 1.0 if objective is ObjectiveKind.KI and not elastic else 0.0,
            "depth": 1.0 if deep else 0.0,
            "relaxation": 1.0 if elastic else 0.0,
            "ki_scale": self.ki_scale,
        }
        head = pack_parameters(np.array(task.limits), weights)
        self.p[: len(head)] = head

    def _place(self, b: int, place: int, slot: Slot) -> None:
        block = self.problem.blocks[b]
        if block.kind is SlotKind.LIMIT:
            first = self.problem.first_parameter[b] + place * WIDTH
            self.p[first : first + WIDTH] = slot.end
            return
        width = self.width + (0 if block.has_frequency else 1)
        first = self.problem.first_parameter[b] + place * width
        self.p[first : first + self.width] = (*slot.theta, slot.near, slot.side)
        if block.has_frequency:
            i = self.problem.first_frequency[b] + place
            self.x0[i] = self.lbx[i] = self.ubx[i] = slot.v
        else:
            self.p[first + self.width] = slot.v

    def _open(self, b: int, block: Block, place: int, slot: Slot) -> None:
        if block.has_frequency:
            i = self.problem.first_frequency[b] + place
            self.lbx[i], self.ubx[i] = min(slot.v, slot.v_low), max(slot.v, slot.v_high)
        first = self.problem.first_row[b] + place * len(block.rows)
        for j, name in enumerate(block.rows):
            if name in slot.rows:
                self.lbg[first + j], self.ubg[first + j] = slot.rows[name]

    def open_gains_at_bound(self, x: Array) -> tuple[str, ...]:
        """Names of what reached the end of the search range: gains that the spec leaves open, or the smallest slack."""
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
