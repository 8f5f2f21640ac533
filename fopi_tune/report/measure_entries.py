"""The entries of a document about requirements on measures of scenarios, and their check."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fopi_tune.errors import CertificateError
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.spec.model import DesignSpec, Limit, Relation

#: the entry of a result's JSON
ENTRIES = "scenario_requirements"
#: verdict -> a symbol that is readable without colour
SIGNS = {"proved": "✓", "checked": "✓", "violated": "✗", "open": "–"}


def measures_met(document: Mapping[str, Any]) -> list[bool]:
    """Whether each is met."""
    return [bool(each["met"]) for each in document.get(ENTRIES, ())]


def _refuse_contradictions(entry: JsonObject, limit: Limit) -> None:
    """Verdict, score and value say the same."""
    achieved, score = entry.number_or_none("achieved"), entry.number_or_none("score")
    expected = {"checked", "proved"} if entry.flag("met") else {"open" if entry.get("worst") is None else "violated"}
    if entry.text("verdict") not in expected:
        raise CertificateError(f"{entry.at('verdict')} is none of an entry with this {entry.at('met')}")
    if achieved is None or score is None:
        if entry.flag("met"):
            raise CertificateError(f"{entry.at('met')} is true without a value")
        return
    over = achieved > limit.limit if limit.relation is Relation.AT_MOST else achieved < limit.limit
    if over is not (score > 1.0) or (not entry.flag("met") and not over):
        raise CertificateError(f"{entry.at('achieved')} is none with this {entry.at('score')}")


def check_measures(top: JsonObject, spec: DesignSpec) -> None:
    """Refuse entries that are not those of the spec.

    Raises:
        CertificateError: an entry is missing, of another requirement, or not as this tool writes it.
    """
    if not spec.scenario_requirements:
        return
    entries = top.children(ENTRIES)
    if len(entries) != len(spec.scenario_requirements):
        raise CertificateError(f"{top.at(ENTRIES)} is not those of the spec")
    names = [scenario.name for scenario in spec.scenarios]
    for entry, limit in zip(entries, spec.scenario_requirements, strict=True):
        same = entry.text("name") == limit.measure and entry.word("relation", Relation) is limit.relation
        if not same or entry.number("limit") != limit.limit or entry.get("scenario") != limit.scenario:
            raise CertificateError(f"{entry.at('name')} is another requirement than the spec's")
        if entry.text("verdict") not in SIGNS:
            raise CertificateError(f"{entry.at('verdict')} is none of {', '.join(SIGNS)}")
        entry.flag("met")
        for key in ("achieved", "score", "multiplier", "proved_bound"):
            entry.number_or_none(key)
        _refuse_contradictions(entry, limit)
        if entry.get("worst") is not None:
            worst = entry.child("worst")
            worst.number_or_none("time_s")
            plant = worst.child("plant")
            if worst.text("scenario") not in names or set(plant.value) != set(spec.plant.uncertain_names):
                raise CertificateError(f"{entry.at('worst')} is no scenario or plant of the spec")
            for name in plant.value:
                plant.number(name)
        if entry.get("drawn") is not None:
            drawn = entry.child("drawn")
            met, total = (drawn.count_or_none(key) for key in ("met", "total"))
            low, high = drawn.number("low"), drawn.number("high")
            if met is None or total is None or not 0 <= met <= total or not 0.0 <= low <= high <= 1.0:
                raise CertificateError(f"{entry.at('drawn')} is no count of plants")
