"""Simulations as text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.core.text_tables.words import counted
from fopi_tune.report.text.formatting import BAD, QUIET, Line, entry, gains_lines, number, style_of, to_text, wrapped
from fopi_tune.spec.model import MEASURES, DesignSpec, Relation, SystemSpec

if TYPE_CHECKING:
    from fopi_tune.results.simulation import ScenarioResult, Simulated
    from fopi_tune.results.system import SimulatedSystem
    from fopi_tune.spec.model import Limit

_NAME, _VALUE = 22, 14
#: the measures of single steps, in words
_WORDS = {
    "overshoot": "overshoot",
    "undershoot": "undershoot",
    "settling_time_s": "settling time",
    "rise_time_s": "rise time",
    "final_error": "final error",
}
#: the measures that are infinite where an output never gets there
_TIMES = ("settling_time_s", "rise_time_s")


def simulation_text(result: Simulated | SimulatedSystem) -> Text:
    """Measures of every scenario, and whether their limits are met."""
    met = result.status == "met"
    lines: list[Line] = [*wrapped(f"{result.spec.name}, simulated: {_headline(result)}", style_of(met)), ("", "")]
    lines += gains_lines(result.gains)
    named = ", ".join(f"{name} = {number(value)}" for name, value in result.plant.items()) or "known exactly"
    named = f"{result.member}: {named}" if result.member else named
    lines += entry("plant", named + (f" (draw {result.index})" if result.index is not None else ""))
    for note in result.notes:
        lines += entry("note", note)
    for driven in result.driven:
        lines += _scenario_lines(driven, _units_of(result.spec))
    if result.exact:
        lines += [("", ""), *wrapped(_exactness_note(result), QUIET)]
    lines += [("", ""), *wrapped("Each step is judged up to the next one, or the scenario's end.", QUIET)]
    return to_text(lines)


def _headline(result: Simulated | SimulatedSystem) -> str:
    """The status, and what it is about."""
    status = result.status
    if result.left_out and status != "chattering":
        status += f", without {result.left_out}"
    if result.status == "chattering":
        return f"{status}. The modes switch faster than the system allows."
    if not all(driven.finite for driven in result.driven):
        return f"{status}. The output does not stay finite."
    if not any(driven.limits for driven in result.driven):
        return f"{status}. The spec sets no limits for these scenarios."
    return f"{status}. " + (
        "Every limit of the scenarios is kept."
        if result.status == "met"
        else "Not every limit of the scenarios is kept."
    )


def _units_of(spec: DesignSpec | SystemSpec) -> Mapping[str, str]:
    """What the units of measures are called where the spec names them, and all modes alike."""
    specs = [mode.spec for mode in spec.modes] if isinstance(spec, SystemSpec) else [spec]
    named = [(each.digital.measurement_unit, each.digital.output_unit) for each in specs if each.digital is not None]
    found = zip(("output unit", "control unit"), zip(*named, strict=True), strict=False)
    return {word: units[0] for word, units in found if units[0].strip() and len(set(units)) == 1}


def _scenario_lines(driven: ScenarioResult, units: Mapping[str, str]) -> Iterator[Line]:
    """One scenario: its measures, which steps count in them, and its notes."""
    yield "", ""
    yield f"{driven.scenario.name}, {number(driven.scenario.duration_s)} s", "bold"
    if driven.chattering:
        yield "  CHATTERING: the modes switch faster than the system allows", BAD
    if not driven.finite:
        yield "  UNSTABLE: the output does not stay finite", BAD
    yield from wrapped(driven.outcome, QUIET, indent="  ")
    for name in driven.measures:
        kind, value = MEASURES[name], driven.measures[name]
        never = name in _TIMES and math.isinf(value)
        shown = number(value) if math.isfinite(value) else "never" if never else "unknown"
        unit = "" if kind.unit == "1" or not math.isfinite(value) else kind.unit
        for word, called in units.items():
            unit = unit.replace(word, called)
        verdicts = "".join(_verdict(limit, kept) for limit, kept in driven.limits if limit.measure == name)
        yield f"  {name:<{_NAME}}{shown:>{_VALUE}} {unit}{verdicts}", "red" if "VIOLATED" in verdicts else ""
    words = [f"{_WORDS[name]} of {step.phrase()}" for name, step in driven.worst_steps.items()]
    if words:
        yield from wrapped(f"Worst of {counted(len(driven.steps), 'step')}: {', '.join(words)}.", QUIET, indent="  ")
    for note in driven.notes:
        yield from wrapped(note, "yellow", "    ", "  ! ")


def _verdict(limit: Limit, kept: bool | None) -> str:
    sign = "<=" if limit.relation is Relation.AT_MOST else ">="
    word = "unknown" if kept is None else "met" if kept else "VIOLATED"
    return f"   {word}: {sign} {number(limit.limit)}"


def _exactness_note(result: Simulated | SimulatedSystem) -> str:
    """What a simulation in continuous time leaves out, and its accuracy."""
    of_system = isinstance(result.gains, Mapping)
    said = f"In continuous time: without filter, samples{'' if of_system else ', computing delay'} and anti-windup."
    known = [d.accuracy for d in result.driven if d.accuracy is not None and math.isfinite(d.accuracy)]
    if not known:
        return said
    coarser = "A coarser run moves" if of_system else "Steps twice as long move"
    return f"{said} {coarser} the output by {number(max(known), 2)} at most."
