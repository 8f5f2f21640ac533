"""Signals of a few sampled loops and their derivatives by the gains, for the design of gains by simulation.

Each number v of the simulation is carried as (v, dv/dkp, dv/dki, dv/dalpha), by the rules of sums and products applied
to the recursions of `simulation.scenario`, (3) and (4), of `digital.runtime`, (1), and of `sampled.plants`, (1).  Where
the simulation has branches, the one that is taken is differentiated:

    u = v within the limits                 du = dv;  du = 0 while the output is limited
    u moves by at most D                    du = du_last while it does
    applied moves by at most rate Ts        d applied = du;  d of the last applied control while the rate is limited
    rate_after, the larger one              its own derivative

The signals are continuous where a branch changes; their derivatives jump there.  A limited output keeps its effect on
the controller's states: the back-calculation's derivative goes on.

Source: derived.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.digital.derivatives import ControllerDerivatives
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import DiscretePlants
from fopi_tune.simulation.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Signals of m plants, as in `simulation.scenario.Traces`, and their derivatives.

    Every array has the shape (m, steps, 4): the value, d/d kp, d/d ki and d/d alpha.  Signals that overflow are not
    finite, as in `Traces`; derivatives may overflow before them.

    Args:
        output: y just before the new control acts; shape (m, steps, 4).
        rate: dy/dt there, per s.
        rate_after: dy/dt just after a new input arrives, per s; where control and load arrive at different times, the
            larger of the two.
        demanded: the controller's output; shape (m, steps, 4).
        applied: the actuator's output from this sample on, undelayed; shape (m, steps, 4).
    """

    output: Array
    rate: Array
    rate_after: Array
    demanded: Array
    applied: Array


def trajectories(controller: ControllerDerivatives, plants: DiscretePlants, scenario: Scenario) -> Trajectories:
    """Simulate a few plants with derivatives; keeps 20 numbers per plant and sample.

    Args:
        controller: with its derivatives.
        plants: m plants, discretised with the sample time and the delay of the scenario.
        scenario: one mode, no noise and no quantisation.

    Raises:
        DomainError: the scenario has noise, a quantum or two modes, or a plant cannot start as it says.
    """
    from fopi_tune.simulation.sensitivities.kernel import run_plants

    _check(scenario)
    m, steps, runtime = len(plants), len(scenario.signals), controller.controller
    states, past = plants.initial_state(scenario.start)
    start = _start(runtime, scenario, past)
    signal = scenario.signals.load
    control = (plants.control.delay, *plants.control.whole)
    load = (plants.load.delay, *plants.load.whole[1:])
    output = (plants.output, plants.direct, plants.rate_state, plants.rate_input)
    rates = runtime.most_change, float(scenario.actuator.rate_per_s * scenario.sample_time_s)
    found = np.empty((5, m, steps, 4))
    run_plants(
        _rows(controller), (*runtime.limits, *rates),
        Precision.FLOAT64.flush_below, start, float(runtime.has_integrator), _contiguous(states), _contiguous(past),
        tuple(_contiguous(part) for part in control), tuple(_contiguous(part) for part in load),
        tuple(_contiguous(part) for part in output), plants.acts_at_samples, _contiguous(plants.arrivals),
        scenario.signals.reference, signal if signal is not None else np.zeros(0), found,
    )  # fmt: skip
    return Trajectories(*found)


def _check(scenario: Scenario) -> None:
    sensor = scenario.sensor
    if scenario.hybrid is not None:
        raise DomainError("derivatives by the gains are of a loop with one mode; leave `hybrid` out")
    if sensor.noise_std or sensor.quantum:
        what = "noise_std" if sensor.noise_std else "quantum"
        raise DomainError(f"there is no derivative by the gains with {what} of the measurement; set it to 0")


def _start(runtime: Runtime, scenario: Scenario, past: Array) -> Array:
    """The first output of every plant's controller, shape (m,), by `runtime.reset`: it does not depend on the gains."""
    low, high = runtime.limits
    if scenario.start.bumpless:
        return np.clip(past, low, high)
    return np.full(len(past), float(init(runtime).output))


def _rows(controller: ControllerDerivatives) -> Array:
    """The controller's numbers as the kernel takes them, shape (2 + 3 sections, 5).

    A row holds the value, then 0 and the three derivatives: (ab)_j = a b_j + a'_j b for every column j of b, the first
    one included.
    """
    parts = [controller.direct[None], controller.tracking_gain[None]]
    sections = np.stack([controller.poles, controller.weights, controller.residues], axis=1)
    rows = np.concatenate([*parts, sections.reshape(-1, 4)])
    found = np.zeros((len(rows), 5))
    found[:, 0], found[:, 2:] = rows[:, 0], rows[:, 1:]
    return found


def _contiguous(values: NDArray[Any]) -> NDArray[Any]:
    # the compiled function accepts one kind of array only
    return np.ascontiguousarray(values)
