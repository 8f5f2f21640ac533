"""Joint yield:  of every draw, whether it meets each demand -> how many meet all of them at once.

The shares of single requirements do not tell it: of two that 99 % of the plants meet, between 98 % and 99 % meet both.

    met_i = stable_i  and  every requirement's met_i  and, in every scenario,  finite_i  and  calm_i  and  every limit's
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fopi_tune.montecarlo.membership import ClassifiedDraws, FamilyTally, Flags, family_tally
from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.montecarlo.tally import Worst

#: how many draws that meet not everything are kept, the first ones
_KEPT = 5


@dataclass(frozen=True)
class JointYield:
    """How many plants met everything at once.

    Args:
        fraction: of the plants, with its interval.
        missed_inside: plants of the family that did not.
        first_missed: indices of the first plants that did not, ascending, at most five.
        scenario: in which everything was met; None for all demands together.
    """

    fraction: Fraction
    missed_inside: int
    first_missed: tuple[int, ...]
    scenario: str | None = None

    @classmethod
    def of(cls, found: FamilyTally, confidence: float, scenario: str | None = None) -> JointYield:
        """The yield of a tally of `condition_tally`.

        Args:
            found: of all draws.
            confidence: of the interval, between 0 and 1.
            scenario: see the class.
        """
        missed = tuple(each.index for each in found.tally.worst if each.value > 0.0)
        return cls(found.tally.fraction(confidence), found.missed_inside, missed, scenario)


def condition_tally(draws: ClassifiedDraws, met: Flags) -> FamilyTally:
    """The tally of a chunk of truth values, shape (m,); a value is 0 where it is true, and 1 where it is not."""
    return family_tally(draws, np.where(met, 0.0, 1.0), met, Worst.LARGEST, _KEPT)


def all_of(flags: Iterable[Flags]) -> Flags:
    """Which draws meet every one of several demands, each of shape (m,); there is at least one."""
    return np.logical_and.reduce(list(flags))
