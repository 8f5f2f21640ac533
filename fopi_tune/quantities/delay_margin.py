"""The delay margin."""

from __future__ import annotations

from typing import Any

from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured, delay_margins
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, QuantityAtCrossings


class DelayMargin(QuantityAtCrossings):
    name = "delay_margin_s"
    where = EvaluatedAt.GAIN_CROSSOVERS
    meaning = "the lag that brings L to -1, over omega, the smallest over all gain crossovers"
    is_margin = True

    def to_natural(self, value: float) -> float:
        return value

    def from_natural(self, value: float) -> float:
        return value

    def check_limit(self, limit: float) -> str | None:
        return None if limit > 0 else "must be greater than 0 s"

    def at_crossings(self, loops: Loops, crossings: Crossings) -> Measured:
        return delay_margins(loops, crossings)

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.lag_to_minus_one_rad / loop.omega_rad_s

    def natural_scale(self, limit: float) -> float:
        return 1.0 / limit
