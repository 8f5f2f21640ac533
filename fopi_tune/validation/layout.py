"""Where the compiled simulation keeps its numbers:  a scratch array of rows of `WIDTH` doubles, one lane a plant.

What a mode's controller has is a slot; slot A belongs to the active mode.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: lanes: two of the widest registers, so that one chain of operations fills the wait of the other
WIDTH = 16

#: results, a row each
RESULTS = (
    "peak_rate", "overshoot", "outside", "iae", "ise", "saturated", "peak_control", "switches", "longest_run",
    "chattering", "final_error", "finite",
)  # fmt: skip
#: traces, a row each
TRACES = ("output", "rate", "measured", "error", "demanded", "applied", "mode")

PEAK_RATE, OVER, OUTSIDE, IAE, ISE, SATURATED, PEAK_U = (WIDTH * i for i in range(7))
SWITCHES, LONGEST, CHATTER, ERROR, FINITE = (WIDTH * i for i in range(7, 12))
RUN, JUMPED, APPLIED, MODE, BEFORE, CONTROL, LOAD, ARRIVED = (WIDTH * i for i in range(12, 20))
OLD_CONTROL, OLD_LOAD, OLD_ARRIVED, NOISE = (WIDTH * i for i in range(20, 24))
#: rows with a fixed place, noise for four samples included
FIXED_ROWS = 28
#: rows of a slot before its coefficients p, w, r of every section
SLOT_ROWS = 7
DIRECT, GAIN, LOW, HIGH, LAST, START, INTEGRATES, SECTIONS = (WIDTH * i for i in range(SLOT_ROWS + 1))
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
    loaded: int
    load_delayed: int
    steps: int
    width: int
    keep: int


class Layout(NamedTuple):
    """Places in the scratch array; of a table's rows: x, then what `simulate` packs behind it."""

    x: int
    plant: int
    following: int
    slot_a: int
    slot_b: int
    active_0: int
    active_1: int
    inactive_0: int
    inactive_1: int
    size: int


def layout(order: int, plant_rows: int, sections: int) -> Layout:
    """The places for plants of an order with so many rows of numbers behind their states, and controllers."""
    slot = SLOT_ROWS + 3 * sections
    rows = (order, plant_rows, order, slot, slot, sections, sections, sections, sections)
    return Layout(*(int(WIDTH * place) for place in np.cumsum((FIXED_ROWS, *rows))))
