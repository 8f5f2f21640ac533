"""Evidence as JSON."""

from __future__ import annotations

import math
from typing import Any

from fopi_tune.core.distributions import Uniform
from fopi_tune.montecarlo.montecarlo import Evidence
from fopi_tune.montecarlo.outcomes import OutcomeStatistics, WorstPlant
from fopi_tune.montecarlo.statistics import Fraction, Histogram
from fopi_tune.montecarlo.systems import SystemEvidence
from fopi_tune.spec.model import ValidationSpec


def to_document(evidence: Evidence) -> dict[str, Any]:
    """What the JSON of `fopi validate` says of the plants that were drawn; infinite numbers are null."""
    return {
        "drawn": _drawn(evidence),
        "stable": {**_fraction(evidence.stable), "missed_in_the_family": evidence.unstable_inside},
        "requirements": [_judged(judged) for judged in evidence.requirements],
        "limits": [_judged(judged) for judged in evidence.limits],
    }


def system_document(evidence: SystemEvidence) -> dict[str, Any]:
    """What the JSON of `fopi validate` says of a system."""
    return {
        "drawn": _drawn(evidence),
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


def _drawn(evidence: Evidence | SystemEvidence) -> dict[str, Any]:
    """How plants were drawn, and how many of them no proof speaks of."""
    drawn = evidence.validation
    return {
        "samples": drawn.samples,
        "seed": drawn.seed,
        "design": drawn.design if drawn.samples_file is None else None,
        "confidence": drawn.confidence,
        "intervals_are_exact": drawn.design == "random",
        "distributions": _distributions(drawn, evidence.numbers),
        "samples_file": _file(drawn),
        "outside_the_family": evidence.outside,
        "no_plants": evidence.no_plants,
    }


def _judged(judged: OutcomeStatistics) -> dict[str, Any]:
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
        "histogram": _histogram(judged.histogram),
        "worst": [_worst(worst) for worst in judged.worst],
        "missed_in_the_family": judged.missed_inside,
        "worst_in_the_family": None if judged.worst_inside is None else _worst(judged.worst_inside),
    }


def _histogram(histogram: Histogram | None) -> dict[str, Any] | None:
    return None if histogram is None else {"edges": list(histogram.edges), "counts": list(histogram.counts)}


def _worst(worst: WorstPlant) -> dict[str, Any]:
    return {
        "index": worst.index,
        "value": _finite(worst.value),
        "plant": dict(worst.plant),
        "in_the_family": worst.inside,
    }


def _distributions(drawn: ValidationSpec, numbers: tuple[str, ...]) -> dict[str, Any] | None:
    """Of every uncertain number as a spec writes it; null where the plants come from a file."""
    if drawn.samples_file is not None:
        return None
    return {name: drawn.distributions.get(name, Uniform()).words() for name in numbers}


def _file(drawn: ValidationSpec) -> dict[str, Any] | None:
    listed = drawn.samples_file
    if listed is None:
        return None
    return {"name": listed.name, "sha256": listed.sha256, "rows": len(listed.table.rows)}


def _fraction(fraction: Fraction) -> dict[str, Any]:
    return {"met": fraction.met, "total": fraction.total, "low": fraction.low, "high": fraction.high}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
