"""One limit of one requirement, to be moved while the rest of the spec stays."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.spec.model import DesignSpec, Relation, Requirement

#: the largest distance a limit is moved, by unit: dB, degrees, degrees per decade
_LARGEST_DISTANCE = {"_db": 40.0, "_deg": 90.0, "_deg_per_decade": 180.0}
#: the same for other units, as a factor
_LARGEST_FACTOR = 20.0
#: how far a sweep goes by default, relative to these
_DEFAULT_PART = 0.15


@dataclass(frozen=True)
class MovableLimit:
    """A limit that can be moved.

    Args:
        spec: the user's, with the limit as a requirement of its own: a `between` becomes two requirements.
        index: of that requirement in `spec`.
        number: of the requirement in the user's spec, from 1 on.
        end: "lower" or "upper" of a `between`; empty otherwise.
    """

    spec: DesignSpec
    index: int
    number: int
    end: str = ""

    @property
    def requirement(self) -> Requirement:
        """The requirement, with the user's limit."""
        return self.spec.requirements[self.index]

    @property
    def quantity(self) -> Quantity:
        """The quantity that is limited."""
        return QUANTITIES[self.requirement.quantity]

    @property
    def limit(self) -> float:
        """The user's limit, public unit."""
        return self.requirement.limits[0]

    @property
    def name(self) -> str:
        """The name by which it is selected: "4" or "2.upper"."""
        return f"{self.number}.{self.end}" if self.end else str(self.number)

    @property
    def tightens(self) -> int:
        """The direction that tightens the limit: 1 up, -1 down; 0 for `equals`, which has none."""
        return {Relation.AT_LEAST: 1, Relation.AT_MOST: -1}.get(self.requirement.relation, 0)

    def at(self, limit: float) -> DesignSpec:
        """The spec with the limit at `limit`, in its public unit."""
        moved = replace(self.requirement, limits=(limit,))
        requirements = (*self.spec.requirements[: self.index], moved, *self.spec.requirements[self.index + 1 :])
        return replace(self.spec, requirements=requirements)

    def farthest_limit(self, way: int, part: float = 1.0) -> float:
        """The farthest limit that is tried, public unit.

        Args:
            way: 1 up, -1 down.
            part: relative to the largest distance, from 0 to 1.
        """
        for unit, distance in _LARGEST_DISTANCE.items():
            if self.requirement.quantity.endswith(unit):
                return self.limit + way * part * distance
        return self.limit * _LARGEST_FACTOR ** (way * part)

    def default_end(self, way: int) -> float:
        """Where a sweep up (`way` 1) or down (-1) ends by default, public unit."""
        return self.farthest_limit(way, _DEFAULT_PART)


def movable_limit(spec: DesignSpec, words: str) -> MovableLimit:
    """Select a limit by its requirement's number in the spec, or by its quantity if only one requirement has it.

    Args:
        spec: the user's.
        words: "3" or "sensitivity_db"; for a `between` followed by ".lower" or ".upper".

    Raises:
        DomainError: there is no such requirement, or more than one; the message lists the choices.
    """
    limits = movable_limits(spec)
    found = [movable for movable in limits if words in (movable.name, str(movable.number))]
    if not found:
        name, _, end = words.partition(".")
        found = [k for k in limits if k.requirement.quantity == name and end in ("", k.end)]
    if len(found) == 1:
        return found[0]
    if not limits:
        raise DomainError(f"there is no requirement {words!r}: the spec has none")
    problem = f"{words!r} is not one limit of the spec" if found else f"there is no requirement {words!r}"
    raise DomainError(f"{problem}; choose by number: {'; '.join(_described(movable) for movable in found or limits)}")


def movable_limits(spec: DesignSpec) -> tuple[MovableLimit, ...]:
    """Every limit of a spec, in its order."""
    limits: list[MovableLimit] = []
    for i, requirement in enumerate(spec.requirements):
        if requirement.relation is not Relation.BETWEEN:
            limits.append(MovableLimit(spec, i, i + 1))
            continue
        sides = [
            replace(requirement, relation=relation, limits=(limit,))
            for relation, limit in zip((Relation.AT_LEAST, Relation.AT_MOST), requirement.limits, strict=True)
        ]
        for k, end in enumerate(("lower", "upper")):
            others = (*spec.requirements[:i], sides[k], *spec.requirements[i + 1 :], sides[1 - k])
            limits.append(MovableLimit(replace(spec, requirements=others), i, i + 1, end))
    return tuple(limits)


def _described(movable: MovableLimit) -> str:
    requirement = movable.requirement
    low, high = requirement.from_rad_s, requirement.to_rad_s
    band = f" from {low:g} rad/s on" if low > 0.0 else ""
    if high < math.inf:
        band = f" from {low:g} to {high:g} rad/s" if low > 0.0 else f" up to {high:g} rad/s"
    return (
        f"{movable.name} is {requirement.quantity} {requirement.relation.value} {movable.limit:g}{band}"
        f" ({requirement.scope.value})"
    )
