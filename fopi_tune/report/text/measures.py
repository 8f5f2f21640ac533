"""Requirements on measures of scenarios as lines of the table of requirements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from fopi_tune.report.text.formatting import (
    FIRST_COLUMN,
    QUIET,
    TIE,
    Line,
    number,
    requirement_phrase,
    scope_phrase,
    with_unit,
    wrapped,
)
from fopi_tune.report.text.percentages import meeting_phrase
from fopi_tune.spec.model import Limit, Relation, Requirement

if TYPE_CHECKING:
    from fopi_tune.proof.verification.results import MeasureResult
    from fopi_tune.results.measures import MeasureReport

_SIGNS = {Relation.AT_MOST: "<=", Relation.AT_LEAST: ">="}


def measure_phrase(limit: Limit) -> str:
    """A limit as a formula: "overshoot <= 0.1"."""
    return f"{limit.measure} {_SIGNS[limit.relation]} {limit.limit:.10g}"


def about_phrase(limit: Limit) -> str:
    """In which scenarios, for which plants."""
    return "family, every scenario" if limit.scenario is None else f"family, scenario {limit.scenario}"


def limit_phrase(requirement: Requirement | Limit) -> str:
    """Any requirement as a formula."""
    return measure_phrase(requirement) if isinstance(requirement, Limit) else requirement_phrase(requirement)


def limit_scope_phrase(requirement: Requirement | Limit) -> str:
    """For which plants, and frequencies or scenarios, it holds."""
    return about_phrase(requirement) if isinstance(requirement, Limit) else scope_phrase(requirement)


def measure_lines(
    reports: Sequence[MeasureReport], widths: tuple[int, int, int, int], objective: float | None, priced: bool
) -> Iterator[Line]:
    """The lines of a table, as those of other requirements.

    Args:
        reports: the requirements.
        widths: of the columns requirement, achieved, score and multiplier.
        objective: of the design.
        priced: whether the table has multipliers.
    """
    what, achieved, score, multiplier = widths
    for report in reports:
        result = report.result
        value = "-" if result is None else _achieved(result)
        rank = "-" if result is None or result.score > 1e9 else f"{result.score:.3f}"
        numbers = f"{value:>{achieved}}{rank:>{score}}"
        if priced:
            numbers += f"{_multiplier(report, objective):>{multiplier}}"
        style = "red" if report.verdict == "violated" else ""
        said = measure_phrase(report.requirement)
        if len(said) > what:
            yield f"{report.verdict:<{FIRST_COLUMN}}{said}", style
            yield f"{'':{FIRST_COLUMN + what}}{numbers}", style
        else:
            yield f"{report.verdict:<{FIRST_COLUMN}}{said:<{what}}{numbers}", style
        yield from wrapped("; ".join(_details(report)), QUIET, indent=" " * (FIRST_COLUMN + 2))


def _achieved(result: MeasureResult) -> str:
    if math.isinf(result.achieved):
        return "never"
    # never print a missed limit as if it were reached
    digits, limit = 5, result.requirement.limit
    while not result.is_met and digits < 9 and float(f"{result.achieved:.{digits}g}") == limit:
        digits += 1
    return number(result.achieved, digits)


def _details(report: MeasureReport) -> Iterator[str]:
    yield about_phrase(report.requirement)
    result, drawn = report.result, report.drawn
    if result is None:
        return
    when = "" if result.time_s is None else f" at {with_unit(result.time_s, 's')}"
    where = f" in {result.scenario}" if report.requirement.scenario is None else ""
    named = ", ".join(f"{name}{TIE}={TIE}{number(value)}" for name, value in result.worst.plant.items())
    yield f"worst{where}{when}{f' with {named}' if named else ''}" if when or where or named else "one plant"
    if report.bound is not None:
        edge = "at most" if report.requirement.relation is Relation.AT_MOST else "at least"
        yield f"shown: {edge} {report.bound:.9g}"
    if report.why_checked:
        yield f"not proved: {report.why_checked}"
    if drawn is not None and drawn.total and named:
        yield meeting_phrase(drawn.met, drawn.total, "plants", drawn.low, drawn.high)


def _multiplier(report: MeasureReport, objective: float | None) -> str:
    value = report.multiplier
    if value is None:
        return "-"
    size = abs(report.requirement.limit) or 1.0
    return "0" if abs(value) * size <= 1e-6 * abs(objective or 0.0) else f"{value:.3g}"
