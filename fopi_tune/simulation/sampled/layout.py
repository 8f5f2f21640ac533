"""Where the compiled simulation keeps its numbers:  a scratch array of rows of `WIDTH` doubles, one lane a plant.

What the controllers are made of is the same for all lanes and not here; a lane selects its mode's numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: lanes: four of the widest registers, so that one chain of operations fills the wait of the others
WIDTH = 32

#: results, a row each
RESULTS = (
    "peak_rate", "overshoot", "outside", "iae", "ise", "saturated", "peak_control", "switches", "longest_run",
    "chattering", "final_error", "finite",
)  # fmt: skip
#: traces, a row each
TRACES = ("output", "rate", "measured", "error", "demanded", "applied", "mode", "rate_after")

PEAK_RATE, OVERSHOOT, OUTSIDE, IAE, ISE, SATURATED, PEAK_CONTROL = (WIDTH * i for i in range(7))
SWITCHES, LONGEST_RUN, CHATTERING, FINAL_ERROR, FINITE = (WIDTH * i for i in range(7, 12))
RUN, LAST_SWITCH, APPLIED, MODE, PREVIOUS_INPUT, CONTROL, LOAD, ARRIVED_MODE = (WIDTH * i for i in range(12, 20))
OLD_CONTROL, OLD_LOAD, OLD_ARRIVED_MODE, LAST_OUTPUT, OTHER_LAST_OUTPUT, LAST_ERROR, EXCESS, RECENT_SWITCHES, NOISE = (
    WIDTH * i for i in range(20, 29)
)
#: four rows each, for the noise of four samples; a pack may be read from the last place
TAILS, LOGARITHMS = NOISE + 4 * WIDTH, NOISE + 9 * WIDTH
#: rows with a fixed place
FIXED_ROWS = 42
#: a controller's numbers before p, w, r of every section
DIRECT, GAIN, LOW, HIGH, START, INTEGRATES, SECTIONS = range(7)
HOLD, TRACK, RESET = 0, 1, 2


class Settings(NamedTuple):
    """A scenario in numbers; the whole ones count samples or are 0 and 1."""

    noise_std: float
    quantum: float
    most_change: float
    half_width: float
    band: float
    final: float
    direction: float
    seed: np.uint64
    first_index: int
    order: int
    sections: int
    hybrid: int
    inactive: int
    first_mode: int
    most_switches: int
    window: int
    horizon: int
    bumpless: int
    delayed: int
    ring: int
    same_late: int
    loaded: int
    load_delayed: int
    prompt: int
    steps: int
    width: int
    keep: int


class ScratchLayout(NamedTuple):
    """Places in the scratch array; of a table's rows: x, then what `simulate` packs behind it."""

    x: int
    plant: int
    following: int
    active: int
    spare: int
    inactive_0: int
    inactive_1: int
    size: int


def scratch_layout(order: int, plant_rows: int, sections: int) -> ScratchLayout:
    """The places for plants of an order with so many rows of numbers behind their states, and controllers."""
    rows = (order, plant_rows, order, sections, sections, sections, sections)
    return ScratchLayout(*(int(WIDTH * place) for place in np.cumsum((FIXED_ROWS, *rows))))
