"""The commands:  their arguments, and what they call."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune import __version__
from fopi_tune.cli.certificates import gains_of_earlier_design, recheck_file
from fopi_tune.cli.output import Exit, print_out, reason_of, report_failure, say, to_json, write_file
from fopi_tune.cli.process import Handling, process
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.result import Check, Design, Discretized
    from fopi_tune.spec.model import DesignSpec

app = typer.Typer(
    name="fopi",
    help="Robust fractional-order PI design: a spec in, gains that are proved for every plant of the family out.",
    epilog="Exit codes: 0 all requirements met and proved, 1 not met, 2 bad input, 3 the tool failed.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
)

Specs = Annotated[list[str], typer.Argument(metavar="SPEC", help="Spec files.")]
Out = Annotated[
    str | None,
    typer.Option(metavar="DIR", help="Folder of the results, instead of results/NAME; of several specs, DIR/NAME."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on stdout; of several specs, a list.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No notes on stderr.")]
NoProof = Annotated[bool, typer.Option("--no-proof", help="Leave the certificate out; the result says so.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback when the tool itself fails.")]


@app.callback()
def _fopi(
    version: Annotated[
        bool,
        typer.Option("--version", callback=lambda wanted: _version(wanted), is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


def _version(wanted: bool) -> None:
    if wanted:
        raise typer.Exit(print_out(f"fopi {__version__}"))


@app.command()
def tune(
    specs: Specs,
    out: Out = None,
    as_json: AsJson = False,
    no_proof: NoProof = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Find the gains that meet a spec, and prove that they do.

    They meet it for every plant of its family.  The result and the certificate are also written to files.
    """
    _tune(specs, Handling("design.json", out, as_json, quiet, debug, len(specs) > 1), not no_proof)


@app.command()
def run(
    specs: Specs,
    out: Out = None,
    as_json: AsJson = False,
    no_proof: NoProof = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Run every stage there is on a spec.

    In this version that is what `fopi tune` does.
    """
    _tune(specs, Handling("design.json", out, as_json, quiet, debug, len(specs) > 1), not no_proof)


@app.command()
def prove(
    spec: Annotated[str | None, typer.Argument(metavar="[SPEC]", help="Spec file.")] = None,
    kp: Annotated[float | None, typer.Option(help="Proportional gain.")] = None,
    ki: Annotated[float | None, typer.Option(help="Integral gain, in kp's unit times (rad/s)^alpha.")] = None,
    alpha: Annotated[float | None, typer.Option(help="Order of the integral, between 0 and 2.")] = None,
    tolerance: Annotated[
        float, typer.Option(help="How far a requirement may be missed, neper or radian; a delay margin's is relative.")
    ] = 1e-6,
    recheck: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Check a certificate instead; with SPEC, also that it is about that spec."),
    ] = None,
    out: Out = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Prove or refute that gains meet a spec, for every plant and every frequency.

    The gains may come from anywhere; the ranges that the spec gives them are not looked at.  Without --kp, --ki and
    --alpha they are those of DIR/design.json if it is of this spec, and are tuned otherwise.
    """
    handling = Handling("check.json", out, as_json, quiet, debug)
    given = (kp, ki, alpha)
    if recheck is not None:
        if any(gain is not None for gain in given):
            raise _refusal("--recheck takes the gains from the certificate; leave --kp, --ki and --alpha out")
        raise typer.Exit(recheck_file(recheck, spec, handling))
    if spec is None:
        raise _refusal("there is no SPEC to prove; name a spec file, or a certificate with --recheck")
    if any(gain is None for gain in given) and any(gain is not None for gain in given):
        raise _refusal("give --kp, --ki and --alpha all three, or none of them")

    def make(loaded: DesignSpec) -> Check | Design:
        from fopi_tune import pipeline
        from fopi_tune.core.controller import FoPi

        if kp is not None and ki is not None and alpha is not None:
            return pipeline.prove(loaded, FoPi(kp, ki, alpha), tolerance)
        gains = gains_of_earlier_design(loaded, handling)
        if gains is None:
            handling.note(f"{loaded.name}: no gains given, and no design of this spec there; tuning first ...")
            design = pipeline.tune(loaded, proof=False)
            if design.gains is None or design.status.value != "solved":
                return design
            gains = design.gains
        return pipeline.prove(loaded, gains, tolerance)

    raise typer.Exit(process([spec], make, handling, "proving"))


@app.command()
def discretize(
    spec: Annotated[str, typer.Argument(metavar="SPEC", help="Spec file with a section `digital`.")],
    kp: Annotated[float | None, typer.Option(help="Proportional gain.")] = None,
    ki: Annotated[float | None, typer.Option(help="Integral gain, in kp's unit times (rad/s)^alpha.")] = None,
    alpha: Annotated[float | None, typer.Option(help="Order of the integral, between 0 and 2.")] = None,
    out: Out = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Turn gains into a filter at the spec's sample time, and measure how far it is from the ideal controller.

    Gains are taken as `fopi prove` takes them.  The sampled loop is not verified in this version.
    """
    handling = Handling("digital.json", out, as_json, quiet, debug)
    given = (kp, ki, alpha)
    if any(gain is None for gain in given) and any(gain is not None for gain in given):
        raise _refusal("give --kp, --ki and --alpha all three, or none of them")

    def make(loaded: DesignSpec) -> Discretized | Design:
        from fopi_tune import pipeline
        from fopi_tune.core.controller import FoPi

        if kp is not None and ki is not None and alpha is not None:
            return pipeline.discretize(loaded, FoPi(kp, ki, alpha))
        gains = gains_of_earlier_design(loaded, handling)
        if gains is None:
            handling.note(f"{loaded.name}: no gains given, and no design of this spec there; tuning first ...")
            design = pipeline.tune(loaded, proof=False)
            if design.gains is None or design.status.value != "solved":
                return design
            gains = design.gains
        return pipeline.discretize(loaded, gains)

    raise typer.Exit(process([spec], make, handling, "discretizing"))


@app.command()
def schema() -> None:
    """Print the spec language as JSON Schema."""
    from fopi_tune.spec.schema import json_schema

    raise typer.Exit(print_out(to_json(json_schema())))


@app.command()
def init(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Name of the design; `design` when left out.")
    ] = None,
    out: Annotated[str | None, typer.Option("--out", "-o", metavar="FILE", help="File, instead of NAME.yaml.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
) -> None:
    """Write a commented spec to start from."""
    from fopi_tune.spec.template import template

    if name is None:
        name = Path(out).stem if out else "design"
    name = name.removesuffix(".yaml")
    path = Path(out or f"{name}.yaml")
    try:
        text = template(name)
    except DomainError as error:
        raise _refusal(str(error)) from None
    if path.is_dir():
        raise _refusal(f"{path} is a folder; give a file's name with --out")
    if os.path.lexists(path) and not force:
        raise _refusal(f"{path} exists already; choose another name, or overwrite it with --force")
    try:
        write_file(path, text)
    except OSError as error:
        raise _refusal(f"cannot write {path} ({reason_of(error)}); choose another file with --out") from None
    say(f"wrote {path}; next: fopi tune {path}")


def main() -> None:
    """Entry point of the command `fopi`."""
    try:
        app(prog_name="fopi")
    except Exception as error:
        sys.exit(report_failure("fopi", error, "--debug" in sys.argv))


def _tune(files: Sequence[str], handling: Handling, proof: bool) -> None:
    def make(spec: DesignSpec) -> Design:
        from fopi_tune.pipeline import tune

        return tune(spec) if proof else tune(spec, proof=False)

    raise typer.Exit(process(files, make, handling, "tuning"))


def _refusal(words: str) -> typer.Exit:
    say(words)
    return typer.Exit(Exit.BAD_INPUT)
