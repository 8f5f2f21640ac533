"""A digital controller and its loop as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.core.text_tables.words import counted
from fopi_tune.report.text.certificates import proof_lines
from fopi_tune.report.text.design import CHECKED, UNDECIDED, proved_sentence, requirement_lines, summary_lines
from fopi_tune.report.text.formatting import (
    BAD,
    QUIET,
    TIE,
    Line,
    entry,
    gains_lines,
    number,
    samples_phrase,
    style_of,
    to_text,
    with_unit,
    wrapped,
)
from fopi_tune.results.documents import objective_name

if TYPE_CHECKING:
    from fopi_tune.results.design import Discretized

_HEADLINES = {
    "met": "The loop on samples meets all requirements, proved for every plant and frequency.",
    "undecided": "The loop on samples passes the check in floating point; not everything could be proved.",
    "violated": "The loop on samples does not meet the requirements that are marked.",
}
_MEASURED = {"undecided": UNDECIDED, "violated": "The loop does not meet the requirements that are marked."}
_FRACTIONAL = {
    "met": "The ideal loop in continuous time meets all requirements, proved for every plant and frequency.",
    "undecided": "The ideal loop in continuous time passes the check in floating point; not everything is proved.",
    "violated": "The ideal loop in continuous time does not meet the requirements that are marked.",
}


def digital_text(result: Discretized) -> Text:
    """The requirements for the loop on samples, the filter's sections, and the rounding errors of its realisations."""
    controller = result.controller
    digital, found, status = controller.digital, result.verification, result.status
    said = _HEADLINES[status]
    if not found.stability.stable and not found.stability.undecided:
        loop = "loop on samples" if result.spec.has_loop_on_samples else "loop"
        said = f"The {loop} is not stable for every plant of the family."
    elif result.spec.is_measured:
        said = CHECKED if status == "met" else _MEASURED[status]
    elif not result.spec.has_loop_on_samples:
        said = _FRACTIONAL["undecided" if result.certificate is None and status == "met" else status]
    elif result.certificate is None and status == "met":
        said = "The loop on samples meets all requirements, as far as a check in floating point tells."
    elif status == "met" and result.measures:
        said = proved_sentence(result.spec, result.measures)
    lines: list[Line] = [
        *wrapped(f"{result.spec.name}, digital: {status}. {said}", style_of(status == "met")),
        ("", ""),
    ]
    lines += gains_lines(controller.gains)
    prewarped = ", prewarped" if digital.prewarp != "none" else ""
    made = f"{digital.method}, {counted(digital.poles, 'pole')}" + (
        "" if digital.method == "fit" else f", {digital.rule}{prewarped}"
    )
    late = f", {samples_phrase(digital.delay_samples)} of computing delay" if digital.delay_samples else ""
    lines += entry("sampled", f"every {with_unit(digital.sample_time_s, 's')} ({made}{late})")
    if digital.output_rate_per_s is not None:
        unit = f"{digital.output_unit} per s" if digital.output_unit else "per s"
        said = f"changes by at most {with_unit(digital.output_rate_per_s, unit)}, which the anti-windup knows of"
        lines += entry("output", said)
    weight = result.spec.controller.setpoint_weight
    # one that was designed stands beside the gains
    if weight != 1.0:
        lines += entry("setpoint", f"weight {number(weight)}: kp acts on {number(weight)} r - y")
    if controller.gains.measurement_filter is not None:
        lines += entry("measured", "behind its filter, by Tustin's rule, before the sections")
    if controller.sections.has_derivative:
        count = len(controller.sections.poles) - controller.sections.integral_sections
        last = "the last of the sections" if count == 1 else f"the last {count} sections"
        lines += entry("kd", f"acts on -y alone, by Tustin's rule: {last}")
    lines += requirement_lines(result.reports, found.objective, result.measures)
    for note in result.notes:
        lines += wrapped(f"{note}.", "yellow")
    helps = result.spec.has_loop_on_samples and not digital.designs_sampled
    if status == "violated" and found.stability.stable and helps:
        lines += wrapped(
            "`design: sampled` in the spec's section digital finds gains whose loop on samples meets them."
        )
    lines += summary_lines(objective_name(result.spec), found.objective, found.stability, found.nominal)
    lines += proof_lines(result.certificate)
    lines += [*_accuracy(result), *_sections(result)]
    return to_text(lines)


def _sections(result: Discretized) -> Iterator[Line]:
    controller = result.controller
    sections = controller.sections
    yield "", ""
    used = controller.gains.measurement_filter
    yield f"C(z){'' if used is None else '/F(z)'} = direct + sum of residue/(z - pole)", "bold"
    yield f"{'direct':<10}{number(sections.direct, 9):>18}", ""
    for pole, residue in zip(sections.poles, sections.residues, strict=True):
        yield f"{'pole':<10}{number(pole, 12):>18}   residue {number(residue, 9):>18}", ""
    yield "", ""
    yield f"{'form':<14}{'precision':<12}{'error':>10}", "bold"
    for form in controller.realisations:
        stable = "" if form.stable else "   a pole leaves the unit circle"
        yield f"{form.form.value:<14}{form.precision.value:<12}{form.error:>10.1e}{stable}", ""
    if used is not None:
        yield from wrapped("The forms are of C/F; the measurement's filter runs before them, as in the C code.", QUIET)
    yield from wrapped("Errors of forms are relative to the largest output over a seeded noisy step.", QUIET)


def _accuracy(result: Discretized) -> Iterator[Line]:
    controller = result.controller
    low = controller.errors_from_rad_s
    if controller.accurate_rad_s is not None:
        first, last = controller.accurate_rad_s
        yield from entry("accurate", f"filter to 5 % from {number(first)} to {with_unit(last, 'rad/s')}")
    if controller.band_note:
        yield from entry("band", f"NOTE: {controller.band_note}", BAD)
    yield from entry("errors", f"largest relative error from {with_unit(low, 'rad/s')}: {_told(controller.errors)}")
    for name, errors in controller.errors_of_terms.items():
        yield from entry("", f"of the {name} alone: {_told(errors)}")
    cost = result.cost
    operations = f"{counted(cost.multiplications, 'multiplication')}, {counted(cost.additions, 'addition')}"
    room = f"{cost.state_bytes_float64} bytes of state in double, {cost.state_bytes_float32} in float"
    yield from entry("a sample", f"takes {operations}; {room}")


def _told(errors: tuple[tuple[float, float], ...]) -> str:
    return ", ".join(f"{100 * error:.3g}{TIE}% up to {with_unit(omega, 'rad/s')}" for omega, error in errors)
