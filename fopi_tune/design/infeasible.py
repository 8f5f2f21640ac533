"""Why a spec has no answer:  the requirements that clash, and by how much each has to be relaxed.

The scan and the polish answer one more question: by how little some requirements (`free`) can be missed while the
others hold and some are left out.  A requirement without which the others still clash is dropped; of those that are
left, each is relaxed alone.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.design.constraints import Bound
from fopi_tune.design.global_search.basins import WORTH, scan_box
from fopi_tune.design.global_search.polish import Counts, Polish, Polished
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.worst_case import ROW, SLACK
from fopi_tune.design.measured.polish import polish_of
from fopi_tune.design.measured.problem import MeasuredProblem
from fopi_tune.design.reasons import Reason, describe, has_negative_gain
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec.model import DesignSpec

#: natural units; requirements that are missed by no more can hold together
MET = 1e-6
_BASINS = 2
_COARSE = 2.0
_UNSTABLE = "no gains within their ranges were found that give every plant of the family a stable loop"
_NEAREST = "the requirements can be met, but Ipopt did not converge on the objective; try narrower gain ranges"


def explain(problem: Problem, excluded: str, nearest: Polished | None, counts: Counts) -> Candidate:
    """The candidate of a spec for which the search found no gains.

    Args:
        problem: the problem.
        excluded: how completely the box was searched, in words; empty when it was not asked.
        nearest: gains at which the largest miss is smallest; None where all leave a plant unstable.
        counts: of the search so far.
    """
    spec, everything = problem.spec, problem.every_requirement
    nothing = tuple(None for _ in spec.requirements)
    if nearest is None:
        return Candidate(Status.INFEASIBLE, None, nothing, (), _unstable(problem), counts.solves)
    gains = problem.gains(nearest.x)
    if nearest.cost <= MET:
        return Candidate(Status.FAILED, gains, nothing, (), _NEAREST, counts.solves)
    clash = everything
    for requirement in sorted(everything):
        rest = clash - {requirement}
        without = least_missed(problem, rest, everything - rest, counts, MET) if rest else None
        if without is not None and without.cost > MET:
            clash = rest
    relaxations = tuple(relaxation_alone(problem, requirement, counts) for requirement in sorted(clash))
    message = _message(spec, clash) + (f"; {excluded}" if excluded else "")
    return Candidate(Status.INFEASIBLE, gains, nothing, relaxations, message, counts.solves)


def explain_reason(problem: Problem, reason: Reason) -> Candidate:
    """The candidate of a spec that a formula refuses: its nearest gains and the relaxations needed."""
    counts, spec = Counts(), problem.spec
    everything = problem.every_requirement
    nearest = least_missed(problem, everything - reason.unattainable, reason.unattainable, counts)
    relaxations = tuple(
        Relaxation(r, None, None) if r in reason.unattainable else relaxation_alone(problem, r, counts)
        for r in sorted(reason.requirements)
    )
    gains = problem.gains(nearest.x) if nearest else None
    nothing = tuple(None for _ in spec.requirements)
    return Candidate(Status.INFEASIBLE, gains, nothing, relaxations, reason.message, counts.solves)


def nearest_of(problem: Problem, counts: Counts) -> Polished | None:
    """The gains at which the largest miss is smallest; None where all that were found leave a plant unstable."""
    return least_missed(problem, problem.every_requirement, frozenset(), counts)


def least_missed(
    problem: Problem, free: frozenset[int], dropped: frozenset[int], counts: Counts, enough: float = -math.inf
) -> Polished | None:  # fmt: skip
    """The gains at which the largest miss of the requirements in `free` is smallest; its cost is that miss.

    None where no gains were found at which all others hold, or where it is not known whether a miss is small enough.

    Args:
        problem: the problem.
        free, dropped: requirements that may be missed, and that are left out.
        counts: of the work so far.
        enough: a miss; gains without a larger one are not improved.
    """
    question = problem.missing(free, dropped)
    polish = polish_of(question, counts)
    best: Polished | None = None
    for basin in scan_box(question, _BASINS, _COARSE, enough).basins:
        if best is not None and basin.cost > best.cost + WORTH * max(abs(best.cost), 0.05):
            continue
        found = polish.unchanged(basin.gains) if basin.cost <= enough else None
        if found is None or found.cost > enough:
            found = polish.run(basin.gains, rival=best)
        if found is None and basin.cost <= enough:
            # the scan says that these gains are enough and nothing shows it: neither that, nor that none are
            return None
        if found is not None and (best is None or found.cost < best.cost):
            best = found
        if best is not None and best.cost <= MET:
            break
    return best


def relaxation_alone(problem: Problem, requirement: int, counts: Counts) -> Relaxation:
    """The smallest change of one limit with which all requirements can be met."""
    found = least_missed(problem, frozenset({requirement}), frozenset(), counts)
    if found is None:
        return Relaxation(requirement, None, None)
    polish = polish_of(problem.missing(frozenset({requirement}), frozenset()), counts)
    moved = moved_limit(polish, found, requirement)
    return Relaxation(requirement, None, None) if moved is None else Relaxation(requirement, moved[1], moved[0])


def moved_limit(polish: Polish, found: Polished, requirement: int) -> tuple[float, float] | None:
    """The limit that gains meet instead of the requirement's own, and its change, public unit; None if none is missed.

    Args:
        polish: of a problem in which the requirement may be missed.
        found: its answer.
        requirement: index in the spec's list.
    """
    missed, best = misses(polish, found.x), (0.0, 0.0, 0.0)
    for k, constraint in enumerate(polish.problem.constraints):
        if constraint.requirement != requirement or missed[k] <= best[0]:
            continue
        side = float(constraint.bound.value)
        if constraint.bound is Bound.EQUAL:
            side = 1.0 if is_closer(polish, found.x, k, 1.0) else -1.0
        limit = constraint.quantity.from_natural(constraint.limit + side * missed[k] / constraint.scale)
        if math.isfinite(limit):
            best = float(missed[k]), limit, abs(limit - constraint.limit_public)
    return None if best[0] == 0.0 else (best[1], best[2])


def misses(polish: Polish, x: Array) -> Array:
    """By how much each requirement's row is missed at gains, natural units, 0 where it is met; shape (rows,)."""
    found, missed = polish.look(x), np.zeros(polish.real_rows)
    for finding in [] if found is None else found:
        q = int(finding[ROW])
        if q < polish.real_rows:
            missed[q] = max(missed[q], -finding[SLACK])
    return missed


def is_closer(polish: Polish, x: Array, row: int, side: float) -> bool:
    """Whether an equality's limit moved to a side (1 up, -1 down) would be missed by less."""
    before = misses(polish, x)[row]
    rows = polish.rows
    step = side * min(1e-3, 0.5 * before) / float(rows.scale[row])
    limit = rows.limit.copy()
    limit[row] += step
    polish.rows = rows._replace(limit=limit)
    after = misses(polish, x)[row]
    polish.rows = rows
    return bool(after < before)


def has_wrong_sign(problem: Problem) -> bool:
    """Whether the plant's gain is negative and the ranges hold no negative gains."""
    box = problem.spec.controller
    never_negative = all(gain.min >= 0.0 for gain in (box.kp, box.ki, box.kd))
    if isinstance(problem, MeasuredProblem):
        end = problem.family.members[0].table.low_end
        return end is not None and end.is_negative and never_negative
    plants = Plants.members(problem.spec.plant, problem.fine_points[0])
    return has_negative_gain(plants) and never_negative


def _unstable(problem: Problem) -> str:
    if has_wrong_sign(problem):
        return _UNSTABLE + "; the plant's gain is negative, so allow negative kp and ki"
    if isinstance(problem, MeasuredProblem):
        low, high = problem.family.band_rad_s
        return f"{_UNSTABLE}, with |L| above 1 at {low:.5g} rad/s and below 1 at {high:.5g} rad/s, the measured band"
    return _UNSTABLE


def _message(spec: DesignSpec, clash: frozenset[int]) -> str:
    if not clash:
        return "every point that meets the requirements is unstable for some plant of the family"
    names = " and ".join(describe(spec.requirements[i]) for i in sorted(clash))
    verb = "cannot be met" if len(clash) == 1 else "cannot hold together"
    return f"{names} {verb} within the gains' ranges"
