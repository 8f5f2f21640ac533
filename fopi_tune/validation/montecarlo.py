"""Evidence by sampling:  a spec, its digital controller and plants drawn from its family -> how often everything holds.

Draw i depends on the seed and on i alone, and so does the noise of its simulation: chunks and threads change nothing,
and each draw can be made again by itself.  Draws may leave the family (`counted`): what is proved is not about those.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled import SampledLoops
from fopi_tune.core.samples import outside_box, why_impossible
from fopi_tune.core.sections import Implementation
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, Limit, Relation, Requirement, ScenarioSpec, Scope, ValidationSpec
from fopi_tune.validation.counted import Counted, Marked, count, merge_counts
from fopi_tune.validation.draws import Design, Draw, Listed, points, stays_inside
from fopi_tune.validation.judged import MEASURE_VALUES, horizon_of, scenario_of
from fopi_tune.validation.scan import Scan
from fopi_tune.validation.scenario import Array, Mode
from fopi_tune.validation.simulate import measure_chunks
from fopi_tune.validation.statistics import Fraction, Quantile
from fopi_tune.validation.tally import Found, Worst

#: plants whose margins are scanned at once, and whose simulations are
_SCANNED, _SIMULATED = 512, 8192
#: how many of the worst plants are kept
KEPT = 5
PROBABILITIES = (0.01, 0.05, 0.5, 0.95, 0.99)
#: by how much a requirement may be missed, as in the verification
_TOLERANCE = 1e-6

#: (done, of all) plants
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class WorstPlant:
    """A plant that was drawn, with the value that makes it one of the worst.

    Args:
        index: of the draw; with the seed it can be made again.
        value: in the unit of what was judged; infinite where there is none.
        plant: the uncertain numbers by name.
        inside: whether it lies in the family's box.
    """

    index: int
    value: float
    plant: Mapping[str, float]
    inside: bool


@dataclass(frozen=True)
class Judged:
    """How often one requirement or limit held.

    Args:
        requirement: the spec's, of a requirement.
        limit: the spec's, of a limit.
        scenario: in which a limit was judged.
        upper: whether large values are the bad ones.
        fraction: of the plants that met it, with its interval.
        quantiles: of the values.
        worst: the worst plants, the worst first.
        missed_inside: plants of the family that did not meet it.
        worst_inside: the worst plant of the family; None when none of it was drawn.
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


@dataclass(frozen=True)
class Evidence:
    """What sampling says of a digital controller's loop.

    Args:
        validation: how it was drawn.
        stable: fraction of stable loops.
        requirements: over the family; those about the nominal plant alone are not sampled.
        limits: of the scenarios.
        outside: plants outside the family's box, of which no proof speaks.
        unstable_inside: plants of the family whose loop is unstable.
        no_plants: draws that are no plants, such as one with a negative time constant; they count nowhere else.
        numbers: names of the uncertain numbers.
    """

    validation: ValidationSpec
    stable: Fraction
    requirements: tuple[Judged, ...]
    limits: tuple[Judged, ...]
    outside: int
    unstable_inside: int = 0
    no_plants: int = 0
    numbers: tuple[str, ...] = ()

    @property
    def missed_inside(self) -> bool:
        """Whether a plant of the family was drawn that is unstable or misses anything."""
        return bool(self.unstable_inside) or any(e.missed_inside for e in (*self.requirements, *self.limits))

    @property
    def all_met(self) -> bool:
        """Whether every drawn plant is stable and meets everything."""
        every = (self.stable, *(judged.fraction for judged in (*self.requirements, *self.limits)))
        return all(fraction.met == fraction.total for fraction in every)


def monte_carlo(
    spec: DesignSpec, gains: FoPi, implementation: Implementation, progress: Progress | None = None
) -> Evidence:
    """Draw plants, and judge each by the spec's requirements and, in its scenarios, by its limits.

    Args:
        spec: what is asked; its section `validation` says how many plants.
        gains: what the controller approximates.
        implementation: the controller that runs.
        progress: told how many plants are done.

    Raises:
        DomainError: none of the draws is a plant, or a loop so late that it cannot be simulated.
    """
    sampler = _Sampler(spec, gains, implementation, spec.validation or ValidationSpec())
    outside, no_plants = sampler.strays()
    stable, requirements = sampler.margins(progress)
    limits = tuple(judged for scenario in spec.scenarios for judged in sampler.simulations(scenario))
    confidence = sampler.validation.confidence
    return Evidence(
        validation=sampler.validation,
        stable=stable.tally.fraction(confidence),
        requirements=requirements,
        limits=limits,
        outside=outside,
        unstable_inside=stable.missed_inside,
        no_plants=no_plants,
        numbers=tuple(spec.plant.uncertain_names),
    )


def draw_of(validation: ValidationSpec) -> Draw:
    """The draws that a spec's section `validation` asks for; those of a file are its rows in their order."""
    listed = validation.samples_file
    source = validation.distributions if listed is None else Listed(listed.table)
    return Draw(validation.seed, Design(validation.design), validation.samples, source)


@dataclass(frozen=True)
class _Sampler:
    spec: DesignSpec
    gains: FoPi
    implementation: Implementation
    validation: ValidationSpec

    @cached_property
    def draw(self) -> Draw:
        return draw_of(self.validation)

    @cached_property
    def is_free(self) -> bool:
        """Whether a draw may leave the family's box."""
        return not stays_inside(self.draw, self.spec.plant)

    def places(self, first: int, end: int) -> Array:
        return points(self.draw, self.spec.plant, first, end - first)

    def drawn(self, first: int, end: int) -> Marked:
        return Marked.of(self.places(first, end), self.spec.plant, first, self.is_free)

    def plants(self, first: int, end: int) -> Plants:
        return Plants.members(self.spec.plant, self.drawn(first, end).places)

    def chunks(self, size: int) -> Iterator[tuple[int, int]]:
        total = self.validation.samples
        for first in range(0, total, size):
            yield first, min(first + size, total)

    def strays(self) -> tuple[int, int]:
        """Plants outside the family's box, and draws that are no plants."""
        if not self.is_free:
            return 0, 0
        plants = inside = 0
        for drawn in (self.drawn(*chunk) for chunk in self.chunks(_SIMULATED)):
            plants += int(drawn.is_plant.sum())
            inside += int(drawn.inside.sum())
        if not plants:
            why = why_impossible(self.places(0, 1)[0], self.spec.plant)
            raise DomainError(f"no draw is a plant; the first: {why}.  Check distributions: in section validation")
        return plants - inside, self.validation.samples - plants

    # -- margins ------------------------------------------------------------------------------------------------------

    def margins(self, progress: Progress | None) -> tuple[Counted, tuple[Judged, ...]]:
        """Stability and every requirement over the family."""
        requirements = [r for r in self.spec.requirements if r.scope is Scope.FAMILY]
        sides = [(r, upper) for r in requirements for upper in (False, True) if math.isfinite(_limit_of(r, upper))]

        def scan(chunk: tuple[int, int]) -> list[Counted]:
            drawn = self.drawn(*chunk)
            plants = Plants.members(self.spec.plant, drawn.places)
            found = Scan(SampledLoops.implemented(self.gains, self.implementation, plants))
            stable = found.unstable_poles < 0.5
            counts = [_counted(drawn, np.where(stable, 0.0, 1.0), stable, True)]
            for requirement, upper in sides:
                values = found.measure(requirement, upper)
                # without a gain crossover there is no such number, and the requirement is not met
                values = np.where(np.isnan(values), np.inf if upper else -np.inf, values)
                counts.append(_counted(drawn, values, _keeps(requirement, upper, values), upper))
            return counts

        parts: list[list[Counted]] = []
        with ThreadPoolExecutor(_workers()) as pool:
            for chunk, counts in zip(self.chunks(_SCANNED), pool.map(scan, self.chunks(_SCANNED)), strict=True):
                parts.append(counts)
                if progress is not None:
                    progress(chunk[1], self.validation.samples)
        whole = [merge_counts(column) for column in zip(*parts, strict=True)]
        judged = [self.judged(found, upper, requirement=r) for found, (r, upper) in zip(whole[1:], sides, strict=True)]
        return whole[0], tuple(judged)

    # -- simulations --------------------------------------------------------------------------------------------------

    def simulations(self, scenario: ScenarioSpec) -> list[Judged]:
        """Every limit about a scenario."""
        limits = [each for each in self.spec.limits if each.scenario in (None, scenario.name)]
        if not limits:
            return []
        controller = controller_of(self.spec, self.implementation)
        modes, run = [Mode(controller, self.plants)], scenario_of(scenario, self.implementation, self.validation.seed)
        parts: list[list[Counted]] = []
        first = 0
        horizon = horizon_of(scenario, run)
        for measures in measure_chunks(modes, run, horizon, self.validation.samples, chunk=_SIMULATED):
            drawn = self.drawn(first, first + len(measures.finite))
            counts = []
            for limit in limits:
                upper = limit.relation is Relation.AT_MOST
                values = MEASURE_VALUES[limit.measure](measures)
                values = np.where(np.isnan(values), np.inf if upper else -np.inf, values)
                met = values <= limit.limit if upper else values >= limit.limit
                counts.append(_counted(drawn, values, met, upper))
            parts.append(counts)
            first += len(measures.finite)
        pairs = zip((merge_counts(column) for column in zip(*parts, strict=True)), limits, strict=True)
        return [self.judged(t, e.relation is Relation.AT_MOST, limit=e, scenario=scenario.name) for t, e in pairs]

    def judged(
        self,
        found: Counted,
        upper: bool,
        *,
        requirement: Requirement | None = None,
        limit: Limit | None = None,
        scenario: str | None = None,
    ) -> Judged:
        confidence, tally = self.validation.confidence, found.tally
        return Judged(
            requirement=requirement,
            limit=limit,
            scenario=scenario,
            upper=upper,
            fraction=tally.fraction(confidence),
            quantiles=tally.quantiles(PROBABILITIES, confidence),
            worst=tuple(self.worst_plant(each) for each in tally.worst),
            missed_inside=found.missed_inside,
            worst_inside=None if found.worst_inside is None else self.worst_plant(found.worst_inside),
        )

    def worst_plant(self, found: Found) -> WorstPlant:
        place, family = self.places(found.index, found.index + 1), self.spec.plant
        return WorstPlant(found.index, found.value, family.describe(place[0]), not bool(outside_box(place, family)[0]))


def controller_of(spec: DesignSpec, implementation: Implementation) -> Runtime:
    """The controller in the arithmetic of the exported double-precision code."""
    limits = spec.digital.output_limits if spec.digital is not None else None
    return Runtime.of(implementation.sections, Precision.FLOAT64, limits)


def _counted(drawn: Marked, values: Array, met: np.ndarray, upper: bool) -> Counted:
    return count(drawn, values, met, Worst.LARGEST if upper else Worst.SMALLEST, KEPT)


def _limit_of(requirement: Requirement, upper: bool) -> float:
    return requirement.upper if upper else requirement.lower


def _keeps(requirement: Requirement, upper: bool, values: Array) -> np.ndarray:
    """Whether values are on their side of a limit, within the verification's tolerance."""
    quantity, limit = QUANTITIES[requirement.quantity], _limit_of(requirement, upper)
    natural = quantity.to_natural(limit)
    slack = _TOLERANCE * (abs(natural) if requirement.quantity == "delay_margin_s" else 1.0)
    relaxed = quantity.from_natural(natural + slack if upper else natural - slack)
    return values <= relaxed if upper else values >= relaxed


def _workers() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
