"""Parts of results' JSON that several of them have.

Numbers are in the public unit that their name ends with; a requirement's value and limit are in its quantity's, which
ends its `name` the same way.  What is infinite or missing is null.
"""

from typing import Literal, NotRequired, TypedDict

from fopi_tune.proof.verdict import Verdict
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.quantities.requirement import Relation, Scope

#: a plant's uncertain numbers by name, in the spec's units
Plant = dict[str, float]


class Gains(TypedDict):
    """A controller's numbers.

    Args:
        kp: control unit per output unit.
        ki: in kp's unit times (rad/s)^alpha.
        alpha: order of the integral, dimensionless.
        kd: in kp's unit times s^mu.
        derivative_filter_time_constant_s: of the derivative, s.
        mu: order of the derivative, dimensionless.
        measurement_filter_order: 1 or 2.
        measurement_filter_time_constant_s: s.
        setpoint_weight: b, dimensionless, where it was designed.
    """

    kp: float
    ki: float
    alpha: float
    kd: NotRequired[float]
    derivative_filter_time_constant_s: NotRequired[float]
    mu: NotRequired[float]
    measurement_filter_order: NotRequired[int]
    measurement_filter_time_constant_s: NotRequired[float]
    setpoint_weight: NotRequired[float]


class StampEntry(TypedDict):
    """Provenance.

    Args:
        spec_sha256: of the bytes of the spec's or the system's file.
        versions: distribution to version.
        python: version of the interpreter.
        platform: operating system and machine.
        solver: what found the gains; null where nothing was solved.
        seed: of random numbers; null where none were drawn.
        digests: SHA-256 of the spec's parts by name; empty where the result depends on all of it.
        samples: how many plants were drawn, of which this is one.
        samples_file_sha256: of the file that the plants are listed in; null without one.
    """

    spec_sha256: str
    versions: dict[str, str]
    python: str
    platform: str
    solver: str | None
    seed: int | None
    digests: dict[str, str]
    samples: NotRequired[int]
    samples_file_sha256: NotRequired[str | None]


class PlaceEntry(TypedDict):
    """Where a value is the worst.

    Args:
        omega_rad_s: rad/s; null where no single frequency decides, or in a limit.
        plant: the uncertain numbers by name, in the spec's units.
        member: of a list of plants, the plant's name.
        limit: the frequency that is approached, where `omega_rad_s` is null.
    """

    omega_rad_s: float | None
    plant: Plant
    member: NotRequired[str]
    limit: NotRequired[Literal["omega -> 0", "omega -> inf"]]


class PriceEntry(TypedDict):
    """A multiplier checked by solving again.

    Args:
        limit: that was moved, in the quantity's unit.
        relaxed: objective per unit of the limit, from solving with it relaxed; null where it cannot be.
        tightened: the same with it tightened.
        agrees: whether both agree with the multiplier.
        kink: whether they differ, because the optimum has a kink there.
    """

    limit: float
    relaxed: float | None
    tightened: float | None
    agrees: bool
    kink: bool


class RequirementProofEntry(TypedDict):
    """What is proved of a requirement.

    Args:
        verdict: of the certificate; `checked` and `violated` of measured responses, of which there is none.
        proved_from: lower bound of the value over the family, in the quantity's unit; null where it has none.
        proved_to: upper bound, likewise.
        relative_gap: dimensionless distance of the bound from a value that a plant reaches.
        boxes: boxes in ball arithmetic.
        reason: why it is not proved; empty where it is.
    """

    verdict: Literal["proved", "refuted", "undecided", "checked", "violated"]
    proved_from: float | None
    proved_to: float | None
    relative_gap: float | None
    boxes: int
    reason: str


class RequirementEntry(TypedDict):
    """A requirement on the loop's frequency response.

    Args:
        name: the quantity, with its unit.
        relation: what its value is compared by.
        limit: in the quantity's unit; two of `between`, at the band's lower end of a line.
        limit_at_to_rad_s: of a limit that is a line over log omega, its value at the upper end.
        on: the family, or the nominal plant.
        from_rad_s: lower end of its band, rad/s; null: from 0.
        to_rad_s: upper end, rad/s; null: no end.
        achieved: the worst value, in the quantity's unit; null where there is none.
        achieved_at_worst: of a line, the value at the worst frequency.
        limit_at_worst: of a line, the limit there.
        outcome: of the verification in floating point; null without gains.
        met: whether it is met.
        score: dimensionless, at most 1 where it is met; null where there is none.
        worst: where it is the worst; null without gains.
        multiplier: by how much the objective gains for each unit of the limit; null where not known.
        multiplier_checked: null where that was not asked for.
        proof: null without gains or certificate.
    """

    name: str
    relation: Relation
    limit: float | list[float]
    limit_at_to_rad_s: NotRequired[float]
    on: Scope
    from_rad_s: NotRequired[float | None]
    to_rad_s: NotRequired[float | None]
    achieved: float | None
    achieved_at_worst: NotRequired[float | None]
    limit_at_worst: NotRequired[float]
    outcome: Outcome | None
    met: bool
    score: float | None
    worst: PlaceEntry | None
    multiplier: float | None
    multiplier_checked: PriceEntry | None
    proof: RequirementProofEntry | None


class DrawnEntry(TypedDict):
    """How many drawn plants meet something.

    Args:
        met: plants.
        total: plants.
        low: lower end of the share's exact interval, between 0 and 1.
        high: its upper end.
        confidence: of the interval, between 0 and 1.
    """

    met: int
    total: int
    low: float
    high: float
    confidence: float


class WorstScenario(TypedDict):
    """Where a measure is the worst.

    Args:
        scenario: its name.
        time_s: s; null where no time decides.
        plant: the uncertain numbers by name, in the spec's units.
    """

    scenario: str
    time_s: NotRequired[float | None]
    plant: Plant


class ScenarioRequirement(TypedDict):
    """A requirement on a measure of simulations.

    Args:
        name: the measure, with its unit where that is not the output's.
        relation: what its value is compared by.
        limit: in the measure's unit.
        scenario: the only one it is about; null: all.
        verdict: `checked` by simulation only; `open` without gains.
        achieved: the worst value, in the measure's unit.
        met: whether it is met.
        score: dimensionless, at most 1 where it is met.
        worst: null without gains.
        simulated_plants: by the verification.
        drawn: null where none were drawn.
        multiplier: as of a requirement on the frequency response.
        multiplier_checked: null where that was not asked for.
        proved_bound: of the measure over the family, in its unit; null where nothing is proved.
        why_checked: why it is not proved; null where it is.
    """

    name: str
    relation: Relation
    limit: float
    scenario: str | None
    verdict: Literal["proved", "checked", "violated", "open"]
    achieved: float | None
    met: bool
    score: float | None
    worst: WorstScenario | None
    simulated_plants: int | None
    drawn: DrawnEntry | None
    multiplier: float | None
    multiplier_checked: PriceEntry | None
    proved_bound: float | None
    why_checked: str | None


class StabilityEntry(TypedDict):
    """Stability of the family, in floating point.

    Args:
        stable: of every plant.
        peak_sensitivity_db: the largest |S|, dB; null of an unstable family.
        worst: closest to -1, or unstable.
        unstable_poles: of the worst plant's closed loop; null where they were not counted.
        reason: how it was found.
        undecided: whether it is open.
    """

    stable: bool
    peak_sensitivity_db: float | None
    worst: PlaceEntry
    unstable_poles: int | None
    reason: str
    undecided: NotRequired[bool]


class StabilityProofEntry(TypedDict):
    """What the certificate says of stability.

    Args:
        verdict: of the whole family.
        reason: why.
        member: of a list of plants, the one that decides.
    """

    verdict: Verdict
    reason: str
    member: NotRequired[str]


class LimitsProofEntry(TypedDict):
    """The loop with the limits of its control.

    Args:
        verdict: whether it is proved to settle from every state.
        output_limits: of the control, in its unit, lower first.
        most_change: of the control from sample to sample, in its unit.
        statement: what is meant.
        reason: why nothing is shown; empty where it is.
        decay_per_sample: factor of the distance per sample, between 0 and 1.
        half_life_s: s.
    """

    verdict: Literal["not_available", "proved"]
    output_limits: list[float]
    most_change: NotRequired[float]
    statement: str
    reason: str
    decay_per_sample: float | None
    half_life_s: float | None


class ProofEntry(TypedDict):
    """The certificate in short.

    Args:
        verdict: `checked` of measured responses, `not_attempted` without gains or on demand.
        reason: in words.
        tolerance: by which a requirement may be missed, neper or radian; of a delay margin relative.
        stability: of the family.
        with_limits: of a controller with limits.
        boxes: boxes in ball arithmetic.
        certificate_digest: SHA-256 that the certificate's file states.
    """

    verdict: Literal["proved", "refuted", "undecided", "checked", "not_attempted"]
    reason: str
    tolerance: NotRequired[float]
    stability: NotRequired[StabilityProofEntry]
    with_limits: NotRequired[LimitsProofEntry]
    boxes: NotRequired[int]
    certificate_digest: NotRequired[str]


class Clash(TypedDict):
    """A requirement that clashes with others.

    Args:
        requirement: index from 0; those on scenarios are counted after the others.
        name: its quantity or measure.
        relation: what its value is compared by.
        give: by how much relaxing this limit alone is enough, in its unit; null where that does not help.
        new_limit: the relaxed limit with which gains were found, in its unit.
    """

    requirement: int
    name: str
    relation: Relation
    give: float | None
    new_limit: float | None
