"""Requirements on the loop's frequency response with what was achieved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fopi_tune.proof.certificate import Certificate, RequirementProof
from fopi_tune.proof.verdict import Verdict
from fopi_tune.proof.verification.requirements import assess_requirement
from fopi_tune.proof.verification.results import Extreme, Outcome, RequirementResult, Verification
from fopi_tune.quantities import QUANTITIES
from fopi_tune.results.documents import finite, place_dict, price_dict, requirement_proof_dict
from fopi_tune.results.measured import NO_PROOF
from fopi_tune.results.status import Price
from fopi_tune.spec.model import Relation, Requirement


@dataclass(frozen=True)
class RequirementReport:
    """One requirement with what was achieved.

    Args:
        requirement: what the spec says.
        result: what the verification found; None when there are no gains to verify.
        multiplier: by how much the objective would improve if the limit were relaxed by one unit; None where not known.
        proof: what the certificate says; None without one.
        price: the multiplier checked by solving again; None where that was not asked for, or the multiplier is zero.
        is_checked: whether the plant is measured, of which there is no proof.
    """

    requirement: Requirement
    result: RequirementResult | None
    multiplier: float | None
    proof: RequirementProof | None = None
    price: Price | None = None
    is_checked: bool = False

    @property
    def verdict(self) -> str | None:
        """Of the certificate, or `checked` of measured responses; None without either, before `met` is asked."""
        if self.is_checked:
            undecided = self.result is not None and self.result.outcome is Outcome.UNDECIDED
            return "undecided" if undecided else "checked"
        return None if self.proof is None else self.proof.verdict.value

    def to_dict(self) -> dict[str, Any]:
        """As in the result's JSON; infinite and missing numbers are null, and `outcome` says which."""
        requirement, result = self.requirement, self.result
        limits = requirement.limits
        band = {
            "from_rad_s": finite(requirement.from_rad_s) or None,
            "to_rad_s": finite(requirement.to_rad_s),
        }
        return {
            "name": requirement.quantity,
            "relation": requirement.relation.value,
            "limit": list(limits) if requirement.relation is Relation.BETWEEN else limits[0],
            **({} if requirement.end_limit is None else {"limit_at_to_rad_s": requirement.end_limit}),
            "on": requirement.scope.value,
            **(band if any(band.values()) else {}),
            "achieved": finite(result.achieved) if result else None,
            **self._at_worst(),
            "outcome": result.outcome.value if result else None,
            "met": result.is_met if result else False,
            "score": finite(result.score) if result else None,
            "worst": place_dict(result.worst) if result else None,
            "multiplier": finite(self.multiplier),
            "multiplier_checked": price_dict(self.price),
            "proof": self._checked_dict() if self.is_checked else requirement_proof_dict(self.proof),
        }

    def _checked_dict(self) -> dict[str, Any] | None:
        """In place of a proof, of measured responses; None without gains."""
        if self.result is None:
            return None
        verdict = self.verdict if self.result.is_met or self.verdict == "undecided" else "violated"
        bounds = {"proved_from": None, "proved_to": None, "relative_gap": None, "boxes": 0}
        return {"verdict": verdict, **bounds, "reason": NO_PROOF}

    def _at_worst(self) -> dict[str, Any]:
        """Of a line of `by_frequency`, the value and the limit at the worst frequency."""
        requirement, result = self.requirement, self.result
        omega = None if result is None else result.worst.omega_rad_s
        if requirement.end_limit is None or result is None or result.achieved is None or omega is None:
            return {}
        there = requirement.value_at(result.achieved, omega)
        return {"achieved_at_worst": finite(there), "limit_at_worst": requirement.limit_at(omega)}


def requirement_reports(
    found: Verification, certificate: Certificate | None, is_checked: bool = False
) -> tuple[RequirementReport, ...]:
    """The requirements, each with its result and, with a certificate, its proof; `is_checked` of measured responses."""
    if certificate is None:
        return tuple(
            RequirementReport(result.requirement, result, None, is_checked=is_checked) for result in found.requirements
        )
    return tuple(
        RequirementReport(result.requirement, with_witness(result, proof, found.tolerance), None, proof)
        for result, proof in zip(found.requirements, certificate.requirements, strict=True)
    )


def with_witness(result: RequirementResult, proof: RequirementProof, tolerance: float) -> RequirementResult:
    """The result of a requirement that the verification took for met, with the value that a proof refutes it by.

    The proof looks at every plant and frequency, and may meet with a value that the verification missed.
    """
    if not result.is_met or proof.verdict is not Verdict.REFUTED:
        return result
    from_natural = QUANTITIES[proof.requirement.quantity].from_natural
    extremes = tuple(
        Extreme(side.upper, from_natural(side.witness), side.worst)
        if side.verdict is Verdict.REFUTED and side.witness is not None
        else extreme
        for extreme, side in zip(result.extremes, proof.sides, strict=True)
    )
    return assess_requirement(result.requirement, extremes, tolerance)
