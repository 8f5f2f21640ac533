"""The page of a system:  its certificate, its simulation, its drawn pairs -> system_report.html and its figures.

Equal certificates, simulations and evidence give equal bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from fopi_tune.core.controller import FoPi
from fopi_tune.core.text_tables.words import counted
from fopi_tune.proof.switched import SystemCertificate, SystemVerdict
from fopi_tune.proof.switched.certificate import ASSUMPTIONS
from fopi_tune.report.evidence import sampling_phrase, system_evidence_rows
from fopi_tune.report.figures.picture import Picture
from fopi_tune.report.figures.scenarios import DrivenLoops, driven_system
from fopi_tune.report.figures.switched import orbit_picture, place_of, region_picture
from fopi_tune.report.head import controller_words
from fopi_tune.report.page import figure_files, render_figures, render_template
from fopi_tune.report.response_rows import driven_plants, measure_ranges
from fopi_tune.report.text.formatting import number
from fopi_tune.spec.model import SystemSpec

#: the page's file
SYSTEM_REPORT = "system_report.html"
#: what an undecided verdict still has
_STILL = "What is still proved, and how far the proof came, is below."

_FIGURES: Mapping[str, Callable[..., Picture | None]] = {
    "orbit": orbit_picture,
    "region": region_picture,
}


@dataclass(frozen=True)
class SystemRuns:
    """What was simulated of a system with its gains, and drawn.

    Args:
        driven: every scenario, with pairs of plants.
        gains: of each mode, in words.
        evidence: the JSON of the pairs that were drawn; None without.
        sha256: of the system's text.
    """

    driven: DrivenLoops
    gains: tuple[tuple[str, str], ...]
    evidence: Mapping[str, Any] | None
    sha256: str


def system_runs(system: SystemSpec, gains: Mapping[str, FoPi], evidence: Mapping[str, Any] | None = None) -> SystemRuns:
    """Simulate a system for its page.

    Args:
        system: the system.
        gains: of each mode.
        evidence: the JSON of the pairs that were drawn with these gains; None without.
    """
    words = tuple((name, controller_words(each)) for name, each in gains.items())
    return SystemRuns(driven_system(system, gains), words, evidence, system.sha256)


def system_report_files(
    certificate: SystemCertificate | None, unit: str = "", runs: SystemRuns | None = None
) -> dict[str, str | bytes]:
    """The page and its figures, by their names in the folder of results.

    Args:
        certificate: that was checked; None where nothing is proved.
        unit: of the output, which a certificate does not hold; empty where it is not known.
        runs: what was simulated and drawn; None shows the certificate alone.  There is one of both.

    Returns:
        Figures as text (SVG) and bytes (PNG), `system_report.html` last, as text.
    """
    pictures = {name: partial(make, unit=unit) for name, make in _FIGURES.items()}
    figures = [] if certificate is None else list(render_figures(pictures, certificate))
    of_time = [] if runs is None else list(render_figures(runs.driven.pictures, runs.driven))
    values = {**_run_values(runs), **_proof_values(certificate, unit), "figures": figures, "time_figures": of_time}
    return {**figure_files([*figures, *of_time]), SYSTEM_REPORT: render_template("system.html.jinja", values)}


def _proof_values(certificate: SystemCertificate | None, unit: str) -> dict[str, Any]:
    """Template values of the certificate."""
    if certificate is None:
        return {"proved": False, "good": True, "status": ""}
    verdict = certificate.verdict
    still = f" {_STILL}" if verdict is SystemVerdict.UNDECIDED else ""
    return {
        "proved": True,
        "name": certificate.name,
        "unit": unit or "the output's unit",
        "good": verdict is SystemVerdict.SETTLES,
        "status": f"{verdict.value}. {verdict.advice}{still}",
        "statements": [said for said in certificate.statements if not said.startswith("At setpoint")],
        "orbits": list(_orbits(certificate)),
        "bounds": list(_bounds(certificate)),
        "assumptions": ASSUMPTIONS,
        "model": list(_model(certificate, unit)),
        "versions": ", ".join(f"{name} {version}" for name, version in certificate.versions.items()),
        "system_sha256": certificate.system_sha256,
    }


def _run_values(runs: SystemRuns | None) -> dict[str, Any]:
    """Template values of what was simulated and drawn."""
    if runs is None:
        return {"runs": False, "evidence": ()}
    drawn = runs.evidence
    return {
        "runs": True,
        "name": runs.driven.name,
        "gains": runs.gains,
        "why_not_driven": runs.driven.why_none,
        "driven_plants": driven_plants(runs.driven),
        "ranges": measure_ranges(runs.driven),
        "sampling": "" if drawn is None else sampling_phrase(drawn),
        "confidence": "" if drawn is None else f"{100.0 * drawn['drawn']['confidence']:g} %",
        "evidence": () if drawn is None else system_evidence_rows(drawn),
        "system_sha256": runs.sha256,
    }  # fmt: skip


def _orbits(certificate: SystemCertificate) -> Iterator[tuple[str, ...]]:
    """A row for each orbit: place, samples, period, least and largest deviation, and whether it attracts."""
    for each in certificate.cycles:
        samples = len(each.modes)
        yield (
            place_of(certificate, each),
            str(samples),
            f"{samples * certificate.model.sample_time_s:g}",
            f"{each.lowest:+.4g}",
            f"{each.highest:+.4g}",
            "yes" if each.attracts else "not shown",
        )


def _bounds(certificate: SystemCertificate) -> Iterator[tuple[str, ...]]:
    """A row for each mode whose memory is bounded: name, the sum's bound, those of the sections."""
    if certificate.bounded is None:
        return
    for loop, bounds in zip(certificate.model.loops, certificate.bounded.memories, strict=True):
        if bounds is not None:
            yield loop.name, number(bounds.total), ", ".join(number(each) for each in bounds.sections)


def _model(certificate: SystemCertificate, unit: str) -> Iterator[tuple[str, str]]:
    """What the certificate is about."""
    model = certificate.model
    yield "sample time", f"{model.sample_time_s:g} s"
    suffix, lines = f" {unit}" if unit else "", model.lines
    if lines.half_width is not None:
        yield "hysteresis", f"{lines.half_width:g}{suffix} on both sides of the setpoint"
    else:
        for word, line in lines.named(*(loop.name for loop in model.loops)).items():
            yield word, f"{line.value:g}{suffix}{'' if line.is_absolute else ' from the setpoint'}"
    yield "inactive controller", model.memory.value
    delay, other = (loop.delay_samples for loop in model.loops)
    if delay != other:
        told = " and ".join(f"{loop.delay_samples:g} in the {loop.name}" for loop in model.loops)
        yield "computing delay, samples", told
    elif delay:
        yield "computing delay", f"{delay:g} of a sample" if delay < 1.0 else "one sample"
    for loop in model.loops:
        numbers = [
            f"{name} = {value.nominal:g}" if value.is_exact else f"{name} from {value.min:g} to {value.max:g}"
            for name, value in loop.plant.parameters.items()
        ]
        low, high = loop.controller.limits
        yield (
            loop.name,
            f"plant {loop.plant.model}: {', '.join(numbers)}; control from {low:g} to {high:g}; "
            f"{counted(len(loop.controller.poles), 'section')}",
        )
