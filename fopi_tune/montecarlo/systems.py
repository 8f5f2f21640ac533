"""Systems of two loops on samples:  SystemSpec, gains -> modes, scenario and evidence.

Each mode's plants come from its own columns of a draw from the joint box (`SystemSpec.family`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.sections import Implementation
from fopi_tune.montecarlo.montecarlo import controller_of
from fopi_tune.montecarlo.outcomes import PlantSampler, Progress, ScenarioStatistics, split_progress
from fopi_tune.simulation.measures import scenario_of
from fopi_tune.simulation.scenario import Hybrid, InactiveController, Mode, PlantSupplier, Scenario
from fopi_tune.spec.model import ModeSpec, ScenarioSpec, SystemSpec, ValidationSpec

_INACTIVE = {"held": InactiveController.HOLD, "tracking": InactiveController.TRACK, "reset": InactiveController.RESET}

#: uncertain numbers of the draws first to end - 1, shape (end - first, p), columns as the joint box's
PointSource = Callable[[int, int], Array]


@dataclass(frozen=True)
class SystemEvidence:
    """What sampling says of a system.

    Args:
        validation: how it was drawn.
        scenarios: what was driven, and how often it kept its limits.
        outside: pairs outside the box.
        no_plants: draws that are no plants; they count nowhere else.
        numbers: names of the uncertain numbers.
    """

    validation: ValidationSpec
    scenarios: tuple[ScenarioStatistics, ...]
    outside: int
    no_plants: int = 0
    numbers: tuple[str, ...] = ()

    @property
    def all_met(self) -> bool:
        """Whether every drawn plant stays finite, does not chatter, and meets every limit."""
        every = [f for s in self.scenarios for f in (s.finite, s.calm, *(judged.fraction for judged in s.limits))]
        return all(fraction.met == fraction.total for fraction in every)


def modes_of(system: SystemSpec, implementations: Sequence[Implementation], places: PointSource) -> list[Mode]:
    """Both modes of a system for the plants at these places.

    Args:
        system: the system.
        implementations: the controllers that run, throttle first.
        places: see `Places`.
    """
    split = len(system.modes[0].spec.plant.uncertain_names)

    def supply(mode: ModeSpec, columns: slice) -> PlantSupplier:
        return lambda first, end: Plants.members(mode.spec.plant, places(first, end)[:, columns])

    return [
        Mode(controller_of(mode.spec, implementation), supply(mode, columns))
        for mode, implementation, columns in zip(
            system.modes, implementations, (slice(0, split), slice(split, None)), strict=True
        )
    ]


def hybrid_scenario(system: SystemSpec, scenario: ScenarioSpec, implementation: Implementation, seed: int) -> Scenario:
    """A system's scenario on its samples.

    Args:
        system: how it switches.
        scenario: what is driven.
        implementation: of either mode; gives sample time and delay.
        seed: of the noise.
    """
    names = [mode.name for mode in system.modes]
    hybrid = Hybrid(
        system.hysteresis,
        _INACTIVE[system.inactive],
        1 + names.index(system.first),
        system.most_switches,
        system.window_s,
    )
    return replace(scenario_of(scenario, implementation, seed), hybrid=hybrid)


def system_evidence(
    system: SystemSpec, implementations: Sequence[Implementation], progress: Progress | None = None
) -> SystemEvidence:
    """Draw pairs of plants, and judge each by the system's limits in its scenarios.

    Args:
        system: what is asked; its section `validation` says how many plants.
        implementations: the controllers that run, throttle first.
        progress: told how many plants are done.
    """
    drawn = PlantSampler(system.family, system.validation or ValidationSpec())
    modes = modes_of(system, implementations, lambda first, end: drawn.marked(first, end).places)
    outside, no_plants = drawn.strays()
    drawn.check_plants(no_plants)
    done = split_progress(progress, drawn.validation.samples, len(system.scenarios))
    found = []
    for scenario, each in zip(system.scenarios, done, strict=True):
        run = hybrid_scenario(system, scenario, implementations[0], drawn.seed)
        counts = drawn.simulated(system.limits, scenario, modes, run, each)
        found.append(drawn.simulations(system.limits, scenario, counts))
    return SystemEvidence(drawn.validation, tuple(found), outside, no_plants, system.family.uncertain_names)
