"""Explain infeasibility:  an irreducible infeasible set of requirements, and how far each limit must be relaxed.

The set comes from a deletion filter over elastic solves: a requirement is dropped where the others are infeasible
without it.  The relaxation of each requirement in the set is found by relaxing it alone, with all others held.
"""

from __future__ import annotations

from fopi_tune.core.bode_form import Array
from fopi_tune.design.constraints import Bound
from fopi_tune.design.reasons import Reason, describe, has_negative_gain
from fopi_tune.design.search import MEETS, Search
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec.model import DesignSpec

_UNSTABLE = "no gains within their ranges were found that give every plant of the family a stable loop"


def explain_infeasibility(search: Search) -> Candidate:
    """The irreducible infeasible set by deletion, and the relaxation that each of its requirements needs."""
    everything, limits = search.all_requirements, search.limits(0.0)
    nothing = tuple(None for _ in search.spec.requirements)
    relaxed = search.relaxed
    if relaxed is None:
        return _without_any_solution(search)
    near = relaxed.solved.gains
    if not search.stable(near) and _no_start_is_stable(search):
        return Candidate(Status.INFEASIBLE, near, nothing, (), _UNSTABLE, search.exchange.solves, relaxed.rounds)
    if relaxed.solved.relaxations.sum() <= MEETS:
        message = "the requirements can be met, but Ipopt did not converge on the objective; try narrower gain ranges"
        return Candidate(Status.FAILED, near, nothing, (), message, search.exchange.solves)
    clash = everything
    relaxation = _total_relaxation(search, relaxed.solved.relaxations)
    for requirement in sorted(everything, key=lambda r: relaxation.get(r, 0.0)):
        rest = clash - {requirement}
        without = search.elastic(rest, rest, limits)
        if without is not None and without.solved.relaxations.sum() > MEETS:
            clash = rest
    relaxations = tuple(_relaxation_alone(search, requirement, limits) for requirement in sorted(clash))
    return Candidate(
        Status.INFEASIBLE,
        near,
        nothing,
        relaxations,
        _message(search.spec, clash),
        search.exchange.solves,
        relaxed.rounds,
    )


def explain_reason(search: Search, reason: Reason) -> Candidate:
    """The candidate of a spec that `reason_without_solving` refuses: its nearest gains and the relaxations needed."""
    limits, rest = search.limits(0.0), search.all_requirements - reason.unattainable
    search.relaxed = search.elastic(rest, rest, limits)
    relaxations = tuple(
        Relaxation(r, None, None) if r in reason.unattainable else _relaxation_alone(search, r, limits)
        for r in sorted(reason.requirements)
    )
    gains = search.relaxed.solved.gains if search.relaxed else None
    nothing = tuple(None for _ in search.spec.requirements)
    return Candidate(Status.INFEASIBLE, gains, nothing, relaxations, reason.message, search.exchange.solves)


def _without_any_solution(search: Search) -> Candidate:
    """No solution with all requirements relaxed: tell instability of every start from failure of the solver."""
    nothing = tuple(None for _ in search.spec.requirements)
    box = search.spec.controller
    wrong_sign = has_negative_gain(search.exchange.oracle.plants) and box.kp.min >= 0.0 and box.ki.min >= 0.0
    if wrong_sign or _no_start_is_stable(search):
        message = _UNSTABLE
        if wrong_sign:
            message += "; the plant's gain is negative, so allow negative kp and ki"
        return Candidate(Status.INFEASIBLE, None, nothing, (), message, search.exchange.solves)
    message = "Ipopt found no point that could be confirmed from any start, even with every requirement relaxed"
    return Candidate(Status.FAILED, None, nothing, (), message, search.exchange.solves)


def _no_start_is_stable(search: Search) -> bool:
    """Whether no start of the search stabilises the family."""
    return not any(search.stable(gains) for gains in (*search.starts, *search.stable_starts()))


def _total_relaxation(search: Search, relaxations: Array) -> dict[int, float]:
    totals: dict[int, float] = {}
    for k, constraint in enumerate(search.exchange.constraints):
        totals[constraint.requirement] = totals.get(constraint.requirement, 0.0) + float(
            relaxations[2 * k] + relaxations[2 * k + 1]
        )
    return totals


def _relaxation_alone(search: Search, requirement: int, limits: tuple[float, ...]) -> Relaxation:
    """The smallest change of one limit with which all requirements can be met."""
    run = search.elastic(search.all_requirements, frozenset({requirement}), limits)
    if run is None:
        return Relaxation(requirement, None, None)
    changes = []
    for k, constraint in enumerate(search.exchange.constraints):
        up, down = float(run.solved.relaxations[2 * k]), float(run.solved.relaxations[2 * k + 1])
        if constraint.requirement != requirement or max(up, down) <= 0.0:
            continue
        # slack = bound (limit - value) scale + up - down; an equality reads limit - value + up - down = 0.
        direction = 1.0 if constraint.bound is Bound.EQUAL else float(constraint.bound.value)
        changes.append(
            (
                abs(up - down),
                constraint,
                constraint.quantity.from_natural(constraint.limit + direction * (up - down) / constraint.scale),
            )
        )
    if not changes:
        return Relaxation(requirement, None, None)
    _, constraint, new_limit = max(changes, key=lambda change: change[0])
    return Relaxation(requirement, abs(new_limit - constraint.limit_public), new_limit)


def _message(spec: DesignSpec, clash: frozenset[int]) -> str:
    if not clash:
        return "every point that meets the requirements is unstable for some plant of the family"
    names = " and ".join(describe(spec.requirements[i]) for i in sorted(clash))
    if len(clash) == 1:
        return f"{names} cannot be met within the gains' ranges"
    return f"{names} cannot hold together within the gains' ranges"
