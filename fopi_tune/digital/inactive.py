"""A controller of which another one has the actuator, in NumPy:  what it remembers, beside `runtime.track`.

The same operations and roundings as the exported C of a system.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fopi_tune.digital.runtime import Runtime, State, init


def follow_from(runtime: Runtime, state: State, output: np.floating) -> State:
    """The state whose next output is reached from one that another controller had, cut to the limits.

    Args:
        runtime: with a limit of the rate.
        state: of which the sections' states stay.
        output: of the other controller, in the precision.
    """
    return replace(state, output=runtime.stored.limited(output))


@np.errstate(all="ignore")
def observe(runtime: Runtime, state: State, setpoint: float, measurement: float) -> State:
    """One sample in which the controller has no actuator: m_j of (5) go on, and nothing else does.

    Args:
        runtime: the controller, without a measurement filter.
        state: before the sample.
        setpoint: r.
        measurement: y.
    """
    if state.filtered is None:
        return state
    c, dtype = runtime.stored, runtime.precision.dtype
    r, y = dtype(setpoint), dtype(measurement)
    before = np.full_like(state.filtered, y) if state.is_new else state.filtered
    filtered = before + c.derivative_shares * (y - before)
    if not (c.finite(r - y) and np.all(np.isfinite(filtered))):
        return state
    if abs(y) < c.flush_below:
        filtered[np.abs(filtered) < c.flush_below] = 0.0
    return replace(state, filtered=filtered, is_new=False)


def restarted(runtime: Runtime, state: State) -> State:
    """The state after `init`, but for m_j of (5), which are the measurement's."""
    return replace(init(runtime), filtered=state.filtered, is_new=state.is_new)
