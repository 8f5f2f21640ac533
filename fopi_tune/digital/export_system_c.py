"""A system of two controllers as C99:  both digital controllers, how they take turns -> {file name: text}.

A system's `step` calls the functions of both modes, which are those of `export_c`.  The arithmetic is
`switched_runtime`'s.  Equal inputs give equal bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from fopi_tune.core.controller import FoPi, derivative_of
from fopi_tune.digital.export_c import (
    ControllerCode,
    Export,
    c_type,
    code_files,
    controller_code,
    identifier_of,
    literal,
    replay_files,
    sanitized,
    with_export_id,
)
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.switched_runtime import Memory, SwitchedRuntime, Switching
from fopi_tune.digital.system_vectors import COLUMNS, system_operations, system_vector_table

#: largest length of a description
_DESCRIPTION = 600
#: words of C and C++, and the other members of a system's state, that no mode's controller can be called
_TAKEN = (
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl const constexpr continue "
    "decltype default delete do double else enum explicit export extern false float for friend goto if inline int long "
    "main mode mutable namespace new noexcept not not_eq nullptr operator or or_eq output private protected public "
    "register restrict return short signed sizeof static stayed struct switch template this throw true try typedef "
    "typeid typename union unsigned using virtual void volatile while xor xor_eq"
)
_MEMORY = {
    Memory.HELD: "held as it was",
    Memory.TRACKING: "tracks the output of the active one, within its own limits",
    Memory.RESET: "starts anew, at an output of 0, when its mode is entered",
}


@dataclass(frozen=True)
class SystemExport:
    """What is exported.

    Args:
        name: of the system; letters, digits, dot, underscore and hyphen, at most 64.
        description: of the system; any text.
        system_sha256: of the system's file and its specs.
        tool: name and version of what makes the files.
        modes: of mode 1 and mode 2, with the same sample time.
        mode_names: of the raising mode and the lowering one, lower-case letters, digits and underscores.
        switching: how they take turns.
        min_dwell_s: as the system says it, s; rounded up in `switching`.
    """

    name: str
    description: str
    system_sha256: str
    tool: str
    modes: tuple[Export, Export]
    mode_names: tuple[str, str]
    switching: Switching
    min_dwell_s: float = 0.0


def export_system_c(export: SystemExport) -> dict[str, str]:
    """The files: in double and in float a header and a source for the system and for each mode; test vectors, a program
    that replays them, and a Makefile.

    Args:
        export: the controllers, how they take turns, and what the headers say.

    Raises:
        DomainError: an invalid name, empty limits, a controller that is unusable after rounding, or a half-width or
            lines that a precision does not hold.
    """
    identifier = identifier_of(export.name)
    files: dict[str, str] = {}
    called = {"is_fed": bool(export.switching.fed), "restarts": export.switching.memory is Memory.RESET}
    pairs, stems = [], []
    for precision in Precision:
        prefix = f"fopi_{identifier}_{c_type(precision)['suffix']}"
        codes = [
            controller_code(replace(mode, **called), precision, f"{identifier}_{name}", prefix)
            for mode, name in zip(export.modes, export.mode_names, strict=True)
        ]
        pair = SwitchedRuntime((codes[0].runtime, codes[1].runtime), export.switching)
        files |= code_files("system", with_export_id(_values(export, pair, prefix, codes)))
        for code in codes:
            files |= code.files
        pairs.append(pair)
        stems += [prefix, *(code.prefix for code in codes)]
    files["test_vectors.csv"] = system_vector_table(pairs[0], pairs[1], system_operations(pairs[0]))
    return files | replay_files(identifier, stems, COLUMNS, pair=True)


def _values(export: SystemExport, pair: SwitchedRuntime, prefix: str, codes: list[ControllerCode]) -> dict[str, Any]:
    """What the templates name."""
    kind, digital = c_type(pair.precision), export.modes[0].controller.digital
    return {
        **kind,
        "prefix": prefix,
        "macro": prefix.upper(),
        "name": export.name,
        "description": sanitized(export.description, _DESCRIPTION),
        "sha256": sanitized(export.system_sha256),
        "tool": sanitized(export.tool),
        "sample_time": digital.sample_time_s,
        "delay_samples": _delays(export),
        "measurement_unit": sanitized(export.modes[0].units.measurement) or "unit not given",
        "modes": [_mode(export, index, code) for index, code in enumerate(codes)],
        "first": 1 + export.switching.first,
        **_turns(pair, kind["literal"]),
        **_fed(pair, kind["literal"]),
        "dwell": export.switching.min_dwell_samples,
        "dwell_text": _dwell(export),
        "memory": export.switching.memory.value,
        "memory_text": _MEMORY[export.switching.memory],
    }


def _delays(export: SystemExport) -> float | str:
    """The computing delay that was foreseen, in samples; of both modes where theirs differ."""
    one, other = (mode.controller.digital.delay_samples for mode in export.modes)
    return one if one == other else f"{one} in mode 1 and {other} in mode 2"


def _turns(pair: SwitchedRuntime, suffix: str) -> dict[str, Any]:
    """The half-width of the hysteresis, or each line with its number, as an expression and in words."""
    lines = pair.lines
    if lines.half_width is not None:
        return {"half_width": (literal(lines.half_width, suffix), repr(lines.half_width))}
    named = {"to_2": lines.up, "to_1": lines.down, "rest_from_1": lines.coast_above, "rest_from_2": lines.coast_below}
    return {
        "lines": {
            name: {
                "value": literal(line.value, suffix),
                "told": repr(line.value),
                "at": f"line_{name}" if line.is_absolute else f"setpoint + line_{name}",
                "words": repr(line.value) if line.is_absolute else f"setpoint + {line.value!r}",
            }
            for name, line in named.items()
            if line is not None
        }
    }


def _fed(pair: SwitchedRuntime, suffix: str) -> dict[str, Any]:
    """The gains of each mode's feed-forward; nothing without one."""
    if not pair.switching.fed:
        return {}

    def number(value: float) -> tuple[str, str]:
        rounded = float(pair.precision.dtype(value))
        return literal(rounded, suffix), repr(rounded)

    return {"fed": [{"static": number(static), "change": number(change)} for static, change in pair.switching.fed]}


def _mode(export: SystemExport, index: int, code: ControllerCode) -> dict[str, Any]:
    (low, high), gains = code.runtime.limits, export.modes[index].controller.gains
    return {
        "name": export.mode_names[index],
        "member": _member(export.mode_names[index]),
        "gains": gains,
        **({} if code.runtime.derivative is None else {"derivative": _derivative(gains)}),
        "number": 1 + index,
        "limits": "none" if export.modes[index].limits is None else f"{low!r} to {high!r}",
        "limits_rate": code.runtime.limits_rate,
        "rate": f", rate: {export.modes[index].rate_per_s!r} per s" if code.runtime.limits_rate else "",
        "prefix": code.prefix,
        "macro": code.macro,
        "export_id": code.export_id,
    }


def _derivative(gains: FoPi) -> str:
    """A mode's derivative for the header."""
    kd, mu, filter_s = derivative_of(gains)
    return f", kd = {kd}{'' if mu == 1.0 else f', mu = {mu}'}, Tf = {filter_s} s"


def _member(name: str) -> str:
    """A mode's name as a member of the state's struct, where some words are taken."""
    return f"{name}_controller" if name in _TAKEN.split() else name


def _dwell(export: SystemExport) -> str:
    """The minimum dwell in words."""
    count = export.switching.min_dwell_samples
    if count <= 1:
        return "none; a mode may be left at the next sample"
    seconds = count * export.modes[0].controller.digital.sample_time_s
    rounded = (
        "" if abs(seconds - export.min_dwell_s) <= 1e-6 * seconds else f", rounded up from {export.min_dwell_s:g} s"
    )
    told = f"a mode stays at least {count} samples after it was entered, {seconds:.6g} s{rounded}"
    return f"{told}; the first may be left at once"
