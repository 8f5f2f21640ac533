"""A digital controller as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fopi_tune.digital.discretize import DigitalController


def to_document(controller: DigitalController) -> dict[str, Any]:
    """What the JSON of `fopi discretize` says of the controller itself."""
    sections = controller.sections
    return {
        "digital": {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(controller.digital).items()},
        "controller": {
            "form": "direct + sum of residue/(z - pole)",
            "direct": sections.direct,
            "sections": [
                {"pole": pole, "residue": residue}
                for pole, residue in zip(sections.poles, sections.residues, strict=True)
            ],
        },
        **({"band_note": controller.band_note} if controller.band_note else {}),
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
