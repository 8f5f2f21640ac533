"""A requirement as frozen data:  a quantity, its limits, and where they hold."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from fopi_tune.core.peaks import Tilt
from fopi_tune.quantities.base import NEPER_PER_DB


class Relation(StrEnum):
    """How a quantity relates to its limit."""

    EQUALS = "equals"
    AT_LEAST = "at_least"
    AT_MOST = "at_most"
    BETWEEN = "between"


class Scope(StrEnum):
    """Which plants a requirement is about."""

    FAMILY = "family"
    NOMINAL = "nominal"


@dataclass(frozen=True)
class Requirement:
    """One line of `requirements:`.

    Args:
        quantity: a key of `fopi_tune.quantities.QUANTITIES`.
        relation: how it relates to the limits.
        limits: one number, two for `between`; in the quantity's public unit.
        scope: the whole family or the nominal member.
        from_rad_s: lower end of the band of a frequency function; 0 is "all low frequencies".
        to_rad_s: upper end; infinite is "all high frequencies".  Equal ends are `at_rad_s`.
        end_limit: of a line of `by_frequency`, the limit at `to_rad_s`, where `limits` is that at `from_rad_s`; between
            them it is straight over log omega.  Values are told as what they amount to at `from_rad_s`: of a response
            R in dB, R(omega) - (limit at omega) + (limit at from_rad_s).  None: the limit is one number.
        line: line in the file, 0 when the spec did not come from a file.
    """

    quantity: str
    relation: Relation
    limits: tuple[float, ...]
    scope: Scope = Scope.FAMILY
    from_rad_s: float = 0.0
    to_rad_s: float = math.inf
    line: int = 0
    end_limit: float | None = None

    @property
    def every_limit(self) -> tuple[float, ...]:
        """All numbers of the limit, both ends of a line."""
        return self.limits if self.end_limit is None else (*self.limits, self.end_limit)

    @property
    def tilt(self) -> Tilt | None:
        """What turns a response into one that is compared with the limit at `from_rad_s`; None of one number."""
        if self.end_limit is None:
            return None
        rise = (self.end_limit - self.limits[0]) * NEPER_PER_DB
        return Tilt(rise / math.log(self.to_rad_s / self.from_rad_s), self.from_rad_s)

    def moved(self, limits: tuple[float, ...]) -> Requirement:
        """With other limits; a line moves as a whole."""
        end = None if self.end_limit is None else self.end_limit + limits[0] - self.limits[0]
        return replace(self, limits=limits, end_limit=end)

    def value_at(self, value: float, omega_rad_s: float | None) -> float:
        """What a value that is told as at `from_rad_s` is at its own frequency; itself without a line."""
        if self.end_limit is None or omega_rad_s is None:
            return value
        return value + self.limit_at(omega_rad_s) - self.limits[0]

    def limit_at(self, omega_rad_s: float) -> float:
        """The limit, dB, at a frequency of a line of `by_frequency`."""
        tilt = self.tilt
        assert tilt is not None
        # where a line crosses 0 dB its rounding error is all that is left of it
        return round(self.limits[0] + tilt.power * math.log(omega_rad_s / tilt.omega_rad_s) / NEPER_PER_DB, 12)

    @property
    def lower(self) -> float:
        """The quantity must be at least this; -inf where there is no such limit."""
        return self.limits[0] if self.relation is not Relation.AT_MOST else -math.inf

    @property
    def upper(self) -> float:
        """The quantity must be at most this; inf where there is no such limit."""
        return self.limits[-1] if self.relation is not Relation.AT_LEAST else math.inf
