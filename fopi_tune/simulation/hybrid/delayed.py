"""The hybrid car with dead time and load, in equal steps:  loops, reference, load -> signals and jumps.

The control of mode i reaches its plant, and the mode with it, after the dead time L; the load acts at once:

    y' = -p_i y + g_i (v(t - L) + load),    i the mode at t - L,    v = u within the limits of its mode.            (1)

Controllers and jumps are those of `inclusion`, but that TRACKING is what it is on samples: the idle integral follows
the control until just before the jump, so that a step of the reference that causes it still acts by kp.  Over one step
e, v and the load are lines between their values just after and just before the nodes, and the states follow exactly:

    x' = p x + f:   x_{n+1} = e^{ph} x_n + I_1 f_n + I_2 (f_{n+1} - f_n),
    I_1 = (e^{ph} - 1)/p,   I_2 = (e^{ph} - 1 - ph)/(p^2 h).                                                         (2)

A standstill is that of `simulation.scenario`, by the larger drive of a step.  Where the modes coast, v is 0, the plant
is that of the mode that was left last, and what each controller remembers is kept or follows 0.

A feed-forward of r and of its slope is added to u.  At a step of r the slope's part is an impulse, which the limits cut
to nothing.

The error falls as h^2 between jumps; a jump happens at the first node beyond its line after the minimum dwell, so that
it is up to h late.

Source: exact integration of (1) for piecewise linear inputs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.switching_lines import Threshold
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.simulation.hybrid.flow import ModeLoop
from fopi_tune.simulation.hybrid.model import HybridCar, HybridOutcome, HybridStart, Mode, Watch

#: repetitions of a step whose own control acts within it
_REPEATED = 3


@dataclass(frozen=True, eq=False)
class SteppedSignals:
    """Values just before and just after each node, shape (n + 1,) each.

    Args:
        reference: r.
        load: at the plant's input.
    """

    reference: tuple[Array, Array]
    load: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class SteppedResponse:
    """One run; arrays of shape (k,), k nodes up to where it ended.

    Args:
        output: y.
        rate: y' just before the node, output unit per s.
        rate_after: just after it.
        control: v just after the node.
        mode: 1 or 2, just after it; 0 while both outputs rest.
        jumps: the nodes of all jumps.
        outcome: how it ended.
        reason: one sentence.
    """

    output: Array
    rate: Array
    rate_after: Array
    control: Array
    mode: np.ndarray
    jumps: tuple[int, ...]
    outcome: HybridOutcome
    reason: str


def simulate_stepped(
    car: HybridCar, signals: SteppedSignals, step_s: float, lag: int, start: HybridStart, past: float, watch: Watch
) -> SteppedResponse:
    """Run the car over n equal steps.

    Args:
        car: both modes' loops, eps, and the behaviour of an inactive controller's states.
        signals: at n + 1 nodes.
        step_s: h, s.
        lag: the dead time in steps.
        start: y, mode and control at 0.
        past: the plant's input before 0, still on its way through the dead time.
        watch: when to give up.
    """
    run = _Run(car, signals, step_s, lag, start, past, watch)
    return run.through()


class _Run:
    """One pass through the nodes."""

    def __init__(
        self, car: HybridCar, signals: SteppedSignals, step: float, lag: int, start: HybridStart, past: float,
        watch: Watch,
    ) -> None:  # fmt: skip
        self.car, self.signals, self.step, self.lag, self.watch = car, signals, step, lag, watch
        count = len(signals.reference[0])
        self.output, self.rate, self.rate_after, self.before, self.after = np.zeros((5, count))
        self.mode = np.zeros(count, dtype=np.int64)
        self.loops = {mode: car.loop(mode) for mode in Mode}
        self.sections = {mode: _line_weights(loop.poles, step) for mode, loop in self.loops.items()}
        self.plants = {mode: _line_weights(np.array([-loop.pole_rad_s]), step) for mode, loop in self.loops.items()}
        self.memory = {mode: np.zeros(len(loop.poles)) for mode, loop in self.loops.items()}
        self.active, self.first, self.past, self.jumps = start.mode, start.mode, past, list[int]()
        self.lines, self.coasting = car.lines, False
        #: whose plant moves from each node on
        self.moved = [start.mode] * count
        if start.control is not None and len(self.memory[start.mode]):
            error = float(signals.reference[1][0]) - start.output
            self.memory[start.mode] = self.loop.memory_for(start.control, error, self.memory[start.mode])
        self.idle_since = dict.fromkeys(Mode, 0)
        # a jump must not come before the dwell ends
        self.dwell, self.free_at = math.ceil(car.min_dwell_s / step * (1.0 - 1e-9)), 0
        self.output[0] = start.output
        self.outcome, self.reason = HybridOutcome.FINISHED, f"ran to the end at {step * (count - 1):g} s"

    @property
    def loop(self) -> ModeLoop:
        """The active mode's."""
        return self.loops[self.active]

    def through(self) -> SteppedResponse:
        """All nodes in turn, up to where the run ends."""
        count = len(self.output)
        first = float(self.signals.reference[0][0])
        self.before[0] = self._control(first - self.output[0], self.memory[self.active], self._added(first, 0.0))
        self._node(0)
        end = 1
        while end < count and self.outcome is HybridOutcome.FINISHED:
            self._advance(end - 1)
            self._node(end)
            end += 1
        kept = slice(0, end)
        return SteppedResponse(
            self.output[kept], self.rate[kept], self.rate_after[kept], self.after[kept], self.mode[kept],
            tuple(self.jumps), self.outcome, self.reason,
        )  # fmt: skip

    def _control(self, error: float, memory: Array, added: float) -> float:
        return 0.0 if self.coasting else self.loop.saturate(self.loop.demand(float(error), memory) + added)

    def _added(self, setpoint: float, slope: float) -> float:
        """What the active mode's feed-forward adds."""
        if not self.car.fed:
            return 0.0
        static, rate = self.car.fed[self.active - 1]
        return static * setpoint + rate * slope

    def _slope(self, n: int) -> float:
        """The setpoint's rate from node n to the next one."""
        before, after = self.signals.reference
        return float(before[n + 1] - after[n]) / self.step if 0 <= n < len(before) - 1 else 0.0

    def _arriving(self, n: int) -> tuple[Mode, float]:
        """The mode that acts just after node n, and its control."""
        k = n - self.lag
        return (self.moved[k], float(self.after[k])) if k >= 0 else (self.first, self.past)

    def _advance(self, n: int) -> None:
        """From node n to just before node n + 1."""
        (reference, reference_after), (load, load_after) = self.signals.reference, self.signals.load
        mode, begin = self._arriving(n)
        gain, plant = self.loops[mode].gain, self.plants[mode]
        e0, memory = reference_after[n] - self.output[n], self.memory[self.active]
        late = n + 1 - self.lag
        end = self.before[late] if self.lag and late > 0 else self.past if self.lag else begin
        y, control, x = 0.0, end, memory
        added = self._added(float(reference[n + 1]), self._slope(n))
        for _ in range(1 if self.lag else _REPEATED):
            line = gain * (begin + load_after[n]), gain * (end + load[n + 1])
            y = self._standing(mode, n, float(_stepped(self.output[n : n + 1], plant, *line)[0]), max(line))
            error = float(reference[n + 1] - y)
            x = memory if self.coasting else _stepped(memory, self.sections[self.active], float(e0), error)
            control = self._control(error, x, added)
            end = end if self.lag else control
        self.output[n + 1], self.memory[self.active], self.before[n + 1] = y, x, control
        self.rate[n + 1] = self._rate(mode, y, gain * (end + load[n + 1]))

    def _node(self, n: int) -> None:
        """The jump at node n, and the values just after it."""
        y, r = float(self.output[n]), float(self.signals.reference[1][n])
        if not abs(y) <= self.watch.most_output:
            self._stop(n, HybridOutcome.DIVERGED, f"the output goes beyond {self.watch.most_output:g}")
        elif n >= self.free_at and (entered := self._entered(y, r)) is not None:
            self._jump(n, entered)
        self.after[n] = self._control(r - y, self.memory[self.active], self._added(r, self._slope(n)))
        self.mode[n], self.moved[n] = 0 if self.coasting else self.active, self.active
        mode, control = self._arriving(n)
        gain, load = self.loops[mode].gain, float(self.signals.load[1][n])
        self.rate_after[n] = self._rate(mode, y, gain * (control + load))
        if n == 0:
            self.rate[0] = self._rate(mode, y, gain * self.past)

    def _holds(self, mode: Mode, y: float, drive: float) -> bool:
        """Whether the output rests at 0, held against what drives it, output unit per s."""
        return bool(self.car.hold_below) and y <= 0.0 and drive < self.car.hold_below[mode - 1]

    def _rate(self, mode: Mode, y: float, drive: float) -> float:
        return 0.0 if self._holds(mode, y, drive) else -self.loops[mode].pole_rad_s * y + drive

    def _standing(self, mode: Mode, n: int, y: float, drive: float) -> float:
        """The output at node n + 1: it stays at 0, or ends there on its way below."""
        if self._holds(mode, float(self.output[n]), drive):
            return 0.0
        return max(y, 0.0) if self.car.hold_below and math.isfinite(self.car.hold_below[mode - 1]) else y

    def _entered(self, y: float, r: float) -> Mode | int | None:
        """The mode that is entered, 0 for coasting; None where nothing changes."""
        lines, acts = self.lines, None if self.coasting else self.active
        if acts is not Mode.BRAKE and y - _zero(lines.up, r) >= lines.up.value:
            return Mode.BRAKE
        if acts is not Mode.THROTTLE and y - _zero(lines.down, r) <= lines.down.value:
            return Mode.THROTTLE
        high, low = lines.coast_above, lines.coast_below
        if acts is Mode.THROTTLE and high is not None and y - _zero(high, r) >= high.value:
            return 0
        return 0 if acts is Mode.BRAKE and low is not None and y - _zero(low, r) <= low.value else None

    def _jump(self, n: int, entered: Mode | int) -> None:
        y, left = float(self.output[n]), self.active
        error = float(self.signals.reference[0][n]) - y
        setpoint, slope = float(self.signals.reference[0][n]), self._slope(n - 1)
        control = self._control(error, self.memory[left], self._added(setpoint, slope))
        if not self.coasting:
            self.idle_since[left] = n
        self.free_at, self.coasting = n + self.dwell, not isinstance(entered, Mode)
        if isinstance(entered, Mode):
            self.active = entered
            self._begin(n, control, error, self._added(setpoint, slope))
        self.jumps.append(n)
        count = self.watch.most_jumps
        if len(self.jumps) > count and (n - self.jumps[-1 - count]) * self.step <= self.watch.window_s:
            found = f"more than {count} jumps within {self.watch.window_s:g} s"
            self._stop(n, HybridOutcome.CHATTERING, found)

    def _begin(self, n: int, control: float, error: float, added: float) -> None:
        """The memory of the mode that begins to act."""
        memory = self.memory[self.active]
        if self.car.memory is Memory.RESET:
            self.memory[self.active] = np.zeros_like(memory)
        elif self.car.memory is Memory.TRACKING and len(memory):
            # as on samples: the idle integral followed the control until just before, the other states decayed
            decayed = memory * np.exp(self.loop.poles * (n - self.idle_since[self.active]) * self.step)
            self.memory[self.active] = self.loop.memory_for(self.loop.saturate(control) - added, error, decayed)

    def _stop(self, n: int, outcome: HybridOutcome, reason: str) -> None:
        mode = 0 if self.coasting else self.active.value
        place = f"at {n * self.step:.9g} s, y = {self.output[n]:.9g}, mode {mode}"
        self.outcome, self.reason = outcome, f"{reason}; {place}"


def _line_weights(poles: Array, step: float) -> tuple[Array, Array, Array]:
    """e^{ph}, I_1 and I_2 of (2), shape (n,) each."""
    exponent = poles * step
    small = np.abs(exponent) < 1e-3
    safe = np.where(small, 1.0, exponent)
    # their series where the differences would cancel: the next terms are below 1e-14
    first = np.where(small, 1.0 + exponent * (0.5 + exponent * (1 / 6 + exponent / 24)), np.expm1(exponent) / safe)
    series = 0.5 + exponent * (1 / 6 + exponent * (1 / 24 + exponent / 120))
    second = np.where(small, series, (np.expm1(exponent) - exponent) / safe**2)
    return np.exp(exponent), step * first, step * second


def _stepped(x: Array, weights: tuple[Array, Array, Array], begin: float, end: float) -> Array:
    """(2)."""
    growth, first, second = weights
    return growth * x + first * begin + second * (end - begin)


def _zero(line: Threshold, setpoint: float) -> float:
    """Where a line's number counts from."""
    return 0.0 if line.is_absolute else setpoint
