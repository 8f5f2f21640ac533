"""The report:  ResultDocuments -> report.html and its figures as SVG and PNG; the same documents give the same bytes.

This module decides what the report contains; `page.py` renders it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from fopi_tune.core.controller import FoPi
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.report.document_shapes import CHECKED
from fopi_tune.report.documents import ReportedRequirement, ResultDocuments
from fopi_tune.report.evidence import evidence_rows, histograms, sampling_phrase
from fopi_tune.report.figures.frequency import bode, margins_along, nyquist, sensitivities
from fopi_tune.report.figures.measured import (
    MeasuredMembers,
    measured_bode,
    measured_members,
    measured_nyquist,
    measured_sensitivities,
)
from fopi_tune.report.figures.members import Members, members_of
from fopi_tune.report.figures.picture import Picture
from fopi_tune.report.figures.plots import digital_picture
from fopi_tune.report.figures.scenarios import DrivenLoops, driven_loops
from fopi_tune.report.figures.slider import HEIGHT, WIDTH, critical_point_mark, slider_of
from fopi_tune.report.figures.step_responses import step_responses
from fopi_tune.report.head import controller_words, files_of_page, head_of
from fopi_tune.report.measure_entries import ENTRIES, measures_met
from fopi_tune.report.measure_rows import measure_rows
from fopi_tune.report.page import figure_files, render_figures, render_template
from fopi_tune.report.requirement_rows import place_phrase, requirement_rows
from fopi_tune.report.response_rows import driven_plants, measure_ranges
from fopi_tune.report.text.formatting import (
    exact_limit,
    margins_phrase,
    next_sentence,
    number,
    samples_phrase,
    score_note,
    sentence,
)
from fopi_tune.report.text.measures import limit_phrase, limit_scope_phrase
from fopi_tune.results.documents import loop_name
from fopi_tune.spec.scenarios import every_requirement

#: the report's file
REPORT = "report.html"


def report_files(documents: ResultDocuments) -> dict[str, str | bytes]:
    """The report and its figures, by their names in the folder of results.

    Args:
        documents: the spec and its results.

    Returns:
        `report.html` last, as text; figures as text (SVG) and bytes (PNG).
    """
    measured, evidence = measured_members(documents), documents.evidence
    members = members_of(documents)
    of_loop = [] if members is None else list(render_figures(_LOOP_FIGURES, members))
    of_loop += [] if measured is None else list(render_figures(_MEASURED_FIGURES, measured))
    of_filter = list(render_figures({"digital": digital_picture}, documents))
    of_plants = [] if evidence is None else list(render_figures({"plants": _histograms}, documents))
    driven = driven_loops(documents, members)
    of_time = list(render_figures(driven.pictures, driven))
    values = {**_text_values(documents), **_slider_values(members), **_driven_values(driven)}
    values |= {"figures": of_loop, "digital_figures": of_filter, "evidence_figures": of_plants, "time_figures": of_time}
    figures = figure_files([*of_loop, *of_time, *of_filter, *of_plants])
    return {**figures, REPORT: render_template("report.html.jinja", values)}


#: name of a figure of the loop -> how it is drawn, in the order of the page
_LOOP_FIGURES: Mapping[str, Callable[[Members], Picture | None]] = {
    "bode": bode,
    "nyquist": nyquist,
    "sensitivities": sensitivities,
    "responses": step_responses,
    "margins": margins_along,
}
#: the same of measured responses
_MEASURED_FIGURES: Mapping[str, Callable[[MeasuredMembers], Picture | None]] = {
    "bode": measured_bode,
    "nyquist": measured_nyquist,
    "sensitivities": measured_sensitivities,
}


def _histograms(documents: ResultDocuments) -> Picture | None:
    return None if documents.evidence is None else histograms(documents.evidence, documents.spec.name)


def _driven_values(driven: DrivenLoops) -> dict[str, Any]:
    """Template values of the loop as it runs."""
    return {
        "why_not_driven": driven.why_none,
        "driven_plants": driven_plants(driven),
        "own_scenarios": driven.own_scenarios,
        "ranges": measure_ranges(driven),
    }


def _slider_values(members: Members | None) -> dict[str, Any]:
    """Template values of the slider: its curves, and the mark of -1 in its Nyquist panel."""
    try:
        slider = None if members is None else slider_of(members)
    except DomainError:
        slider = None  # crossings that cannot be listed
    curves = {} if slider is None else {panel.key: panel.curves for panel in slider.panels}
    return {
        "slider": slider,
        "curves": {
            "labels": () if slider is None else slider.labels,
            "places": () if slider is None else [(n.first, n.last, n.nominal) for n in slider.numbers],
            "curves": curves,
        },
        "width": WIDTH,
        "height": HEIGHT,
        "minus_one": critical_point_mark(),
    }


def _text_values(documents: ResultDocuments) -> dict[str, Any]:
    """Template values that are text."""
    spec, design, digital, evidence = documents.spec, documents.design, documents.digital, documents.evidence
    rows = requirement_rows(documents.requirements, design["objective"]) + measure_rows(spec, design)
    status = str(design["status"])
    verdict = design["proof"]["verdict"]
    return {
        "name": spec.name,
        "description": spec.description,
        "good": status == "solved",
        "status": " ".join([f"{status}. {design['advice']}", *_proof_words(design, verdict)]),
        "good_on_samples": digital is not None and digital["status"] == "met",
        "on_samples": "" if digital is None else f"The loop on samples: {digital['status']}.{_missed_phrase(digital)}",
        "message": sentence(design["message"]) if design["message"] else "",
        "gains": None if documents.gains is None else _gains_words(documents.gains, status),
        "sampled": loop_name(spec) == "sampled",
        "clash": _clash(documents),
        "rows": rows,
        "summary": list(_summary(design)),
        "why_no_figures": "there are no gains, or the digital controller that the requirements speak of is not there",
        "digital_status": "" if digital is None else _digital_words(documents, digital),
        "score_note": _score_note(documents.requirements),
        "digital_score_note": _score_note(documents.digital_requirements),
        "digital_rows": requirement_rows(documents.digital_requirements) + measure_rows(spec, digital),
        "sampling": "" if evidence is None else sampling_phrase(evidence),
        "confidence": "" if evidence is None else f"{100.0 * evidence['drawn']['confidence']:g} %",
        "evidence": () if evidence is None else evidence_rows(evidence),
        "head": list(head_of(documents)),
        "links": files_of_page(documents, design["proof"].get("certificate_digest") is not None),
        "priced": any(row.cost for row in rows),
        "objective_name": design["objective_quantity"],
        "proof": list(_proof(design["proof"])),
        "stamp": list(_stamp(design)),
    }


def _gains_words(gains: FoPi, status: str) -> str:
    no_solution = "" if status == "solved" else "; these gains are no solution, only where the search ended"
    return f"{controller_words(gains)}{no_solution}"


def _score_note(requirements: Sequence[ReportedRequirement]) -> str:
    return score_note(each.requirement for each in requirements if not each.reported["met"])


def _missed_phrase(digital: Mapping[str, Any]) -> str:
    """A sentence on how many requirements the loop on samples misses; empty if none."""
    met = [*(bool(each["met"]) for each in digital["requirements"]), *measures_met(digital)]
    missed = met.count(False)
    return f" It misses {missed} of {counted(len(met), 'requirement')}; see below." if missed else ""


def _proof_words(design: Mapping[str, Any], verdict: str) -> list[str]:
    if design["status"] != "solved":
        return []
    if verdict == CHECKED:
        return ["Checked at the measured frequencies and between them; there is no proof of measured data."]
    if verdict != "proved":
        return ["Checked in floating point, not proved."]
    checked = sum(each["verdict"] == "checked" for each in design.get(ENTRIES, ()))
    several = "one requirement" if checked == 1 else f"{checked} requirements"
    beside = f" But {several} on scenarios: checked by simulation." if checked else ""
    return [f"Proved for every plant and every frequency.{beside}"]


def _clash(documents: ResultDocuments) -> list[str]:
    words = []
    for give in documents.design["clash"]:
        requirement = every_requirement(documents.spec)[give["requirement"]]
        said = f"{limit_phrase(requirement)} ({limit_scope_phrase(requirement)})"
        if give["give"] is not None and give["new_limit"] is not None:
            said += f": alone it would have to give {number(give['give'])}, to {exact_limit(give['new_limit'])}"
        words.append(said)
    return words


def _summary(design: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    stability, nominal = design["stability"], design["nominal"]
    value = "undefined" if design["objective"] is None else number(design["objective"])
    yield "objective", f"{design['objective_quantity']}: {value}"
    if stability is not None:
        stable = "undecided" if stability.get("undecided") else "stable" if stability["stable"] else "NOT STABLE"
        yield (
            "stability",
            f"{stable}: {stability['reason']}; closest to -1 {place_phrase(stability['worst'])}",
        )
    if nominal is not None:
        yield "nominal plant", margins_phrase(nominal)


def _digital_words(documents: ResultDocuments, digital: Mapping[str, Any]) -> str:
    asked = documents.spec.digital
    assert asked is not None  # there is a digital controller only if the spec asks for one
    made = f"{asked.method} with {counted(asked.poles, 'pole')}"
    words = f"{digital['status']}. Every {number(asked.sample_time_s)} s, {made}"
    words += "" if asked.method == "fit" else f", {asked.rule}"
    words += f", {samples_phrase(asked.delay_samples)} of computing delay" if asked.delay_samples else ""
    rate = asked.output_rate_per_s
    words += "" if rate is None else f". The output changes by at most {number(rate)} per s, anti-windup included"
    note = digital.get("band_note")
    return f"{words}. {sentence(f'Note: {note}')}" if note else f"{words}."


def _proof(proof: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "verdict", f"{str(proof['verdict']).replace('_', ' ')}. {next_sentence(proof['reason'])}"
    if "stability" in proof:
        said = proof["stability"]
        yield "stability", f"{said['verdict']}: {said['reason']} (a coarse bound, which is all that stability needs)"
        if "with_limits" in proof:
            yield "limits", proof["with_limits"]["statement"]
        yield "boxes", f"{proof['boxes']} in ball arithmetic"
        yield "tolerance", f"{proof['tolerance']:g} (neper or radian)"
        yield "certificate", f"certificate.json, digest {proof['certificate_digest']}"
        yield "again", "fopi prove --recheck certificate.json tests it without searching"


def _stamp(design: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    stamp = design["stamp"]
    yield "spec (SHA-256)", stamp["spec_sha256"]
    yield "versions", ", ".join(f"{name} {version}" for name, version in stamp["versions"].items())
    yield "Python", stamp["python"]
    yield "platform", stamp["platform"]
    yield "gains from", stamp["solver"] or "the spec"
    yield "result's schema", str(design["schema"])
