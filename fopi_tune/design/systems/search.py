"""SystemProblem -> SystemCandidate:  scattered gains, simplex searches, exchange of the worst pairs of plants."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.design.systems.problem import MET, TIGHTENING, Judged, Question, SystemProblem, unit_of
from fopi_tune.results.status import Relaxation
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.spec.measures import ACCELERATION, PER_M_S, velocity_unit
from fopi_tune.spec.model import Relation, SystemSpec

#: gains that are scattered, for each tuned mode
_SCATTERED = 192
#: simplex searches, evaluations of each, and of each round of the exchange
_STARTS, _EVALUATIONS, _LAST_EVALUATIONS = 4, 160, 260
_ROUNDS = 6
#: edges of the first simplex in the unit cube: of a start, and of rounds after it
_EDGE, _NEAR_EDGE = 0.06, 0.01
#: relative, by which a relaxed limit is moved farther than the search found necessary
_CLEARANCE = 1e-4


@dataclass(frozen=True)
class SystemCandidate:
    """The answer, before it is checked.

    Args:
        gains: of every mode; None where no gains give stable loops.
        judged: what they do with a dense sample of both families; None without gains.
        evaluations: how many gains were simulated.
        reasons: why requirements cannot be met by any gains, as formulas show; none otherwise.
        clash: where they are not met: requirements on scenarios that were not found to hold together, and by how much
            each would have to be relaxed; none where the modes' own loops miss theirs.
    """

    gains: Mapping[str, FoPi] | None
    judged: Judged | None
    evaluations: int
    reasons: tuple[str, ...] = ()
    clash: tuple[Relaxation, ...] = ()

    @property
    def is_met(self) -> bool:
        """Whether everything holds for the sample."""
        return self.judged is not None and self.judged.holds_without()


def design_system(system: SystemSpec, fixed: Mapping[str, FoPi]) -> SystemCandidate:
    """Gains of the tuned modes that meet the requirements with every pair of plants, and minimise the objective.

    Args:
        system: with an objective and tuned modes.
        fixed: gains of the modes that are not tuned.

    Raises:
        DomainError: a mode's digital controller cannot be made.
    """
    search = _Search(SystemProblem(system, fixed))
    reasons = tuple(dict.fromkeys(reasons_by_formula(system)))
    found = search.best()
    if found is None:
        return SystemCandidate(None, None, search.evaluations, reasons)
    candidate = SystemCandidate(search.problem.gains(found.x), found.judged, search.evaluations, reasons)
    if candidate.is_met:
        return candidate
    clash = tuple(_clash(search, found.x))
    return replace(candidate, clash=clash, evaluations=search.evaluations)


def _clash(search: _Search, nearest: Array) -> Iterator[Relaxation]:
    """Requirements of which none can be left out, each with the limit that it would need beside all others."""
    requirements = search.problem.system.requirements
    every = frozenset(range(len(requirements)))
    together = search.refined(nearest, Question(missed=every))
    if together.judged.loops > MET:
        return
    clash = every
    for index in sorted(every):
        rest = clash - {index}
        if rest and search.refined(together.x, Question(missed=rest, ignored=every - rest)).missed(rest) > MET:
            clash = rest
    for index in sorted(clash):
        found = search.refined(together.x, Question(missed=frozenset({index})))
        miss = found.judged.missed[index] + TIGHTENING
        if not (found.judged.holds_without(frozenset({index})) and np.isfinite(miss)):
            yield Relaxation(index, None, None)
            continue
        requirement = requirements[index]
        moved = max(miss, 0.0) * (1.0 + _CLEARANCE) * unit_of(requirement)
        side = 1.0 if requirement.relation is Relation.AT_MOST else -1.0
        yield Relaxation(index, moved, requirement.limit + side * moved)


@dataclass(frozen=True, eq=False)
class _Found:
    """A point of the unit cube, and what its gains do with a dense sample of both families."""

    x: Array
    judged: Judged

    def missed(self, requirements: Iterable[int]) -> float:
        """The largest miss of some requirements, or of the modes' own loops."""
        return max(self.judged.loops, *(self.judged.missed[index] for index in requirements))


class _Search:
    def __init__(self, problem: SystemProblem) -> None:
        self.problem, self.points, self.evaluations = problem, problem.corners, 0
        self.size = problem.count

    def best(self) -> _Found | None:
        """The best gains from scattered ones; None where none give stable loops."""
        from scipy.stats import qmc

        problem = self.problem
        count = 2 ** int(np.ceil(np.log2(_SCATTERED * len(problem.tuned))))
        cube = qmc.Sobol(self.size, scramble=False).random(count)[1:]
        judged = [self._judge(x) for x in cube]
        finite = [each.objective for each in judged if each is not None and np.isfinite(each.objective)]
        if not finite:
            return None
        question = Question(scale=max(float(np.median(finite)), 1e-12))
        order = sorted(range(len(cube)), key=lambda k: question.merit(judged[k]))
        starts = self._apart([cube[k] for k in order])
        ends = [self._simplex(x, question, _EDGE, _EVALUATIONS) for x in starts]
        return self.refined(min(ends, key=lambda end: end[1])[0], question, _LAST_EVALUATIONS)

    def refined(self, x: Array, question: Question, evaluations: int = _EVALUATIONS) -> _Found:
        """The best gains near others, of which stable loops are known; the worst pairs of plants are exchanged."""
        problem, start = self.problem, x
        for _ in range(_ROUNDS):
            # a fresh simplex: the old one may have collapsed on a kink
            x = self._simplex(x, question, _NEAR_EDGE, evaluations)[0]
            x = self._simplex(x, question, 0.1 * _NEAR_EDGE, _EVALUATIONS)[0]
            everywhere = problem.judge(problem.gains(x), problem.family)
            if everywhere is None:
                break
            new = [problem.family[k] for k in dict.fromkeys(everywhere.worst)]
            known = {tuple(point) for point in self.points}
            added = [point for point in new if tuple(point) not in known]
            here = problem.judge(problem.gains(x), self.points)
            worse = here is None or question.violation(everywhere) > max(question.violation(here), MET)
            higher = here is None or question.aim(everywhere) > question.aim(here) * (1.0 + 1e-6)
            if not added or not (worse or higher):
                break
            self.points = np.vstack([self.points, *[point[None, :] for point in added]])
        ends = [(end, problem.judge(problem.gains(end), problem.family)) for end in (x, start)]
        return next(_Found(end, judged) for end, judged in ends if judged is not None)

    def _judge(self, x: Array) -> Judged | None:
        self.evaluations += 1
        return self.problem.judge(self.problem.gains(x), self.points)

    def _simplex(self, start: Array, question: Question, edge: float, most: int) -> tuple[Array, float]:
        """Nelder and Mead's search within the unit cube; ends are those of the gains' ranges."""
        from scipy.optimize import minimize

        inside = np.clip(start, 0.0, 1.0)
        corners = [inside]
        for axis in range(self.size):
            corner = inside.copy()
            corner[axis] += edge if corner[axis] + edge <= 1.0 else -edge
            corners.append(corner)
        found = minimize(
            lambda x: question.merit(self._judge(x)), inside, method="Nelder-Mead", bounds=[(0.0, 1.0)] * self.size,
            options={"maxfev": most, "initial_simplex": np.array(corners), "xatol": 1e-9, "fatol": 1e-11},
        )  # fmt: skip
        return np.clip(found.x, 0.0, 1.0), float(found.fun)

    def _apart(self, points: list[Array]) -> list[Array]:
        kept: list[Array] = []
        for point in points:
            if all(np.abs(point - other).max() > 0.12 for other in kept):
                kept.append(point)
            if len(kept) == _STARTS:
                break
        return kept


def reasons_by_formula(system: SystemSpec) -> Iterator[str]:
    """Requirements on the rate that no gains meet, because a mode begins where the plant alone is too fast.

    The second mode begins at the first sample where the output is on its line or above.  Its control is not
    positive, so that the output of a lag falls by at least y/tau; from the initial output that is there at once.
    """
    lowering = system.modes[1]
    digital = lowering.spec.digital
    limits = (-np.inf, np.inf) if digital is None or digital.output_limits is None else digital.output_limits
    if limits[1] > 0.0 or lowering.spec.plant.dead_time.max > 0.0 or len(lowering.spec.plant.assemble({})[1]) != 2:
        return
    held = discretize_plants(Plants.members(lowering.spec.plant, lowering.spec.plant.corners()), system.sample_time_s)
    if not np.all(held.rate_input > 0.0):
        return
    for limit in system.requirements:
        if limit.measure not in (ACCELERATION, "peak_rate_per_s") or limit.relation is not Relation.AT_MOST:
            continue
        unit = velocity_unit(system.measurement_unit)
        factor = PER_M_S[unit] if limit.measure == ACCELERATION and unit is not None else 1.0
        for scenario in system.scenarios:
            if limit.scenario not in (None, scenario.name):
                continue
            first = scenario.reference[0]
            setpoint = first.value if first.at_s == 0.0 and first.ramp_s == 0.0 else scenario.initial_output
            entry = scenario.initial_output
            if entry < system.lines.up.level(setpoint) or entry <= 0.0 or scenario.judged_from_s > 0.0:
                continue
            # dy/dt = -p y + K u <= -p y
            least = float(np.abs(held.rate_state[:, 0] * entry).max()) / factor
            if least > limit.limit:
                yield (
                    f"{limit.measure} at most {limit.limit:g} in scenario {scenario.name}: the {lowering.name}'s mode "
                    f"begins at once at {entry:g}, where its plant alone slows by {least:.3g}; let the setpoint fall "
                    "in a ramp"
                )
