"""Scenarios of the ideal loop in continuous time:  without filter, sampling and computing delay.

The loop is the exact fractional one (`time_stepping`), without anti-windup, run with two steps to estimate its error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi, refuse_derivative_in, refuse_measurement_filter_in
from fopi_tune.core.plant import Plant
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.quadrature import state_space
from fopi_tune.simulation.fractional.time_stepping import (
    InitialState,
    StepTooLongError,
    TimeResponse,
    simulate_fractional,
)
from fopi_tune.simulation.measures import StepMeasures, horizon_of, measures_of, piecewise_signal, step_measures
from fopi_tune.simulation.scenario import InitialInput, Measures, Scenario, Signals, Start, Traces
from fopi_tune.spec.model import DigitalSpec, Knot, ScenarioSpec

#: steps of the coarser of the two runs: about the first number, never more than the second
_USUAL_STEPS, _MOST_STEPS = 3000, 12_000
#: steps of the finest run where an accuracy is asked for
_FINEST_STEPS = 60_000
#: steps per sample, at most
_MOST_PARTS = 40


@dataclass(frozen=True)
class ContinuousSimulation:
    """One scenario of one plant, or pair of plants, in continuous time.

    Args:
        reference: the setpoint at the times of the traces.
        traces: one row; `demanded` is the control within its limits.
        measures: of the traces.
        steps: those of each step that is judged.
        switch_times_s: when the modes changed; located to 1e-9 s, or to a step where `accuracy` is known.
        accuracy: largest difference of the output to a coarser run; None for a system whose run is exact.
        outcome: one sentence on how a system's run ended; empty for a loop.
    """

    reference: Array
    traces: Traces
    measures: Measures
    steps: StepMeasures
    switch_times_s: tuple[float, ...] = ()
    accuracy: float | None = None
    outcome: str = ""


def simulate_loop(
    scenario: ScenarioSpec, gains: FoPi, plant: Plant, controller: Runtime, sample_time_s: float,
    accuracy: float | None = None,
) -> ContinuousSimulation:  # fmt: skip
    """Simulate one loop.

    Args:
        scenario: without noise, quantum and rate limit.
        gains: the controller.
        plant: the plant.
        controller: gives the control's limits.
        sample_time_s: of the digital controller; a scenario's times are its multiples.
        accuracy: halve the step until the output moves by less than this, in its unit, or there are too many steps;
            None: as it is.

    Raises:
        DomainError: something only a sampled loop has, a derivative, a start without solution, or too many samples.
    """
    refuse_derivative_in(gains, "the exact simulation in continuous time")
    refuse_measurement_filter_in(gains, "the exact simulation in continuous time")
    refuse_samples_only(scenario, controller.limits_rate)
    step, coarse = _step(scenario.duration_s, sample_time_s, plant.dead_time_s), None
    while coarse is None:
        try:
            coarse = _simulate(scenario, gains, plant, controller.limits, step)
        except StepTooLongError:
            step /= 2
            if scenario.duration_s / step > _FINEST_STEPS:
                said = f"the loop is too fast for {_FINEST_STEPS} steps in {scenario.duration_s:g} s of continuous time"
                raise DomainError(f"scenario {scenario.name}: {said}; end earlier") from None
    while True:
        step /= 2
        fine = _simulate(scenario, gains, plant, controller.limits, step)
        shared = min(len(fine.output[::2]), len(coarse.output))
        with np.errstate(all="ignore"):
            reached = float(np.abs(fine.output[::2][:shared] - coarse.output[:shared]).max())
        if accuracy is None or reached <= accuracy or 4 * len(coarse.output) > _FINEST_STEPS:
            break
        coarse = fine
    reference = piecewise_signal(scenario.reference, scenario.initial_output, fine.time_s)
    rows = (fine.output, fine.rate, fine.output, fine.error, fine.control, fine.control)
    traces = Traces(
        fine.time_s,
        *(row[None, :] for row in rows),
        mode=np.ones((1, len(reference)), dtype=np.int64),
        rate_after=fine.rate[None, :],
    )
    run = Scenario(step, Signals(reference), start=start_of(scenario))
    horizon = horizon_of(scenario, run)
    measures = measures_of(traces, [controller], run, horizon)
    return ContinuousSimulation(reference, traces, measures, step_measures(traces, run, horizon), (), reached)


def refuse_loop(scenario: ScenarioSpec, plant: Plant, digital: DigitalSpec) -> None:
    """Refuse, before anything runs, what `simulate_loop` cannot.

    Raises:
        DomainError: as there.
    """
    refuse_samples_only(scenario, digital.output_rate_per_s is not None)
    _step(scenario.duration_s, digital.sample_time_s, plant.dead_time_s)
    _initial_input(scenario, plant)


def refuse_samples_only(scenario: ScenarioSpec, limits_rate: bool) -> None:
    """Refuse noise, quantisation and rate limits.

    Args:
        scenario: may have noise, a quantum or an actuator with a rate limit.
        limits_rate: whether the controller limits its output's rate.

    Raises:
        DomainError: there is one of them; only a sampled loop simulates it.
    """
    if limits_rate:
        raise DomainError("output_rate_per_s belongs to the loop on samples; leave it or `exact=True` out")
    for key, none in (("noise_std", 0.0), ("quantum", 0.0), ("rate_per_s", math.inf)):
        if getattr(scenario, key) != none:
            raise DomainError(
                f"scenario {scenario.name}: {key} belongs to the loop on samples; leave it or `exact=True` out"
            )


def _step(duration_s: float, sample_time_s: float, dead_time_s: float) -> float:
    """A fraction or a multiple of the sample time; if possible one that divides the dead time."""
    samples = duration_s / sample_time_s
    if samples > _MOST_STEPS:
        # then a scenario's steps act late, by less than one of these steps
        whole = sample_time_s * math.ceil(samples / _MOST_STEPS)
        step = dead_time_s / math.ceil(dead_time_s / whole) if dead_time_s else whole
        return _checked_step(step, duration_s, dead_time_s)
    usual = max(1, min(_MOST_PARTS, math.ceil(_USUAL_STEPS / samples)))
    for parts in range(usual, usual + _MOST_PARTS):
        lag = dead_time_s * parts / sample_time_s
        if abs(lag - round(lag)) <= 1e-9 * max(1.0, lag) and parts * samples <= _MOST_STEPS:
            return sample_time_s / parts
    # no such fraction: then a scenario's steps act late, by less than one of these steps
    return _checked_step(dead_time_s / math.ceil(dead_time_s * usual / sample_time_s), duration_s, dead_time_s)


def _checked_step(step: float, duration_s: float, dead_time_s: float) -> float:
    if duration_s / step > 2 * _MOST_STEPS:
        raise DomainError(
            f"a dead time of {dead_time_s:g} s is too short for {duration_s:g} s in continuous time: more than "
            f"{2 * _MOST_STEPS} steps; end earlier"
        )
    return step


def _simulate(
    scenario: ScenarioSpec, gains: FoPi, plant: Plant, limits: tuple[float, float], step: float
) -> TimeResponse:
    steps = max(1, round(scenario.duration_s / step))
    times = np.asarray(step * np.arange(steps + 1), dtype=float)

    def sides(knots: Sequence[Knot], before: float) -> tuple[Array, Array]:
        return piecewise_signal(knots, before, times, just_before=True), piecewise_signal(knots, before, times)

    past = _initial_input(scenario, plant)
    model = state_space(plant)
    state = np.zeros(len(model.a))
    if scenario.initial_output and scenario.before == InitialInput.FREE.value:
        state[0] = scenario.initial_output
    elif scenario.initial_output and len(state):
        # at rest: A x + B u = 0 and C x + g u = y0; an integrator's A is singular
        rest = np.concatenate([-model.b * past, [scenario.initial_output - model.direct * past]])
        state = np.linalg.lstsq(np.vstack([model.a, model.c]), rest)[0]
    # without ki there is no integral to start from: the loop on samples starts at kp e too
    integral = past / gains.ki if scenario.bumpless and gains.ki != 0.0 else 0.0
    start = InitialState(tuple(state.tolist()), integral, past)
    load = sides(scenario.load, 0.0)
    reference = sides(scenario.reference, scenario.initial_output)
    # an unstable loop may overflow: its measures are then not known
    with np.errstate(all="ignore"):
        return simulate_fractional(gains, plant, reference, step, steps, limits=limits, load=load, start=start)


def _initial_input(scenario: ScenarioSpec, plant: Plant) -> float:
    """The input before the start, as in `sampled.plants.DiscretePlants.initial_state`."""
    y0, order = scenario.initial_output, len(plant.denominator) - 1
    if y0 == 0.0:
        return 0.0
    if scenario.before == InitialInput.FREE.value:
        if order != 1:
            raise DomainError(f"an initial output without input needs plants of order 1, not {order}")
        return 0.0
    if plant.numerator[-1] == 0.0:
        raise DomainError(f"no input holds a plant at {y0!r}, because P(0) is 0; start it at initial_output: 0")
    return y0 * plant.denominator[-1] / plant.numerator[-1]


def start_of(scenario: ScenarioSpec) -> Start:
    """How a scenario starts."""
    return Start(scenario.initial_output, InitialInput(scenario.before), scenario.bumpless)
