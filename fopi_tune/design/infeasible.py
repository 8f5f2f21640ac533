"""Why a spec has no answer:  reasons in words where the mathematics gives them, else the smallest set that clashes.

The smallest set comes from a deletion filter over elastic solves: a requirement without which the rest still clashes
is not part of the clash.  What each of the set would have to give is found by letting it alone give, all others held.
"""

from __future__ import annotations

from fopi_tune.core.logform import Array
from fopi_tune.design.reasons import Reason, describe, has_negative_gain
from fopi_tune.design.search import MEETS, Search
from fopi_tune.design.sides import Bound
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec.model import DesignSpec

_UNSTABLE = "no gains within their ranges were found that give every plant of the family a stable loop"


def clash_of(search: Search) -> Candidate:
    """The smallest clashing set, found by deletion, and what each of it would have to give."""
    everything, limits = search.all_requirements, search.limits(0.0)
    nothing = tuple(None for _ in search.spec.requirements)
    relaxed = search.relaxed
    if relaxed is None:
        return _without_any_point(search)
    near = relaxed.solved.gains
    if not search.stable(near) and _none_is_stable(search):
        return Candidate(Status.INFEASIBLE, near, nothing, (), _UNSTABLE, search.exchange.solves, relaxed.rounds)
    if relaxed.solved.gives.sum() <= MEETS:
        message = "the requirements can be met, but Ipopt did not converge on the objective; try narrower gain ranges"
        return Candidate(Status.FAILED, near, nothing, (), message, search.exchange.solves)
    clash = everything
    given = _given(search, relaxed.solved.gives)
    for requirement in sorted(everything, key=lambda r: given.get(r, 0.0)):
        rest = clash - {requirement}
        without = search.elastic(rest, rest, limits)
        if without is not None and without.solved.gives.sum() > MEETS:
            clash = rest
    gives = tuple(_give_alone(search, requirement, limits) for requirement in sorted(clash))
    return Candidate(
        Status.INFEASIBLE, near, nothing, gives, _words(search.spec, clash), search.exchange.solves, relaxed.rounds
    )


def _without_any_point(search: Search) -> Candidate:
    """Even relaxed requirements had no answer: is it stability itself?"""
    nothing = tuple(None for _ in search.spec.requirements)
    box = search.spec.controller
    wrong_sign = has_negative_gain(search.exchange.oracle.plants) and box.kp.min >= 0.0 and box.ki.min >= 0.0
    if wrong_sign or _none_is_stable(search):
        message = _UNSTABLE
        if wrong_sign:
            message += "; the plant's gain is negative, so allow negative kp and ki"
        return Candidate(Status.INFEASIBLE, None, nothing, (), message, search.exchange.solves)
    message = "Ipopt found no point that could be confirmed from any start, even with every requirement relaxed"
    return Candidate(Status.FAILED, None, nothing, (), message, search.exchange.solves)


def _none_is_stable(search: Search) -> bool:
    """Whether all the places where searches begin leave an unstable loop."""
    return not any(search.stable(gains) for gains in (*search.starts, *search.stable_starts()))


def _given(search: Search, gives: Array) -> dict[int, float]:
    totals: dict[int, float] = {}
    for k, side in enumerate(search.exchange.sides):
        totals[side.requirement] = totals.get(side.requirement, 0.0) + float(gives[2 * k] + gives[2 * k + 1])
    return totals


def _give_alone(search: Search, requirement: int, limits: tuple[float, ...]) -> Relaxation:
    """The smallest change of one limit that lets all the others hold."""
    run = search.elastic(search.all_requirements, frozenset({requirement}), limits)
    if run is None:
        return Relaxation(requirement, None, None)
    changes = []
    for k, side in enumerate(search.exchange.sides):
        up, down = float(run.solved.gives[2 * k]), float(run.solved.gives[2 * k + 1])
        if side.requirement != requirement or max(up, down) <= 0.0:
            continue
        # slack = bound (limit - value) scale + up - down; an equality reads limit - value + up - down = 0.
        direction = 1.0 if side.bound is Bound.EQUAL else float(side.bound.value)
        changes.append(
            (abs(up - down), side, side.quantity.from_natural(side.limit + direction * (up - down) / side.scale))
        )
    if not changes:
        return Relaxation(requirement, None, None)
    _, side, new_limit = max(changes, key=lambda change: change[0])
    return Relaxation(requirement, abs(new_limit - side.limit_public), new_limit)


def _words(spec: DesignSpec, clash: frozenset[int]) -> str:
    if not clash:
        return "every point that meets the requirements is unstable for some plant of the family"
    names = " and ".join(describe(spec.requirements[i]) for i in sorted(clash))
    if len(clash) == 1:
        return f"{names} cannot be met within the gains' ranges"
    return f"{names} cannot hold together within the gains' ranges"


def explained(search: Search, reason: Reason) -> Candidate:
    """The answer for a spec with such a reason: the gains that come nearest, and what each would have to give."""
    limits, rest = search.limits(0.0), search.all_requirements - reason.hopeless
    search.relaxed = search.elastic(rest, rest, limits)
    gives = tuple(
        Relaxation(r, None, None) if r in reason.hopeless else _give_alone(search, r, limits)
        for r in sorted(reason.requirements)
    )
    gains = search.relaxed.solved.gains if search.relaxed else None
    nothing = tuple(None for _ in search.spec.requirements)
    return Candidate(Status.INFEASIBLE, gains, nothing, gives, reason.message, search.exchange.solves)
