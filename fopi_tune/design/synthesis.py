"""DesignSpec -> Candidate:  analytic infeasibility first, then the search of the whole box, then an explanation."""

from __future__ import annotations

from collections.abc import Sequence

from fopi_tune.core.controller import FoPi
from fopi_tune.design.filter_times import design_with_filter_times
from fopi_tune.design.infeasible import explain_reason
from fopi_tune.design.measured.problem import problem_of
from fopi_tune.design.reasons import reason_without_solving
from fopi_tune.design.search import Neighbour, search
from fopi_tune.digital.implementation import nominal_crossover
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

NO_CONTROLLER = "all gains are fixed at 0: there is no controller"


def design(
    spec: DesignSpec,
    violations: Sequence[Violation] = (),
    start: FoPi | Neighbour | None = None,
    bracket: bool = False,
) -> Candidate:
    """Search for the gains that meet a spec over its whole family and optimise its objective.

    Args:
        spec: what the loop must do.
        violations: points that a check found; they are among the plants and frequencies that are looked at.
        start: gains close to the optimum, or a solved spec; polished beside the basins of a coarser scan.
        bracket: whether to bound in floating point what no gains can beat (`Candidate.gap`), and to search again
            wherever that leaves room; not with `structure: pid` or `fopid`, whose derivative the bound does not know,
            nor on samples where the filter depends on the gains' crossover.

    Returns:
        A candidate; `fopi_tune.proof` has to check it.
    """
    fixed = spec.controller.fixed
    if spec.controller.filter_times is not None:
        known = start.gains if isinstance(start, Neighbour) else start
        return design_with_filter_times(spec, known, lambda fixed, near: design(fixed, violations, near))
    nothing = tuple(None for _ in spec.requirements)
    if fixed is not None and fixed.is_zero:
        return Candidate(Status.INFEASIBLE, None, nothing, (), NO_CONTROLLER)
    if fixed is not None:
        return Candidate(Status.SOLVED, fixed, nothing)
    problem = problem_of(spec, violations)
    # the formulas are of transfer functions
    reason = None if spec.is_measured else reason_without_solving(spec)
    if reason is not None:
        return explain_reason(problem, reason)
    known = start.gains if isinstance(start, Neighbour) else start
    found = search(problem, known, bracket)
    if found.status is Status.FAILED and found.gains is not None and not found.gains.is_zero:
        # gains that meet everything say where the rays have to be close to each other
        crossover = nominal_crossover(spec, found.gains)
        again = None if crossover is None else search(problem_of(spec, violations, crossover), found.gains, bracket)
        if again is not None and again.status is Status.SOLVED:
            return again
    return found


def neighbour(spec: DesignSpec, gains: FoPi) -> Neighbour:
    """A solved spec, as a start for others that differ in their limits.

    Args:
        spec: the spec.
        gains: its designed gains.
    """
    return Neighbour(spec, gains)
