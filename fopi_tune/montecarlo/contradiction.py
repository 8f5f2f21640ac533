"""Where sampling contradicts a proof:  Evidence, Certificate -> sentences; any of them is an error of this tool."""

from __future__ import annotations

import math
from collections.abc import Iterator

from fopi_tune.montecarlo.montecarlo import Evidence
from fopi_tune.montecarlo.outcomes import OutcomeStatistics
from fopi_tune.proof.certificate import Certificate, RequirementProof, Verdict
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Requirement

#: tolerance, relative or in natural units, by which a floating-point value may exceed a proved bound
_ROUNDING = 1e-8


def contradictions(evidence: Evidence, certificate: Certificate | None) -> tuple[str, ...]:
    """One sentence for every bound proved for the whole family that a drawn plant of the family violates.

    Drawn plants outside the family's box are covered by no proof and are ignored.
    """
    if certificate is None:
        return ()
    found = []
    stable = certificate.stability.verdict is Verdict.PROVED
    if stable and evidence.unstable_inside:
        found.append("a drawn plant's loop is unstable, though the stability of all of them is proved")
    by_requirement = {_key(proof.requirement): proof for proof in certificate.requirements}
    for outcome in evidence.requirements:
        assert outcome.requirement is not None
        proof, worst = by_requirement.get(_key(outcome.requirement)), outcome.worst_inside
        if proof is None or worst is None:
            continue
        bound, name = _bound(proof, outcome.upper), outcome.requirement.quantity
        if math.isinf(worst.value):
            # a margin that does not end, or none, where all plants are proved to have one within the limit
            if stable and proof.verdict is Verdict.PROVED and (worst.value > 0.0) == outcome.upper:
                found.append(f"plant {worst.index} has no {name} within the limit, though that is proved of all plants")
        elif bound is not None and _is_beyond(outcome, worst.value, bound):
            found.append(f"plant {worst.index} has {name} = {worst.value!r}, beyond the proved {bound!r}")
    return (*found, *_of_scenarios(evidence, certificate))


def _of_scenarios(evidence: Evidence, certificate: Certificate) -> Iterator[str]:
    """The same of measures of scenarios, which are proved without noise."""
    for each in certificate.scenarios:
        limit, bound = each.case.limit, each.proof.bound
        if each.proof.verdict is not Verdict.PROVED or bound is None:
            continue
        for outcome in evidence.limits:
            said, worst = outcome.limit, outcome.worst_inside
            same = said is not None and (said.measure, said.relation, said.limit) == (
                limit.measure, limit.relation, limit.limit,
            )  # fmt: skip
            noisy = outcome.scenario in evidence.noisy_scenarios
            if not same or noisy or worst is None or outcome.scenario != each.case.scenario.name:
                continue
            room = _ROUNDING * max(1.0, abs(bound))
            if worst.value > bound + room if outcome.upper else worst.value < bound - room:
                yield f"plant {worst.index} has {limit.measure} = {worst.value!r}, beyond the proved {bound!r}"


def _key(r: Requirement) -> tuple[object, ...]:
    """Equal for requirements that demand the same."""
    return r.quantity, r.relation, r.limits, r.scope, r.from_rad_s, r.to_rad_s, r.end_limit


def _bound(proof: RequirementProof, upper: bool) -> float | None:
    """The proved bound of the quantity over all plants, public unit."""
    return proof.bounds[1] if upper else proof.bounds[0]


def _is_beyond(outcome: OutcomeStatistics, value: float, bound: float) -> bool:
    assert outcome.requirement is not None
    quantity = QUANTITIES[outcome.requirement.quantity]
    found, proved = quantity.to_natural(value), quantity.to_natural(bound)
    tolerance = _ROUNDING * max(1.0, abs(proved))
    return found > proved + tolerance if outcome.upper else found < proved - tolerance
