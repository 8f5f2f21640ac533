"""`fopi init`:  a commented spec, from an example or from recorded step responses, and the schema that editors read."""

from __future__ import annotations

import os
import textwrap
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune.cli.output import bad_input, reason_of, say, to_json, write_file
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.identify import Interval, LagFit, Recording
    from fopi_tune.spec.template_sections import TemplateSections

#: file of the JSON Schema beside a spec, which the spec's first line names
SCHEMA_FILE = "fopi.schema.json"


class Model(Enum):
    """The plant models of `--plant`; a test compares them with those of the spec language."""

    LAG = "lag"
    POLE = "pole"
    TRANSFER_FUNCTION = "transfer_function"


NameArgument = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="NAME",
        show_default=False,
        help="Name of the design; `design` when left out.  After --from-step-data, more .csv files too.",
    ),
]
PlantOption = Annotated[Model | None, typer.Option("--plant", help="Model of the plant; lag when left out.")]
StepDataOption = Annotated[
    list[str] | None,
    typer.Option(
        "--from-step-data",
        metavar="CSV",
        help="Fit a lag with dead time to a step response, columns time_s,input,output; several files: a family.",
    ),
]
NoSchemaOption = Annotated[bool, typer.Option("--no-schema", help="Leave out the JSON Schema that editors read.")]


@dataclass(frozen=True)
class InitOptions:
    """Options of `fopi init`."""

    words: tuple[str, ...]
    model: Model | None
    recordings: tuple[str, ...]
    out: str | None
    force: bool
    schema: bool


def write_spec(options: InitOptions) -> None:
    """Write a valid spec, and beside it the JSON Schema that its first line names.

    Raises:
        typer.Exit: a file that is in the way, cannot be written, or cannot be fitted; nothing was written.
    """
    from fopi_tune.spec.template import template

    name, recordings = _name_and_recordings(options)
    path = Path(options.out or f"{name}.yaml")
    if path.is_dir():
        raise bad_input(f"{path} is a folder; give a file's name with --out")
    if os.path.lexists(path) and not options.force:
        raise bad_input(f"{path} exists already; choose another name, or overwrite it with --force")
    beside = path.parent / SCHEMA_FILE
    if options.schema:
        _check_schema_file(beside, options.force)
    try:
        text = template(name, _plant_sections(options.model, recordings), SCHEMA_FILE if options.schema else None)
    except DomainError as error:
        raise bad_input(str(error)) from None
    if options.schema:
        _write(beside, _schema_text())
    _write(path, text)
    say(f"wrote {path}; next: fopi run {path}")


def _name_and_recordings(options: InitOptions) -> tuple[str, tuple[str, ...]]:
    """The design's name and all recordings; of *.csv the option takes the first file, the rest arrive as names."""
    more = tuple(word for word in options.words if options.recordings and word.lower().endswith(".csv"))
    names = [word for word in options.words if word not in more]
    if len(names) > 1:
        hint = "" if options.recordings else "; recordings go after --from-step-data"
        raise bad_input(f"{len(names)} names are given, {names[0]} and {names[1]}; a spec has one{hint}")
    if options.recordings and options.model not in (None, Model.LAG):
        raise bad_input("--from-step-data fits a lag; leave --plant out")
    name = names[0] if names else Path(options.out).stem if options.out else "design"
    return name.removesuffix(".yaml"), options.recordings + more


# -- from recordings ---------------------------------------------------------------------------------------------------


def _plant_sections(model: Model | None, recordings: tuple[str, ...]) -> TemplateSections:
    from fopi_tune.spec.template_sections import SECTIONS_BY_MODEL, sections_for_fitted_lag

    if not recordings:
        return SECTIONS_BY_MODEL[(model or Model.LAG).value]
    from fopi_tune.identify import identify_lag

    family = identify_lag([_recording(file) for file in recordings])
    about = [line for fit in family.fits for line in _fit_summary(fit)]
    for line in about:
        say(line)
    hull = "Each range holds the 95 % intervals of these fits, y0 + static_gain step (1 - e^(-(t - dead_time_s) / "
    lines = [
        *about,
        f"{hull}time_constant_s)) after the step; nominal is the median of the fitted values.",
        "The dead time's upper end is for a step right after the last line with the old input, its fitted value for "
        "one at the first line with the new input: the recording does not show which.",
    ]
    wrapped = [part for line in lines for part in textwrap.wrap(_printable(line), 116, subsequent_indent="  ")]
    return sections_for_fitted_lag(family.static_gain, family.time_constant_s, family.dead_time_s, wrapped)


def _recording(file: str) -> Recording:
    from fopi_tune.identify import parse_recording
    from fopi_tune.identify.recording import MAX_BYTES
    from fopi_tune.spec.files import read_text

    try:
        text = read_text(file, MAX_BYTES)
    except OSError as error:
        raise bad_input(f"cannot read {file} ({reason_of(error)}); give CSV files with --from-step-data") from None
    except DomainError as error:
        raise bad_input(f"{file}: {error}; give CSV files with --from-step-data") from None
    return parse_recording(text, file)


def _fit_summary(fit: LagFit) -> list[str]:
    def shown(value: Interval, unit: str = "") -> str:
        return f"{value.value:.5g} ({value.low:.5g} ... {value.high:.5g}){unit}"

    numbers = (
        f"{fit.name}: static gain {shown(fit.static_gain)}, time constant {shown(fit.time_constant_s, ' s')}, "
        f"dead time {shown(fit.dead_time_s, ' s')}, noise {fit.residual_std:.3g}"
    )
    return [numbers, *(f"{fit.name}: {note}" for note in fit.notes)]


def _printable(line: str) -> str:
    """A line with its control characters escaped."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)


# -- files -------------------------------------------------------------------------------------------------------------


def _schema_text() -> str:
    from fopi_tune.spec.language import json_schema

    return to_json(json_schema()) + "\n"


def _check_schema_file(path: Path, force: bool) -> None:
    """Refuse to replace a file that is not a schema of this tool; an older schema is replaced."""
    from fopi_tune.spec.files import read_json

    if force or not os.path.lexists(path):
        return
    try:
        found = read_json(path)
        ours = isinstance(found, dict) and str(found.get("title", "")).startswith("fopi-tune spec")
    except (OSError, DomainError):
        ours = False
    if not ours:
        raise bad_input(f"{path} exists already and is no schema of fopi; move it, use --force, or add --no-schema")


def _write(path: Path, text: str) -> None:
    try:
        write_file(path, text)
    except OSError as error:
        raise bad_input(f"cannot write {path} ({reason_of(error)}); choose another file with --out") from None
