"""What to know before a simulation's numbers are trusted:  scenario, plant, limits -> sentences."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Sequence

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant
from fopi_tune.simulation.measures import StepMeasures
from fopi_tune.simulation.scenario import Traces
from fopi_tune.spec.model import DigitalSpec, Limit, ScenarioSpec, SystemSpec


def static_gain(plant: Plant) -> float:
    """P(0); infinite with the sign of the plant's integral where it integrates."""
    top, bottom = plant.numerator[-1], np.trim_zeros(plant.denominator, "b")[-1]
    return top / bottom if plant.denominator[-1] != 0.0 else math.copysign(math.inf, top * bottom)


def mode_notes(name: str, raises: bool, plant: Plant, limits: tuple[float, float]) -> list[str]:
    """Whether the control's limits leave a mode of a system nothing to act with.

    Args:
        name: of the mode.
        raises: whether it has to raise the output (the first mode) or to lower it (the second).
        plant: of the mode.
        limits: of its control.
    """
    gain = math.copysign(1.0, static_gain(plant))
    side = "above" if (gain > 0.0) == raises else "below"
    if limits[1] > 0.0 if side == "above" else limits[0] < 0.0:
        return []
    shown, does = ", ".join(f"{limit:g}" for limit in limits), "raise" if raises else "lower"
    return [f"{name}: its output_limits [{shown}] leave nothing {side} 0: it cannot {does} the output"]


def dwell_notes(system: SystemSpec) -> list[str]:
    """A minimum dwell that is no whole number of samples."""
    count, rounded = system.min_dwell_samples, system.min_dwell_samples * system.sample_time_s
    if abs(rounded - system.min_dwell_s) <= 1e-6 * rounded:
        return []
    plural = "s" if count > 1 else ""
    return [f"min_dwell_s: {system.min_dwell_s:g} s is rounded up to {count} sample{plural}, {rounded:g} s"]


def setpoint_notes(scenario: ScenarioSpec, plant: Plant, limits: tuple[float, float]) -> list[str]:
    """Setpoints that no control within the limits holds.

    Args:
        scenario: gives the setpoints; with a load at the plant's input nothing is said.
        plant: the plant.
        limits: of its control, the largest floats where there are none.
    """
    gain = static_gain(plant)
    if scenario.load or not math.isfinite(gain) or gain == 0.0 or limits[1] - limits[0] > sys.float_info.max / 2:
        return []
    low, high = sorted(gain * limit for limit in limits)
    size = 1e-9 * max(abs(low), abs(high))
    beyond = [knot.value for knot in scenario.reference if not low - size <= knot.value <= high + size]
    if not beyond:
        return []
    worst = max(beyond, key=lambda value: max(value - high, low - value))
    return [
        f"the setpoint {worst:g} is out of reach: within output_limits [{limits[0]:g}, {limits[1]:g}] the plant rests "
        f"between {low:.5g} and {high:.5g}"
    ]


def rate_notes(scenario: ScenarioSpec, traces: Traces, digitals: Sequence[DigitalSpec | None]) -> list[str]:
    """An actuator's rate limit that acted, and of which a controller's anti-windup does not know.

    Args:
        scenario: with the rate of its actuator.
        traces: what the simulation gave.
        digitals: of the controllers that share the actuator.
    """
    rate = scenario.rate_per_s
    acted = not np.array_equal(traces.demanded, traces.applied, equal_nan=True)
    own = {None if digital is None else digital.output_rate_per_s for digital in digitals}
    unknown = [each for each in own if each is None or each > rate]
    if not (math.isfinite(rate) and acted and unknown):
        return []
    faster = "" if None in unknown else f", as its output_rate_per_s of {max(each or 0.0 for each in own):g} is faster"
    return [
        f"the actuator's rate_per_s of {rate:g} acted, which the controller does not know{faster}, and it winds up; "
        f"write output_rate_per_s: {rate:g} in the section digital, and the anti-windup works through that limit too"
    ]


def bumpless_notes(scenario: ScenarioSpec, gains: FoPi) -> list[str]:
    """A start that needs an integral."""
    if scenario.bumpless and gains.ki == 0.0 and scenario.initial_output != 0.0:
        return ["bumpless has no effect: without ki the controller has no state to start from"]
    return []


def step_notes(found: StepMeasures) -> list[str]:
    """Steps that come before the output has settled at the last one; of the first plant."""
    starts = [(i, step) for i, step in enumerate(found.steps) if not step.of_load]
    early = []
    for (i, step), (j, following) in itertools.pairwise(starts):
        settled = [time for time in found.settling_s[i:j, 0] if not math.isnan(time)]
        if any(math.isinf(time) for time in settled):
            early.append((step.at_s, following.at_s))
    if not early:
        return []
    before, at = early[0]
    more = f"; so do {len(early) - 1} more" if len(early) > 1 else ""
    return [f"the step at {at:g} s comes before the output has settled at the one before, of {before:g} s{more}"]


def limit_notes(limits: Sequence[Limit]) -> list[str]:
    """Limits that a single loop always meets."""
    if any(limit.measure == "switch_count" for limit in limits):
        return ["switch_count is about the modes of a system: a single loop never switches"]
    return []
