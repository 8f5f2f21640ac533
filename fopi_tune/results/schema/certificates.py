"""The JSON of certificates, which `fopi prove --recheck` tests again."""

from typing import Literal, NotRequired, TypedDict

from fopi_tune.proof.verdict import Verdict
from fopi_tune.quantities.requirement import Relation, Scope
from fopi_tune.results.schema.parts import Gains, Plant

Matrix = list[list[float]]
Side = Literal["at_most", "at_least"]


class ParameterEntry(TypedDict):
    """An uncertain number of a plant.

    Args:
        name: as the spec has it, with its unit.
        nominal: in that unit.
        min: in that unit.
        max: in that unit.
    """

    name: str
    nominal: float
    min: float
    max: float


class Term(TypedDict):
    """A term of a polynomial in the plant's parameters.

    Args:
        coefficient: a rational number, as text.
        powers: of the parameters, in their order.
    """

    coefficient: str
    powers: list[int]


class Polynomial(TypedDict):
    """A polynomial in the plant's parameters.

    Args:
        terms: whose sum it is.
    """

    terms: list[Term]


class PlantEntry(TypedDict):
    """A family of plants.

    Args:
        model: as the spec has it.
        parameters: in the model's order.
        numerator_orders: of a fractional plant, dimensionless.
        denominator_orders: likewise.
        numerator: coefficients of a plant by named parameters, in descending powers of s.
        denominator: likewise.
        dead_time_s: of such a plant, s.
    """

    model: str
    parameters: list[ParameterEntry]
    numerator_orders: NotRequired[list[float]]
    denominator_orders: NotRequired[list[float]]
    numerator: NotRequired[list[Polynomial]]
    denominator: NotRequired[list[Polynomial]]
    dead_time_s: NotRequired[Polynomial]


class ImplementationEntry(TypedDict):
    """The digital controller that a certificate is about.

    Args:
        sample_time_s: s.
        delay_samples: computing delay, in samples.
        direct: control unit per output unit.
        poles: of the sections, dimensionless.
        residues: of the sections, in the unit of `direct`.
    """

    sample_time_s: float
    delay_samples: float
    direct: float
    poles: list[float]
    residues: list[float]


class RecordEntry(TypedDict):
    """A list of boxes.

    Args:
        tokens: how the axes are cut, box after box.
        boxes: how many they are.
    """

    tokens: str
    boxes: int


class CertifiedStability(TypedDict):
    """Stability of the family.

    Args:
        verdict: of the family.
        sensitivity_at_most_neper: bound of |S| over the family, neper; null without one.
        plant: whose closed loop's poles are counted, by its numbers' names, in the spec's units.
        point: the same in the order of the uncertain numbers.
        unstable_poles: of that loop; null where they could not be counted.
        records: boxes of the bound.
        reason: in words.
        member: of a list of plants, the one that decides.
    """

    verdict: Verdict
    sensitivity_at_most_neper: float | None
    plant: Plant
    point: list[float]
    unstable_poles: int | None
    records: NotRequired[list[RecordEntry]]
    reason: str
    member: NotRequired[str]


class SideEntry(TypedDict):
    """One limit of a requirement.

    Args:
        side: of the limit.
        verdict: of this limit.
        level_natural: that is shown for the family, in natural units (neper, radian, s).
        witness_natural: that a plant reaches, in natural units.
        witness: the same in the quantity's unit.
        omega_rad_s: where, rad/s; null where no single frequency decides.
        omega_tends_to_infinity: whether the frequency is a limit.
        plant: by its numbers' names, in the spec's units.
        point: the same in the order of the uncertain numbers.
        records: boxes of the bound.
        witness_records: boxes of the witness.
        member: of a list of plants, the one that decides.
    """

    side: Side
    verdict: Verdict
    level_natural: float | None
    witness_natural: float | None
    witness: float | None
    omega_rad_s: float | None
    omega_tends_to_infinity: bool
    plant: Plant
    point: list[float]
    records: NotRequired[list[RecordEntry]]
    witness_records: NotRequired[list[RecordEntry]]
    member: NotRequired[str]


class CertifiedRequirement(TypedDict):
    """A requirement with its proof.

    Args:
        name: the quantity, with its unit.
        relation: what its value is compared by.
        limits: in the quantity's unit; two of `between`.
        limit_at_to_rad_s: of a limit that is a line over log omega, its value at the upper end.
        on: the family, or the nominal plant.
        from_rad_s: lower end of its band, rad/s.
        to_rad_s: upper end, rad/s; null: no end.
        verdict: of the requirement.
        proved_from: lower bound of the value, in the quantity's unit; null without one.
        proved_to: upper bound, likewise.
        relative_gap: dimensionless distance of bound and witness; null without both.
        reason: in words; empty where it is proved.
        sides: each limit.
    """

    name: str
    relation: Relation
    limits: list[float]
    limit_at_to_rad_s: NotRequired[float]
    on: Scope
    from_rad_s: float
    to_rad_s: float | None
    verdict: Verdict
    proved_from: float | None
    proved_to: float | None
    relative_gap: float | None
    reason: str
    sides: list[SideEntry]


class CertifiedScenario(TypedDict):
    """A scenario as a spec has it; times in s, signals in the output's or the control's unit.

    Args:
        name: of the scenario.
        duration_s: s.
        reference: [at_s, value, ramp_s] of each change.
        load: likewise.
        initial_output: output unit.
        before: what the plant's input was.
        bumpless: whether the controller starts at that input.
        rate_per_s: fastest change of the control, per s; null: any.
        settling_band: output unit; null: 2 % of each step.
        judged_from_s: s.
    """

    name: str
    duration_s: float
    reference: list[tuple[float, float, float]]
    load: list[tuple[float, float, float]]
    initial_output: float
    before: Literal["rest", "free"]
    bumpless: bool
    rate_per_s: float | None
    settling_band: float | None
    judged_from_s: float


class TimeDomainProofEntry(TypedDict):
    """A limit of a measure over the family.

    Args:
        measure: with its unit where that is not the output's.
        relation: what its value is compared by.
        limit: in the measure's unit.
        scenario: its name.
        verdict: of this limit.
        tolerance: by which it may be missed, relative.
        bound: that is shown, in the measure's unit; null unless proved.
        plant: that refutes it, by its numbers' names; null unless refuted.
        time_s: when, s.
        value: that it reaches, in the measure's unit.
        boxes: of uncertain numbers: lower and upper ends, axis after axis.
    """

    measure: str
    relation: Relation
    limit: float
    scenario: str
    verdict: Verdict
    tolerance: float
    bound: float | None
    plant: Plant | None
    time_s: float | None
    value: float | None
    boxes: list[list[float]]


class ScenarioProofEntry(TypedDict):
    """The proof of a requirement on a scenario.

    Args:
        requirement: index among those on scenarios, from 0.
        scenario: that is run.
        measurement_unit: of the output.
        output_limits: of the control, in its unit, lower first; null: none.
        most_change: of the control from sample to sample, in its unit.
        acts_on_error: false of a controller that acts on more than r - y, of which nothing is shown.
        proof: what is shown.
    """

    requirement: int
    scenario: CertifiedScenario
    measurement_unit: str
    output_limits: list[float | None]
    most_change: NotRequired[float]
    acts_on_error: NotRequired[bool]
    proof: TimeDomainProofEntry


class DecayEntry(TypedDict):
    """A quadratic function of the state that falls from sample to sample.

    Args:
        matrix: its lower triangle, row by row.
        multiplier: of the sector of the limits, dimensionless.
        decay: factor of its square root per sample, between 0 and 1.
    """

    matrix: Matrix
    multiplier: float
    decay: float


class CertifiedLimits(TypedDict):
    """The loop with the limits of its control.

    Args:
        output_limits: of the control, in its unit, lower first.
        most_change: of the control from sample to sample, in its unit.
        decays: null where nothing is shown.
        statement: what is meant.
    """

    output_limits: list[float]
    most_change: NotRequired[float]
    decays: DecayEntry | None
    statement: str


class MemberEntry(TypedDict):
    """A plant of a list.

    Args:
        name: of the plant.
        certificate: of it alone.
    """

    name: str
    certificate: "CertificateDocument"


class CertificateDocument(TypedDict):
    """The proof or refutation of gains, with all its boxes.

    Args:
        schema: version of this JSON; it may only grow.
        kind: of the file.
        name: of the spec.
        verdict: of everything.
        spec_sha256: of the spec's bytes.
        tolerance: by which a requirement may be missed, neper or radian; of a delay margin relative.
        gains: of the controller.
        plant: the family; not of a list.
        origin_log_rad_s: ln of the frequency that boxes are counted from, of rad/s.
        implementation: of a loop on samples.
        stability: of the family.
        requirements: on the frequency response, in the order of the spec.
        scenarios: requirements on measures of scenarios.
        with_limits: of a controller with limits.
        plants: of a list, each with its certificate.
        versions: of what the ball arithmetic ran with.
        digest: SHA-256 of everything else here.
    """

    schema: Literal[2]
    kind: Literal["fopi_tune certificate"]
    name: str
    verdict: Verdict
    spec_sha256: str
    tolerance: float
    gains: Gains
    plant: NotRequired[PlantEntry]
    origin_log_rad_s: NotRequired[float]
    implementation: NotRequired[ImplementationEntry]
    stability: CertifiedStability
    requirements: list[CertifiedRequirement]
    scenarios: NotRequired[list[ScenarioProofEntry]]
    with_limits: NotRequired[CertifiedLimits]
    plants: NotRequired[list[MemberEntry]]
    versions: dict[str, str]
    digest: str
