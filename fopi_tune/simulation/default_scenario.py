"""The scenario of a spec that has none:  a step of the reference, then of the load, over a time that suits the loop.

The step is 1, or half of what the control's limits reach.  The load asks for half of the control that holds the
setpoint, of the largest control at the step's beginning where the plant integrates.  Each part lasts as long as the
output takes to settle at where it ends, and half as long again.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import Plant
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.notes import static_gain
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Actuator, Mode, Scenario, Signals, Traces
from fopi_tune.spec.model import Knot, ScenarioSpec

NAME = "default"
#: samples of the first attempt and of the last, the factor between attempts, and the fewest of one part
_FIRST, _LAST, _LONGER, _FEWEST = 400, 100_000, 4, 20
#: samples of one part at most
_MOST = 50_000
#: settled: within this share of the output's change
_SETTLED = 0.02


def default_scenario(plant: Plant, controller: Runtime, sample_time_s: float, delay_samples: float) -> ScenarioSpec:
    """The default scenario of a loop.

    Args:
        plant: the nominal plant.
        controller: with the control's limits.
        sample_time_s: Ts.
        delay_samples: computing delay.
    """
    step = _step_size(plant, controller.limits)
    count, found = _FIRST, _stepped(plant, controller, sample_time_s, delay_samples, step, _FIRST)
    settled = _settled(found)
    while settled is None and count < _LAST and np.isfinite(found.output).all():
        count *= _LONGER
        found = _stepped(plant, controller, sample_time_s, delay_samples, step, count)
        settled = _settled(found)
    samples = _FIRST if settled is None else min(max(math.ceil(1.5 * settled), _FEWEST), _MOST)
    part = sample_time_s * max(round(_nice(samples * sample_time_s) / sample_time_s), 1)
    load = _load_size(plant, step, found)
    return ScenarioSpec(
        name=NAME,
        duration_s=2.0 * part if load else part,
        reference=(Knot(0.0, step),),
        load=(Knot(part, load),) if load else (),
    )


def described(scenario: ScenarioSpec) -> str:
    """The default scenario in one sentence."""
    load = "".join(f", then of the load by {knot.value:g} at {knot.at_s:g} s" for knot in scenario.load)
    return (
        f"the spec has no scenarios: a step of the reference to {scenario.reference[0].value:g} at 0 s{load}, "
        f"{scenario.duration_s:g} s in all; write scenarios: for your own"
    )


def _stepped(
    plant: Plant, controller: Runtime, sample_time_s: float, delay_samples: float, step: float, count: int
) -> Traces:
    run = Scenario(sample_time_s, Signals(np.full(count, step)), actuator=Actuator(delay_samples=delay_samples))
    return simulate([Mode(controller, Plants.of(plant))], run)


def _settled(found: Traces) -> int | None:
    """Samples until the output stays where it ends; None: not in the first 40 % of the run, or it does not end."""
    y = found.output[0]
    if not np.isfinite(y).all():
        return None
    outside = np.flatnonzero(np.abs(y - y[-1]) > _SETTLED * np.abs(y).max())
    last = int(outside[-1]) + 1 if len(outside) else 0
    return last if last < 0.4 * len(y) else None


def _step_size(plant: Plant, limits: tuple[float, float]) -> float:
    gain = static_gain(plant)
    if not math.isfinite(gain):
        up = limits[1] > 0.0 if gain > 0.0 else limits[0] < 0.0
        return 1.0 if up else -1.0
    low, high = sorted(gain * limit for limit in limits)
    if gain == 0.0 or high >= 2.0:
        return 1.0
    if high > 0.0:
        return high / 2.0 if low <= high / 2.0 else (low + high) / 2.0
    return max(low / 2.0, -1.0)


def _load_size(plant: Plant, step: float, found: Traces) -> float:
    gain = static_gain(plant)
    if math.isfinite(gain) and gain != 0.0:
        return float(f"{-0.5 * step / gain:.2g}")
    control = found.applied[0, :_FEWEST]
    largest = float(control[np.argmax(np.abs(control))]) if np.isfinite(control).all() else 0.0
    return float(f"{-0.5 * largest:.2g}")


def _nice(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 5, 7 or 10 times a power of 10."""
    power = 10.0 ** math.floor(math.log10(value))
    return (
        next(step for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0) if step * power >= value * (1 - 1e-9)) * power
    )
