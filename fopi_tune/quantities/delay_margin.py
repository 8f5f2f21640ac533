"""The delay margin."""

from __future__ import annotations

import math
from typing import Any

from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import gain_crossovers
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, Measured, Quantity, smallest_by_row


class DelayMargin(Quantity):
    name = "delay_margin_s"
    where = EvaluatedAt.GAIN_CROSSOVERS
    meaning = "phase margin / omega, the smallest over all gain crossovers"

    def to_natural(self, value: float) -> float:
        return value

    def from_natural(self, value: float) -> float:
        return value

    def check_limit(self, limit: float) -> str | None:
        return None if limit > 0 else "must be greater than 0 s"

    def measure(self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float) -> Measured:
        crossings = gain_crossovers(loops)
        return smallest_by_row(crossings, crossings.delay_margin_s, len(loops))

    def natural(self, loop: LoopSymbols) -> Any:
        return (loop.phase_rad + math.pi) / loop.omega_rad_s

    def natural_scale(self, limit: float) -> float:
        return 1.0 / limit
