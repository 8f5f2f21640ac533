"""Evidence by sampling:  a spec, its digital controller and plants drawn from its family -> how often everything holds.

Draw i depends on the seed and on i alone, and so does the noise of its simulation: chunks and threads change nothing,
and each draw can be made again by itself.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled import SampledLoops
from fopi_tune.core.sections import Implementation
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, Limit, Relation, Requirement, ScenarioSpec, Scope, ValidationSpec
from fopi_tune.validation.draws import Design, Draw, outside_box, points
from fopi_tune.validation.judged import MEASURE_VALUES, horizon_of, scenario_of
from fopi_tune.validation.scan import Scan
from fopi_tune.validation.scenario import Array, Mode
from fopi_tune.validation.simulate import measure_chunks
from fopi_tune.validation.statistics import Fraction, Quantile
from fopi_tune.validation.tally import Tally, Worst, merge, tally

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
    """

    requirement: Requirement | None
    limit: Limit | None
    scenario: str | None
    upper: bool
    fraction: Fraction
    quantiles: tuple[Quantile, ...]
    worst: tuple[WorstPlant, ...]


@dataclass(frozen=True)
class Evidence:
    """What sampling says of a digital controller's loop.

    Args:
        validation: how it was drawn.
        stable: fraction of stable loops.
        requirements: over the family; those about the nominal plant alone are not sampled.
        limits: of the scenarios.
        outside: draws outside the family's box, of which no proof speaks.
    """

    validation: ValidationSpec
    stable: Fraction
    requirements: tuple[Judged, ...]
    limits: tuple[Judged, ...]
    outside: int

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
    """
    sampler = _Sampler(spec, gains, implementation, spec.validation or ValidationSpec())
    stable, requirements = sampler.margins(progress)
    limits = tuple(judged for scenario in spec.scenarios for judged in sampler.simulations(scenario))
    return Evidence(sampler.validation, stable, requirements, limits, sampler.outside())


def draw_of(validation: ValidationSpec) -> Draw:
    """The draws that a spec's section `validation` asks for."""
    return Draw(seed=validation.seed, design=Design(validation.design), total=validation.samples)


@dataclass(frozen=True)
class _Sampler:
    spec: DesignSpec
    gains: FoPi
    implementation: Implementation
    validation: ValidationSpec

    @property
    def draw(self) -> Draw:
        return draw_of(self.validation)

    def places(self, first: int, end: int) -> Array:
        return points(self.draw, self.spec.plant, first, end - first)

    def plants(self, first: int, end: int) -> Plants:
        return Plants.members(self.spec.plant, self.places(first, end))

    def chunks(self, size: int) -> Iterator[tuple[int, int]]:
        total = self.validation.samples
        for first in range(0, total, size):
            yield first, min(first + size, total)

    def outside(self) -> int:
        return sum(int(outside_box(self.places(*chunk), self.spec.plant).sum()) for chunk in self.chunks(_SIMULATED))

    # -- margins ------------------------------------------------------------------------------------------------------

    def margins(self, progress: Progress | None) -> tuple[Fraction, tuple[Judged, ...]]:
        """Stability and every requirement over the family."""
        requirements = [r for r in self.spec.requirements if r.scope is Scope.FAMILY]
        sides = [(r, upper) for r in requirements for upper in (False, True) if math.isfinite(_limit_of(r, upper))]

        def scan(chunk: tuple[int, int]) -> list[Tally]:
            loops = SampledLoops.implemented(self.gains, self.implementation, self.plants(*chunk))
            found = Scan(loops)
            stable = found.unstable_poles < 0.5
            tallies = [tally(np.where(stable, 0.0, 1.0), stable, chunk[0], Worst.LARGEST, KEPT)]
            for requirement, upper in sides:
                values = found.measure(requirement, upper)
                # without a gain crossover there is no such number, and the requirement is not met
                values = np.where(np.isnan(values), np.inf if upper else -np.inf, values)
                tallies.append(_tallied(chunk[0], values, _keeps(requirement, upper, values), upper))
            return tallies

        parts: list[list[Tally]] = []
        with ThreadPoolExecutor(_workers()) as pool:
            for chunk, tallies in zip(self.chunks(_SCANNED), pool.map(scan, self.chunks(_SCANNED)), strict=True):
                parts.append(tallies)
                if progress is not None:
                    progress(chunk[1], self.validation.samples)
        whole = [merge(column) for column in zip(*parts, strict=True)]
        judged = [self.judged(t, upper, requirement=r) for t, (r, upper) in zip(whole[1:], sides, strict=True)]
        return whole[0].fraction(self.validation.confidence), tuple(judged)

    # -- simulations --------------------------------------------------------------------------------------------------

    def simulations(self, scenario: ScenarioSpec) -> list[Judged]:
        """Every limit about a scenario."""
        limits = [each for each in self.spec.limits if each.scenario in (None, scenario.name)]
        if not limits:
            return []
        controller = controller_of(self.spec, self.implementation)
        modes, run = [Mode(controller, self.plants)], scenario_of(scenario, self.implementation, self.validation.seed)
        parts: list[list[Tally]] = []
        first = 0
        horizon = horizon_of(scenario, run)
        for measures in measure_chunks(modes, run, horizon, self.validation.samples, chunk=_SIMULATED):
            tallies = []
            for limit in limits:
                upper = limit.relation is Relation.AT_MOST
                values = MEASURE_VALUES[limit.measure](measures)
                values = np.where(np.isnan(values), np.inf if upper else -np.inf, values)
                met = values <= limit.limit if upper else values >= limit.limit
                tallies.append(_tallied(first, values, met, upper))
            parts.append(tallies)
            first += len(measures.finite)
        pairs = zip((merge(column) for column in zip(*parts, strict=True)), limits, strict=True)
        return [self.judged(t, e.relation is Relation.AT_MOST, limit=e, scenario=scenario.name) for t, e in pairs]

    def judged(
        self,
        found: Tally,
        upper: bool,
        *,
        requirement: Requirement | None = None,
        limit: Limit | None = None,
        scenario: str | None = None,
    ) -> Judged:
        confidence = self.validation.confidence
        family = self.spec.plant
        worst = []
        for each in found.worst:
            place = self.places(each.index, each.index + 1)
            inside = not bool(outside_box(place, family)[0])
            worst.append(WorstPlant(each.index, each.value, family.describe(place[0]), inside))
        quantiles = found.quantiles(PROBABILITIES, confidence)
        return Judged(requirement, limit, scenario, upper, found.fraction(confidence), quantiles, tuple(worst))


def controller_of(spec: DesignSpec, implementation: Implementation) -> Runtime:
    """The controller in the arithmetic of the exported double-precision code."""
    limits = spec.digital.output_limits if spec.digital is not None else None
    return Runtime.of(implementation.sections, Precision.FLOAT64, limits)


def _tallied(first: int, values: Array, met: np.ndarray, upper: bool) -> Tally:
    return tally(values, met, first, Worst.LARGEST if upper else Worst.SMALLEST, KEPT)


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
