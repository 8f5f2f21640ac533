"""The phase margin."""

from __future__ import annotations

import math
from typing import Any

from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import gain_crossovers
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, Measured, Quantity, smallest_by_row


class PhaseMargin(Quantity):
    name = "phase_margin_deg"
    where = EvaluatedAt.GAIN_CROSSOVERS
    meaning = "180 deg + arg L, the smallest over all gain crossovers"

    def to_natural(self, value: float) -> float:
        return math.radians(value)

    def from_natural(self, value: float) -> float:
        return math.degrees(value)

    def measure(self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float) -> Measured:
        crossings = gain_crossovers(loops)
        return smallest_by_row(crossings, crossings.phase_margin_deg, len(loops))

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.phase_rad + math.pi
