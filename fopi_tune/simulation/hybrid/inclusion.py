"""Simulation of the hybrid car in continuous time, with events located to 1e-9 s.

Flow in mode 1 (throttle) while y < r + eps, in mode 2 (brake) while y > r - eps; jump to mode 3 - i, y kept,

    in mode 1 on y >= r + eps,   in mode 2 on y <= r - eps.                                                          (1)

or on other lines.  The paper writes = in (1), with < and > in the flow sets: then after a step
of the reference the car may be able neither to flow nor to jump, and with eps = 0 it can never flow away from y = r.
Here

  - beyond its line a mode is left at once;
  - touching the line causes a jump, for the flow sets are open;
  - just after a jump, after a corner and at the start, a car on its line flows on if y - r goes inwards (by its first
    derivative that is not 0) or rests there, and jumps otherwise;
  - for `min_dwell_s` after a jump the car flows on whatever its line says, and what is beyond its line then jumps.

States of the inactive controller: `Memory`.  Between events the loop is linear and its state exact to rounding
(`flow`); `events` shows that no event is missed.  A crossing is located to the rounding of y - r over its rate; where
y touches the line within rounding, to the square root of that.

Where both modes head for the line y = r, (1) has no further solution: it jumps for ever at one instant, and only a
sliding motion along the line, in neither mode, would continue.  Too many jumps within a window (`Watch`) end the run as
CHATTERING.

Source: the paper's flow and jump sets; hybrid inclusions in Goebel, Sanfelice and Teel, Hybrid Dynamical
Systems, 2012.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError
from fopi_tune.simulation.hybrid.events import Guard, GuardStatus
from fopi_tune.simulation.hybrid.flow import FINEST, Flow, LoopDerivatives, ModeLoop, Node, Regime, interpolate
from fopi_tune.simulation.hybrid.model import (
    Corner,
    Event,
    HybridCar,
    HybridOutcome,
    HybridResponse,
    HybridStart,
    Mode,
    Watch,
    checked_reference,
    checked_samples,
)

#: y - r and u count as 0 below this share of the largest signals
_ROUNDING = 2.0**-46
_MOST_STEPS = 1e6
#: numbers after the memory in w: r, slope, 1
_TAIL = 3


def simulate_hybrid(
    car: HybridCar, reference: Sequence[Corner], end_s: float, times_s: Sequence[float] | Array, *,
    start: HybridStart | None = None, watch: Watch | None = None,
) -> HybridResponse:  # fmt: skip
    """Run the car from 0 to `end_s`.

    Args:
        car: both modes' loops, eps, and the behaviour of an inactive controller's states.
        reference: corners, the first at 0.
        end_s: the end, s.
        times_s: sample times, increasing, within [0, end_s].
        start: y, mode and control at 0; None: at rest in mode 1.
        watch: when to give up; None: 20 jumps within 0.2 s, the paper's sampling period.

    Returns:
        The jumps, the samples up to where the run ended, and how it ended.

    Raises:
        DomainError: an invalid reference, end, sample times or start, modes that need equal steps, or a horizon of more
            than a million of the car's longest steps.
    """
    if car.lines.coasts or car.hold_below or car.fed:
        raise DomainError("modes that coast, stand still or are fed forward are simulated in equal steps")
    corners = checked_reference(reference, end_s)
    times = checked_samples(times_s, end_s)
    simulation = _Simulation(car, corners, end_s, start or HybridStart(), watch or Watch())
    simulation.run(corners, end_s)
    times = times[times <= simulation.time]
    return HybridResponse(
        times,
        *interpolate(simulation.nodes, times),
        tuple(simulation.events),
        simulation.outcome,
        simulation.reason,
        simulation.time,
    )


class _Simulation:
    """One pass through time: the state that changes on the way."""

    def __init__(
        self, car: HybridCar, corners: Sequence[Corner], end_s: float, start: HybridStart, watch: Watch
    ) -> None:
        self.car, self.watch, self.mode, self.time = car, watch, start.mode, 0.0
        loops = {mode: car.loop(mode) for mode in Mode}
        self.flows = {(m, regime): Flow(loops[m], regime) for m in Mode for regime in loops[m].regimes()}
        shortest = min(flow.longest_s for flow in self.flows.values())
        if end_s > _MOST_STEPS * shortest:
            raise DomainError(f"end_s = {end_s!r} s is more than {_MOST_STEPS:g} steps of {shortest:g} s; end earlier")
        #: each controller's states; the active one's are stored when it becomes inactive
        self.memory = {mode: np.zeros(len(car.loop(mode).poles)) for mode in Mode}
        self.w = np.concatenate([[start.output], self.memory[start.mode], [corners[0].value, 0.0, 1.0]])
        self._start_control(start)
        ends = [*(corner.time_s for corner in corners[1:]), end_s]
        levels = [abs(c.value) + abs(c.slope_per_s * (end - c.time_s)) for c, end in zip(corners, ends, strict=True)]
        self.lines = {mode: car.line(mode) for mode in Mode}
        reach = max(abs(line.value) for line in self.lines.values())
        scale = abs(start.output) + reach + max(levels)
        if start.control is not None:
            scale += abs(start.control * self.loop.gain) * shortest
        self.rounding = _ROUNDING * scale
        self.regime, self.on_line, self.switched_at = Regime.WITHIN, False, -1.0
        self.level = FINEST // 2
        #: when the minimum dwell of the active mode ends
        self.free_at = 0.0
        self.events: list[Event] = []
        #: speed at which each mode crossed its line when it was left
        self.exit_rates: list[float] = []
        self.outcome, self.reason = HybridOutcome.FINISHED, f"ran to the end at {end_s:g} s"
        self.nodes: list[Node] = []

    @property
    def loop(self) -> ModeLoop:
        return self.car.loop(self.mode)

    @property
    def flow(self) -> Flow:
        return self.flows[self.mode, self.regime]

    def _start_control(self, start: HybridStart) -> None:
        if start.control is None:
            return
        if not len(self.memory[start.mode]):
            raise DomainError("start: control needs an integral in the starting mode's controller; leave it None")
        error = float(self.w[-_TAIL] - self.w[0])
        self.w[1:-_TAIL] = self.loop.memory_for(start.control, error, self.w[1:-_TAIL])

    def run(self, corners: Sequence[Corner], end_s: float) -> None:
        """Corner by corner."""
        ends = [*(corner.time_s for corner in corners[1:]), end_s]
        for corner, until in zip(corners, ends, strict=True):
            if corner.time_s >= end_s:
                break
            self.w[-_TAIL], self.w[-_TAIL + 1] = corner.value, corner.slope_per_s
            self._choose_regime()
            self._settle()
            while self.time < min(until, end_s) and self.outcome is HybridOutcome.FINISHED:
                self._advance(min(until, end_s))
            if self.outcome is not HybridOutcome.FINISHED:
                return
        self._record()

    def _advance(self, until: float) -> None:
        """One step at most to `until`, or to the first event on the way."""
        if not abs(self.w[0]) <= self.watch.most_output:
            return self._stop(HybridOutcome.DIVERGED, f"the output goes beyond {self.watch.most_output:g}")
        self._record()
        if self.time < self.free_at:
            until = min(until, self.free_at)
        left, derivatives = until - self.time, self.flow.derivatives(self.w)
        guards = self._guards(derivatives, left)
        if self._correct_overshoot(guards):
            return None
        level = self.level
        while level < FINEST and self.flow.steps_s[level] > left:
            level += 1
        while True:
            end = self.w + self.flow.exponential_less_one[level] @ self.w
            verdicts = self._verdicts(guards, self.flow.derivative_changes(derivatives, level), level, end)
            if level == FINEST or GuardStatus.UNDECIDED not in verdicts:
                break
            level += 1
        self.level = max(level - 1, 0)
        if verdicts[0] is GuardStatus.UNDECIDED:
            return self._jump_and_settle()
        # the flow is the same on both sides of a limit: crossing it again at once can only be rounding
        seen = 1 if self.switched_at == self.time else len(verdicts)
        crossed = [i for i, verdict in enumerate(verdicts[:seen]) if verdict is GuardStatus.CROSSED]
        if crossed:
            return self._locate_crossing(level, crossed)
        step = self.flow.steps_s[level]
        self.w, self.time = end, until if step >= left else self.time + step
        return None

    def _verdicts(
        self, guards: Sequence[Guard], derivative_changes: tuple[float, float], level: int, end: Array
    ) -> list[GuardStatus]:
        """The status of the mode's guard and of the limits', over the step of this level."""
        step = self.flow.steps_s[level]
        return [guard.check(step, derivative_changes[min(i, 1)], self._value(i, end)) for i, guard in enumerate(guards)]

    def _guards(self, derivatives: LoopDerivatives, left: float) -> list[Guard]:
        """The mode's guard, and those of the limits that bound the regime; `left` is the time to the next corner."""
        guard, longest = self._mode_guard(derivatives), self.flow.longest_s
        near = abs(guard.value) <= self.rounding
        # a car that has just jumped need not leave its line before the next corner
        time = min(left, longest) if self.on_line else longest
        rests = near and guard.rests_for(time, self.flow.derivative_changes(derivatives, 0)[0])
        guards = [replace(guard, on_line=near and self.on_line, at_rest=rests)]
        u, slope, curvature = derivatives.demand
        for sign, limit in self.loop.bounds(self.regime):
            rounding = self._control_rounding(limit)
            value = sign * (u - limit)
            guards.append(Guard(value, sign * slope, sign * curvature, rounding, abs(value) <= rounding))
        return guards

    def _value(self, i: int, w: Array) -> float:
        """The value of guard i."""
        if i == 0:
            line, side = self.lines[self.mode], self.mode.outwards
            offset = float(w[0]) if line.is_absolute else float(w[0] - w[-_TAIL])
            return side * offset - side * line.value
        sign, limit = self.loop.bounds(self.regime)[i - 1]
        return sign * (self.loop.demand(float(w[-_TAIL] - w[0]), w[1:-_TAIL]) - limit)

    def _control_rounding(self, limit: float) -> float:
        return _ROUNDING * abs(limit) + abs(self.loop.gains.kp) * self.rounding

    def _correct_overshoot(self, guards: Sequence[Guard]) -> bool:
        """Whether rounding left the car beyond a line; if so, jump or choose the regime again."""
        if guards[0].value > self.rounding or (guards[0].value >= 0.0 and not self.on_line and not guards[0].at_rest):
            self._jump_and_settle()
            return True
        self.on_line = self.on_line and guards[0].value >= -self.rounding
        if any(guard.value > guard.rounding for guard in guards[1:]):
            self._choose_regime()
        return False

    def _locate_crossing(self, level: int, crossed: list[int]) -> None:
        """Go to the first of these crossings: bisection of the step, then one Newton step."""
        flow = self.flow
        for finer in range(level + 1, FINEST + 1):
            middle = self.w + flow.exponential_less_one[finer] @ self.w
            if all(self._value(i, middle) < 0.0 for i in crossed):
                self.w, self.time = middle, self.time + flow.steps_s[finer]
        derivatives = flow.derivatives(self.w)
        guards = self._guards(derivatives, 0.0)
        left = [-guards[i].value / guards[i].slope if guards[i].slope > 0.0 else 0.0 for i in crossed]
        left = [min(max(rest, 0.0), flow.steps_s[FINEST]) for rest in left]
        rest = min(left)
        self.w, self.time = self.w + rest * (flow.matrix @ self.w), self.time + rest
        if crossed[left.index(rest)] == 0:
            self._jump_and_settle()
        else:
            self.switched_at = self.time
            self._choose_regime()

    def _choose_regime(self) -> None:
        """By u, and on a limit by where u goes: the flow is the same on both sides there."""
        derivatives = self.flows[self.mode, Regime.WITHIN].derivatives(self.w)
        u, slope, curvature = derivatives.demand
        longest = self.flows[self.mode, Regime.WITHIN].longest_s
        self.regime = Regime.WITHIN
        for sign, limit, regime in ((1, self.loop.limits[1], Regime.HIGH), (-1, self.loop.limits[0], Regime.LOW)):
            if math.isfinite(limit):
                rounding = self._control_rounding(limit)
                if Guard(sign * (u - limit), sign * slope, sign * curvature, rounding).is_leaving(longest):
                    self.regime = regime

    def _mode_guard(self, derivatives: LoopDerivatives) -> Guard:
        if self.time < self.free_at:
            return Guard(-math.inf, 0.0, 0.0, self.rounding)
        side, (y, slope, curvature) = self.mode.outwards, derivatives.offset
        line = self.lines[self.mode]
        if line.is_absolute:
            y, slope = float(self.w[0]), slope + float(self.w[-_TAIL + 1])
        return Guard(side * y - side * line.value, side * slope, side * curvature, self.rounding)

    def _settle(self) -> None:
        """Jump as long as the mode is left at once."""
        while self.outcome is HybridOutcome.FINISHED:
            guard = self._mode_guard(self.flow.derivatives(self.w))
            self.on_line = abs(guard.value) <= self.rounding
            if not guard.is_leaving(self.flow.longest_s):
                # the longest step first: a short one would not tell that the line is left
                self.level = 0
                return
            self._jump()

    def _jump_and_settle(self) -> None:
        self._jump()
        self._settle()

    def _jump(self) -> None:
        """One jump by (1), with the controllers' states."""
        self._record()
        y, r = float(self.w[0]), float(self.w[-_TAIL])
        control = self.loop.saturate(self.loop.demand(r - y, self.w[1:-_TAIL]))
        self.memory[self.mode] = self.w[1:-_TAIL].copy()
        self.exit_rates.append(self._mode_guard(self.flow.derivatives(self.w)).slope)
        self.events.append(Event(self.time, self.mode, self.mode.other, y, r))
        self.mode, self.free_at = self.mode.other, self.time + self.car.min_dwell_s
        memory = self.memory[self.mode]
        if self.car.memory is Memory.RESET:
            memory = np.zeros_like(memory)
        elif self.car.memory is Memory.TRACKING and len(memory):
            memory = self.loop.memory_for(self.loop.saturate(control), r - y, memory)
        self.w = np.concatenate([[y], memory, self.w[-_TAIL:]])
        self._choose_regime()
        count = self.watch.most_jumps
        if len(self.events) > count and self.time - self.events[-1 - count].time_s <= self.watch.window_s:
            self._stop(HybridOutcome.CHATTERING, self._chattering())

    def _chattering(self) -> str:
        watch = self.watch
        found = f"more than {watch.most_jumps} jumps within {watch.window_s:g} s"
        if self.car.lines.half_width != 0.0:
            apart = "eps is too small" if self.car.lines.half_width else "the lines are too close"
            return f"{found}; {apart} for how fast the modes turn"
        at_once = self.events[-1].time_s == self.events[-2].time_s
        if at_once and min(self.exit_rates[-2:]) > 0.0:
            return f"{found}; sliding: on the line y = r both modes head for it"
        return f"{found}; eps = 0 leaves no room between the two lines"

    def _stop(self, outcome: HybridOutcome, reason: str) -> None:
        place = f"at {self.time:.9g} s, y = {self.w[0]:.9g}, mode {self.mode.value}"
        self.outcome, self.reason = outcome, f"{reason}; {place}"
        self._record()

    def _record(self) -> None:
        self.nodes.append(Node(self.time, self.mode.value, self.flow, self.w.copy()))
