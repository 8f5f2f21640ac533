"""Semi-infinite programming by exchange:  solve on few points, add the worst violator, solve again.

A requirement over a family is a constraint for every plant and every frequency.  The solver is given a few of them, the
cuts.  The oracle finds where the solution violates the requirements most, and that point becomes a cut, until nothing
is violated by more than the tolerance.  A peak that moves from round to round gets a slot whose frequency is a
variable, which saves rounds.  Where a crossing appears that no cut covers, the trust region shrinks around the last
solution without violations.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import STABILITY_GUARD, Bound, Constraint, Scale
from fopi_tune.design.nlp.compile import Problem, compiled_problem
from fopi_tune.design.nlp.layout import TooManySlotsError
from fopi_tune.design.nlp.rows import PEAKS
from fopi_tune.design.nlp.slots import PEAKS_OF, MarginPlant, Mode, Point, Task, peak_reaches
from fopi_tune.design.nlp.solve import Solved, solve
from fopi_tune.design.oracle import Oracle
from fopi_tune.design.probes import Finding
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import ControllerSpec

#: a requirement is violated beyond this, in natural units
TOLERANCE = 2e-7
#: natural units; constraints with more slack than this are not refined
_NEAR = 0.1
_MOST_ROUNDS = 60
_MOST_ROUNDS_WITHOUT_CUT = 4
#: radius of the trust region (see `Task`): the first, the smallest, and the smallest around a feasible solution
_TRUST_RADIUS = 4.0
_SMALLEST_TRUST_RADIUS = 0.1
_SMALLEST_FEASIBLE_RADIUS = 1e-4
_FIRST_CAPACITY = 8


@dataclass(frozen=True)
class Cuts:
    """The cuts: fixed points, moving peaks, plants with their gain crossovers, and plants with their gain margins."""

    points: tuple[Point, ...] = ()
    peaks: tuple[Point, ...] = ()
    plants: tuple[tuple[float, ...], ...] = ()
    margin_plants: tuple[MarginPlant, ...] = ()

    def __len__(self) -> int:
        return len(self.points) + len(self.peaks) + len(self.plants) + len(self.margin_plants)


@dataclass(frozen=True)
class ExchangeResult:
    """The result of an exchange, converged or not.

    Args:
        solved: the last solve.
        ok: the solver succeeded and the oracle finds no violation.
        violation: the largest remaining, natural units; inf when the solver failed.
        cuts: those of the last solve.
        rounds: number of solves.
    """

    solved: Solved
    ok: bool
    violation: float
    cuts: Cuts
    rounds: int


@dataclass
class Exchange:
    """The compiled problem, its oracle, and the iteration between them.  It is recompiled when it has too few slots."""

    family: PlantFamily
    scale: Scale
    constraints: tuple[Constraint, ...]
    objective: ObjectiveKind
    horizon_s: float
    box: ControllerSpec
    capacity: int = _FIRST_CAPACITY
    solves: int = 0
    endless_margins: bool = False
    problem: Problem = field(init=False)
    oracle: Oracle = field(init=False)

    def __post_init__(self) -> None:
        self.oracle = Oracle(self.family, self.scale, self.constraints, self.objective, self.horizon_s)
        self._compile()

    def _compile(self) -> None:
        self.problem = compiled_problem(
            self.family, self.scale, self.constraints, self.objective, self.horizon_s, self.capacity
        )

    def with_constraints(self, constraints: tuple[Constraint, ...]) -> Exchange:
        """The same compiled problem with other limits of the same constraints."""
        other = copy.copy(self)
        other.constraints, other.oracle = constraints, self.oracle.with_constraints(constraints)
        return other

    def look_at(self, violations: Sequence[Violation]) -> None:
        """Let the oracle look at the plants and frequencies of these too, from now on."""
        frequencies = [v.omega_rad_s for v in violations if 0.0 < v.omega_rad_s < math.inf]
        self.oracle = self.oracle.with_places([v.theta for v in violations], frequencies)

    def first_cuts(self) -> Cuts:
        """The cuts of the first solve.

        The nominal plant and the lowest and highest corner of the box, where a requirement concerns gain crossovers;
        and for frequency functions a few frequencies of the nominal plant.  With fewer frequencies the first solves
        meet the requirement by a notch at the cuts.
        """
        nominal = tuple(self.family.nominal_point.tolist())
        needs_crossover = any(
            constraint.where in (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)
            and constraint.requirement != STABILITY_GUARD
            for constraint in self.constraints
        )
        spread = self.objective in (ObjectiveKind.PHASE_MARGIN_SPREAD, ObjectiveKind.CROSSOVER_SPREAD)
        plants: list[tuple[float, ...]] = []
        if needs_crossover or spread or np.any(self.oracle.plants.unstable_poles > 0):
            plants = [nominal, tuple(self.family.low.tolist()), tuple(self.family.high.tolist())]
        points = [
            Point(k, nominal, omega)
            for k, constraint in enumerate(self.constraints)
            if constraint.where is EvaluatedAt.BAND and constraint.requirement != STABILITY_GUARD
            for omega in self._first_frequencies(constraint.from_rad_s, constraint.to_rad_s)
        ]
        if self.objective in (ObjectiveKind.SENSITIVITY_PEAK, ObjectiveKind.CONTROL_SENSITIVITY_PEAK):
            points += [Point(None, nominal, omega) for omega in self._first_frequencies(0.0, math.inf)]
        if self.objective in (ObjectiveKind.CROSSOVER_SPREAD, ObjectiveKind.IAE_DISTURBANCE):
            points.append(Point(None, nominal, self.scale.omega_rad_s))
        return Cuts(points=tuple(dict.fromkeys(points)), plants=tuple(dict.fromkeys(plants)))

    def with_worst_of(self, cuts: Cuts, gains: FoPi) -> Cuts:
        """The cuts and the worst points of these gains, of every constraint and of the objective, violated or not."""
        everything = frozenset(constraint.requirement for constraint in self.constraints)
        return self._extended(cuts, self.oracle.worst(gains, 0.0), Mode.OBJECTIVE, everything, (), None, first=True)

    def binding(self, cuts: Cuts, gains: FoPi) -> Cuts:
        """The cuts without the fixed points that are far from binding at these gains."""
        far = {
            point
            for point in cuts.points
            if point.constraint is not None
            and self.oracle.slack(point.constraint, point.theta, point.omega_rad_s, gains) > _NEAR
        }
        return replace(cuts, points=tuple(p for p in cuts.points if p not in far))

    def _first_frequencies(self, from_rad_s: float, to_rad_s: float) -> list[float]:
        """Frequencies around the characteristic one, clipped to a band."""
        spread = self.scale.omega_rad_s * 4.0 ** np.arange(-2.0, 3.0)
        return sorted({float(w) for w in np.clip(spread, from_rad_s, to_rad_s)})

    def run(
        self,
        start: FoPi,
        cuts: Cuts,
        mode: Mode,
        active: frozenset[int],
        relaxed: frozenset[int],
        limits: Sequence[float],
        dominated: Callable[[Solved], bool] = lambda solved: False,
        most_rounds: int = _MOST_ROUNDS,
        trust_radius: float = _TRUST_RADIUS,
        peaks: tuple[Point, ...] = (),
    ) -> ExchangeResult:
        """Exchange from one start until nothing is violated.

        Args:
            start: gains to start from.
            cuts: those of the first solve.
            mode, active, relaxed, limits: see `Task`.
            dominated: whether the optimum on the cuts alone, a bound, is no better than a known solution.
            most_rounds: number of solves after which the exchange stops.
            trust_radius: of the first solve; see `Task`.
            peaks: known peaks of the start, as moving peaks of the first solve.
        """
        rounds = 0
        cuts, gains, solved, violation = replace(cuts, peaks=peaks), start, None, math.inf
        safe, safe_violation = None, math.inf
        follow_from, patience, stale = 0, 2, 0
        for rounds in range(1, most_rounds + 1):
            task = Task(
                cuts.points,
                cuts.peaks,
                cuts.plants,
                cuts.margin_plants,
                tuple(limits),
                mode,
                active,
                relaxed,
                trust_radius,
                self.endless_margins,
            )
            solved = self._solve(task, gains)
            if not solved.success and cuts.peaks:
                # A moving peak may vanish; the fixed points near it remain cuts.
                cuts, follow_from, patience = replace(cuts, peaks=()), rounds + patience, 2 * patience
                continue
            if solved.success and dominated(solved) and not solved.on_trust_boundary:
                break
            findings = self._findings(solved)
            violation = max((self._violation(f, mode, active, limits, solved) for f in findings), default=math.inf)
            if violation <= TOLERANCE:
                if not solved.on_trust_boundary:
                    return ExchangeResult(solved, True, violation, cuts, rounds)
                safe, safe_violation, gains = solved, violation, solved.gains
                continue
            larger = self._extended(cuts, findings, mode, active, limits, solved, first=False)
            if rounds >= follow_from:
                larger = replace(larger, peaks=self._moving_peaks(cuts, larger))
            # No new cut: from these gains the same plants may have other crossings, so solve again a few times.
            stale += len(larger) == len(cuts)
            if solved.success and (len(larger) > len(cuts) or (stale <= _MOST_ROUNDS_WITHOUT_CUT and safe is None)):
                cuts, gains = larger, solved.gains
                continue
            # Ipopt failed, or a crossing appears that no cut covers: shrink the trust region around the safe solution.
            if trust_radius <= (_SMALLEST_TRUST_RADIUS if safe is None else _SMALLEST_FEASIBLE_RADIUS):
                break
            trust_radius, gains = 0.25 * trust_radius, safe.gains if safe else gains
        assert solved is not None
        if safe is not None and not dominated(safe):
            return ExchangeResult(safe, True, safe_violation, cuts, rounds)
        return ExchangeResult(solved, False, violation, cuts, rounds)

    def _findings(self, solved: Solved) -> list[Finding]:
        """The worst points of a solution; none when the solver failed or both gains are 0."""
        if not solved.success:
            return []
        try:
            return self.oracle.worst(solved.gains, solved.depth + _NEAR)
        except DomainError:
            return []

    def _solve(self, task: Task, gains: FoPi) -> Solved:
        while True:
            try:
                self.solves += 1
                return solve(self.problem, self.box, task, gains, 1.0)
            except TooManySlotsError:
                self.capacity *= 2
                self._compile()

    def _violation(
        self, finding: Finding, mode: Mode, active: frozenset[int], limits: Sequence[float], solved: Solved | None
    ) -> float:
        """By how much a finding exceeds what the solver assumed; <= 0 when it does not."""
        if finding.constraint is None:
            if mode is Mode.FEASIBILITY:
                return -math.inf
            return -finding.slack - (solved.worst if solved else -math.inf)
        constraint = self.constraints[finding.constraint]
        if constraint.requirement not in active and constraint.requirement != STABILITY_GUARD:
            return -math.inf
        # The oracle's slack refers to the constraints' own limits, the solve may use others.
        slack = (
            finding.slack + constraint.bound.value * (limits[finding.constraint] - constraint.limit) * constraint.scale
        )
        if solved is None:
            return -slack
        k = finding.constraint
        relaxation = float(solved.relaxations[2 * k] + solved.relaxations[2 * k + 1])
        return (solved.depth if constraint.in_depth else 0.0) - slack - relaxation

    def _extended(
        self,
        cuts: Cuts,
        findings: list[Finding],
        mode: Mode,
        active: frozenset[int],
        limits: Sequence[float],
        solved: Solved | None,
        first: bool,
    ) -> Cuts:
        """The cuts and the violated findings (with `first`: the worst finding of each constraint)."""
        points, plants, margin_plants = list(cuts.points), list(cuts.plants), list(cuts.margin_plants)
        for finding in findings:
            constraint = None if finding.constraint is None else self.constraints[finding.constraint]
            if not first and self._violation(finding, mode, active, limits, solved) <= 0.5 * TOLERANCE:
                continue
            if (
                first
                and constraint is not None
                and constraint.requirement == STABILITY_GUARD
                and not constraint.in_depth
            ):
                continue
            theta = tuple(float(v) for v in finding.theta)
            if constraint is None:
                self._add_objective_member(points, plants, finding, theta)
            elif constraint.where is EvaluatedAt.BAND or not 0.0 < finding.omega_rad_s < math.inf:
                if finding.slack < math.inf:
                    points.append(Point(finding.constraint, theta, finding.omega_rad_s))
            elif constraint.where is EvaluatedAt.PHASE_CROSSOVERS:
                if not first or constraint.bound is not Bound.LOWER:
                    # First as a level; if violated again, as a phase crossing: the phase fell below -180 deg earlier.
                    level = MarginPlant(finding.constraint or 0, theta, crossing=constraint.bound is not Bound.LOWER)
                    margin_plants.append(replace(level, crossing=True) if level in margin_plants else level)
            else:
                plants.append(theta)
        return Cuts(
            tuple(dict.fromkeys(points)), cuts.peaks, tuple(dict.fromkeys(plants)), tuple(dict.fromkeys(margin_plants))
        )

    def _moving_peaks(self, before: Cuts, after: Cuts) -> tuple[Point, ...]:
        """The moving peaks: those of before, and each new point that is close to an earlier one of the same plant."""
        peaks = list(before.peaks)
        for new in set(after.points) - set(before.points):
            if new.is_limit or (new.constraint is None and self.objective not in PEAKS_OF):
                continue
            if new.constraint is not None:
                constraint = self.constraints[new.constraint]
                ends = (constraint.from_rad_s, constraint.to_rad_s)
                if any(0.0 < w < math.inf and abs(math.log(w / new.omega_rad_s)) < 1e-6 for w in ends):
                    continue
            reach = float(peak_reaches(self.family, [new])[0])
            same = [p for p in before.points if _beside(p, new, reach)]
            if not same:
                continue
            peaks = [p for p in peaks if not _beside(p, new, reach)]
            if sum(p.constraint == new.constraint for p in peaks) < PEAKS:
                peaks.append(new)
        return tuple(peaks)

    def _add_objective_member(
        self, points: list[Point], plants: list[tuple[float, ...]], finding: Finding, theta: tuple[float, ...]
    ) -> None:
        if self.objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
            plants.append(theta)
        else:
            points.append(Point(None, theta, finding.omega_rad_s))


def _beside(a: Point, b: Point, reach: float) -> bool:
    """Whether two points are of the same constraint and plant and, judged by frequency, of the same peak."""
    same = a.constraint == b.constraint and a.theta == b.theta and not a.is_limit
    return same and abs(math.log(a.omega_rad_s / b.omega_rad_s)) < reach
