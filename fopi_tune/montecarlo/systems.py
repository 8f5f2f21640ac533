"""Systems of two switched loops on samples:  SystemSpec, implementations -> modes, scenario and evidence.

Each mode's plants come from its own columns of a draw from the joint box (`SystemSpec.family`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.terms.feedforward import fed_by
from fopi_tune.digital.implementation import runtime_of
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.montecarlo.joint import JointYield, all_of
from fopi_tune.montecarlo.outcomes import PlantSampler, Progress, ScenarioStatistics, split_progress
from fopi_tune.simulation.measures import scenario_of
from fopi_tune.simulation.scenario import Hybrid, InactiveController, Mode, PlantSupplier, Scenario
from fopi_tune.spec.model import ModeSpec, ScenarioSpec, SystemSpec, ValidationSpec

#: uncertain numbers of the draws first to end - 1, shape (end - first, p), columns as the joint box's
PointSource = Callable[[int, int], Array]


@dataclass(frozen=True)
class SystemEvidence:
    """The evidence about a system.

    Args:
        validation: how plants were drawn.
        scenarios: what was simulated, and how often the limits were met.
        outside: pairs outside the box.
        no_plants: draws that are no plants; they enter no other count.
        numbers: names of the uncertain numbers.
        joint: how many pairs met everything in every scenario.
    """

    validation: ValidationSpec
    scenarios: tuple[ScenarioStatistics, ...]
    outside: int
    joint: JointYield
    no_plants: int = 0
    numbers: tuple[str, ...] = ()

    @property
    def all_met(self) -> bool:
        """Whether every drawn plant stays finite, does not chatter, and meets every limit."""
        every = [f for s in self.scenarios for f in (s.finite, s.calm, *(outcome.fraction for outcome in s.limits))]
        return all(fraction.met == fraction.total for fraction in every)


def modes_of(system: SystemSpec, implementations: Sequence[Implementation], points: PointSource) -> list[Mode]:
    """Both modes of a system, with the plants at these points.

    Args:
        system: the system.
        implementations: the controllers that run, in the order of the modes.
        points: see `PointSource`.
    """
    family = system.family

    def supply(mode: ModeSpec) -> PlantSupplier:
        columns = family.columns(mode.name)
        return lambda first, end: Plants.members(mode.spec.plant, points(first, end)[:, columns])

    return [
        Mode(runtime_of(implementation.sections, mode.spec), supply(mode))
        for mode, implementation in zip(system.modes, implementations, strict=True)
    ]


def hybrid_scenario(system: SystemSpec, scenario: ScenarioSpec, implementation: Implementation, seed: int) -> Scenario:
    """A system's scenario on its samples.

    Args:
        system: gives hysteresis, minimum dwell, first mode and the inactive controller's behaviour.
        scenario: the spec's.
        implementation: of either mode; gives the sample time, and the delay where both have the same.
        seed: of the noise.
    """
    names = [mode.name for mode in system.modes]
    hybrid = Hybrid(
        system.hysteresis,
        InactiveController.of(Memory(system.inactive)),
        1 + names.index(system.first),
        system.most_switches,
        system.chattering_window_s,
        system.min_dwell_samples,
        fed_by(tuple(mode.feedforward for mode in system.modes), system.sample_time_s),
        system.hold_below,
        system.own_delays,
    )
    run = scenario_of(scenario, implementation, seed)
    if hybrid.delay_samples:
        run = replace(run, actuator=replace(run.actuator, delay_samples=0.0))
    return replace(run, hybrid=hybrid)


def system_evidence(
    system: SystemSpec, implementations: Sequence[Implementation], progress: Progress | None = None
) -> SystemEvidence:
    """Draw pairs of plants, and check the system's limits on each in its scenarios.

    Args:
        system: the spec; its section `validation` says how many plants.
        implementations: the controllers that run, in the order of the modes.
        progress: called with the number of plants done.
    """
    sampler = PlantSampler(system.family, system.validation or ValidationSpec())
    modes = modes_of(system, implementations, lambda first, end: sampler.classified(first, end).points)
    outside, no_plants = sampler.count_outside()
    sampler.check_plants(no_plants)
    done = split_progress(progress, sampler.validation.samples, len(system.scenarios))
    found, met = [], []
    for scenario, each in zip(system.scenarios, done, strict=True):
        run = hybrid_scenario(system, scenario, implementations[0], sampler.seed)
        some = sampler.simulate_scenario(system.judged_limits, scenario, modes, run, each, unit=system.measurement_unit)
        joint = sampler.joint_tally(some.met, 0)
        found.append(sampler.scenario_statistics(system.judged_limits, scenario, some.tallies, joint))
        met.append(some.met)
    joint = JointYield.of(sampler.joint_tally(all_of(met), 0), sampler.validation.confidence)
    return SystemEvidence(sampler.validation, tuple(found), outside, joint, no_plants, system.family.uncertain_names)
