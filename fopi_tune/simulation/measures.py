"""A spec's scenarios on samples, and the measures that its limits name:  traces -> Measures -> word of the spec.

`measures_of` reads them off whole traces, by their definitions in `simulation.scenario.Measures`; the compiled
simulation collects the same sample by sample (`sampled.plant_stages`, `sampled.controller_stages`); tests compare them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.scenario import (
    Actuator,
    Horizon,
    InitialInput,
    Measures,
    Scenario,
    Sensor,
    Signals,
    Start,
    Traces,
)
from fopi_tune.spec.model import Knot, ScenarioSpec

#: km/h per m/s
KMH_PER_M_S = 3.6
#: settling band as a share of the last step, where the spec gives none
_SETTLED = 0.02

#: word after `limits:` -> the measure, shape (m,)
MEASURE_VALUES: dict[str, Callable[[Measures], Array]] = {
    "acceleration_m_s2": lambda found: found.peak_rate / KMH_PER_M_S,
    "peak_rate_per_s": lambda found: found.peak_rate,
    "overshoot": lambda found: found.overshoot,
    "settling_time_s": lambda found: found.settling_s,
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


def horizon_of(scenario: ScenarioSpec, run: Scenario) -> Horizon:
    """The samples over which its measures are taken, and the settling band."""
    reference = run.signals.reference
    first = min(math.ceil(scenario.judged_from_s / run.sample_time_s - 1e-9), len(reference) - 1)
    before = float(reference[first - 1]) if first else scenario.initial_output
    band = scenario.settling_band
    if band is None:
        band = _SETTLED * (abs(float(reference[-1]) - before) or abs(float(reference[-1])))
    return Horizon(band, first)


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
    final = reference[-1]
    direction = np.sign(final - (reference[first - 1] if first else scenario.start.output))
    y, counted = traces.output[:, first:], slice(first, None)
    with np.errstate(all="ignore"):
        off, beyond = np.abs(y - final), y - final
        outside = ~(off <= horizon.band)
        last = np.where(outside.any(axis=1), y.shape[1] - np.argmax(outside[:, ::-1], axis=1), 0)
        settled = np.where(last == y.shape[1], np.inf, last * Ts)
        limits = np.array([controller.limits for controller in controllers])[traces.mode[:, counted] - 1]
        at_limit = (traces.demanded[:, counted, None] == limits).any(axis=2)
        error = reference[counted] - y
        jumps = [np.flatnonzero(np.diff(row, prepend=scenario.first_mode)) for row in traces.mode]
        finite = np.all(np.isfinite(traces.output) & np.isfinite(traces.rate), axis=1)

        peak_rate = np.abs(traces.rate[:, counted]).max(axis=1)
        # the rate after the last sample lies beyond the end
        peak_rate = np.maximum(peak_rate, np.abs(traces.rate_after[:, first:-1]).max(axis=1, initial=0.0))

        def known(values: Array) -> Array:
            return np.where(finite, values, np.nan)

        return Measures(
            peak_rate=known(peak_rate),
            overshoot=known((direction * beyond if direction else off).max(axis=1)),
            settling_s=np.where(finite, settled, np.inf),
            iae=known(Ts * np.abs(error).sum(axis=1)),
            ise=known(Ts * (error**2).sum(axis=1)),
            saturated_s=known(Ts * at_limit.sum(axis=1)),
            peak_control=known(np.abs(traces.applied[:, counted]).max(axis=1)),
            switches=np.array([len(found) for found in jumps]),
            longest_run=np.array([_longest_run(found) for found in jumps]),
            chattering=np.array([_chatters(found, scenario) for found in jumps]),
            final_error=known(error[:, -1]),
            finite=finite,
        )


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
