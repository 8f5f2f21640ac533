"""How far a clashing requirement would have to give:  said only where the spec was met with that one limit moved."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from fopi_tune.quantities import QUANTITIES
from fopi_tune.results.status import Give
from fopi_tune.spec.model import DesignSpec, Relation, Requirement

#: a limit is moved this much further than where a search ended (natural units): at the very end rounding decides
_HAIR = 1e-5
#: digits of the limits that are tried: those that a table prints, then fewer, since a stand-in is right to fewer
_DIGITS = (5, 2)


def confirmed(spec: DesignSpec, clash: Sequence[Give], is_met: Callable[[DesignSpec], bool]) -> tuple[Give, ...]:
    """The same requirements, each with the limit with which the spec was met, or with none.

    Args:
        spec: that is infeasible.
        clash: what a search, or a check of fixed gains, takes for enough.
        is_met: whether gains were found with which a spec holds, stability of the whole family included; decided by
            the independent check.
    """
    return tuple(_confirmed(spec, give, is_met) for give in clash)


def _confirmed(spec: DesignSpec, give: Give, is_met: Callable[[DesignSpec], bool]) -> Give:
    requirement = spec.requirements[give.requirement]
    if give.new_limit is not None:
        position = _position(requirement, give.new_limit)
        old = requirement.limits[position]
        for limit in _beyond(requirement, old, give.new_limit):
            limits = (*requirement.limits[:position], limit, *requirement.limits[position + 1 :])
            moved = replace(requirement, limits=limits)
            others = spec.requirements
            every = (*others[: give.requirement], moved, *others[give.requirement + 1 :])
            if is_met(replace(spec, requirements=every)):
                return Give(give.requirement, abs(limit - old), limit)
    return Give(give.requirement, None, None)


def _position(requirement: Requirement, limit: float) -> int:
    """Which of the limits moves: of a `between` the one that the new limit lies beyond."""
    return 0 if limit < requirement.limits[0] else len(requirement.limits) - 1


def _beyond(requirement: Requirement, old: float, limit: float) -> Iterator[float]:
    """Limits at least as far from the old one, in few digits; of an `equals` first the very value."""
    quantity = QUANTITIES[requirement.quantity]
    way = math.copysign(1.0, limit - old)
    further = quantity.from_natural(quantity.to_natural(limit) + way * _HAIR)
    tried = [_rounded(further, way, digits) for digits in _DIGITS if further != 0.0]
    if requirement.relation is Relation.EQUALS:
        tried = [limit, *tried[1:]]
    for each in dict.fromkeys(tried):
        if each != old and quantity.check_limit(each) is None:
            yield each


def _rounded(value: float, way: float, digits: int) -> float:
    """To so many digits, up (`way` 1) or down (-1)."""
    step = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    count = math.ceil(value / step) if way > 0.0 else math.floor(value / step)
    # through text: the nearest double of a number with few digits
    return float(f"{count * step:.{digits}g}")
