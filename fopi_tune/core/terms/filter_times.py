"""Time constants of a controller's filters that are designed with its gains: where each of them may lie.

The filters are those of the derivative, 1/(Tf s + 1), and of the measurement, F with its T.  A controller has one value
of each; a box of controllers may have a range instead, and stands then for the controllers of all times in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.errors import DomainError

#: names of both times in notes and messages
TIME_NAMES: tuple[str, str] = ("derivative_filter_time_constant_s", "measurement_filter.time_constant_s")


@dataclass(frozen=True)
class FilterTimes:
    """Ranges of the filters' time constants.

    Args:
        derivative_s: least and largest Tf, s; None where it is given.
        measurement_s: least and largest T, s; None where it is given, or where there is no such filter.

    Raises:
        DomainError: a range is not of two positive numbers, the smaller one first; or there is none.
    """

    derivative_s: tuple[float, float] | None = None
    measurement_s: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for low, high in self.ranges.values():
            if not 0.0 < low < high < math.inf:
                raise DomainError(f"[{low!r}, {high!r}] is no range of time constants; give two positive numbers of s")
        if not self.ranges:
            raise DomainError("no time constant has a range")

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Least and largest time constant, s, of each filter whose time is designed, by its name in a spec."""
        both = zip(TIME_NAMES, (self.derivative_s, self.measurement_s), strict=True)
        return {name: side for name, side in both if side is not None}

    def hold(self, filter_s: float, used: MeasurementFilter | None) -> bool:
        """Whether these times lie in the ranges that there are.

        Args:
            filter_s: Tf, s.
            used: the measurement's filter.
        """
        times = (self.derivative_s, filter_s), (self.measurement_s, used.time_constant_s if used else math.nan)
        return all(side is None or side[0] <= time <= side[1] for side, time in times)


def middle_of(side: tuple[float, float]) -> float:
    """The geometric mean of a range of times, s."""
    return math.sqrt(side[0]) * math.sqrt(side[1])
