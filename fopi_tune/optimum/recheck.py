"""Check a bound without searching:  every box again in ball arithmetic, and the incumbent by the verification.

Only the spec is trusted.  The conditions, the root boxes and the incumbent's objective are derived from it again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import ctx

from fopi_tune.optimum.certify import incumbent_refusal, why_no_bound
from fopi_tune.optimum.documents import OptimumDocument
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Test, conditions_of
from fopi_tune.optimum.pruning.exclusion import is_excluded
from fopi_tune.optimum.results import OptimumProof, OptimumStatus, relative_gap
from fopi_tune.optimum.tree import walk
from fopi_tune.proof import verify
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.spec.model import DesignSpec

#: relative; the objective is computed the same way again, but perhaps on another machine
_SAME = 1e-9


@dataclass(frozen=True)
class OptimumRecheck:
    """Result of checking a bound.

    Args:
        status: as the file states it.
        leaves: number of boxes tested.
        problems: errors found; empty when the file is sound.
    """

    status: OptimumStatus
    leaves: int
    problems: tuple[str, ...]

    @property
    def is_sound(self) -> bool:
        """Whether every statement was confirmed."""
        return not self.problems


def recheck_optimum(document: object, spec: DesignSpec) -> OptimumRecheck:
    """Check a document about the best gains against a spec.

    Args:
        document: the file's JSON, as `json.load` gives it.
        spec: of the document.

    Raises:
        CertificateError: not such a document.
    """
    stated = OptimumDocument(document)
    problems = list(_inconsistencies(stated, spec))
    leaves = 0
    if stated.proof is not None and not problems:
        with ctx.workprec(PRECISION):
            leaves, found = _check_proof(stated.proof, spec)
        problems += found
    if not problems and stated.gains is not None and stated.objective is not None:
        problems += _check_incumbent(stated, spec)
    if not problems:
        problems += _check_wording(stated, spec)
    return OptimumRecheck(stated.status, leaves, tuple(problems))


def _inconsistencies(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    """Contradictions between the file's statements."""
    found = []
    if (stated.name, stated.spec_sha256) != (spec.name, spec.sha256):
        found.append("the file is about another spec")
    beat = stated.proof.beat if stated.proof else None
    if stated.status is OptimumStatus.INFEASIBLE and (stated.proof is None or beat is not None):
        found.append("that there are no gains is stated, but not shown")
    if stated.status is OptimumStatus.INFEASIBLE and (stated.gains is not None or stated.objective is not None):
        found.append("gains are stated of a spec that is said to have none")
    if stated.status is not OptimumStatus.INFEASIBLE and stated.bound != beat:
        found.append("the bound that is stated is not the one that is shown")
    if stated.bound is not None and (stated.objective is None or stated.gains is None or stated.gap is None):
        found.append("a bound is stated without the gains, the objective and the gap that belong to it")
    if stated.bound is None and stated.gap is not None:
        found.append("a gap is stated without a bound")
    if stated.status is OptimumStatus.CERTIFIED and (stated.gap is None or not stated.gap <= stated.wanted_gap):
        found.append("the gap that is stated is not the one that was asked for")
    if stated.status is OptimumStatus.NO_BOUND and stated.proof is not None:
        found.append("a proof is given of nothing")
    reason = why_no_bound(spec)
    if stated.proof is not None and reason:
        found.append(reason)
    return found


def _check_proof(proof: OptimumProof, spec: DesignSpec) -> tuple[int, list[str]]:
    """Number of tested leaves, and the first error."""
    problem = Problem.of(spec, proof.beat)
    if tuple(cover.root for cover in proof.covers) != problem.roots:
        return 0, ["the boxes that are covered are not those of the spec"]
    if any(reason.condition >= len(problem.conditions.every) for reason in proof.reasons):
        return 0, ["a reason names a condition that the spec does not have"]
    leaves = 0
    for place, cover in enumerate(proof.covers):
        # LOWER_CROSSOVER may discard only boxes of the first root: the second root holds the required margin
        on_line = problem.margin_is_fixed and place == len(proof.covers) - 1
        try:
            for box, reason in walk(cover, proof.reasons):
                leaves += 1
                test = problem.conditions.every[reason.condition].test
                if on_line and test is Test.LOWER_CROSSOVER:
                    return leaves, [f"box {leaves} lies on the line of the fixed margin, where its reason says nothing"]
                if not is_excluded(problem, problem.parametrization.controllers(box), reason):
                    return leaves, [f"box {leaves} is not discarded by the reason that is given"]
        except ValueError as error:
            return leaves, [str(error)]
    return leaves, []


def _check_incumbent(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    """Errors in the gains and their objective."""
    assert stated.gains is not None
    assert stated.objective is not None
    found = verify(spec, stated.gains)
    refusal = incumbent_refusal(spec, stated.gains, found)
    if refusal:
        return [refusal]
    assert found.objective is not None
    scale = max(abs(found.objective), 1e-6)
    if abs(found.objective - stated.objective) > _SAME * scale:
        return [f"the objective of these gains is {found.objective:.10g}, not {stated.objective:.10g}"]
    if stated.bound is None:
        return []
    gap = relative_gap(found.objective, stated.bound)
    if stated.gap is None or not math.isclose(gap, stated.gap, rel_tol=1e-6, abs_tol=_SAME):
        return ["the gap that is stated is not that of the bound and the objective"]
    return []


def _check_wording(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    """Sentences and summary numbers that do not follow from the proof."""
    found = []
    if stated.statement != stated.to_optimum().statement or stated.advice != stated.status.advice:
        found.append("the statement in words is not that of the numbers")
    if stated.proof is not None and stated.discarded_boxes != stated.proof.leaves:
        found.append("the number of discarded boxes is not that of the proof")
    if stated.proof is not None and stated.left_out != conditions_of(spec, stated.proof.beat).left_out:
        found.append("what is said to be left out of the proof is not what is")
    if stated.better is not None:
        checked = verify(spec, stated.better)
        objective, claimed = checked.objective, stated.better_objective
        same = objective is not None and claimed is not None and math.isclose(objective, claimed, rel_tol=_SAME)
        if not (same and checked.all_met):
            found.append("the gains that are said to be better are not, or their objective is another")
    return found
