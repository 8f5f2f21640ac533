"""Evidence as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from fopi_tune.core.distributions.bounded import Uniform
from fopi_tune.montecarlo.joint import JointYield
from fopi_tune.montecarlo.montecarlo import Evidence
from fopi_tune.montecarlo.outcomes import OutcomeStatistics, WorstPlant
from fopi_tune.montecarlo.statistics import Fraction, Histogram
from fopi_tune.montecarlo.systems import SystemEvidence
from fopi_tune.spec.model import ValidationSpec


def to_document(evidence: Evidence) -> dict[str, Any]:
    """Evidence about a loop, as in the JSON of `fopi validate`; infinite numbers are null."""
    return {
        "drawn": _sampling(evidence),
        "joint_yield": _joint(evidence.joint, evidence.scenarios),
        "stable": {**_fraction(evidence.stable), "missed_in_the_family": evidence.unstable_inside},
        "requirements": [_outcome(outcome) for outcome in evidence.requirements],
        "limits": [_outcome(outcome) for outcome in evidence.limits],
    }


def system_document(evidence: SystemEvidence) -> dict[str, Any]:
    """Evidence about a system, as in the JSON of `fopi validate`."""
    return {
        "drawn": _sampling(evidence),
        "joint_yield": _joint(evidence.joint, [each.joint for each in evidence.scenarios]),
        "scenarios": [
            {
                "name": each.scenario,
                "finite": _fraction(each.finite),
                "without_chattering": _fraction(each.calm),
                "limits": [_outcome(outcome) for outcome in each.limits],
            }
            for each in evidence.scenarios
        ],
    }


def _sampling(evidence: Evidence | SystemEvidence) -> dict[str, Any]:
    """How plants were drawn, and how many of them lie outside the family, where no proof applies."""
    validation = evidence.validation
    members = evidence.members if isinstance(evidence, Evidence) else ()
    return {
        "samples": validation.samples,
        "seed": validation.seed,
        "design": validation.design if validation.samples_file is None else None,
        "confidence": validation.confidence,
        "intervals_are_exact": validation.design == "random",
        "distributions": _distributions(validation, evidence.numbers),
        **_correlations(validation),
        "samples_file": _file(validation),
        "outside_the_family": evidence.outside,
        "no_plants": evidence.no_plants,
        **({"plants": [{"name": name, "weight": weight} for name, weight in members]} if members else {}),
    }


def _joint(joint: JointYield, scenarios: Sequence[JointYield]) -> dict[str, Any]:
    """How many plants met everything at once, in all and in each scenario."""

    def said(each: JointYield) -> dict[str, Any]:
        counts = {**_fraction(each.fraction), "missed_in_the_family": each.missed_inside}
        return {**counts, "first_missed": list(each.first_missed)}

    return {**said(joint), "scenarios": [{"name": each.scenario, **said(each)} for each in scenarios]}


def _outcome(outcome: OutcomeStatistics) -> dict[str, Any]:
    said: dict[str, Any] = {}
    if outcome.requirement is not None:
        requirement = outcome.requirement
        said = {
            "name": requirement.quantity,
            "relation": requirement.relation.value,
            "limits": list(requirement.limits),
            **({} if requirement.end_limit is None else {"limit_at_to_rad_s": requirement.end_limit}),
            "side": "at_most" if outcome.upper else "at_least",
        }
    elif outcome.limit is not None:
        limit = outcome.limit
        said = {"name": limit.measure, "relation": limit.relation.value, "limits": [limit.limit]}
        said["scenario"] = outcome.scenario
    return {
        **said,
        "fraction": _fraction(outcome.fraction),
        "quantiles": [
            {"probability": q.probability, "value": _finite(q.value), "low": _finite(q.low), "high": _finite(q.high)}
            for q in outcome.quantiles
        ],
        "histogram": _histogram(outcome.histogram),
        "worst": [_worst(worst) for worst in outcome.worst],
        "missed_in_the_family": outcome.missed_inside,
        "worst_in_the_family": None if outcome.worst_inside is None else _worst(outcome.worst_inside),
    }


def _histogram(histogram: Histogram | None) -> dict[str, Any] | None:
    return None if histogram is None else {"edges": list(histogram.edges), "counts": list(histogram.counts)}


def _worst(worst: WorstPlant) -> dict[str, Any]:
    return {
        "index": worst.index,
        "value": _finite(worst.value),
        "plant": dict(worst.plant),
        "in_the_family": worst.inside,
        **({"member": worst.member} if worst.member else {}),
    }


def _distributions(validation: ValidationSpec, numbers: tuple[str, ...]) -> dict[str, Any] | None:
    """The distribution of every uncertain number, as a spec writes it; null where the plants come from a file."""
    if validation.samples_file is not None:
        return None
    return {name: validation.distributions.get(name, Uniform()).words() for name in numbers}


def _correlations(validation: ValidationSpec) -> dict[str, Any]:
    """The correlations as a spec writes them; nothing where there are none."""
    said = [{"numbers": list(each.numbers), "coefficient": each.coefficient} for each in validation.correlations]
    return {"correlations": said} if said else {}


def _file(validation: ValidationSpec) -> dict[str, Any] | None:
    listed = validation.samples_file
    if listed is None:
        return None
    return {"name": listed.name, "sha256": listed.sha256, "rows": len(listed.table.rows)}


def _fraction(fraction: Fraction) -> dict[str, Any]:
    return {"met": fraction.met, "total": fraction.total, "low": fraction.low, "high": fraction.high}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
