"""Reference implementation of the sampled simulation, one plant and one sample at a time, to test the kernel against.

The controllers are `fopi_tune.digital.runtime` itself; `simulation.scenario` defines what happens in a sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fopi_tune.core.switching_lines import SwitchingLines
from fopi_tune.digital import runtime
from fopi_tune.digital.inactive import follow_from, observe, restarted
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, State
from fopi_tune.simulation.sampled.mode_plants import Segments
from fopi_tune.simulation.sampled.noise import normal_deviates
from fopi_tune.simulation.sampled.plants import DiscretePlants
from fopi_tune.simulation.scenario import Hybrid, InactiveController, Scenario, Traces


def simulate_reference(
    controllers: Sequence[Runtime], plants: Sequence[DiscretePlants], scenario: Scenario, first_index: int = 0,
    segments: Segments | None = None,
) -> Traces:  # fmt: skip
    """Simulate every plant; slow.

    Args:
        controllers: one, or two of a hybrid loop.
        plants: as many, of m plants each.
        scenario: everything else.
        first_index: of the first plant; the noise depends on it.
        segments: of two modes of which one has a dead time.
    """
    m, steps = len(plants[0]), len(scenario.signals)
    rows = np.zeros((8, m, steps))
    with np.errstate(all="ignore"):
        for i in range(m):
            run = _ReferenceLoop(controllers, plants, scenario, i, first_index + i, segments)
            for k in range(steps):
                rows[:, i, k] = run.sample(k)
    time_s = np.asarray(scenario.sample_time_s * np.arange(steps), dtype=float)
    y, rate, measured, error, demanded, applied, mode, after = rows
    return Traces(time_s, y, rate, measured, error, demanded, applied, mode.astype(np.int64), after)


class _ReferenceLoop:
    """The state of one loop from sample to sample."""

    def __init__(
        self, controllers: Sequence[Runtime], plants: Sequence[DiscretePlants], scenario: Scenario, row: int,
        index: int, segments: Segments | None,
    ) -> None:  # fmt: skip
        self.segments, self.sent = segments, -1
        self.controllers, self.plants, self.scenario, self.row = controllers, plants, scenario, row
        self.steps = len(scenario.signals)
        self.noise = (
            normal_deviates(scenario.sensor.seed, index, self.steps) if scenario.sensor.noise_std else np.zeros(0)
        )
        self.mode, self.coasting = scenario.first_mode - 1, False
        states, past = plants[self.mode].initial_state(scenario.start)
        self.x, self.past = states[row], float(past[row])
        self.before = self.last = self.past
        self.memory: list[State] = [runtime.init(controller) for controller in controllers]
        if scenario.start.bumpless:
            self.memory[self.mode] = runtime.reset(controllers[self.mode], self.past)
        # controls sent to the plant, and their modes
        self.applied: list[float] = []
        self.modes: list[int] = []
        self.arrived = self.mode
        self.last_switch = -math.inf

    def sample(self, k: int) -> tuple[float, ...]:
        """Sample k, and the plant's step to the next one."""
        scenario, reference = self.scenario, float(self.scenario.signals.reference[k])
        held = self.plants[self.arrived]
        y = float(held.output[self.row] @ self.x) + float(held.direct[self.row]) * self.before
        rate = self._rate()
        measured = self._measured(y, k)
        if scenario.hybrid is not None:
            self._switch(k, measured, reference, scenario.hybrid)
        demanded = 0.0
        if not self.coasting:
            controller = self.controllers[self.mode]
            added = self._fed(k, self.mode)
            self.memory[self.mode] = runtime.step(controller, self.memory[self.mode], reference, measured, added)
            demanded = float(self.memory[self.mode].output)
        self._actuate(demanded)
        if scenario.hybrid is not None:
            for idle in (0, 1) if self.coasting else (1 - self.mode,):
                own, state = self.controllers[idle], self.memory[idle]
                if scenario.hybrid.inactive is InactiveController.TRACK:
                    state = runtime.track(own, state, reference, measured, self.last, self._fed(k, idle))
                else:
                    state = observe(own, state, reference, measured)
                self.memory[idle] = state
        self.applied.append(self.last)
        self.modes.append(self.mode)
        after = self._rate_after(k, rate) if scenario.hybrid is None else 0.0
        arriving = self._advance(k)
        self.x = np.where(np.abs(self.x) < Precision.FLOAT64.flush_below, 0.0, self.x)
        if scenario.hybrid is not None:
            after = arriving
        return (
            y,
            rate,
            measured,
            reference - measured,
            demanded,
            self.last,
            0.0 if self.coasting else self.mode + 1.0,
            after,
        )

    def _fed(self, k: int, mode: int) -> np.float64 | None:
        """What the feed-forward adds to a mode's output; None without one."""
        if self.scenario.hybrid is None or not self.scenario.hybrid.fed:
            return None
        reference = self.scenario.signals.reference
        static, rate = self.scenario.hybrid.fed[mode]
        return np.float64(static * reference[k] + rate * (reference[k] - reference[max(k - 1, 0)]))

    def _rate_after(self, k: int, rate: float) -> float:
        """dy/dt just after a new input arrives, the larger one of control and load."""
        i, held = self.row, self.plants[0]
        if not held.acts_at_samples[i]:
            now, late = k - int(held.control.delay[i]), k - int(held.load.delay[i])
            inputs = self._control(now), self._control(now - 1), self._load(late), self._load(late - 1)
            control, load = held.arrivals[i] @ np.concatenate([self.x, inputs])
            loaded = self.scenario.signals.load is not None
            return float(load if loaded and abs(load) > abs(control) else control)
        new = self._control(k - int(held.control.delay[i])) + self._load(k - int(held.load.delay[i]))
        return rate + float(held.rate_input[i]) * (new - self.before)

    def _rate(self) -> float:
        held = self.plants[self.arrived]
        if self._stands_still():
            return 0.0
        return float(held.rate_state[self.row] @ self.x) + float(held.rate_input[self.row]) * self.before

    def _stands_still(self) -> bool:
        """Whether the output rests at 0, held against what drives it."""
        hybrid = self.scenario.hybrid
        if hybrid is None or not hybrid.hold_below or self.x[0] > 0.0:
            return False
        return float(self.plants[self.arrived].rate_input[self.row]) * self.before < hybrid.hold_below[self.arrived]

    def _measured(self, y: float, k: int) -> float:
        sensor = self.scenario.sensor
        value = y + sensor.noise_std * self.noise[k] if sensor.noise_std else y
        return float(sensor.quantum * np.rint(value / sensor.quantum)) if sensor.quantum else float(value)

    def _switch(self, k: int, measured: float, reference: float, hybrid: Hybrid) -> None:
        entered = self._entered(measured, reference, hybrid.lines)
        if entered is None or k - self.last_switch < hybrid.min_dwell_samples:
            return
        if not math.isfinite(reference - measured):
            return
        output = np.float64(0.0 if self.coasting else self.memory[self.mode].output)
        self.last_switch, self.coasting = k, entered < 0
        if not self.coasting:
            self.mode = entered
            low, high = self.controllers[self.mode].limits
            self.last = min(max(self.last, low), high)
            if hybrid.inactive is InactiveController.RESET:
                self.memory[self.mode] = restarted(self.controllers[self.mode], self.memory[self.mode])
            if self.controllers[self.mode].limits_rate and hybrid.inactive is not InactiveController.TRACK:
                self.memory[self.mode] = follow_from(self.controllers[self.mode], self.memory[entered], output)

    def _entered(self, measured: float, reference: float, lines: SwitchingLines) -> int | None:
        """The mode that is entered, -1 for coasting; None where the state stays."""
        if measured >= lines.up.level(reference) and (self.mode == 0 or self.coasting):
            return 1
        if measured <= lines.down.level(reference) and (self.mode == 1 or self.coasting):
            return 0
        if lines.coast_above is None or lines.coast_below is None or self.coasting:
            return None
        leaves = measured >= lines.coast_above.level(reference)
        if self.mode == 1:
            leaves = measured <= lines.coast_below.level(reference)
        return -1 if leaves else None

    def _actuate(self, wanted: float) -> None:
        most = self.scenario.actuator.rate_per_s * self.scenario.sample_time_s
        change = wanted - self.last
        self.last = wanted if abs(change) <= most else self.last + (most if change > 0.0 else -most)

    def _advance(self, k: int) -> float:
        """(1) of `plants`, the control's part and the load's; in a hybrid loop the load acts undelayed.

        Returns dy/dt when the new control arrives in a hybrid loop, 0 in other loops.
        """
        i = self.row
        if self.scenario.hybrid is None:
            held = self.plants[0]
            transition, *weights = (whole[i] for whole in held.control.whole)
            delay = int(held.control.delay[i])
            now, old = self._control(k - delay), self._control(k - delay - 1)
            follow = transition @ self.x + weights[0] * now + weights[1] * old
            delay = int(held.load.delay[i])
            load, old_load = self._load(k - delay), self._load(k - delay - 1)
            _, *weights = (whole[i] for whole in held.load.whole)
            self.x = follow + weights[0] * load + weights[1] * old_load
            self.before = now + load
            return 0.0
        if self.segments is not None:
            return self._advance_segments(self.segments, k)
        delay = int(self.plants[0].control.delay[i])
        load, after = self._load(k), 0.0
        places = [(0, k - delay - 1), (1, k - delay)]
        if self.scenario.hybrid.delay_samples:
            places = [(1, self._sent_last(k))]
        for segment, place in places:
            self.arrived = self.modes[place] if place >= 0 else self.scenario.hybrid.first - 1
            control = self.plants[self.arrived].control
            self.before = self._control(place) + load
            after, stands = self._rate(), self._stands_still()
            self.x = control.transition[segment, i] @ self.x + control.weight[segment, i] * self.before
            # the first segment lasts no time where the control arrives at the sample
            if stands and np.any(control.weight[segment, i] != 0.0):
                self.x = np.zeros(1)
            elif (hold := self.scenario.hybrid.hold_below) and math.isfinite(hold[self.arrived]):
                self.x = np.maximum(self.x, 0.0)
        return after

    def _advance_segments(self, parts: Segments, k: int) -> float:
        """To the next sample from arrival to arrival; returns the largest dy/dt just after one."""
        i, after = self.row, 0.0
        assert self.scenario.hybrid is not None
        for part in range(len(parts)):
            for mode in (0, 1):
                sent = k - int(parts.control[part, mode, i])
                if sent > self.sent and self.modes[sent] == mode:
                    self.sent, self.arrived = sent, mode
            mode = self.arrived
            self.before = self._control(self.sent) + self._load(k - int(parts.load[part, mode, i]))
            rate, stands = self._rate(), self._stands_still()
            if parts.arrives[part, mode, i] and abs(rate) > abs(after):
                after = rate
            self.x = parts.transition[part, mode, i] @ self.x + parts.weight[part, mode, i] * self.before
            if stands:
                self.x = np.zeros(1)
            elif (hold := self.scenario.hybrid.hold_below) and math.isfinite(hold[mode]):
                self.x = np.maximum(self.x, 0.0)
        return after

    def _sent_last(self, k: int) -> int:
        """The sample at which the control was sent that acts now, by each mode's own delay; -1 before the first."""
        assert self.scenario.hybrid is not None
        delays = self.scenario.hybrid.delay_samples
        return max((j for j in range(k + 1) if j + delays[self.modes[j]] <= k), default=-1)

    def _control(self, place: int) -> float:
        return self.applied[place] if place >= 0 else self.past

    def _load(self, place: int) -> float:
        load = self.scenario.signals.load
        return float(load[place]) if load is not None and place >= 0 else 0.0
