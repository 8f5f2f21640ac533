"""Options of `fopi tune` about what requirements cost:  --prices, --tradeoff and its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune.candidate import Solver
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.prices import Tradeoff
    from fopi_tune.result import Design
    from fopi_tune.spec.model import DesignSpec

Prices = Annotated[
    bool, typer.Option("--prices", help="Check each multiplier by solving again with its limit moved both ways.")
]
Swept = Annotated[
    str | None,
    typer.Option(
        "--tradeoff",
        metavar="REQUIREMENT",
        help="Sweep this requirement's limit (by its number or quantity) and draw the objective against it.",
    ),
]
From = Annotated[float | None, typer.Option("--from", help="Lowest limit of the sweep, in the limit's unit.")]
To = Annotated[float | None, typer.Option("--to", help="Highest limit of the sweep.")]
Points = Annotated[int | None, typer.Option("--points", help="Limits in the sweep; 50 when left out.")]


@dataclass(frozen=True)
class Asked:
    """What the command line asks about prices.

    Args:
        prices: check the multipliers.
        requirement: whose limit is swept; None for none.
        start, stop, points: of the sweep; None where left out.
        solver: of the design.
    """

    prices: bool
    requirement: str | None
    start: float | None
    stop: float | None
    points: int | None
    solver: Solver = Solver.IPOPT

    def problem(self, specs: int) -> str | None:
        """What is wrong with the options together, or None."""
        if self.solver is not Solver.IPOPT and (self.prices or self.requirement is not None):
            return "--prices and --tradeoff are solved by ipopt; leave --solver out"
        if self.requirement is None:
            if (self.start, self.stop, self.points) != (None, None, None):
                return "--from, --to and --points belong to --tradeoff REQUIREMENT"
            return None
        if self.prices:
            return "--prices and --tradeoff are two runs; give one of them"
        return "--tradeoff sweeps the limit of one spec; name one SPEC" if specs != 1 else None


def designed(spec: DesignSpec, asked: Asked, proof: bool) -> Design | Tradeoff:
    """The design, with its prices where they are asked for, or the sweep.

    Raises:
        DomainError: of the sweep: there is no such requirement, or no design to start from.
    """
    from fopi_tune import pipeline

    if asked.requirement is not None:
        points = 50 if asked.points is None else asked.points
        return pipeline.tradeoff(spec, asked.requirement, start=asked.start, stop=asked.stop, points=points)
    if asked.prices and spec.digital is not None and spec.digital.designs_sampled:
        raise DomainError(pipeline.NOT_ON_SAMPLES)
    if asked.solver is not Solver.IPOPT:
        return pipeline.tune(spec, proof, asked.solver)
    design = pipeline.tune(spec) if proof else pipeline.tune(spec, proof=False)
    return pipeline.price(design) if asked.prices else design
