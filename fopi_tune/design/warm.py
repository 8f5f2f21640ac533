"""One spec solved again and again while its limits move:  limits, neighbour's gains -> Solution.

Limits are parameters of the compiled problem, so that nothing is compiled again.  A cut (a plant and a frequency at
which something is asked) is valid whatever the limits are; the ones that bind are handed from solve to solve.  Three
ways, each dearer and surer than the one before:

    glance     one solve on the cuts in play; the check of its answer has to say whether a cut was missing
    settle     the exchange, until nothing is violated
    anew       every start, as for a design
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fopi_tune.core.controller import FoPi
from fopi_tune.design.constraints import Bound, Constraint, constraints_of
from fopi_tune.design.exchange import Cuts, Exchange, ExchangeResult
from fopi_tune.design.nlp.layout import TooManySlotsError
from fopi_tune.design.nlp.slots import PEAKS_OF, Mode, Point, Task
from fopi_tune.design.nlp.solve import Solved, solve
from fopi_tune.design.reasons import branches, reason_without_solving
from fopi_tune.design.search import TIGHTENING, Search, Violation, limits_of, with_violations
from fopi_tune.design.synthesis import best_of
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import DesignSpec

#: a requirement this near its limit (neper or radian) is followed at its plant's own peak
_NEAR = 0.05
#: cuts of a kind that are handed on
_MOST_KEPT = 12


@dataclass(frozen=True)
class Seen:
    """Where a check found a requirement (None: the objective) worst.

    Args:
        requirement: index in the spec's list; None for the objective.
        theta: the plant's place in the box, shape (p,).
        omega_rad_s: the frequency; nan where none decides.
        slack: how far from the limit, natural units.
    """

    requirement: int | None
    theta: tuple[float, ...]
    omega_rad_s: float
    slack: float


@dataclass(frozen=True)
class Solution:
    """An answer of the solver; nothing has checked it yet.

    Args:
        gains: the controller.
        objective: in its public unit, as the solver sees it.
        solves: how many it took.
    """

    gains: FoPi
    objective: float
    solves: int = 1


@dataclass
class Warm:
    """A spec's compiled problem, and the cuts that bind where it was solved last.

    Args:
        search: the compiled problem.
        cuts: places where it is asked something.
    """

    search: Search
    cuts: Cuts

    @classmethod
    def of(cls, spec: DesignSpec, gains: FoPi) -> Warm:
        """Compile once.

        Args:
            spec: with any limits.
            gains: of a design of it, from which the first cuts are taken.
        """
        ways = branches(spec)
        # with ki = 0 the search is another one
        way = next((w for w in ways if w.controller.ki.min <= gains.ki <= w.controller.ki.max), ways[0])
        search = Search.of(way, (), gains)
        return cls(search, search.first_cuts)

    def fits(self, spec: DesignSpec) -> bool:
        """Whether the compiled problem is also that of this spec, which differs in its limits alone.

        A delay margin's slack is relative to its limit; where the slack itself is the objective, it is compiled in.
        """
        if self.search.objective is not ObjectiveKind.DEPTH:
            return True
        pairs = zip(self.search.exchange.constraints, constraints_of(spec), strict=True)
        return all(old.scale == new.scale for old, new in pairs)

    def glance(self, spec: DesignSpec, start: FoPi, seen: Sequence[Seen] = ()) -> Solution | None:
        """One solve, of a problem that may lack a cut; None when the solver gave up or went too far.

        Its objective is at least as good as that of the whole problem's local optimum: where a check of the gains
        agrees with it, and finds every requirement met, nothing was missing.  `seen` are places that a check found.
        """
        exchange = self.search.exchange.with_constraints(constraints_of(spec))
        cuts = self._with_seen(exchange, seen)
        for peaks in (self._peaks(exchange.constraints, seen), ()):
            solved = self._solved(exchange, replace(cuts, peaks=peaks), start)
            if solved is not None:
                self._keep(exchange, cuts, solved.gains)
                return Solution(solved.gains, self.search.public_objective(solved))
            if not peaks:
                break
        return None

    def settle(self, spec: DesignSpec, start: FoPi, seen: Sequence[Seen] = ()) -> Solution | None:
        """The exchange from a neighbour's gains and from places `seen` by a check; None when it leads nowhere."""
        exchange = self.search.exchange.with_constraints(constraints_of(spec))
        cuts = self._with_seen(exchange, seen)
        peaks = self._peaks(exchange.constraints, seen)
        # small steps: a neighbour is near, and few cuts hold larger ones back.  Limits that leave no room at all
        # are met without the tightening
        for tightening, trust_radius in ((TIGHTENING, 0.5), (0.0, 0.1)):
            limits = limits_of(exchange.constraints, tightening)
            run = self._run(
                exchange, start, replace(cuts, peaks=peaks), Mode.OBJECTIVE, limits, trust_radius=trust_radius
            )
            if run is not None and run.solved.depth >= -TIGHTENING and not run.solved.at_bound:
                self._keep(exchange, run.cuts, run.solved.gains)
                return Solution(run.solved.gains, self.search.public_objective(run.solved), run.rounds)
        return None

    def anew(self, spec: DesignSpec) -> Solution | None:
        """Every start of every branch, as for a design; None when none leads to a feasible point."""
        if reason_without_solving(spec) is not None:
            return None
        found = best_of([Search.of(branch, ()) for branch in branches(spec)])
        if found is None or found[1].solved.at_bound:
            return None
        search, best = found
        return Solution(best.solved.gains, search.public_objective(best.solved), best.rounds)

    def farthest(self, spec: DesignSpec, start: FoPi, requirement: int) -> tuple[float, FoPi] | None:
        """How near the limit of one requirement can come to what the spec asks, all others held.

        Args:
            spec: with a limit that cannot be met, or can.
            start: gains that meet all the other requirements.
            requirement: index of the one that gives; it has one limit.

        Returns:
            The limit (the spec's own when it can be met), and gains there; None when the solver gave up.
        """
        exchange = self.search.exchange.with_constraints(constraints_of(spec))
        limits = limits_of(exchange.constraints, TIGHTENING)
        run = self._run(exchange, start, self.cuts, Mode.FEASIBILITY, limits, frozenset({requirement}))
        if run is None:
            return None
        k, constraint = next((k, s) for k, s in enumerate(exchange.constraints) if s.requirement == requirement)
        given = float(run.solved.relaxations[2 * k] - run.solved.relaxations[2 * k + 1])
        direction = 1.0 if constraint.bound is Bound.EQUAL else float(constraint.bound.value)
        return constraint.quantity.from_natural(
            constraint.limit + direction * given / constraint.scale
        ), run.solved.gains

    def _run(
        self,
        exchange: Exchange,
        start: FoPi,
        cuts: Cuts,
        mode: Mode,
        limits: tuple[float, ...],
        relaxed: frozenset[int] = frozenset(),
        trust_radius: float = 4.0,
    ) -> ExchangeResult | None:
        try:
            everything = self.search.all_requirements
            run = exchange.run(
                start, cuts, mode, everything, relaxed, limits, trust_radius=trust_radius, peaks=cuts.peaks
            )
        except DomainError:
            # Both gains ran to 0: no loop is left to judge.
            return None
        return run if run.ok else None

    def _solved(self, exchange: Exchange, cuts: Cuts, start: FoPi) -> Solved | None:
        limits, everything = limits_of(exchange.constraints, TIGHTENING), self.search.all_requirements
        task = Task(
            cuts.points,
            cuts.peaks,
            cuts.plants,
            cuts.margin_plants,
            limits,
            Mode.OBJECTIVE,
            everything,
            trust_radius=1.0,
        )
        try:
            solved = solve(exchange.problem, exchange.box, task, start, 1.0)
        except (TooManySlotsError, DomainError):
            return None
        usable = solved.success and not solved.on_trust_boundary and not solved.at_bound and solved.depth >= -TIGHTENING
        return solved if usable else None

    def _keep(self, exchange: Exchange, cuts: Cuts, gains: FoPi) -> None:
        """What the next solve starts with: the cuts that bind, of each kind the newest."""
        mine = self.search.exchange
        mine.problem, mine.capacity, mine.solves = exchange.problem, exchange.capacity, exchange.solves
        binding = exchange.binding(cuts, gains)
        constraints = dict.fromkeys(p.constraint for p in binding.points)
        points = [
            p
            for constraint in constraints
            for p in [p for p in binding.points if p.constraint == constraint][-_MOST_KEPT:]
        ]
        # the nominal plant stays the first
        plants = (*binding.plants[:1], *binding.plants[1:][-_MOST_KEPT:])
        self.cuts = Cuts(tuple(points), (), plants, binding.margin_plants[-_MOST_KEPT:])

    def _with_seen(self, exchange: Exchange, seen: Sequence[Seen]) -> Cuts:
        """The cuts in play and the places where a check found the neighbour's gains worst."""
        asked = [Violation(s.requirement, s.theta, s.omega_rad_s) for s in seen if s.requirement is not None]
        cuts = with_violations(self.cuts, exchange.constraints, asked)
        points, plants = list(cuts.points), list(cuts.plants)
        for place in seen:
            if place.requirement is not None:
                continue
            if self.search.objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
                plants.append(place.theta)
            elif self.search.objective in PEAKS_OF:
                if not math.isnan(place.omega_rad_s):
                    points.append(Point(None, place.theta, place.omega_rad_s))
            elif self.search.objective in (ObjectiveKind.CROSSOVER_SPREAD, ObjectiveKind.IAE_DISTURBANCE):
                points.append(Point(None, place.theta, self.search.scale.omega_rad_s))
        return replace(cuts, points=tuple(dict.fromkeys(points)), plants=tuple(dict.fromkeys(plants)))

    def _peaks(self, constraints: tuple[Constraint, ...], seen: Sequence[Seen]) -> tuple[Point, ...]:
        """Peaks that move with the limits: fixed points would have to be put in again at every step."""
        peaks: list[Point] = []
        for place in seen:
            if not _is_a_frequency(place.omega_rad_s) or place.slack > _NEAR:
                continue
            if place.requirement is None and self.search.objective in PEAKS_OF:
                peaks.append(Point(None, place.theta, place.omega_rad_s))
            for k, constraint in enumerate(constraints):
                inside = constraint.from_rad_s * (1 + 1e-6) < place.omega_rad_s < constraint.to_rad_s * (1 - 1e-6)
                if constraint.requirement == place.requirement and constraint.where is EvaluatedAt.BAND and inside:
                    peaks.append(Point(k, place.theta, place.omega_rad_s))
        return tuple(dict.fromkeys(peaks))


def _is_a_frequency(omega_rad_s: float) -> bool:
    return 0.0 < omega_rad_s < math.inf
