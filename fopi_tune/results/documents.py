"""Parts of results as JSON:  frozen data -> dictionaries, in which nothing is infinite."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from fopi_tune.core.margins import Margins
from fopi_tune.proof.certificate import Certificate, RequirementProof
from fopi_tune.proof.documents import to_document
from fopi_tune.proof.verification.results import Place, Stability
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.results.measured import checked_dict
from fopi_tune.results.status import Price, Relaxation
from fopi_tune.spec.model import DesignSpec, Limit
from fopi_tune.spec.scenarios import every_requirement


def finite(value: float | None) -> float | None:
    """The number, or None (null in JSON) where it is infinite or nan; negative zero becomes zero."""
    return value + 0.0 if value is not None and math.isfinite(value) else None


def place_dict(place: Place) -> dict[str, Any]:
    """A worst plant and frequency; the frequency is null where no single one decides, or in the limit 0 or infinity."""
    omega = place.omega_rad_s
    limit = {0.0: "omega -> 0", math.inf: "omega -> inf"}.get(omega) if omega is not None else None
    described: dict[str, Any] = {"omega_rad_s": finite(omega), "plant": dict(place.plant)}
    if place.member:
        described["member"] = place.member
    return described | ({"limit": limit} if limit else {})


def stability_dict(stability: Stability | None) -> dict[str, Any] | None:
    """Stability of the family."""
    if stability is None:
        return None
    return {
        "stable": stability.stable,
        "peak_sensitivity_db": finite(stability.peak_sensitivity_db),
        "worst": place_dict(stability.worst),
        "unstable_poles": stability.unstable_poles,
        "reason": stability.reason,
        **({"undecided": True} if stability.undecided else {}),
    }


def requirement_proof_dict(proof: RequirementProof | None) -> dict[str, Any] | None:
    """A requirement's verdict, and the proved lower and upper bound of its value, public unit."""
    if proof is None:
        return None
    low, high = proof.bounds
    return {
        "verdict": proof.verdict.value,
        "proved_from": finite(low),
        "proved_to": finite(high),
        "relative_gap": finite(proof.gap),
        "boxes": sum(side.boxes for side in proof.sides),
        "reason": proof.reason,
    }


def proof_dict(certificate: Certificate | None, wanted: bool, is_measured: bool = False) -> dict[str, Any]:
    """The certificate in short; of measured responses, that there is none."""
    if is_measured:
        return checked_dict()
    if certificate is None:
        reason = "there are no gains that pass the check" if wanted else "left out on demand: the gains are not proved"
        return {"verdict": "not_attempted", "reason": reason}
    stability = certificate.stability
    return {
        "verdict": certificate.verdict.value,
        "reason": certificate.verdict.advice,
        "tolerance": certificate.tolerance,
        "stability": {
            "verdict": stability.verdict.value,
            "reason": stability.reason,
            **({"member": stability.member} if stability.member else {}),
        },
        **({"with_limits": certificate.limited.to_dict()} if certificate.limited else {}),
        "boxes": certificate.boxes,
        "certificate_digest": to_document(certificate)["digest"],
    }


def margins_dict(nominal: Margins | None) -> dict[str, Any] | None:
    """Margins; null is an infinite one where the loop is stable, and none where it is not."""
    if nominal is None:
        return None
    return {
        key: list(value) if isinstance(value, tuple) else value if isinstance(value, bool) else finite(value)
        for key, value in asdict(nominal).items()
    }


def price_dict(price: Price | None) -> dict[str, Any] | None:
    """A multiplier checked by solving again; null where the limit cannot be moved that way."""
    if price is None:
        return None
    return {
        "limit": price.limit,
        "relaxed": finite(price.relaxed),
        "tightened": finite(price.tightened),
        "agrees": price.agrees,
        "kink": price.has_kink,
    }


def relaxation_dict(relaxation: Relaxation, spec: DesignSpec) -> dict[str, Any]:
    """A clashing requirement and the relaxation of its limit."""
    requirement = every_requirement(spec)[relaxation.requirement]
    return {
        "requirement": relaxation.requirement,
        "name": requirement.measure if isinstance(requirement, Limit) else requirement.quantity,
        "relation": requirement.relation.value,
        "give": finite(relaxation.amount),
        "new_limit": finite(relaxation.new_limit),
    }


def loop_name(spec: DesignSpec) -> str:
    """Which loop the requirements are about."""
    return "continuous" if spec.sampled_design is None else "sampled"


def objective_name(spec: DesignSpec) -> str:
    """The objective in words, unit included; a proxy says what it is."""
    if spec.objective is None:
        return "smallest slack (natural units)"
    name = f"{spec.objective.sense.value} {spec.objective.quantity}"
    if spec.objective.scenario is not None:
        return f"{name} in scenario {spec.objective.scenario}, the worst plant's"
    if spec.objective.quantity != ObjectiveKind.IAE_DISTURBANCE:
        return name
    horizon_s = spec.objective.horizon_s or default_horizon_s(spec.plant)
    return f"{name} (proxy: |integral of e exp(-t/T)| after a unit step at the plant's input, T = {horizon_s:.5g} s)"
