"""DesignSpec -> Candidate:  analytic infeasibility first, then the search from its starts, then an explanation."""

from __future__ import annotations

from collections.abc import Sequence

from fopi_tune.core.controller import FoPi
from fopi_tune.design.exchange import ExchangeResult
from fopi_tune.design.infeasible import explain_infeasibility, explain_reason
from fopi_tune.design.reasons import branches, reason_without_solving
from fopi_tune.design.search import Neighbour, Search
from fopi_tune.design.starts import fixed_gains
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec


def design(spec: DesignSpec, violations: Sequence[Violation] = (), start: FoPi | Neighbour | None = None) -> Candidate:
    """Search for the gains that meet a spec over its whole family and optimise its objective.

    Args:
        spec: what the loop must do.
        violations: points that a check found; they are cuts of the first solve.
        start: gains close to the optimum, or a solved spec; the only start unless no feasible point is found from it.

    Returns:
        A candidate; `fopi_tune.proof` has to check it.
    """
    fixed = fixed_gains(spec.controller)
    if fixed is not None and fixed.kp == 0.0 and fixed.ki == 0.0:
        nothing = tuple(None for _ in spec.requirements)
        return Candidate(Status.INFEASIBLE, None, nothing, (), "kp and ki are fixed at 0: there is no controller")
    if fixed is not None:
        return Candidate(Status.SOLVED, fixed, tuple(None for _ in spec.requirements))
    reason = reason_without_solving(spec)
    if reason is not None:
        return explain_reason(Search.of(spec, violations), reason)
    if start is not None:
        near = Search.of(spec, violations, start)
        best = near.best()
        if best is not None:
            return near.candidate(best)
    searches = [Search.of(branch, violations) for branch in branches(spec)]
    found = best_of(searches)
    if found is None:
        return explain_infeasibility(searches[0])
    search, best = found
    return search.candidate(best)


def best_of(searches: Sequence[Search]) -> tuple[Search, ExchangeResult] | None:
    """The best result of all searches, each from all its starts, with its search; None when no start is feasible."""
    found = [(search, best) for search in searches if (best := search.best()) is not None]
    return min(found, key=lambda pair: pair[0].cost(pair[1].solved)) if found else None


def neighbour(spec: DesignSpec, gains: FoPi) -> Neighbour:
    """A solved spec, as a start for others that differ in their limits.

    Args:
        spec: the spec.
        gains: its designed gains.
    """
    return Neighbour(spec, gains, Search.of(spec, (), gains).first_cuts)
