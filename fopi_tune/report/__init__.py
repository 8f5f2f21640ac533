"""Results as text, figures and HTML pages; nothing is computed anew and nothing is written to the disk.

A name is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fopi_tune.report.figures.plots import controller_bode_svg, simulation_svg
    from fopi_tune.report.figures.tradeoff import tradeoff_svg
    from fopi_tune.report.text.certificates import recheck_text
    from fopi_tune.report.text.design import check_text, design_text
    from fopi_tune.report.text.digital import digital_text
    from fopi_tune.report.text.evidence import evidence_text, system_evidence_text
    from fopi_tune.report.text.simulation import simulation_text
    from fopi_tune.report.text.study import study_text
    from fopi_tune.report.text.system_design import system_design_text
    from fopi_tune.report.text.system_proof import system_proof_text
    from fopi_tune.report.text.tradeoff import tradeoff_text

_MODULES = {
    "check_text": "text.design",
    "controller_bode_svg": "figures.plots",
    "design_text": "text.design",
    "digital_text": "text.digital",
    "evidence_text": "text.evidence",
    "recheck_text": "text.certificates",
    "simulation_svg": "figures.plots",
    "simulation_text": "text.simulation",
    "study_text": "text.study",
    "system_design_text": "text.system_design",
    "system_evidence_text": "text.evidence",
    "system_proof_text": "text.system_proof",
    "tradeoff_svg": "figures.tradeoff",
    "tradeoff_text": "text.tradeoff",
}

__all__ = [
    "check_text",
    "controller_bode_svg",
    "design_text",
    "digital_text",
    "evidence_text",
    "recheck_text",
    "simulation_svg",
    "simulation_text",
    "study_text",
    "system_design_text",
    "system_evidence_text",
    "system_proof_text",
    "tradeoff_svg",
    "tradeoff_text",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"fopi_tune.report.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
