"""DesignSpec -> Candidate:  compile to a CasADi NLP, solve with Ipopt, exchange until nothing is violated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops
from fopi_tune.core.stability import is_stable
from fopi_tune.design.constraints import STABILITY_GUARD, Bound, Constraint, Scale, constraints_of, scale_of
from fopi_tune.design.exchange import Cuts, Exchange, ExchangeResult
from fopi_tune.design.nlp.slots import MarginPlant, Mode, Point
from fopi_tune.design.nlp.solve import Solved
from fopi_tune.design.starts import has_no_integral, small_starts, starts
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import NEPER_PER_DB, EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec, Requirement

#: inequalities are designed this much tighter (natural units), so that rounding does not undo them
TIGHTENING = 4e-7
#: requirements that give less than this (natural units, in sum) meet
MEETS = 2e-6
_STARTS = 8
#: of the objectives that are a largest member: from natural units to public ones
_PUBLIC_UNIT = {
    ObjectiveKind.PHASE_MARGIN_SPREAD: math.degrees(1.0),
    ObjectiveKind.CROSSOVER_SPREAD: 1.0 / NEPER_PER_DB,
    ObjectiveKind.SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: 1.0 / NEPER_PER_DB,
}
#: multipliers beyond this say only that limits coincide
_NO_PRICE = 1e5
#: solves a start may take before and after a first answer is known
_FIRST_ROUNDS = 60
_LATER_ROUNDS = 20


@dataclass(frozen=True)
class Neighbour:
    """A spec that was designed, from which others that differ in their limits are started; made by `neighbour`.

    Args:
        spec: the spec.
        gains: its gains.
        cuts: where these are worst; as cuts they are valid whatever the limits are.
    """

    spec: DesignSpec
    gains: FoPi
    cuts: Cuts

    def fits(self, spec: DesignSpec) -> bool:
        """Whether the cuts speak of the same plants and requirements."""
        mine, other = ([(*_about(r), r.scope, r.relation) for r in s.requirements] for s in (self.spec, spec))
        return self.spec.plant == spec.plant and self.spec.objective == spec.objective and mine == other


def _about(requirement: Requirement) -> tuple[str, float, float]:
    return requirement.quantity, requirement.from_rad_s, requirement.to_rad_s


@dataclass
class Search:
    """One spec's exchange and what it is started from."""

    spec: DesignSpec
    scale: Scale
    objective: ObjectiveKind
    exchange: Exchange
    starts: list[FoPi]
    first_cuts: Cuts
    #: the point where all requirements give least, once it was looked for
    relaxed: ExchangeResult | None = None

    @classmethod
    def of(cls, spec: DesignSpec, violations: Sequence[Violation], start: FoPi | Neighbour | None = None) -> Search:
        """Scale, compile and choose the starts."""
        constraints = constraints_of(spec)
        scale = scale_of(spec)
        objective = ObjectiveKind(spec.objective.quantity) if spec.objective else ObjectiveKind.DEPTH
        given = spec.objective.horizon_s if spec.objective else None
        horizon = given if given is not None else default_horizon_s(spec.plant)
        exchange = Exchange(spec.plant, scale, constraints, objective, horizon, spec.controller)
        near = start if isinstance(start, Neighbour) else None
        gains = near.gains if near is not None else start
        first = [gains] if isinstance(gains, FoPi) else starts(spec, scale, constraints, objective, _STARTS)
        known = near.cuts if near is not None and near.fits(spec) else None
        cuts = exchange.first_cuts() if known is None else known
        cuts = with_violations(cuts, constraints, violations)
        exchange.look_at(violations)
        if first and known is None:
            cuts = exchange.with_worst_of(cuts, first[0])
        return cls(spec, scale, objective, exchange, first, cuts)

    @property
    def all_requirements(self) -> frozenset[int]:
        """Indices of the spec's requirements."""
        return frozenset(range(len(self.spec.requirements)))

    def limits(self, tightening: float) -> tuple[float, ...]:
        """The constraints' limits, those of inequalities tightened."""
        return limits_of(self.exchange.constraints, tightening)

    def stable(self, gains: FoPi) -> bool:
        """Whether the sampled members of the family are stable."""
        try:
            return bool(is_stable(Loops.of(gains, self.exchange.oracle.plants)).all())
        except DomainError:
            # |L| stays on 1 over a whole range, or both gains are 0.
            return False

    def best(self) -> ExchangeResult | None:
        """The best of the local optima from all starts; None when no start leads to a feasible point."""
        found = self._from_all_starts(self.limits(TIGHTENING))
        if found is None and self._margins_may_be_endless():
            # Only now may plants have no gain crossover: a loop that does nothing has every margin.
            self.exchange.endless_margins = True
            self.starts += small_starts(self.spec, self.scale)
            found = self._from_all_starts(self.limits(TIGHTENING))
        if found is not None:
            return found
        # Limits that leave no room at all (an inequality at an equality's value) are met without the tightening.
        limits = self.limits(0.0)
        relaxed = self.elastic(self.all_requirements, self.all_requirements, limits)
        self.relaxed = relaxed
        if relaxed is None or relaxed.solved.relaxations.sum() > MEETS:
            return None
        # From a point that meets everything, ever smaller steps.
        for tried, trust_radius in ((self.limits(TIGHTENING), 4.0), (limits, 4.0), (limits, 0.5), (limits, 0.05)):
            run = self._run(relaxed.solved.gains, relaxed.cuts, tried, trust_radius=trust_radius)
            if run is not None and run.ok and run.solved.depth >= -TIGHTENING:
                return run
        # As many equalities as unknowns leave nothing to optimise: the feasible point is the answer.
        equalities = sum(constraint.bound is Bound.EQUAL for constraint in self.exchange.constraints)
        box = self.spec.controller
        free = sum(not gain.is_fixed for gain in (box.kp, box.ki, box.alpha))
        return relaxed if equalities >= free else None

    def _margins_may_be_endless(self) -> bool:
        """Whether plants without a gain crossover can meet what is asked of crossovers, and such plants can be.

        With integral action |L| falls from infinity, and through 1 unless the plant has a direct path.
        """
        at_crossovers = [
            s
            for s in self.exchange.constraints
            if s.requirement != STABILITY_GUARD
            and not s.nominal
            and s.where in (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)
        ]
        spreads = (ObjectiveKind.PHASE_MARGIN_SPREAD, ObjectiveKind.CROSSOVER_SPREAD)
        if not at_crossovers or self.objective in spreads:
            return False
        direct = bool(np.any(self.exchange.oracle.plants.log.slope_end() > -1e-9))
        lower_margins = all(s.quantity.is_margin and s.bound is Bound.LOWER for s in at_crossovers)
        return lower_margins and (direct or has_no_integral(self.spec.controller))

    def _from_all_starts(self, limits: tuple[float, ...]) -> ExchangeResult | None:
        cuts, best = self.first_cuts, None
        for start in self.starts:
            run = self._run(start, cuts, limits, best)
            if run is None or not run.ok or run.solved.depth < -TIGHTENING:
                continue
            # Cuts are valid for all gains: the next start profits from those that bind here.
            binding = self.exchange.binding(run.cuts, run.solved.gains)
            cuts = replace(
                binding,
                points=tuple(dict.fromkeys(self.first_cuts.points + binding.points)),
                peaks=(),
            )
            if best is None or not self.stable(best.solved.gains) or self.stable(run.solved.gains):
                best = run
        return best

    def _run(
        self,
        start: FoPi,
        cuts: Cuts,
        limits: tuple[float, ...],
        best: ExchangeResult | None = None,
        trust_radius: float = 4.0,
    ) -> ExchangeResult | None:
        def no_better(solved: Solved) -> bool:
            # A relaxation's optimum bounds what this start can still become.
            if best is None or not self.stable(best.solved.gains):
                return False
            known = self.cost(best.solved)
            return self.cost(solved) >= known - 1e-7 * max(1e-3, abs(known))

        everything = self.all_requirements
        rounds = _FIRST_ROUNDS if best is None else _LATER_ROUNDS
        try:
            mode, nobody = Mode.OBJECTIVE, frozenset[int]()
            return self.exchange.run(start, cuts, mode, everything, nobody, limits, no_better, rounds, trust_radius)
        except DomainError:
            # Both gains ran to 0: no loop is left to judge.
            return None

    def cost(self, solved: Solved) -> float:
        """What the objective makes of a solve; smaller is better."""
        if self.objective is ObjectiveKind.KI:
            return -solved.gains.ki
        return -solved.depth if self.objective is ObjectiveKind.DEPTH else solved.worst

    def public_objective(self, solved: Solved) -> float:
        """The objective as the solver sees it, in its public unit; without one the depth."""
        if self.objective is ObjectiveKind.KI:
            return solved.gains.ki
        if self.objective is ObjectiveKind.DEPTH:
            return solved.depth
        if self.objective is ObjectiveKind.IAE_DISTURBANCE:
            return math.exp(min(solved.worst, 600.0))
        return solved.worst * _PUBLIC_UNIT[self.objective]

    def elastic(
        self, active: frozenset[int], relaxed: frozenset[int], limits: tuple[float, ...]
    ) -> ExchangeResult | None:
        """The point where the requirements give least in sum, of several starts; None if Ipopt always gave up."""
        best = None
        known = self.relaxed
        first = (known.solved.gains,) if known else ()
        cuts = known.cuts if known else self.first_cuts
        for start in (*first, *self.starts[:3], *self.stable_starts()):
            try:
                run = self.exchange.run(start, cuts, Mode.FEASIBILITY, active, relaxed, limits)
            except DomainError:
                continue
            if not run.ok:
                continue
            total = run.solved.relaxations.sum()
            again = best is not None and abs(total - best.solved.relaxations.sum()) < 1e-6
            if best is None or total < best.solved.relaxations.sum():
                best = run
            if again or best.solved.relaxations.sum() <= MEETS:
                break
        return best

    def stable_starts(self) -> list[FoPi]:
        """Starts for stability alone, from which a spec that asks for the impossible can still be relaxed."""
        guards = tuple(
            constraint for constraint in self.exchange.constraints if constraint.requirement == STABILITY_GUARD
        )
        return starts(self.spec, self.scale, guards, ObjectiveKind.DEPTH, 2)

    def candidate(self, best: ExchangeResult) -> Candidate:
        """The answer for a feasible spec."""
        solved = best.solved
        status, message = Status.SOLVED, ""
        if solved.at_bound:
            status = Status.UNBOUNDED
            verb = "grow" if len(solved.at_bound) > 1 else "grows"
            message = f"{' and '.join(solved.at_bound)} {verb} without limit while the objective still improves"
        return Candidate(
            status, solved.gains, self._multipliers(solved), (), message,
            self.exchange.solves, best.rounds, len(best.cuts),
        )  # fmt: skip

    def _multipliers(self, solved: Solved) -> tuple[float | None, ...]:
        """d objective / d limit in public units, positive where relaxing gains."""
        unit = {
            ObjectiveKind.KI: solved.ki_scale,
            ObjectiveKind.IAE_DISTURBANCE: math.exp(min(solved.worst, 600.0)),
            ObjectiveKind.DEPTH: 1.0,
            **_PUBLIC_UNIT,
        }[self.objective]
        totals: list[float | None] = [None] * len(self.spec.requirements)
        for k, constraint in enumerate(self.exchange.constraints):
            if constraint.requirement == STABILITY_GUARD:
                continue
            price = float(solved.limit_prices[k]) * constraint.natural_per_public() * unit
            gain = abs(price) if constraint.bound is Bound.EQUAL else -constraint.bound.value * price
            totals[constraint.requirement] = max(totals[constraint.requirement] or 0.0, gain, 0.0)
        # Limits that leave no room between them have no price: the solver's numbers grow without bound.
        return tuple(None if total is not None and total > _NO_PRICE else total for total in totals)


def limits_of(constraints: Sequence[Constraint], tightening: float) -> tuple[float, ...]:
    """The limits of constraints, those of inequalities tightened by this much."""
    moved = (
        constraint.limit
        - constraint.bound.value * (0.0 if constraint.requirement == STABILITY_GUARD else tightening / constraint.scale)
        for constraint in constraints
    )
    return tuple(moved)


def with_violations(cuts: Cuts, constraints: tuple[Constraint, ...], violations: Sequence[Violation]) -> Cuts:
    """The cuts with those a check has found."""
    points, plants, margin_plants = list(cuts.points), list(cuts.plants), list(cuts.margin_plants)
    for violation in violations:
        omega, theta = violation.omega_rad_s, violation.theta
        at_end = omega == 0.0 or math.isinf(omega)
        asked = STABILITY_GUARD if violation.requirement is None else violation.requirement
        for k, constraint in enumerate(constraints):
            if constraint.requirement != asked:
                continue
            if at_end and omega in constraint.ends:
                points.append(Point(k, theta, omega))
            elif constraint.where is EvaluatedAt.BAND:
                if not math.isnan(omega) and not at_end:
                    points.append(Point(k, theta, min(max(omega, constraint.from_rad_s), constraint.to_rad_s)))
            elif constraint.where is EvaluatedAt.PHASE_CROSSOVERS:
                level = MarginPlant(k, theta, crossing=constraint.bound is not Bound.LOWER)
                margin_plants.append(replace(level, crossing=True) if level in margin_plants else level)
            else:
                plants.append(theta)
    return replace(
        cuts,
        points=tuple(dict.fromkeys(points)),
        plants=tuple(dict.fromkeys(plants)),
        margin_plants=tuple(dict.fromkeys(margin_plants)),
    )
