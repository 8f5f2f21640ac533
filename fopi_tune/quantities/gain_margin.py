"""The gain margin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import phase_crossovers
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, Measured, Quantity, smallest_by_row


class GainMargin(Quantity):
    name = "gain_margin_db"
    where = EvaluatedAt.PHASE_CROSSOVERS
    meaning = "1/|L|, the smallest over the phase crossovers with |L| < 1"

    def to_natural(self, value: float) -> float:
        return value * math.log(10.0) / 20.0

    def from_natural(self, value: float) -> float:
        return value * 20.0 / math.log(10.0)

    def measure(self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float) -> Measured:
        crossings = phase_crossovers(loops)
        margin_db = np.where(crossings.gain <= 1.0, -20.0 * np.log10(crossings.gain), np.inf)
        found = smallest_by_row(crossings, margin_db, len(loops))
        return Measured(np.where(np.isnan(found.value), np.inf, found.value), found.omega_rad_s)

    def natural(self, loop: LoopSymbols) -> Any:
        return -loop.log_gain
