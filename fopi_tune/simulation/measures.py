"""A spec's scenarios on samples, and the measures that its limits name:  traces -> Measures -> word of the spec.

`measures_of` reads them off whole traces, by their definitions in `simulation.scenario.Measures`; the compiled
simulation collects the same sample by sample (`sampled.plant_stages`, `sampled.controller_stages`); tests compare them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.simulation.scenario import (
    Actuator,
    Horizon,
    InitialInput,
    Measures,
    Scenario,
    Sensor,
    Signals,
    Start,
    Step,
    Traces,
)
from fopi_tune.spec.measures import ACCELERATION, JERK, PER_M_S, acceleration_problem, velocity_unit
from fopi_tune.spec.model import Knot, ScenarioSpec

#: settling band as a share of a step, where the spec gives none
_SETTLED = 0.02

#: word after `limits:` -> the measure, shape (m,), in the output's unit, to which `measure_values` adds the velocity's
MEASURE_VALUES: dict[str, Callable[[Measures], Array]] = {
    ACCELERATION: lambda found: found.peak_rate,
    "peak_rate_per_s": lambda found: found.peak_rate,
    JERK: lambda found: found.peak_jerk,
    "overshoot": lambda found: found.overshoot,
    "undershoot": lambda found: found.undershoot,
    "settling_time_s": lambda found: found.settling_s,
    "rise_time_s": lambda found: found.rise_s,
    "iae": lambda found: found.iae,
    "ise": lambda found: found.ise,
    "saturation_time_s": lambda found: found.saturated_s,
    "peak_control": lambda found: found.peak_control,
    "final_error": lambda found: np.abs(found.final_error),
    "switch_count": lambda found: np.where(found.finite, found.switches, np.nan),
}


def scenario_of(scenario: ScenarioSpec, implementation: Implementation, seed: int) -> Scenario:
    """A spec's scenario on the samples of a controller.

    Args:
        scenario: the spec's.
        implementation: gives the sample time and the computing delay.
        seed: of the noise.
    """
    step = implementation.sample_time_s
    time_s = np.asarray(step * np.arange(max(1, round(scenario.duration_s / step)) + 1), dtype=float)
    load = piecewise_signal(scenario.load, 0.0, time_s) if scenario.load else None
    return Scenario(
        sample_time_s=step,
        signals=Signals(piecewise_signal(scenario.reference, scenario.initial_output, time_s), load),
        sensor=Sensor(scenario.quantum, scenario.noise_std, seed),
        actuator=Actuator(scenario.rate_per_s, implementation.delay_samples),
        start=Start(scenario.initial_output, InitialInput(scenario.before), scenario.bumpless),
    )


def measure_values(measures: Measures, name: str, measurement_unit: str) -> Array:
    """A measure by its word after `limits:`, shape (m,).

    Args:
        measures: of m plants.
        name: a key of `spec.model.MEASURES`.
        measurement_unit: of the output; an acceleration needs a velocity.

    Raises:
        DomainError: an acceleration where the unit is no velocity.
    """
    values = MEASURE_VALUES[name](measures)
    if name != ACCELERATION:
        return values
    unit = velocity_unit(measurement_unit)
    if unit is None:
        raise DomainError(acceleration_problem(measurement_unit))
    return values / PER_M_S[unit]


def horizon_of(scenario: ScenarioSpec, run: Scenario) -> Horizon:
    """The samples over which its measures are taken, and the steps that are judged.

    A step that is over at `judged_from_s` is none any more, one that is under way is judged from there on.
    """
    reference = run.signals.reference
    first = min(_first_sample(scenario.judged_from_s, run), len(reference) - 1)

    def band(size: float) -> float:
        return scenario.settling_band if scenario.settling_band is not None else _SETTLED * abs(size)

    changes = _changes(scenario.reference, scenario.initial_output, run)
    steps = [Step(k, at, before, value, band(value - before)) for k, at, before, value in changes]
    last = next((step for step in reversed(steps) if step.first < first), None)
    steps = [step for step in steps if step.first >= first]
    under_way = last is not None and float(reference[first - 1]) != last.value
    if under_way or not steps:
        value = scenario.initial_output if last is None else last.value
        before = float(reference[first - 1]) if under_way else value
        width = band(value) if last is None else last.band
        at = first * run.sample_time_s
        if not steps or steps[0].first > first:
            steps = [Step(first, at, before, value, width), *steps]
    loads = [Step(k, at, 0.0, 0.0, 0.0, of_load=True) for k, at, *_ in _changes(scenario.load, 0.0, run)]
    return Horizon(steps[-1].band, first, tuple(_with_loads(steps, loads)))


def _with_loads(steps: Sequence[Step], loads: Sequence[Step]) -> Iterator[Step]:
    """Both in the order of their samples; a step of the load is about the reference of the step before."""
    starts = {step.first for step in steps}
    last = steps[0]
    for step in sorted([*steps, *(load for load in loads if load.first not in starts)], key=lambda step: step.first):
        if step.of_load and step.first < steps[0].first:
            continue
        last = replace(last, first=step.first, at_s=step.at_s, of_load=True) if step.of_load else step
        yield last


def _changes(knots: Sequence[Knot], before: float, run: Scenario) -> list[tuple[int, float, float, float]]:
    """(first sample, beginning, value before, value after) of a signal's steps and ramps; one within a sample."""
    found: list[tuple[int, float, float, float]] = []
    for knot in knots:
        k = _first_sample(knot.at_s, run)
        if knot.value != before and k < len(run.signals):
            start = found.pop()[1:3] if found and found[-1][0] == k else (knot.at_s, before)
            if start[1] != knot.value:
                found.append((k, *start, knot.value))
        before = knot.value
    return found


def _first_sample(time_s: float, run: Scenario) -> int:
    """The first sample not before a time, in spite of rounding."""
    return max(math.ceil(time_s / run.sample_time_s - 1e-9), 0)


def piecewise_signal(knots: Sequence[Knot], before: float, time_s: Array, *, just_before: bool = False) -> Array:
    """A piecewise signal at these times: held between knots, a straight line along a ramp; shape of `time_s`.

    Args:
        knots: in the order of their times.
        before: the value before the first.
        time_s: equally spaced.
        just_before: whether a step at one of these times has not yet been made there.
    """
    values = np.full(len(time_s), before)
    # a knot at the time of a sample acts from that sample on, in spite of rounding
    late = 1e-9 * (time_s[1] - time_s[0]) if len(time_s) > 1 else 0.0
    late = -late if just_before else late
    start = before
    for knot in knots:
        since = time_s - knot.at_s + late
        share = np.clip(since / knot.ramp_s, 0.0, 1.0) if knot.ramp_s > 0.0 else np.ones(len(time_s))
        values = np.where(since >= 0.0, start + share * (knot.value - start), values)
        # entries do not overlap: the next one starts from where this one ends
        start = knot.value
    return values


def measures_of(traces: Traces, controllers: Sequence[Runtime], scenario: Scenario, horizon: Horizon) -> Measures:
    """The measures by their definitions, from whole traces."""
    reference, first, Ts = scenario.signals.reference, horizon.first, scenario.sample_time_s
    y, counted = traces.output[:, first:], slice(first, None)
    with np.errstate(all="ignore"):
        # where both outputs rest, mode 0, none is at a limit
        limits = np.array([(np.nan, np.nan), *(each.limits for each in controllers)])[traces.mode[:, counted]]
        at_limit = (traces.demanded[:, counted, None] == limits).any(axis=2)[:, :-1]
        error = reference[counted] - y
        jumps = [np.flatnonzero(np.diff(row, prepend=scenario.first_mode)) for row in traces.mode]
        finite = np.all(np.isfinite(traces.output) & np.isfinite(traces.rate), axis=1)
        peak_rate = np.abs(traces.rate[:, counted]).max(axis=1)
        # the rate after the last sample lies beyond the end
        peak_rate = np.maximum(peak_rate, np.abs(traces.rate_after[:, first:-1]).max(axis=1, initial=0.0))
        peak_jerk = np.abs(np.diff(y, 2, axis=1)).max(axis=1, initial=0.0) / (Ts * Ts)
        steps = step_measures(traces, scenario, horizon)
        errors = np.where(np.isnan(steps.final_error), 0.0, steps.final_error)
        worst = np.abs(errors).argmax(axis=0)

        def known(values: Array) -> Array:
            return np.where(finite, values, np.nan)

        return Measures(
            peak_rate=known(peak_rate),
            peak_jerk=known(peak_jerk),
            overshoot=known(steps.overshoot.max(axis=0)),
            undershoot=known(steps.undershoot.max(axis=0)),
            settling_s=np.where(finite, np.nanmax(steps.settling_s, axis=0), np.inf),
            rise_s=np.where(finite, np.nanmax(steps.rise_s, axis=0), np.inf),
            iae=known(Ts * np.abs(error).sum(axis=1)),
            ise=known(Ts * (error**2).sum(axis=1)),
            saturated_s=known(Ts * at_limit.sum(axis=1)),
            peak_control=known(np.abs(traces.applied[:, counted]).max(axis=1)),
            switches=np.array([len(found) for found in jumps]),
            longest_run=np.array([_longest_run(found) for found in jumps]),
            chattering=np.array([_chatters(found, scenario) for found in jumps]),
            final_error=known(np.take_along_axis(errors, worst[None, :], axis=0)[0]),
            finite=finite,
        )


@dataclass(frozen=True, eq=False)
class StepMeasures:
    """The measures of each step that is judged, shape (steps, m); nan for a step that goes on with the one before.

    Args:
        steps: their beginnings.
        overshoot, undershoot, settling_s, rise_s, final_error: as in `Measures`.
    """

    steps: tuple[Step, ...]
    overshoot: Array
    undershoot: Array
    settling_s: Array
    rise_s: Array
    final_error: Array


def step_measures(traces: Traces, scenario: Scenario, horizon: Horizon) -> StepMeasures:
    """What is judged of every step, step by step."""
    steps, reference, Ts = horizon.steps_of(scenario), scenario.signals.reference, scenario.sample_time_s
    m, count = traces.output.shape
    overshoot, undershoot, settling, rise, final = np.full((5, len(steps), m), np.nan)
    # a rise goes on when the load changes
    next_own = iter([*[step.first for step in steps if not step.of_load][1:], count])
    #: of each plant: the step that its time belongs to
    owner, columns = np.zeros(m, dtype=int), np.arange(m)
    begun = np.array([step.first for step in steps])
    for i, step in enumerate(steps):
        end = steps[i + 1].first if i + 1 < len(steps) else count
        y = traces.output[:, step.first : end]
        beyond = y - step.value
        outside = ~(np.abs(beyond) <= step.band)
        overshoot[i] = (step.direction * beyond if step.direction else np.abs(beyond)).max(axis=1)
        undershoot[i] = np.maximum(step.direction * (step.before - y), 0.0).max(axis=1)
        if not step.of_load:
            rise[i] = Ts * _rise_samples(traces.output, step, next(next_own))
        # a step of the load is its own only where the output had settled
        goes_on = np.isinf(settling[owner, columns]) if step.of_load else np.zeros(m, dtype=bool)
        owner = np.where(goes_on, owner, i)
        last = np.where(outside.any(axis=1), y.shape[1] - np.argmax(outside[:, ::-1], axis=1), 0)
        settling[owner, columns] = np.where(last == y.shape[1], np.inf, Ts * (step.first + last - begun[owner]))
        if i + 1 == len(steps) or not steps[i + 1].of_load:
            final[i] = reference[end - 1] - traces.output[:, end - 1]
    return StepMeasures(steps, overshoot, undershoot, settling, rise, final)


def _rise_samples(output: Array, step: Step, end: int) -> Array:
    """From a tenth to nine tenths of a step, in samples, shape (m,); inf: the latter is not reached before `end`."""
    if not step.direction:
        return np.zeros(len(output))
    begun, ended = (_first_crossing(output, step, level, end) for level in step.rise_levels)
    return ended - np.where(np.isinf(ended), 0.0, begun)


def _first_crossing(output: Array, step: Step, level: float, end: int) -> Array:
    """When the output first reaches a level in the step's direction, in samples, shape (m,); inf: it does not."""
    y, rows = output[:, step.first : end], np.arange(len(output))
    beyond = y >= level if step.direction > 0.0 else y <= level
    k = np.argmax(beyond, axis=1)
    last, now = y[rows, np.maximum(k - 1, 0)], y[rows, k]
    share = (level - last) / np.where(k > 0, now - last, 1.0)
    crossed = np.where(k > 0, step.first + k - 1.0 + share, float(step.first))
    return np.where(beyond.any(axis=1), crossed, np.inf)


def _longest_run(jumps: NDArray[np.int_]) -> int:
    longest = run = 0
    for n, k in enumerate(jumps):
        run = run + 1 if n and k == jumps[n - 1] + 1 else 1
        longest = max(longest, run)
    return longest


def _chatters(jumps: NDArray[np.int_], scenario: Scenario) -> bool:
    hybrid = scenario.hybrid
    if hybrid is None or len(jumps) <= hybrid.most_switches:
        return False
    within = np.floor(hybrid.window_s / scenario.sample_time_s + 1e-9)
    return bool((jumps[hybrid.most_switches :] - jumps[: -hybrid.most_switches] <= within).any())
