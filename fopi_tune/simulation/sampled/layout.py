"""Memory layout of the compiled simulation:  a scratch array of rows of `WIDTH` doubles, one lane per plant.

Coefficients of the controllers are common to all lanes and kept elsewhere; a lane selects those of its mode.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: lanes: four of the widest registers, so that independent chains of operations hide each other's latency
WIDTH = 32
#: the mask of every lane as a whole number
ALL_LANES = 2**WIDTH - 1

#: results, one row each, in the order of the first offsets below; `outside` is the last sample outside the band,
#: `begun` the first of the step that is judged, `reached` and `risen` when the output first was at a tenth and at nine
#: tenths of it, in samples, inf while it was not; `settled`, `step_error` and `rise` the worst of the steps before it
RESULTS = (
    "peak_rate", "overshoot", "outside", "iae", "ise", "saturated", "peak_control", "switches", "longest_run",
    "chattering", "final_error", "finite", "begun", "settled", "step_error", "undershoot", "reached", "risen", "rise",
    "peak_jerk",
)  # fmt: skip
#: traces, one row each
TRACES = ("output", "rate", "measured", "error", "demanded", "applied", "mode", "rate_after")

#: offsets of rows: first the results; then the run of switches, sample of the last switch, applied control, mode, input
#: just before the sample, control and load that act now, mode of that control, the same three one sample before, last
#: output of the active and of the inactive controller, last error, excess u - v, switches in the window; of a rise the
#: direction and the lanes that wait for its two levels, in three places, and y one sample before; whether the next
#: sample is the active and the inactive controller's first; whether both outputs rest; y and its change at the last
#: sample that counts; the sample at which the control that acts was sent
PEAK_RATE, OVERSHOOT, OUTSIDE, IAE, ISE, SATURATED, PEAK_CONTROL = (WIDTH * i for i in range(7))
SWITCHES, LONGEST_RUN, CHATTERING, FINAL_ERROR, FINITE, BEGUN, SETTLED, STEP_ERROR = (WIDTH * i for i in range(7, 15))
UNDERSHOOT, REACHED, RISEN, RISE, PEAK_JERK = (WIDTH * i for i in range(15, 20))
RUN, LAST_SWITCH, APPLIED, MODE, PREVIOUS_INPUT, CONTROL, LOAD, ARRIVED_MODE = (WIDTH * i for i in range(20, 28))
OLD_CONTROL, OLD_LOAD, OLD_ARRIVED_MODE, LAST_OUTPUT, OTHER_LAST_OUTPUT, LAST_ERROR, EXCESS, RECENT_SWITCHES = (
    WIDTH * i for i in range(28, 36)
)
RISING, RISING_OUTPUT, IS_NEW, COASTING, OUTPUT, CHANGE, SENT, IDLE_IS_NEW = (WIDTH * i for i in range(36, 44))
NOISE = WIDTH * 44
#: four rows, of the noise of four samples, and again; a vector may be read from the last entry of these
TAILS = NOISE + 4 * WIDTH
#: rows with a fixed offset
FIXED_ROWS = TAILS // WIDTH + 5
#: rows of `steps`, one number a sample: the reference that is judged, direction, band, what begins there, the reference
#: before, and a tenth and nine tenths of the reference's last step
VALUE, DIRECTION, BAND, BEGINS, BEFORE, RISES_FROM, RISES_TO = range(7)
STEP_ROWS = 7
GOES_ON, REFERENCE_BEGINS, LOAD_BEGINS = 0.0, 1.0, 2.0
#: a controller's coefficients; from SECTIONS on p, w, r of every section, then k, q of every one of the derivative,
#: then c and d of a measurement filter
DIRECT, GAIN, LOW, HIGH, START, INTEGRATES, MOST_CHANGE = range(7)
PROPORTIONAL, SETPOINT_WEIGHT, FED_STATIC, FED_CHANGE, FLOOR, HOLD_BELOW, SECTIONS = range(7, 14)
HOLD, TRACK, RESET = 0, 1, 2
#: `Precision.FLOAT64.flush_below`; stated here because the cache of what was compiled knows this module
FLUSH_BELOW = 2.0**-970


class Settings(NamedTuple):
    """A scenario in numbers; integers count samples or are flags, 0 or 1."""

    noise_std: float
    quantum: float
    most_change: float
    up: float
    down: float
    coast_above: float
    coast_below: float
    seed: np.uint64
    first_index: int
    order: int
    sections: int
    hybrid: int
    up_absolute: int
    down_absolute: int
    coasts: int
    coast_above_absolute: int
    coast_below_absolute: int
    inactive: int
    limits_rate: int
    weighted: int
    fed: int
    stands: int
    derivatives: int
    starts_at_first_sample: int
    filter_order: int
    first_mode: int
    most_switches: int
    window: int
    dwell: int
    horizon: int
    judged: int
    bumpless: int
    delayed: int
    ring: int
    own_delays: int
    first_delay: int
    second_delay: int
    segments: int
    same_delay: int
    loaded: int
    load_delayed: int
    acts_at_samples: int
    steps: int
    width: int
    keep: int


class ScratchLayout(NamedTuple):
    """Offsets in the scratch array: states x of the plant, its coefficients, next states, then controllers' states, the
    measurements behind the lags of the active and of the inactive controller's derivative, and those of a measurement
    filter last."""

    x: int
    plant: int
    following: int
    active: int
    spare: int
    inactive_0: int
    inactive_1: int
    filtered: int
    idle_filtered: int
    spare_filtered: int
    lagged: int
    spare_lagged: int
    size: int


def scratch_layout(order: int, plant_rows: int, sections: int, derivatives: int, filter_order: int) -> ScratchLayout:
    """The layout for an order of plant, its number of coefficients, and the controllers' numbers of sections."""
    rows = (order, plant_rows, order, sections, sections, sections, sections)
    rows = (*rows, derivatives, derivatives, derivatives, filter_order, filter_order)
    return ScratchLayout(*(int(WIDTH * place) for place in np.cumsum((FIXED_ROWS, *rows))))
