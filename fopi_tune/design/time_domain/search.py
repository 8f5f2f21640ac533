"""ScenarioProblem -> Candidate:  the best gains for what scenarios measure, or why there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.design.constraints import STABILITY_GUARD, Bound
from fopi_tune.design.infeasible import explain_reason
from fopi_tune.design.reasons import reason_without_solving
from fopi_tune.design.synthesis import NO_CONTROLLER
from fopi_tune.design.time_domain.exchange import MET, Counts, Exchanged, solve
from fopi_tune.design.time_domain.infeasible import explain
from fopi_tune.design.time_domain.problem import ScenarioProblem, ScenarioRow
from fopi_tune.design.time_domain.settling import shortest_settling
from fopi_tune.digital.discretize import Method
from fopi_tune.errors import DomainError
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec, Limit
from fopi_tune.spec.scenarios import frequency_part

#: multipliers below this part of the objective are those of limits that do not bind
_SMALLEST_PRICE = 1e-7
_NO_FIT = (
    "method: fit has no gains designed for scenarios, as its frequency response is not searched; write method: "
    "modified_oustaloup or oustaloup, or fix kp, ki and alpha"
)


def design_for_scenarios(
    spec: DesignSpec, violations: Sequence[Violation] = (), start: FoPi | None = None
) -> Candidate:
    """Search for the gains that meet requirements on scenarios and on the loop's frequency response.

    Args:
        spec: one that designs for scenarios.
        violations: plants and frequencies at which a check refuted gains.
        start: gains close to the optimum; the whole box is searched beside them.

    Raises:
        DomainError: the digital controller cannot be made, a plant cannot be simulated, or the filter is fitted.
    """
    fixed = spec.controller.fixed
    nothing = tuple(None for _ in spec.requirements), tuple(None for _ in spec.scenario_requirements)
    if fixed is not None:
        status, gains, why = (Status.INFEASIBLE, None, NO_CONTROLLER) if fixed.is_zero else (Status.SOLVED, fixed, "")
        return Candidate(status, gains, nothing[0], message=why, scenario_multipliers=nothing[1])
    assert spec.digital is not None
    if Method(spec.digital.method) is Method.FIT:
        raise DomainError(_NO_FIT)
    problem, counts = ScenarioProblem.of(spec, violations), Counts()
    reason = reason_without_solving(frequency_part(spec))
    if reason is not None:
        return replace(explain_reason(problem.scanned, reason), scenario_multipliers=nothing[1])
    if problem.objective is not None and problem.objective.limit.measure == "settling_time_s":
        return _fastest(problem, problem.objective, counts, () if start is None else (start,))
    best = solve(problem, counts, () if start is None else (start,))
    if best is None or best.violation > MET or (problem.maximises_depth and best.objective > MET):
        return explain(problem, None if best is None else best.gains, counts)
    return candidate_of(problem, best, counts)


def _fastest(problem: ScenarioProblem, aim: ScenarioRow, counts: Counts, known: tuple[FoPi, ...]) -> Candidate:
    """The gains with which every plant settles first; without multipliers, as a settling time changes in jumps."""
    Ts, spec = aim.run.run.sample_time_s, problem.spec

    def question(count: int) -> ScenarioProblem:
        limit = replace(aim.limit, limit=count * Ts)
        return replace(problem, objective=None, rows=(*problem.rows, replace(aim, limit=limit, in_depth=True)))

    found = shortest_settling(question, -1, len(aim.run.run.signals), known, counts)
    if found is None:
        met = solve(replace(problem, objective=None), counts, known)
        if met is None or met.violation > MET:
            return explain(problem, None if met is None else met.gains, counts)
        message = f"no gains were found with which every plant settles within scenario {aim.run.spec.name}"
        return replace(explain(problem, met.gains, counts), message=message)
    nothing = tuple(None for _ in spec.requirements), tuple(None for _ in spec.scenario_requirements)
    return Candidate(
        Status.SOLVED, found[1], nothing[0], solves=counts.steps, rounds=counts.rounds, cuts=counts.plants,
        scenario_multipliers=nothing[1],
    )  # fmt: skip


def candidate_of(problem: ScenarioProblem, best: Exchanged, counts: Counts) -> Candidate:
    """The answer for a feasible spec."""
    loop, scenarios = multipliers_of(problem, best)
    return Candidate(
        Status.SOLVED, best.gains, loop, solves=counts.steps, rounds=counts.rounds, cuts=counts.plants,
        scenario_multipliers=scenarios,
    )  # fmt: skip


def multipliers_of(
    problem: ScenarioProblem, best: Exchanged
) -> tuple[tuple[float | None, ...], tuple[float | None, ...]]:
    """d objective/d limit in public units, positive where relaxing gains: of the loop's requirements, of scenarios'.

    None of a settling time, which changes in jumps of a sample.
    """
    spec, step, model = problem.spec, best.local.step, best.local.model
    nothing = tuple(None for _ in spec.requirements), tuple(None for _ in spec.scenario_requirements)
    if step is None:
        return nothing
    loop, scenarios = np.zeros(len(spec.requirements)), np.zeros(len(spec.scenario_requirements))
    constraints = problem.loop.constraints
    prices = [(int(owner), float(price)) for owner, price in zip(model.owner, step.row_prices, strict=True)]
    of_sums = zip(model.sums, step.sum_prices, strict=True)
    prices += [(each.row, float(price)) for each, price in of_sums if each.row >= 0]
    for owner, price in prices:
        worth = best.local.scale * price
        if owner >= 0:
            row = problem.rows[owner]
            scenarios[row.index] += worth / row.unit
            continue
        constraint = constraints[-1 - owner]
        if constraint.requirement != STABILITY_GUARD:
            natural = constraint.natural_per_public() * constraint.scale
            loop[constraint.requirement] += worth * (natural if constraint.bound is not Bound.EQUAL else abs(natural))
    least = _SMALLEST_PRICE * max(abs(best.objective), best.local.scale)
    return (
        tuple(float(abs(price)) if abs(price) > least else 0.0 for price in loop),
        tuple(map(_priced, spec.scenario_requirements, scenarios.tolist(), [least] * len(scenarios))),
    )


def _priced(limit: Limit, price: float, least: float) -> float | None:
    """A multiplier, 0 where it is worth less than `least`; that of a settling time is per band, and of no use."""
    if limit.measure == "settling_time_s":
        return None
    return price if price * (abs(limit.limit) or 1.0) > least else 0.0
