"""Scenarios of a system in continuous time:  the hybrid inclusion, without samples, noise and rate limit.

s^-alpha is replaced by a filter whose relative error is at most 2e-4 from 1e-3 to 1e2 rad/s.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant
from fopi_tune.core.terms.feedforward import fed_by
from fopi_tune.digital.oustaloup import oustaloup
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.continuous import ContinuousSimulation, refuse_samples_only, start_of
from fopi_tune.simulation.hybrid.delayed import SteppedSignals, simulate_stepped
from fopi_tune.simulation.hybrid.flow import PURE_INTEGRAL, ModeLoop
from fopi_tune.simulation.hybrid.inclusion import simulate_hybrid
from fopi_tune.simulation.hybrid.model import Corner, HybridCar, HybridOutcome, HybridStart, Mode, Watch
from fopi_tune.simulation.measures import horizon_of, measures_of, piecewise_signal, step_measures
from fopi_tune.simulation.scenario import Hybrid, InitialInput, Scenario, Signals, Traces
from fopi_tune.spec.model import Knot, ScenarioSpec, SystemSpec

#: poles of the filter for s^-alpha, refined from the first on, its band, and the number of stored times per sample
_POLES, _BAND = (39, 51, 65), (1e-7, 1e6)
_KEPT = 10
#: steps of a run in equal steps: about the first number before it is refined, never more than the second
_STEPS, _MOST_STEPS = 3000, 200_000


def simulate_inclusion(
    system: SystemSpec, scenario: ScenarioSpec, gains: Sequence[FoPi], plants: Sequence[Plant],
    controllers: Sequence[Runtime], sample_time_s: float, accuracy: float | None = None,
) -> ContinuousSimulation:  # fmt: skip
    """Simulate a system: with located jumps, or in equal steps where it has a computing delay, a load, a coast or
    a standstill.

    Args:
        system: gives hysteresis, minimum dwell, first mode, memory and the computing delay.
        scenario: without noise, quantum and rate limit.
        gains: of the raising mode first.
        plants: of first order, in the same order.
        controllers: give the controls' limits.
        sample_time_s: of the digital controllers.
        accuracy: refine until the output moves by less than this, in its unit; None: as it is.

    Raises:
        DomainError: the scenario has something only a sampled loop has, or invalid numbers.
    """
    refuse_samples_only(scenario, any(controller.limits_rate for controller in controllers))
    refuse_what_is_sampled(system, scenario)

    def run(refined: int) -> _Run:
        return _simulated(system, scenario, gains, plants, controllers, sample_time_s, refined)

    found, reached, most = run(0), None, 0
    if _is_stepped(system, scenario):
        most = int(math.log2(_MOST_STEPS / (len(found.time_s) - 1)))
    elif accuracy is not None and any(each.alpha != 1.0 for each in gains):
        most = len(_POLES) - 1
    for refined in range(1, (1 if accuracy is None else most) + 1 if most else 1):
        finer = run(refined)
        reached, found = _difference(found, finer), finer
        if accuracy is not None and reached <= accuracy:
            break
    return _result(system, scenario, controllers, found, reached)


def computing_delay_s(system: SystemSpec) -> float:
    """From the measurement to the new control, s; both modes have the same."""
    digital = system.modes[0].spec.digital
    return 0.0 if digital is None else digital.delay_samples * digital.sample_time_s


def refuse_what_is_sampled(system: SystemSpec, scenario: ScenarioSpec) -> None:
    """Refuse what only a simulation of the system on samples has.

    Args:
        system: to be simulated.
        scenario: of it.

    Raises:
        DomainError: there is such a thing.
    """
    if system.own_delays:
        raise DomainError(
            "delay_samples that differ are simulated on samples; make them equal, or leave `exact=True` out"
        )
    for mode in system.modes:
        order = len(mode.spec.plant.assemble({})[1]) - 1
        if mode.spec.plant.dead_time.max > 0.0:
            raise DomainError(
                f"{mode.name}: the dead time of its plant is simulated on samples; leave `exact=True` out, or "
                "write whole samples of it as delay_samples"
            )
        if order != 1:
            raise DomainError(
                f"{mode.name}: its plant of order {order} is simulated on samples; leave `exact=True` out"
            )
        if mode.feedforward is not None and mode.feedforward.rate_gain and _has_step(scenario):
            limits = mode.spec.digital.output_limits if mode.spec.digital is not None else None
            if limits is None:
                raise DomainError(
                    f"{mode.name}: the rate_gain of its feedforward makes an impulse of a step of the setpoint; write "
                    "output_limits, which cut it, or a ramp_s, or leave `exact=True` out"
                )


def _has_step(scenario: ScenarioSpec) -> bool:
    """Whether the setpoint jumps."""
    before = [scenario.initial_output, *(knot.value for knot in scenario.reference)]
    pairs = zip(scenario.reference, before, strict=False)
    return any(knot.ramp_s == 0.0 and knot.value != last for knot, last in pairs)


def _is_stepped(system: SystemSpec, scenario: ScenarioSpec) -> bool:
    """Whether a system's jumps cannot be located."""
    return (
        bool(scenario.load)
        or computing_delay_s(system) > 0.0
        or system.lines.coasts
        or bool(system.hold_below)
        or _is_fed(system)
    )


def _is_fed(system: SystemSpec) -> bool:
    return any(mode.feedforward is not None for mode in system.modes)


@dataclass(frozen=True, eq=False)
class _Run:
    """One run: the step between stored times, these, its signals at them, its jumps, and how it ended."""

    step_s: float
    time_s: Array
    rows: tuple[Array, ...]
    mode: np.ndarray
    jumps_s: tuple[float, ...]
    outcome: HybridOutcome
    reason: str


def _simulated(
    system: SystemSpec, scenario: ScenarioSpec, gains: Sequence[FoPi], plants: Sequence[Plant],
    controllers: Sequence[Runtime], sample_time_s: float, refined: int,
) -> _Run:  # fmt: skip
    poles = _POLES[min(refined, len(_POLES) - 1)]
    loops = [
        _mode_loop(plant, gain, controller.limits, poles)
        for plant, gain, controller in zip(plants, gains, controllers, strict=True)
    ]
    first = Mode.THROTTLE if system.first == system.modes[0].name else Mode.BRAKE
    # without any integral there is nothing to track
    memory = Memory(system.inactive) if any(gain.ki for gain in gains) else Memory.HELD
    # in continuous time the rate is dr/dt itself, as if a sample lasted a second
    fed = fed_by(tuple(mode.feedforward for mode in system.modes), 1.0)
    raises, lowers = loops
    car = HybridCar(raises, lowers, system.hysteresis, memory, system.min_dwell_s, system.hold_below, fed)
    loop = car.loop(first)
    at_rest = scenario.before == InitialInput.REST.value
    past = scenario.initial_output * loop.pole_rad_s / loop.gain if at_rest else 0.0
    bumpless = scenario.bumpless and loop.gains.ki != 0.0
    start = HybridStart(scenario.initial_output, first, loop.saturate(past) if bumpless else None)
    watch = Watch(system.most_switches, system.chattering_window_s)
    if _is_stepped(system, scenario):
        return _in_steps(system, scenario, car, sample_time_s, start, past, watch, refined)
    step = sample_time_s / _KEPT
    times = step * np.arange(round(scenario.duration_s / step) + 1)
    times = np.unique(np.minimum(times, scenario.duration_s))
    found = simulate_hybrid(car, _corners(scenario), scenario.duration_s, times, start=start, watch=watch)
    jumps = tuple(event.time_s for event in found.events)
    rows = (found.output, found.rate, found.rate, found.control)
    return _Run(step, found.time_s, rows, found.mode, jumps, found.outcome, found.reason)


def _in_steps(
    system: SystemSpec, scenario: ScenarioSpec, car: HybridCar, sample_time_s: float, start: HybridStart, past: float,
    watch: Watch, refined: int,
) -> _Run:  # fmt: skip
    samples = scenario.duration_s / sample_time_s
    parts = max(1, round(_STEPS / samples))
    delay = computing_delay_s(system) / sample_time_s
    # a step that divides the delay, if a few more of them to a sample give one
    parts = next((k for k in range(parts, 2 * parts + 20) if abs(k * delay - round(k * delay)) < 1e-9 * k), parts)
    parts *= 2**refined
    step = sample_time_s / parts
    count = max(1, round(scenario.duration_s / step))
    if refined == 0 and count > _MOST_STEPS // 2:
        raise DomainError(
            f"scenario {scenario.name}: {samples:.0f} samples are too many in continuous time; end earlier"
        )
    times = np.asarray(step * np.arange(count + 1), dtype=float)

    def sides(knots: Sequence[Knot], before: float) -> tuple[Array, Array]:
        return piecewise_signal(knots, before, times, just_before=True), piecewise_signal(knots, before, times)

    signals = SteppedSignals(sides(scenario.reference, scenario.initial_output), sides(scenario.load, 0.0))
    found = simulate_stepped(car, signals, step, round(parts * delay), start, past, watch)
    jumps = tuple(float(times[n]) for n in found.jumps)
    rows = (found.output, found.rate, found.rate_after, found.control)
    with_delay = f", with {delay * sample_time_s:g} s of computing delay" if delay else ""
    reason = f"{found.reason}; in steps of {step:.3g} s{with_delay}"
    return _Run(step, times[: len(found.output)], rows, found.mode, jumps, found.outcome, reason)


def _difference(coarse: _Run, fine: _Run) -> float:
    """The largest difference of the output at the times that both runs have."""
    every = max(1, round(coarse.step_s / fine.step_s))
    one, two = coarse.rows[0], fine.rows[0][::every]
    shared = min(len(one), len(two))
    return float(np.abs(one[:shared] - two[:shared]).max())


def _result(
    system: SystemSpec, scenario: ScenarioSpec, controllers: Sequence[Runtime], found: _Run, accuracy: float | None
) -> ContinuousSimulation:
    output, rate, rate_after, control = found.rows
    reference = piecewise_signal(scenario.reference, scenario.initial_output, found.time_s)
    signals = (output, rate, output, reference - output, control, control)
    traces = Traces(
        found.time_s,
        *(row[None, :] for row in signals),
        mode=found.mode[None, :].astype(np.int64),
        rate_after=rate_after[None, :],
    )
    first = 1 if system.first == system.modes[0].name else 2
    hybrid = Hybrid(system.hysteresis, first=first)
    run = Scenario(found.step_s, Signals(reference), start=start_of(scenario), hybrid=hybrid)
    horizon = horizon_of(scenario, run)
    measures = measures_of(traces, controllers, run, horizon)
    if found.outcome is not HybridOutcome.FINISHED:
        # the run ended early: its measures are not known
        names = [field.name for field in fields(measures) if getattr(measures, field.name).dtype == float]
        measures = replace(measures, **dict.fromkeys(names, np.array([math.nan])), finite=np.array([False]))
    # counted from the located jumps: there may be several between two stored times
    chattering = np.array([found.outcome is HybridOutcome.CHATTERING])
    measures = replace(measures, switches=np.array([len(found.jumps_s)]), chattering=chattering)
    steps = step_measures(traces, run, horizon)
    return ContinuousSimulation(reference, traces, measures, steps, found.jumps_s, accuracy, found.reason)


def _mode_loop(plant: Plant, gains: FoPi, limits: tuple[float, float], poles: int) -> ModeLoop:
    lead, rest = plant.denominator
    integral = PURE_INTEGRAL if gains.alpha == 1.0 else oustaloup(gains.alpha, poles, _BAND)
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
