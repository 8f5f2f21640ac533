"""The JSON of a system's certificate, and of other results of systems of two modes."""

from typing import Literal, NotRequired, TypedDict

from fopi_tune.core.terms.feedforward import FeedForward
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.proof.switched.certificate import SystemVerdict
from fopi_tune.quantities.requirement import Relation
from fopi_tune.results.schema.certificates import DecayEntry, Matrix, PlantEntry
from fopi_tune.results.schema.loops import ControllerParts
from fopi_tune.results.schema.parts import DrawnEntry, Gains, Plant, RequirementEntry, StampEntry, WorstScenario
from fopi_tune.results.status import Relaxation, Status


class ThresholdEntry(TypedDict):
    """A line that does not move with the setpoint.

    Args:
        absolute: output unit.
    """

    absolute: float


class RunningDerivative(TypedDict):
    """A derivative as it runs, of a measurement y: -sum k (y - m), with m <- m + q (y - m).

    Args:
        gains: k, control unit per output unit.
        shares: q, dimensionless.
    """

    gains: list[float]
    shares: list[float]


class RuntimeEntry(TypedDict):
    """A mode's controller as it runs.

    Args:
        direct: control unit per output unit.
        poles: of the sections, dimensionless.
        residues: of the sections, in the unit of `direct`.
        weights: of the sections in the anti-windup, dimensionless.
        tracking_gain: of the anti-windup, dimensionless.
        limits: of the control, in its unit, lower first.
        most_change: of the control from sample to sample, in its unit.
        derivative: without one there is no entry.
        delay_samples: computing delay, in samples.
    """

    direct: float
    poles: list[float]
    residues: list[float]
    weights: list[float]
    tracking_gain: float
    limits: tuple[float, float]
    most_change: NotRequired[float]
    derivative: NotRequired[RunningDerivative]
    delay_samples: float


class ModeEntry(TypedDict):
    """A mode of a system.

    Args:
        name: of the mode.
        controller: as it runs.
        feedforward: without one there is no entry.
        hold_below_per_s: by which the output stays at 0, output unit per s.
        plant: its family.
        decays: of its loop alone; null where nothing is shown.
    """

    name: str
    controller: RuntimeEntry
    feedforward: NotRequired[FeedForward]
    hold_below_per_s: NotRequired[float]
    plant: PlantEntry
    decays: DecayEntry | None


class SettlingEntry(TypedDict):
    """The proof that the output settles.

    Args:
        setpoints: the least and the largest, output unit.
        samples: of the raising phase that are followed one by one.
        matrix: lower triangle of a quadratic function of the state, row by row.
        decay: factor per sample, between 0 and 1.
        undershoot: below the setpoint at most, output unit.
        overshoot: above it at most, output unit.
    """

    setpoints: tuple[float, float]
    samples: int
    matrix: Matrix
    decay: float
    undershoot: float
    overshoot: float


class CycleEntry(TypedDict):
    """A periodic orbit.

    Args:
        setpoint: output unit.
        plants: of each mode, by the numbers' names, in the specs' units.
        modes: which one is active, sample by sample.
        parts: at which limit the control is, sample by sample.
        attraction: lower triangle of a quadratic function that falls towards it; null where that is not shown.
        lowest: output, in its unit.
        highest: output, in its unit.
    """

    setpoint: float
    plants: list[Plant]
    modes: str
    parts: str
    attraction: Matrix | None
    lowest: float
    highest: float


class MemoryBoundsEntry(TypedDict, total=False):
    """Bounds of a controller's memory; empty where there are none.

    Args:
        samples: that are followed one by one.
        sections: of each section's state, control unit.
        total: of their sum, control unit.
    """

    samples: int
    sections: list[float]
    total: float


class BoundedEntry(TypedDict):
    """What stays bounded.

    Args:
        setpoints: the least and the largest, output unit.
        outputs: the least and the largest, output unit.
        memories: of each mode's controller.
    """

    setpoints: tuple[float, float]
    outputs: tuple[float, float]
    memories: list[MemoryBoundsEntry]


class SystemCertificateDocument(TypedDict):
    """What is proved of a system, with all its numbers.

    Args:
        kind: of the file.
        schema: version of this JSON; it may only grow.
        name: of the system.
        system_sha256: of its file's bytes.
        verdict: of the system.
        statements: what is proved, in sentences.
        assumptions: what that takes for granted.
        sample_time_s: s.
        hysteresis: half-width around the setpoint, output unit.
        thresholds: other lines by name, output unit above or below the setpoint.
        inactive: what the inactive controller remembers.
        min_dwell_samples: of each mode, in samples.
        shared: uncertain numbers that both plants have in common.
        modes: the raising one first.
        setpoints: that were asked for, output unit; null: as many as can be proved.
        settling: null unless proved.
        reason: why settling is not proved; empty where it is.
        cycles: that were found.
        bounded: null where nothing is shown.
        unbounded: what is not bounded; empty where everything is.
        versions: of what the ball arithmetic ran with.
        digest: SHA-256 of everything else here.
    """

    kind: Literal["fopi-tune system certificate"]
    schema: Literal[1]
    name: str
    system_sha256: str
    verdict: SystemVerdict
    statements: list[str]
    assumptions: list[str]
    sample_time_s: float
    hysteresis: NotRequired[float]
    thresholds: NotRequired[dict[str, float | ThresholdEntry]]
    inactive: Memory
    min_dwell_samples: NotRequired[int]
    shared: NotRequired[list[str]]
    modes: list[ModeEntry]
    setpoints: tuple[float, float] | None
    settling: SettlingEntry | None
    reason: str
    cycles: list[CycleEntry]
    bounded: BoundedEntry | None
    unbounded: str
    versions: dict[str, str]
    digest: str


class DrawnRequirementEntry(TypedDict):
    """A requirement on scenarios of a system, over pairs of plants that were drawn.

    Args:
        name: the measure, with its unit where that is not the output's.
        relation: what its value is compared by.
        limit: in the measure's unit.
        scenario: the only one it is about; null: all.
        verdict: by simulation.
        achieved: the worst value, in the measure's unit; null where not finite.
        met: whether every pair meets it.
        worst: the pair.
        drawn: how many pairs meet it.
    """

    name: str
    relation: Relation
    limit: float
    scenario: str | None
    verdict: Literal["checked", "violated"]
    achieved: float | None
    met: bool
    worst: WorstScenario
    drawn: DrawnEntry


class SystemDesignDocument(TypedDict):
    """What `fopi tune` finds for a system.

    Args:
        schema: version of this JSON; it may only grow.
        status: how it ended.
        name: of the system.
        gains: of each mode by name; null where no gains give stable loops.
        tuned: modes whose gains were designed.
        objective: of the worst pair, in the measure's unit; null without gains.
        objective_quantity: the objective in words.
        requirements: on scenarios.
        loops: requirements of each tuned mode's own loop, by its name.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Status
    name: str
    gains: dict[str, Gains] | None
    tuned: list[str]
    objective: float | None
    objective_quantity: str
    requirements: list[DrawnRequirementEntry]
    loops: dict[str, list[RequirementEntry]]
    clash: list[Relaxation]
    message: str
    notes: list[str]
    stamp: StampEntry


class SystemDigitalDocument(TypedDict):
    """What `fopi discretize` makes of a system.

    Args:
        schema: version of this JSON; it may only grow.
        status: nothing is judged.
        name: of the system.
        gains: of each mode by name.
        hysteresis: half-width around the setpoint, output unit.
        thresholds: other lines by name, output unit above or below the setpoint.
        feedforward: of each mode that has one, by name.
        inactive: what the inactive controller remembers.
        first: the mode that begins.
        min_dwell_s: of each mode, s.
        min_dwell_samples: the same in samples.
        modes: the digital controllers by the modes' names.
        notes: what to know besides.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Literal["made"]
    name: str
    gains: dict[str, Gains]
    hysteresis: NotRequired[float]
    thresholds: NotRequired[dict[str, float | ThresholdEntry]]
    feedforward: NotRequired[dict[str, FeedForward]]
    inactive: Memory
    first: str
    min_dwell_s: float
    min_dwell_samples: int
    modes: dict[str, ControllerParts]
    notes: list[str]
    stamp: StampEntry


class SystemProofDocument(TypedDict):
    """What `fopi prove` says of a system.

    Args:
        schema: version of this JSON; it may only grow.
        status: the verdict.
        name: of the system.
        gains: of each mode by name.
        inactive: what the inactive controller remembers.
        min_dwell_s: of each mode, s.
        measurement_unit: of the output.
        statements: what is proved, in sentences.
        stamp: provenance.
    """

    schema: Literal[1]
    status: SystemVerdict
    name: str
    gains: dict[str, Gains]
    inactive: Memory
    min_dwell_s: NotRequired[float]
    measurement_unit: str
    statements: list[str]
    stamp: StampEntry
