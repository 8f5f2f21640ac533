"""The controller as structured text:  a digital controller -> function blocks of IEC 61131-3, in LREAL and in REAL.

A block is one controller, a call one sample, with the operations of `runtime` in their order.  It has no function, no
library and no pointer, so that every edition of the standard reads it.  Literals are decimal, the standard has no
others, with as many digits as tell a number from its neighbours in double precision.

Source: IEC 61131-3, Programmable controllers, Part 3: Programming languages, 2013.
"""

from __future__ import annotations

import re
import textwrap
from typing import Any

import numpy as np

from fopi_tune.digital.export_c import Export, identifier_of, rendered, runtime_in, template_values
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init

_TEMPLATE, _FOLDER = "function_block.st.jinja", "targets/templates"
_TYPES = {Precision.FLOAT64: "LREAL", Precision.FLOAT32: "REAL"}
#: of a comment's lines after its first
_WIDTH, _INDENT = 110, 17


def structured_text_files(export: Export) -> dict[str, str]:
    """A function block in LREAL and one in REAL, a file each.

    Args:
        export: the controller and what the head of a block says.

    Raises:
        DomainError: an invalid name, empty limits, or a controller that is unusable after rounding.
    """
    every = [_values(export, runtime_in(export, precision)) for precision in Precision]
    return {f"{values['prefix']}.st": rendered(_TEMPLATE, values, _FOLDER) for values in every}


def _values(export: Export, runtime: Runtime) -> dict[str, Any]:
    """What the template names: of the values of C's those that are texts and counts, and all numbers anew."""
    kind = _TYPES[runtime.precision]

    def number(value: float) -> str:
        return _literal(value, kind)

    def row(values: tuple[float, ...]) -> list[str]:
        return [number(value) for value in values]

    values = template_values(export, runtime, identifier_of(export.name))
    sections, derivative, used = len(runtime.poles), runtime.derivative, runtime.measurement_filter
    arrays = [(name, row(getattr(runtime, name))) for name in ("poles", "residues", "weights") if sections]
    memories = [("x", sections)] if sections else []
    if derivative is not None:
        arrays += [("derivative_gains", row(derivative.gains)), ("derivative_shares", row(derivative.shares))]
        memories.append(("filtered", len(derivative.gains)))
    if used is not None:
        values |= {"filter_share": number(used.share), "filter_damping": number(used.damping or 0.0)}
        memories.append(("lagged", values["filter_order"]))
    if runtime.proportional != 0.0:
        values |= {"setpoint_weight": number(runtime.setpoint_weight), "proportional": number(runtime.proportional)}
    start = init(runtime)
    return {
        **values,
        "block": values["macro"],
        "type": kind,
        "facts": [line for fact in _facts(export, values) for line in _comment(fact)],
        "zero": number(0.0),
        "start": number(float(start.output)),
        "states": row(tuple(start.x.tolist())),
        "largest": number(float(np.finfo(runtime.precision.dtype).max)),
        "direct": number(runtime.direct),
        "low": number(runtime.limits[0]),
        "high": number(runtime.limits[1]),
        "most_change": number(runtime.most_change) if runtime.limits_rate else None,
        "flush_below": number(runtime.precision.flush_below),
        "tracking_gain": number(runtime.tracking_gain),
        "arrays": arrays,
        "memories": memories,
        "remembers": bool(memories),
    }


def _facts(export: Export, values: dict[str, Any]) -> list[str]:
    """What the block's head says of the controller."""
    facts = [f"Spec:        {export.name}, sha256 {values['sha256']}"]
    facts += [f"Description: {values['description']}"] if values["description"] else []
    facts += [f"Made by:     {values['tool']}", f"Controller:  {export.controller.gains!r}"]
    facts += [f"Signals:     {values['signals']}"] if "signals" in values else []
    facts += [f"Setpoint:    {values['measurement_unit']}, the measurement too"]
    facts += [f"Output:      {values['output_unit']}, limits: {values['limits']}"]
    facts += [f"Rate:        the output changes by at most {values['rate']} per s"] if "rate" in values else []
    return [*facts, f"Filter:      {values['filter']}", f"Accuracy:    {values['errors']}"]


def _comment(text: str) -> list[str]:
    """Lines of a comment, which the text cannot end."""
    text = re.sub(r"(?<=\()(?=\*)|(?<=\*)(?=\))", " ", text)
    return [f" * {line}" for line in textwrap.wrap(text, _WIDTH, subsequent_indent=" " * (_INDENT - 4))]


def _literal(value: float, kind: str) -> str:
    """A number as a typed literal, which has a point and no sign of a positive exponent:  1e-05 -> LREAL#1.0E-5."""
    digits, _, exponent = repr(float(value)).partition("e")
    digits = digits if "." in digits else f"{digits}.0"
    return f"{kind}#{digits}{f'E{int(exponent)}' if exponent else ''}"
