"""The commands:  their arguments, and what they call."""

from __future__ import annotations

import gc
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune import __version__
from fopi_tune.cli.batch import OutputOptions, process_specs
from fopi_tune.cli.discretize import ExportOption, discretize_file
from fopi_tune.cli.gains import GivenGains, number_option
from fopi_tune.cli.logs import LogLevelOption, VerboseOption, show_log
from fopi_tune.cli.output import bad_input, print_out, report_failure
from fopi_tune.cli.prove import TOLERANCE, prove_file
from fopi_tune.cli.recheck import recheck_file
from fopi_tune.cli.simulations import SimulationOptions, parameters_from_options, simulate_file, validate_file
from fopi_tune.cli.starting.init import (
    FIRST_STEPS,
    ExampleOption,
    FittedOption,
    FromOption,
    FromTfOption,
    InitOptions,
    InputOption,
    ListOption,
    NameArgument,
    NoSchemaOption,
    OutputOption,
    PlantOption,
    RecordingOptions,
    SampleTimeOption,
    StepDataOption,
    TimeOption,
    ToOption,
    UnitOption,
    start,
)
from fopi_tune.cli.starting.schema import schema
from fopi_tune.cli.study import study
from fopi_tune.cli.tune import (
    BracketOption,
    PointsOption,
    PricesOption,
    StartOption,
    StopOption,
    TradeoffOption,
    TuneOptions,
    tune_files,
)
from fopi_tune.results.candidate import Solver

if TYPE_CHECKING:
    from fopi_tune.results.design import Run
    from fopi_tune.spec.model import DesignSpec

app = typer.Typer(
    name="fopi",
    help="Robust design of PI, PID and fractional-order controllers: a spec in, proved gains out.",
    epilog="Exit codes: 0 all requirements met and proved, 1 not met, 2 bad input, 3 the tool failed.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    invoke_without_command=True,
)

#: new objects after which Python looks for cycles among them
_COLLECTED_AFTER = 50_000
#: defaults of --certify-optimum
_GAP, _TIME_LIMIT_S = 1e-3, 60.0

Specs = Annotated[list[str], typer.Argument(metavar="SPEC", help="Spec files.")]
Out = Annotated[
    str | None,
    typer.Option(metavar="DIR", help="Folder of the results, instead of results/NAME; of several specs, DIR/NAME."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on stdout; of several specs, a list.")]
Kp = Annotated[float | None, number_option(help="Proportional gain.")]
Kd = Annotated[float | None, number_option(help="Derivative gain of pid and fopid, in kp's unit times s^mu.")]
Mu = Annotated[float | None, number_option(help="Order of the derivative of fopid, above 0 and up to 1.")]
Ki = Annotated[float | None, number_option(help="Integral gain, in kp's unit times (rad/s)^alpha.")]
Alpha = Annotated[float | None, number_option(help="Order of the integral, between 0 and 2.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No notes on stderr.")]
RequireProof = Annotated[
    bool, typer.Option("--require-proof", help="Exit with 3 where a requirement is only checked, and not proved.")
]
NoProof = Annotated[bool, typer.Option("--no-proof", help="Leave the certificate out; the result says so.")]
SolverOption = Annotated[
    Solver, typer.Option("--solver", help="What finds the gains; convex is a slower, independent second opinion.")
]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback when the tool itself fails.")]


@app.callback()
def _fopi(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=lambda wanted: _version(wanted), is_eager=True, help="Print the version."),
    ] = False,
    log_level: LogLevelOption = None,
    verbose: VerboseOption = 0,
) -> None:
    show_log(context, log_level, verbose)
    if context.invoked_subcommand is None:
        raise typer.Exit(print_out(FIRST_STEPS))


def _version(wanted: bool) -> None:
    if wanted:
        raise typer.Exit(print_out(f"fopi {__version__}"))


@app.command()
def tune(
    specs: Specs,
    prices: PricesOption = False,
    bracket: BracketOption = None,
    tradeoff: TradeoffOption = None,
    start: StartOption = None,
    stop: StopOption = None,
    points: PointsOption = None,
    out: Out = None,
    as_json: AsJson = False,
    solver: SolverOption = Solver.IPOPT,
    no_proof: NoProof = False,
    require_proof: RequireProof = False,
    certify_optimum: Annotated[
        bool,
        typer.Option("--certify-optimum", help="Prove how far the gains can be from the best; or that none exist."),
    ] = False,
    gap: Annotated[float, number_option(help="Relative gap that --certify-optimum is to reach.")] = _GAP,
    time_limit: Annotated[float, number_option(metavar="SECONDS", help="When it stops all the same.")] = _TIME_LIMIT_S,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Find the gains that meet a spec, and prove that they do.

    They meet it for every plant of its family; of a system those of the modes under `tune:`.  The result and the
    certificate are also written to files.
    """
    tune_options = TuneOptions(prices, tradeoff, start, stop, points, solver, bracket)
    problem = tune_options.problem(len(specs))
    if problem is not None:
        raise bad_input(problem)
    if not certify_optimum and (gap != _GAP or time_limit != _TIME_LIMIT_S):
        raise bad_input("--gap and --time-limit belong to --certify-optimum")
    if certify_optimum and not (gap > 0.0 and time_limit > 0.0):
        raise bad_input("--gap and --time-limit must be greater than 0")
    if certify_optimum and tradeoff is not None:
        raise bad_input("--certify-optimum is about one design and --tradeoff about many; give one of them")
    options = OutputOptions(out, as_json, quiet, debug, len(specs) > 1, require_proof)
    certified = (gap, time_limit) if certify_optimum else None
    raise typer.Exit(tune_files(specs, tune_options, not no_proof, certified, options))


@app.command()
def run(
    specs: Specs,
    out: Out = None,
    as_json: AsJson = False,
    no_proof: NoProof = False,
    require_proof: RequireProof = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Run every stage on a spec, and write the report.

    Stages: design, proof, digital controller, the proof of its loop, C code.

    Without a section `digital` that is what `fopi tune` does, and the report.
    """

    def compute(spec: DesignSpec) -> Run:
        from fopi_tune.pipeline.run import run

        return run(spec, not no_proof)

    options = OutputOptions(out, as_json, quiet, debug, len(specs) > 1, require_proof)
    raise typer.Exit(process_specs(specs, compute, options, "running"))


@app.command()
def report(
    specs: Annotated[
        list[str], typer.Argument(metavar="SPEC", help="Spec or system files, or folders of their results.")
    ],
    compare: Annotated[
        bool, typer.Option("--compare", help="One page with all of them side by side, in results/compare.")
    ] = False,
    out: Out = None,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Make reports again from results.

    From the results that `fopi run` and `fopi validate` left, or the certificate of `fopi prove SYSTEM`.

    The results must be of the spec as it is; a folder holds its own.  Prints where the report is.  With --compare also
    folders that `fopi tune` or `fopi prove` filled, or the design.json or check.json in them.
    """
    if compare:
        from fopi_tune.cli.report_command import compare_results

        raise typer.Exit(compare_results(specs, OutputOptions(out, False, quiet, debug)))
    from fopi_tune.cli.report_command import remake_reports

    raise typer.Exit(remake_reports(specs, OutputOptions(out, False, quiet, debug, len(specs) > 1)))


@app.command()
def prove(
    spec: Annotated[str | None, typer.Argument(metavar="[SPEC]", help="Spec or system file.")] = None,
    kp: Kp = None,
    ki: Ki = None,
    alpha: Alpha = None,
    kd: Kd = None,
    mu: Mu = None,
    tolerance: Annotated[
        float, number_option(help="How far a requirement may be missed, neper or radian; a delay margin's is relative.")
    ] = TOLERANCE,
    recheck: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Check a certificate instead; with SPEC, also that it is about that spec."),
    ] = None,
    require_proof: RequireProof = False,
    out: Out = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Prove or refute that gains meet a spec.

    For every plant and every frequency.

    The gains may come from anywhere; the ranges that the spec gives them are not looked at.  Without --kp, --ki and
    --alpha they are those of DIR/design.json if it is of this spec, and are tuned otherwise.

    Of a system it is proved that it settles, or that it ends in a cycle; undecided is exit code 3.
    """
    options = OutputOptions(out, as_json, quiet, debug, require_proof=require_proof)
    if recheck is not None:
        if any(gain is not None for gain in (kp, ki, alpha, kd, mu)):
            raise bad_input("--recheck takes the gains from the certificate; leave --kp, --ki, --alpha, --kd, --mu out")
        raise typer.Exit(recheck_file(recheck, spec, options))
    if spec is None:
        raise bad_input("there is no SPEC to prove; name a spec file, or a certificate with --recheck")
    raise typer.Exit(prove_file(spec, GivenGains(kp, ki, alpha, kd, mu), tolerance, options))


@app.command()
def discretize(
    spec: Annotated[str, typer.Argument(metavar="SPEC", help="Spec file with a section `digital`, or a system.")],
    kp: Kp = None,
    ki: Ki = None,
    alpha: Alpha = None,
    kd: Kd = None,
    mu: Mu = None,
    export: ExportOption = None,
    out: Out = None,
    as_json: AsJson = False,
    no_proof: NoProof = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Turn gains into a digital controller, and prove its loop.

    Says what the loop on samples keeps of the requirements, and exports C.

    Gains are taken as `fopi prove` takes them, those of a system from its file.  A system's C code has both controllers
    and how they take turns; nothing is proved of it here.
    """
    options = OutputOptions(out, as_json, quiet, debug)
    raise typer.Exit(discretize_file(spec, GivenGains(kp, ki, alpha, kd, mu), not no_proof, options, export or ()))


@app.command()
def validate(
    spec: Annotated[str, typer.Argument(metavar="SPEC", help="Spec file with a section `digital`, or a system.")],
    kp: Kp = None,
    ki: Ki = None,
    alpha: Alpha = None,
    kd: Kd = None,
    mu: Mu = None,
    samples: Annotated[int | None, typer.Option(help="Plants to draw, in place of the spec's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the draw, in place of the spec's.")] = None,
    out: Out = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Draw plants and say how often everything holds.

    With intervals: how often the digital controller's loop meets requirements and limits.

    Gains are taken as `fopi prove` takes them, those of a system from its file.
    """
    options = OutputOptions(out, as_json, quiet, debug)
    raise typer.Exit(validate_file(spec, GivenGains(kp, ki, alpha, kd, mu), samples, seed, options))


@app.command()
def simulate(
    spec: Annotated[
        str, typer.Argument(metavar="SPEC", help="Spec file, or a system; without scenarios a default one.")
    ],
    kp: Kp = None,
    ki: Ki = None,
    alpha: Alpha = None,
    kd: Kd = None,
    mu: Mu = None,
    scenario: Annotated[str | None, typer.Option(metavar="NAME", help="Only this scenario.")] = None,
    plant: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="An uncertain number; nominal where left out.")
    ] = None,
    member: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of a list of plants; the first if left out.")
    ] = None,
    replay: Annotated[int | None, typer.Option(metavar="INDEX", help="A plant that `fopi validate` drew.")] = None,
    exact: Annotated[
        bool, typer.Option("--exact", help="The loop in continuous time instead, without filter and samples.")
    ] = False,
    accuracy: Annotated[
        float | None,
        number_option(metavar="VALUE", help="With --exact: refine it to this, in the output's unit."),
    ] = None,
    samples: Annotated[int | None, typer.Option(help="For --replay: as `fopi validate` was given it.")] = None,
    seed: Annotated[int | None, typer.Option(help="In place of the spec's; as `fopi validate` was given it.")] = None,
    out: Out = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Drive one plant through a spec's or a system's scenarios.

    With the digital controllers' own arithmetic.

    Gains are taken as `fopi prove` takes them, those of a system from its file.  The signals are written to a CSV file
    and a figure a scenario.
    """
    options = OutputOptions(out, as_json, quiet, debug)
    numbers = parameters_from_options(plant or [])
    selection = SimulationOptions(scenario, numbers, replay, samples, seed, exact, accuracy, member)
    selection.refuse_contradictions()
    raise typer.Exit(simulate_file(spec, GivenGains(kp, ki, alpha, kd, mu), selection, options))


app.command()(study)
app.command()(schema)


@app.command()
def init(
    words: NameArgument = None,
    plant: PlantOption = None,
    from_tf: FromTfOption = None,
    from_step_data: StepDataOption = None,
    model: FittedOption = None,
    time: TimeOption = None,
    input: InputOption = None,
    output: OutputOption = None,
    sample_time: SampleTimeOption = None,
    time_unit: UnitOption = None,
    first: FromOption = None,
    last: ToOption = None,
    example: ExampleOption = None,
    list_examples: ListOption = False,
    out: Annotated[str | None, typer.Option("--out", "-o", metavar="FILE", help="File, instead of NAME.yaml.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    no_schema: NoSchemaOption = False,
) -> None:
    """Write a commented spec to start from.

    Beside it the JSON Schema, with which editors complete and check it.

    With --from-tf its plant is a transfer function as people write or print it.
    With --from-step-data its plant is fitted to recordings: CSV files with any columns and any input that moves.
    With --example it is one of those that ship; --list has their names.
    """
    recordings = tuple(from_step_data or ())
    reading = RecordingOptions(model, time, input, output, sample_time, time_unit, first, last)
    names, with_schema = tuple(words or ()), not no_schema
    start(InitOptions(names, plant, from_tf, recordings, reading, out, force, with_schema, example, list_examples))


def main() -> None:
    """Entry point of the command `fopi`."""
    # to look for cycles in what is imported is a tenth of a short command's time
    gc.set_threshold(_COLLECTED_AFTER, 20, 100)
    try:
        app(prog_name="fopi")
    except Exception as error:
        sys.exit(report_failure("fopi", error, "--debug" in sys.argv))
