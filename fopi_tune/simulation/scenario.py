"""Inputs and results of a sampled simulation:  signals, sensor, actuator, switching; traces, measures.

At sample k, in this order:

    y_m = quantised(y + noise_std n_k)                                                                               (1)
    mode 1 -> 2 when y_m >= r + eps,   2 -> 1 when y_m <= r - eps, or at other `SwitchingLines`                      (2)
    u = the controller's output for e = r - y_m, by `fopi_tune.digital.runtime`                                      (3)
    applied = the last one moved towards u by at most rate Ts; u itself where it is within reach                     (4)

and the plant runs to sample k + 1 under `applied`, delayed, plus the load.  Its states below `Precision.flush_below`
become 0, as the controller's do: at rest they would stay subnormal numbers, which are slow.  Two modes may have a
standstill: with y' = p y + g (u + w) the output of such a mode's plant does not go below 0, and stays there while
g (u + w) < h.

Source: definitions of the spec's words.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.switching_lines import SwitchingLines
from fopi_tune.core.terms.feedforward import Fed
from fopi_tune.core.text_tables.words import counted
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError

#: shares of a step between which the output rises
_RISE = (0.1, 0.9)
#: (begin, end) -> plants of the indices begin to end - 1
PlantSupplier = Callable[[int, int], Plants]


class InitialInput(Enum):
    """The plant's input before the first sample."""

    REST = "rest"  # the input that holds the plant at its initial output
    FREE = "free"  # no input: a plant of first order starts at its initial output and decays


class InactiveController(IntEnum):
    """What the controller of the inactive mode does."""

    HOLD = 0  # nothing: its states are kept
    TRACK = 1  # tracks the applied control, within its own limits
    RESET = 2  # is reset when its mode is entered

    @classmethod
    def of(cls, memory: Memory) -> InactiveController:
        """What keeps this memory."""
        return {Memory.HELD: cls.HOLD, Memory.TRACKING: cls.TRACK, Memory.RESET: cls.RESET}[memory]


@dataclass(frozen=True, eq=False)
class Signals:
    """External signals, one value per sample, the same for every plant.

    Args:
        reference: r_k, shape (steps,), in the output's unit.
        load: w_k, shape (steps,), added to the control at the plant's input from t_k on; None: 0.

    Raises:
        DomainError: no sample, different lengths, or a value that is not finite.
    """

    reference: Array
    load: Array | None = None

    def __post_init__(self) -> None:
        for name, values in (("reference", self.reference), ("load", self.load)):
            if values is None:
                continue
            # a copy: the compiled function accepts one array type only
            signal = np.array(values, dtype=float)
            if signal.ndim != 1 or not len(signal) or not np.all(np.isfinite(signal)):
                raise DomainError(f"the {name} needs one finite number a sample; it has shape {signal.shape}")
            if len(signal) != len(self.reference):
                raise DomainError(f"the load has {counted(len(signal), 'sample')}, the reference {len(self.reference)}")
            object.__setattr__(self, name, signal)

    def __len__(self) -> int:
        return len(self.reference)


@dataclass(frozen=True)
class Sensor:
    """(1); the noise of a plant depends on the seed and the plant's index only.

    Args:
        quantum: quantisation step of the measurement, in the output's unit; 0: none; halves round to the even multiple.
        noise_std: standard deviation of the normal noise, in the output's unit.
        seed: 0 to 2^64 - 1.
    """

    quantum: float = 0.0
    noise_std: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not (0.0 <= self.quantum < math.inf and 0.0 <= self.noise_std < math.inf):
            raise DomainError(f"quantum {self.quantum!r} and noise_std {self.noise_std!r} must be finite and >= 0")
        if not 0 <= self.seed < 2**64:
            raise DomainError(f"seed {self.seed!r} must lie in 0 to 2^64 - 1")


@dataclass(frozen=True)
class Actuator:
    """(4); the controller does not know of it, unless it limits the rate of its output itself.

    Args:
        rate_per_s: fastest change of the control, per s; inf: any.
        delay_samples: computing delay of the control, whole or not.
    """

    rate_per_s: float = math.inf
    delay_samples: float = 0.0

    def __post_init__(self) -> None:
        if not self.rate_per_s > 0.0:
            raise DomainError(f"rate_per_s {self.rate_per_s!r} must be greater than 0; write inf for no limit")
        if not 0.0 <= self.delay_samples < math.inf:
            raise DomainError(f"delay_samples {self.delay_samples!r} must be finite and >= 0")


@dataclass(frozen=True)
class Start:
    """How the loop begins.

    Args:
        output: y just before the first sample.
        before: the plant's input until then.
        bumpless: whether the first controller is reset to that input; otherwise it starts from 0.
    """

    output: float = 0.0
    before: InitialInput = InitialInput.REST
    bumpless: bool = False

    def __post_init__(self) -> None:
        if not math.isfinite(self.output):
            raise DomainError(f"the initial output {self.output!r} must be a finite number")


@dataclass(frozen=True)
class Hybrid:
    """(2): two modes that share the output.  With a computing delay a mode travels with its control to the plant.

    At a jump the actuator's last value is cut to the new mode's limits before (4).  The last output of a controller
    that limits its rate is then the other one's, cut likewise, or what it tracked.  A measurement whose error is not
    finite causes none.

    While the modes coast, u is 0, the plant is that of the mode that was left last, and each controller's memory does
    what `inactive` says.  A mode that is entered from there is entered as from one whose last output was 0.

    Args:
        half_width: eps of the hysteresis, in the output's unit, or other lines.
        inactive: behaviour of the inactive controller.
        first: the mode at the start, 1 or 2.
        most_switches: more than these within the window is chattering.
        window_s: the window, s.
        min_dwell_samples: from one jump to the next at least; 0 and 1 are any.  The first mode may be left at once.
        fed: g and h/Ts of each mode's feed-forward of the setpoint; empty where there is none.
        hold_below: h of each mode's standstill, output unit per s, -inf for a mode without; empty where there is none.
        delay_samples: computing delay of each mode's control, in place of the actuator's; empty where that holds for
            both.  Of the controls that have arrived the one that was sent last acts.
    """

    half_width: float | SwitchingLines
    inactive: InactiveController = InactiveController.HOLD
    first: int = 1
    most_switches: int = 5
    window_s: float = 2.0
    min_dwell_samples: int = 0
    fed: tuple[Fed, ...] = ()
    hold_below: tuple[float, ...] = ()
    delay_samples: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        SwitchingLines.of(self.half_width)
        if self.first not in (1, 2):
            raise DomainError(f"the first mode {self.first!r} must be 1 or 2")
        if not (self.most_switches >= 1 and 0.0 < self.window_s < math.inf):
            raise DomainError("chattering needs most_switches >= 1 and a window_s greater than 0")
        if not self.min_dwell_samples >= 0:
            raise DomainError(f"min_dwell_samples {self.min_dwell_samples!r} must be a whole number of at least 0")

    @property
    def lines(self) -> SwitchingLines:
        """Where the modes take turns."""
        return SwitchingLines.of(self.half_width)


@dataclass(frozen=True)
class Mode:
    """A controller and the plants it acts on, one loop a plant; a hybrid loop has two of them.

    Args:
        controller: in float64.
        plants: m plants, or a function that gives those of an index range.
    """

    controller: Runtime
    plants: Plants | PlantSupplier

    def __post_init__(self) -> None:
        if self.controller.precision is not Precision.FLOAT64:
            raise DomainError("simulations compute in float64; round the controller to float64")


@dataclass(frozen=True)
class Scenario:
    """Everything but controllers and plants.

    Args:
        sample_time_s: Ts.
        signals: reference and load.
        sensor: quantisation and noise.
        actuator: rate limit and delay.
        start: initial output.
        hybrid: how two modes switch; None with one mode.
    """

    sample_time_s: float
    signals: Signals
    sensor: Sensor = field(default_factory=Sensor)
    actuator: Actuator = field(default_factory=Actuator)
    start: Start = field(default_factory=Start)
    hybrid: Hybrid | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.sample_time_s < math.inf:
            raise DomainError(f"sample_time_s {self.sample_time_s!r} must be finite and greater than 0")

    @property
    def first_mode(self) -> int:
        """The mode at the start; 1 where there is only one."""
        return self.hybrid.first if self.hybrid else 1


@dataclass(frozen=True)
class Step:
    """A step or ramp of the reference, or of the load, judged from its own beginning to the next one.

    Args:
        first: the first sample that sees it.
        at_s: its beginning, s.
        before: the reference before it, in the output's unit; equal to `value`: there is no step.
        value: the reference at its end.
        band: half-width around `value` that counts as settled, in the output's unit.
        of_load: whether it is the load that changes; the reference is then the last step's.
    """

    first: int
    at_s: float
    before: float
    value: float
    band: float
    of_load: bool = False

    def __post_init__(self) -> None:
        if not (0.0 <= self.band < math.inf and self.first >= 0):
            raise DomainError(f"band {self.band!r} and first sample {self.first!r} must be finite and >= 0")

    @property
    def direction(self) -> float:
        """1 upwards, -1 downwards, 0 without a step."""
        return float(np.sign(self.value - self.before))

    @property
    def rise_levels(self) -> tuple[float, float]:
        """Where a rise begins and where it ends, a tenth and nine tenths of the step, in the output's unit."""
        size = self.value - self.before
        return self.before + _RISE[0] * size, self.before + _RISE[1] * size


@dataclass(frozen=True)
class Horizon:
    """The samples over which measures are taken, and the steps that are judged.

    Args:
        band: half-width around the final reference that counts as settled, in the output's unit.
        first: the first sample that counts.
        steps: in the order of their first samples, the first one of the reference or no step; none: one, from the
            reference before the horizon to the last one, with this band.
    """

    band: float
    first: int = 0
    steps: tuple[Step, ...] = ()

    def __post_init__(self) -> None:
        if not (0.0 <= self.band < math.inf and self.first >= 0):
            raise DomainError(f"band {self.band!r} and first sample {self.first!r} must be finite and >= 0")

    def steps_of(self, scenario: Scenario) -> tuple[Step, ...]:
        """The steps that are judged, at least one."""
        if self.steps:
            return self.steps
        reference, first = scenario.signals.reference, self.first
        before = float(reference[first - 1]) if first else scenario.start.output
        return (Step(first, scenario.sample_time_s * first, before, float(reference[-1]), self.band),)


@dataclass(frozen=True, eq=False)
class Traces:
    """Signals of every plant; arrays of shape (m, steps).

    Args:
        time_s: of the samples, shape (steps,).
        output: y just before the new control acts.
        rate: dy/dt there, per s, without the jumps of a direct path.
        rate_after: dy/dt just after a new input arrives, at the sample or between samples; where control and load
            arrive at different times, the larger of the two.
        measured: y_m, the controller's input.
        error: r - y_m.
        demanded: the controller's output.
        applied: the actuator's output from this sample on, undelayed.
        mode: 1 or 2; 0 while both outputs rest.
    """

    time_s: Array
    output: Array
    rate: Array
    measured: Array
    error: Array
    demanded: Array
    applied: Array
    mode: NDArray[np.int64]
    rate_after: Array


@dataclass(frozen=True, eq=False)
class Measures:
    """One number a plant, shape (m,), over the samples of a `Horizon`; y at the samples.

    Overshoot, undershoot, settling time, rise time and final error are the worst of the horizon's steps, each over the
    samples from its first to the one before the next step's.  Where an output did not stay finite the measures are nan,
    its settling and rise time inf.

    Args:
        peak_rate: largest |dy/dt| just before and after the samples, and just after an input arrives between them.
        peak_jerk: largest |y_k - 2 y_(k-1) + y_(k-2)|/Ts^2 of three samples that count; 0 where there are fewer.
        overshoot: largest y - value in the step's direction; negative when y stays short of it; without a step, largest
            |y - value|.  A step of the load goes on with the direction of the reference's last one.
        undershoot: largest before - y in the step's direction, at least 0: how far the output goes back beyond the
            reference before the step; 0 without a step.  A step of the load goes on with the direction and the value
            before of the reference's last one.
        settling_s: from the step to the first sample after which y stays within the band; inf: it does not.  A step of
            the load that comes before y is within the band goes on with the time of the step before.
        rise_s: from where the output first reaches a tenth of a step of the reference to where it first reaches nine
            tenths, each on the straight line between two samples, or at the step's first sample where it is beyond
            already; inf: it does not before the reference's next step; 0 without a step.
        iae: Ts sum |r - y|.
        ise: Ts sum (r - y)^2.
        saturated_s: time with the controller's output at a limit; the last sample's acts after the end.
        peak_control: largest |applied|.
        switches: number of jumps, over all samples.
        longest_run: of jumps at consecutive samples, over all samples.
        chattering: whether too many jumps fell within the window of `Hybrid`, over all samples.
        final_error: r - y at the last sample before the reference's next step, or the end.
        finite: whether output and rate stayed finite.
    """

    peak_rate: Array
    peak_jerk: Array
    overshoot: Array
    undershoot: Array
    settling_s: Array
    rise_s: Array
    iae: Array
    ise: Array
    saturated_s: Array
    peak_control: Array
    switches: NDArray[np.int64]
    longest_run: NDArray[np.int64]
    chattering: NDArray[np.bool_]
    final_error: Array
    finite: NDArray[np.bool_]
