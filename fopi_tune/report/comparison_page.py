"""The page of a comparison:  designs -> compare.html and its figures; the same designs give the same bytes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from fopi_tune.core.controller import FoPid, Pid
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.plant import PlantFamily
from fopi_tune.report.comparison import ALIKE, ComparedDesign, Comparison, compare_designs
from fopi_tune.report.documents import Document, ResultDocuments
from fopi_tune.report.evidence import evidence_rows, sampling_phrase
from fopi_tune.report.figures.overlays import Overlay, overlay_pictures
from fopi_tune.report.page import figure_files, render_figures, render_template
from fopi_tune.report.text.formatting import number

#: the page's file
COMPARISON = "compare.html"


def comparison_files(named: Sequence[tuple[str, ResultDocuments]]) -> dict[str, str | bytes]:
    """Designs side by side, as files by their names.

    Args:
        named: where each was read from, and its documents; two to `comparison.MOST`.

    Returns:
        Figures as text (SVG) and bytes (PNG), `compare.html` last.
    """
    comparison = compare_designs(named)
    figures = list(render_figures(overlay_pictures(), Overlay(comparison)))
    values = {
        "title": "; ".join(entry.label for entry in comparison.entries),
        "entries": comparison.entries,
        "facts": _facts(comparison),
        "lines": comparison.lines,
        "sentences": comparison.sentences,
        "groups": [" and ".join(comparison.entries[k].letter for k in group) for group in comparison.groups],
        "plants": [_plants_phrase(comparison.entries[group[0]].documents) for group in comparison.groups],
        "loops": [comparison.entries[group[0]].loop for group in comparison.groups],
        "alike": f"{ALIKE:g}",
        "evidence": _evidence(comparison.entries),
        "figures": figures,
    }
    return {**figure_files(figures), COMPARISON: render_template("compare.html.jinja", values)}


def _facts(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Facts about each design: (name, a text for each design)."""
    every = [entry.documents for entry in comparison.entries]
    makers = (
        ("result", lambda f: _status_phrase(f.design)),
        ("kp", lambda f: "–" if f.gains is None else number(f.gains.kp)),
        ("ki", lambda f: "–" if f.gains is None else number(f.gains.ki)),
        ("alpha", lambda f: "–" if f.gains is None else number(f.gains.alpha)),
        *(_DERIVATIVE_FACTS if any(isinstance(each.gains, FoPid) for each in every) else ()),
        *(_FILTER_FACTS if any(each.gains and each.gains.measurement_filter for each in every) else ()),
        *(_ORDER_FACTS if any(_has_order(each.gains) for each in every) else ()),
        ("gains from", lambda f: f.design["stamp"]["solver"] or "the spec or the command line"),
        ("stability", _stability),
        ("nominal crossover, rad/s", lambda f: _nominal(f, "crossover_rad_s")),
        ("nominal phase margin, deg", lambda f: _nominal(f, "phase_margin_deg")),
        ("nominal gain margin, dB", lambda f: _nominal(f, "gain_margin_db")),
        ("digital controller", _digital),
        ("spec (SHA-256)", lambda f: f.spec.sha256[:12]),
    )
    return [(name, [str(tell(each)) for each in every]) for name, tell in makers]


def _of_derivative(name: str, documents: ResultDocuments) -> str:
    return number(getattr(documents.gains, name)) if isinstance(documents.gains, FoPid) else "–"


def _filter_of(documents: ResultDocuments) -> str:
    used = None if documents.gains is None else documents.gains.measurement_filter
    return "none" if used is None else f"order {used.order}, {number(used.time_constant_s)} s"


def _has_order(gains: object) -> bool:
    return isinstance(gains, FoPid) and not isinstance(gains, Pid)


#: shown where one of the designs is of structure fopid
_ORDER_FACTS = (("mu", partial(_of_derivative, "mu")),)
#: shown where one of the designs filters its measurement
_FILTER_FACTS = (("measurement filter", _filter_of),)
#: shown where one of the designs has a derivative
_DERIVATIVE_FACTS = (
    ("kd", partial(_of_derivative, "kd")),
    ("derivative filter, s", partial(_of_derivative, "derivative_filter_time_constant_s")),
)


def _stability(documents: ResultDocuments) -> str:
    found = documents.design["stability"]
    return "–" if found is None else "stable family" if found["stable"] else f"NOT STABLE: {found['reason']}"


def _nominal(documents: ResultDocuments, key: str) -> str:
    found = documents.design["nominal"]
    if found is None:
        return "–"
    value = found[key]
    return number(value) if value is not None else "infinite" if key == "gain_margin_db" else "none"


def _digital(documents: ResultDocuments) -> str:
    digital, asked = documents.digital, documents.spec.digital
    if digital is None or asked is None:
        return "none"
    missed = sum(not each["met"] for each in digital["requirements"])
    told = f"{digital['status']} every {number(asked.sample_time_s)} s"
    return f"{told}, {missed} of {len(digital['requirements'])} missed" if missed else told


def _evidence(entries: Sequence[ComparedDesign]) -> dict[str, Any] | None:
    """Monte Carlo evidence of all designs as rows; None where no design has any."""
    if all(entry.documents.evidence is None for entry in entries):
        return None
    found = [entry.documents.evidence for entry in entries]
    rows = [{} if each is None else {row.what: row for row in evidence_rows(each)} for each in found]
    names = list(dict.fromkeys(name for each in rows for name in each))
    return {
        "sampling": ["none were drawn" if each is None else sampling_phrase(each) for each in found],
        "rows": [(name, [_share(each.get(name)) for each in rows]) for name in names],
    }


def _share(row: Any) -> str:
    return "–" if row is None else f"{row.share} ({row.interval})"


def _plants_phrase(documents: ResultDocuments) -> str:
    """The family in words."""
    plant = documents.spec.plant
    if isinstance(plant, PlantList):
        return " | ".join(f"{member.name}: {_family_phrase(member.family)}" for member in plant.members)
    return _family_phrase(plant)


def _family_phrase(plant: PlantFamily) -> str:
    parts = [
        f"{name} = {number(value.nominal)}"
        if value.is_exact
        else f"{name} from {number(value.min)} to {number(value.max)}, nominal {number(value.nominal)}"
        for name, value in plant.parameters.items()
    ]
    return f"{plant.model}: {'; '.join(parts)}"


def _status_phrase(document: Document) -> str:
    """The status of a result and its proof's verdict."""
    verdict = str(document["proof"]["verdict"]).replace("_", " ")
    return f"{document['status']}; proof: {verdict}"
