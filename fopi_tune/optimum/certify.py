"""Optimality gap of given gains, or a proof that a spec is infeasible.

For a level of the objective every box of gains is discarded, either because some plant at some frequency violates a
requirement for all of its gains, or because their objective is not better than the level.  Levels approach the
incumbent's objective until the requested gap is reached, or better gains are found.
"""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass

import numpy as np
from flint import ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.digital.discretize import Method
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.errors import DomainError
from fopi_tune.optimum.branch_and_bound import BranchAndBound, Limits, Progress, Termination
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Conditions, conditions_of, is_maximized, kind_of, nominal_equality
from fopi_tune.optimum.pruning.sample_points import WorstCasePoint, typical_frequency_rad_s
from fopi_tune.optimum.pruning.screen import gains_at
from fopi_tune.optimum.results import Optimum, OptimumProof, OptimumStatus, objective_size, relative_gap
from fopi_tune.optimum.tree import Reasons, to_cover
from fopi_tune.proof import verify
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.proof.verification.results import Verification
from fopi_tune.spec.model import DesignSpec

_log = logging.getLogger(__name__)
#: a first gap, tried before the requested one
_COARSE = 0.1
#: the largest useful gap, and the ratio of a proved to a failed gap at which bisection ends
_LOOSEST, _CLOSE = 1.0, 1.15
#: factor of the requested gap, as a margin for rounding
_AIM = 1.0 - 1e-6
_RANGE_ROOM = 1e-9
#: the reason with which a search ends that has shown no level
NOTHING_SHOWN = "no level could be shown"


def certify_optimum(
    spec: DesignSpec,
    gains: FoPi | None,
    *,
    gap: float = 1e-3,
    time_limit_s: float = 60.0,
    most_boxes: int = 2_000_000,
    progress: Progress | None = None,
) -> Optimum:
    """Prove a bound of the objective that no gains in the spec's box can beat, or that no gains meet the spec.

    Args:
        spec: plant family, requirements and objective, of the loop in continuous time or on samples.
        gains: the incumbent; None to prove that the spec is infeasible.
        gap: requested relative distance of the bound from the incumbent's objective.
        time_limit_s: the gap reached by then is returned.
        most_boxes: the same limit in boxes.
        progress: called with (boxes examined, boxes open).

    Raises:
        DomainError: a gap or a limit that is not positive.
    """
    for name, value in (("gap", gap), ("time_limit_s", time_limit_s), ("most_boxes", most_boxes)):
        if not value > 0:
            raise DomainError(f"{name} = {value!r} must be greater than 0")
    start = time.monotonic()
    run = _Run(spec, gains, gap, start, Limits(start + time_limit_s, most_boxes), progress)
    reason = why_no_bound(spec)
    if reason:
        return run.without_bound(reason)
    found = None
    if gains is not None:
        found = verified(spec, gains)
        reason = incumbent_refusal(spec, gains, found)
        if reason:
            return run.without_bound(reason)
    with ctx.workprec(PRECISION):
        return run.infeasible() if found is None else run.bounded(found)


def met_reason(spec: DesignSpec, gains: FoPi) -> str:
    """The reason with which a search for a proof that there are no gains ends at some that seem to meet the spec."""
    told = ", ".join(f"{name} = {getattr(gains, name):.6g}" for name in spec.controller.ranges)
    return f"{told} seem to meet every requirement"


def better_gains_reason(objective: float) -> str:
    """The reason with which a search ends at gains that are better than the incumbent."""
    return f"there are better gains: their objective is {objective:.8g}"


def why_no_bound(spec: DesignSpec) -> str:
    """Why no bound can be proved for a spec; empty when one can."""
    if spec.sampled_design is not None and (why := _why_none_on_samples(spec, spec.sampled_design)):
        return why
    if spec.controller.filter_times is not None:
        return "there is no bound where a filter's time constant has a range"
    has_derivative = spec.controller.has_derivative
    if nominal_equality(spec, "crossover_rad_s") is not None and not has_derivative:
        return ""
    for name, side in spec.controller.ranges.items():
        if not math.isfinite(side.min) or not math.isfinite(side.max):
            end = "lower" if not math.isfinite(side.min) else "upper"
            return f"{name} has no {end} end, so that the box of gains cannot be searched; give it a range"
    return ""


def _why_none_on_samples(spec: DesignSpec, digital: DigitalSpec) -> str:
    """The filter must be a smooth function of alpha that does not depend on the loop."""
    if spec.controller.has_derivative:
        return "there is no bound for a controller with a derivative on samples (design: sampled)"
    if Method(digital.method) is Method.FIT:
        return "there is no bound on samples (design: sampled) with method: fit; take oustaloup or modified_oustaloup"
    if digital.depends_on_crossover:
        return "there is no bound on samples (design: sampled) with rule: matched or prewarp: crossover"
    return ""


def incumbent_refusal(spec: DesignSpec, gains: FoPi, found: Verification) -> str:
    """Why these gains do not meet the spec; empty when they do."""
    if not found.stability.stable:
        return f"the gains are no design of this spec: {found.stability.reason}"
    for result in found.requirements:
        if not result.is_met:
            return f"the gains are no design of this spec: they miss its requirement of {result.requirement.quantity}"
    if not spec.controller.has_structure_of(gains):
        return f"the gains are no design of this spec: they are not of structure {spec.controller.structure}"
    for name, side in spec.controller.ranges.items():
        value = getattr(gains, name)
        room = _RANGE_ROOM * max(1.0, abs(value))
        if not side.min - room <= value <= side.max + room:
            return f"the gains are no design of this spec: {name} = {value:g} is outside its range"
    if found.objective is None or not math.isfinite(found.objective):
        return "the objective of these gains has no finite value"
    return ""


@dataclass
class _Run:
    """One certification."""

    spec: DesignSpec
    gains: FoPi | None
    wanted: float
    start: float
    limits: Limits
    progress: Progress | None

    def without_bound(self, reason: str) -> Optimum:
        """Result without a proof."""
        return self._result(OptimumStatus.NO_BOUND, reason=reason)

    def infeasible(self) -> Optimum:
        """Try to prove that the spec is infeasible."""
        problem = Problem.of(self.spec, None, _rounded(typical_frequency_rad_s(self.spec.plant)))
        search = BranchAndBound.of(problem, self.limits, [], self.progress)
        termination = search.show(problem)
        while termination is Termination.BETTER and not (seeming := verified(self.spec, _gains(search))).all_met:
            search.learn(_worst_cases(seeming))
            termination = search.show(problem)
        if termination is Termination.SHOWN:
            return self._result(OptimumStatus.INFEASIBLE, search, proof=_proof(search, None))
        if termination is Termination.BETTER and search.better is not None:
            gains = _gains(search)
            return self._result(OptimumStatus.LIMIT_REACHED, search, reason=met_reason(self.spec, gains))
        return self._result(OptimumStatus.LIMIT_REACHED, search, reason=termination.words)

    def bounded(self, found: Verification) -> Optimum:
        """The level closest to the incumbent's objective that can be proved."""
        assert found.objective is not None
        objective = found.objective
        reference = found.nominal.crossover_rad_s or typical_frequency_rad_s(self.spec.plant)
        problem = Problem.of(self.spec, self._level(objective, _COARSE), _rounded(reference))
        search = BranchAndBound.of(problem, self.limits, _worst_cases(found), self.progress)
        shown, failed, termination = math.inf, 0.0, Termination.SHOWN
        proof: OptimumProof | None = None
        aim = self.wanted * _AIM
        # with both equalities the search space is small: try the requested gap first
        gap = aim if problem.margin_is_fixed else max(_COARSE, aim)
        while True:
            level = self._level(objective, gap)
            termination = search.show(problem.beating(level))
            _log.debug("%s: bound within a gap of %.3g: %s", self.spec.name, gap, termination.value)
            if termination is Termination.BETTER and self._better(search, found)[0] is None:
                search.learn(_worst_cases(verified(self.spec, _gains(search))))
                continue
            if termination is Termination.SHOWN:
                shown, proof = gap, _proof(search, level)
                if gap <= aim:
                    break
            else:
                failed = gap
            if termination is Termination.LIMIT:
                break
            if failed == 0.0:
                gap = aim
            elif math.isinf(shown):
                if gap >= _LOOSEST:
                    break
                gap = min(_LOOSEST, 3.0 * gap)
            elif shown / failed < _CLOSE:
                break
            else:
                gap = math.sqrt(shown * failed)
        return self._bounded_result(found, search, proof, termination)

    def _bounded_result(
        self, found: Verification, search: BranchAndBound, proof: OptimumProof | None, termination: Termination
    ) -> Optimum:
        better, better_objective = self._better(search, found)
        reason = termination.words if better_objective is None else better_gains_reason(better_objective)
        if proof is None or proof.beat is None:
            reason = reason or NOTHING_SHOWN
            return self._result(OptimumStatus.LIMIT_REACHED, search, found, None, reason, better, better_objective)
        assert found.objective is not None
        reached = relative_gap(kind_of(self.spec), found.objective, proof.beat)
        if reached <= self.wanted:
            return self._result(OptimumStatus.CERTIFIED, search, found, proof)
        return self._result(OptimumStatus.LIMIT_REACHED, search, found, proof, reason, better, better_objective)

    def _level(self, objective: float, gap: float) -> float:
        """The objective that is better than the incumbent's by the relative gap."""
        scale = gap * objective_size(kind_of(self.spec), objective)
        return objective + scale if is_maximized(self.spec) else objective - scale

    def _better(self, search: BranchAndBound, found: Verification) -> tuple[FoPi | None, float | None]:
        """Better gains found by the search, if the verification confirms them."""
        if search.better is None:
            return None, None
        gains = _gains(search)
        checked = verified(self.spec, gains)
        if incumbent_refusal(self.spec, gains, checked) or checked.objective is None or found.objective is None:
            return None, None
        ahead = checked.objective - found.objective
        if not (ahead > 0.0 if is_maximized(self.spec) else ahead < 0.0):
            return None, None
        return gains, checked.objective

    def _result(
        self,
        status: OptimumStatus,
        search: BranchAndBound | None = None,
        found: Verification | None = None,
        proof: OptimumProof | None = None,
        reason: str = "",
        better: FoPi | None = None,
        better_objective: float | None = None,
    ) -> Optimum:
        objective = None if found is None else found.objective
        bound = None if proof is None else proof.beat
        conditions: Conditions = conditions_of(self.spec, None)
        return Optimum(
            name=self.spec.name,
            spec_sha256=self.spec.text_sha256,
            status=status,
            gains=self.gains,
            objective=objective,
            bound=bound,
            gap=None if objective is None or bound is None else relative_gap(kind_of(self.spec), objective, bound),
            wanted_gap=self.wanted,
            better=better,
            better_objective=better_objective,
            boxes=0 if search is None else search.boxes_examined,
            seconds=time.monotonic() - self.start,
            proof=proof,
            left_out=conditions.left_out,
            reason=reason,
        )


def verified(spec: DesignSpec, gains: FoPi) -> Verification:
    """The verification of gains in the loop that the requirements are about."""
    return verify(spec, gains, implementation=designed_implementation(spec, gains))


def _worst_cases(found: Verification) -> list[WorstCasePoint]:
    """Where a verification found its worst values."""
    worst = [(e.worst.omega_rad_s, e.worst.point) for r in found.requirements for e in r.extremes]
    worst.append((found.stability.worst.omega_rad_s, found.stability.worst.point))
    if found.objective_worst is not None:
        worst.append((found.objective_worst.omega_rad_s, found.objective_worst.point))
    return worst


def _gains(search: BranchAndBound) -> FoPi:
    """The better gains found by the search."""
    assert search.better is not None
    return gains_at(search.problem.parametrization, np.array([search.better])).controller(
        search.problem.measurement_filter
    )


def _rounded(frequency_rad_s: float) -> float:
    """Few digits are enough, and the same on any machine."""
    return float(f"{frequency_rad_s:.3g}")


def _proof(search: BranchAndBound, beat: float | None) -> OptimumProof:
    reasons = Reasons()
    covers = tuple(to_cover(root, reasons) for root in search.roots)
    return OptimumProof(beat, search.problem.reference_rad_s, covers, tuple(reasons.indices))
