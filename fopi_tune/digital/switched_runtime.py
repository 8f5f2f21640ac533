"""Two controllers that take turns, in NumPy:  the same operations and roundings as the exported C of a system.

Mode 0 raises the output and mode 1 lowers it.  At a sample, with the half-width eps,

    mode 0 -> 1 when measurement >= setpoint + eps,      1 -> 0 when measurement <= setpoint - eps,                  (1)

or at other lines, which may leave a band in which both outputs rest (`core.switching_lines`), if the active mode, or
the band, was entered by a change at least `min_dwell_samples` samples ago; the first mode may be left at once.  Then
the active controller steps as in `runtime`.  The other one's memory is held, tracks the active one's output within its
own limits, or starts anew, at an output of 0, when its mode is entered.  In the band the output is 0, and the memories
of both do so.

A derivative is that of the measurement, which both modes see: the measurements behind its lags, m_j of `runtime`, go on
at every sample, whatever becomes of the memory.  So they are those of a controller that was never inactive, and a
change of the mode is no kick.

The actuator is one: where the rate of the entered mode's output is limited, its first output is reached from the last
output of the other mode, or of the band, cut to its own limits.  A controller that tracked has tracked just that.

A mode may be fed forward: g r + (h/Ts)(r - r') is added to its output before the limits, r' being the setpoint of the
last sample with a finite error, and r itself at the first one.

At a sample whose setpoint - measurement is not finite the mode is held, and both controllers hold too.  The time of the
dwell goes on.

Source: (1) is the hysteresis of the paper, with <= and >= as in `simulation.scenario`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.core.terms.feedforward import Fed
from fopi_tune.digital import runtime
from fopi_tune.digital.inactive import follow_from, observe, restarted
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, State
from fopi_tune.digital.vectors import Op, Operation
from fopi_tune.errors import DomainError

#: the mode of the band in which both outputs rest
COASTING = -1


class Memory(StrEnum):
    """What the inactive controller remembers; the value is the word in a system's file."""

    HELD = "held"
    TRACKING = "tracking"
    RESET = "reset"


@dataclass(frozen=True)
class Switching:
    """How two controllers take turns.

    Args:
        hysteresis: eps, half-width around the setpoint, in the measurement's unit; or other lines.
        memory: of the inactive controller.
        min_dwell_samples: from one change of the mode to the next at least; 0 and 1 are any.
        first: the mode to start in, 0 or 1.
        fed: g and h/Ts of each mode's feed-forward; empty where there is none.
    """

    hysteresis: float | SwitchingLines
    memory: Memory = Memory.HELD
    min_dwell_samples: int = 0
    first: int = 0
    fed: tuple[Fed, ...] = ()


@dataclass(frozen=True)
class SwitchedRuntime:
    """Both controllers with the numbers that their target stores.

    Args:
        controllers: of mode 0 and mode 1, in one precision.
        switching: how they take turns.

    Raises:
        DomainError: a half-width or lines that the precision does not hold, limits without 0 where the modes coast, a
            dwell below 0, no such first mode, or a controller with a weight of the setpoint or a measurement filter.
    """

    controllers: tuple[Runtime, Runtime]
    switching: Switching

    def __post_init__(self) -> None:
        wanted = self.switching
        eps = wanted.hysteresis
        if not isinstance(eps, SwitchingLines) and not 0.0 <= self._rounded(eps) < np.inf:
            raise DomainError(f"hysteresis {eps!r} must be a number of {self.precision.value} and >= 0")
        if not all(np.isfinite(self._rounded(gain)) for own in wanted.fed for gain in own):
            raise DomainError(f"a gain of the feed-forward is beyond the range of {self.precision.value}; scale it")
        if self.lines.coasts and not all(low <= 0.0 <= high for low, high in (c.limits for c in self.controllers)):
            raise DomainError("modes that coast rest at an output of 0, which must lie within the limits of both")
        if wanted.min_dwell_samples < 0 or wanted.first not in (0, 1):
            raise DomainError(f"{wanted}: the dwell must be at least 0 and the first mode 0 or 1")
        if not all(controller.can_take_turns for controller in self.controllers):
            raise DomainError("two controllers that take turns have setpoint_weight: 1 and no measurement_filter")

    @property
    def precision(self) -> Precision:
        """Of all numbers."""
        return self.controllers[0].precision

    @property
    def lines(self) -> SwitchingLines:
        """Where the modes take turns, rounded to the precision."""
        exact = SwitchingLines.of(self.switching.hysteresis)

        def rounded(line: Threshold) -> Threshold:
            return Threshold(self._rounded(line.value), line.is_absolute)

        rests = [line and rounded(line) for line in (exact.coast_above, exact.coast_below)]
        return SwitchingLines(rounded(exact.up), rounded(exact.down), rests[0], rests[1])

    def _rounded(self, value: float) -> float:
        with np.errstate(over="ignore"):
            return float(self.precision.dtype(value))


@dataclass(frozen=True, eq=False)
class SwitchedState:
    """What the pair remembers.

    Args:
        mode: the active one, 0 or 1, or `COASTING`.
        stayed: samples since it was entered, at most the minimum dwell.
        controllers: states of both controllers.
        setpoint: of the last sample with a finite error; None before the first one.
    """

    mode: int
    stayed: int
    controllers: tuple[State, State]
    setpoint: np.floating | None = None

    @property
    def output(self) -> np.floating:
        """The last output."""
        if self.mode == COASTING:
            # of the precision: a rate that is limited goes on from it
            return self.controllers[0].output.dtype.type(0.0)
        return self.controllers[self.mode].output


def init(pair: SwitchedRuntime) -> SwitchedState:
    """The state to start from: the first mode at output 0, or the limit next to it."""
    return reset(pair, 0.0)


def reset(pair: SwitchedRuntime, output: float) -> SwitchedState:
    """The first mode at rest at an output, and the other controller as after `init`.

    Args:
        pair: both controllers.
        output: taken within the first mode's limits; 0 in place of one that is not finite.
    """
    first, states = pair.switching.first, [runtime.init(controller) for controller in pair.controllers]
    states[first] = runtime.reset(pair.controllers[first], output)
    return SwitchedState(first, pair.switching.min_dwell_samples, (states[0], states[1]))


def step(pair: SwitchedRuntime, state: SwitchedState, setpoint: float, measurement: float) -> SwitchedState:
    """One sample; `output` of what is returned goes to the actuator."""
    switching, controllers = pair.switching, pair.controllers
    mode, stayed = state.mode, min(state.stayed + 1, switching.min_dwell_samples)
    memories = list(state.controllers)
    wanted = _next_mode(pair, mode, setpoint, measurement)
    if stayed >= switching.min_dwell_samples and wanted != mode:
        mode, stayed = wanted, 0
        if mode != COASTING and switching.memory is Memory.RESET:
            memories[mode] = restarted(controllers[mode], memories[mode])
        if mode != COASTING and controllers[mode].limits_rate and switching.memory is not Memory.TRACKING:
            memories[mode] = follow_from(controllers[mode], memories[mode], state.output)
    applied, (added, last) = 0.0, _fed_forward(pair, state, setpoint, measurement)
    if mode != COASTING:
        memories[mode] = runtime.step(controllers[mode], memories[mode], setpoint, measurement, added[mode])
        applied = float(memories[mode].output)
    for idle in {0, 1} - {mode}:
        memories[idle] = (
            runtime.track(controllers[idle], memories[idle], setpoint, measurement, applied, added[idle])
            if switching.memory is Memory.TRACKING
            else observe(controllers[idle], memories[idle], setpoint, measurement)
        )
    return SwitchedState(mode, stayed, (memories[0], memories[1]), last)


@np.errstate(all="ignore")
def _fed_forward(
    pair: SwitchedRuntime, state: SwitchedState, setpoint: float, measurement: float
) -> tuple[list[np.floating | None], np.floating | None]:
    """What is added to each mode's output, and the setpoint to remember, in the precision."""
    if not pair.switching.fed:
        return [None, None], None
    dtype = pair.precision.dtype
    r, y = dtype(setpoint), dtype(measurement)
    known = bool(np.isfinite(r - y))
    change = r - state.setpoint if known and state.setpoint is not None else dtype(0.0)
    added = [dtype(static) * r + dtype(rate) * change for static, rate in pair.switching.fed]
    return list(added), r if known else state.setpoint


@np.errstate(all="ignore")
def _next_mode(pair: SwitchedRuntime, mode: int, setpoint: float, measurement: float) -> int:
    """The mode, or `COASTING`, that the lines ask for, in the precision."""
    r, y = (pair.precision.dtype(each) for each in (setpoint, measurement))

    def level(line: Threshold) -> np.floating:
        value = pair.precision.dtype(line.value)
        return value if line.is_absolute else r + value

    lines = pair.lines
    if not np.isfinite(r - y):
        return mode
    if mode != 1 and y >= level(lines.up):
        return 1
    if mode != 0 and y <= level(lines.down):
        return 0
    if mode == 0 and lines.coast_above and y >= level(lines.coast_above):
        return COASTING
    if mode == 1 and lines.coast_below and y <= level(lines.coast_below):
        return COASTING
    return mode


def replay(pair: SwitchedRuntime, operations: Iterable[Operation]) -> tuple[Array, np.ndarray]:
    """The output and the mode (0 or 1, or `COASTING`) after each operation, from a fresh `init`; shape (n,) each.

    Args:
        pair: both controllers.
        operations: without `track`, which a pair has not.

    Raises:
        DomainError: an operation is `track`.
    """
    state, outputs, modes = init(pair), [], []
    for operation in operations:
        if operation.op is Op.STEP:
            state = step(pair, state, operation.setpoint, operation.measurement)
        elif operation.op is Op.TRACK:
            raise DomainError("a pair of controllers has no operation track; reset it to what was applied")
        else:
            state = init(pair) if operation.op is Op.INIT else reset(pair, operation.output)
        outputs.append(float(state.output))
        modes.append(state.mode)
    return np.array(outputs), np.array(modes, dtype=np.int64)
