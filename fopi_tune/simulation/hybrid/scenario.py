"""Scenarios of a system in continuous time:  the hybrid inclusion, without samples and computing delay.

s^-alpha is replaced by a filter whose relative error is at most 2e-4 from 1e-3 to 1e2 rad/s.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant
from fopi_tune.digital.oustaloup import oustaloup
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.continuous import ContinuousSimulation, refuse_samples_only, start_of
from fopi_tune.simulation.hybrid.flow import PURE_INTEGRAL, ModeLoop
from fopi_tune.simulation.hybrid.inclusion import simulate_hybrid
from fopi_tune.simulation.hybrid.model import Corner, HybridCar, HybridOutcome, HybridStart, Memory, Mode, Watch
from fopi_tune.simulation.measures import horizon_of, measures_of, piecewise_signal
from fopi_tune.simulation.scenario import Hybrid, InitialInput, Scenario, Signals, Traces
from fopi_tune.spec.model import ScenarioSpec, SystemSpec

_MEMORY = {"held": Memory.HELD, "tracking": Memory.TRACKING, "reset": Memory.RESET}
#: poles and band of the filter for s^-alpha, and the number of stored times per sample
_POLES, _BAND = 39, (1e-7, 1e6)
_KEPT = 10


def simulate_inclusion(
    system: SystemSpec, scenario: ScenarioSpec, gains: Sequence[FoPi], plants: Sequence[Plant],
    controllers: Sequence[Runtime], sample_time_s: float,
) -> ContinuousSimulation:  # fmt: skip
    """Simulate a system.

    Args:
        system: gives hysteresis, first mode and memory.
        scenario: without noise, quantum, rate limit and load.
        gains: throttle first.
        plants: of first order, throttle first.
        controllers: give the controls' limits.
        sample_time_s: of the digital controllers.

    Raises:
        DomainError: the scenario has something only a sampled loop has, or invalid numbers.
    """
    refuse_samples_only(scenario)
    if scenario.load:
        raise DomainError(f"scenario {scenario.name}: a system in continuous time has no load; leave it or --exact out")
    loops = [
        _mode_loop(plant, gain, controller.limits)
        for plant, gain, controller in zip(plants, gains, controllers, strict=True)
    ]
    first = Mode.THROTTLE if system.first == system.modes[0].name else Mode.BRAKE
    car = HybridCar(*loops, eps=system.hysteresis, memory=_MEMORY[system.inactive])
    loop = car.loop(first)
    past = scenario.initial_output * loop.pole_rad_s / loop.gain if scenario.before == InitialInput.REST.value else 0.0
    start = HybridStart(scenario.initial_output, first, loop.saturate(past) if scenario.bumpless else None)
    step = sample_time_s / _KEPT
    times = step * np.arange(round(scenario.duration_s / step) + 1)
    times = np.minimum(times, scenario.duration_s)
    watch = Watch(system.most_switches, system.chattering_window_s)
    found = simulate_hybrid(car, _corners(scenario), scenario.duration_s, np.unique(times), start=start, watch=watch)
    reference = piecewise_signal(scenario.reference, scenario.initial_output, found.time_s)
    rows = (found.output, found.rate, found.output, found.error, found.control, found.control)
    traces = Traces(
        found.time_s,
        *(row[None, :] for row in rows),
        mode=found.mode[None, :].astype(np.int64),
        rate_after=found.rate[None, :],
    )
    hybrid = Hybrid(system.hysteresis, first=int(first))
    run = Scenario(step, Signals(reference), start=start_of(scenario), hybrid=hybrid)
    measures = measures_of(traces, controllers, run, horizon_of(scenario, run))
    if found.outcome is not HybridOutcome.FINISHED:
        # the run ended early: its measures are not known
        names = [field.name for field in fields(measures) if getattr(measures, field.name).dtype == float]
        measures = replace(measures, **dict.fromkeys(names, np.array([math.nan])), finite=np.array([False]))
    # counted from the located jumps: there may be several between two stored times
    chattering = np.array([found.outcome is HybridOutcome.CHATTERING])
    measures = replace(measures, switches=np.array([len(found.events)]), chattering=chattering)
    switches = tuple(event.time_s for event in found.events)
    return ContinuousSimulation(reference, traces, measures, switches, None, found.reason)


def _mode_loop(plant: Plant, gains: FoPi, limits: tuple[float, float]) -> ModeLoop:
    lead, rest = plant.denominator
    integral = PURE_INTEGRAL if gains.alpha == 1.0 else oustaloup(gains.alpha, _POLES, _BAND)
    # a runtime without limits has the largest floats as limits
    low, high = (limit if abs(limit) < sys.float_info.max else math.copysign(math.inf, limit) for limit in limits)
    return ModeLoop(plant.numerator[-1] / lead, rest / lead, gains, integral, (low, high))


def _corners(scenario: ScenarioSpec) -> list[Corner]:
    """The reference as corners."""
    value, corners = scenario.initial_output, [Corner(0.0, scenario.initial_output)]

    def put(corner: Corner) -> None:
        if corners[-1].time_s == corner.time_s:
            corners.pop()
        corners.append(corner)

    for knot in scenario.reference:
        if knot.at_s >= scenario.duration_s:
            break
        if knot.ramp_s > 0.0:
            put(Corner(knot.at_s, value, (knot.value - value) / knot.ramp_s))
            if knot.at_s + knot.ramp_s < scenario.duration_s:
                put(Corner(knot.at_s + knot.ramp_s, knot.value))
        else:
            put(Corner(knot.at_s, knot.value))
        value = knot.value
    return corners
