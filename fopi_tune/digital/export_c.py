"""The controller as C99:  a digital controller -> {file name: text}.

Two translation units, double and float, that allocate nothing and call nothing; test vectors, and a program that
replays them bit for bit.  The arithmetic is `runtime`'s.  Equal inputs give equal bytes: nothing of the machine or the
hour is in them.  Names and texts are untrusted: text in a comment cannot end the comment.
"""

from __future__ import annotations

import hashlib
import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.text_tables.words import counted
from fopi_tune.digital.discretize import FILTER_TERM, DigitalController, Method
from fopi_tune.digital.implementation import step_cost
from fopi_tune.digital.realise import Form, Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.vectors import COLUMNS, standard_operations, vector_table
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.spec.model import DesignSpec

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
#: largest lengths: of a comment's line after " * ", of a description, and of other texts
_WIDTH, _DESCRIPTION, _SHORT = 96, 600, 80
#: of a comment's lines after its first
_INDENT = 13
#: C type, suffixes and prefix of the limits in float.h of each precision
_TYPES = {
    Precision.FLOAT64: {"suffix": "f64", "type": "double", "limit": "DBL", "literal": ""},
    Precision.FLOAT32: {"suffix": "f32", "type": "float", "limit": "FLT", "literal": "f"},
}


@dataclass(frozen=True)
class Units:
    """Units of the controller's signals, as text.

    Args:
        measurement: of setpoint and measurement.
        output: of the output.
    """

    measurement: str = ""
    output: str = ""


@dataclass(frozen=True)
class Export:
    """What is exported.

    Args:
        name: of the spec; letters, digits, dot, underscore and hyphen, at most 64.
        description: of the spec; any text.
        spec_sha256: of the spec file's bytes.
        tool: name and version of what makes the files.
        controller: the filter with its measured errors.
        units: of the signals; any text.
        limits: of the output in its unit, lower first; None where there are none.
        rate_per_s: fastest change of the output, per s; None where there is no limit.
        setpoint_weight: b of kp (b r - y), dimensionless.
        is_fed: whether a system adds a feed-forward to its output; such a controller has no weight of the setpoint.
        restarts: whether a system starts it anew where its mode is entered.
    """

    name: str
    description: str
    spec_sha256: str
    tool: str
    controller: DigitalController
    units: Units = Units()
    limits: tuple[float, float] | None = None
    rate_per_s: float | None = None
    setpoint_weight: float = 1.0
    is_fed: bool = False
    restarts: bool = False

    @classmethod
    def of(cls, spec: DesignSpec, controller: DigitalController) -> Export:
        """A spec's controller, with the limits and units that it was made with."""
        from fopi_tune import __version__

        digital = controller.digital
        return cls(
            name=spec.name,
            description=spec.description,
            spec_sha256=spec.text_sha256,
            tool=f"fopi-tune {__version__}",
            controller=controller,
            units=Units(digital.measurement_unit, digital.output_unit),
            limits=digital.output_limits,
            rate_per_s=digital.output_rate_per_s,
            setpoint_weight=spec.controller.weight_of(controller.gains),
        )


def export_c(export: Export) -> dict[str, str]:
    """The files: a header and a source for double and for float, test vectors, a program that replays them, a Makefile.

    Args:
        export: the controller and what its header says.

    Raises:
        DomainError: an invalid name, empty limits, or a controller that is unusable after rounding.
    """
    identifier = identifier_of(export.name)
    codes = [controller_code(export, precision, identifier) for precision in Precision]
    double, single = (code.runtime for code in codes)
    files = {"test_vectors.csv": vector_table(double, single, standard_operations(double))}
    for code in codes:
        files |= code.files
    return files | replay_files(identifier, [code.prefix for code in codes], COLUMNS)


@dataclass(frozen=True)
class ControllerCode:
    """One controller in one precision.

    Args:
        runtime: its numbers.
        prefix: of its functions, and the name of its files.
        macro: the same in capital letters, of its macros.
        export_id: what its header has as `macro`_EXPORT.
        files: header and source.
    """

    runtime: Runtime
    prefix: str
    macro: str
    export_id: str
    files: dict[str, str]


def controller_code(export: Export, precision: Precision, identifier: str, part_of: str = "") -> ControllerCode:
    """A controller's header and source.

    Args:
        export: the controller and what its header says.
        precision: of its numbers.
        identifier: a part of its names in C.
        part_of: prefix of the system that calls it; empty for a controller of its own.

    Raises:
        DomainError: empty limits, a rate of 0, or a controller that is unusable after rounding.
    """
    runtime = runtime_in(export, precision)
    of_system: dict[str, Any] = {"part_of": part_of} if part_of else {}
    of_system |= {"fed": True} if export.is_fed else {}
    of_system |= {"restarts": True} if export.restarts and runtime.derivative is not None else {}
    values = with_export_id({**template_values(export, runtime, identifier), **of_system})
    files = code_files("controller", {"part_of": "", **values})
    return ControllerCode(runtime, values["prefix"], values["macro"], values["export_id"], files)


def runtime_in(export: Export, precision: Precision) -> Runtime:
    """The controller's arithmetic in a precision.

    Raises:
        DomainError: empty limits, a rate of 0, or a controller that is unusable after rounding.
    """
    sections, weight = export.controller.sections, export.setpoint_weight
    used = export.controller.gains.measurement_filter
    return Runtime.of(sections, precision, export.limits, export.rate_per_s, weight, used)


def with_export_id(values: dict[str, Any]) -> dict[str, Any]:
    """The values and a short hash of all that header and source say."""
    return {**values, "export_id": f"0x{hashlib.sha256(repr(values).encode()).hexdigest()[:8]}U"}


def code_files(template: str, values: dict[str, Any]) -> dict[str, str]:
    """Header and source from their templates, named by the prefix."""
    return {f"{values['prefix']}.{ending}": rendered(f"{template}.{ending}.jinja", values) for ending in "hc"}


def replay_files(identifier: str, stems: Sequence[str], columns: str, pair: bool = False) -> dict[str, str]:
    """The program that replays the test vectors, and its Makefile.

    Args:
        identifier: of the controller or system.
        stems: of all its sources.
        columns: first line of the table of vectors.
        pair: whether it is a system, of which the mode is compared too.
    """
    values = {"identifier": identifier, "columns": columns, "stems": sorted(stems), "pair": pair}
    return {name: rendered(f"{name}.jinja", values) for name in ("main.c", "Makefile")}


def identifier_of(name: str) -> str:
    """A name as a part of C's names:  Brake-1.2 -> brake_1_2.

    Raises:
        DomainError: it is no name of a spec.
    """
    if not _NAME.fullmatch(name):
        raise DomainError(f"{name[:80]!a} cannot name files; use letters, digits, dot, underscore or hyphen")
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def c_type(precision: Precision) -> dict[str, str]:
    """The C type of a precision, the suffix of its files and literals, and its prefix in float.h."""
    return _TYPES[precision]


def comment(text: str) -> str:
    """Any text as lines of a C comment, each after " * "."""
    return "\n".join(f" * {line}" for line in textwrap.wrap(text, _WIDTH, subsequent_indent=" " * _INDENT)) or " *"


def sanitized(text: str, longest: int = _SHORT) -> str:
    """Any text as printable ASCII of one line without comment marks, trigraphs and continued lines.

    Args:
        text: untrusted.
        longest: in characters; longer texts end in "...".
    """
    # text that is cut off below need not be cleaned; cleaning removes white space only
    text = " ".join(text[: 20 * longest].split())
    text = re.sub(r"[^ -~]", "?", text).replace("\\", "/")
    text = re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", text)
    return text if len(text) <= longest else text[: longest - 3] + "..."


def literal(value: float, suffix: str = "") -> str:
    """A number as C99's hexadecimal constant: exact, whatever the compiler's reader does."""
    digits, _, exponent = value.hex().partition("p")
    if "." in digits:
        digits = digits.rstrip("0").rstrip(".")
    return f"{digits}p{exponent}{suffix}"


def _power_of_two(value: float) -> str:
    return f"2^{math.frexp(value)[1] - 1}"


def rendered(template: str, values: dict[str, Any], folder: str = "c") -> str:
    """A template with its values.

    Args:
        template: its file's name.
        values: by the names in it.
        folder: of templates, below that of this module.
    """
    # imported here: only the export of C needs templates
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("fopi_tune.digital", folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["comment"] = comment
    return environment.get_template(template).render(values)


def template_values(export: Export, runtime: Runtime, identifier: str) -> dict[str, Any]:
    """What the templates name: texts that are fit for a comment of C, and numbers as constants of C.

    Args:
        export: the controller and what its header says.
        runtime: its arithmetic in a precision.
        identifier: a part of its names in C.
    """
    controller, kind = export.controller, _TYPES[runtime.precision]

    def numbers(row: tuple[float, ...]) -> list[tuple[str, str]]:
        return _numbers(row, runtime.precision)

    return {
        **kind,
        "prefix": f"fopi_{identifier}_{kind['suffix']}",
        "macro": f"FOPI_{identifier}_{kind['suffix']}".upper(),
        "name": export.name,
        "description": sanitized(export.description, _DESCRIPTION),
        "sha256": sanitized(export.spec_sha256),
        "tool": sanitized(export.tool),
        "measurement_unit": sanitized(export.units.measurement) or "unit not given",
        "output_unit": sanitized(export.units.output) or "unit not given",
        "gains": controller.gains,
        "digital": controller.digital,
        "filter": sanitized(_filter(controller), _DESCRIPTION),
        "errors": _errors(controller),
        "rounding": _rounding(controller, runtime),
        "cost": _cost(runtime, export.is_fed),
        "limits": "none" if export.limits is None else f"{runtime.limits[0]!r} to {runtime.limits[1]!r}",
        "integrator": runtime.has_integrator,
        "sections": len(runtime.poles),
        "direct": numbers((runtime.direct,))[0],
        "tracking_gain": numbers((runtime.tracking_gain,))[0],
        "low": numbers(runtime.limits)[0],
        "high": numbers(runtime.limits)[1],
        **({"rate": repr(export.rate_per_s)} if runtime.limits_rate else {}),
        "most_change": numbers((runtime.most_change,))[0] if runtime.limits_rate else None,
        "flush_below": literal(runtime.precision.flush_below, kind["literal"]),
        "flush_text": _power_of_two(runtime.precision.flush_below),
        "absorbing_text": _power_of_two(runtime.precision.absorbs_flushed),
        **_parts(runtime),
        "filter_errors": f"off by {_stated(controller.errors_of_terms.get(FILTER_TERM, ()))}",
        "rows": [(label, numbers(getattr(runtime, label))) for label in ("poles", "residues", "weights")],
    }


def _numbers(row: tuple[float, ...], precision: Precision) -> list[tuple[str, str]]:
    """Each number as a constant of C, and for people."""
    return [(literal(number, _TYPES[precision]["literal"]), repr(number)) for number in row]


def _parts(runtime: Runtime) -> dict[str, Any]:
    """What a setpoint weight and a derivative need; nothing for a controller of r - y alone."""
    if runtime.acts_on_error:
        return {}
    values: dict[str, Any] = {"signals": _signals(runtime)}
    if runtime.proportional != 0.0:
        pair = _numbers((runtime.proportional, runtime.setpoint_weight), runtime.precision)
        values |= {"proportional": pair[0], "setpoint_weight": pair[1]}
    if runtime.derivative is not None:
        rows = (("gains", runtime.derivative.gains), ("shares", runtime.derivative.shares))
        values |= {"derivative_rows": [(label, _numbers(row, runtime.precision)) for label, row in rows]}
        values |= {"derivatives": len(runtime.derivative.gains)}
    if (used := runtime.measurement_filter) is not None:
        pair = _numbers((used.share, used.damping or 0.0), runtime.precision)
        values |= {"filter_order": 1 if used.damping is None else 2}
        values |= {"filter_share": pair[0], "filter_damping": pair[1]}
    return {**values, **({"starts_at_first_sample": True} if runtime.starts_at_first_sample else {})}


def _signals(runtime: Runtime) -> str:
    """Which term acts on which signal."""
    terms = ["kp on b r - y" if runtime.proportional != 0.0 else "kp on r - y", "ki on r - y"]
    terms += ["kd on -y"] if runtime.derivative is not None else []
    measured = "the measurement" if runtime.measurement_filter is None else "the filtered measurement"
    return f"r is the setpoint and y {measured}; {', '.join(terms)}"


def _cost(runtime: Runtime, is_fed: bool) -> str:
    """What a step costs, whatever the processor."""
    cost, size = step_cost(runtime), np.dtype(runtime.precision.dtype).itemsize
    state = cost.state_bytes_float64 if size == 8 else cost.state_bytes_float32
    added = counted(cost.additions + is_fed, "addition")
    return (
        f"a step takes at most {counted(cost.multiplications, 'multiplication')} and {added}, beside comparisons; "
        f"{state} bytes of state and {size * cost.coefficients} of coefficients"
    )


def _filter(controller: DigitalController) -> str:
    digital = controller.digital
    rule = "" if digital.method == Method.FIT.value else f", sampled by {digital.rule}"
    low, high = digital.band_rad_s
    return f"{digital.method}{rule}, {counted(digital.poles, 'pole')} for {low:g} to {high:g} rad/s"


def _errors(controller: DigitalController) -> str:
    """How far the filter is from the ideal controller."""
    low = controller.errors_from_rad_s
    text = f"relative error |C_d/C - 1| from {low:g} rad/s: {_stated(controller.errors) or 'not stated'}"
    for name, errors in controller.errors_of_terms.items():
        if name == FILTER_TERM:
            continue
        text += f"; of the {name} alone {_stated(errors) or 'not stated'}"
    if controller.accurate_rad_s is not None:
        first, last = controller.accurate_rad_s
        text += f"; within 5 % from {first:.4g} to {last:.4g} rad/s"
    return f"{text}; NOTE: {controller.band_note}" if controller.band_note else text


def _stated(errors: tuple[tuple[float, float], ...]) -> str:
    return "; ".join(f"at most {100.0 * error:.3g} % up to {omega:.4g} rad/s" for omega, error in errors)


def _rounding(controller: DigitalController, runtime: Runtime) -> str:
    """What this precision costs: measured, and the smallest error that still moves the integrator."""
    measured = [
        f"largest error over largest output {one.error:.2g}, measured on a seeded noisy step"
        for one in controller.realisations
        if one.form is Form.PARALLEL and one.precision is runtime.precision
    ]
    text = measured[0] if measured else "not measured"
    largest = max(abs(limit) for limit in runtime.limits)
    if runtime.has_integrator and largest < 0.5 * float(runtime.stored.largest):
        # x + r e rounds to x for |r e| below half of x's last place, which is at most epsneg |x|
        lost = largest * float(np.finfo(runtime.precision.dtype).epsneg) / abs(runtime.residues[0])
        text += f"; with the integrator at a limit an error below {lost:.2g} may be too small to move it"
    return text
