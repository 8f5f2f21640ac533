"""The slope of the phase."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured, highest_by_row
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, QuantityAtCrossings


class PhaseSlope(QuantityAtCrossings):
    name = "phase_slope_deg_per_decade"
    where = EvaluatedAt.HIGHEST_GAIN_CROSSOVER
    meaning = "d arg L / d log10 omega at the highest gain crossover; 0 is iso-damping"

    def to_natural(self, value: float) -> float:
        return math.radians(value)

    def from_natural(self, value: float) -> float:
        return math.degrees(value)

    def at_crossings(self, loops: Loops, crossings: Crossings) -> Measured:
        slope_deg_per_decade = np.degrees(crossings.slope_rad) * math.log(10.0)
        return highest_by_row(crossings, slope_deg_per_decade, len(loops))

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.phase_slope_rad * math.log(10.0)
