"""Evidence from sampled plants as text."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.report.text.formatting import (
    BAD,
    FIRST_COLUMN,
    QUIET,
    Line,
    drawn_phrase,
    entry,
    gains_lines,
    members_phrase,
    number,
    requirement_phrase,
    style_of,
    to_text,
    wrapped,
)
from fopi_tune.report.text.percentages import interval_phrase, share_phrase
from fopi_tune.spec.model import Relation

if TYPE_CHECKING:
    from fopi_tune.core.distributions.distribution import Words
    from fopi_tune.montecarlo.joint import JointYield
    from fopi_tune.montecarlo.montecarlo import Evidence
    from fopi_tune.montecarlo.outcomes import OutcomeStatistics
    from fopi_tune.montecarlo.statistics import Fraction
    from fopi_tune.montecarlo.systems import SystemEvidence
    from fopi_tune.results.design import Validated
    from fopi_tune.results.system import ValidatedSystem
    from fopi_tune.spec.model import ValidationSpec

_HEADLINES = {
    "met": "Every plant that was drawn is stable and meets everything.",
    "violated": "Not every plant that was drawn meets everything.",
    "outside": "Not every plant that was drawn meets everything; those of the family do.",
    "contradiction": "A plant contradicts the proof: this is a defect of the tool, please report it.",
}
_REPLAY = "`fopi simulate {} --replay INDEX` makes a {} again by its index (with the same --seed and --samples)."
_WHAT, _SHARE, _INTERVAL = 36, 12, 22


def evidence_text(result: Validated) -> Text:
    """How often each requirement and limit was met, with intervals, and the worst plants."""
    evidence, status = result.evidence, result.status
    family_is_fine = evidence.stable.total > evidence.outside and not evidence.missed_inside
    said = _HEADLINES["outside" if status == "violated" and family_is_fine else status]
    lines: list[Line] = [*wrapped(f"{result.spec.name}, validated: {status}. {said}", style_of(status == "met"))]
    lines += [("", ""), *gains_lines(result.digital.controller.gains)]
    lines += _sampling_lines(evidence, "plants")
    if evidence.members:
        lines += entry("plants", members_phrase(evidence.members))
    lines += _header(evidence.validation)
    for joint in (evidence.joint, *evidence.scenarios):
        lines += _joint_rows(evidence, joint)
    lines += _row("stable loop", evidence.stable)
    lines += wrapped(
        _missed_phrase(evidence, evidence.stable, evidence.unstable_inside), QUIET, indent=" " * (FIRST_COLUMN + 2)
    )
    for judged in (*evidence.requirements, *evidence.limits):
        lines += _row(_phrase(judged), judged.fraction)
        misses = _missed_phrase(evidence, judged.fraction, judged.missed_inside)
        lines += wrapped("; ".join(filter(None, (_details(judged), misses))), QUIET, indent=" " * (FIRST_COLUMN + 2))
    for problem in result.contradictions:
        lines += wrapped(problem, BAD)
    lines += [("", "")]
    lines += wrapped(
        "Requirements are about the loop on samples; those about the nominal plant alone are not sampled.", QUIET
    )
    lines += wrapped(_REPLAY.format("SPEC", "plant"), QUIET)
    return to_text(lines)


def system_evidence_text(result: ValidatedSystem) -> Text:
    """How often a system met its limits, with intervals, and the worst plants."""
    evidence, met = result.evidence, result.status == "met"
    said = (
        _HEADLINES["met" if met else "violated"].replace("plant", "pair of plants").replace("is stable", "stays finite")
    )
    lines: list[Line] = [*wrapped(f"{result.spec.name}, validated: {result.status}. {said}", style_of(met)), ("", "")]
    lines += gains_lines(result.gains)
    lines += _sampling_lines(evidence, "pairs of plants")
    lines += _header(evidence.validation)
    lines += _joint_rows(evidence, evidence.joint)
    for each in evidence.scenarios:
        lines.append((each.scenario, "bold"))
        lines += _joint_rows(evidence, each.joint)
        lines += _row("output stays finite", each.finite)
        lines += _row("modes do not chatter", each.calm)
        for judged in each.limits:
            lines += _row(_phrase(judged), judged.fraction)
            misses = _missed_phrase(evidence, judged.fraction, judged.missed_inside)
            below = "; ".join(filter(None, (_details(replace(judged, scenario=None)), misses)))
            lines += wrapped(below, QUIET, indent=" " * (FIRST_COLUMN + 2))
    for note in result.notes:
        lines += [("", ""), *entry("note", note)]
    lines += [("", ""), *wrapped(_REPLAY.format("SYSTEM", "pair"), QUIET)]
    return to_text(lines)


def _sampling_lines(evidence: Evidence | SystemEvidence, what: str) -> Iterator[Line]:
    """How many plants were drawn, how, and how many of them lie outside the family, where nothing is proved."""
    drawn, listed = evidence.validation, evidence.validation.samples_file
    how = f"{drawn.design}, seed {drawn.seed}" if listed is None else f"rows of {listed.name}, seed {drawn.seed}"
    words = f"{drawn.samples - evidence.no_plants} {what}, {how}"
    if listed is None and drawn.design != "random":
        words += " (the intervals are those of independent draws)"
    if evidence.outside:
        words += f", {evidence.outside} of them outside the family, where nothing is proved"
    if evidence.no_plants:
        are = agreeing(evidence.no_plants, "is no plant and is", "are no plants and are")
        words += f"; {counted(evidence.no_plants, 'more draw')} {are} left out"
    yield from entry("drawn", words)
    for name, distribution in drawn.distributions.items():
        yield from entry("", f"{name}: {_distribution_phrase(distribution.words())}")
    for each in drawn.correlations:
        yield from entry("", f"{each.numbers[0]} and {each.numbers[1]}: correlation {number(each.coefficient)}")
    yield "", ""


def _distribution_phrase(words: Words) -> str:
    """A distribution in one line: "truncated_normal, mean 2.25, std 0.4"."""
    if isinstance(words, str):
        return words
    ((word, numbers),) = words.items()
    parts = [f"{name} {number(v) if isinstance(v, float) else v}" for name, v in numbers.items()]
    return ", ".join([word, *parts])


def _missed_phrase(evidence: Evidence | SystemEvidence, found: Fraction, inside: int) -> str:
    """How many plants miss, and how many of these lie in the family; empty if none was drawn outside it."""
    missed = found.total - found.met
    if not evidence.outside or not missed:
        return ""
    return f"{missed} miss, {f'{inside} of them' if inside else 'none'} in the family"


def _joint_rows(evidence: Evidence | SystemEvidence, joint: JointYield) -> Iterator[Line]:
    """How many plants met everything at once, and the first of those that did not."""
    yield from _row("all at once" + ("" if joint.scenario is None else f", {joint.scenario}"), joint.fraction)
    first = ", ".join(str(index) for index in joint.first_missed)
    missed = _missed_phrase(evidence, joint.fraction, joint.missed_inside)
    words = "; ".join(filter(None, (f"the first to miss: {first}" if first else "", missed)))
    yield from wrapped(words, QUIET, indent=" " * (FIRST_COLUMN + 2))


def _header(drawn: ValidationSpec) -> list[Line]:
    share = f"{100 * drawn.confidence:g} % interval"
    return [(f"{'':{FIRST_COLUMN}}{'requirement or limit':<{_WHAT}}{'met':>{_SHARE}}{share:>{_INTERVAL}}", "bold")]


def _row(what: str, found: Fraction) -> Iterator[Line]:
    met = found.met == found.total
    share, interval = share_phrase(found.met, found.total), interval_phrase(found.low, found.high)
    numbers = f"{share:>{_SHARE}}{interval:>{_INTERVAL}}"
    verdict = "met" if met else "violated"
    style = "" if met else "red"
    if len(what) > _WHAT:
        yield f"{verdict:<{FIRST_COLUMN}}{what}", style
        yield f"{'':{FIRST_COLUMN + _WHAT}}{numbers}", style
    else:
        yield f"{verdict:<{FIRST_COLUMN}}{what:<{_WHAT}}{numbers}", style


def _phrase(judged: OutcomeStatistics) -> str:
    sign = "<=" if judged.upper else ">="
    if judged.requirement is not None:
        asked = judged.requirement
        if asked.relation is Relation.BETWEEN:  # each side is tested by itself
            return f"{asked.quantity} {sign} {number(asked.upper if judged.upper else asked.lower)}"
        return requirement_phrase(asked)
    assert judged.limit is not None
    return f"{judged.limit.measure} {sign} {number(judged.limit.limit)}"


def _details(judged: OutcomeStatistics) -> str:
    """Scenario, median, and the worst plant."""
    parts = [] if judged.scenario is None else [judged.scenario]
    middle = next((q for q in judged.quantiles if q.probability == 0.5), None)
    if middle is not None:
        parts.append(f"median {_value(middle.value, judged)}")
    if judged.worst:
        worst = judged.worst[0]
        named = ", ".join(f"{name} = {number(value)}" for name, value in worst.plant.items())
        named = ": ".join(part for part in (worst.member, named) if part)
        parts.append(f"worst {_value(worst.value, judged)} (plant {worst.index}" + (f": {named})" if named else ")"))
    return "; ".join(parts)


def _value(value: float, judged: OutcomeStatistics) -> str:
    if math.isfinite(value):
        return number(value)
    asked = judged.requirement.quantity if judged.requirement is not None else ""
    return drawn_phrase(asked, judged.upper, met=value > 0.0)
