"""The JSON of results about one loop:  designs, checks of given gains, digital controllers, runs and trade-offs."""

from typing import Literal, NotRequired, TypedDict

from fopi_tune.core.margins import Margins
from fopi_tune.digital.implementation import StepCost
from fopi_tune.digital.realise import Form, Precision
from fopi_tune.optimum.results import OptimumStatus
from fopi_tune.quantities.requirement import Relation, Scope
from fopi_tune.results.schema.parts import (
    Clash,
    Gains,
    ProofEntry,
    RequirementEntry,
    ScenarioRequirement,
    StabilityEntry,
    StampEntry,
)
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DigitalSpec

Judged = Literal["met", "violated", "undecided"]


class OptimumParts(TypedDict):
    """What is proved of the best gains.

    Args:
        status: how far the proof came.
        statement: what is proved.
        advice: what to do.
        gap: relative distance of the bound from the gains' objective; null without a bound.
        wanted_gap: the same that was asked for.
        bound: that no gains beat, in the objective's unit.
        objective: of the gains, in its unit.
        gains: that the bound is compared with.
        better_gains: that were met with on the way.
        better_objective: of those, in the objective's unit.
        boxes: of gains that were looked at.
        discarded_boxes: in the proof.
        left_out: requirements that the bound does not use.
        reason: why the gap is not reached; empty where it is.
    """

    status: OptimumStatus
    statement: str
    advice: str
    gap: float | None
    wanted_gap: float
    bound: float | None
    objective: float | None
    gains: Gains | None
    better_gains: Gains | None
    better_objective: float | None
    boxes: int
    discarded_boxes: int
    left_out: list[str]
    reason: str


class OptimumSummary(OptimumParts):
    """The same in the result of a design.

    Args:
        seconds: that it took, s.
    """

    seconds: float


class DesignDocument(TypedDict):
    """What `fopi tune` finds.

    Args:
        schema: version of this JSON; it may only grow.
        status: how it ended.
        gains: of an infeasible spec those with the least relaxation; null where there are none.
        objective: of the gains, in its public unit.
        requirements: on the frequency response, in the order of the spec.
        stamp: provenance.
        name: of the spec.
        loop: which one the requirements are about.
        objective_quantity: the objective in words.
        message: why, in words; empty when solved.
        advice: what to do.
        stability: of the family; null without gains.
        nominal: margins with the nominal plant, null without gains; a margin that is null is infinite of a stable loop.
        proof: the certificate in short.
        scenario_requirements: on measures of scenarios, in the order of the spec.
    """

    schema: Literal[1]
    status: Status
    gains: Gains | None
    objective: float | None
    requirements: list[RequirementEntry]
    stamp: StampEntry
    name: str
    loop: Literal["continuous", "sampled"]
    objective_quantity: str
    message: str
    advice: str
    steady_state_error: float | None
    gap: float | None
    notes: list[str]
    stability: StabilityEntry | None
    nominal: Margins | None
    clash: list[Clash]
    proof: ProofEntry
    scenario_requirements: NotRequired[list[ScenarioRequirement]]
    optimum: NotRequired[OptimumSummary]


class CheckDocument(TypedDict):
    """What `fopi prove` says of given gains.

    Args:
        schema: version of this JSON; it may only grow.
        status: the verdict.
        gains: that were given.
        objective: of the gains, in its public unit.
        requirements: on the frequency response, in the order of the spec.
        stamp: provenance.
        name: of the spec.
        loop: which one the requirements are about.
        objective_quantity: the objective in words.
        tolerance: by which a requirement may be missed, neper or radian; of a delay margin relative.
        notes: what to know besides.
        stability: of the family.
        nominal: margins with the nominal plant; a margin that is null is infinite of a stable loop.
        proof: the certificate in short.
        scenario_requirements: on measures of scenarios, in the order of the spec.
    """

    schema: Literal[1]
    status: Judged
    gains: Gains
    objective: float | None
    requirements: list[RequirementEntry]
    stamp: StampEntry
    name: str
    loop: Literal["continuous", "sampled"]
    objective_quantity: str
    tolerance: float
    notes: list[str]
    stability: StabilityEntry | None
    nominal: Margins | None
    proof: ProofEntry
    scenario_requirements: NotRequired[list[ScenarioRequirement]]


class Section(TypedDict):
    """A first-order section, residue/(z - pole).

    Args:
        pole: dimensionless.
        residue: control unit per output unit.
    """

    pole: float
    residue: float


class DerivativeParts(TypedDict):
    """What acts on the measurement alone.

    Args:
        acts_on: its input.
        direct: control unit per output unit.
        pole: of a PID's one section.
        residue: of that section.
        sections: of several.
    """

    acts_on: Literal["-measurement"]
    direct: float
    pole: NotRequired[float]
    residue: NotRequired[float]
    sections: NotRequired[list[Section]]


class Filter(TypedDict):
    """The controller as a sum.

    Args:
        form: the sum in words.
        direct: control unit per output unit.
        sections: of first order.
        derivative: the part of the sum that acts on the measurement alone.
    """

    form: str
    direct: float
    sections: list[Section]
    derivative: NotRequired[DerivativeParts]


class MeasurementFilterEntry(TypedDict):
    """The measurement's filter, which comes before the sum.

    Args:
        acts_on: its input.
        order: 1 or 2.
        time_constant_s: s.
        rule: from s to z.
        share: of the new measurement, dimensionless.
        damping: of order 2, dimensionless.
    """

    acts_on: Literal["measurement"]
    order: int
    time_constant_s: float
    rule: str
    share: float
    damping: NotRequired[float]


class FilterError(TypedDict):
    """How exact the filter is.

    Args:
        up_to_rad_s: rad/s.
        largest_relative: of the response, dimensionless.
    """

    up_to_rad_s: float
    largest_relative: float


class RealisationEntry(TypedDict):
    """The controller in one layout and precision.

    Args:
        form: the layout.
        precision: of all numbers.
        relative_error: of the largest output over a seeded noisy step; null where it diverges.
        stable: whether it is.
        coefficients: a row a section; its numbers are in the layout's own order.
    """

    form: Form
    precision: Precision
    relative_error: float | None
    stable: bool
    coefficients: list[list[float]]


class ControllerParts(TypedDict):
    """A digital controller.

    Args:
        digital: the spec's section, with defaults filled in.
        controller: the filter of the error.
        measurement_filter: without one there is no entry.
        band_note: where the filter's band does not suit the loop.
        errors: against the ideal controller, up to rising frequencies.
        errors_of_terms: the same by term.
        accurate_rad_s: the frequencies between which the error is at most 5 %, rad/s; null without any.
        realisations: as they are exported.
    """

    digital: DigitalSpec
    controller: Filter
    measurement_filter: NotRequired[MeasurementFilterEntry]
    band_note: NotRequired[str]
    errors: list[FilterError]
    errors_of_terms: NotRequired[dict[str, list[FilterError]]]
    accurate_rad_s: tuple[float, float] | None
    realisations: list[RealisationEntry]


class DigitalDocument(CheckDocument, ControllerParts):
    """What `fopi discretize` makes and says of it.

    Args:
        setpoint_weight: b in kp (b r - y), dimensionless; 1 where left out.
        cost_of_step: of a sample of the exported code.
    """

    setpoint_weight: NotRequired[float]
    cost_of_step: StepCost


class RunDocument(DesignDocument):
    """What `fopi run --json` prints.

    Args:
        digital: as in digital.json; null without one.
        digital_problem: why it cannot be made; empty otherwise.
    """

    digital: DigitalDocument | None
    digital_problem: str


class MovedRequirement(TypedDict):
    """The requirement whose limit is moved.

    Args:
        number: in the spec, from 1.
        end: of a `between`: `lower` or `upper`.
        name: its quantity or measure.
        relation: what its value is compared by.
        on: the family, or the nominal plant.
        scenario: of a measure; null: all.
        from_rad_s: lower end of its band, rad/s; null: from 0.
        to_rad_s: upper end, rad/s; null: no end.
    """

    number: int
    end: Literal["lower", "upper"] | None
    name: str
    relation: Relation
    on: Scope
    scenario: NotRequired[str | None]
    from_rad_s: NotRequired[float | None]
    to_rad_s: NotRequired[float | None]


class PointEntry(TypedDict):
    """The best gains with one limit.

    Args:
        limit: in the quantity's unit.
        status: `met` only after the verification.
        objective: in its public unit; null unless met.
        gains: of a refused point the refused ones; null when infeasible.
        largest_score: of all requirements, dimensionless.
        binds: whether the limit is active.
    """

    limit: float
    status: Literal["met", "infeasible", "refused"]
    objective: float | None
    gains: Gains | None
    largest_score: float | None
    binds: bool


class EndEntry(TypedDict):
    """Where the limit can no longer be met.

    Args:
        side: of the spec's own limit.
        last_feasible: the farthest limit that was met, in the quantity's unit.
        first_infeasible: the nearest that is met from no start; null where all that were tried are met.
    """

    side: Literal["above", "below"]
    last_feasible: float
    first_infeasible: float | None


class TradeoffDocument(TypedDict):
    """What `fopi tune --tradeoff` finds.

    Args:
        schema: version of this JSON; it may only grow.
        status: `failed` where the verification refused a point.
        name: of the spec.
        requirement: the one that is moved.
        objective_quantity: the objective in words.
        own: the point at the spec's limit.
        points: the sweep, by rising limit.
        ends: of the directions that were searched.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Literal["solved", "failed"]
    name: str
    requirement: MovedRequirement
    objective_quantity: str
    own: PointEntry
    points: list[PointEntry]
    ends: list[EndEntry]
    stamp: StampEntry
