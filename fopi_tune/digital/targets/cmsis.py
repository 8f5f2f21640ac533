"""The controller's filter for CMSIS-DSP:  a digital controller -> a header with arrays for its biquad cascades.

Each second-order section is {b0, b1, b2, -a1, -a2}, as arm_biquad_cascade_df2T_f32 and _f64 take it.  It is the linear
filter from r - y to the output alone: without limits, anti-windup, setpoint weight and measurement filter.
"""

from __future__ import annotations

from fopi_tune.digital.export_c import Export, identifier_of, literal, sanitized
from fopi_tune.digital.realise import Form, Precision, Realisation
from fopi_tune.errors import DomainError

_TYPES = {Precision.FLOAT64: ("double", "f64", ""), Precision.FLOAT32: ("float", "f32", "f")}


def cmsis_header(export: Export) -> str:
    """The header's text.

    Args:
        export: the controller and what its header says.

    Raises:
        DomainError: an invalid name, a setpoint weight, a measurement filter, or no precision keeps it stable.
    """
    prefix = f"fopi_{identifier_of(export.name)}"
    if export.setpoint_weight != 1.0 or export.controller.gains.measurement_filter is not None:
        raise DomainError("the arrays for CMSIS-DSP are a filter of r - y alone; use C, or leave weight and filter out")
    stable = [one for one in export.controller.realisations if one.form is Form.CMSIS and one.stable]
    if not stable or not stable[0].coefficients:
        raise DomainError("the controller has no stable second-order sections for CMSIS-DSP; use C")
    guard = f"{prefix}_CMSIS_H".upper()
    derives = export.controller.sections.has_derivative
    head = [
        "/*",
        f" * Filter from r - y to the output for CMSIS-DSP, every {export.controller.digital.sample_time_s!r} s:",
        " * second-order sections {b0, b1, b2, -a1, -a2}.  Without limits and anti-windup.",
        *([" * The derivative acts on r - y here, so that a step of r moves it; in C it acts on -y."] * derives),
        f" * Spec: {export.name}, sha256 {sanitized(export.spec_sha256)}; made by {sanitized(export.tool)}",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        f"#define {prefix.upper()}_STAGES {len(stable[0].coefficients)}",
    ]
    arrays = [line for one in stable for line in _array(one, prefix)]
    return "\n".join([*head, *arrays, "", "#endif", ""])


def _array(made: Realisation, prefix: str) -> list[str]:
    """An array for one precision, with its measured error."""
    kind, suffix, ending = _TYPES[made.precision]
    size = 5 * len(made.coefficients)
    rows = ["    " + ", ".join(literal(number, ending) for number in row) + "," for row in made.coefficients]
    told = (
        f"/* arm_biquad_cascade_df2T_{suffix}: largest error over largest output {made.error:.2g}, "
        "on 2000 samples of a\n"
        "   step of 0.3 with noise of standard deviation 1; on a step with little noise it is larger */"
    )
    return ["", told, f"static const {kind} {prefix}_cmsis_{suffix}[{size}] = {{", *rows, "};"]
