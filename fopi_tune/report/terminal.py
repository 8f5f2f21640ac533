"""Results as text for a terminal:  Design or Check -> rich.text.Text of at most 80 columns.

The layout is fixed and of ASCII characters, so that it reads the same in a terminal, a pipe, a log and a README.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.proof.results import Outcome, Place, RequirementResult, Stability
from fopi_tune.result import Check, Design, RequirementReport, objective_name
from fopi_tune.spec.model import Relation, Requirement, Scope

if TYPE_CHECKING:
    from fopi_tune.core.controller import FoPi
    from fopi_tune.core.margins import Margins
    from fopi_tune.outcome import Give

WIDTH = 80
#: widths of the columns verdict, requirement, achieved, score, multiplier; 80 in sum
_VERDICT, _WHAT, _ACHIEVED, _SCORE, _MULTIPLIER = 10, 38, 12, 9, 11
_GOOD, _BAD, _QUIET = "bold green", "bold red", "dim"
#: a space at which no line is broken
_TIE = "\N{NO-BREAK SPACE}"
_SIGNS = {Relation.EQUALS: "=", Relation.AT_LEAST: ">=", Relation.AT_MOST: "<="}
#: a multiplier that changes the objective by less than this part of it is rounding
_ROUNDING = 1e-6

#: what to call gains that are no solution
_GAINS_TITLES = {
    "infeasible": "These gains come nearest; they are no solution:",
    "unbounded": "The search stopped at these gains; they are no solution:",
    "failed": "The best gains found; they are no solution:",
}

#: a line and its style
Line = tuple[str, str]


def design_text(design: Design) -> Text:
    """A design's status, gains, requirements, objective, stability and margins."""
    status = design.status.value
    solved = status == "solved"
    lines: list[Line] = [*_styled(f"{design.spec.name}: {status}. {design.status.advice}", _style(solved))]
    lines += _styled(f"Why: {_sentence(design.message)}" if design.message else "")
    lines += _clash(design.clash, design.spec.requirements)
    if design.gains is not None:
        lines += [("", ""), *_styled(_GAINS_TITLES.get(status, "")), (_gains(design.gains), "bold")]
    if design.gains is not None or not design.clash:
        lines += _requirements(design.requirements, design.objective)
    lines += _summary(objective_name(design.spec), design.objective, design.stability, design.nominal)
    return _text(lines)


def check_text(check: Check) -> Text:
    """What the verification of given gains found, laid out as a design."""
    found = check.verification
    if found.all_met:
        said = "The gains meet every requirement for the whole family."
    elif found.stability.stable:
        said = "The gains do not meet the requirements that are marked."
    else:
        said = "The loop is not stable for every plant of the family."
    lines = [*_styled(f"{check.spec.name}: {check.status}. {said}", _style(found.all_met)), ("", "")]
    lines.append((_gains(found.gains), "bold"))
    lines += _requirements([RequirementReport(r.requirement, r, None) for r in found.requirements], found.objective)
    lines += _summary(objective_name(check.spec), found.objective, found.stability, found.nominal)
    return _text(lines)


def requirement_phrase(requirement: Requirement) -> str:
    """A requirement as a formula: "phase_margin_deg >= 80"; its scope and band are left out."""
    limits = [f"{limit:.10g}" for limit in requirement.limits]
    if requirement.relation is Relation.BETWEEN:
        return f"{requirement.quantity} in [{', '.join(limits)}]"
    return f"{requirement.quantity} {_SIGNS[requirement.relation]} {limits[0]}"


def scope_phrase(requirement: Requirement) -> str:
    """For which plants and frequencies a requirement holds: "family, up to 0.02 rad/s"."""
    low, high = requirement.from_rad_s, requirement.to_rad_s
    plants = "nominal plant" if requirement.scope is Scope.NOMINAL else "family"
    if low == high:
        return f"{plants}, at {_with_unit(low, 'rad/s')}"
    if low > 0.0 and math.isfinite(high):
        return f"{plants}, from {_number(low)} to {_with_unit(high, 'rad/s')}"
    if low > 0.0:
        return f"{plants}, from {_with_unit(low, 'rad/s')} on"
    return f"{plants}, up to {_with_unit(high, 'rad/s')}" if math.isfinite(high) else plants


def _text(lines: Sequence[Line]) -> Text:
    text = Text()
    for line, style in lines:
        text.append(line.replace(_TIE, " ").rstrip() + "\n", style)
    text.rstrip()
    return text


def _style(good: bool) -> str:
    return _GOOD if good else _BAD


def _styled(sentence: str, style: str = "", indent: str = "", first: str = "") -> list[Line]:
    """A sentence broken into lines; none when it is empty."""
    wrapped = textwrap.wrap(
        sentence,
        WIDTH,
        initial_indent=first or indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [(line, style) for line in wrapped]


def _sentence(words: str) -> str:
    return words if words.endswith(".") else words + "."


def _gains(gains: FoPi) -> str:
    values = "   ".join(f"{name} = {_number(getattr(gains, name))}" for name in ("kp", "ki", "alpha"))
    return f"{values:<56}C(s) = kp + ki / s^alpha"


def _requirements(reports: Sequence[RequirementReport], objective: float | None) -> Iterator[Line]:
    """The table: two lines a requirement, numbers in columns and below them where they are worst."""
    yield "", ""
    if not reports:
        yield "No requirements but stability.", ""
        return
    priced = any(report.multiplier is not None for report in reports)
    header = f"{'':{_VERDICT}}{'requirement':<{_WHAT}}{'achieved':>{_ACHIEVED}}{'score':>{_SCORE}}"
    yield header + (f"{'multiplier':>{_MULTIPLIER}}" if priced else ""), "bold"
    for report in reports:
        yield from _requirement(report, objective, priced)
    yield "", ""
    yield "A score of at most 1 is met.", _QUIET
    if priced:
        yield "The multiplier is what the objective gains for each unit the limit gives.", _QUIET


def _requirement(report: RequirementReport, objective: float | None, priced: bool) -> Iterator[Line]:
    requirement, result = report.requirement, report.result
    met = result is not None and result.is_met
    verdict = "open" if result is None else "met" if met else "violated"
    numbers = f"{_achieved(requirement, result):>{_ACHIEVED}}{_score(result):>{_SCORE}}"
    if priced:
        numbers += f"{_multiplier(report, objective):>{_MULTIPLIER}}"
    what, style = requirement_phrase(requirement), "" if met or result is None else "red"
    if len(what) > _WHAT:
        yield f"{verdict:<{_VERDICT}}{what}", style
        yield f"{'':{_VERDICT + _WHAT}}{numbers}", style
    else:
        yield f"{verdict:<{_VERDICT}}{what:<{_WHAT}}{numbers}", style
    where = f"{scope_phrase(requirement)}; {_worst(requirement, result)}" if result else scope_phrase(requirement)
    yield from _styled(where, _QUIET, indent=" " * (_VERDICT + 2))


def _achieved(requirement: Requirement, result: RequirementResult | None) -> str:
    if result is None:
        return "-"
    if result.achieved is None:
        return "no crossover"
    if math.isinf(result.achieved):
        return "infinite" if result.achieved > 0 else "-infinite"
    # Never print a missed limit as if it were reached.
    digits = 5
    while not result.is_met and digits < 9 and float(f"{result.achieved:.{digits}g}") in requirement.limits:
        digits += 1
    return _number(result.achieved, digits)


def _score(result: RequirementResult | None) -> str:
    if result is None or result.score is None:
        return "-"
    score = result.score
    if 0.9995 <= score < 1.0005:
        return f"{score:.6f}" if score > 1.0 else "1.000"
    return f"{abs(score):.3f}" if score < 1000.0 else f"{score:.3g}"


def _multiplier(report: RequirementReport, objective: float | None) -> str:
    value = report.multiplier
    if value is None:
        return "-"
    size = max(map(abs, report.requirement.limits)) or 1.0
    return "0" if abs(value) * size <= _ROUNDING * abs(objective or 0.0) else f"{value:.3g}"


def _worst(requirement: Requirement, result: RequirementResult) -> str:
    if result.outcome is Outcome.INFINITE:
        return "no phase crossover sets it"
    if result.outcome is Outcome.NO_CROSSOVER:
        return f"|L| never crosses 1{_plant(result.worst.plant)}"
    if requirement.scope is Scope.NOMINAL:
        return f"worst {_frequency(result.worst.omega_rad_s)}"
    return f"worst {_place(result.worst)}"


def _place(place: Place) -> str:
    return _frequency(place.omega_rad_s) + _plant(place.plant)


def _frequency(omega_rad_s: float | None) -> str:
    if omega_rad_s is None or math.isnan(omega_rad_s):
        return "at no single frequency"
    if omega_rad_s == 0.0 or math.isinf(omega_rad_s):
        return f"as omega tends to {'0' if omega_rad_s == 0.0 else 'infinity'}"
    return f"at {_with_unit(omega_rad_s, 'rad/s')}"


def _plant(plant: Mapping[str, float]) -> str:
    named = ", ".join(f"{name}{_TIE}={_TIE}{_number(value)}" for name, value in plant.items())
    return f" with {named}" if named else ""


def _clash(clash: Sequence[Give], requirements: Sequence[Requirement]) -> Iterator[Line]:
    """What each of the clashing requirements would have to give, in words."""
    if not clash:
        return
    yield "", ""
    known = any(give.new_limit is not None for give in clash)
    yield "These clash; one of them would have to give:" if known else "These clash:", "bold"
    for give in clash:
        requirement = requirements[give.requirement]
        yield from _styled(f"{requirement_phrase(requirement)} ({scope_phrase(requirement)})", "", "    ", "  ")
        if give.amount is not None and give.new_limit is not None:
            yield f"      by {_number(give.amount)}, to {_number(give.new_limit)}", ""
        elif known:
            yield "      no change of this limit alone was found to help", ""


def _summary(
    objective_name: str, objective: float | None, stability: Stability | None, nominal: Margins | None
) -> Iterator[Line]:
    if stability is None:
        return
    yield "", ""
    value = "undefined: a plant has no gain crossover" if objective is None else _number(objective)
    yield from _entry("objective", f"{objective_name}: {value}")
    if stability.stable:
        yield from _entry("stability", f"stable: {stability.reason}; closest to -1 {_place(stability.worst)}")
    else:
        yield from _entry("stability", f"NOT STABLE: {stability.reason}{_plant(stability.worst.plant)}", _BAD)
    if nominal is not None:
        yield from _entry("nominal", _margins(nominal))


def _entry(label: str, words: str, style: str = "") -> list[Line]:
    return _styled(words, style, indent=" " * _VERDICT, first=f"{label:<{_VERDICT}}")


def _margins(found: Margins) -> str:
    parts = []
    if found.crossover_rad_s is None or found.phase_margin_deg is None or found.delay_margin_s is None:
        parts.append("no gain crossover")
    else:
        all_of_them = ", ".join(_number(omega) for omega in found.gain_crossovers_rad_s)
        plural = "s" if len(found.gain_crossovers_rad_s) > 1 else ""
        parts += [
            f"crossover{plural} {all_of_them}{_TIE}rad/s",
            f"phase margin {_with_unit(found.phase_margin_deg, 'deg')}",
        ]
    infinite = math.isinf(found.gain_margin_db)
    parts.append("gain margin infinite" if infinite else f"gain margin {_with_unit(found.gain_margin_db, 'dB')}")
    if math.isfinite(found.gain_reduction_margin_db):
        parts.append(f"gain reduction margin {_with_unit(found.gain_reduction_margin_db, 'dB')}")
    if found.delay_margin_s is not None:
        parts.append(f"delay margin {_with_unit(found.delay_margin_s, 's')}")
    return ", ".join(parts)


def _number(value: float, digits: int = 5) -> str:
    # "-0" helps nobody
    return f"{value + 0.0:.{digits}g}"


def _with_unit(value: float, unit: str) -> str:
    return f"{_number(value)}{_TIE}{unit}"
