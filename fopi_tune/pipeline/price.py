"""Prices of limits:  Design -> Design with checked multipliers, and a sweep of one limit:  spec -> Tradeoff."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.errors import DomainError
from fopi_tune.pipeline.tune import tune
from fopi_tune.results.design import Design
from fopi_tune.results.documents import objective_name
from fopi_tune.results.status import Status
from fopi_tune.spec import load_spec
from fopi_tune.spec.load import Source

if TYPE_CHECKING:
    from fopi_tune.prices import Tradeoff


def price(design: Design) -> Design:
    """Check a design's multipliers by solving again with each limit moved a little, both ways.

    Args:
        design: a solved one.

    Returns:
        The design with a `price` for each requirement whose multiplier is not zero; unchanged unless it is solved.

    Raises:
        DomainError: another result, such as one that was loaded from a folder.
    """
    if not isinstance(design, Design):
        raise DomainError(
            f"an object of type {type(design).__name__} has no multipliers to check; give the Design that tune returns"
        )
    gains = design.gains
    if design.status is not Status.SOLVED or gains is None:
        return design
    from fopi_tune.prices.price import price_of  # loads CasADi

    reports = tuple(
        replace(report, price=price_of(design.spec, gains, k, report.multiplier))
        for k, report in enumerate(design.requirements, start=1)
    )
    first = len(reports)
    measures = tuple(
        replace(report, price=price_of(design.spec, gains, first + k, report.multiplier))
        for k, report in enumerate(design.measures, start=1)
    )
    return replace(design, requirements=reports, measures=measures)


def tradeoff(
    source: Source,
    requirement: str | int,
    *,
    start: float | None = None,
    stop: float | None = None,
    points: int = 50,
) -> Tradeoff:
    """Sweep the limit of one requirement: the best objective for each limit, up to where the spec is infeasible.

    Args:
        source: a spec file, or a spec.
        requirement: its number in the spec, from 1 on, or its quantity if that occurs once; of a `between` followed by
            ".lower" or ".upper".
        start: lowest limit, in the limit's unit; by default the spec's own limit lies in the middle between the
            infeasible end and the other end of the sweep.
        stop: highest limit, in the limit's unit.
        points: number of limits.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: there is no such requirement, no design with the spec's own limit, or no gain to choose; or the
            range makes no sense.
    """
    spec = load_spec(source)
    from fopi_tune.prices import movable_limit
    from fopi_tune.prices.sweep import SweepRange, check_range, sweep  # loads CasADi

    knob = movable_limit(spec, str(requirement))
    wanted = SweepRange(start, stop, points)
    check_range(knob, wanted)
    box = spec.controller
    box.refuse_filter_times("a sweep")
    if box.fixed is not None:
        raise DomainError(f"the spec fixes {box.names}: whatever a limit is, the gains stay; give one of them a range")
    design = tune(spec, proof=False, bracket=False)
    if design.status is not Status.SOLVED or design.gains is None:
        said = f"{design.status.value}: {design.message}" if design.message else design.status.value
        raise DomainError(f"a sweep starts from the design with the spec's own limits, which is {said}")
    return sweep(spec, knob, design.gains, wanted, objective_name(spec))
