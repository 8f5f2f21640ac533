"""A spec as frozen data: the result of `spec/` and the input of every later stage."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from fopi_tune.core.controller import FoPi
from fopi_tune.core.distributions.correlation import Correlation
from fopi_tune.core.distributions.distribution import Distribution
from fopi_tune.core.fractional_plants.family import is_fractional
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.parameter_table import SamplesFile
from fopi_tune.core.plant import JointFamily, PlantFamily
from fopi_tune.core.switching_lines import SwitchingLines
from fopi_tune.core.terms.controller_spec import ControllerSpec as ControllerSpec
from fopi_tune.core.terms.controller_spec import GainRange as GainRange
from fopi_tune.core.terms.digital_spec import DigitalSpec as DigitalSpec
from fopi_tune.core.terms.feedforward import FeedForward
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.quantities.requirement import Relation as Relation
from fopi_tune.quantities.requirement import Requirement as Requirement
from fopi_tune.quantities.requirement import Scope as Scope
from fopi_tune.spec.measures import MEASURES as MEASURES
from fopi_tune.spec.measures import MeasureKind as MeasureKind
from fopi_tune.spec.python.entries import text_of_changed


class Sense(StrEnum):
    """Which way an objective goes."""

    MINIMIZE = "minimize"
    MAXIMIZE = "maximize"


@dataclass(frozen=True)
class Objective:
    """What to do with the freedom the requirements leave.

    Args:
        sense: which way.
        quantity: a word of `quantities.objectives.OBJECTIVES`, or a measure of the scenario.
        horizon_s: of `iae_disturbance` alone; None lets the tool choose it from the plant.
        scenario: whose measure is minimised; None for the loop's own numbers.
    """

    sense: Sense
    quantity: str
    horizon_s: float | None = None
    scenario: str | None = None


@dataclass(frozen=True)
class Knot:
    """A value from a time on, reached at once or in a straight line."""

    at_s: float
    value: float
    ramp_s: float = 0.0


@dataclass(frozen=True)
class ScenarioSpec:
    """One thing to simulate on samples.

    Args:
        name: of the scenario.
        duration_s: how long it lasts.
        reference: the setpoint, in the output's unit; the initial output before its first entry.
        load: added to the control at the plant's input; 0 before its first entry.
        initial_output: at the start.
        before: "rest", the input was what holds the plant there; "free", there was none.
        bumpless: whether the controller starts at that input instead of 0.
        noise_std: standard deviation of the measurement's noise, output unit.
        quantum: step of the measurement, output unit; 0 for none.
        rate_per_s: fastest change of the control.
        settling_band: half-width around a step's setpoint that counts as settled, output unit; None is 2 % of each
            step, of the setpoint where there is no step.
        judged_from_s: from when on it is judged: a step that is over by then counts as none.
    """

    name: str
    duration_s: float
    reference: tuple[Knot, ...]
    load: tuple[Knot, ...] = ()
    initial_output: float = 0.0
    before: str = "rest"
    bumpless: bool = False
    noise_std: float = 0.0
    quantum: float = 0.0
    rate_per_s: float = math.inf
    settling_band: float | None = None
    judged_from_s: float = 0.0


@dataclass(frozen=True)
class Limit:
    """One line of `limits:`, or a requirement on a measure of simulations.

    Args:
        measure: a key of `MEASURES`.
        relation: at_most or at_least.
        limit: in the measure's unit.
        scenario: the only one it is about; None for all.
        line: in the file, 0 when the spec did not come from a file.
    """

    measure: str
    relation: Relation
    limit: float
    scenario: str | None = None
    line: int = 0


@dataclass(frozen=True)
class ValidationSpec:
    """How many plants the Monte-Carlo stage draws, how, and how sure its intervals are.

    Args:
        samples: plants; of a file, its first rows.
        seed: of every random number.
        design: random, latin_hypercube or sobol.
        confidence: of each interval, between 0 and 1.
        distributions: by the uncertain number's name; uniform where left out.
        correlations: between uncertain numbers; those that are left out are independent.
        samples_file: the plants, one a row, instead of drawing them; the design has then no meaning.
    """

    samples: int = 10_000
    seed: int = 1
    design: str = "random"
    confidence: float = 0.99
    distributions: Mapping[str, Distribution] = field(default_factory=dict)
    correlations: tuple[Correlation, ...] = ()
    samples_file: SamplesFile | None = None

    @property
    def samples_file_sha256(self) -> str | None:
        """Of the file's bytes: the spec's own hash does not tell what is in there."""
        return None if self.samples_file is None else self.samples_file.sha256


@dataclass(frozen=True, repr=False)
class DesignSpec:
    """A whole spec.

    Args:
        name: of the design and of its results' folder.
        plant: the family; of a list of plants (`plants:`) all of its members, a `PlantList`, which is no box.
        controller: the box of gains.
        requirements: in the order of the file.
        objective: None for the gains that are deepest inside all requirements.
        digital: how the gains become a filter; None without.
        validation: how plants are drawn; None without.
        scenarios: what is simulated.
        limits: what simulations are judged by, beside the requirements on their measures.
        scenario_requirements: on measures of scenarios, for the whole family; the gains are designed for them.
        description: for people.
        text_sha256: of the file's bytes, or of the text it was made from; "" without one.
        schema: version of the language.
        source: those bytes.
        content_sha256: of what those bytes say, by which a spec that was changed afterwards is told; empty for a spec
            that was not read.
        digest: how `content_sha256` is made of a spec; None of one that was not read.
        is_as_read: whether nothing was changed since the text was read.
        as_read: the spec that was read, of which this one was made; None without one.
        reference: of one member of a list (`spec.lists.members`), the family whose nominal plant is the list's; None
            where that is `plant` itself.
    """

    name: str
    plant: PlantFamily
    controller: ControllerSpec
    requirements: tuple[Requirement, ...]
    objective: Objective | None = None
    digital: DigitalSpec | None = None
    validation: ValidationSpec | None = None
    scenarios: tuple[ScenarioSpec, ...] = ()
    limits: tuple[Limit, ...] = ()
    description: str = ""
    text_sha256: str = ""
    schema: int = 1
    source: bytes = field(default=b"", compare=False, repr=False)
    content_sha256: str = field(default="", compare=False, repr=False)
    digest: Callable[[DesignSpec], str] | None = field(default=None, compare=False, repr=False)
    scenario_requirements: tuple[Limit, ...] = ()
    reference: PlantFamily | None = None
    as_read: DesignSpec | None = field(default=None, compare=False, repr=False)
    is_as_read: bool = field(default=False, init=False, compare=False, repr=False)

    def __repr__(self) -> str:
        asked = len(self.requirements) + len(self.scenario_requirements)
        loop = "in continuous time" if self.digital is None else f"on samples of {self.digital.sample_time_s:g} s"
        return f"<DesignSpec {self.name}: plant {self.plant.model}, {counted(asked, 'requirement')}, {loop}>"

    def to_yaml(self) -> str:
        """The text that this spec was read from, in YAML; of `ft.spec` one with the same entries.

        Of a spec that was changed by `dataclasses.replace` sections that were changed are written anew.

        Raises:
            DomainError: what was changed has no words here, such as a measured plant; says which section.
        """
        return self.source.decode() if self.is_as_read else text_of_changed(self, self.as_read)

    @property
    def sha256(self) -> str:
        """The hash of the text that this spec was read from; of one that says something else, of what it says."""
        if self.is_as_read or self.digest is None:
            return self.text_sha256
        content = self.digest(self)
        return self.text_sha256 if content == self.content_sha256 else content

    @property
    def is_measured(self) -> bool:
        """Whether the plant is known by measured frequency responses: requirements are then checked, never proved."""
        return isinstance(self.plant, MeasuredFamily)

    @property
    def has_loop_on_samples(self) -> bool:
        """Whether the plant behind a hold is known: that of a measured one is not, nor that of a fractional one."""
        return not self.is_measured and not is_fractional(self.plant)

    @property
    def sampled_design(self) -> DigitalSpec | None:
        """The digital section where the requirements are about the loop on samples; None: that in continuous time."""
        return self.digital if self.digital is not None and self.digital.designs_sampled else None

    @property
    def nominal_family(self) -> PlantFamily:
        """The family whose nominal plant `on: nominal`, spreads and a digital controller's crossover are about."""
        return self.plant if self.reference is None else self.reference

    @property
    def judged_limits(self) -> tuple[Limit, ...]:
        """Everything that simulations are judged by: requirements on their measures, then the limits."""
        return (*self.scenario_requirements, *self.limits)

    @property
    def designs_scenarios(self) -> bool:
        """Whether the gains are designed for what scenarios measure."""
        by_objective = self.objective is not None and self.objective.scenario is not None
        return by_objective or bool(self.scenario_requirements)


@dataclass(frozen=True)
class ModeSpec:
    """One mode of a system.

    Args:
        name: of the mode.
        spec: its plant, its digital controller, and how to find its gains.
        gains: when the system names them; None leaves them to the spec.
        feedforward: of the setpoint; None without one.
        hold_below_per_s: the output of its plant does not go below 0, and stays there while the plant's input, with the
            load, drives it by less than this, output unit per s; None for a plant without a standstill.
    """

    name: str
    spec: DesignSpec
    gains: FoPi | None = None
    feedforward: FeedForward | None = None
    hold_below_per_s: float | None = None


@dataclass(frozen=True, repr=False)
class SystemSpec:
    """Two loops that share their output and take turns, as a car's throttle and brake do.

    From the first mode, which raises the output, to the second one when the output reaches the setpoint + hysteresis,
    back when it falls to setpoint - hysteresis; or at other lines (`core.switching_lines`).

    Args:
        name: of the system and its results' folder.
        modes: the one that raises the output, then the one that lowers it, by any names.
        hysteresis: half-width around the setpoint, output unit, or other lines.
        inactive: what the controller does that is not active: held, tracking or reset.
        first: name of the mode at the start; the first of `modes` where left out.
        most_switches: more of them than this ...
        window_s: ... within this time are chattering; None is `chattering_window_s`.
        scenarios: what is driven.
        limits: what is judged.
        validation: how many plants are drawn, and how.
        description: for people.
        sha256: of the file and of its specs.
        schema: of the language.
        requirements: on measures of scenarios, for every pair of plants.
        objective: which measure is minimised; None where nothing is designed.
        tuned: names of the modes whose gains are designed for them.
        min_dwell_s: a mode that was entered by a switch stays at least so long; the first one may be left at once.
        shared: names of numbers that both plants have and that are one number, such as a car's mass.
    """

    name: str
    modes: tuple[ModeSpec, ModeSpec]
    hysteresis: float | SwitchingLines
    inactive: str = "held"
    first: str = ""
    most_switches: int = 5
    window_s: float | None = None
    scenarios: tuple[ScenarioSpec, ...] = ()
    limits: tuple[Limit, ...] = ()
    validation: ValidationSpec | None = None
    description: str = ""
    sha256: str = ""
    schema: int = 1
    requirements: tuple[Limit, ...] = ()
    objective: Objective | None = None
    tuned: tuple[str, ...] = ()
    min_dwell_s: float = 0.0
    shared: tuple[str, ...] = ()

    def __repr__(self) -> str:
        names = " and ".join(mode.name for mode in self.modes)
        return f"<SystemSpec {self.name}: modes {names}, {counted(len(self.scenarios), 'scenario')}>"

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_dwell_s < math.inf:
            raise DomainError(f"min_dwell_s {self.min_dwell_s!r} must be a finite number of at least 0, in s")
        if not self.first:
            object.__setattr__(self, "first", self.modes[0].name)

    @property
    def lines(self) -> SwitchingLines:
        """Where the modes take turns."""
        return SwitchingLines.of(self.hysteresis)

    @property
    def own_delays(self) -> tuple[int, ...]:
        """Computing delay of each mode, whole samples; empty where both have the same."""
        one, other = (0.0 if mode.spec.digital is None else mode.spec.digital.delay_samples for mode in self.modes)
        return () if one == other else (round(one), round(other))

    @property
    def hold_below(self) -> tuple[float, ...]:
        """Of each mode's standstill, output unit per s, -inf for a mode without; empty where there is none."""
        every = [mode.hold_below_per_s for mode in self.modes]
        return tuple(-math.inf if each is None else each for each in every) if every != [None, None] else ()

    @property
    def judged_limits(self) -> tuple[Limit, ...]:
        """Everything that simulations are judged by."""
        return (*self.requirements, *self.limits)

    @property
    def sample_time_s(self) -> float:
        """Of both modes' controllers; 0 without a section `digital`."""
        digital = self.modes[0].spec.digital
        return 0.0 if digital is None else digital.sample_time_s

    @property
    def min_dwell_samples(self) -> int:
        """`min_dwell_s` in samples, rounded up to whole ones; 0 without a section `digital`."""
        # 0.6 s are three samples of 0.2 s, however their quotient is rounded
        return math.ceil(self.min_dwell_s / self.sample_time_s * (1.0 - 1e-9)) if self.sample_time_s else 0

    @property
    def chattering_window_s(self) -> float:
        """The window of chattering; where the system gives none, twice `most_switches` samples."""
        return 2.0 * self.most_switches * self.sample_time_s if self.window_s is None else self.window_s

    @property
    def measurement_unit(self) -> str:
        """Of the output that both modes share; empty where no mode says it, or each another."""
        units = {mode.spec.digital.measurement_unit.strip() for mode in self.modes if mode.spec.digital} - {""}
        return units.pop() if len(units) == 1 else ""

    @property
    def family(self) -> JointFamily:
        """The uncertain numbers of both plants as one box, each named MODE.NUMBER; shared ones by their own names."""
        return JointFamily.of({mode.name: mode.spec.plant for mode in self.modes}, self.shared)
