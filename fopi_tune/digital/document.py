"""A digital controller as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fopi_tune.digital.discretize import DigitalController

#: version of the file; it may only grow
DIGITAL_SCHEMA = 1


def to_document(controller: DigitalController, name: str) -> dict[str, Any]:
    """The JSON of `fopi discretize`.

    Args:
        controller: what was made.
        name: of the spec.
    """
    sections = controller.sections
    return {
        "schema": DIGITAL_SCHEMA,
        "status": "discretized",
        "gains": asdict(controller.gains),
        "name": name,
        "digital": {**asdict(controller.digital), "band_rad_s": list(controller.digital.band_rad_s)},
        "controller": {
            "form": "direct + sum of residue/(z - pole)",
            "direct": sections.direct,
            "sections": [
                {"pole": pole, "residue": residue}
                for pole, residue in zip(sections.poles, sections.residues, strict=True)
            ],
        },
        "errors": [{"up_to_rad_s": omega, "largest_relative": error} for omega, error in controller.errors],
        "accurate_rad_s": list(controller.accurate_rad_s) if controller.accurate_rad_s else None,
        "realisations": [
            {
                "form": realisation.form.value,
                "precision": realisation.precision.value,
                "relative_error": realisation.error if realisation.error < float("inf") else None,
                "stable": realisation.stable,
                "coefficients": [list(row) for row in realisation.coefficients],
            }
            for realisation in controller.realisations
        ],
    }
