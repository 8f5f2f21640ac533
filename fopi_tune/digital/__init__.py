"""Gains to a controller that runs on samples:  approximated, discretised, and measured in the forms targets use."""

from fopi_tune.digital.discretize import DigitalController, discretize
from fopi_tune.digital.document import to_document

__all__ = ["DigitalController", "discretize", "to_document"]
