"""DesignSpec -> Candidate:  scan, polish of every basin, recheck."""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import is_stable
from fopi_tune.design.constraints import STABILITY_GUARD, Bound
from fopi_tune.design.global_search.basins import Scan, scan_box
from fopi_tune.design.global_search.compiled import DEPTH, ENDLESS
from fopi_tune.design.global_search.infeasible import explain
from fopi_tune.design.global_search.polish import MEETS, Polish, Polished
from fopi_tune.design.global_search.problem import LARGEST_GAIN, Problem
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

_BASINS = 3
#: of the best cost (or of 0.05): a basin that is worse by more on the scan's table is not polished
_WORTH = 0.03
#: radii of the polish when its result is worse than the scan's
_NEARER = (0.1, 0.03)
#: of objectives that are a largest member: from natural units to public ones
_PUBLIC_UNIT = {
    ObjectiveKind.PHASE_MARGIN_SPREAD: math.degrees(1.0),
    ObjectiveKind.CROSSOVER_SPREAD: 1.0 / NEPER_PER_DB,
    ObjectiveKind.SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
}
#: multipliers beyond this say only that limits coincide
_NO_PRICE = 1e5


def search_globally(spec: DesignSpec) -> Candidate:
    """The best gains of the whole box.

    Args:
        spec: what the loop must do; at least one gain is free.

    Returns:
        A candidate; `fopi_tune.proof` has to check it.
    """
    problem = Problem.of(spec)
    scan = scan_box(problem, _BASINS)
    polish = Polish(problem)
    best = polish_basins(polish, scan)
    if best is None or (problem.code == DEPTH and best.cost > MEETS):
        return explain(problem, "", polish.counts)
    return candidate_of(polish, best)


def polish_basins(polish: Polish, scan: Scan) -> Polished | None:
    """The best local optimum of the scan's basins."""
    best: Polished | None = None
    for basin in scan.basins:
        worth = _WORTH * max(abs(basin.cost), 0.05)
        if best is not None and basin.cost > best.cost + worth:
            continue
        found = polish.run(basin.gains)
        for radius in _NEARER:
            if found is not None and found.settled and found.cost <= basin.cost + worth:
                break
            nearer = polish.run(basin.gains if found is None else found.x, radius)
            if nearer is not None and (found is None or nearer.cost < found.cost):
                found = nearer
        if found is not None and (best is None or found.cost < best.cost) and _is_stable(polish.problem, found):
            best = found
    return best


def _is_stable(problem: Problem, found: Polished) -> bool:
    plants = Plants.members(problem.spec.plant, problem.fine_points[0])
    return bool(is_stable(Loops.of(problem.gains(found.x), plants)).all())


def candidate_of(polish: Polish, best: Polished) -> Candidate:
    """The answer for a feasible spec."""
    problem = polish.problem
    status, message = Status.SOLVED, ""
    box, x = problem.spec.controller, problem.gains(best.x)
    grown = [
        name for name, gain, value in (("kp", box.kp, best.x[0]), ("ki", box.ki, best.x[1]))
        if (math.isinf(gain.max) and value > 0.99 * LARGEST_GAIN) or (math.isinf(gain.min) and -value > 0.99 * LARGEST_GAIN)
    ]  # fmt: skip
    if problem.code == DEPTH and -best.cost > ENDLESS - 1e-6:
        grown.append("the smallest slack")
    if grown:
        status = Status.UNBOUNDED
        verb = "grow" if len(grown) > 1 else "grows"
        message = f"{' and '.join(grown)} {verb} without limit while the objective still improves"
    return Candidate(
        status, x, multipliers_of(problem, best), (), message, polish.counts.solves, best.rounds, best.cuts
    )  # fmt: skip


def multipliers_of(problem: Problem, best: Polished) -> tuple[float | None, ...]:
    """d objective/d limit in public units, positive where relaxing gains."""
    unit = _PUBLIC_UNIT.get(problem.objective, 1.0)
    if problem.objective is ObjectiveKind.IAE_DISTURBANCE:
        # the cost is ln of the scaled error:  error = horizon e^cost / (g_s), up to the gain's unit
        unit = problem.horizon_s * problem.scale.gain * math.exp(min(best.cost, 600.0))
    totals: list[float | None] = [None] * len(problem.spec.requirements)
    if np.isnan(best.prices).any():
        return tuple(totals)
    for k, constraint in enumerate(problem.constraints):
        if constraint.requirement == STABILITY_GUARD:
            continue
        price = float(best.prices[k]) * constraint.natural_per_public() * unit
        if constraint.quantity.name == "delay_margin_s":
            price *= problem.scale.omega_rad_s
        gain = abs(price) if constraint.bound is Bound.EQUAL else -constraint.bound.value * price
        totals[constraint.requirement] = max(totals[constraint.requirement] or 0.0, gain, 0.0)
    return tuple(None if total is not None and total > _NO_PRICE else total for total in totals)
