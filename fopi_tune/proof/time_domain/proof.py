"""The result of trying to prove a time-domain requirement, and when a requirement is met."""

from __future__ import annotations

from dataclasses import dataclass

from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.measures import MeasureRange
from fopi_tune.proof.verdict import Verdict
from fopi_tune.spec.model import Relation

#: methods
FREE, LIMITED = "Taylor models of the loop", "Taylor models of the loop with saturation"
#: relative; above the rounding of a level and of its unit
_ROUNDING = 2.0**-49
#: measures whose tolerance is relative to the step, and not to a limit that may well be 0
_OF_STEP = ("overshoot", "undershoot")


@dataclass(frozen=True)
class TimeDomainProof:
    """What became of a time-domain requirement.

    Args:
        verdict: proved for every plant of the family, refuted by one, or neither.
        method: how; empty where there is no method.
        tolerance: by how much the limit may be missed, relative to it, or to the step for an overshoot.
        bound: proved of the measure over the family, in its unit, rounded outwards: it is not above it (not below it,
            where the limit is a lower one).  None when none was proved.
        theta: the uncertain numbers of a plant that refutes it, in the family's order; None without one.
        time_s: when, s; None for a measure of all samples.
        value: of the measure at that plant, in its unit, rounded towards the limit.
        boxes: that cover the family, each meeting the limit; empty unless it was proved.
        message: why it is undecided.
        examined: number of boxes.
    """

    verdict: Verdict
    method: str
    tolerance: float
    bound: float | None = None
    theta: tuple[float, ...] | None = None
    time_s: float | None = None
    value: float | None = None
    boxes: tuple[Box, ...] = ()
    message: str = ""
    examined: int = 0


@dataclass(frozen=True)
class Level:
    """A limit with its tolerance, in the output's unit.

    Args:
        upper: whether it is an upper one.
        within: on this side of it the limit is met, rounded towards the plants that meet it.
        beyond: on the other side of it the limit is missed, rounded away from them.
        per_unit: of the measure's unit.
    """

    upper: bool
    within: float
    beyond: float
    per_unit: float

    @classmethod
    def of(cls, case: TimeDomainCase, tolerance: float, margin: float = 0.0) -> Level:
        """The level of a case's limit.

        Args:
            case: with the limit.
            tolerance: as in a proof.
            margin: share of the tolerance that a search keeps, so that a recheck with other roundings agrees with it.
        """
        limit, scale = case.limit.limit, case.per_unit
        size = abs(limit)
        if case.limit.measure in _OF_STEP:
            steps = case.horizon.steps_of(case.run)
            size = max(abs(step.value - step.before) for step in steps) or size
        upper = case.limit.relation is Relation.AT_MOST
        sign = 1.0 if upper else -1.0
        within, beyond = ((limit + sign * tolerance * share * size) * scale for share in (1.0 - margin, 1.0 + margin))
        rounding = sign * _ROUNDING * (abs(limit) + size) * scale
        # without a tolerance the limit itself meets the limit
        exact = tolerance == 0.0 and scale == 1.0
        return cls(upper, within if exact else within - rounding, beyond + rounding, scale)

    def is_met(self, found: MeasureRange) -> bool:
        """Whether every plant meets the limit."""
        return found.high <= self.within if self.upper else found.low >= self.within

    def is_missed(self, found: MeasureRange) -> bool:
        """Whether no plant meets it."""
        return found.low > self.beyond if self.upper else found.high < self.beyond

    def excess(self, found: MeasureRange) -> float:
        """By how much the limit may be missed."""
        return found.high - self.within if self.upper else self.within - found.low

    def bound(self, found: MeasureRange) -> float:
        """What is proved of the measure, in its unit."""
        return self._public(found.high, 1.0) if self.upper else self._public(found.low, -1.0)

    def witness(self, found: MeasureRange) -> float:
        """What the measure reaches at least, in its unit; at most, of a lower limit."""
        return self._public(found.low, -1.0) if self.upper else self._public(found.high, 1.0)

    def _public(self, value: float, direction: float) -> float:
        return value / self.per_unit + direction * abs(value / self.per_unit) * _ROUNDING
