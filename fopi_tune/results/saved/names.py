"""Names of the files of results."""

DESIGN, CHECK, DIGITAL = "design.json", "check.json", "digital.json"
CERTIFICATE, DIGITAL_CERTIFICATE = "certificate.json", "digital_certificate.json"
#: the certificate of an optimum
OPTIMUM = "optimum.json"
#: the folder of the exported C code, and the figure of the controller
CODE_FOLDER, CONTROLLER_FIGURE = "c", "controller.svg"
#: the folder of other export formats
TARGETS_FOLDER = "targets"
EVIDENCE = "evidence.json"
#: the gains designed for a system
SYSTEM_DESIGN = "system_design.json"
#: the digital controllers of a system
SYSTEM_DIGITAL = "system_digital.json"
#: what is proved of a system
SYSTEM_PROOF, SYSTEM_CERTIFICATE = "system_proof.json", "system_certificate.json"
#: the page of what is proved of a system, and its figures
SYSTEM_REPORT = "system_report.html"
#: figures of scenarios, on either page; there may be fewer
_SCENARIO_FIGURES = tuple(f"scenario_{k}" for k in range(1, 7))
SYSTEM_FIGURES = ("orbit", "region", *_SCENARIO_FIGURES)
#: prefixes of the files of simulations: of the sampled loop, and in continuous time
SIMULATION, EXACT = "simulation", "exact"
#: a copy of the spec of a result
SPEC = "spec.yaml"
#: the report of a run, and the folder of its figures
REPORT, FIGURES_FOLDER = "report.html", "figures"
#: names of a report's figures; a report may have fewer
REPORT_FIGURES = (
    "bode", "nyquist", "sensitivities", "responses", "margins", "digital", "plants", *_SCENARIO_FIGURES,
)  # fmt: skip
#: the page that compares designs, and its folder
COMPARISON_PAGE, COMPARISON_FOLDER = "compare.html", "compare"
#: prefix of the files of a sweep: .json, .csv and .svg
TRADEOFF = "tradeoff"


def simulation_kind(exact: bool) -> str:
    """The prefix of the files of a simulation."""
    return EXACT if exact else SIMULATION
