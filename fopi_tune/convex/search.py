"""DesignSpec -> Candidate by convex problems alone:  an independent check of the design by Ipopt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fopi_tune.convex.alpha_search import AlphaSearch
from fopi_tune.convex.convex_concave import TOLERANCE, LocalResult, Members, is_better
from fopi_tune.convex.limits import OPEN_GAIN, STABILITY_GUARD, TIGHTENING, Bound, Task, task_of, unsupported
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.implementation import nominal_crossover
from fopi_tune.errors import DomainError
from fopi_tune.proof import verify
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange

#: rounds of the exchange: find the worst plants of the whole family, add them, solve again
_MOST_EXCHANGES = 8
#: natural units; limits violated by less count as met, without the tightening
_MEETS = TOLERANCE + TIGHTENING
#: natural units; with a smaller violation the search failed to converge, rather than the spec being infeasible
_NEARLY = 1e-5
#: neper or radian; a smallest slack of this size counts as unbounded
_DEPTH_CAP = 15.0
#: searches with a filter that is exact at the crossover of the one before, and relative differences that do not matter
_MOST_CROSSOVERS, _SAME_CROSSOVER = 6, 1e-7


def convex_design(spec: DesignSpec, violations: Sequence[Violation] = ()) -> Candidate:
    """Search for the gains that meet a spec over its whole family and optimise its objective, by convex problems.

    Args:
        spec: what the loop must do, in continuous time or on samples.
        violations: points that a check found; their plants are members from the start.

    Returns:
        A candidate, which `fopi_tune.proof` has to check; here `verify` only finds plants to add.
    """
    nothing = tuple(None for _ in spec.requirements)
    reason = unsupported(spec)
    if reason is not None:
        return Candidate(Status.FAILED, None, nothing, message=reason)
    box = spec.controller
    if box.kp.is_fixed and box.ki.is_fixed and box.kp.min == 0.0 and box.ki.min == 0.0:
        message = "kp and ki are fixed at 0: there is no controller"
        return Candidate(Status.INFEASIBLE, None, nothing, message=message)
    if box.fixed is not None:
        return Candidate(Status.SOLVED, box.fixed, nothing)
    searches = [_search_at_own_crossover(branch, violations) for branch in _branches(spec)]
    found = [(search, best) for search in searches if (best := search.best()) is not None]
    solves = sum(search.procedure.program.solves for search in searches)
    if not found:
        message = "the convex path found no gains within their ranges whose loop has the crossings that are asked for"
        return Candidate(Status.INFEASIBLE, None, nothing, message=message, solves=solves)
    search, best = found[0]
    for other, its_best in found[1:]:
        search, best = (other, its_best) if is_better(its_best.evaluation, best.evaluation) else (search, best)
    return replace(_candidate(search.task, best), solves=solves, cuts=len(search.members.points))


def _search_at_own_crossover(spec: DesignSpec, violations: Sequence[Violation]) -> AlphaSearch:
    """The search; where the filter depends on the loop's crossover, with that of the gains found, by a fixed point."""
    crossover: float | None = None
    search = _search(spec, violations)
    for _ in range(_MOST_CROSSOVERS if search.task.kind.needs_crossover else 0):
        best = search.best()
        found = None if best is None else nominal_crossover(spec, best.gains)
        if best is None or found is None:
            break
        if crossover is not None and abs(found / crossover - 1.0) < _SAME_CROSSOVER:
            break
        crossover = found
        search = _search(spec, violations, crossover, best.gains)
    return search


def _search(
    spec: DesignSpec, violations: Sequence[Violation], crossover_rad_s: float | None = None, start: FoPi | None = None
) -> AlphaSearch:
    """Scan alpha, or begin at a start; then refine and add the worst plants, until there are no worse ones."""
    task = task_of(spec, crossover_rad_s)
    members = Members.of(task)
    members.add(np.array([v.theta for v in violations]).reshape(len(violations), members.points.shape[1]))
    alphas = AlphaSearch(task, members)
    if start is None:
        alphas.scan()
    else:
        alphas.begin_at(start)
    for _ in range(_MOST_EXCHANGES):
        alphas.refine()
        best = alphas.best()
        if best is None or not _with_worst_plants(task, members, best):
            break
        alphas.reevaluate()
    return alphas


def _with_worst_plants(task: Task, members: Members, best: LocalResult) -> bool:
    """Add the worst plants of the whole family for these gains; False when all are members already."""
    if not members.points.shape[1]:
        return False
    try:
        found = verify(task.spec, best.gains, TIGHTENING, implementation=task.kind.implementation(best.gains))
    except DomainError:
        return False
    worst = [r.worst.point for r in found.requirements if not r.is_met]
    if not found.stability.stable:
        worst.append(found.stability.worst.point)
    if found.objective_worst is not None:
        worst.append(found.objective_worst.point)
    return members.add(np.array(worst).reshape(len(worst), members.points.shape[1])) > 0


def _branches(spec: DesignSpec) -> list[DesignSpec]:
    """The spec, and the same with ki = 0 where the responses' jump at ki = 0 may be an advantage.

    As omega -> 0, with ki != 0 on a plant with a finite P(0) != 0 and for all gains, |C S| -> 1/|P(0)|, |T| -> 1,
    |L| -> inf and |S| -> 0; not so with ki = 0.
    """
    ki = spec.controller.ki
    if ki.is_fixed or not ki.min <= 0.0 <= ki.max:
        return [spec]
    alpha = min(max(1.0, spec.controller.alpha.min), spec.controller.alpha.max)
    controller = ControllerSpec(spec.controller.kp, GainRange(0.0, 0.0), GainRange(alpha, alpha))
    without = replace(spec, controller=controller)
    plants = Plants.members(spec.plant, spec.plant.corners())
    if np.any(plants.numerator[:, -1] == 0.0):
        return [without]  # a zero at s = 0 cancels the integral, which is then an unstable hidden mode
    floor = float(-plants.log.scale.min()) if np.all(plants.log.slope0 == 0.0) else -math.inf
    at_rest = {"control_sensitivity_db": floor, "complementary_sensitivity_db": 0.0, "loop_gain_db": math.inf}
    if math.isfinite(floor):
        for limit in task_of(spec).limits:
            if limit.from_rad_s == 0.0 and limit.bound is Bound.UPPER:
                if at_rest.get(limit.quantity, -math.inf) > limit.limit + TIGHTENING:
                    return [without]
            elif limit.from_rad_s == 0.0 and limit.bound is Bound.LOWER and limit.quantity == "sensitivity_db":
                return [without]
        if spec.objective is not None and spec.objective.quantity == ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
            return [spec, without]
    return [spec]


def _candidate(task: Task, best: LocalResult) -> Candidate:
    spec, nothing = task.spec, tuple(None for _ in task.spec.requirements)
    if best.evaluation.violation <= _MEETS:
        unbounded = _unbounded(task, best)
        if unbounded:
            message = f"{unbounded} without limit while the objective still improves"
            return Candidate(Status.UNBOUNDED, best.gains, nothing, message=message, rounds=best.rounds)
        return Candidate(Status.SOLVED, best.gains, nothing, rounds=best.rounds)
    if not best.evaluation.stable:
        missed = "no start led to a loop that is stable for every plant"
    else:
        worst = [k for k, by in best.evaluation.largest_violations(3).items() if by > _MEETS]
        indices = [task.limits[k].requirement for k in worst]
        names = " and ".join(
            dict.fromkeys("stability" if i == STABILITY_GUARD else spec.requirements[i].quantity for i in indices)
        )
        missed = f"the gains that miss least miss {names} by {best.evaluation.violation:.2g} neper or radian"
    if best.evaluation.violation <= _NEARLY:
        message = f"the convex path did not end: {missed}"
        return Candidate(Status.FAILED, best.gains, nothing, message=message, rounds=best.rounds)
    message = f"the convex path found no gains that meet all requirements; {missed}"
    return Candidate(Status.INFEASIBLE, best.gains, nothing, message=message, rounds=best.rounds)


def _unbounded(task: Task, best: LocalResult) -> str:
    """What reached the end of the search range though the spec leaves it open, in words; empty when nothing did."""
    x, box = task.scaled(best.gains), task.spec.controller
    names = []
    for name, value, gain, unit in zip(("kp", "ki"), x, (box.kp, box.ki), task.unit(best.gains.alpha), strict=True):
        end = gain.max if value > 0.0 else gain.min
        if abs(value) > 0.5 * OPEN_GAIN and (math.isinf(end) or abs(end / unit) > OPEN_GAIN):
            names.append(name)
    if task.objective is ObjectiveKind.DEPTH and best.evaluation.cost < -0.999 * _DEPTH_CAP:
        names.append("the smallest slack")
    if not names:
        return ""
    return f"{' and '.join(names)} {'grow' if len(names) > 1 else 'grows'}"
