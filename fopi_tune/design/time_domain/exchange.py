"""Local searches with few plants, exchanged with the worst ones of the family until none is worse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.local_search import Local, local_search
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.model import Modeller
from fopi_tune.design.time_domain.numbers import Numbers
from fopi_tune.design.time_domain.problem import TIGHTENING, ScenarioProblem
from fopi_tune.design.time_domain.starts import starts_of
from fopi_tune.design.time_domain.worst_plants import Family, Worst
from fopi_tune.digital.implementation import nominal_crossover
from fopi_tune.errors import DomainError

#: starts and scattered gains; where the control meets its limits there are more local optima
_STARTS, _SCATTERED = 4, 200
_STARTS_LIMITED, _SCATTERED_LIMITED = 8, 500
#: convex problems of a start, and of a round of the exchange
_STEPS_OF_START, _STEPS = 12, 40
_ROUNDS = 15
#: local optima that are exchanged
_EXCHANGED = 2
#: in the units of rows, and of the objective relative: what counts as met and as equal
MET, _EQUAL = 5e-7, 1e-7
#: plants that are kept
_MOST_PLANTS = 60


@dataclass
class Counts:
    """Work done."""

    steps: int = 0
    rounds: int = 0
    simulated: int = 0
    plants: int = 0


@dataclass(frozen=True, eq=False)
class Exchanged:
    """The answer of an exchange.

    Args:
        gains: the gains.
        objective: over the family; of a smallest slack its negative.
        violation: of what must hold, in the rows' units; 0 where everything holds.
        worst: the worst plant of each row of scenarios.
        local: the last local search, with the prices.
        cuts: of the loop.
    """

    gains: FoPi
    objective: float
    violation: float
    worst: dict[tuple[int, str], Worst] = field(repr=False)
    local: Local = field(repr=False)
    cuts: LoopCuts = field(repr=False)

    @property
    def rank(self) -> tuple[float, float]:
        """By which answers are compared: what is missed, then the objective."""
        return (self.violation if self.violation > MET else 0.0), self.objective


def solve(
    problem: ScenarioProblem, counts: Counts, known: Sequence[FoPi] = (), thorough: bool = True
) -> Exchanged | None:
    """The best gains found; None where no gains give every plant a stable loop.

    Args:
        problem: the problem.
        counts: of the work, added to.
        known: gains that may be close.
        thorough: whether the whole box is searched beside them.
    """
    cuts = LoopCuts(_at_crossover(problem, known[0]).loop if known else problem.loop)
    starts = list(known)
    if thorough or not starts:
        limited = _is_limited(problem)
        starts += starts_of(
            problem, cuts, _STARTS_LIMITED if limited else _STARTS, _SCATTERED_LIMITED if limited else _SCATTERED
        )
    found = local_optima(problem, cuts, starts, counts)
    best: Exchanged | None = None
    tried: list[Local] = []
    for local in found:
        if len(tried) == _EXCHANGED:
            break
        if any(_same(problem.numbers, local, other) for other in tried):
            continue
        tried.append(local)
        one = exchange(problem, local.gains, counts)
        if one is not None and (best is None or one.rank < best.rank):
            best = one
    return best


def local_optima(problem: ScenarioProblem, cuts: LoopCuts, starts: Sequence[FoPi], counts: Counts) -> list[Local]:
    """Where short searches with the vertices of the box end, the best first."""
    modeller, found = Modeller(problem, cuts, problem.corners), []
    for start in starts:
        cuts.pool = []
        local = local_search(modeller, start, _STEPS_OF_START)
        if local is not None:
            counts.steps += local.steps
            found.append(local)
    return sorted(found, key=_rank)


def exchange(problem: ScenarioProblem, start: FoPi, counts: Counts) -> Exchanged | None:
    """The local optimum over the whole family."""
    family = Family(problem)
    points, gains, best = problem.corners, start, None
    cuts = LoopCuts(_at_crossover(problem, start).loop)
    for _ in range(_ROUNDS):
        counts.rounds += 1
        modeller = Modeller(problem, cuts, points)
        local = local_search(modeller, gains, _STEPS)
        if local is None:
            return best
        counts.steps += local.steps
        gains = local.gains
        try:
            worst = family.worst(gains)
        except DomainError:
            return best
        answer = _answer(problem, local, worst, cuts)
        if best is None or answer.rank < best.rank or local.model.violation <= MET:
            best = answer
        counts.simulated, counts.plants = counts.simulated + family.simulated, max(counts.plants, len(points))
        family.simulated = 0
        new = _new_points(problem, local, worst, points)
        moved = LoopCuts(_at_crossover(problem, gains).loop)
        same_filter = not problem.loop.needs_crossover or moved.problem.is_exact_at(
            cuts.problem.scaled.samples.crossover_rad_s if cuts.problem.scaled.samples is not None else None
        )
        if not len(new) and same_filter:
            return answer
        if not same_filter:
            cuts = moved
        points = np.vstack([points, new]) if len(new) else points
        if len(points) > _MOST_PLANTS:
            break
    return best


def _answer(problem: ScenarioProblem, local: Local, worst: dict[tuple[int, str], Worst], cuts: LoopCuts) -> Exchanged:
    missed = [worst[row.key].value for row in problem.rows if not row.in_depth]
    violation = max([0.0, cuts_violation(cuts, local.gains), *missed])
    objective = local.model.objective
    if problem.objective is not None:
        objective = worst[problem.objective.key].value
    in_depth = [worst[row.key].value for row in problem.rows if row.in_depth]
    return Exchanged(local.gains, max([objective, *in_depth]), violation, worst, local, cuts)


def cuts_violation(cuts: LoopCuts, gains: FoPi) -> float:
    """By how much the loop's requirements are missed over the family; inf where it is unstable."""
    found = cuts.look(gains)
    return math.inf if found is None else cuts.violation(found)


def _new_points(
    problem: ScenarioProblem, local: Local, worst: dict[tuple[int, str], Worst], points: np.ndarray
) -> np.ndarray:
    """Plants that are worse than all that are known."""
    slack = max(local.model.violation, 0.0)
    new = []
    for row in problem.rows:
        found = worst[row.key]
        least = local.model.objective if row.in_depth else slack - 0.5 * TIGHTENING
        if found.value > least + (_EQUAL * max(1.0, abs(least)) if row.in_depth else 0.0):
            new.append(found.point)
    if problem.objective is not None:
        found = worst[problem.objective.key]
        if found.value > local.model.objective + _EQUAL * max(abs(local.model.objective), 1e-12):
            new.append(found.point)
    size = np.maximum(problem.spec.plant.high - problem.spec.plant.low, 1e-300)
    kept: list[np.ndarray] = []
    for point in map(np.array, sorted(set(new))):
        known = np.vstack([points, *kept]) if kept else points
        if not np.any(np.all(np.abs(known - point) <= 1e-9 * size, axis=1)):
            kept.append(point)
    return np.array(kept, dtype=float).reshape(len(kept), points.shape[1])


def _at_crossover(problem: ScenarioProblem, gains: FoPi) -> ScenarioProblem:
    """The same problem with a filter that is exact at the gains' crossover, where it depends on that."""
    from dataclasses import replace

    if not problem.loop.needs_crossover or gains.is_zero:
        return problem
    return replace(problem, loop=problem.loop.exact_at(nominal_crossover(problem.spec, gains)))


def _is_limited(problem: ScenarioProblem) -> bool:
    """Whether the control can meet a limit."""
    digital = problem.spec.digital
    limited = digital is not None and (digital.output_limits is not None or digital.output_rate_per_s is not None)
    return limited or any(math.isfinite(run.spec.rate_per_s) for run in problem.runs)


def _rank(local: Local) -> tuple[float, float]:
    violation = local.model.violation
    return (violation if violation > MET else 0.0), local.model.objective


def _same(numbers: Numbers, one: Local, other: Local) -> bool:
    a, b = (numbers.of(each.gains) for each in (one, other))
    return bool(np.all(np.abs(a - b) <= 0.01 * np.maximum(np.abs(a), np.abs(b)) + 1e-12))
