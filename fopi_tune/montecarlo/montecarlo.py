"""Evidence by sampling:  a spec, its digital controller and plants drawn from its family -> how often everything holds.

Draw i depends on the seed and on i alone, and so does the noise of its simulation: chunks and threads change nothing,
and each draw can be reproduced by itself.  Draws may lie outside the family (`membership`), where no proof applies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.families.plant_list import members_of
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.digital.implementation import runtime_of
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.joint import JointYield, all_of
from fopi_tune.montecarlo.margins import MarginScan
from fopi_tune.montecarlo.membership import FamilyTally, Flags, merge_family_tallies
from fopi_tune.montecarlo.outcomes import (
    ChunkProgress,
    OutcomeStatistics,
    PlantSampler,
    Progress,
    limits_about,
    outcome_tally,
    split_progress,
)
from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.quantities import QUANTITIES
from fopi_tune.simulation.measures import scenario_of
from fopi_tune.simulation.sampled.simulate import available_threads
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec.model import DesignSpec, Limit, Requirement, ScenarioSpec, Scope, ValidationSpec

#: plants whose margins are computed at once, on a common frequency grid: another division into chunks would change
#: the margins in their last bits
SCANNED = 512
#: plants that are drawn to check requirements on scenarios
CHECKED_PLANTS = 10_000
#: tolerance of a requirement's limit, as in the verification
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Evidence:
    """The evidence about a digital controller's loop.

    Args:
        validation: how plants were drawn.
        stable: fraction of stable loops.
        requirements: those over the family; those on the nominal plant alone are not sampled.
        limits: of the scenarios.
        joint: how many plants are stable and meet every requirement and limit at once.
        scenarios: how many plants meet every limit of one scenario at once, for each with limits.
        outside: plants outside the family's box, where no proof applies.
        unstable_inside: plants of the family whose loop is unstable.
        no_plants: draws that are no plants, such as one with a negative time constant; they enter no other count.
        numbers: names of the uncertain numbers; of a list of plants those of all of them, each once.
        noisy_scenarios: names of those with noise.
        members: name and weight of each plant of a list; empty without one.
    """

    validation: ValidationSpec
    stable: Fraction
    requirements: tuple[OutcomeStatistics, ...]
    limits: tuple[OutcomeStatistics, ...]
    joint: JointYield
    scenarios: tuple[JointYield, ...]
    outside: int
    unstable_inside: int = 0
    no_plants: int = 0
    numbers: tuple[str, ...] = ()
    noisy_scenarios: tuple[str, ...] = ()
    members: tuple[tuple[str, float], ...] = ()

    @property
    def missed_inside(self) -> bool:
        """Whether a drawn plant of the family is unstable or violates a requirement or limit."""
        return bool(self.unstable_inside) or any(e.missed_inside for e in (*self.requirements, *self.limits))

    @property
    def all_met(self) -> bool:
        """Whether every drawn plant is stable and meets everything."""
        every = (self.stable, *(outcome.fraction for outcome in (*self.requirements, *self.limits)))
        return all(fraction.met == fraction.total for fraction in every)


@dataclass(frozen=True, eq=False)
class Block:
    """The tallies of the draws first to end - 1.

    Args:
        first: index of the first draw.
        end: index after the last.
        outside: plants outside the family's box.
        no_plants: draws that are no plants.
        margins: of stability, then of every side of every requirement over the family.
        simulated: of each scenario with limits, as `PlantSampler.simulate_scenario`.
        joint: of each scenario with limits everything at once, then of all demands.
    """

    first: int
    end: int
    outside: int
    no_plants: int
    margins: tuple[FamilyTally, ...]
    simulated: tuple[tuple[FamilyTally, ...], ...]
    joint: tuple[FamilyTally, ...]


def monte_carlo(
    spec: DesignSpec, gains: FoPi, implementation: Implementation, progress: Progress | None = None
) -> Evidence:
    """Draw plants, and check the spec's requirements and, in its scenarios, its limits on each.

    Args:
        spec: the spec; its section `validation` says how many plants.
        gains: what the controller approximates.
        implementation: the controller that runs.
        progress: called with the number of plants done.

    Raises:
        DomainError: none of the draws is a plant, or a loop's delay is too long to be simulated.
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
    """`monte_carlo` of the draws first to end - 1 alone, on any machine; `evidence_of` merges blocks.

    Raises:
        DomainError: a block that does not begin and end at multiples of `SCANNED` (or at the last draw); none of all
            draws is a plant, or a loop's delay is too long to be simulated.
    """
    samples = (spec.validation or ValidationSpec()).samples
    if first % SCANNED or not first < end <= samples or (end % SCANNED and end != samples):
        raise DomainError(f"draws {first} to {end - 1} of {samples} are no block; cut at multiples of {SCANNED}")
    sampler = PlantSampler(spec.plant, spec.validation or ValidationSpec())
    outside, no_plants = sampler.count_outside(first, end)
    sampler.check_plants(no_plants)
    scenarios = _limited_scenarios(spec)
    done = split_progress(progress, end - first, 1 + len(scenarios))
    margins, met = _MarginSampler(spec, gains, implementation, sampler).margins(first, end, done[0])
    modes = [Mode(runtime_of(implementation.sections, spec), sampler.plants)]
    unit = "" if spec.digital is None else spec.digital.measurement_unit
    simulated = [
        sampler.simulate_scenario(
            spec.judged_limits,
            scenario,
            modes,
            scenario_of(scenario, implementation, sampler.seed),
            each,
            (first, end),
            unit=unit,
        )
        for scenario, each in zip(scenarios, done[1:], strict=True)
    ]
    flags = [each.met for each in simulated]
    joint = tuple(sampler.joint_tally(each, first) for each in (*flags, all_of([met, *flags])))
    return Block(first, end, outside, no_plants, margins, tuple(each.tallies for each in simulated), joint)


def evidence_of(spec: DesignSpec, blocks: Sequence[Block]) -> Evidence:
    """The evidence of all draws, to the same bits for every division into blocks.

    Args:
        spec: for which the blocks were drawn.
        blocks: of all draws, in any order.

    Raises:
        DomainError: draws that are missing or were counted twice, or of which none is a plant.
    """
    sampler = PlantSampler(spec.plant, spec.validation or ValidationSpec())
    ordered = sorted(blocks, key=lambda block: block.first)
    edges = [0, *(block.end for block in ordered)]
    if [block.first for block in ordered] != edges[:-1] or edges[-1] != sampler.validation.samples:
        raise DomainError(f"blocks up to {edges[1:]} do not make up {sampler.validation.samples} draws")
    no_plants = sum(block.no_plants for block in ordered)
    sampler.check_plants(no_plants)
    stable, *rest = (merge_family_tallies(column) for column in zip(*(block.margins for block in ordered), strict=True))
    *each_joint, joint = (
        merge_family_tallies(column) for column in zip(*(block.joint for block in ordered), strict=True)
    )
    simulated = []
    for place, scenario in enumerate(_limited_scenarios(spec)):
        found = [
            merge_family_tallies(column) for column in zip(*(block.simulated[place] for block in ordered), strict=True)
        ]
        simulated.append(sampler.scenario_statistics(spec.judged_limits, scenario, found, each_joint[place]))
    return Evidence(
        validation=sampler.validation,
        stable=stable.tally.fraction(sampler.validation.confidence),
        requirements=tuple(
            sampler.outcome_statistics(t, upper, requirement=r)
            for t, (r, upper) in zip(rest, _sides(spec), strict=True)
        ),
        limits=tuple(limit for each in simulated for limit in each.limits),
        joint=JointYield.of(joint, sampler.validation.confidence),
        scenarios=tuple(each.joint for each in simulated),
        outside=sum(block.outside for block in ordered),
        unstable_inside=stable.missed_inside,
        no_plants=no_plants,
        numbers=tuple(dict.fromkeys(name for each in members_of(spec.plant) for name in each.family.uncertain_names)),
        members=tuple((each.name, each.weight) for each in members_of(spec.plant) if each.name),
        noisy_scenarios=tuple(scenario.name for scenario in spec.scenarios if scenario.noise_std),
    )


def scenario_fractions(spec: DesignSpec, implementation: Implementation) -> tuple[Fraction, ...]:
    """How many of `CHECKED_PLANTS` plants meet each requirement on a scenario, without noise; uniform over the box.

    Args:
        spec: the spec, with requirements on measures of scenarios.
        implementation: the controller that runs.

    Raises:
        DomainError: a loop's delay is too long to be simulated.
    """
    drawn = ValidationSpec(samples=CHECKED_PLANTS, seed=(spec.validation or ValidationSpec()).seed)
    sampler = PlantSampler(spec.plant, drawn)
    modes = [Mode(runtime_of(implementation.sections, spec), sampler.plants)]
    unit = "" if spec.digital is None else spec.digital.measurement_unit
    found: dict[Limit, list[Fraction]] = {limit: [] for limit in spec.scenario_requirements}
    for scenario in spec.scenarios:
        about = limits_about(spec.scenario_requirements, scenario)
        if about:
            run = scenario_of(replace(scenario, noise_std=0.0), implementation, drawn.seed)
            some = sampler.simulate_scenario(about, scenario, modes, run, lambda plants: None, unit=unit)
            for limit, counted in zip(about, some.tallies[2:], strict=True):
                found[limit].append(counted.tally.fraction(drawn.confidence))
    return tuple(min(found[limit], key=lambda each: each.met) for limit in spec.scenario_requirements)


def _limited_scenarios(spec: DesignSpec) -> list[ScenarioSpec]:
    """The scenarios on which there is a limit."""
    return [scenario for scenario in spec.scenarios if limits_about(spec.judged_limits, scenario)]


def _sides(spec: DesignSpec) -> list[tuple[Requirement, bool]]:
    """Every requirement over the family with each of its finite limits; True for the upper one."""
    family = [r for r in spec.requirements if r.scope is Scope.FAMILY]
    return [(r, upper) for r in family for upper in (False, True) if math.isfinite(_limit_of(r, upper))]


@dataclass(frozen=True)
class _MarginSampler:
    spec: DesignSpec
    gains: FoPi
    implementation: Implementation
    sampler: PlantSampler

    def margins(self, first: int, end: int, done: ChunkProgress) -> tuple[tuple[FamilyTally, ...], Flags]:
        """Stability and every requirement over the family, of the draws first to end - 1, and which meet all."""
        sides = _sides(self.spec)

        def margins_of(chunk: tuple[int, int]) -> tuple[list[FamilyTally], Flags]:
            draws = self.sampler.classified(*chunk)
            plants = Plants.members(self.spec.plant, draws.points)
            found = MarginScan(SampledLoops.implemented(self.gains, self.implementation, plants))
            stable = found.unstable_poles < 0.5
            counts, flags = [outcome_tally(draws, np.where(stable, 0.0, 1.0), stable, True)], [stable]
            for requirement, upper in sides:
                values = found.measure(requirement, upper)
                # a value that does not exist is the worst there is: a crossover that |L| never makes, a margin of an
                # unstable loop, which meets nothing.  An infinite margin stays what it is
                values = np.where(np.isnan(values) | ~stable, np.inf if upper else -np.inf, values)
                flags.append(_meets(requirement, upper, values))
                counts.append(outcome_tally(draws, values, flags[-1], upper))
            return counts, all_of(flags)

        parts: list[list[FamilyTally]] = []
        everything: list[Flags] = []
        with ThreadPoolExecutor(available_threads()) as pool:
            chunks = list(self.sampler.chunks(SCANNED, first, end))
            for chunk, (counts, met) in zip(chunks, pool.map(margins_of, chunks), strict=True):
                parts.append(counts)
                everything.append(met)
                done(chunk[1] - first)
        return tuple(merge_family_tallies(column) for column in zip(*parts, strict=True)), np.concatenate(everything)


def _limit_of(requirement: Requirement, upper: bool) -> float:
    return requirement.upper if upper else requirement.lower


def _meets(requirement: Requirement, upper: bool, values: Array) -> Flags:
    """Whether values meet a limit, within the verification's tolerance."""
    quantity, limit = QUANTITIES[requirement.quantity], _limit_of(requirement, upper)
    natural = quantity.to_natural(limit)
    slack = _TOLERANCE * (abs(natural) if requirement.quantity == "delay_margin_s" else 1.0)
    relaxed = quantity.from_natural(natural + slack if upper else natural - slack)
    return values <= relaxed if upper else values >= relaxed
