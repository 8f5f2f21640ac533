"""Evidence by sampling:  a spec, its digital controller and plants drawn from its family -> how often everything holds.

Draw i depends on the seed and on i alone, and so does the noise of its simulation: chunks and threads change nothing,
and each draw can be made again by itself.  Draws may leave the family (`counted`): what is proved is not about those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled import SampledLoops
from fopi_tune.core.sections import Implementation
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.margins import MarginScan
from fopi_tune.montecarlo.membership import FamilyTally, merge_family_tallies
from fopi_tune.montecarlo.outcomes import (
    ChunkProgress,
    OutcomeStatistics,
    PlantSampler,
    Progress,
    counted,
    limits_about,
    split_progress,
)
from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.quantities import QUANTITIES
from fopi_tune.simulation.measures import scenario_of
from fopi_tune.simulation.sampled.simulate import available_threads
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec.model import DesignSpec, Requirement, ScenarioSpec, Scope, ValidationSpec

#: plants whose margins are scanned at once, on a grid of frequencies that all of them have in common: cut elsewhere,
#: their margins would differ in the last bits
SCANNED = 512
#: by how much a requirement may be missed, as in the verification
_TOLERANCE = 1e-6


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
    requirements: tuple[OutcomeStatistics, ...]
    limits: tuple[OutcomeStatistics, ...]
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


@dataclass(frozen=True, eq=False)
class Block:
    """What was counted of the draws first to end - 1.

    Args:
        first: index of the first draw.
        end: index after the last.
        outside: plants outside the family's box.
        no_plants: draws that are no plants.
        margins: stable, then every side of every requirement over the family.
        simulated: of each scenario that is judged, as `Drawn.simulated`.
    """

    first: int
    end: int
    outside: int
    no_plants: int
    margins: tuple[FamilyTally, ...]
    simulated: tuple[tuple[FamilyTally, ...], ...]


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
    samples = (spec.validation or ValidationSpec()).samples
    return evidence_of(spec, [sample_block(spec, gains, implementation, 0, samples, progress)])


def sample_block(
    spec: DesignSpec,
    gains: FoPi,
    implementation: Implementation,
    first: int,
    end: int,
    progress: Progress | None = None,
) -> Block:
    """`monte_carlo` of the draws first to end - 1 alone, on whatever machine; `evidence_of` puts blocks together.

    Raises:
        DomainError: a block that does not begin and end at multiples of `SCANNED` (or at the last draw); none of the
            draws of the whole is a plant, or a loop so late that it cannot be simulated.
    """
    samples = (spec.validation or ValidationSpec()).samples
    if first % SCANNED or not first < end <= samples or (end % SCANNED and end != samples):
        raise DomainError(f"draws {first} to {end - 1} of {samples} are no block; cut at multiples of {SCANNED}")
    drawn = PlantSampler(spec.plant, spec.validation or ValidationSpec())
    outside, no_plants = drawn.strays(first, end)
    drawn.check_plants(no_plants)
    driven = _driven(spec)
    done = split_progress(progress, end - first, 1 + len(driven))
    margins = _Scanner(spec, gains, implementation, drawn).margins(first, end, done[0])
    modes = [Mode(controller_of(spec, implementation), drawn.plants)]
    simulated = [
        drawn.simulated(
            spec.limits, scenario, modes, scenario_of(scenario, implementation, drawn.seed), each, (first, end)
        )
        for scenario, each in zip(driven, done[1:], strict=True)
    ]
    return Block(first, end, outside, no_plants, margins, tuple(simulated))


def evidence_of(spec: DesignSpec, blocks: Sequence[Block]) -> Evidence:
    """The evidence of all draws, to the same bits however they were divided.

    Args:
        spec: that the blocks were drawn for.
        blocks: of all its draws, in any order.

    Raises:
        DomainError: draws that are missing or were counted twice, or of which none is a plant.
    """
    drawn = PlantSampler(spec.plant, spec.validation or ValidationSpec())
    ordered = sorted(blocks, key=lambda block: block.first)
    edges = [0, *(block.end for block in ordered)]
    if [block.first for block in ordered] != edges[:-1] or edges[-1] != drawn.validation.samples:
        raise DomainError(f"blocks up to {edges[1:]} do not make up {drawn.validation.samples} draws")
    no_plants = sum(block.no_plants for block in ordered)
    drawn.check_plants(no_plants)
    stable, *rest = (merge_family_tallies(column) for column in zip(*(block.margins for block in ordered), strict=True))
    limits: list[OutcomeStatistics] = []
    for place, scenario in enumerate(_driven(spec)):
        found = [
            merge_family_tallies(column) for column in zip(*(block.simulated[place] for block in ordered), strict=True)
        ]
        limits += drawn.simulations(spec.limits, scenario, found).limits
    return Evidence(
        validation=drawn.validation,
        stable=stable.tally.fraction(drawn.validation.confidence),
        requirements=tuple(
            drawn.judged(t, upper, requirement=r) for t, (r, upper) in zip(rest, _sides(spec), strict=True)
        ),
        limits=tuple(limits),
        outside=sum(block.outside for block in ordered),
        unstable_inside=stable.missed_inside,
        no_plants=no_plants,
        numbers=spec.plant.uncertain_names,
    )


def _driven(spec: DesignSpec) -> list[ScenarioSpec]:
    """The scenarios that a limit judges."""
    return [scenario for scenario in spec.scenarios if limits_about(spec.limits, scenario)]


def _sides(spec: DesignSpec) -> list[tuple[Requirement, bool]]:
    """Every requirement over the family with each of its limits: whether it is the upper one."""
    family = [r for r in spec.requirements if r.scope is Scope.FAMILY]
    return [(r, upper) for r in family for upper in (False, True) if math.isfinite(_limit_of(r, upper))]


@dataclass(frozen=True)
class _Scanner:
    spec: DesignSpec
    gains: FoPi
    implementation: Implementation
    drawn: PlantSampler

    def margins(self, first: int, end: int, done: ChunkProgress) -> tuple[FamilyTally, ...]:
        """Stability and every requirement over the family, of the draws first to end - 1."""
        sides = _sides(self.spec)

        def scan(chunk: tuple[int, int]) -> list[FamilyTally]:
            drawn = self.drawn.marked(*chunk)
            plants = Plants.members(self.spec.plant, drawn.places)
            found = MarginScan(SampledLoops.implemented(self.gains, self.implementation, plants))
            stable = found.unstable_poles < 0.5
            counts = [counted(drawn, np.where(stable, 0.0, 1.0), stable, True)]
            for requirement, upper in sides:
                values = found.measure(requirement, upper)
                # without a gain crossover there is no such number, and the requirement is not met
                # nor does an unstable loop meet any
                values = np.where(np.isnan(values) | ~stable, np.inf if upper else -np.inf, values)
                counts.append(counted(drawn, values, _keeps(requirement, upper, values), upper))
            return counts

        parts: list[list[FamilyTally]] = []
        with ThreadPoolExecutor(available_threads()) as pool:
            chunks = list(self.drawn.chunks(SCANNED, first, end))
            for chunk, counts in zip(chunks, pool.map(scan, chunks), strict=True):
                parts.append(counts)
                done(chunk[1] - first)
        return tuple(merge_family_tallies(column) for column in zip(*parts, strict=True))


def controller_of(spec: DesignSpec, implementation: Implementation) -> Runtime:
    """The controller in the arithmetic of the exported double-precision code."""
    limits = spec.digital.output_limits if spec.digital is not None else None
    return Runtime.of(implementation.sections, Precision.FLOAT64, limits)


def _limit_of(requirement: Requirement, upper: bool) -> float:
    return requirement.upper if upper else requirement.lower


def _keeps(requirement: Requirement, upper: bool, values: Array) -> np.ndarray:
    """Whether values are on their side of a limit, within the verification's tolerance."""
    quantity, limit = QUANTITIES[requirement.quantity], _limit_of(requirement, upper)
    natural = quantity.to_natural(limit)
    slack = _TOLERANCE * (abs(natural) if requirement.quantity == "delay_margin_s" else 1.0)
    relaxed = quantity.from_natural(natural + slack if upper else natural - slack)
    return values <= relaxed if upper else values >= relaxed
