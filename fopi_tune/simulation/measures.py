"""A spec's scenarios converted for the simulator, and the measures that its limits name."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.simulation.scenario import Actuator, Horizon, InitialInput, Measures, Scenario, Sensor, Signals, Start
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
