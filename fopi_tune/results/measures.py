"""Requirements on measures of scenarios with what was achieved:  what a design, a check and their JSON say of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.proof.verification.results import MeasureResult
from fopi_tune.results.documents import finite, price_dict
from fopi_tune.results.status import Price
from fopi_tune.spec.model import Limit


@dataclass(frozen=True)
class MeasureReport:
    """One requirement on a measure of scenarios.

    Args:
        requirement: what the spec says.
        result: what the verification found by simulation; None when there are no gains to verify.
        multiplier: by how much the objective would improve if the limit were relaxed by one unit; None where not known.
        drawn: how many plants that were drawn meet it, with the interval; None where none were drawn.
        price: the multiplier checked by solving again; None where that was not asked for, or the multiplier is zero.
    """

    requirement: Limit
    result: MeasureResult | None
    multiplier: float | None = None
    drawn: Fraction | None = None
    price: Price | None = None

    @property
    def verdict(self) -> str:
        """`checked`: the plants that were simulated meet it; `violated`; `open` without gains."""
        if self.result is None:
            return "open"
        return "checked" if self.result.is_met else "violated"

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
        }


def measure_reports(
    requirements: Sequence[Limit], results: Sequence[MeasureResult], multipliers: Sequence[float | None] = (),
    drawn: Sequence[Fraction] = (),
) -> tuple[MeasureReport, ...]:  # fmt: skip
    """The requirements of a spec, each with what is known of it.

    Args:
        requirements: those on measures of scenarios.
        results: of the verification, in the same order; none without gains.
        multipliers: of the design; none of given gains.
        drawn: plants that meet each; none where no plants were drawn.
    """
    return tuple(
        MeasureReport(
            each,
            results[i] if results else None,
            multipliers[i] if multipliers else None,
            drawn[i] if drawn else None,
        )
        for i, each in enumerate(requirements)
    )


def measures_dict(reports: Sequence[MeasureReport]) -> dict[str, Any]:
    """The entry of a result's JSON; nothing where no requirement is on a scenario."""
    return {"scenario_requirements": [report.to_dict() for report in reports]} if reports else {}
