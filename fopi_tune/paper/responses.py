"""Exact responses of the brake's fractional loop in time, by Laplace inversion."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.paper.sources import brake_plant
from fopi_tune.simulation.fractional.linear import Signal, exact_response


def step_of(gains: FoPi, tau_s: float, dead_time_s: float, step_s: float, end_s: float) -> tuple[Array, Array]:
    """Times and the output after a unit step of the setpoint.

    Args:
        gains: the controller.
        tau_s: of the brake 1/(tau s + 1).
        dead_time_s: of the brake.
        step_s: between the times, s; the first is `step_s`.
        end_s: the last, s.
    """
    times = _times(step_s, end_s)
    plant = brake_plant(tau_s=tau_s, dead_time_s=dead_time_s)
    return times, exact_response(gains, plant, Signal.OUTPUT_AFTER_REFERENCE, times)


def load_error(gains: FoPi, tau_s: float, dead_time_s: float, step_s: float, end_s: float) -> float:
    """The integral of |e| after a unit step at the plant's input, by the trapezoidal rule; arguments as `step_of`."""
    times = _times(step_s, end_s)
    plant = brake_plant(tau_s=tau_s, dead_time_s=dead_time_s)
    error = np.abs(exact_response(gains, plant, Signal.OUTPUT_AFTER_LOAD, times))
    # the output is 0 at t = 0
    return float(step_s * (error.sum() - 0.5 * error[-1]))


def _times(step_s: float, end_s: float) -> Array:
    return np.asarray(step_s * np.arange(1, round(end_s / step_s) + 1), dtype=float)
