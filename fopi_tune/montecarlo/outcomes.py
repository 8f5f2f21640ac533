"""Outcomes of sampling:  plants drawn from a box, their simulations, and how often each limit holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.families.plant_list import named_place
from fopi_tune.core.loops import Plants
from fopi_tune.core.parameter_table import outside_box, why_impossible
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.draws import SampleList, SamplingPlan, sample_points, stays_inside
from fopi_tune.montecarlo.joint import JointYield, all_of, condition_tally
from fopi_tune.montecarlo.membership import ClassifiedDraws, FamilyTally, Flags, family_tally, merge_family_tallies
from fopi_tune.montecarlo.sampling import SamplingDesign
from fopi_tune.montecarlo.statistics import Fraction, Histogram, Quantile, histogram
from fopi_tune.montecarlo.tally import IndexedValue, Worst
from fopi_tune.simulation.measures import horizon_of, measure_values
from fopi_tune.simulation.sampled.simulate import CHUNK, measure_chunks
from fopi_tune.simulation.scenario import Mode, Scenario
from fopi_tune.spec.model import Limit, Relation, Requirement, ScenarioSpec, ValidationSpec

#: how many of the worst plants are kept
WORST_KEPT = 5
#: called with (plants done, plants in all), and with the plants done of one pass over them
Progress = Callable[[int, int], None]
ChunkProgress = Callable[[int], None]
#: of the quantiles that are stated
PROBABILITIES = (0.01, 0.05, 0.5, 0.95, 0.99)


@dataclass(frozen=True)
class WorstPlant:
    """A plant that was drawn, with the value that makes it one of the worst.

    Args:
        index: of the draw; index and seed reproduce it.
        value: of the quantity or measure, in its public unit; infinite, on the side of the worst, where there is none.
        plant: the uncertain numbers by name.
        inside: whether it lies in the family's box.
        member: its name in a list of plants; empty without one.
    """

    index: int
    value: float
    plant: Mapping[str, float]
    inside: bool
    member: str = ""


@dataclass(frozen=True)
class OutcomeStatistics:
    """How often one requirement or limit held.

    Args:
        requirement: the spec's; None for a limit of a scenario.
        limit: the spec's; None for a requirement.
        scenario: in which a limit was evaluated.
        upper: whether large values are the worst.
        fraction: of the plants that met it, with its interval.
        quantiles: of the values.
        worst: the worst plants, the worst first.
        missed_inside: plants of the family that violate it.
        worst_inside: the worst plant of the family; None when none of it was drawn.
        histogram: of the finite values; None without any.
    """

    requirement: Requirement | None
    limit: Limit | None
    scenario: str | None
    upper: bool
    fraction: Fraction
    quantiles: tuple[Quantile, ...]
    worst: tuple[WorstPlant, ...]
    missed_inside: int = 0
    worst_inside: WorstPlant | None = None
    histogram: Histogram | None = None


@dataclass(frozen=True)
class ScenarioStatistics:
    """One scenario, simulated with every plant that was drawn.

    Args:
        scenario: its name.
        finite: fraction of the plants whose output stayed finite.
        calm: fraction of the plants that did not chatter.
        limits: the outcomes of the limits on this scenario.
        joint: how many plants met all of this at once.
    """

    scenario: str
    finite: Fraction
    calm: Fraction
    limits: tuple[OutcomeStatistics, ...]
    joint: JointYield


@dataclass(frozen=True, eq=False)
class SimulatedDraws:
    """One scenario, simulated with some of the draws.

    Args:
        tallies: finite, without chattering, then every limit on the scenario.
        met: which draws met all of them, shape (m,).
    """

    tallies: tuple[FamilyTally, ...]
    met: Flags


@dataclass(frozen=True)
class PlantSampler:
    """The plants that a section `validation` draws from a box.

    Args:
        family: the box.
        validation: how many, and how.
    """

    family: PlantFamily
    validation: ValidationSpec

    @property
    def seed(self) -> int:
        """The seed of every random number."""
        return self.validation.seed

    @cached_property
    def plan(self) -> SamplingPlan:
        """Seed, design and distributions."""
        return sampling_plan_of(self.validation)

    @cached_property
    def may_leave_box(self) -> bool:
        """Whether a draw may leave the family's box."""
        return not stays_inside(self.plan, self.family)

    def points(self, first: int, end: int) -> Array:
        """Uncertain numbers of the draws first to end - 1, shape (end - first, p)."""
        return sample_points(self.plan, self.family, first, end - first)

    def classified(self, first: int, end: int) -> ClassifiedDraws:
        """The same draws, classified by membership; draws that are no plants are replaced."""
        return ClassifiedDraws.of(self.points(first, end), self.family, first, self.may_leave_box)

    def plants(self, first: int, end: int) -> Plants:
        """The draws first to end - 1 as plants of the family's model."""
        return Plants.members(self.family, self.classified(first, end).points)

    def chunks(self, size: int, first: int, end: int) -> Iterator[tuple[int, int]]:
        """(first, end) of chunks of at most `size` draws."""
        for begin in range(first, end, size):
            yield begin, min(begin + size, end)

    def count_outside(self, first: int = 0, end: int | None = None) -> tuple[int, int]:
        """How many of the draws first to end - 1 (None: all) are plants outside the box, and how many no plants."""
        end = self.validation.samples if end is None else end
        if not self.may_leave_box:
            return 0, 0
        plants = inside = 0
        for draws in (self.classified(*chunk) for chunk in self.chunks(CHUNK, first, end)):
            plants += int(draws.is_plant.sum())
            inside += int(draws.inside.sum())
        return plants - inside, end - first - plants

    def check_plants(self, no_plants: int) -> None:
        """Refuse draws of which none is a plant.

        Raises:
            DomainError: as many draws are no plants as there are draws.
        """
        if no_plants == self.validation.samples:
            why = why_impossible(self.points(0, 1)[0], self.family)
            raise DomainError(f"no draw is a plant; the first: {why}.  Check distributions: in section validation")

    def simulate_scenario(
        self,
        limits: Sequence[Limit],
        scenario: ScenarioSpec,
        modes: Sequence[Mode],
        run: Scenario,
        done: ChunkProgress,
        block: tuple[int, int] | None = None,
        *,
        unit: str = "",
    ) -> SimulatedDraws:
        """Simulate a scenario with draws, and tally: finite, without chattering, then every limit on it.

        Args:
            limits: the spec's.
            scenario: the spec's.
            modes: controllers, with the plants by index.
            run: the scenario on the controllers' samples.
            done: called with the number of plants done.
            block: the draws, (first, end); None: all.
            unit: of the measurement.
        """
        limits = limits_about(limits, scenario)
        parts: list[list[FamilyTally]] = []
        everything: list[Flags] = []
        start, end = block or (0, self.validation.samples)
        first = start
        horizon = horizon_of(scenario, run)
        for measures in measure_chunks(modes, run, horizon, end - start, first=start, chunk=CHUNK):
            draws = self.classified(first, first + len(measures.finite))
            flags = [measures.finite, ~measures.chattering]
            counts = [condition_tally(draws, each) for each in flags]
            for limit in limits:
                upper = limit.relation is Relation.AT_MOST
                values = measure_values(measures, limit.measure, unit)
                values = np.where(np.isnan(values), np.inf if upper else -np.inf, values)
                met = values <= limit.limit if upper else values >= limit.limit
                counts.append(outcome_tally(draws, values, met, upper))
                flags.append(met)
            parts.append(counts)
            everything.append(all_of(flags))
            first += len(measures.finite)
            done(first - start)
        tallies = tuple(merge_family_tallies(column) for column in zip(*parts, strict=True))
        return SimulatedDraws(tallies, np.concatenate(everything))

    def joint_tally(self, met: Flags, first: int) -> FamilyTally:
        """The tally of the draws from `first` on, of which `met`, shape (m,), says which met everything."""
        parts = []
        for chunk in self.chunks(CHUNK, first, first + len(met)):
            parts.append(condition_tally(self.classified(*chunk), met[chunk[0] - first : chunk[1] - first]))
        return merge_family_tallies(parts)

    def scenario_statistics(
        self, limits: Sequence[Limit], scenario: ScenarioSpec, found: Sequence[FamilyTally], joint: FamilyTally
    ) -> ScenarioStatistics:
        """The tallies of `simulate_scenario` over all draws, with their intervals.

        Args:
            limits: the spec's.
            scenario: the spec's.
            found: finite, without chattering, then every limit on the scenario.
            joint: all of this at once.
        """
        finite, calm, *rest = found
        outcomes = [
            self.outcome_statistics(t, e.relation is Relation.AT_MOST, limit=e, scenario=scenario.name)
            for t, e in zip(rest, limits_about(limits, scenario), strict=True)
        ]
        confidence = self.validation.confidence
        return ScenarioStatistics(
            scenario.name,
            finite.tally.fraction(confidence),
            calm.tally.fraction(confidence),
            tuple(outcomes),
            JointYield.of(joint, confidence, scenario.name),
        )

    def outcome_statistics(
        self,
        found: FamilyTally,
        upper: bool,
        *,
        requirement: Requirement | None = None,
        limit: Limit | None = None,
        scenario: str | None = None,
    ) -> OutcomeStatistics:
        """A tally with its intervals, quantiles and worst plants."""
        confidence, tally = self.validation.confidence, found.tally
        return OutcomeStatistics(
            requirement=requirement,
            limit=limit,
            scenario=scenario,
            upper=upper,
            fraction=tally.fraction(confidence),
            quantiles=tally.quantiles(PROBABILITIES, confidence),
            histogram=histogram(tally.values()),
            worst=tuple(self.worst_plant(each) for each in tally.worst),
            missed_inside=found.missed_inside,
            worst_inside=None if found.worst_inside is None else self.worst_plant(found.worst_inside),
        )

    def worst_plant(self, found: IndexedValue) -> WorstPlant:
        """The plant of a draw."""
        place = self.points(found.index, found.index + 1)
        inside = not bool(outside_box(place, self.family)[0])
        plant, member = self.family.describe(place[0]), named_place(self.family, place[0])
        return WorstPlant(found.index, found.value, plant, inside, member)


def limits_about(limits: Sequence[Limit], scenario: ScenarioSpec) -> list[Limit]:
    """The limits that apply to a scenario."""
    return [each for each in limits if each.scenario in (None, scenario.name)]


def split_progress(progress: Progress | None, samples: int, count: int) -> list[ChunkProgress]:
    """One callback for each of `count` passes over the plants, which together report to `progress`."""

    def step(place: int) -> ChunkProgress:
        return lambda plants: None if progress is None else progress(place * samples + plants, count * samples)

    return [step(place) for place in range(count)]


def sampling_plan_of(validation: ValidationSpec) -> SamplingPlan:
    """The draws that a spec's section `validation` asks for; those of a file are its rows in their order."""
    listed = validation.samples_file
    source = validation.distributions if listed is None else SampleList(listed.table)
    return SamplingPlan(
        validation.seed, SamplingDesign(validation.design), validation.samples, source, validation.correlations
    )


def outcome_tally(draws: ClassifiedDraws, values: Array, met: np.ndarray, upper: bool) -> FamilyTally:
    """The tally of a chunk of values whose largest (upper) or smallest are the worst."""
    return family_tally(draws, values, met, Worst.LARGEST if upper else Worst.SMALLEST, WORST_KEPT)
