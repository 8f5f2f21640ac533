"""Check a bound without searching:  every box again in ball arithmetic, and the incumbent by the verification.

Only the spec is trusted.  The conditions, the root boxes and the incumbent's objective are derived from it again.  What
tells how the file came about is tested as far as it follows from the rest: `boxes` are at least those of the tree, and
the reason why a search ended is one of those that exist.  `versions` is not tested.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from flint import ctx

from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.optimum.branch_and_bound import Termination
from fopi_tune.optimum.certify import (
    NOTHING_SHOWN,
    better_gains_reason,
    incumbent_refusal,
    met_reason,
    verified,
    why_no_bound,
)
from fopi_tune.optimum.documents import OptimumDocument, to_document
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.combinations import Combination, are_excluded_together
from fopi_tune.optimum.pruning.conditions import Condition, Test, conditions_of, is_maximized, kind_of
from fopi_tune.optimum.pruning.exclusion import Reason, is_excluded
from fopi_tune.optimum.results import OptimumProof, OptimumStatus, objective_size, relative_gap
from fopi_tune.optimum.tree import uses_every_reason, walk
from fopi_tune.proof import Verification
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.proof.strict_json import first_difference
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import DesignSpec

#: relative; the objective is computed the same way again, but perhaps on another machine
_SAME = 1e-9
#: relative; the rounding of gains that a reason names
_SIX_DIGITS = 1e-5


@dataclass(frozen=True)
class OptimumRecheck:
    """Result of checking a bound.

    Args:
        status: as the file states it.
        leaves: number of boxes tested.
        problems: errors found; empty when the file is sound.
        notes: what is not confirmed and need not be for the statements to be true.
    """

    status: OptimumStatus
    leaves: int
    problems: tuple[str, ...]
    notes: tuple[str, ...] = ()

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
    assert isinstance(document, dict)
    problems = [*_differences(stated, document), *_inconsistencies(stated, spec)]
    leaves = 0
    if stated.proof is not None and not problems:
        with ctx.workprec(PRECISION):
            leaves, found = _check_proof(stated.proof, spec)
        problems += found
    if not problems:
        problems += _check_gains(stated, spec)
    return OptimumRecheck(stated.status, leaves, tuple(problems))


def _differences(stated: OptimumDocument, document: dict[str, Any]) -> list[str]:
    """Entries that do not follow from the others: sentences, counts, and what no such file has."""
    again = to_document(stated.to_optimum(), stated.versions)
    wrong = sorted(document.keys() ^ again.keys())
    if wrong:
        return [f"{key[:40]!r} is missing, or no entry of such a file" for key in wrong]
    found = (first_difference(document[key], again[key], key) for key in again)
    return [f"{place} does not follow from the rest of the file" for place in found if place is not None]


def _inconsistencies(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    """Contradictions between the file's statements, and to the spec."""
    s = stated
    searched = s.status is not OptimumStatus.NO_BOUND
    gap = None if s.objective is None or s.bound is None else relative_gap(kind_of(spec), s.objective, s.bound)
    wrong = {
        "the file is about another spec": (s.name, s.spec_sha256) != (spec.name, spec.text_sha256),
        "what is said to be left out of the proof is not what is": s.left_out != conditions_of(spec, None).left_out,
        "the bound that is stated is not the one that is shown": s.bound != (s.proof.beat if s.proof else None),
        "the gap that is stated is not that of the bound and the objective": s.gap != gap,
        "a bound is stated without the objective that belongs to it": s.bound is not None and s.objective is None,
        "gains without their objective, or the reverse": searched and (s.objective is None) != (s.gains is None),
        "better gains without their objective, or the reverse": (s.better is None) != (s.better_objective is None),
        "better gains are stated without those that they beat": s.better is not None and s.objective is None,
        why_no_bound(spec): searched and why_no_bound(spec) != "",
    }
    return [words for words, is_wrong in wrong.items() if is_wrong] + _STATUS_CHECKS[s.status](s, spec)


def _certified(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    if stated.gap is None or not stated.gap <= stated.wanted_gap:
        return ["the gap that is stated is not the one that was asked for"]
    return ["a reason why there is no bound is given beside one"] if stated.reason else _boxes(stated, exactly=False)


def _infeasible(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    if stated.proof is None or stated.proof.beat is not None:
        return ["that there are no gains is stated, but not shown"]
    if stated.gains is not None or stated.objective is not None:
        return ["gains are stated of a spec that is said to have none"]
    return ["a reason why nothing is shown is given beside a proof"] if stated.reason else _boxes(stated, exactly=True)


def _limit_reached(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    if stated.proof is not None and stated.proof.beat is None:
        return ["it is shown that there are no gains, but not stated"]
    if stated.gap is not None and stated.gap <= stated.wanted_gap:
        return ["the gap that was asked for is reached, but that it is not is stated"]
    if stated.reason not in _reasons_of_a_search(stated, spec):
        return ["the reason that is given is not one why a search ends like this"]
    return _boxes(stated, exactly=False)


def _no_bound(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    numbers = (stated.proof, stated.objective, stated.bound, stated.gap, stated.better, stated.better_objective)
    if any(number is not None for number in numbers) or stated.boxes != 0:
        return ["a proof, a number or boxes are stated of a search that never began"]
    return []


_STATUS_CHECKS = {
    OptimumStatus.CERTIFIED: _certified,
    OptimumStatus.INFEASIBLE: _infeasible,
    OptimumStatus.LIMIT_REACHED: _limit_reached,
    OptimumStatus.NO_BOUND: _no_bound,
}


def _boxes(stated: OptimumDocument, exactly: bool) -> list[str]:
    """A search looks at every box of its tree; one for a single level looks at each of them once."""
    boxes = sum(len(cover.tokens) for cover in stated.proof.covers) if stated.proof else 0
    wrong = stated.boxes != boxes if exactly else stated.boxes < boxes
    told = f"the search is said to have looked at {counted(stated.boxes, 'box', 'boxes')}; its tree has {boxes}"
    return [told] if wrong else []


def _reasons_of_a_search(stated: OptimumDocument, spec: DesignSpec) -> tuple[str, ...]:
    """The reasons with which `certify_optimum` can end a search that did not reach what was asked for."""
    ended = tuple(termination.words for termination in Termination if termination.words)
    if stated.gains is None:
        return (*ended, *_met(stated.reason, spec))
    better = () if stated.better_objective is None else (better_gains_reason(stated.better_objective),)
    if stated.proof is None:
        return (*ended, NOTHING_SHOWN, *better)  # without a bound earlier files name what stopped the search
    if better:
        return better
    return (*ended, "")  # empty: the last level was shown, and no closer one was tried


def _met(reason: str, spec: DesignSpec) -> tuple[str, ...]:
    """The reason that names gains of the box which seem to meet the spec; empty when it does not."""
    names = tuple(spec.controller.ranges)
    told = ", ".join(rf"{name} = (\S+)" for name in names)
    found = re.fullmatch(f"{told} seem to meet every requirement", reason)
    try:
        values = [float(value) for value in found.groups()] if found is not None else []
        gains = spec.controller.controller(**{"alpha": 1.0, **dict(zip(names, values, strict=True))})
    except (ValueError, TypeError, DomainError):
        return ()
    sides = zip(spec.controller.ranges.values(), values, strict=True)
    inside = all(side.min - _SIX_DIGITS * abs(v) <= v <= side.max + _SIX_DIGITS * abs(v) for side, v in sides)
    return (met_reason(spec, gains),) if inside else ()


def _check_proof(proof: OptimumProof, spec: DesignSpec) -> tuple[int, list[str]]:
    """Number of tested leaves, and the first error."""
    problem = Problem.of(spec, proof.beat, proof.reference_rad_s)
    if tuple(cover.root for cover in proof.covers) != problem.roots:
        return 0, ["the boxes that are covered are not those of the spec"]
    if proof.reference_rad_s != problem.reference_rad_s:
        return 0, ["a reference frequency is stated where there is none, or none where there is one"]
    if any(reason.condition >= len(problem.conditions.every) for reason in proof.reasons):
        return 0, ["a reason names a condition that the spec does not have"]
    if not uses_every_reason(proof.covers, proof.reasons):
        return 0, ["the reasons are not those that the leaves use, each once and in the order of its first use"]
    for place, reason in enumerate(proof.reasons):
        if _has_unused_entries(problem, problem.conditions.every[reason.condition], reason):
            return 0, [f"reason {place} states a plant, or a side, that its condition does not depend on"]
    leaves = 0
    for place, cover in enumerate(proof.covers):
        # LOWER_CROSSOVER may discard only boxes of the first root: the others hold the required margin
        on_line = place > 0
        try:
            for box, reason in walk(cover, proof.reasons):
                leaves += 1
                controllers = problem.parametrization.controllers(box)
                if isinstance(reason, Combination):
                    is_discarded = are_excluded_together(problem, controllers, reason)
                else:
                    test = problem.conditions.every[reason.condition].test
                    if on_line and test is Test.LOWER_CROSSOVER:
                        words = "lies on a line of the fixed margin, where its reason says nothing"
                        return leaves, [f"box {leaves} {words}"]
                    is_discarded = is_excluded(problem, controllers, reason)
                if not is_discarded:
                    return leaves, [f"box {leaves} is not discarded by the reason that is given"]
        except ValueError as error:
            return leaves, [str(error)]
    return leaves, []


def _has_unused_entries(problem: Problem, condition: Condition, reason: Reason) -> bool:
    """Whether a reason states something that its test does not read, so that any other value would do."""
    if reason.above and (condition.test is not Test.SPREAD or not reason.omega):
        return True
    if condition.test in (Test.GAIN, Test.LOWER_CROSSOVER):
        return reason.point != ()
    constant = condition.test in (Test.RESPONSE, Test.SPREAD, Test.GAIN_SPREAD) and not reason.omega
    return constant and reason.point != problem.nominal


def _check_gains(stated: OptimumDocument, spec: DesignSpec) -> list[str]:
    """Errors in the gains and their objectives, and in the reason why there is no bound of them.

    Raises:
        CertificateError: gains that are no controller, or whose loop cannot be checked.
    """
    reason = why_no_bound(spec)
    try:
        found = verified(spec, stated.gains) if stated.gains is not None and not reason else None
        better = verified(spec, stated.better) if stated.better is not None else None
    except DomainError as error:
        raise CertificateError(str(error)) from None
    refusal = "" if stated.gains is None or found is None else incumbent_refusal(spec, stated.gains, found)
    if stated.status is OptimumStatus.NO_BOUND:
        told = stated.reason != "" and stated.reason == (reason or refusal)
        return [] if told else ["the reason that is given is not why there is no bound"]
    if refusal:
        return [refusal]
    problems = [] if found is None else _objective_problems(kind_of(spec), found, stated.objective)
    if better is not None and found is not None:
        problems += _check_better(stated, spec, found, better)
    return problems


def _objective_problems(kind: ObjectiveKind, found: Verification, stated: float | None) -> list[str]:
    if found.objective is None or stated is None:
        return ["the objective of these gains has no value, or none is stated"]
    if abs(found.objective - stated) <= _SAME * objective_size(kind, found.objective):
        return []
    return [f"the objective of these gains is {found.objective:.10g}, not {stated:.10g}"]


def _check_better(stated: OptimumDocument, spec: DesignSpec, found: Verification, better: Verification) -> list[str]:
    assert stated.better is not None
    assert found.objective is not None
    refusal = incumbent_refusal(spec, stated.better, better)
    if refusal:
        return [f"the gains that are said to be better: {refusal}"]
    assert better.objective is not None
    ahead = better.objective - found.objective
    if not (ahead > 0.0 if is_maximized(spec) else ahead < 0.0):
        return ["the gains that are said to be better are not"]
    return _objective_problems(kind_of(spec), better, stated.better_objective)
