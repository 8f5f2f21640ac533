"""The gain margin."""

from __future__ import annotations

from typing import Any

from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured, gain_margins
from fopi_tune.quantities.base import NEPER_PER_DB, EvaluatedAt, LoopSymbols, QuantityAtCrossings


class GainMargin(QuantityAtCrossings):
    name = "gain_margin_db"
    where = EvaluatedAt.PHASE_CROSSOVERS
    meaning = "1/|L|, the smallest over the phase crossovers with |L| < 1"
    is_margin = True

    def to_natural(self, value: float) -> float:
        return value * NEPER_PER_DB

    def from_natural(self, value: float) -> float:
        return value / NEPER_PER_DB

    def at_crossings(self, loops: Loops, crossings: Crossings) -> Measured:
        found = gain_margins(loops, crossings)
        return Measured(found.value / NEPER_PER_DB, found.omega_rad_s)

    def natural(self, loop: LoopSymbols) -> Any:
        return -loop.log_gain
