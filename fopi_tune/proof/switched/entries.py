"""How the raising phase can begin:  model, setpoint -> corners of all states at the switch to the raising mode.

While the lowering mode is active, y <- y + m (K u - y) with u within its limits. Let top and bottom be the largest and
the least K u, and r + b the line to the raising mode, b = -eps of a hysteresis. With r + b > top the distance y - top
shrinks by 1 - m at least, so that the phase ends; its last sample has y_last > r + b, and the first one of the raising
phase

    r + b >= y_0 >= (1 - m) y_last + m bottom,       m the largest one .                                           (1)

A minimum dwell of D samples may keep the lowering mode active below the line. The phase begins with an output above it,
and a phase that is longer than D samples ends as without a dwell, so that in any case

    y_last >= bottom + (1 - m)^{D-1} (r + b - bottom),     y_0 >= bottom + (1 - m) (y_last - bottom) .            (2)

As long as y_last > top the output falls to y_0 < y_last.

After `reset` the raising mode's controller starts with the state of an output of 0. With `tracking` of a lowering mode
whose control lies below the raising mode's limits, the integrator holds x_0 = low - direct (r - y_last), and sections
that were 0 before, as at rest, are 0.

With a computing delay the last control before may still be the raising mode's, over a share m_1 of the raising mode's
plant, if the lowering mode was active for one sample: both cases are enclosed. After the switch the lowering mode's
last control acts for a while: y_0 moves to (1 - m_1) y_0 + m_1 w, w between bottom and top. The raising mode's plant
would do the same with a last control of

    ((1 - m_1) y_0 + m_1 w - (1 - n_1) y_0)/(n_1 K),       n_1 its own m_1,                                          (3)

which is therefore the last part of the state.

In coordinates (y - r, x_0 - r/K, x_1, ...) the corners of (1) are affine in r:  a property that is convex in state and
setpoint holds for all entries when it holds at the corners for both ends of the setpoints.

Source: derived here from (2) and (4) of `model`.
"""

from __future__ import annotations

from flint import arb, arb_mat

from fopi_tune.proof.switched.model import Lag, Memory, SwitchedModel, lag_at, lag_range


def why_no_entries(model: SwitchedModel) -> str:
    """Why the states at the switch are not known this way; empty where they are.

    Args:
        model: with `obstacle == ""`.
    """
    raising, lowering = model.loops
    if not model.upper > model.lower:
        if model.lines.half_width is not None:
            return "without hysteresis a switch may follow every sample; write a hysteresis greater than 0"
        return f"both lines are one, so that a switch may follow every sample; write to_{raising.name}_below lower"
    if not model.upper > 0.0:
        return f"the {raising.name} is left before it rests at the setpoint; write to_{lowering.name}_above above 0"
    if model.memory is Memory.HELD:
        return f"a held memory begins the {raising.name} phase with what it had: nothing bounds its overshoot"
    if raising.plant.uncertain_names:
        return f"{raising.name}: its plant is uncertain; settling is proved for an exact one"
    if model.min_dwell_samples > 1 and raising.delay_samples > 0.0:
        return "settling with both a minimum dwell and a computing delay is not modelled in this proof"
    if not lowering.is_limited:
        return f"{lowering.name}: without output_limits its control may take the output anywhere within a sample"
    return ""


def raising_lag(model: SwitchedModel) -> Lag:
    """The raising mode's exact plant, at the current precision."""
    return lag_at(model.loops[0], model.sample_time_s, {})


def lowering_top(model: SwitchedModel) -> arb:
    """The largest K u of the lowering mode: the phase ends for setpoints whose lower line lies above it."""
    lowering = model.loops[1]
    high = arb(lowering.controller.limits[1])
    least, largest = (gain * high for gain in lag_range(lowering, model.sample_time_s).gains)
    return least.max(largest)


def dwell_margin(model: SwitchedModel) -> arb:
    """How much higher than without a dwell setpoints must be for y_last > top in (2); only `tracking` needs it."""
    if model.memory is not Memory.TRACKING or model.min_dwell_samples <= 1:
        return arb(0)
    share, bottom = _fastest_fall(model)
    return (lowering_top(model) - bottom) * (1 / (1 - share) ** (model.min_dwell_samples - 1) - 1)


def _fastest_fall(model: SwitchedModel) -> tuple[arb, arb]:
    """The largest m and the least K u of the lowering mode."""
    lowering, lags = model.loops[1], lag_range(model.loops[1], model.sample_time_s)
    low = arb(lowering.controller.limits[0])
    return lags.shares[1], (lags.gains[0] * low).min(lags.gains[1] * low)


def starts_above_low(model: SwitchedModel) -> bool:
    """Whether v >= low is known of the first sample: after tracking, v = low + direct (y_last - y_0), y_last > y_0."""
    return model.memory is Memory.TRACKING and model.loops[0].controller.direct >= 0.0


def entry_corners(model: SwitchedModel, setpoint: arb) -> arb_mat:
    """Corners of the states with which the raising phase begins, at the current precision.

    Args:
        model: with `why_no_entries(model) == ""`.
        setpoint: r, in the output's unit.

    Returns:
        One state per column, shape (n + 1, 2) after a reset, (n + 1, 3) after tracking, (n + 1, 4) with a dwell too;
        with a computing delay there are n + 2 rows, and four times as many columns.
    """
    controller, dwell = model.loops[0].controller, max(1, model.min_dwell_samples)
    share, bottom = _fastest_fall(model)
    line = setpoint + arb(model.lower)
    last = line if dwell == 1 else bottom + (1 - share) ** (dwell - 1) * (line - bottom)
    # y_0 = kept y_last + moved at the least
    ways = [(1 - share, share * bottom)]
    lag = raising_lag(model)
    if lag.late is not None:
        ways += _one_lowering_sample(model, lag.late, bottom)
    lowest = _least([kept * last + moved for kept, moved in ways])
    if model.memory is Memory.RESET:
        start = min(max(0.0, controller.limits[0]), controller.limits[1])
        corners = [(lowest, arb(start)), (line, arb(start))]
    else:
        highest = -_least([(moved - line) / kept for kept, moved in ways])

        def tracked(last: arb) -> arb:
            return arb(controller.limits[0]) - arb(controller.direct) * (setpoint - last)

        corners = [(lowest, tracked(last)), (line, tracked(line)), (line, tracked(highest))]
        if dwell > 1:
            corners.append((last, tracked(last)))
    columns = arb_mat(len(controller.poles) + 1, len(corners))
    for j, (output, integrator) in enumerate(corners):
        columns[0, j] = output - setpoint
        columns[1, j] = integrator - setpoint / lag.gain
    return columns if lag.late is None else _with_last_control(model, lag.late, columns, setpoint, bottom)


def _one_lowering_sample(model: SwitchedModel, late: arb, bottom: arb) -> list[tuple[arb, arb]]:
    """y_0 = kept y_last + moved at the least, where the raising control of before acts first; per share after it."""
    raising, lowering = raising_lag(model), lag_range(model.loops[1], model.sample_time_s)
    first = raising.gain * arb(model.loops[0].controller.limits[0])
    return [
        ((1 - each.share) * (1 - late), (1 - each.share) * late * first + each.share * bottom)
        for each in lowering.vertices
    ]


def _with_last_control(model: SwitchedModel, own: arb, columns: arb_mat, setpoint: arb, bottom: arb) -> arb_mat:
    """Each corner with the four corners of (3) below it."""
    lag, lowering = raising_lag(model), lag_range(model.loops[1], model.sample_time_s)
    found = []
    for column in columns.transpose().tolist():
        y = column[0] + setpoint
        for late in lowering.late:
            for held in (bottom, lowering_top(model)):
                last = ((1 - late) * y + late * held - (1 - own) * y) / (own * lag.gain)
                found.append([*column, last - setpoint / lag.gain])
    return arb_mat(found).transpose()


def _least(numbers: list[arb]) -> arb:
    first, *others = numbers
    for other in others:
        first = first.min(other)
    return first
