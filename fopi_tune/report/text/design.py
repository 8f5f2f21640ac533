"""Results as text for a terminal:  Design or Check -> rich.text.Text of at most 80 columns.

The layout is fixed and of ASCII characters, the same in a terminal, a pipe, a log and a README.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.core.controller import FoPid
from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.proof.verification.results import Outcome, Place, RequirementResult, Stability
from fopi_tune.report.text.certificates import proof_lines
from fopi_tune.report.text.formatting import (
    BAD,
    FIRST_COLUMN,
    NO_MARGIN,
    QUIET,
    TIE,
    Line,
    endless_phrase,
    entry,
    exact_limit,
    gains_lines,
    margins_phrase,
    missed_digits,
    number,
    requirement_phrase,
    scope_phrase,
    score_note,
    score_phrase,
    sentence,
    style_of,
    to_text,
    verdict_word,
    with_unit,
    wrapped,
)
from fopi_tune.report.text.measures import limit_phrase, limit_scope_phrase, measure_lines
from fopi_tune.report.text.tradeoff import price_lines
from fopi_tune.results.design import Check, Design
from fopi_tune.results.documents import loop_name, margins_dict, objective_name
from fopi_tune.results.requirement_reports import RequirementReport
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec, Limit, Requirement, Scope
from fopi_tune.spec.scenarios import every_requirement

if TYPE_CHECKING:
    from fopi_tune.core.margins import Margins
    from fopi_tune.optimum import Optimum
    from fopi_tune.results.measures import MeasureReport
    from fopi_tune.results.status import Relaxation

#: widths of the columns requirement, achieved, score, multiplier; 80 in sum with the verdict
_WHAT, _ACHIEVED, _SCORE, _MULTIPLIER = 38, 12, 9, 11
#: a multiplier that changes the objective by less than this part of it is rounding
_ROUNDING = 1e-6
#: a steady-state error below this is none
_NO_ERROR = 1e-9
#: of measured responses
CHECKED = (
    "All requirements are met at the measured frequencies and between them: checked, as there is no proof of measured "
    "data."
)
_NO_CLAIM = "no margins: stability is undecided"
UNDECIDED = "The measurement leaves something open; see stability."
#: headings of gains that are no solution
_GAINS_TITLES = {
    "infeasible": "These gains come nearest; they are no solution:",
    "unbounded": "The search stopped at these gains; they are no solution:",
    "failed": "The best gains found; they are no solution:",
}


def design_text(design: Design) -> Text:
    """A design's status, gains, requirements, objective, stability and margins."""
    status = design.status.value
    solved = status == "solved"
    lines: list[Line] = [*wrapped(f"{design.spec.name}: {_headline(design)}", style_of(solved))]
    lines += wrapped(f"Why: {sentence(design.message)}" if design.message else "")
    lines += clash_lines(design.clash, every_requirement(design.spec))
    if design.gains is not None:
        lines += [("", ""), *wrapped(_GAINS_TITLES.get(status, "")), *gains_lines(design.gains)]
    if design.gains is not None or not design.clash:
        lines += requirement_lines(design.requirements, design.objective, design.measures)
    lines += summary_lines(objective_name(design.spec), design.objective, design.stability, design.nominal)
    lines += steady_state_lines(design.steady_state_error)
    lines += proof_lines(design.certificate)
    for note in design.notes:
        lines += entry("note", f"{note}.", "yellow")
    lines += optimum_lines(design.optimum, design.gap)
    if design.status is Status.SOLVED and design.spec.controller.has_derivative_order:
        lines += entry("optimum", "not bounded: there is no bound for structure: fopid in this version")
    elif design.status is Status.SOLVED and design.spec.controller.filter_times is not None:
        lines += entry("optimum", "not bounded: there is no bound where a filter's time has a range in this version")
    return to_text(lines)


def _headline(design: Design) -> str:
    status = design.status.value
    if status != "solved":
        return f"{status}. {design.advice}"
    if design.spec.is_measured:
        return f"{status}. {CHECKED}"
    if design.certificate is None:
        return f"{status}, not proved. {design.advice[:-1]}, as far as a check in floating point tells."
    return f"{status}. {proved_sentence(design.spec, design.measures)}"


def proved_sentence(spec: DesignSpec, measures: Sequence[MeasureReport]) -> str:
    """What is proved, and what of it is only checked."""
    on_samples = " of the loop on samples" if loop_name(spec) == "sampled" else ""
    checked = [report for report in measures if report.verdict == "checked"]
    if not checked:
        return f"All requirements{on_samples} are proved for every plant and every frequency."
    some = f"{len(checked)}{f' of {len(measures)}' if len(measures) > len(checked) else ''}"
    every = f"Requirements{on_samples} are proved" if spec.requirements else f"Stability{on_samples} is proved"
    are = agreeing(len(checked), "is", "are")
    return f"{every} for every plant and frequency; {some} on scenarios {are} checked by simulation."


def check_text(check: Check) -> Text:
    """The verification of given gains, laid out as that of a design."""
    found = check.verification
    if check.spec.is_measured and check.status != "violated":
        said = CHECKED if check.status == "met" else UNDECIDED
    elif check.status == "met":
        said = proved_sentence(check.spec, check.measures)
    elif check.status == "undecided":
        said = "The gains pass the check in floating point; not everything could be proved."
    elif found.stability.stable or found.stability.undecided:
        said = "The gains do not meet the requirements that are marked."
    else:
        said = "The loop is not stable for every plant of the family."
    lines = [*wrapped(f"{check.spec.name}: {check.status}. {said}", style_of(check.status == "met")), ("", "")]
    lines += gains_lines(found.gains)
    lines += requirement_lines(check.reports, found.objective, check.measures)
    for note in check.notes:
        lines += wrapped(f"{note}.", "yellow")
    lines += summary_lines(objective_name(check.spec), found.objective, found.stability, found.nominal)
    lines += proof_lines(check.proof)
    return to_text(lines)


def requirement_lines(
    reports: Sequence[RequirementReport], objective: float | None, measures: Sequence[MeasureReport] = ()
) -> Iterator[Line]:
    """The table: two lines for each requirement, numbers in columns and below them the worst plant and frequency."""
    yield "", ""
    if not reports and not measures:
        yield "No requirements but stability.", ""
        return
    priced = any(report.multiplier is not None for report in (*reports, *measures))
    header = f"{'':{FIRST_COLUMN}}{'requirement':<{_WHAT}}{'achieved':>{_ACHIEVED}}{'score':>{_SCORE}}"
    yield header + (f"{'multiplier':>{_MULTIPLIER}}" if priced else ""), "bold"
    for report in reports:
        yield from _requirement(report, objective, priced)
    yield from measure_lines(measures, (_WHAT, _ACHIEVED, _SCORE, _MULTIPLIER), objective, priced)
    yield "", ""
    yield from wrapped(
        score_note(r.requirement for r in reports if r.result is not None and not r.result.is_met), QUIET
    )
    if priced:
        yield "The multiplier is what the objective gains for each unit the limit gives.", QUIET
    yield from price_lines(
        [
            (name, price.relaxed, price.tightened, price.agrees, price.has_kink)
            for name, price in (
                *((r.requirement.quantity, r.price) for r in reports),
                *((r.requirement.measure, r.price) for r in measures),
            )
            if price is not None
        ]
    )


def _requirement(report: RequirementReport, objective: float | None, priced: bool) -> Iterator[Line]:
    requirement, result = report.requirement, report.result
    met = None if result is None else result.is_met or result.outcome is Outcome.UNDECIDED
    verdict = verdict_word(met, report.verdict)
    numbers = f"{_achieved(requirement, result):>{_ACHIEVED}}{_score(requirement, result):>{_SCORE}}"
    if priced:
        numbers += f"{_multiplier(report, objective):>{_MULTIPLIER}}"
    what, style = requirement_phrase(requirement), "red" if verdict == "violated" else ""
    if len(what) > _WHAT:
        yield f"{verdict:<{FIRST_COLUMN}}{what}", style
        yield f"{'':{FIRST_COLUMN + _WHAT}}{numbers}", style
    else:
        yield f"{verdict:<{FIRST_COLUMN}}{what:<{_WHAT}}{numbers}", style
    where = f"{scope_phrase(requirement)}; {_worst(requirement, result)}" if result else scope_phrase(requirement)
    yield from wrapped(where, QUIET, indent=" " * (FIRST_COLUMN + 2))


def _achieved(requirement: Requirement, result: RequirementResult | None) -> str:
    if result is None or result.outcome in (Outcome.BEYOND_NYQUIST, Outcome.UNDECIDED):
        return "-"
    if result.achieved is None:
        return "no margin" if result.outcome is Outcome.UNSTABLE else "no crossover"
    if math.isinf(result.achieved):
        return "infinite" if result.achieved > 0 else "-infinite"
    digits = 5 if result.is_met else missed_digits(result.achieved, requirement.limits)
    return number(requirement.value_at(result.achieved, result.worst.omega_rad_s), digits)


def _score(requirement: Requirement, result: RequirementResult | None) -> str:
    if result is None or (result.outcome is Outcome.INFINITE and not result.is_met):
        return "-"
    return score_phrase(requirement, result.score, result.achieved)


def _multiplier(report: RequirementReport, objective: float | None) -> str:
    value = report.multiplier
    if value is None:
        return "-"
    size = max(map(abs, report.requirement.limits)) or 1.0
    doubtful = "*" if report.price is not None and not report.price.agrees else ""
    return "0" if abs(value) * size <= _ROUNDING * abs(objective or 0.0) else f"{value:.3g}{doubtful}"


def _worst(requirement: Requirement, result: RequirementResult) -> str:
    if result.outcome is Outcome.INFINITE:
        return endless_phrase(requirement.quantity) + ("" if result.is_met else _plant(result.worst))
    if result.outcome is Outcome.UNSTABLE:
        return f"{NO_MARGIN}{_plant(result.worst)}"
    if result.outcome is Outcome.BEYOND_NYQUIST:
        return "its band lies above Nyquist's frequency: sample faster"
    if result.outcome is Outcome.UNDECIDED:
        return f"a margin belongs to a stable loop, and stability is undecided{_plant(result.worst)}"
    if result.outcome is Outcome.NO_CROSSOVER:
        return f"|L| never crosses 1{_plant(result.worst)}"
    omega = result.worst.omega_rad_s
    limit = (
        ""
        if requirement.end_limit is None or omega is None
        else f"; the limit there is {number(requirement.limit_at(omega))}"
    )
    if requirement.scope is Scope.NOMINAL:
        return f"worst {_frequency(result.worst.omega_rad_s)}{limit}"
    return f"worst {_place(result.worst)}{limit}"


def _place(place: Place) -> str:
    return _frequency(place.omega_rad_s) + _plant(place)


def _frequency(omega_rad_s: float | None) -> str:
    if omega_rad_s is None or math.isnan(omega_rad_s):
        return "at no single frequency"
    if omega_rad_s == 0.0 or math.isinf(omega_rad_s):
        return f"as omega tends to {'0' if omega_rad_s == 0.0 else 'infinity'}"
    return f"at {with_unit(omega_rad_s, 'rad/s')}"


def _plant(place: Place) -> str:
    named = ", ".join(f"{name}{TIE}={TIE}{number(value)}" for name, value in place.plant.items())
    return (f" for {place.member}" if place.member else "") + (f" with {named}" if named else "")


def clash_lines(clash: Sequence[Relaxation], requirements: Sequence[Requirement | Limit]) -> Iterator[Line]:
    """The clashing requirements, and by how much the limit of each can be relaxed."""
    if not clash:
        return
    yield "", ""
    known = any(relaxation.new_limit is not None for relaxation in clash)
    yield "These clash; one of them would have to give:" if known else "These clash:", "bold"
    for relaxation in clash:
        requirement = requirements[relaxation.requirement]
        yield from wrapped(f"{limit_phrase(requirement)} ({limit_scope_phrase(requirement)})", "", "    ", "  ")
        if relaxation.amount is not None and relaxation.new_limit is not None:
            yield f"      by {number(relaxation.amount)}, to {exact_limit(relaxation.new_limit)}", ""
        elif known:
            yield "      no change of this limit alone was found to help", ""


def summary_lines(
    objective_name: str, objective: float | None, stability: Stability | None, nominal: Margins | None
) -> Iterator[Line]:
    """Objective, stability and nominal margins, a paragraph each."""
    if stability is None:
        return
    yield "", ""
    why = "a plant has no gain crossover" if stability.stable else "the loop is not stable for every plant"
    why = "stability is undecided" if stability.undecided else why
    value = f"undefined: {why}" if objective is None else "infinite" if math.isinf(objective) else number(objective)
    yield from entry("objective", f"{objective_name}: {value}")
    if stability.undecided:
        yield from entry("stability", f"undecided{_plant(stability.worst)}: {stability.reason}", "yellow")
    elif stability.stable:
        yield from entry("stability", f"stable: {stability.reason}; closest to -1 {_place(stability.worst)}")
    else:
        yield from entry("stability", f"NOT STABLE: {stability.reason}{_plant(stability.worst)}", BAD)
    plain = margins_dict(nominal)
    if plain is not None:
        words = margins_phrase(plain)
        yield from entry("nominal", words.replace(NO_MARGIN, _NO_CLAIM) if stability.undecided else words)


def steady_state_lines(error: float | None) -> Iterator[Line]:
    """The steady-state error of a constant reference; nothing where there is none."""
    if error is not None and error > _NO_ERROR:
        yield from entry("steady", f"a constant reference leaves an error of up to {100.0 * error:.3g} %", "yellow")


def optimum_lines(optimum: Optimum | None, gap: float | None = None) -> Iterator[Line]:
    """The bound on the global optimum that is proved, else the gap that was checked; nothing without either."""
    if optimum is None:
        if gap is not None:
            yield from entry("optimum", f"nothing better by more than {100.0 * gap:.3g} % is possible (checked)")
        return
    from fopi_tune.optimum import OptimumStatus  # its search is loaded by no design without it

    good = optimum.status in (OptimumStatus.CERTIFIED, OptimumStatus.INFEASIBLE)
    yield from entry("optimum", _optimum_words(optimum), "" if good else "yellow")


def _optimum_words(optimum: Optimum) -> str:
    from fopi_tune.optimum import OptimumStatus

    effort = f"{counted(optimum.boxes, 'box', 'boxes')} of gains, {optimum.seconds:.1f} s"
    status = optimum.status
    if status is OptimumStatus.INFEASIBLE:
        return f"proved infeasible: no gains in the box meet every requirement ({effort})"
    if status is OptimumStatus.NO_BOUND:
        return f"no bound: {optimum.reason}"
    if optimum.bound is None or optimum.gap is None:
        return f"nothing proved: {optimum.reason} ({effort})"
    found = f"no gains that meet every requirement are better than {number(optimum.bound)}"
    if optimum.better is not None:
        g = optimum.better
        last = ("kd", g.kd) if isinstance(g, FoPid) else ("alpha", g.alpha)
        told = (f"{name} = {number(value, 8)}" for name, value in (("kp", g.kp), ("ki", g.ki), last))
        found += f"; better gains: {', '.join(told)}"
    word = "certified" if status is OptimumStatus.CERTIFIED else f"bounded, {optimum.reason}"
    unused = f"; not used: {', '.join(optimum.left_out)}" if optimum.left_out else ""
    return f"{word}: {found}, a gap of {100.0 * optimum.gap:.3g} % ({effort}){unused}"
