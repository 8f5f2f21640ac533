"""Gains to a digital controller:  approximated, discretised, and with measured errors in the forms that targets use."""

from fopi_tune.digital.discretize import DigitalController, discretize, sections_of, to_document
from fopi_tune.digital.export_c import Export, Units, export_c

__all__ = ["DigitalController", "Export", "Units", "discretize", "export_c", "sections_of", "to_document"]
