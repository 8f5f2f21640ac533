"""DesignSpec -> Candidate:  closed-form reasons first, then the search from its starts, then why there is no answer."""

from __future__ import annotations

from collections.abc import Sequence

from fopi_tune.core.controller import FoPi
from fopi_tune.design.exchange import Converged
from fopi_tune.design.infeasible import clash_of, explained
from fopi_tune.design.reasons import branches, reason_without_solving
from fopi_tune.design.search import Neighbour, Search
from fopi_tune.design.starts import fixed_gains
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec


def neighbour(spec: DesignSpec, gains: FoPi) -> Neighbour:
    """A designed spec as a place to start from.

    Args:
        spec: the spec.
        gains: of its design.
    """
    return Neighbour(spec, gains, Search.of(spec, (), gains).first_cuts)


def design(spec: DesignSpec, violations: Sequence[Violation] = (), start: FoPi | Neighbour | None = None) -> Candidate:
    """Search the gains that meet a spec over its whole family and are best by its objective.

    Args:
        spec: what the loop must do.
        violations: points that a check found, to be respected from the start.
        start: gains that are nearly right, or a spec that has them; the only start unless it leads nowhere.

    Returns:
        A candidate; confirming it is `fopi_tune.proof`'s business.
    """
    fixed = fixed_gains(spec.controller)
    if fixed is not None and fixed.kp == 0.0 and fixed.ki == 0.0:
        nothing = tuple(None for _ in spec.requirements)
        return Candidate(Status.INFEASIBLE, None, nothing, (), "kp and ki are fixed at 0: there is no controller")
    if fixed is not None:
        return Candidate(Status.SOLVED, fixed, tuple(None for _ in spec.requirements))
    reason = reason_without_solving(spec)
    if reason is not None:
        return explained(Search.of(spec, violations), reason)
    if start is not None:
        near = Search.of(spec, violations, start)
        best = near.best()
        if best is not None:
            return near.candidate(best)
    searches = [Search.of(branch, violations) for branch in branches(spec)]
    found = best_of(searches)
    if found is None:
        return clash_of(searches[0])
    search, best = found
    return search.candidate(best)


def best_of(searches: Sequence[Search]) -> tuple[Search, Converged] | None:
    """The best answer of all searches, each from all its starts, and whose it is; None when none has any."""
    found = [(search, best) for search in searches if (best := search.best()) is not None]
    return min(found, key=lambda pair: pair[0].cost(pair[1].solved)) if found else None
