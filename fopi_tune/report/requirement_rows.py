"""Requirements as rows of a table:  the entries of a document -> words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fopi_tune.report.documents import ReportedRequirement
from fopi_tune.report.text.formatting import (
    NO_MARGIN,
    TIE,
    endless_phrase,
    missed_digits,
    number,
    requirement_phrase,
    scope_phrase,
    score_phrase,
    verdict_word,
    with_unit,
)
from fopi_tune.spec.model import Requirement

#: verdict -> a symbol that is readable without colour
_SIGNS = {"proved": "✓", "met": "✓", "violated": "✗", "undecided": "?"}
#: a multiplier that changes the objective by less than this part of it is rounding
_ROUNDING = 1e-6


@dataclass(frozen=True)
class RequirementRow:
    """One requirement in words.

    Args:
        verdict: proved, violated or undecided; met without a proof; open without gains.
        sign: the verdict as a symbol.
        what: the requirement as a formula.
        scope: for which plants and frequencies.
        achieved: the worst value.
        score: the requirement is met if at most 1.
        worst: plant and frequency of the worst value.
        proved: the proved bounds of the value, or why there are none.
        cost: the multiplier: by how much the objective improves for each unit the limit is relaxed; empty if not known.
        checked: the multiplier by solving again; empty where not asked for.
    """

    verdict: str
    sign: str
    what: str
    scope: str
    achieved: str
    score: str
    worst: str
    proved: str
    cost: str
    checked: str


def requirement_rows(
    requirements: Sequence[ReportedRequirement], objective: float | None = None
) -> tuple[RequirementRow, ...]:
    """A row for each requirement; a multiplier that is zero up to rounding is shown as 0."""
    return tuple(_row(found, objective) for found in requirements)


def place_phrase(place: Mapping[str, Any] | None) -> str:
    """A worst plant and frequency: "at 0.02 rad/s with time_constant_s = 3.1", of a list "for truck with ..."."""
    if place is None:
        return ""
    omega, limit = place.get("omega_rad_s"), place.get("limit")
    where = f"as {limit}" if limit else f"at {with_unit(omega, 'rad/s')}" if omega is not None else ""
    plant = ", ".join(f"{name}{TIE}={TIE}{number(value)}" for name, value in place["plant"].items())
    member = f"for {place['member']}" if place.get("member") else ""
    return " ".join(part for part in (where, member, f"with {plant}" if plant else "") if part)


def _row(found: ReportedRequirement, objective: float | None) -> RequirementRow:
    said, requirement = found.reported, found.requirement
    proof, outcome = said["proof"], said["outcome"]
    met = None if outcome is None else bool(said["met"]) or outcome == "undecided"
    verdict = verdict_word(met, proof and str(proof["verdict"]))
    has_score = outcome != "infinite" or said["met"]
    return RequirementRow(
        verdict=verdict,
        sign=_SIGNS.get(verdict, "–"),
        what=requirement_phrase(requirement),
        scope=scope_phrase(requirement),
        achieved=_achieved(said, requirement),
        score=score_phrase(requirement, said["score"] if has_score else None, said["achieved"]).replace("-", "–"),
        worst=_worst(found),
        proved="" if proof is None else _proved(proof),
        cost=_cost(said["multiplier"], found, objective),
        checked=_checked(said["multiplier_checked"]),
    )


def _worst(found: ReportedRequirement) -> str:
    place, limit = place_phrase(found.reported["worst"]), found.reported.get("limit_at_worst")
    place += "" if limit is None else f"; the limit there is {number(limit)}"
    if found.reported["outcome"] != "infinite":
        return place
    endless = endless_phrase(found.requirement.quantity)
    return endless if found.reported["met"] else f"{endless} {place}".rstrip()


def _achieved(said: Mapping[str, Any], requirement: Requirement) -> str:
    if said["achieved"] is not None:
        digits = 5 if said["met"] else missed_digits(said["achieved"], requirement.limits)
        return number(said.get("achieved_at_worst", said["achieved"]), digits)
    names = {
        "no_crossover": "no crossover",
        "unstable": NO_MARGIN,
        "beyond_nyquist": "beyond Nyquist",
        "undecided": "undecided",
    }
    return names.get(said["outcome"], "infinite" if said["outcome"] else "–")


def _proved(proof: Mapping[str, Any]) -> str:
    low, high = proof["proved_from"], proof["proved_to"]
    parts = [] if low is None else [f"at least {number(low, 9)}"]
    parts += [] if high is None else [f"at most {number(high, 9)}"]
    return "; ".join(filter(None, (" and ".join(parts), proof["reason"])))


def _cost(multiplier: float | None, found: ReportedRequirement, objective: float | None) -> str:
    if multiplier is None:
        return ""
    size = max(map(abs, found.requirement.limits)) or 1.0
    return "0" if abs(multiplier) * size <= _ROUNDING * abs(objective or 0.0) else f"{multiplier:.3g}"


def _checked(price: Mapping[str, Any] | None) -> str:
    if price is None:
        return ""
    told = [f"{word} {price[word]:.3g}" for word in ("relaxed", "tightened") if price[word] is not None]
    return ", ".join(told) + ("" if price["agrees"] else ": not what the multiplier says")
