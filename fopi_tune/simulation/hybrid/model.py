"""The hybrid car and its parts, and the result of a run; `inclusion` simulates it.

Modes i: 1 throttle, 2 brake, with one output y, the velocity, and in both e = r - y.  Each has its own plant and
controller (`ModeLoop`); u is the input of its plant, so with positive gains the throttle pushes with u > 0 and the
brake pulls with u < 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.core.terms.feedforward import Fed
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError
from fopi_tune.simulation.hybrid.flow import ModeLoop


class Mode(IntEnum):
    """Which pedal acts."""

    THROTTLE = 1
    BRAKE = 2

    @property
    def other(self) -> Mode:
        """3 - i."""
        return Mode(3 - self)

    @property
    def outwards(self) -> int:
        """The sign of y - r on the side where this mode is left."""
        return 1 if self is Mode.THROTTLE else -1


class HybridOutcome(StrEnum):
    """How a run ended."""

    FINISHED = "finished"
    CHATTERING = "chattering"
    DIVERGED = "diverged"


@dataclass(frozen=True)
class HybridCar:
    """The loops of throttle and brake, and how they are switched.

    Args:
        throttle, brake: modes 1 and 2.
        eps: half-width of the hysteresis, >= 0, in the output's unit, or other lines.
        memory: of the inactive controller; the paper keeps it.  TRACKING sets the integrator's state at the jump so
            that the new demand is the control before the jump, as far as the new mode's limits let it; a controller
            without an integral has no state to set.
        min_dwell_s: from one jump to the next at least, s; the first mode may be left at once.
        hold_below: of each mode's standstill as in `simulation.scenario.Hybrid`; only equal steps have it.
        fed: g and h of each mode's feed-forward, g r + h r'; empty where there is none; only equal steps have it.

    Raises:
        DomainError: eps or the dwell is negative or not finite, or TRACKING where no controller has an integral.
    """

    throttle: ModeLoop
    brake: ModeLoop
    eps: float | SwitchingLines = 0.0
    memory: Memory = Memory.HELD
    min_dwell_s: float = 0.0
    hold_below: tuple[float, ...] = ()
    fed: tuple[Fed, ...] = ()

    def __post_init__(self) -> None:
        eps = self.eps
        if not isinstance(eps, SwitchingLines) and not (math.isfinite(eps) and eps >= 0.0):
            raise DomainError(f"hybrid car: eps = {self.eps!r} is no half-width; it must be finite and >= 0")
        if not (math.isfinite(self.min_dwell_s) and self.min_dwell_s >= 0.0):
            raise DomainError(f"hybrid car: min_dwell_s = {self.min_dwell_s!r} must be finite and >= 0")
        if self.memory is Memory.TRACKING and not (self.throttle.gains.ki or self.brake.gains.ki):
            raise DomainError("hybrid car: TRACKING needs ki in one of the controllers; take HELD or RESET")

    @property
    def lines(self) -> SwitchingLines:
        """Where the modes take turns."""
        return SwitchingLines.of(self.eps)

    def line(self, mode: Mode) -> Threshold:
        """The line on which a mode is left for the other one."""
        return self.lines.up if mode is Mode.THROTTLE else self.lines.down

    def loop(self, mode: Mode) -> ModeLoop:
        """The loop of a mode."""
        return self.throttle if mode is Mode.THROTTLE else self.brake


@dataclass(frozen=True)
class Corner:
    """From here on r = value + slope_per_s (t - time_s), until the next corner; r may jump."""

    time_s: float
    value: float
    slope_per_s: float = 0.0


@dataclass(frozen=True)
class HybridStart:
    """The car's state at t = 0.

    Args:
        output: y.
        mode: the active mode; left at once where (1) demands it.
        control: the active controller's demand, by its integrator; None: its memory is 0.  The other's is always 0.
    """

    output: float = 0.0
    mode: Mode = Mode.THROTTLE
    control: float | None = None

    def __post_init__(self) -> None:
        for name in ("output", "control"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise DomainError(f"start: {name} = {value!r} must be a finite number")


@dataclass(frozen=True)
class Watch:
    """Conditions that end a run early.

    Args:
        most_jumps: more of them than this ...
        window_s: ... within this time are CHATTERING.
        most_output: an output beyond it has DIVERGED.
    """

    most_jumps: int = 20
    window_s: float = 0.2
    most_output: float = 1e6

    def __post_init__(self) -> None:
        if not (self.most_jumps >= 1 and 0.0 < self.window_s < math.inf and 0.0 < self.most_output < math.inf):
            raise DomainError(f"{self}: all three must be finite and greater than 0")


@dataclass(frozen=True)
class Event:
    """One jump; y is kept.

    Args:
        time_s: when.
        before, after: the modes.
        output: y.
        reference: r, just after a corner if there is one.
    """

    time_s: float
    before: Mode
    after: Mode
    output: float
    reference: float


@dataclass(frozen=True)
class HybridResponse:
    """One run; arrays of shape (m,) for the requested times up to `reached_s`, values just after events.

    Args:
        time_s: s.
        output: y.
        rate: y', output unit per s.
        control: the active plant's input, within its limits.
        error: r - y.
        mode: 1 or 2.
        events: all jumps in order.
        outcome: how the run ended.
        reason: one sentence; with time and mode, if not FINISHED.
        reached_s: the end of the run, s.
    """

    time_s: Array
    output: Array
    rate: Array
    control: Array
    error: Array
    mode: np.ndarray
    events: tuple[Event, ...]
    outcome: HybridOutcome
    reason: str
    reached_s: float


def checked_reference(reference: Sequence[Corner], end_s: float) -> tuple[Corner, ...]:
    """The corners, checked to be a reference from 0 to `end_s`.

    Raises:
        DomainError: none, the first not at 0, times that do not increase, or a number that is not finite.
    """
    if not (math.isfinite(end_s) and end_s > 0.0):
        raise DomainError(f"end_s = {end_s!r} must be finite and greater than 0")
    if not reference:
        raise DomainError("the reference is empty; give at least Corner(0.0, value)")
    for i, corner in enumerate(reference):
        if not all(math.isfinite(number) for number in (corner.time_s, corner.value, corner.slope_per_s)):
            raise DomainError(f"reference[{i}] = {corner} has a number that is not finite")
        if i == 0 and corner.time_s != 0.0:
            raise DomainError(f"reference[0] starts at {corner.time_s!r} s; the first corner must be at 0")
        if i and not corner.time_s > reference[i - 1].time_s:
            raise DomainError(f"reference[{i}] at {corner.time_s!r} s does not come after the corner before; sort them")
    return tuple(reference)


def checked_samples(times_s: Sequence[float] | Array, end_s: float) -> Array:
    """The times, checked to be increasing within [0, end_s].

    Raises:
        DomainError: not finite, not increasing, or outside.
    """
    times = np.array(times_s, dtype=float)
    if times.ndim != 1 or not np.all(np.isfinite(times)):
        raise DomainError("times_s must be a list of finite times")
    if np.any(np.diff(times) <= 0.0):
        raise DomainError("times_s must increase; sort them and leave out doubles")
    if len(times) and not (times[0] >= 0.0 and times[-1] <= end_s):
        raise DomainError(f"times_s must lie in [0, {end_s!r}]; they reach from {times[0]!r} to {times[-1]!r}")
    return times
