"""What people begin with:  the first steps, `fopi init`, and the schema for editors.

A commented spec comes from an example, a transfer function or recordings.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune.cli.gains import number_option
from fopi_tune.cli.output import bad_input, in_options, reason_of, say
from fopi_tune.core.text_tables.words import TimeUnit
from fopi_tune.errors import DomainError
from fopi_tune.results.saved.writing import obstacle, to_json, write_file

if TYPE_CHECKING:
    from fopi_tune.identification import FitModel, ReadOptions, Recording
    from fopi_tune.spec.templates.sections import TemplateSections

#: file of the JSON Schema beside a spec, which the spec's first line names
SCHEMA_FILE = "fopi.schema.json"
#: what `fopi` alone prints
FIRST_STEPS = """\
fopi finds the gains of PI, PID and fractional-order controllers that meet a spec for every plant of a family, and
proves that they do.  First steps:

  fopi init               write design.yaml, a commented spec to start from
  fopi tune design.yaml   find its gains, and prove its requirements
  fopi run design.yaml    also make C code and a page to read: results/design/report.html

`fopi --help` lists all commands, `fopi COMMAND --help` the options of one."""


class Model(Enum):
    """The plant models of `--plant`; a test compares them with those of the spec language."""

    LAG = "lag"
    POLE = "pole"
    TRANSFER_FUNCTION = "transfer_function"


class Fitted(Enum):
    """The models of `--model`; a test compares them with those that can be fitted."""

    LAG = "lag"
    SECOND_ORDER = "second_order"
    INTEGRATOR = "integrator"
    AUTO = "auto"


NameArgument = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="NAME",
        show_default=False,
        help="Name of the design; `design` when left out.  After --from-step-data, more .csv files too.",
    ),
]
PlantOption = Annotated[Model | None, typer.Option("--plant", help="Model of the plant; lag when left out.")]
FromTfOption = Annotated[
    str | None,
    typer.Option(
        "--from-tf",
        metavar="TEXT",
        help="The plant as a transfer function of s: a formula, tf(…), zpk(…), or what MATLAB prints.",
    ),
]
StepDataOption = Annotated[
    list[str] | None,
    typer.Option(
        "--from-step-data",
        metavar="CSV",
        help="Fit the plant to a recording of its input and output; several files: a family.",
    ),
]
FittedOption = Annotated[
    Fitted | None,
    typer.Option("--model", help="Model to fit; lag when left out, auto: the one with the least AICc."),
]
TimeOption = Annotated[
    str | None, typer.Option("--time", metavar="COLUMN", help="Column of the times, by name or number from 1.")
]
InputOption = Annotated[
    str | None, typer.Option("--input", metavar="COLUMN", help="Column of the plant's input, by name or number.")
]
OutputOption = Annotated[
    str | None, typer.Option("--output", metavar="COLUMN", help="Column of the plant's output, by name or number.")
]
SampleTimeOption = Annotated[
    float | None,
    number_option("--sample-time", metavar="TIME", help="Time from each line to the next, for files without times."),
]
UnitOption = Annotated[
    TimeUnit | None,
    typer.Option("--time-unit", help="Unit of the times and of these options; the header's or s when left out."),
]
FromOption = Annotated[
    float | None,
    number_option("--from", metavar="TIME", help="Fit the outputs from this time of the recording on."),
]
ToOption = Annotated[float | None, number_option("--to", metavar="TIME", help="Fit the outputs until this time.")]
ExampleOption = Annotated[
    str | None,
    typer.Option(
        "--example",
        metavar="NAME",
        help="Instead: write an example that ships, and the files that it names, into this folder.",
    ),
]
ListOption = Annotated[bool, typer.Option("--list", help="Print the names of the examples, and what each shows.")]
NoSchemaOption = Annotated[bool, typer.Option("--no-schema", help="Leave out the JSON Schema that editors read.")]


@dataclass(frozen=True)
class RecordingOptions:
    """What the command line says of recordings."""

    model: Fitted | None = None
    time: str | None = None
    input: str | None = None
    output: str | None = None
    sample_time: float | None = None
    time_unit: TimeUnit | None = None
    start: float | None = None
    end: float | None = None

    def to_read(self) -> ReadOptions:
        """The same for `parse_recording`."""
        from fopi_tune.identification import ReadOptions

        return ReadOptions(self.time, self.input, self.output, self.sample_time, self.time_unit, self.start, self.end)

    def to_fit(self) -> FitModel:
        """The model to fit."""
        from fopi_tune.identification import FitModel

        return FitModel((self.model or Fitted.LAG).value)


@dataclass(frozen=True)
class InitOptions:
    """Options of `fopi init`."""

    words: tuple[str, ...]
    model: Model | None
    from_tf: str | None
    recordings: tuple[str, ...]
    reading: RecordingOptions
    out: str | None
    force: bool
    schema: bool
    example: str | None = None
    list_examples: bool = False


def start(options: InitOptions) -> None:
    """Write a spec or an example, or list the examples.

    Raises:
        typer.Exit: as `write_spec` and `write_example`; options that do not go together.
    """
    if options.example is None and not options.list_examples:
        write_spec(options)
        return
    asked = InitOptions((), None, None, (), RecordingOptions(), None, options.force, options.schema)
    if replace(options, example=None, list_examples=False) != asked or (options.example and options.list_examples):
        raise bad_input("--example NAME and --list go with no other name or option than --force; leave the others out")
    from fopi_tune.cli.starting.examples import list_examples, write_example

    if options.example is None:
        raise typer.Exit(list_examples())
    write_example(options.example, options.force)


def write_spec(options: InitOptions) -> None:
    """Write a valid spec, and beside it the JSON Schema that its first line names.

    Raises:
        typer.Exit: a file that is in the way, cannot be written, or cannot be fitted; nothing was written.
    """
    from fopi_tune.spec.templates.template import template

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
        text = in_options(template(name, _plant_sections(options, recordings), SCHEMA_FILE if options.schema else None))
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
    if options.from_tf is not None and (options.recordings or options.model is not None):
        raise bad_input("--from-tf gives the plant; leave --plant and --from-step-data out")
    if options.recordings and options.model not in (None, Model.LAG):
        raise bad_input("--from-step-data fits the plant; leave --plant out, and say with --model what to fit")
    if not options.recordings and options.reading != RecordingOptions():
        raise bad_input("--model, --time, --input, --output and the like are about recordings; give --from-step-data")
    name = names[0] if names else Path(options.out).stem if options.out else "design"
    return name.removesuffix(".yaml"), options.recordings + more


# -- from a transfer function or recordings ----------------------------------------------------------------------------


def _plant_sections(options: InitOptions, recordings: tuple[str, ...]) -> TemplateSections:
    from fopi_tune.spec.templates.sections import SECTIONS_BY_MODEL

    if options.from_tf is not None:
        return _written_sections(options.from_tf)
    if not recordings:
        return SECTIONS_BY_MODEL[(options.model or Model.LAG).value]
    from fopi_tune.identification import identify_recordings

    reading = options.reading.to_read()
    found = identify_recordings([_recording(file, reading) for file in recordings], options.reading.to_fit())
    for line in found.summary():
        say(line)
    return found.sections()


def _written_sections(text: str) -> TemplateSections:
    from fopi_tune.spec.templates.written import sections_for_written
    from fopi_tune.spec.transfer_functions import from_text

    try:
        plant = from_text(text)
    except DomainError as error:
        raise bad_input(f"--from-tf: {error}") from None
    about = [f"From the transfer function {' '.join(text.split())}"]
    if plant.left_out:
        about.append(f"The common factor {plant.left_out} of numerator and denominator is left out.")
        say(about[-1])
    return sections_for_written(plant, about)


def _recording(file: str, reading: ReadOptions) -> Recording:
    from fopi_tune.core.text_tables.table import MAX_BYTES
    from fopi_tune.identification import parse_recording
    from fopi_tune.spec.files import read_text

    try:
        text = read_text(file, MAX_BYTES)
    except OSError as error:
        raise bad_input(f"cannot read {file} ({reason_of(error)}); give CSV files with --from-step-data") from None
    except DomainError as error:
        raise bad_input(f"{file}: {error}; give CSV files with --from-step-data") from None
    return parse_recording(text, file, reading)


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
        raise bad_input(f"cannot write {path} ({obstacle(path, error)}); choose another file with --out") from None
