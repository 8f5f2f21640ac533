"""Evidence by sampling:  a spec, its digital controller and plants drawn from its family -> how often everything holds.

Draw i depends on the seed and on i alone, and so does the noise of its simulation: chunks and threads change nothing,
and each draw can be made again by itself.  Draws may leave the family (`counted`): what is proved is not about those.
"""

from __future__ import annotations

import math
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
from fopi_tune.spec.model import DesignSpec, Requirement, Scope, ValidationSpec
from fopi_tune.validation.counted import Counted, merge_counts
from fopi_tune.validation.drawn import Done, Drawn, Judged, Progress, counted, limits_about, steps_of
from fopi_tune.validation.judged import scenario_of
from fopi_tune.validation.scan import Scan
from fopi_tune.validation.scenario import Array, Mode
from fopi_tune.validation.statistics import Fraction
from fopi_tune.validation.threads import threads

#: plants whose margins are scanned at once
_SCANNED = 512
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
    drawn = Drawn(spec.plant, spec.validation or ValidationSpec())
    outside, no_plants = drawn.strays()
    driven = [scenario for scenario in spec.scenarios if limits_about(spec.limits, scenario)]
    done = steps_of(progress, drawn.validation.samples, 1 + len(driven))
    stable, requirements = _Scanner(spec, gains, implementation, drawn).margins(done[0])
    modes = [Mode(controller_of(spec, implementation), drawn.plants)]
    limits: list[Judged] = []
    for scenario, each in zip(driven, done[1:], strict=True):
        run = scenario_of(scenario, implementation, drawn.seed)
        limits += drawn.simulations(spec.limits, scenario, modes, run, each).limits
    return Evidence(
        validation=drawn.validation,
        stable=stable.tally.fraction(drawn.validation.confidence),
        requirements=requirements,
        limits=tuple(limits),
        outside=outside,
        unstable_inside=stable.missed_inside,
        no_plants=no_plants,
        numbers=spec.plant.uncertain_names,
    )


@dataclass(frozen=True)
class _Scanner:
    spec: DesignSpec
    gains: FoPi
    implementation: Implementation
    drawn: Drawn

    def margins(self, done: Done) -> tuple[Counted, tuple[Judged, ...]]:
        """Stability and every requirement over the family."""
        requirements = [r for r in self.spec.requirements if r.scope is Scope.FAMILY]
        sides = [(r, upper) for r in requirements for upper in (False, True) if math.isfinite(_limit_of(r, upper))]

        def scan(chunk: tuple[int, int]) -> list[Counted]:
            drawn = self.drawn.marked(*chunk)
            plants = Plants.members(self.spec.plant, drawn.places)
            found = Scan(SampledLoops.implemented(self.gains, self.implementation, plants))
            stable = found.unstable_poles < 0.5
            counts = [counted(drawn, np.where(stable, 0.0, 1.0), stable, True)]
            for requirement, upper in sides:
                values = found.measure(requirement, upper)
                # without a gain crossover there is no such number, and the requirement is not met
                # nor does an unstable loop meet any
                values = np.where(np.isnan(values) | ~stable, np.inf if upper else -np.inf, values)
                counts.append(counted(drawn, values, _keeps(requirement, upper, values), upper))
            return counts

        parts: list[list[Counted]] = []
        with ThreadPoolExecutor(threads()) as pool:
            chunks = list(self.drawn.chunks(_SCANNED))
            for chunk, counts in zip(chunks, pool.map(scan, chunks), strict=True):
                parts.append(counts)
                done(chunk[1])
        whole = [merge_counts(column) for column in zip(*parts, strict=True)]
        judged = [self.drawn.judged(t, upper, requirement=r) for t, (r, upper) in zip(whole[1:], sides, strict=True)]
        return whole[0], tuple(judged)


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
