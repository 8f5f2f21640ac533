"""The controller as an FMU:  a digital controller -> the files of an FMI 3.0 co-simulation with sources.

The archive has the exported C code in double precision, a wrapper of it that FMI's importers call, and the description
of both.  A step of the importer is a whole number of samples.  Binaries are added by who has a compiler.

Source: Modelica Association, Functional Mock-up Interface Specification 3.0, 2022.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from typing import Any

from fopi_tune.core.controller import FoPid
from fopi_tune.digital.export_c import (
    ControllerCode,
    Export,
    controller_code,
    identifier_of,
    literal,
    rendered,
    sanitized,
)
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import init

_TEMPLATES = "targets/templates"
#: of every file in an archive: the first hour that the format knows, readable by all
_HOUR, _MODE = (1980, 1, 1, 0, 0, 0), 0o644 << 16


def fmu_files(export: Export) -> dict[str, bytes]:
    """The files of the archive: description of the model, sources and description of how they are compiled.

    Args:
        export: the controller and what its header says.

    Raises:
        DomainError: an invalid name, empty limits, or a controller that is unusable after rounding.
    """
    code = controller_code(export, Precision.FLOAT64, identifier_of(export.name))
    values = _values(export, code)
    texts = {
        "modelDescription.xml": rendered("modelDescription.xml.jinja", values, _TEMPLATES),
        "sources/buildDescription.xml": rendered("buildDescription.xml.jinja", values, _TEMPLATES),
        "sources/fmi3.c": rendered("fmi3.c.jinja", values, _TEMPLATES),
        **{f"sources/{name}": text for name, text in code.files.items()},
    }
    return {name: text.encode() for name, text in texts.items()}


def model_identifier(export: Export) -> str:
    """Of the FMU: the name of its binaries, without their ending."""
    return f"fopi_{identifier_of(export.name)}"


def packed(files: Mapping[str, bytes]) -> bytes:
    """An archive of files; its bytes depend on them alone.

    Args:
        files: by their names in the archive.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _HOUR)
            # of the machine that packs, otherwise
            entry.create_system, entry.external_attr = 3, _MODE
            archive.writestr(entry, files[name])
    return buffer.getvalue()


def _values(export: Export, code: ControllerCode) -> dict[str, Any]:
    """What the templates name."""
    digest = hashlib.sha256("\n".join(code.files.values()).encode()).hexdigest()

    def number(value: float) -> tuple[str, str]:
        return literal(value), repr(float(value))

    return {
        "name": export.name,
        "identifier": model_identifier(export),
        "prefix": code.prefix,
        "token": digest,
        "description": sanitized(export.description, 600),
        "tool": sanitized(export.tool),
        "measurement_unit": sanitized(export.units.measurement) or "unit not given",
        "output_unit": sanitized(export.units.output) or "unit not given",
        "sample_time": number(export.controller.digital.sample_time_s),
        "start": number(float(init(code.runtime).output)),
        "constants": [(name, *number(value)) for name, value in _constants(export, code).items()],
    }


def _constants(export: Export, code: ControllerCode) -> dict[str, float]:
    """What an importer can read, but not change."""
    gains = export.controller.gains
    found = {"sample_time_s": export.controller.digital.sample_time_s, "kp": gains.kp, "ki": gains.ki}
    found["alpha"] = gains.alpha
    if isinstance(gains, FoPid):
        found |= {"kd": gains.kd, "mu": gains.mu}
        found["derivative_filter_time_constant_s"] = gains.derivative_filter_time_constant_s
    if code.runtime.proportional != 0.0:
        found["setpoint_weight"] = code.runtime.setpoint_weight
    if gains.measurement_filter is not None:
        found["measurement_filter_time_constant_s"] = gains.measurement_filter.time_constant_s
    if export.limits is not None:
        found |= {"output_min": code.runtime.limits[0], "output_max": code.runtime.limits[1]}
    if export.rate_per_s is not None:
        found["output_rate_per_s"] = export.rate_per_s
    return found
