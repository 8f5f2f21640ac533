"""Options of `fopi tune` beyond the design itself:  --prices, --tradeoff and its range, --certify-optimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune.cli.batch import OutputOptions, process_specs_or_systems
from fopi_tune.cli.gains import number_option
from fopi_tune.cli.output import Exit, progress_bar
from fopi_tune.errors import DomainError
from fopi_tune.results.candidate import Solver

if TYPE_CHECKING:
    from fopi_tune.cli.result_files import Result
    from fopi_tune.prices import Tradeoff
    from fopi_tune.results.design import Design
    from fopi_tune.spec.model import DesignSpec, SystemSpec

PricesOption = Annotated[
    bool, typer.Option("--prices", help="Check each multiplier by solving again with its limit moved both ways.")
]
BracketOption = Annotated[
    bool | None,
    typer.Option(
        "--bracket/--no-bracket",
        show_default=False,
        help="Bound in floating point how much better any other gains can be; done when left out.",
    ),
]
TradeoffOption = Annotated[
    str | None,
    typer.Option(
        "--tradeoff",
        metavar="REQUIREMENT",
        help="Sweep this requirement's limit (by its number or quantity) and draw the objective against it.",
    ),
]
StartOption = Annotated[float | None, number_option("--from", help="Lowest limit of the sweep, in the limit's unit.")]
StopOption = Annotated[float | None, number_option("--to", help="Highest limit of the sweep.")]
PointsOption = Annotated[int | None, typer.Option("--points", help="Limits in the sweep; 50 when left out.")]


@dataclass(frozen=True)
class TuneOptions:
    """Options of `fopi tune`: multipliers, the trade-off sweep and the solver.

    Args:
        prices: whether the multipliers are checked.
        requirement: whose limit is swept; None for none.
        start, stop, points: of the sweep; None where left out.
        solver: of the design.
        bracket: whether to bound how much better any other gains can be; None, when left out, where there is a bound.
    """

    prices: bool
    requirement: str | None
    start: float | None
    stop: float | None
    points: int | None
    solver: Solver = Solver.IPOPT
    bracket: bool | None = None

    def problem(self, specs: int) -> str | None:
        """Why the options cannot be combined, or None."""
        if self.solver is not Solver.IPOPT and (self.prices or self.requirement is not None):
            return "--prices and --tradeoff are solved by ipopt; leave --solver out"
        if self.bracket and (self.solver is not Solver.IPOPT or self.requirement is not None):
            return "--bracket belongs to one design by ipopt; leave --solver and --tradeoff out"
        if self.requirement is None:
            if (self.start, self.stop, self.points) != (None, None, None):
                return "--from, --to and --points belong to --tradeoff REQUIREMENT"
            return None
        if self.prices:
            return "--prices and --tradeoff are two runs; give one of them"
        return "--tradeoff sweeps the limit of one spec; name one SPEC" if specs != 1 else None


def design_or_sweep(spec: DesignSpec, options: TuneOptions, proof: bool) -> Design | Tradeoff:
    """The design, with checked multipliers if requested, or the sweep.

    Raises:
        DomainError: of the sweep: there is no such requirement, or no design to start from; or of a bound that cannot
            be had.
    """
    from fopi_tune.pipeline.price import price, tradeoff
    from fopi_tune.pipeline.tune import tune

    if options.requirement is not None:
        points = 50 if options.points is None else options.points
        return tradeoff(spec, options.requirement, start=options.start, stop=options.stop, points=points)
    if options.bracket and spec.is_measured:
        raise DomainError("there is no bound of gains for measured responses; leave --bracket out")
    if options.bracket and spec.designs_scenarios:
        raise DomainError("there is no bound of gains for what scenarios measure; leave --bracket out")
    if options.solver is not Solver.IPOPT:
        return tune(spec, proof, options.solver)
    design = tune(spec, proof, bracket=options.bracket is not False)
    return price(design) if options.prices else design


def tune_files(
    files: Sequence[str],
    options: TuneOptions,
    proof: bool,
    certified: tuple[float, float] | None,
    output: OutputOptions,
) -> Exit:
    """Run `fopi tune`: design each spec or system, or sweep a limit; write and print the results.

    Args:
        files: specs and systems.
        options: of the design.
        proof: whether to prove it.
        certified: gap and time limit, s, of the proof of the optimum; None without one.
        output: where results go.
    """

    def compute(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.results.design import Design
        from fopi_tune.spec.model import SystemSpec

        if isinstance(loaded, SystemSpec):
            from fopi_tune.pipeline.tune_system import tune_system

            if options != TuneOptions(False, None, None, None, None) or certified is not None or not proof:
                raise DomainError("a system is designed by simulation and checked; leave the other options out")
            return tune_system(loaded)
        if certified is not None:
            from fopi_tune.pipeline.optimum import refuse_without_bound

            refuse_without_bound(loaded)
        found = design_or_sweep(loaded, options, proof)
        if certified is not None and isinstance(found, Design):
            return with_optimum(found, *certified, output)
        return found

    activity = "tuning" if options.requirement is None else "sweeping"
    return process_specs_or_systems(files, compute, output, activity)


def with_optimum(design: Design, gap: float, time_limit_s: float, output_options: OutputOptions) -> Design:
    """The design with a proved bound of the optimum; of an infeasible design, with the result of proving infeasibility.

    Raises:
        DomainError: a gap or a limit that is not positive.
    """
    from fopi_tune.pipeline.optimum import certify_optimum

    status = design.status.value
    if status not in ("solved", "infeasible"):
        output_options.note(f"{design.spec.name}: {status}, so there is no optimum to certify")
        return design
    output_options.note(f"{design.spec.name}: certifying the optimum ...")
    with progress_bar("boxes", output_options.quiet) as bar:
        progress_callback = None if bar is None else lambda done, left: bar(done, done + left)
        found = certify_optimum(
            design.spec,
            design.gains if status == "solved" else None,
            gap=gap,
            time_limit_s=time_limit_s,
            progress=progress_callback,
        )
    return replace(design, optimum=found)
