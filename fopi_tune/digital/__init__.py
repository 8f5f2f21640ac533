"""Gains to a digital controller:  approximated, discretised, and with measured errors in the forms that targets use."""

from fopi_tune.digital.discretize import DigitalController, discretize, sections_of, to_document
from fopi_tune.digital.export_c import Export, Units, export_c
from fopi_tune.digital.export_system_c import SystemExport, export_system_c
from fopi_tune.digital.switched_runtime import Memory, Switching

__all__ = [
    "DigitalController",
    "Export",
    "Memory",
    "Switching",
    "SystemExport",
    "Units",
    "discretize",
    "export_c",
    "export_system_c",
    "sections_of",
    "to_document",
]
