"""Requirements on measures of scenarios with what was achieved:  what a design, a check and their JSON say of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.proof.certificate import Certificate
from fopi_tune.proof.scenario_proofs import ScenarioProof, verdict_of
from fopi_tune.proof.verdict import Verdict
from fopi_tune.proof.verification.results import MeasureResult
from fopi_tune.results.documents import finite, price_dict
from fopi_tune.results.status import Price
from fopi_tune.spec.model import Limit, Relation


@dataclass(frozen=True)
class MeasureReport:
    """One requirement on a measure of scenarios.

    Args:
        requirement: what the spec says.
        result: what the verification found by simulation; None when there are no gains to verify.
        multiplier: by how much the objective would improve if the limit were relaxed by one unit; None where not known.
        drawn: how many plants that were drawn meet it, with the interval; None where none were drawn.
        price: the multiplier checked by solving again; None where that was not asked for, or the multiplier is zero.
        proofs: of the certificate, one for each scenario; none without a certificate.
    """

    requirement: Limit
    result: MeasureResult | None
    multiplier: float | None = None
    drawn: Fraction | None = None
    price: Price | None = None
    proofs: tuple[ScenarioProof, ...] = ()

    @property
    def verdict(self) -> str:
        """`proved`, `checked` (the plants that were simulated meet it), `violated`, or `open` without gains."""
        if self.result is None:
            return "open"
        proved = verdict_of(self.proofs, self.proofs[0].index) if self.proofs else None
        if not self.result.is_met or proved is Verdict.REFUTED:
            return "violated"
        return "proved" if proved is Verdict.PROVED else "checked"

    @property
    def bound(self) -> float | None:
        """What is proved of the measure over the family, in its unit; None where it is not proved."""
        if self.verdict != "proved":
            return None
        bounds = [each.proof.bound for each in self.proofs if each.proof.bound is not None]
        upper = self.requirement.relation is Relation.AT_MOST
        return (max if upper else min)(bounds, default=None)

    @property
    def why_checked(self) -> str:
        """Why it is checked only; empty where it is proved, or no proof was wanted."""
        reasons = [each.proof.message for each in self.proofs if each.proof.verdict is Verdict.UNDECIDED]
        return "; ".join(dict.fromkeys(reasons)) if self.verdict == "checked" else ""

    def to_dict(self) -> dict[str, Any]:
        """As in the result's JSON; infinite and missing numbers are null."""
        requirement, result, drawn = self.requirement, self.result, self.drawn
        return {
            "name": requirement.measure,
            "relation": requirement.relation.value,
            "limit": requirement.limit,
            "scenario": requirement.scenario,
            "verdict": self.verdict,
            "achieved": finite(result.achieved) if result else None,
            "met": result.is_met if result else False,
            "score": finite(result.score) if result else None,
            "worst": None
            if result is None
            else {"scenario": result.scenario, "time_s": result.time_s, "plant": dict(result.worst.plant)},
            "simulated_plants": result.plants if result else None,
            "drawn": None
            if drawn is None
            else {
                "met": drawn.met,
                "total": drawn.total,
                "low": drawn.low,
                "high": drawn.high,
                "confidence": drawn.confidence,
            },
            "multiplier": finite(self.multiplier),
            "multiplier_checked": price_dict(self.price),
            "proved_bound": finite(self.bound),
            "why_checked": self.why_checked or None,
        }


def measure_reports(
    requirements: Sequence[Limit], results: Sequence[MeasureResult], multipliers: Sequence[float | None] = (),
    drawn: Sequence[Fraction] = (), certificate: Certificate | None = None,
) -> tuple[MeasureReport, ...]:  # fmt: skip
    """The requirements of a spec, each with what is known of it.

    Args:
        requirements: those on measures of scenarios.
        results: of the verification, in the same order; none without gains.
        multipliers: of the design; none of given gains.
        drawn: plants that meet each; none where no plants were drawn.
        certificate: of the same gains; None where no proof was wanted.
    """
    proofs = certificate.scenarios if certificate is not None else ()
    return tuple(
        MeasureReport(
            each,
            results[i] if results else None,
            multipliers[i] if multipliers else None,
            drawn[i] if drawn else None,
            proofs=tuple(proof for proof in proofs if proof.index == i),
        )
        for i, each in enumerate(requirements)
    )


def measures_dict(reports: Sequence[MeasureReport]) -> dict[str, Any]:
    """The entry of a result's JSON; nothing where no requirement is on a scenario."""
    return {"scenario_requirements": [report.to_dict() for report in reports]} if reports else {}
