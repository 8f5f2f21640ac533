"""How the throttle phase can begin:  model, setpoint -> corners of all states at the switch from brake to throttle.

While the brake is active, y <- y + m (K u - y) with u within its limits.  Let top and bottom be the largest and the
least K u.  With r - eps > top the distance y - top shrinks by 1 - m at least, so that the phase ends; its last sample
has y_last > r - eps, and the first one of the throttle phase

    r - eps >= y_0 >= (1 - m) y_last + m bottom,       m the largest one .                                           (1)

After `reset` the throttle's controller starts with the state of an output of 0.  With `tracking` of a brake whose
control lies below the throttle's limits, the integrator holds x_0 = low - direct (r - y_last), and sections that were 0
before, as at rest, are 0.  In coordinates (y - r, x_0 - r/K, x_1, ...) the corners of (1) are affine in r:  a property
that is convex in state and setpoint holds for all entries when it holds at the corners for both ends of the setpoints.

Source: derived here from (2) of `model`.
"""

from __future__ import annotations

from flint import arb, arb_mat

from fopi_tune.proof.switched.model import Lag, Memory, SwitchedModel, lag_at, lag_range


def why_no_entries(model: SwitchedModel) -> str:
    """Why the states at the switch are not known this way; empty where they are.

    Args:
        model: with `obstacle == ""`.
    """
    throttle = model.loops[0]
    if not model.hysteresis > 0.0:
        return "without hysteresis a switch may follow every sample; write a hysteresis greater than 0"
    if model.memory is Memory.HELD:
        return "a held memory begins the throttle phase with what it had: nothing bounds its overshoot"
    if throttle.plant.uncertain_names:
        return f"{throttle.name}: its plant is uncertain; settling is proved for an exact one"
    return ""


def throttle_lag(model: SwitchedModel) -> Lag:
    """The raising mode's exact plant, at the current precision."""
    return lag_at(model.loops[0], model.sample_time_s, {})


def brake_top(model: SwitchedModel) -> arb:
    """The largest K u of the brake: the phase ends for setpoints above it by more than the hysteresis."""
    brake = model.loops[1]
    high = arb(brake.controller.limits[1])
    first, *others = (gain * high for gain in lag_range(brake, model.sample_time_s).gains)
    for other in others:
        first = first.max(other)
    return first


def starts_above_low(model: SwitchedModel) -> bool:
    """Whether v >= low is known of the first sample: after tracking, v = low + direct (y_last - y_0), y_last > y_0."""
    return model.memory is Memory.TRACKING and model.loops[0].controller.direct >= 0.0


def entry_corners(model: SwitchedModel, setpoint: arb) -> arb_mat:
    """Corners of the states with which the throttle phase begins, at the current precision.

    Args:
        model: with `why_no_entries(model) == ""`.
        setpoint: r, in the output's unit.

    Returns:
        One state per column, shape (n + 1, 2) after a reset, (n + 1, 3) after tracking.
    """
    throttle, brake = model.loops
    controller, lags = throttle.controller, lag_range(brake, model.sample_time_s)
    share, low = lags.shares[1], arb(brake.controller.limits[0])
    bottom = (lags.gains[0] * low).min(lags.gains[1] * low)
    line = setpoint - arb(model.hysteresis)
    lowest = (1 - share) * line + share * bottom
    if model.memory is Memory.RESET:
        start = min(max(0.0, controller.limits[0]), controller.limits[1])
        corners = [(lowest, arb(start)), (line, arb(start))]
    else:
        highest = (line - share * bottom) / (1 - share)

        def tracked(last: arb) -> arb:
            return arb(controller.limits[0]) - arb(controller.direct) * (setpoint - last)

        corners = [(lowest, tracked(line)), (line, tracked(line)), (line, tracked(highest))]
    columns = arb_mat(len(controller.poles) + 1, len(corners))
    for j, (output, integrator) in enumerate(corners):
        columns[0, j] = output - setpoint
        columns[1, j] = integrator - setpoint / throttle_lag(model)[1]
    return columns
