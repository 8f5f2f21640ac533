"""One limit of one requirement, to be moved while the rest of the spec stays."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.spec.model import DesignSpec, Limit, Relation, Requirement
from fopi_tune.spec.scenarios import every_requirement

if TYPE_CHECKING:
    from fopi_tune.proof import Verification

#: the largest distance a limit is moved, by unit: dB, degrees, degrees per decade
_LARGEST_DISTANCE = {"_db": 40.0, "_deg": 90.0, "_deg_per_decade": 180.0}
#: the same for other units, as a factor
_LARGEST_FACTOR = 20.0
#: how far a sweep goes by default, relative to these
_DEFAULT_PART = 0.15


@dataclass(frozen=True)
class MeasureScale:
    """A measure of scenarios as a quantity whose natural unit is relative to its limit.

    Args:
        name: the measure's word.
        unit: the user's limit, in the measure's unit.
    """

    name: str
    unit: float

    def to_natural(self, public: float) -> float:
        """Relative to the user's limit."""
        return public / self.unit

    def from_natural(self, natural: float) -> float:
        """In the measure's unit."""
        return natural * self.unit

    def natural_scale(self, limit: float) -> float:
        """1: slacks are counted as limits are."""
        return 1.0

    def check_limit(self, limit: float) -> str | None:
        """Why a limit makes no sense; None for any number."""
        return None


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
    def requirement(self) -> Requirement | Limit:
        """The requirement, with the user's limit."""
        return every_requirement(self.spec)[self.index]

    @property
    def quantity_name(self) -> str:
        """Of the quantity or measure that is limited."""
        requirement = self.requirement
        return requirement.measure if isinstance(requirement, Limit) else requirement.quantity

    @property
    def quantity(self) -> Quantity | MeasureScale:
        """The quantity that is limited."""
        requirement = self.requirement
        if isinstance(requirement, Limit):
            return MeasureScale(requirement.measure, abs(requirement.limit) or 1.0)
        return QUANTITIES[requirement.quantity]

    @property
    def limit(self) -> float:
        """The user's limit, public unit."""
        requirement = self.requirement
        return requirement.limit if isinstance(requirement, Limit) else requirement.limits[0]

    def slack_in(self, found: Verification) -> float | None:
        """How far inside the limit a check found gains, natural units; None where the quantity has no value."""
        first = len(found.requirements)
        if self.index < first:
            return found.requirements[self.index].slack
        return 1.0 - found.measures[self.index - first].score

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
        requirement, first = self.requirement, len(self.spec.requirements)
        if isinstance(requirement, Limit):
            others = self.spec.scenario_requirements
            place, moved = self.index - first, replace(requirement, limit=limit)
            return replace(self.spec, scenario_requirements=(*others[:place], moved, *others[place + 1 :]))
        moved_one = requirement.moved((limit,))
        requirements = (*self.spec.requirements[: self.index], moved_one, *self.spec.requirements[self.index + 1 :])
        return replace(self.spec, requirements=requirements)

    def farthest_limit(self, way: int, part: float = 1.0) -> float:
        """The farthest limit that is tried, public unit.

        Args:
            way: 1 up, -1 down.
            part: relative to the largest distance, from 0 to 1.
        """
        for unit, distance in _LARGEST_DISTANCE.items():
            if self.quantity_name.endswith(unit):
                return self.limit + way * part * distance
        if self.limit <= 0.0:
            # a measure's, such as an overshoot of 0, which no factor moves to the other side
            return self.limit + way * (abs(self.limit) or 1.0) * (_LARGEST_FACTOR**part - 1.0)
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
        found = [k for k in limits if k.quantity_name == name and end in ("", k.end)]
    if len(found) == 1:
        return found[0]
    if not limits:
        raise DomainError(f"there is no requirement {words!r}: the spec has none")
    problem = f"{words!r} is not one limit of the spec" if found else f"there is no requirement {words!r}"
    raise DomainError(f"{problem}; choose by number: {'; '.join(_described(movable) for movable in found or limits)}")


def movable_limits(spec: DesignSpec) -> tuple[MovableLimit, ...]:
    """Every limit of a spec: those of the loop's frequency response, then those of scenarios.

    They are numbered by their places in the spec's text, where both kinds may stand in any order.
    """
    limits: list[MovableLimit] = []
    every = every_requirement(spec)
    numbers = {place: number for number, place in enumerate(sorted(range(len(every)), key=lambda i: every[i].line), 1)}
    for i, requirement in enumerate(spec.requirements):
        if requirement.relation is not Relation.BETWEEN:
            limits.append(MovableLimit(spec, i, numbers[i]))
            continue
        sides = [
            replace(requirement, relation=relation, limits=(limit,))
            for relation, limit in zip((Relation.AT_LEAST, Relation.AT_MOST), requirement.limits, strict=True)
        ]
        for k, end in enumerate(("lower", "upper")):
            others = (*spec.requirements[:i], sides[k], *spec.requirements[i + 1 :], sides[1 - k])
            limits.append(MovableLimit(replace(spec, requirements=others), i, numbers[i], end))
    first = len(spec.requirements)
    limits += [MovableLimit(spec, first + i, numbers[first + i]) for i in range(len(spec.scenario_requirements))]
    return tuple(limits)


def _described(movable: MovableLimit) -> str:
    requirement = movable.requirement
    if isinstance(requirement, Limit):
        about = f" ({requirement.scenario})" if requirement.scenario is not None else ""
        return f"{movable.name} is {requirement.measure} {requirement.relation.value} {movable.limit:g}{about}"
    low, high = requirement.from_rad_s, requirement.to_rad_s
    band = f" from {low:g} rad/s on" if low > 0.0 else ""
    if high < math.inf:
        band = f" from {low:g} to {high:g} rad/s" if low > 0.0 else f" up to {high:g} rad/s"
    return (
        f"{movable.name} is {requirement.quantity} {requirement.relation.value} {movable.limit:g}{band}"
        f" ({requirement.scope.value})"
    )
