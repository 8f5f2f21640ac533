"""The hybrid car in continuous time, its events located to 1e-9 s.

Flow in mode 1 (throttle) while y < r + eps, in mode 2 (brake) while y > r - eps; jump to mode 3 - i, y kept,

    in mode 1 on y >= r + eps,   in mode 2 on y <= r - eps.                                                          (1)

The paper writes = in (1), with < and > in the flow sets: then a step of the reference can leave the car where it can
neither flow nor jump, and with eps = 0 it can never flow away from y = r.  Here

  - beyond its line a mode is left at once;
  - a touching of the line is a jump, for the flow sets are open;
  - just after a jump, after a corner and at the start, a car on its line flows on if y - r goes inwards (by its first
    derivative that is not 0) or rests there, and jumps otherwise.

What the inactive controller remembers: `Memory`.  Between events the loop is linear and its state exact to rounding
(`flow`); `guards` says why no event is missed.  A crossing is located to the rounding of y - r over its rate; where y
touches the line within rounding, to the square root of that.

Where both modes head for the line y = r, no solution goes on by (1): it jumps for ever at one instant, and only sliding
along the line, in neither mode, would go on.  More than so many jumps within a window (`Watch`) end the run as
CHATTERING.

Source: the paper's flow and jump sets; hybrid inclusions in Goebel, Sanfelice and Teel, Hybrid Dynamical
Systems, 2012.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fopi_tune.core.logform import Array
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
    Memory,
    Mode,
    Watch,
    checked_reference,
    checked_samples,
)

#: y - r and u count as 0 below this share of the greatest numbers in play
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
        car: the two pedals, eps, and what an inactive controller remembers.
        reference: corners, the first at 0.
        end_s: the end, s.
        times_s: where to sample, increasing, within [0, end_s].
        start: y, mode and control at 0; None: at rest in mode 1.
        watch: when to give up; None: 20 jumps within 0.2 s, the paper's sampling period.

    Returns:
        The jumps, the samples up to where the run ended, and how it ended.

    Raises:
        DomainError: a reference, an end, sample times or a start that make no sense, or a horizon of more than a
            million of the car's own steps.
    """
    corners = checked_reference(reference, end_s)
    times = checked_samples(times_s, end_s)
    run = _Run(car, corners, end_s, start or HybridStart(), watch or Watch())
    run.follow(corners, end_s)
    times = times[times <= run.time]
    return HybridResponse(times, *interpolate(run.nodes, times), tuple(run.events), run.outcome, run.reason, run.time)


class _Run:
    """One pass through time: what changes as it goes on."""

    def __init__(
        self, car: HybridCar, corners: Sequence[Corner], end_s: float, start: HybridStart, watch: Watch
    ) -> None:
        self.car, self.watch, self.mode, self.time = car, watch, start.mode, 0.0
        pedals = {mode: car.pedal(mode) for mode in Mode}
        self.flows = {(m, regime): Flow(pedals[m], regime) for m in Mode for regime in pedals[m].regimes()}
        shortest = min(flow.longest_s for flow in self.flows.values())
        if end_s > _MOST_STEPS * shortest:
            raise DomainError(f"end_s = {end_s!r} s is more than {_MOST_STEPS:g} steps of {shortest:g} s; end earlier")
        #: what each controller remembers, the active one only when it goes
        self.memory = {mode: np.zeros(len(car.pedal(mode).poles)) for mode in Mode}
        self.w = np.concatenate([[start.output], self.memory[start.mode], [corners[0].value, 0.0, 1.0]])
        self._start_control(start)
        ends = [*(corner.time_s for corner in corners[1:]), end_s]
        levels = [abs(c.value) + abs(c.slope_per_s * (end - c.time_s)) for c, end in zip(corners, ends, strict=True)]
        scale = abs(start.output) + car.eps + max(levels)
        if start.control is not None:
            scale += abs(start.control * self.pedal.gain) * shortest
        self.rounding = _ROUNDING * scale
        self.regime, self.on_line, self.switched_at = Regime.WITHIN, False, -1.0
        self.level = FINEST // 2
        self.events: list[Event] = []
        #: how fast each mode went beyond its line when it was left
        self.leaving: list[float] = []
        self.outcome, self.reason = HybridOutcome.FINISHED, f"ran to the end at {end_s:g} s"
        self.nodes: list[Node] = []

    @property
    def pedal(self) -> ModeLoop:
        return self.car.pedal(self.mode)

    @property
    def flow(self) -> Flow:
        return self.flows[self.mode, self.regime]

    def _start_control(self, start: HybridStart) -> None:
        if start.control is None:
            return
        if not len(self.memory[start.mode]):
            raise DomainError("start: control needs an integral in the starting mode's controller; leave it None")
        error = float(self.w[-_TAIL] - self.w[0])
        self.w[1:-_TAIL] = self.pedal.memory_for(start.control, error, self.w[1:-_TAIL])

    def follow(self, corners: Sequence[Corner], end_s: float) -> None:
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
        self._note()

    def _advance(self, until: float) -> None:
        """One step at most to `until`, or to the first event on the way."""
        if not abs(self.w[0]) <= self.watch.most_output:
            return self._give_up(HybridOutcome.DIVERGED, f"the output goes beyond {self.watch.most_output:g}")
        self._note()
        left, reading = until - self.time, self.flow.read(self.w)
        guards = self._guards(reading, left)
        if self._beyond(guards):
            return None
        level = self.level
        while level < FINEST and self.flow.steps_s[level] > left:
            level += 1
        while True:
            end = self.w + self.flow.ahead[level] @ self.w
            verdicts = self._verdicts(guards, self.flow.changes(reading, level), level, end)
            if level == FINEST or GuardStatus.OPEN not in verdicts:
                break
            level += 1
        self.level = max(level - 1, 0)
        if verdicts[0] is GuardStatus.OPEN:
            return self._jump_and_settle()
        # a limit that is crossed again at once: the flow is the same on both sides of it, so only rounding can do that
        seen = 1 if self.switched_at == self.time else len(verdicts)
        crossed = [i for i, verdict in enumerate(verdicts[:seen]) if verdict is GuardStatus.CROSSED]
        if crossed:
            return self._locate(level, crossed)
        step = self.flow.steps_s[level]
        self.w, self.time = end, until if step >= left else self.time + step
        return None

    def _verdicts(
        self, guards: Sequence[Guard], changes: tuple[float, float], level: int, end: Array
    ) -> list[GuardStatus]:
        """Of the mode's guard and of the limits', over the step of this level."""
        step = self.flow.steps_s[level]
        return [guard.judge(step, changes[min(i, 1)], self._value(i, end)) for i, guard in enumerate(guards)]

    def _guards(self, reading: LoopDerivatives, left: float) -> list[Guard]:
        """The mode's guard, and those of the limits that bound the regime; `left` is the time to the next corner."""
        guard, longest = self._mode_guard(reading), self.flow.longest_s
        near = abs(guard.value) <= self.rounding
        # a car that has just jumped need not leave its line before the next corner
        time = min(left, longest) if self.on_line else longest
        rests = near and guard.resting(time, self.flow.changes(reading, 0)[0])
        guards = [replace(guard, on_line=near and self.on_line, at_rest=rests)]
        u, slope, bend = reading.demand
        for sign, limit in self.pedal.bounds(self.regime):
            rounding = self._control_rounding(limit)
            value = sign * (u - limit)
            guards.append(Guard(value, sign * slope, sign * bend, rounding, abs(value) <= rounding))
        return guards

    def _value(self, i: int, w: Array) -> float:
        """The guard i alone."""
        if i == 0:
            return self.mode.outwards * float(w[0] - w[-_TAIL]) - self.car.eps
        sign, limit = self.pedal.bounds(self.regime)[i - 1]
        return sign * (self.pedal.demand(float(w[-_TAIL] - w[0]), w[1:-_TAIL]) - limit)

    def _control_rounding(self, limit: float) -> float:
        return _ROUNDING * abs(limit) + abs(self.pedal.gains.kp) * self.rounding

    def _beyond(self, guards: Sequence[Guard]) -> bool:
        """Whether rounding left the car beyond a line; then that is mended."""
        if guards[0].value > self.rounding or (guards[0].value >= 0.0 and not self.on_line and not guards[0].at_rest):
            self._jump_and_settle()
            return True
        self.on_line = self.on_line and guards[0].value >= -self.rounding
        if any(guard.value > guard.rounding for guard in guards[1:]):
            self._choose_regime()
        return False

    def _locate(self, level: int, crossed: list[int]) -> None:
        """Go to the first of these crossings: halve the step, then one step of Newton's."""
        flow = self.flow
        for finer in range(level + 1, FINEST + 1):
            middle = self.w + flow.ahead[finer] @ self.w
            if all(self._value(i, middle) < 0.0 for i in crossed):
                self.w, self.time = middle, self.time + flow.steps_s[finer]
        reading = flow.read(self.w)
        guards = self._guards(reading, 0.0)
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
        reading = self.flows[self.mode, Regime.WITHIN].read(self.w)
        u, slope, bend = reading.demand
        longest = self.flows[self.mode, Regime.WITHIN].longest_s
        self.regime = Regime.WITHIN
        for sign, limit, regime in ((1, self.pedal.limits[1], Regime.HIGH), (-1, self.pedal.limits[0], Regime.LOW)):
            if math.isfinite(limit):
                rounding = self._control_rounding(limit)
                if Guard(sign * (u - limit), sign * slope, sign * bend, rounding).leaves(longest):
                    self.regime = regime

    def _mode_guard(self, reading: LoopDerivatives) -> Guard:
        side, (y, slope, bend) = self.mode.outwards, reading.offset
        return Guard(side * y - self.car.eps, side * slope, side * bend, self.rounding)

    def _settle(self) -> None:
        """Jump as long as the mode is left at once."""
        while self.outcome is HybridOutcome.FINISHED:
            guard = self._mode_guard(self.flow.read(self.w))
            self.on_line = abs(guard.value) <= self.rounding
            if not guard.leaves(self.flow.longest_s):
                # the longest step first: a short one would not tell that the line is left
                self.level = 0
                return
            self._jump()

    def _jump_and_settle(self) -> None:
        self._jump()
        self._settle()

    def _jump(self) -> None:
        """(1), with what the controllers remember."""
        self._note()
        y, r = float(self.w[0]), float(self.w[-_TAIL])
        control = self.pedal.cut(self.pedal.demand(r - y, self.w[1:-_TAIL]))
        self.memory[self.mode] = self.w[1:-_TAIL].copy()
        self.leaving.append(self._mode_guard(self.flow.read(self.w)).slope)
        self.events.append(Event(self.time, self.mode, self.mode.other, y, r))
        self.mode = self.mode.other
        memory = self.memory[self.mode]
        if self.car.memory is Memory.RESET:
            memory = np.zeros_like(memory)
        elif self.car.memory is Memory.TRACKING:
            memory = self.pedal.memory_for(self.pedal.cut(control), r - y, memory)
        self.w = np.concatenate([[y], memory, self.w[-_TAIL:]])
        self._choose_regime()
        count = self.watch.most_jumps
        if len(self.events) > count and self.time - self.events[-1 - count].time_s <= self.watch.window_s:
            self._give_up(HybridOutcome.CHATTERING, self._chattering())

    def _chattering(self) -> str:
        watch = self.watch
        found = f"more than {watch.most_jumps} jumps within {watch.window_s:g} s"
        if self.car.eps > 0.0:
            return f"{found}; eps is too small for how fast the modes turn"
        at_once = self.events[-1].time_s == self.events[-2].time_s
        if at_once and min(self.leaving[-2:]) > 0.0:
            return f"{found}; sliding: on the line y = r both modes head for it"
        return f"{found}; eps = 0 leaves no room between the two lines"

    def _give_up(self, outcome: HybridOutcome, reason: str) -> None:
        place = f"at {self.time:.9g} s, y = {self.w[0]:.9g}, mode {self.mode.value}"
        self.outcome, self.reason = outcome, f"{reason}; {place}"
        self._note()

    def _note(self) -> None:
        self.nodes.append(Node(self.time, self.mode.value, self.flow, self.w.copy()))
