"""`fopi schema`:  the languages and the results as JSON Schema."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer

from fopi_tune.cli.output import bad_input, print_out
from fopi_tune.results.saved.writing import to_json


class Result(Enum):
    """The words of `--result`; a test compares them with the kinds of results."""

    DESIGN = "design"
    CHECK = "check"
    DIGITAL = "digital"
    RUN = "run"
    CERTIFICATE = "certificate"
    OPTIMUM = "optimum"
    TRADEOFF = "tradeoff"
    EVIDENCE = "evidence"
    SIMULATION = "simulation"
    SYSTEM_DESIGN = "system_design"
    SYSTEM_DIGITAL = "system_digital"
    SYSTEM_PROOF = "system_proof"
    SYSTEM_CERTIFICATE = "system_certificate"
    SYSTEM_EVIDENCE = "system_evidence"
    SYSTEM_SIMULATION = "system_simulation"
    RECHECK = "recheck"
    OPTIMUM_RECHECK = "optimum_recheck"
    SYSTEM_RECHECK = "system_recheck"
    STUDY = "study"
    STUDY_CELLS = "study_cells"
    STUDY_STATUS = "study_status"
    STUDY_PROGRESS = "study_progress"
    STUDY_BEST = "study_best"


def schema(
    system: Annotated[bool, typer.Option("--system", help="The language of systems instead.")] = False,
    result: Annotated[
        Result | None, typer.Option("--result", help="What a kind of results holds, as files or --json have it.")
    ] = None,
    study: Annotated[bool, typer.Option("--study", help="The language of studies instead.")] = False,
) -> None:
    """Print the spec language, or what results hold, as JSON Schema."""
    from fopi_tune.spec.language import json_schema
    from fopi_tune.spec.systems import system_json_schema

    if (result is not None) + system + study > 1:
        raise bad_input("--system, --study and --result are three schemas; give one of them")
    if result is not None:
        from fopi_tune.results.schema.kinds import result_schema

        raise typer.Exit(print_out(to_json(result_schema(result.value))))
    if study:
        from fopi_tune.study.load import study_json_schema

        raise typer.Exit(print_out(to_json(study_json_schema())))
    raise typer.Exit(print_out(to_json(system_json_schema() if system else json_schema())))
