"""Semi-infinite programming by exchange:  solve on few points, add the worst violator, solve again.

A requirement over a family is a constraint for every plant and every frequency.  The solver sees a handful of them; the
oracle finds where the answer is worst; that point joins the handful, until nothing is violated by more than the
tolerance.  A peak that keeps moving is followed by a slot with its own frequency, so that few rounds are enough; and
where a crossing appears that no cut speaks of, the search retreats to the last point where all was well.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.nlp.compile import PEAKS, Problem, compiled_problem
from fopi_tune.design.nlp.layout import TooManySlotsError
from fopi_tune.design.nlp.slots import MarginPlant, Mode, Point, Task
from fopi_tune.design.nlp.solve import Solved, solve
from fopi_tune.design.oracle import Finding, Oracle
from fopi_tune.design.sides import GUARD, Bound, Scale, Side
from fopi_tune.design.table import numbers_at, part_of
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import Where
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import ControllerSpec

#: a requirement is violated beyond this, in natural units
TOLERANCE = 2e-7
#: sides this far from violation are not refined
_NEAR = 0.1
_MOST_ROUNDS = 60
_MOST_STALE = 4
#: how far a solve may go from its start (see `Task`), at first and at the least
_TRUST = 4.0
_SMALLEST_TRUST = 0.1
_SMALLEST_RETREAT = 1e-4
#: points of a plant this near (in ln omega) belong to one peak
_SAME_PEAK = 0.7
_PEAK_OBJECTIVES = (ObjectiveKind.SENSITIVITY_PEAK, ObjectiveKind.CONTROL_SENSITIVITY_PEAK)
_FIRST_CAPACITY = 8


@dataclass(frozen=True)
class Cuts:
    """The plants and points in play."""

    points: tuple[Point, ...] = ()
    peaks: tuple[Point, ...] = ()
    plants: tuple[tuple[float, ...], ...] = ()
    margin_plants: tuple[MarginPlant, ...] = ()

    def __len__(self) -> int:
        return len(self.points) + len(self.peaks) + len(self.plants) + len(self.margin_plants)


@dataclass(frozen=True)
class Converged:
    """The end of an exchange.

    Args:
        solved: the last solve.
        ok: the solver succeeded and the oracle finds no violation.
        violation: the largest left, natural units; inf when the solver gave up.
        cuts: what was in play.
        rounds: solves it took.
    """

    solved: Solved
    ok: bool
    violation: float
    cuts: Cuts
    rounds: int


@dataclass
class Exchange:
    """The compiled problem, its oracle, and the loop between them.  Recompiled only when it runs out of slots."""

    family: PlantFamily
    scale: Scale
    sides: tuple[Side, ...]
    objective: ObjectiveKind
    horizon_s: float
    box: ControllerSpec
    capacity: int = _FIRST_CAPACITY
    solves: int = 0
    problem: Problem = field(init=False)
    oracle: Oracle = field(init=False)

    def __post_init__(self) -> None:
        self.oracle = Oracle(self.family, self.scale, self.sides, self.objective, self.horizon_s)
        self._compile()

    def _compile(self) -> None:
        self.problem = compiled_problem(
            self.family, self.scale, self.sides, self.objective, self.horizon_s, self.capacity
        )

    def about(self, sides: tuple[Side, ...]) -> Exchange:
        """The same compiled problem about the same sides with other limits."""
        other = copy.copy(self)
        other.sides, other.oracle = sides, self.oracle.about(sides)
        return other

    def first_cuts(self) -> Cuts:
        """What is in play before anything was solved.

        The nominal plant and the box's first corners, where anything is asked of gain crossovers; and for frequency
        functions
        a few frequencies of the nominal plant: without them the first solves put a notch where they are looked at.
        """
        nominal = tuple(self.family.nominal_point.tolist())
        asked = any(
            side.where in (Where.GAIN_CROSSOVERS, Where.HIGHEST_GAIN_CROSSOVER) and side.requirement != GUARD
            for side in self.sides
        )
        spread = self.objective in (ObjectiveKind.PHASE_MARGIN_SPREAD, ObjectiveKind.CROSSOVER_SPREAD)
        plants: list[tuple[float, ...]] = []
        if asked or spread or np.any(self.oracle.plants.unstable_poles > 0):
            plants = [nominal, tuple(self.family.low.tolist()), tuple(self.family.high.tolist())]
        points = [
            Point(k, nominal, omega)
            for k, side in enumerate(self.sides)
            if side.where is Where.BAND and side.requirement != GUARD
            for omega in self._seeds(side.from_rad_s, side.to_rad_s)
        ]
        if self.objective in (ObjectiveKind.SENSITIVITY_PEAK, ObjectiveKind.CONTROL_SENSITIVITY_PEAK):
            points += [Point(None, nominal, omega) for omega in self._seeds(0.0, math.inf)]
        if self.objective in (ObjectiveKind.CROSSOVER_SPREAD, ObjectiveKind.IAE_DISTURBANCE):
            points.append(Point(None, nominal, self.scale.omega_rad_s))
        return Cuts(points=tuple(dict.fromkeys(points)), plants=tuple(dict.fromkeys(plants)))

    def with_worst_of(self, cuts: Cuts, gains: FoPi) -> Cuts:
        """The cuts and where these gains are worst: of each requirement, violated or not, and of the objective."""
        everything = frozenset(side.requirement for side in self.sides)
        return self._extended(cuts, self.oracle.worst(gains, 0.0), Mode.OBJECTIVE, everything, (), None, first=True)

    def binding(self, cuts: Cuts, gains: FoPi) -> Cuts:
        """The cuts without the fixed points that are far from binding at these gains."""
        points = [p for p in cuts.points if p.side is not None]
        if not points:
            return cuts
        loops = Loops.of(
            gains, Plants.members(self.family, np.array([p.theta for p in points]).reshape(len(points), -1))
        )
        numbers = numbers_at(loops, np.arange(len(points)), np.log([p.omega_rad_s for p in points]))
        far = {
            point
            for i, point in enumerate(points)
            if self.oracle.probes[point.side or 0].slack(part_of(numbers, slice(i, i + 1)), math.nan)[0] > _NEAR
        }
        return replace(cuts, points=tuple(p for p in cuts.points if p not in far))

    def _seeds(self, from_rad_s: float, to_rad_s: float) -> list[float]:
        """Frequencies around the spec's own, moved into a band."""
        spread = self.scale.omega_rad_s * 4.0 ** np.arange(-2.0, 3.0)
        return sorted({float(w) for w in np.clip(spread, from_rad_s, to_rad_s)})

    def run(
        self,
        start: FoPi,
        cuts: Cuts,
        mode: Mode,
        active: frozenset[int],
        giving: frozenset[int],
        limits: Sequence[float],
        hopeless: Callable[[Solved], bool] = lambda solved: False,
        most_rounds: int = _MOST_ROUNDS,
        trust: float = _TRUST,
        peaks: tuple[Point, ...] = (),
    ) -> Converged:
        """Exchange from one start until nothing is violated.

        Args:
            start: gains to start from.
            cuts: what is in play from the start.
            mode, active, giving, limits: see `Task`.
            hopeless: whether a solve of the relaxation is already no better than what is known.
            most_rounds: solves after which this start is given up.
            trust: how far the first solve may go; see `Task`.
            peaks: known ones of the start, followed from the first solve on.
        """
        rounds = 0
        cuts, gains, solved, violation = replace(cuts, peaks=peaks), start, None, math.inf
        safe, safe_violation = None, math.inf
        follow_from, patience, stale = 0, 2, 0
        for rounds in range(1, most_rounds + 1):
            task = Task(
                cuts.points, cuts.peaks, cuts.plants, cuts.margin_plants, tuple(limits), mode, active, giving, trust
            )
            solved = self._solve(task, gains)
            if not solved.success and cuts.peaks:
                # A peak that moves may also vanish; the fixed points near it stay in play.
                cuts, follow_from, patience = replace(cuts, peaks=()), rounds + patience, 2 * patience
                continue
            if solved.success and hopeless(solved) and not solved.on_trust_bound:
                break
            findings = self._findings(solved)
            violation = max((self._violation(f, mode, active, limits, solved) for f in findings), default=math.inf)
            if violation <= TOLERANCE:
                if not solved.on_trust_bound:
                    return Converged(solved, True, violation, cuts, rounds)
                safe, safe_violation, gains = solved, violation, solved.gains
                continue
            larger = self._extended(cuts, findings, mode, active, limits, solved, first=False)
            if rounds >= follow_from:
                larger = replace(larger, peaks=self._followed(cuts, larger))
            # Nothing new to put in: from here the same plants may cross elsewhere, so look again a few times.
            stale += len(larger) == len(cuts)
            if solved.success and (len(larger) > len(cuts) or (stale <= _MOST_STALE and safe is None)):
                cuts, gains = larger, solved.gains
                continue
            # Ipopt lost its way, or a crossing appears that no cut speaks of: look closer to where all was well.
            if trust <= (_SMALLEST_TRUST if safe is None else _SMALLEST_RETREAT):
                break
            trust, gains = 0.25 * trust, safe.gains if safe else gains
        assert solved is not None
        if safe is not None and not hopeless(safe):
            return Converged(safe, True, safe_violation, cuts, rounds)
        return Converged(solved, False, violation, cuts, rounds)

    def _findings(self, solved: Solved) -> list[Finding]:
        """Where a solve's answer is worst; nothing when there is no answer, or no loop left to look at."""
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
        """By how much a finding contradicts the solver's view; <= 0 when it does not."""
        if finding.side is None:
            if mode is Mode.FEASIBILITY:
                return -math.inf
            return -finding.slack - (solved.worst if solved else -math.inf)
        side = self.sides[finding.side]
        if side.requirement not in active and side.requirement != GUARD:
            return -math.inf
        # The oracle measures against the sides' own limits, the solve may use others.
        slack = finding.slack + side.bound.value * (limits[finding.side] - side.limit) * side.scale
        if solved is None:
            return -slack
        k = finding.side
        give = float(solved.gives[2 * k] + solved.gives[2 * k + 1])
        return (solved.depth if side.in_depth else 0.0) - slack - give

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
        """The cuts with the findings that are violated (the first time: with the worst of each side)."""
        points, plants, margin_plants = list(cuts.points), list(cuts.plants), list(cuts.margin_plants)
        for finding in findings:
            side = None if finding.side is None else self.sides[finding.side]
            if not first and self._violation(finding, mode, active, limits, solved) <= 0.5 * TOLERANCE:
                continue
            if first and side is not None and side.requirement == GUARD and not side.in_depth:
                continue
            theta = tuple(float(v) for v in finding.theta)
            if side is None:
                self._add_objective_member(points, plants, finding, theta)
            elif side.where is Where.BAND:
                points.append(Point(finding.side, theta, finding.omega_rad_s))
            elif side.where is Where.PHASE_CROSSOVERS:
                if not first or side.bound is not Bound.LOWER:
                    # First as a level; where the phase dips below -180 deg before that level, as a crossing too.
                    level = MarginPlant(finding.side or 0, theta, crossing=side.bound is not Bound.LOWER)
                    margin_plants.append(replace(level, crossing=True) if level in margin_plants else level)
            else:
                plants.append(theta)
        return Cuts(
            tuple(dict.fromkeys(points)), cuts.peaks, tuple(dict.fromkeys(plants)), tuple(dict.fromkeys(margin_plants))
        )

    def _followed(self, before: Cuts, after: Cuts) -> tuple[Point, ...]:
        """The peaks in play: where a new point lies beside an older one of the same plant, the peak has moved."""
        peaks = list(before.peaks)
        for new in set(after.points) - set(before.points):
            if new.side is None and self.objective not in _PEAK_OBJECTIVES:
                continue
            if new.side is not None:
                side = self.sides[new.side]
                ends = (side.from_rad_s, side.to_rad_s)
                if any(0.0 < w < math.inf and abs(math.log(w / new.omega_rad_s)) < 1e-6 for w in ends):
                    continue
            same = [p for p in before.points if p.side == new.side and _beside(p, new)]
            if not same:
                continue
            peaks = [p for p in peaks if not (p.side == new.side and _beside(p, new))]
            if sum(p.side == new.side for p in peaks) < PEAKS:
                peaks.append(new)
        return tuple(peaks)

    def _add_objective_member(
        self, points: list[Point], plants: list[tuple[float, ...]], finding: Finding, theta: tuple[float, ...]
    ) -> None:
        if self.objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
            plants.append(theta)
        else:
            points.append(Point(None, theta, finding.omega_rad_s))


def _beside(a: Point, b: Point) -> bool:
    """Whether two points are of the same plant and the same peak, as far as one can tell from the frequency."""
    return a.theta == b.theta and abs(math.log(a.omega_rad_s / b.omega_rad_s)) < _SAME_PEAK
