"""The maps of samples are the loop that is simulated:  same modes, and outputs equal up to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from cases import switched
from flint import arb

from fopi_tune.core.loops import Plants
from fopi_tune.digital import Memory
from fopi_tune.proof.switched.definite import midpoints
from fopi_tune.proof.switched.model import SwitchedModel, lag_at
from fopi_tune.proof.switched.sample_map import sample_map
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import (
    Actuator,
    Hybrid,
    InactiveController,
    InitialInput,
    Mode,
    Scenario,
    Signals,
    Start,
    Traces,
)

SAMPLES = 4000


def simulated(model: SwitchedModel, memory: str, setpoint: float, tau: float) -> Traces:
    delay = model.loops[0].delay_samples
    points = (np.zeros((1, 0)), np.array([[tau]]))
    modes = [
        Mode(each.controller, Plants.members(each.plant, at)) for each, at in zip(model.loops, points, strict=True)
    ]
    start = Start(25.0, InitialInput.REST, bumpless=True)
    hybrid = Hybrid(model.hysteresis, InactiveController.of(Memory(memory)))
    signals = Signals(np.full(SAMPLES, setpoint))
    return simulate(
        modes,
        Scenario(model.sample_time_s, signals, start=start, hybrid=hybrid, actuator=Actuator(delay_samples=delay)),
    )


def mapped(model: SwitchedModel, setpoint: float, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """Outputs and modes by the maps, each chosen by its own conditions."""
    lags = [lag_at(model.loops[0], model.sample_time_s, {})]
    lags.append(lag_at(model.loops[1], model.sample_time_s, {"time_constant_s": tau}))
    known = {}
    for mode in (0, 1):
        for part in "-0+":
            for begins in (False, True):
                found = sample_map(model, lags, arb(setpoint), mode, part, begins)
                known[mode, part, begins] = midpoints(found.matrix), midpoints(found.demand)[0]
    z = np.zeros(len(known[0, "0", False][0]))
    # at rest at 25 km/h
    z[0], z[-1], z[1] = 25.0, 1.0, 25.0 * 0.1746 / 4.39
    if model.loops[0].delay_samples:
        z[-2] = z[1]
    mode, outputs, modes = 0, [], []
    for _ in range(SAMPLES):
        before = mode
        if mode == 0 and z[0] >= setpoint + model.upper:
            mode = 1
        elif mode == 1 and z[0] <= setpoint + model.lower:
            mode = 0
        v = known[mode, "0", mode != before][1] @ z
        low, high = model.loops[mode].controller.limits
        outputs.append(z[0])
        modes.append(mode + 1)
        z = known[mode, "-" if v < low else "+" if v > high else "0", mode != before][0] @ z
    return np.array(outputs), np.array(modes)


@pytest.mark.parametrize("memory", list(Memory))
@pytest.mark.parametrize(
    ("setpoint", "tau", "delay"),
    [(6.0, 3.1, 0.0), (12.0, 1.6, 0.0), (20.0, 2.25, 0.0), (6.0, 3.1, 0.35), (12.0, 1.6, 1.0)],
)
def test_the_maps_are_the_simulation(memory: str, setpoint: float, tau: float, delay: float) -> None:
    model = switched.model(memory, delay)
    traces, (outputs, modes) = simulated(model, memory, setpoint, tau), mapped(model, setpoint, tau)
    assert np.array_equal(traces.mode[0], modes)
    assert len(set(modes.tolist())) == 2
    # rounding of some ten operations a sample, in loops that forget it
    assert np.max(np.abs(traces.output[0] - outputs)) <= 1e-14 * 25.0
