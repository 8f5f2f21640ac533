"""A digital controller as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.report.phrases import GOOD, QUIET, Line, entry, gains_line, number, styled, to_text, with_unit

if TYPE_CHECKING:
    from fopi_tune.result import Discretized


def digital_text(result: Discretized) -> Text:
    """The sections, how far they are from the ideal controller, and what rounding does to each form."""
    controller = result.controller
    digital, sections = controller.digital, controller.sections
    made = f"{digital.method}, {digital.poles} poles" + ("" if digital.method == "fit" else f", {digital.rule}")
    head = f"{result.spec.name}: discretized at {with_unit(digital.sample_time_s, 's')} ({made})."
    lines: list[Line] = [*styled(head, GOOD), ("", ""), (gains_line(controller.gains), "bold"), ("", "")]
    lines.append(("C(z) = direct + sum of residue/(z - pole)", "bold"))
    lines.append((f"{'direct':<10}{number(sections.direct, 9):>18}", ""))
    for pole, residue in zip(sections.poles, sections.residues, strict=True):
        lines.append((f"{'pole':<10}{number(pole, 12):>18}   residue {number(residue, 9):>18}", ""))
    lines += [("", ""), *_accuracy(result)]
    lines += [("", ""), (f"{'form':<14}{'precision':<12}{'error':>10}", "bold")]
    for form in controller.realisations:
        stable = "" if form.stable else "   a pole leaves the unit circle"
        lines.append((f"{form.form.value:<14}{form.precision.value:<12}{form.error:>10.1e}{stable}", ""))
    lines += styled("Errors of forms are relative to the largest output over a seeded noisy step.", QUIET)
    lines += styled("The sampled loop is not verified: a certificate is about the continuous controller.", QUIET)
    return to_text(lines)


def _accuracy(result: Discretized) -> Iterator[Line]:
    controller = result.controller
    parts = [f"{100 * error:.3g} % up to {with_unit(omega, 'rad/s')}" for omega, error in controller.errors]
    low = controller.digital.band_rad_s[0]
    if controller.accurate_rad_s is not None:
        first, last = controller.accurate_rad_s
        yield from entry("accurate", f"to 5 % from {number(first)} to {with_unit(last, 'rad/s')}")
    yield from entry("errors", f"largest relative error from {with_unit(low, 'rad/s')}: " + ", ".join(parts))
