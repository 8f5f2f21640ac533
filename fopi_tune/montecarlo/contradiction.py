"""Where sampling contradicts a proof:  Evidence, Certificate -> sentences; any of them is an error of this tool."""

from __future__ import annotations

import math

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
    if certificate.stability.verdict is Verdict.PROVED and evidence.unstable_inside:
        found.append("a drawn plant's loop is unstable, though the stability of all of them is proved")
    proofs = {id(proof.requirement): proof for proof in certificate.requirements}
    by_requirement = {_key(proof.requirement): proof for proof in proofs.values()}
    for outcome in evidence.requirements:
        assert outcome.requirement is not None
        proof = by_requirement.get(_key(outcome.requirement))
        bound = None if proof is None else _bound(proof, outcome.upper)
        if proof is None or bound is None:
            continue
        worst = outcome.worst_inside
        if worst is not None and math.isfinite(worst.value) and _is_beyond(outcome, worst.value, bound):
            name = outcome.requirement.quantity
            found.append(f"plant {worst.index} has {name} = {worst.value!r}, beyond the proved {bound!r}")
    return tuple(found)


def _key(r: Requirement) -> tuple[object, ...]:
    """Equal for requirements that demand the same."""
    return r.quantity, r.relation, r.limits, r.scope, r.from_rad_s, r.to_rad_s


def _bound(proof: RequirementProof, upper: bool) -> float | None:
    """The proved bound of the quantity over all plants, public unit."""
    return proof.bounds[1] if upper else proof.bounds[0]


def _is_beyond(outcome: OutcomeStatistics, value: float, bound: float) -> bool:
    assert outcome.requirement is not None
    quantity = QUANTITIES[outcome.requirement.quantity]
    found, proved = quantity.to_natural(value), quantity.to_natural(bound)
    tolerance = _ROUNDING * max(1.0, abs(proved))
    return found > proved + tolerance if outcome.upper else found < proved - tolerance
