"""Where sampling contradicts a proof:  Evidence and Certificate -> what is wrong with this tool."""

from __future__ import annotations

import math

from fopi_tune.montecarlo.montecarlo import Evidence
from fopi_tune.montecarlo.outcomes import OutcomeStatistics
from fopi_tune.proof.certificate import Certificate, RequirementProof, Verdict
from fopi_tune.quantities import QUANTITIES

#: by how much (relative or natural units) a float value may lie beyond a proved bound
_ROUNDING = 1e-8


def contradictions(evidence: Evidence, certificate: Certificate | None) -> tuple[str, ...]:
    """One sentence for everything proved of all plants of the family that one of those drawn lies beyond.

    Drawn plants outside the family's box are not spoken of by any proof and contradict none.
    """
    if certificate is None:
        return ()
    found = []
    if certificate.stability.verdict is Verdict.PROVED and evidence.unstable_inside:
        found.append("a drawn plant's loop is unstable, though the stability of all of them is proved")
    proofs = {id(proof.requirement): proof for proof in certificate.requirements}
    by_meaning = {_meaning(proof): proof for proof in proofs.values()}
    for judged in evidence.requirements:
        assert judged.requirement is not None
        proof = by_meaning.get(_key(judged))
        bound = None if proof is None else _bound(proof, judged.upper)
        if proof is None or bound is None:
            continue
        worst = judged.worst_inside
        if worst is not None and math.isfinite(worst.value) and _is_beyond(judged, worst.value, bound):
            name = judged.requirement.quantity
            found.append(f"plant {worst.index} has {name} = {worst.value!r}, beyond the proved {bound!r}")
    return tuple(found)


def _key(judged: OutcomeStatistics) -> tuple[object, ...]:
    r = judged.requirement
    assert r is not None
    return r.quantity, r.relation, r.limits, r.scope, r.from_rad_s, r.to_rad_s


def _meaning(proof: RequirementProof) -> tuple[object, ...]:
    r = proof.requirement
    return r.quantity, r.relation, r.limits, r.scope, r.from_rad_s, r.to_rad_s


def _bound(proof: RequirementProof, upper: bool) -> float | None:
    """What is proved of every plant, public unit."""
    return proof.bounds[1] if upper else proof.bounds[0]


def _is_beyond(judged: OutcomeStatistics, value: float, bound: float) -> bool:
    assert judged.requirement is not None
    quantity = QUANTITIES[judged.requirement.quantity]
    one, other = quantity.to_natural(value), quantity.to_natural(bound)
    room = _ROUNDING * max(1.0, abs(other))
    return one > other + room if judged.upper else one < other - room
