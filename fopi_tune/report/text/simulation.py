"""Simulations as text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.report.text.formatting import BAD, QUIET, Line, entry, gains_lines, number, style_of, to_text, wrapped
from fopi_tune.spec.model import MEASURES, Relation

if TYPE_CHECKING:
    from fopi_tune.results.simulation import Simulated
    from fopi_tune.results.system import SimulatedSystem

_NAME, _VALUE = 22, 14


def simulation_text(result: Simulated | SimulatedSystem) -> Text:
    """Measures of every scenario, and whether their limits are met."""
    met = result.status == "met"
    said = "Every limit of the scenarios is kept." if met else "Not every limit of the scenarios is kept."
    if not any(driven.limits for driven in result.driven):
        said = "The spec sets no limits for these scenarios."
    if result.status == "chattering":
        said = "The modes switch faster than the system allows."
    lines: list[Line] = [*wrapped(f"{result.spec.name}, simulated: {result.status}. {said}", style_of(met)), ("", "")]
    lines += gains_lines(result.gains)
    named = ", ".join(f"{name} = {number(value)}" for name, value in result.plant.items()) or "known exactly"
    lines += entry("plant", named + (f" (draw {result.index})" if result.index is not None else ""))
    for driven in result.driven:
        lines += [("", ""), (f"{driven.scenario.name}, {number(driven.scenario.duration_s)} s", "bold")]
        if driven.chattering:
            lines.append(("  CHATTERING: the modes switch faster than the system allows", BAD))
        lines += wrapped(driven.outcome, QUIET, indent="  ")
        for name, kind in MEASURES.items():
            value = driven.measures[name]
            shown = number(value) if math.isfinite(value) else "never" if name == "settling_time_s" else "-"
            verdicts, unit = "", "" if kind.unit == "1" else kind.unit
            for limit, kept in driven.limits:
                if limit.measure == name:
                    sign = "<=" if limit.relation is Relation.AT_MOST else ">="
                    verdicts += f"   {'met' if kept else 'VIOLATED'}: {sign} {number(limit.limit)}"
            lines.append(
                (f"  {name:<{_NAME}}{shown:>{_VALUE}} {unit}{verdicts}", "red" if "VIOLATED" in verdicts else "")
            )
    if result.exact:
        lines += [("", ""), *wrapped(_exactness_note(result), QUIET)]
    lines += [("", ""), *wrapped("Settling and overshoot are over the scenario's own length.", QUIET)]
    return to_text(lines)


def _exactness_note(result: Simulated | SimulatedSystem) -> str:
    """What a simulation in continuous time leaves out, and its accuracy."""
    said = "In continuous time: without filter, samples, computing delay and anti-windup."
    known = [driven.accuracy for driven in result.driven if driven.accuracy is not None]
    return f"{said} Steps twice as long move the output by {number(max(known), 2)} at most." if known else said
