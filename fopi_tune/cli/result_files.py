"""Files of a result:  result -> (file name in the folder of results, content), in the order of writing.

The spec is written first and the document that states the gains last.  Whenever writing ends early, a design with its
own spec beside it means that all its other files are there, of this result; every other state is refused or told.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from fopi_tune.cli.output import to_json

if TYPE_CHECKING:
    from fopi_tune.prices import Tradeoff
    from fopi_tune.results.design import Check, Design, Discretized, Run, Validated
    from fopi_tune.results.proved_system import ProvedSystem
    from fopi_tune.results.simulation import ScenarioResult, Simulated
    from fopi_tune.results.system import DiscretizedSystem, SimulatedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem

    Result = (
        Design | Check | Discretized | Run | Validated | Simulated | Tradeoff | SimulatedSystem | ValidatedSystem
        | DesignedSystem | ProvedSystem | DiscretizedSystem
    )  # fmt: skip

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
SYSTEM_REPORT, SYSTEM_FIGURES = (
    "system_report.html",
    ("orbit", "region", *(f"scenario_{k}" for k in range(1, 7))),
)
#: prefixes of the files of simulations: of the sampled loop, and in continuous time
SIMULATION, EXACT = "simulation", "exact"
#: a copy of the spec of a result
SPEC = "spec.yaml"
#: the report of a run, and the folder of its figures
REPORT, FIGURES_FOLDER = "report.html", "figures"
#: names of a report's figures; a report may have fewer
REPORT_FIGURES = (
    "bode", "nyquist", "sensitivities", "responses", "margins", "digital", "plants",
    *(f"scenario_{k}" for k in range(1, 7)),
)  # fmt: skip
#: the page that compares designs, and its folder
COMPARISON_PAGE, COMPARISON_FOLDER = "compare.html", "compare"
#: prefix of the files of a sweep: .json, .csv and .svg
TRADEOFF = "tradeoff"


def files_of(result: Result) -> Iterator[tuple[str, str | bytes]]:
    """The files of a result.

    Raises:
        DomainError: the controller cannot be exported as code.
    """
    from fopi_tune.results.design import Check, Design, Discretized, Run

    if isinstance(result, Design | Check):
        yield from _design_files(result)
    elif isinstance(result, Run):
        of_design = dict(files_of(result.design))
        if SPEC in of_design:
            yield SPEC, of_design.pop(SPEC)
        if result.digital is not None:
            yield from files_of(result.digital)
        yield from of_design.items()
    elif isinstance(result, Discretized):
        yield from _code_files(result)
        yield CONTROLLER_FIGURE, _controller_figure(result)
        yield from _certificate_file(result, DIGITAL_CERTIFICATE)
        yield DIGITAL, to_json(result.to_dict()) + "\n"
    else:
        yield from _other_files(result)


def _design_files(result: Design | Check) -> Iterator[tuple[str, str | bytes]]:
    from fopi_tune.results.design import Check

    if result.spec.source:
        yield SPEC, result.spec.source
    yield from _certificate_file(result, CERTIFICATE)
    if not isinstance(result, Check) and (optimum := result.optimum_document()) is not None:
        yield OPTIMUM, to_json(optimum) + "\n"
    yield CHECK if isinstance(result, Check) else DESIGN, to_json(result.to_dict()) + "\n"


def _other_files(
    result: Validated | Simulated | Tradeoff | SimulatedSystem | ValidatedSystem | DesignedSystem | ProvedSystem
    | DiscretizedSystem,
) -> Iterator[tuple[str, str | bytes]]:  # fmt: skip
    """Of what is not about one design; its modules are loaded for it alone."""
    from fopi_tune.prices.result import Tradeoff
    from fopi_tune.results.design import Validated
    from fopi_tune.results.proved_system import ProvedSystem
    from fopi_tune.results.system import DiscretizedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem

    if isinstance(result, DiscretizedSystem):
        yield from ((f"{CODE_FOLDER}/{name}", text) for name, text in result.code().items())
        yield SYSTEM_DIGITAL, to_json(result.to_dict()) + "\n"
        return
    if isinstance(result, ProvedSystem):
        yield SYSTEM_CERTIFICATE, to_json(result.certificate_document()) + "\n"
        yield SYSTEM_PROOF, to_json(result.to_dict()) + "\n"
        return
    if isinstance(result, DesignedSystem):
        yield SYSTEM_DESIGN, to_json(result.to_dict()) + "\n"
        return
    if isinstance(result, Tradeoff):
        yield from _tradeoff_files(result)
        return
    if isinstance(result, Validated | ValidatedSystem):
        yield EVIDENCE, to_json(result.to_dict()) + "\n"
        return
    kind = EXACT if result.exact else SIMULATION
    yield f"{kind}.json", to_json(result.to_dict()) + "\n"
    for driven in result.driven:
        yield f"{kind}_{driven.scenario.name}.csv", _simulation_csv(driven)
        yield f"{kind}_{driven.scenario.name}.svg", _simulation_figure(result, driven)


def _certificate_file(result: Design | Check | Discretized, name: str) -> Iterator[tuple[str, str]]:
    if result.spec.is_measured:
        return
    document = result.certificate_document()
    if document is not None:
        yield name, to_json(document) + "\n"


def _code_files(result: Discretized) -> Iterator[tuple[str, str]]:
    from fopi_tune.digital import Export, export_c

    files = export_c(Export.of(result.spec, result.controller))
    yield from ((f"{CODE_FOLDER}/{name}", text) for name, text in files.items())


def _simulation_csv(driven: ScenarioResult) -> str:
    """CSV; numbers with all digits, so that they can be read back exactly."""
    from fopi_tune.results.simulation import COLUMNS

    lines = (",".join(repr(value) for value in row) for row in driven.rows())
    return "\n".join([",".join(COLUMNS), *lines]) + "\n"


def _tradeoff_files(result: Tradeoff) -> Iterator[tuple[str, str]]:
    from fopi_tune.prices.result import columns_of
    from fopi_tune.report import tradeoff_svg

    yield f"{TRADEOFF}.json", to_json(result.to_dict()) + "\n"
    lines = [",".join(columns_of(result.spec.controller)), *(",".join(row) for row in result.rows())]
    yield f"{TRADEOFF}.csv", "\n".join(lines) + "\n"
    yield f"{TRADEOFF}.svg", tradeoff_svg(result)


def _simulation_figure(result: Simulated | SimulatedSystem, driven: ScenarioResult) -> str:
    from fopi_tune.report import simulation_svg

    return simulation_svg(result, driven)


def _controller_figure(result: Discretized) -> str:
    from fopi_tune.report import controller_bode_svg

    return controller_bode_svg(result)
