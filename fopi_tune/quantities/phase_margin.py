"""The phase margin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured, phase_margins
from fopi_tune.quantities.base import EvaluatedAt, LoopSymbols, QuantityAtCrossings


class PhaseMargin(QuantityAtCrossings):
    name = "phase_margin_deg"
    where = EvaluatedAt.GAIN_CROSSOVERS
    meaning = "the smallest angle between L and -1, by lag or by lead, over all gain crossovers"
    is_margin = True

    def to_natural(self, value: float) -> float:
        return math.radians(value)

    def from_natural(self, value: float) -> float:
        return math.degrees(value)

    def check_limit(self, limit: float) -> str | None:
        return None if limit <= 180 else "must be at most 180 deg, the largest angle between L and -1"

    def at_crossings(self, loops: Loops, crossings: Crossings) -> Measured:
        found = phase_margins(loops, crossings)
        return Measured(np.degrees(found.value), found.omega_rad_s)

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.phase_margin_rad
