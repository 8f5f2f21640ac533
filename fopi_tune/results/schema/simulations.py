"""The JSON of simulations and of evidence from drawn plants, of a loop and of a system of two."""

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from fopi_tune.quantities.requirement import Relation
from fopi_tune.results.schema.parts import Gains, Plant, StampEntry
from fopi_tune.results.schema.records import FINITE
from fopi_tune.results.simulation import JudgedStep


class JudgedLimit(TypedDict):
    """A limit that a simulation is judged by.

    Args:
        name: the measure, with its unit where that is not the output's.
        relation: what its value is compared by.
        limit: in the measure's unit.
        met: null where that is not known.
    """

    name: str
    relation: Relation
    limit: float
    met: bool | None


class SimulatedScenario(TypedDict):
    """One scenario with one plant.

    Args:
        name: of the scenario.
        samples: rows of its CSV file.
        measures: by name, with the unit where that is not the output's; null where not finite.
        limits: of the spec for this scenario.
        chattering: whether modes switch faster than the system allows.
        switch_times_s: when the mode changed, s.
        accuracy: in continuous time the largest difference of the output to a coarser run, in its unit.
        outcome: of a system in continuous time, how the run ended.
        steps: of the reference or the load, which are judged one by one.
        worst_steps: measure to the index in `steps` of the one that counts.
        notes: what to know about the run.
        finite: whether the output stayed finite.
    """

    name: str
    samples: int
    measures: dict[str, float | None]
    limits: list[JudgedLimit]
    chattering: bool
    switch_times_s: list[float]
    accuracy: float | None
    outcome: str | None
    steps: list[Annotated[JudgedStep, FINITE]]
    worst_steps: dict[str, int]
    notes: list[str]
    finite: bool


class SimulationDocument(TypedDict):
    """What `fopi simulate` says of a loop.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether every limit is met.
        gains: what the controller approximates.
        name: of the spec.
        member: of a list of plants, the plant's name.
        plant: the uncertain numbers by name, in the spec's units.
        index: of the plant's draw; null where it is given by its numbers.
        exact: whether it is the loop in continuous time.
        left_out: what the loop has and this simulation has not.
        notes: what to know about all scenarios.
        scenarios: in the order of the spec.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Literal["met", "violated"]
    gains: Gains
    name: str
    member: NotRequired[str]
    plant: Plant
    index: int | None
    exact: bool
    left_out: str | None
    notes: list[str]
    scenarios: list[SimulatedScenario]
    stamp: StampEntry


class SystemSimulationDocument(TypedDict):
    """What `fopi simulate` says of a system.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether every limit is met; `chattering` where modes switch faster than the system allows.
        gains: of each mode by name.
        name: of the system.
        plant: the uncertain numbers, each after its mode's name and a dot, in the specs' units.
        index: of the draw; null for plants given by their numbers.
        exact: whether it is the system in continuous time.
        left_out: what the system has and this simulation has not.
        notes: what to know about all scenarios.
        scenarios: in the order of the system.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Literal["met", "violated", "chattering"]
    gains: dict[str, Gains]
    name: str
    plant: Plant
    index: int | None
    exact: bool
    left_out: str | None
    notes: list[str]
    scenarios: list[SimulatedScenario]
    stamp: StampEntry


class Share(TypedDict):
    """How many plants meet something, with an exact interval.

    Args:
        met: plants.
        total: plants.
        low: lower end of the share's interval, between 0 and 1.
        high: its upper end.
    """

    met: int
    total: int
    low: float
    high: float


class ShareInFamily(Share):
    """The same, and how many of the plants inside of the family miss it.

    Args:
        missed_in_the_family: plants for which a proof would hold.
    """

    missed_in_the_family: int


class JointShare(ShareInFamily):
    """How many plants meet everything at once.

    Args:
        first_missed: indices of the first plants that miss something.
    """

    first_missed: list[int]


class ScenarioYield(JointShare):
    """The same of one scenario.

    Args:
        name: of the scenario.
    """

    name: str


class JointYieldEntry(JointShare):
    """The same of everything.

    Args:
        scenarios: of each alone.
    """

    scenarios: list[ScenarioYield]


class CorrelationEntry(TypedDict):
    """Two uncertain numbers that vary together.

    Args:
        numbers: their names.
        coefficient: between -1 and 1.
    """

    numbers: list[str]
    coefficient: float


class SamplesFileEntry(TypedDict):
    """The file that plants are listed in.

    Args:
        name: as the spec writes it.
        sha256: of its bytes.
        rows: plants in it.
    """

    name: str
    sha256: str
    rows: int


class MemberWeight(TypedDict):
    """A plant of a list.

    Args:
        name: of the plant.
        weight: relative, by which it is drawn.
    """

    name: str
    weight: float


class Draws(TypedDict):
    """How plants were drawn.

    Args:
        samples: plants.
        seed: of the draw.
        design: random, latin_hypercube or sobol; null where the plants come from a file.
        confidence: of every interval, between 0 and 1.
        intervals_are_exact: whether the draws are independent, which the intervals take for granted.
        distributions: of the uncertain numbers, as a spec writes them; null where the plants come from a file.
        correlations: without any there is no entry.
        samples_file: null without one.
        outside_the_family: plants for which no proof holds.
        no_plants: draws that are no plant, and are left out.
        plants: of a list of plants.
    """

    samples: int
    seed: int
    design: str | None
    confidence: float
    intervals_are_exact: bool
    distributions: dict[str, Any] | None
    correlations: NotRequired[list[CorrelationEntry]]
    samples_file: SamplesFileEntry | None
    outside_the_family: int
    no_plants: int
    plants: NotRequired[list[MemberWeight]]


class QuantileEntry(TypedDict):
    """A quantile over the plants, with its interval.

    Args:
        probability: between 0 and 1.
        value: in the quantity's unit; null where infinite.
        low: lower end of its interval; null: none.
        high: its upper end.
    """

    probability: float
    value: float | None
    low: float | None
    high: float | None


class HistogramEntry(TypedDict):
    """How often values occur.

    Args:
        edges: of the bins, in the quantity's unit, one more than bins.
        counts: plants in each bin.
    """

    edges: list[float]
    counts: list[int]


class WorstPlantEntry(TypedDict):
    """One of the worst plants.

    Args:
        index: of the draw, for `--replay`.
        value: in the quantity's unit; null where infinite.
        plant: the uncertain numbers by name, in the spec's units.
        in_the_family: whether a proof would hold for it.
        member: of a list of plants, the plant's name.
    """

    index: int
    value: float | None
    plant: Plant
    in_the_family: bool
    member: NotRequired[str]


class OutcomeEntry(TypedDict):
    """A requirement or a limit over the plants.

    Args:
        name: the quantity or measure, with its unit.
        relation: what its value is compared by.
        limits: in the quantity's unit; two of `between`.
        limit_at_to_rad_s: of a limit that is a line over log omega, its value at the upper end.
        side: which of two limits this is about.
        scenario: of a limit of simulations.
        fraction: how many plants meet it.
        quantiles: of the value over the plants.
        histogram: null where no value is finite.
        worst: the worst first.
        missed_in_the_family: plants for which a proof would hold.
        worst_in_the_family: null without one.
    """

    name: str
    relation: Relation
    limits: list[float]
    limit_at_to_rad_s: NotRequired[float]
    side: NotRequired[Literal["at_most", "at_least"]]
    scenario: NotRequired[str]
    fraction: Share
    quantiles: list[QuantileEntry]
    histogram: HistogramEntry | None
    worst: list[WorstPlantEntry]
    missed_in_the_family: int
    worst_in_the_family: WorstPlantEntry | None


class EvidenceDocument(TypedDict):
    """What `fopi validate` says of a loop.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether every plant meets everything; `contradiction` where one refutes what is proved.
        gains: what the controller approximates.
        name: of the spec.
        contradictions: a defect of the tool, in words.
        drawn: how.
        joint_yield: how many plants meet everything at once.
        stable: how many plants are.
        requirements: on the frequency response.
        limits: of scenarios.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Literal["met", "violated", "contradiction"]
    gains: Gains
    name: str
    contradictions: list[str]
    drawn: Draws
    joint_yield: JointYieldEntry
    stable: ShareInFamily
    requirements: list[OutcomeEntry]
    limits: list[OutcomeEntry]
    stamp: StampEntry


class SystemScenarioEvidence(TypedDict):
    """One scenario of a system over pairs of plants.

    Args:
        name: of the scenario.
        finite: pairs whose output stays finite.
        without_chattering: pairs whose modes do not switch faster than the system allows.
        limits: that are judged.
    """

    name: str
    finite: Share
    without_chattering: Share
    limits: list[OutcomeEntry]


class SystemEvidenceDocument(TypedDict):
    """What `fopi validate` says of a system.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether every pair of plants meets everything.
        gains: of each mode by name.
        name: of the system.
        drawn: how.
        joint_yield: how many pairs meet everything at once.
        scenarios: in the order of the system.
        notes: what to know about all scenarios.
        stamp: provenance.
    """

    schema: Literal[1]
    status: Literal["met", "violated"]
    gains: dict[str, Gains]
    name: str
    drawn: Draws
    joint_yield: JointYieldEntry
    scenarios: list[SystemScenarioEvidence]
    notes: list[str]
    stamp: StampEntry
