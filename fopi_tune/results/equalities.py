"""Equalities on a scale that people read:  how far a value is from what `equals` asks for.

A value equals its limit within the tolerance of the check, 1e-6 neper or radian, which no gains meet that were rounded
to the digits of a table.  The verdict keeps that tolerance; the score that is shown counts 0.1 % or 0.1 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fopi_tune.proof.verification.results import RequirementResult
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Relation, Requirement

#: neper, and relative for delay margins: 0.1 %
_SHOWN_RELATIVE = 1e-3
#: degrees, or degrees per decade
_SHOWN_DEG = 0.1
#: a value within so many of these is taken to be missed by rounding
_NEAR = 20.0
#: endings of quantities, and the unit as people write it
_UNITS = {"_deg_per_decade": "deg per decade", "_deg": "deg", "_db": "dB", "_rad_s": "rad/s", "_s": "s"}


def shown_score(requirement: Requirement, achieved: float) -> float:
    """The distance of a value from the limit of an equality, per 0.1 % or 0.1 degrees.

    Args:
        requirement: with the relation `equals`.
        achieved: the worst value, in the requirement's unit.
    """
    limit = requirement.limits[0]
    if not math.isfinite(achieved):
        return math.inf
    if _is_angle(requirement):
        return abs(achieved - limit) / _SHOWN_DEG
    if requirement.quantity == "delay_margin_s":
        return abs(achieved / limit - 1.0) / _SHOWN_RELATIVE
    natural = QUANTITIES[requirement.quantity].to_natural
    return abs(natural(achieved) - natural(limit)) / _SHOWN_RELATIVE


def in_percent(share: float) -> str:
    """A share with two digits, and never as a power of ten: "0.024 %", "45 %", "100 %"."""
    percent = 100.0 * share
    return f"{percent:.2g} %" if percent < 99.5 else f"{percent:.0f} %"


def equality_notes(results: Sequence[RequirementResult]) -> tuple[str, ...]:
    """By how much each equality is missed, and the range to write where that is little."""
    return tuple(note for result in results for note in _note(result))


def _note(result: RequirementResult) -> Iterator[str]:
    requirement, achieved = result.requirement, result.achieved
    if requirement.relation is not Relation.EQUALS or result.is_met or achieved is None or not math.isfinite(achieved):
        return
    limit, missed = requirement.limits[0], abs(achieved - requirement.limits[0])
    unit = next(unit for ending, unit in _UNITS.items() if requirement.quantity.endswith(ending))
    has_percent = not _is_angle(requirement) and unit != "dB" and limit != 0.0
    part = f" ({in_percent(missed / abs(limit))})" if has_percent else ""
    words = f"{requirement.quantity} = {limit:.10g} is missed by {missed:.3g} {unit}{part}"
    if shown_score(requirement, achieved) <= _NEAR:
        low, high = _range_around(requirement, limit, missed)
        words += (
            f"; `equals` leaves no room for rounded gains: to allow that much write "
            f"{requirement.quantity}: {{between: [{low:.10g}, {high:.10g}]}}"
        )
    yield words


def _range_around(requirement: Requirement, limit: float, missed: float) -> tuple[float, float]:
    """A range about the limit that holds the value: 0.1 % or 0.1 degrees wide to each side, or what it takes."""
    if _is_angle(requirement):
        usual = _SHOWN_DEG
    elif requirement.quantity.endswith("_db"):
        usual = 0.01
    else:
        usual = _SHOWN_RELATIVE * abs(limit)
    half = max(usual, 1.25 * missed)
    # two digits, upwards
    step = 10.0 ** (math.floor(math.log10(half)) - 1)
    half = math.ceil(half / step - 1e-9) * step
    return limit - half, limit + half


def _is_angle(requirement: Requirement) -> bool:
    return requirement.quantity.endswith(("_deg", "_deg_per_decade"))
