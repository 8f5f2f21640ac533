"""Requirements on measures of scenarios as rows of a table:  the entries of a document -> words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fopi_tune.report.measure_entries import ENTRIES, SIGNS
from fopi_tune.report.requirement_rows import RequirementRow
from fopi_tune.report.text.formatting import TIE, number, with_unit
from fopi_tune.report.text.measures import about_phrase, measure_phrase
from fopi_tune.report.text.percentages import meeting_phrase
from fopi_tune.spec.model import DesignSpec, Limit, Relation


def measure_rows(spec: DesignSpec, document: Mapping[str, Any] | None) -> tuple[RequirementRow, ...]:
    """A row for each requirement on a scenario; none without a document.

    Args:
        spec: the spec.
        document: JSON of a design, a check or a digital controller.
    """
    if document is None:
        return ()
    # a document has no such entry where the spec has no such requirement
    entries = document.get(ENTRIES, ())
    return tuple(_row(limit, said) for limit, said in zip(spec.scenario_requirements, entries, strict=True))


def _row(limit: Limit, said: Mapping[str, Any]) -> RequirementRow:
    worst, drawn, value = said["worst"], said["drawn"], said["achieved"]
    place = ""
    if worst is not None:
        plant = ", ".join(f"{name}{TIE}={TIE}{number(each)}" for name, each in worst["plant"].items())
        when = "" if worst["time_s"] is None else f"at {with_unit(worst['time_s'], 's')}"
        where = f"in {worst['scenario']}" if limit.scenario is None else ""
        place = " ".join(part for part in (where, when, f"with {plant}" if plant else "") if part)
    counted = ""
    if drawn is not None:
        counted = meeting_phrase(drawn["met"], drawn["total"], "plants", drawn["low"], drawn["high"])
    shown = said["proved_bound"]
    if shown is not None:
        word = "at most" if limit.relation is Relation.AT_MOST else "at least"
        counted = f"{word} {number(shown, 9)}{f'; {counted}' if counted else ''}"
    return RequirementRow(
        verdict=said["verdict"],
        sign=SIGNS[said["verdict"]],
        what=measure_phrase(limit),
        scope=about_phrase(limit),
        achieved="never" if value is None and worst is not None else "–" if value is None else number(value),
        score="–" if said["score"] is None else f"{said['score']:.3f}",
        worst=place,
        proved=counted,
        cost="" if said["multiplier"] is None else f"{said['multiplier']:.3g}",
        checked="",
    )
