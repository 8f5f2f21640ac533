"""Why requirements on scenarios have no answer:  which clash, and by how much each limit would have to give.

As `design.infeasible` does it: the search answers by how little some requirements can be missed while the others hold.
Reasons that a formula shows come first: what a limited control cannot hold at its setpoint, and how fast a plant
without an input slows down by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.design.constraints import Bound
from fopi_tune.design.infeasible import is_closer, misses
from fopi_tune.design.reasons import describe
from fopi_tune.design.time_domain.exchange import MET, Counts, Exchanged, local_optima, solve
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.problem import ScenarioProblem, ScenarioRow
from fopi_tune.design.time_domain.settling import shortest_settling
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.spec.model import DesignSpec, Limit, Relation

_UNSTABLE = "no gains within their ranges were found that give every plant of the family a stable loop"
#: relaxed limits are moved further by this part: there rounding decides
_CLEARANCE = 1e-5
#: relative; a setpoint that is missed by less can be held
_SAME = 1e-9


def explain(problem: ScenarioProblem, nearest: FoPi | None, counts: Counts) -> Candidate:
    """The candidate of a spec for which the search found no gains.

    Args:
        problem: the problem.
        nearest: gains that came near; None where none are known.
        counts: of the search so far.
    """
    spec = problem.spec
    first = len(spec.requirements)
    every = frozenset(range(first + len(spec.scenario_requirements)))
    reason = reason_by_formula(problem)
    known = () if nearest is None else (nearest,)
    least = solve(problem.missing(every, frozenset()), counts, known)
    if least is None:
        return _candidate(spec, None, (), reason or _UNSTABLE, counts)
    clash, known = every, (*known, least.gains)
    for requirement in sorted(every):
        rest = clash - {requirement}
        if rest and _least_missed(problem.missing(rest, every - rest), known, counts) > MET:
            clash = rest
    relaxations = tuple(_relaxation(problem, requirement, known, counts) for requirement in sorted(clash))
    names = " and ".join(describe_requirement(spec, index) for index in sorted(clash))
    verb = "cannot be met" if len(clash) == 1 else "cannot hold together"
    message = reason or f"{names} {verb} within the gains' ranges"
    return _candidate(spec, least.gains, relaxations, message, counts)


def _least_missed(question: ScenarioProblem, known: tuple[FoPi, ...], counts: Counts) -> float:
    """By how little the requirements that are free can be missed, with the vertices of the box; inf if not known."""
    found = local_optima(question, LoopCuts(question.loop), known, counts)
    return min((each.model.objective for each in found), default=math.inf)


def describe_requirement(spec: DesignSpec, index: int) -> str:
    """A requirement in words; those of scenarios are counted after those of the loop."""
    first = len(spec.requirements)
    if index < first:
        return describe(spec.requirements[index])
    limit = spec.scenario_requirements[index - first]
    about = f" in scenario {limit.scenario}" if limit.scenario is not None else ""
    return f"{limit.measure} {limit.relation.value.replace('_', ' ')} {limit.limit:g}{about}"


def _candidate(
    spec: DesignSpec, gains: FoPi | None, clash: tuple[Relaxation, ...], message: str, counts: Counts
) -> Candidate:
    nothing = tuple(None for _ in spec.requirements), tuple(None for _ in spec.scenario_requirements)
    return Candidate(
        Status.INFEASIBLE, gains, nothing[0], clash, message, counts.steps, scenario_multipliers=nothing[1]
    )  # fmt: skip


def _relaxation(problem: ScenarioProblem, index: int, known: tuple[FoPi, ...], counts: Counts) -> Relaxation:
    """The smallest change of one limit with which all requirements can be met."""
    first = len(problem.spec.requirements)
    if index >= first and problem.spec.scenario_requirements[index - first].measure == "settling_time_s":
        return _other_settling(problem, index, known, counts)
    question = problem.missing(frozenset({index}), frozenset())
    found = solve(question, counts, known, thorough=False)
    if found is None or found.violation > MET:
        found = solve(question, counts, known)
    if found is None or found.violation > MET or not math.isfinite(found.objective):
        return Relaxation(index, None, None)
    return relaxation_from(question, index, found)


def relaxation_from(question: ScenarioProblem, index: int, found: Exchanged) -> Relaxation:
    """The limit that gains meet in place of the one that may be missed.

    Args:
        question: in which requirement `index` may be missed.
        index: of the requirement, those of scenarios last.
        found: its answer.
    """
    first = len(question.spec.requirements)
    if index < first:
        return _of_loop(question, index, found)
    return _of_scenario(index, [row for row in question.rows if first + row.index == index], found)


def _of_scenario(index: int, rows: list[ScenarioRow], found: Exchanged) -> Relaxation:
    limit = rows[0].limit.limit
    moved = max((row.side * found.worst[row.key].value * row.unit for row in rows), key=abs)
    if moved == 0.0:
        return Relaxation(index, None, None)
    return Relaxation(index, abs(moved), limit + moved * (1.0 + _CLEARANCE))


def _of_loop(question: ScenarioProblem, index: int, found: Exchanged) -> Relaxation:
    polish = found.cuts.polish
    missed = misses(polish, found.cuts.scaled(found.gains))
    best: tuple[float, float, float] | None = None
    for k, constraint in enumerate(question.loop.constraints):
        if constraint.requirement != index or missed[k] <= 0.0 or (best is not None and missed[k] <= best[0]):
            continue
        side = float(constraint.bound.value)
        if constraint.bound is Bound.EQUAL:
            side = 1.0 if is_closer(polish, found.cuts.scaled(found.gains), k, 1.0) else -1.0
        limit = constraint.quantity.from_natural(constraint.limit + side * missed[k] / constraint.scale)
        if math.isfinite(limit):
            best = float(missed[k]), limit, abs(limit - constraint.limit_public)
    return Relaxation(index, None, None) if best is None else Relaxation(index, best[2], best[1])


def _other_settling(problem: ScenarioProblem, index: int, known: tuple[FoPi, ...], counts: Counts) -> Relaxation:
    """The settling time next to the limit that can be had, by bisection over whole samples."""
    place = index - len(problem.spec.requirements)
    limit = problem.spec.scenario_requirements[place]
    rows = [row for row in problem.rows if row.index == place]
    step, side = rows[0].run.run.sample_time_s, int(rows[0].side)
    # the last whole number of samples that cannot be had
    start = math.floor(limit.limit / step) if side > 0 else math.ceil(limit.limit / step)
    most = max(len(row.run.run.signals) for row in rows) - start if side > 0 else start

    def question(count: int) -> ScenarioProblem:
        moved = replace(limit, limit=(start + side * count) * step)
        rows = tuple(replace(row, limit=moved) if row.index == place else row for row in problem.rows)
        return replace(problem, rows=rows).missing(frozenset({index}), frozenset())

    found = shortest_settling(question, 0, most, known, counts)
    if found is None:
        return Relaxation(index, None, None)
    relaxed = (start + side * found[0]) * step
    return Relaxation(index, abs(relaxed - limit.limit), relaxed)


def reason_by_formula(problem: ScenarioProblem) -> str:
    """Why no controller at all can do what is asked; empty where no formula shows it."""
    return "; ".join(dict.fromkeys(_reasons(problem)))


def _reasons(problem: ScenarioProblem) -> Iterator[str]:
    digital = problem.spec.digital
    assert digital is not None
    plants = Plants.members(problem.spec.plant, problem.corners)
    held = discretize_plants(plants, digital.sample_time_s)
    low, high = digital.output_limits or (-math.inf, math.inf)
    for row in problem.rows:
        limit, run = row.limit, row.run
        if limit.relation is not Relation.AT_MOST:
            continue
        final, load = run.steps[-1].value, 0.0 if run.run.signals.load is None else float(run.run.signals.load[-1])
        if limit.measure in ("settling_time_s", "final_error") and np.isfinite(held.static_gain).all():
            # what a control within its limits holds: P(0) (u + load)
            ends = held.static_gain[:, None] * (np.array([low, high]) + load)
            away = np.maximum(np.maximum(ends.min(axis=1) - final, final - ends.max(axis=1)), 0.0)
            allowed = run.steps[-1].band if limit.measure == "settling_time_s" else limit.limit
            if away.max() > allowed * (1.0 + _SAME):
                yield (
                    f"{_words(limit)}: the control's limits {low:g} .. {high:g} hold the output no closer to "
                    f"{final:g} than {away.max():.4g} with a plant of the family"
                )
        if limit.measure in ("acceleration_m_s2", "peak_rate_per_s") and run.horizon.first == 0:
            states, past = held.initial_state(run.run.start)
            rate = np.einsum("mi,mi->m", held.rate_state, states) + held.rate_input * past
            worst = float(np.abs(rate).max()) / (run.per_m_s if limit.measure == "acceleration_m_s2" else 1.0)
            if worst > limit.limit * (1.0 + _SAME):
                yield (
                    f"{_words(limit)}: before: {run.spec.before} alone changes the output by {worst:.4g} at the start, "
                    "whatever the gains are"
                )


def _words(limit: Limit) -> str:
    return f"{limit.measure} {limit.relation.value.replace('_', ' ')} {limit.limit:g}"
