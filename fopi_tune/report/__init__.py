"""Results as text, figures and HTML pages; nothing is computed anew and nothing is written to the disk."""

from fopi_tune.report.figures.plots import controller_bode_svg, simulation_svg
from fopi_tune.report.text.certificates import recheck_text
from fopi_tune.report.text.design import check_text, design_text
from fopi_tune.report.text.digital import digital_text
from fopi_tune.report.text.evidence import evidence_text, system_evidence_text
from fopi_tune.report.text.simulation import simulation_text
from fopi_tune.report.text.study import study_text
from fopi_tune.report.text.system_design import system_design_text
from fopi_tune.report.text.system_proof import system_proof_text
from fopi_tune.report.text.tradeoff import tradeoff_svg, tradeoff_text

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
