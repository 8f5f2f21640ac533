"""The gain crossover."""

from __future__ import annotations

import math
from typing import Any

from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured, highest_by_row
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, QuantityAtCrossings


class Crossover(QuantityAtCrossings):
    name = "crossover_rad_s"
    where = EvaluatedAt.HIGHEST_GAIN_CROSSOVER
    meaning = "the highest gain crossover, |L| = 1"

    def to_natural(self, value: float) -> float:
        return math.log(value)

    def from_natural(self, value: float) -> float:
        return math.exp(value)

    def check_limit(self, limit: float) -> str | None:
        return None if limit > 0 else "must be greater than 0 rad/s"

    def at_crossings(self, loops: Loops, crossings: Crossings) -> Measured:
        return highest_by_row(crossings, crossings.omega_rad_s, len(loops))

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.log_omega
