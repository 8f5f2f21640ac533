"""What is proved of a system as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.report.text.formatting import QUIET, Line, gains_lines, style_of, to_text, wrapped

if TYPE_CHECKING:
    from fopi_tune.results.proved_system import ProvedSystem

#: orbits that are told; the certificate has all of them
_MOST_ORBITS = 8


def system_proof_text(result: ProvedSystem) -> Text:
    """Verdict, gains, and what is proved, a sentence each."""
    certificate = result.certificate
    settles = result.status.value == "settles"
    lines: list[Line] = [
        *wrapped(f"{result.spec.name}: {result.status.value}. {result.status.advice}", style_of(settles)),
        ("", ""),
        *gains_lines(result.gains),
        ("", ""),
    ]
    statements, left = list(certificate.statements), max(0, len(certificate.cycles) - _MOST_ORBITS)
    first = len(statements) - len(certificate.cycles) - bool(certificate.reason)
    del statements[first + _MOST_ORBITS : first + _MOST_ORBITS + left]
    for said in statements:
        lines += wrapped(f"- {said}", "yellow" if said.startswith("Not proved") else "", indent="  ")
    if left:
        lines += wrapped(f"The certificate has {left} more orbits.", QUIET)
    return to_text(lines)
