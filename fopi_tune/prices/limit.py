"""One limit of one requirement, to be turned while all else of the spec stays."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.spec.model import DesignSpec, Relation, Requirement

#: how far a limit is turned at the most: dB, degrees (per decade), and for the others this many times
_FARTHEST = {"_db": 40.0, "_deg": 90.0, "_deg_per_decade": 180.0}
_MOST_TIMES = 20.0
#: how far a sweep goes where nothing ends it, as a part of that
_USUAL = 0.15


@dataclass(frozen=True)
class MovableLimit:
    """A limit that can be turned.

    Args:
        spec: what was asked, but with the limit as a requirement of its own: `between` becomes two.
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
        """With its own limit."""
        return self.spec.requirements[self.index]

    @property
    def quantity(self) -> Quantity:
        """What is limited."""
        return QUANTITIES[self.requirement.quantity]

    @property
    def limit(self) -> float:
        """The spec's own, public unit."""
        return self.requirement.limits[0]

    @property
    def name(self) -> str:
        """The words that choose it: "4" or "2.upper"."""
        return f"{self.number}.{self.end}" if self.end else str(self.number)

    @property
    def tightens(self) -> int:
        """Which way the limit asks for more: 1 up, -1 down; 0 for `equals`, where either way asks for another thing."""
        return {Relation.AT_LEAST: 1, Relation.AT_MOST: -1}.get(self.requirement.relation, 0)

    def at(self, limit: float) -> DesignSpec:
        """The spec with the limit at `limit`, in its public unit."""
        moved = replace(self.requirement, limits=(limit,))
        requirements = (*self.spec.requirements[: self.index], moved, *self.spec.requirements[self.index + 1 :])
        return replace(self.spec, requirements=requirements)

    def reach(self, way: int, part: float = 1.0) -> float:
        """The limit, public unit, as far up (`way` 1) or down (-1) as it is turned at the most.

        Args:
            way: 1 or -1.
            part: of that way, dimensionless, from 0 to 1.
        """
        for unit, farthest in _FARTHEST.items():
            if self.requirement.quantity.endswith(unit):
                return self.limit + way * part * farthest
        return self.limit * _MOST_TIMES ** (way * part)

    def usual(self, way: int) -> float:
        """Where a sweep up (`way` 1) or down (-1) ends when nothing else ends it, public unit."""
        return self.reach(way, _USUAL)


def movable_limit(spec: DesignSpec, words: str) -> MovableLimit:
    """The knob that words choose: a requirement's number in the spec, or its quantity when no other has the same.

    Args:
        spec: what is asked.
        words: "3", "sensitivity_db"; of a `between` with ".lower" or ".upper" behind.

    Raises:
        DomainError: there is no such requirement, or more than one; the message lists those there are.
    """
    knobs = movable_limits(spec)
    found = [knob for knob in knobs if words in (knob.name, str(knob.number))]
    if not found:
        name, _, end = words.partition(".")
        found = [k for k in knobs if k.requirement.quantity == name and end in ("", k.end)]
    if len(found) == 1:
        return found[0]
    if not knobs:
        raise DomainError(f"there is no requirement {words!r}: the spec has none")
    problem = f"{words!r} is not one limit of the spec" if found else f"there is no requirement {words!r}"
    raise DomainError(f"{problem}; choose by number: {'; '.join(_described(knob) for knob in found or knobs)}")


def movable_limits(spec: DesignSpec) -> tuple[MovableLimit, ...]:
    """Every limit there is, in the order of the spec."""
    knobs: list[MovableLimit] = []
    for i, requirement in enumerate(spec.requirements):
        if requirement.relation is not Relation.BETWEEN:
            knobs.append(MovableLimit(spec, i, i + 1))
            continue
        sides = [
            replace(requirement, relation=relation, limits=(limit,))
            for relation, limit in zip((Relation.AT_LEAST, Relation.AT_MOST), requirement.limits, strict=True)
        ]
        for k, end in enumerate(("lower", "upper")):
            others = (*spec.requirements[:i], sides[k], *spec.requirements[i + 1 :], sides[1 - k])
            knobs.append(MovableLimit(replace(spec, requirements=others), i, i + 1, end))
    return tuple(knobs)


def _described(knob: MovableLimit) -> str:
    requirement = knob.requirement
    low, high = requirement.from_rad_s, requirement.to_rad_s
    band = f" from {low:g} rad/s on" if low > 0.0 else ""
    if high < math.inf:
        band = f" from {low:g} to {high:g} rad/s" if low > 0.0 else f" up to {high:g} rad/s"
    return (
        f"{knob.name} is {requirement.quantity} {requirement.relation.value} {knob.limit:g}{band}"
        f" ({requirement.scope.value})"
    )
