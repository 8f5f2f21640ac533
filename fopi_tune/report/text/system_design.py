"""A system's designed gains as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.report.text.design import clash_lines, requirement_lines
from fopi_tune.report.text.formatting import (
    FIRST_COLUMN,
    QUIET,
    TIE,
    Line,
    entry,
    gains_lines,
    number,
    sentence,
    style_of,
    to_text,
    wrapped,
)
from fopi_tune.report.text.measures import about_phrase, measure_phrase
from fopi_tune.report.text.percentages import meeting_phrase

if TYPE_CHECKING:
    from fopi_tune.results.system_design import DesignedSystem, DrawnRequirement

_WHAT, _ACHIEVED = 38, 12


def system_design_text(result: DesignedSystem) -> Text:
    """Status, gains, the requirements on scenarios, and those of each tuned mode's own loop."""
    solved = result.status.value == "solved"
    said = "Every pair of plants that was simulated meets all requirements: checked, not proved."
    if not solved:
        said = "Not every pair of plants meets all requirements." if result.gains else "There are no gains."
    lines: list[Line] = [*wrapped(f"{result.spec.name}: {result.status.value}. {said}", style_of(solved))]
    lines += wrapped(f"Why: {sentence(result.message)}" if result.message else "")
    lines += clash_lines(result.clash, result.spec.requirements)
    if result.gains is not None:
        lines += [("", ""), *gains_lines(result.gains), ("", "")]
        if result.requirements:
            lines.append((f"{'':{FIRST_COLUMN}}{'requirement':<{_WHAT}}{'achieved':>{_ACHIEVED}}", "bold"))
        for each in result.requirements:
            lines += _requirement(each)
        value = "unknown" if result.objective is None else number(result.objective)
        lines += [("", ""), *entry("objective", f"{result.objective_name}: {value}")]
    for note in result.notes:
        lines += entry("note", f"{note}.", "yellow")
    for name, reports in result.loop_reports.items():
        lines += [("", ""), (f"The {name}'s own loop on samples, checked:", "bold")]
        lines += requirement_lines(reports, None)
    return to_text(lines)


def _requirement(each: DrawnRequirement) -> Iterator[Line]:
    verdict = "checked" if each.is_met else "violated"
    style = "" if each.is_met else "red"
    yield (
        f"{verdict:<{FIRST_COLUMN}}{measure_phrase(each.requirement):<{_WHAT}}{number(each.achieved):>{_ACHIEVED}}",
        style,
    )
    named = ", ".join(f"{name}{TIE}={TIE}{number(value)}" for name, value in each.plant.items())
    where = f"worst in {each.scenario}{f' with {named}' if named else ''}"
    drawn = each.drawn
    counted = meeting_phrase(drawn.met, drawn.total, "pairs", drawn.low, drawn.high)
    yield from wrapped(f"{about_phrase(each.requirement)}; {where}; {counted}", QUIET, indent=" " * (FIRST_COLUMN + 2))
