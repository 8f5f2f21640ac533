"""Which formats there are:  a word -> the files of a controller."""

from __future__ import annotations

from enum import StrEnum

from fopi_tune.digital.export_c import Export
from fopi_tune.digital.targets.cmsis import cmsis_header
from fopi_tune.digital.targets.fmu import fmu_files, packed
from fopi_tune.digital.targets.structured_text import structured_text_files


class Target(StrEnum):
    """An export format beside C; the value is its word on the command line."""

    FMU = "fmu"
    CMSIS = "cmsis"
    STRUCTURED_TEXT = "st"


def export_target(export: Export, target: Target) -> dict[str, str | bytes]:
    """A controller in a format: file names and contents.

    Equal inputs give equal bytes.

    Args:
        export: the controller and what its header says.
        target: the format.

    Raises:
        DomainError: an invalid name, empty limits, or a controller that is unusable after rounding or in this format.
    """
    if target is Target.CMSIS:
        return {f"{export.name}_cmsis.h": cmsis_header(export)}
    if target is Target.STRUCTURED_TEXT:
        return {**structured_text_files(export)}
    return _fmu(export)


def _fmu(export: Export) -> dict[str, str | bytes]:
    return {f"{export.name}.fmu": packed(fmu_files(export))}
