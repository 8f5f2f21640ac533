"""The loop of a case:  box of plants, pattern of limited samples -> trajectories."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from flint import ctx

from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.time_domain.case import PRECISION, TimeDomainCase
from fopi_tune.proof.time_domain.patterns import Filter, Pattern, filter_under
from fopi_tune.proof.time_domain.plants.held import HeldPlants
from fopi_tune.proof.time_domain.plants.hold import hold_plants
from fopi_tune.proof.time_domain.solution import Solution, Trajectory

#: filters under patterns that are kept
_KEPT = 8


class Loop:
    """The loop of a case; keeps the filters of the patterns met last."""

    def __init__(self, case: TimeDomainCase) -> None:
        self.case = case
        self._filters: OrderedDict[bytes, Filter | None] = OrderedDict()

    def plants(self, box: Box) -> HeldPlants | None:
        """The plants of a box; None where it must be split."""
        case = self.case
        with ctx.workprec(PRECISION):
            return hold_plants(
                case.family, box, case.sample_time_s, case.delay_samples, (case.run.start.output, case.rests),
                case.load is not None,
            )  # fmt: skip

    def trajectory(self, plants: HeldPlants, pattern: Pattern) -> Trajectory | None:
        """The trajectories of a box if the pattern is theirs; None where no bound holds."""
        if pattern.key not in self._filters:
            self._filters[pattern.key] = filter_under(self.case, pattern)
            while len(self._filters) > _KEPT:
                self._filters.popitem(last=False)
        self._filters.move_to_end(pattern.key)
        own = self._filters[pattern.key]
        if own is None:
            return None
        with np.errstate(all="ignore"):
            return Solution(self.case, plants, pattern, own).trajectory()
