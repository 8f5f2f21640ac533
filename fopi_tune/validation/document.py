"""Evidence as JSON."""

from __future__ import annotations

import math
from typing import Any

from fopi_tune.spec.model import ValidationSpec
from fopi_tune.validation.drawn import Judged
from fopi_tune.validation.joint import SystemEvidence
from fopi_tune.validation.montecarlo import Evidence
from fopi_tune.validation.statistics import Fraction


def to_document(evidence: Evidence) -> dict[str, Any]:
    """What the JSON of `fopi validate` says of the plants that were drawn; infinite numbers are null."""
    return {
        "drawn": _drawn(evidence.validation, evidence.outside),
        "stable": _fraction(evidence.stable),
        "requirements": [_judged(judged) for judged in evidence.requirements],
        "limits": [_judged(judged) for judged in evidence.limits],
    }


def system_document(evidence: SystemEvidence) -> dict[str, Any]:
    """What the JSON of `fopi validate` says of a system."""
    return {
        "drawn": _drawn(evidence.validation, evidence.outside),
        "scenarios": [
            {
                "name": each.scenario,
                "finite": _fraction(each.finite),
                "without_chattering": _fraction(each.calm),
                "limits": [_judged(judged) for judged in each.limits],
            }
            for each in evidence.scenarios
        ],
    }


def _drawn(drawn: ValidationSpec, outside: int) -> dict[str, Any]:
    return {
        "samples": drawn.samples,
        "seed": drawn.seed,
        "design": drawn.design,
        "confidence": drawn.confidence,
        "outside_the_family": outside,
    }


def _judged(judged: Judged) -> dict[str, Any]:
    said: dict[str, Any] = {}
    if judged.requirement is not None:
        requirement = judged.requirement
        said = {
            "name": requirement.quantity,
            "relation": requirement.relation.value,
            "limits": list(requirement.limits),
            "side": "at_most" if judged.upper else "at_least",
        }
    elif judged.limit is not None:
        limit = judged.limit
        said = {"name": limit.measure, "relation": limit.relation.value, "limits": [limit.limit]}
        said["scenario"] = judged.scenario
    return {
        **said,
        "fraction": _fraction(judged.fraction),
        "quantiles": [
            {"probability": q.probability, "value": _finite(q.value), "low": _finite(q.low), "high": _finite(q.high)}
            for q in judged.quantiles
        ],
        "worst": [
            {
                "index": worst.index,
                "value": _finite(worst.value),
                "plant": dict(worst.plant),
                "in_the_family": worst.inside,
            }
            for worst in judged.worst
        ],
    }


def _fraction(fraction: Fraction) -> dict[str, Any]:
    return {"met": fraction.met, "total": fraction.total, "low": fraction.low, "high": fraction.high}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
