"""Requirements as one-sided inequalities and equalities in natural units: what a solver works with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.quantities.base import Where
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

#: The design keeps |S| below this for every plant and frequency, whether or not a requirement says so: the loop's
#: distance from -1 stays above 0.01, so that stability at one member carries over to the connected family.
STABILITY_GUARD_DB = 40.0
#: 2 arcsin(0.01/2): the phase margin that goes with that distance
STABILITY_GUARD_DEG = 0.573
#: the guard's place in lists of requirements
GUARD = -1


class Bound(Enum):
    """Which way a side bounds its quantity; the value is the slack's sign: slack = value (limit - quantity)."""

    LOWER = -1
    UPPER = 1
    EQUAL = 0


@dataclass(frozen=True)
class Side:
    """One side of one requirement.

    Args:
        requirement: index in the spec's list, or GUARD.
        quantity: what is bounded.
        bound: which way.
        limit: in natural units (neper or radian).
        limit_public: in the quantity's public unit.
        scale: multiplies the slack; see `Quantity.natural_scale`.
        nominal: only the nominal member counts.
        from_rad_s, to_rad_s: the band, for frequency functions.
        in_depth: whether its slack counts when the smallest slack is the objective.
    """

    requirement: int
    quantity: Quantity
    bound: Bound
    limit: float
    limit_public: float
    scale: float
    nominal: bool
    from_rad_s: float
    to_rad_s: float
    in_depth: bool

    @property
    def where(self) -> Where:
        """At which frequencies the quantity is read."""
        return self.quantity.where

    def slack(self, natural: float) -> float:
        """How far inside the limit a value is; of an equality, minus the distance."""
        if self.bound is Bound.EQUAL:
            return -abs(self.limit - natural) * self.scale
        return self.bound.value * (self.limit - natural) * self.scale

    def natural_per_public(self) -> float:
        """d limit / d limit_public, by a central difference (exact for the linear units)."""
        step = 1e-6 * max(1.0, abs(self.limit_public))
        if self.limit_public - step <= 0.0 < self.limit_public:
            step = 1e-6 * self.limit_public
        up, down = (self.quantity.to_natural(self.limit_public + d) for d in (step, -step))
        return (up - down) / (2.0 * step)


def sides_of(spec: DesignSpec) -> tuple[Side, ...]:
    """Every side of every requirement, then the two stability guards.

    The guard of |S| counts in the depth only when nothing else does.  The small phase margin steers away from
    unstable loops that meet all the rest: |S| <= M alone is also true of some of them.
    """
    sides = [side for i, requirement in enumerate(spec.requirements) for side in _split(i, requirement)]
    peak = Requirement("sensitivity_db", Relation.AT_MOST, (STABILITY_GUARD_DB,))
    margin = Requirement("phase_margin_deg", Relation.AT_LEAST, (STABILITY_GUARD_DEG,))
    alone = not any(side.in_depth for side in sides)
    return (
        *sides,
        _side(GUARD, peak, Bound.UPPER, STABILITY_GUARD_DB, alone),
        _side(GUARD, margin, Bound.LOWER, STABILITY_GUARD_DEG, False),
    )


def _split(index: int, requirement: Requirement) -> list[Side]:
    if requirement.relation is Relation.EQUALS:
        return [_side(index, requirement, Bound.EQUAL, requirement.limits[0], False)]
    sides = []
    if math.isfinite(requirement.lower):
        sides.append(_side(index, requirement, Bound.LOWER, requirement.lower, True))
    if math.isfinite(requirement.upper):
        sides.append(_side(index, requirement, Bound.UPPER, requirement.upper, True))
    return sides


def _side(index: int, requirement: Requirement, bound: Bound, limit: float, in_depth: bool) -> Side:
    quantity = QUANTITIES[requirement.quantity]
    return Side(
        requirement=index,
        quantity=quantity,
        bound=bound,
        limit=quantity.to_natural(limit),
        limit_public=limit,
        scale=quantity.natural_scale(limit),
        nominal=requirement.scope is Scope.NOMINAL,
        from_rad_s=requirement.from_rad_s,
        to_rad_s=requirement.to_rad_s,
        in_depth=in_depth,
    )
