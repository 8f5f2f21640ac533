"""`fopi schema`:  the languages and the results as JSON Schema."""

from __future__ import annotations

from typing import Annotated

import typer

from fopi_tune.cli.output import bad_input, print_out, to_json


def schema(
    system: Annotated[bool, typer.Option("--system", help="The language of systems instead.")] = False,
    study: Annotated[bool, typer.Option("--study", help="The language of studies instead.")] = False,
) -> None:
    """Print the spec language as JSON Schema."""
    from fopi_tune.spec.language import json_schema
    from fopi_tune.spec.systems import system_json_schema

    if system and study:
        raise bad_input("--system and --study are two languages; leave one of them out")
    if study:
        from fopi_tune.study.load import study_json_schema

        raise typer.Exit(print_out(to_json(study_json_schema())))
    raise typer.Exit(print_out(to_json(system_json_schema() if system else json_schema())))
