"""The loop with the limits of its control in a certificate:  whether it is shown to be stable with them, and its check.

The requirements are about the loop within its limits.  Where the spec states `output_limits`, the loop on samples is
also shown to settle with them and with its anti-windup, from every state, by the circle criterion of
`switched.saturated_loop`.  This was not asked for, and the criterion is sufficient only: what is not shown changes no
verdict, and its reason is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from fopi_tune.core.controller import FoPi, derivative_of
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.coefficients import MeasuredDerivative
from fopi_tune.digital.implementation import runtime_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.strict_json import JsonObject, read_most_change
from fopi_tune.spec.model import DesignSpec

if TYPE_CHECKING:
    from fopi_tune.proof.switched.model import SwitchedLoop
    from fopi_tune.proof.switched.saturated_loop import SaturatedLoopProof


@dataclass(frozen=True)
class LimitedLoop:
    """A loop with the limits of its control, and that it settles with them.

    Args:
        loop: plants and controller with its limits.
        sample_time_s: Ts.
        proof: that it decays from every state; None where that is not shown.
    """

    loop: SwitchedLoop
    sample_time_s: float
    proof: SaturatedLoopProof | None

    @property
    def reason(self) -> str:
        """Why there is no proof; empty with one."""
        if self.proof is not None:
            return ""
        from fopi_tune.proof.switched.model import plant_obstacle

        return plant_obstacle(self.loop) or "the circle criterion, which is sufficient only, was not shown to hold"

    @property
    def half_life_s(self) -> float | None:
        """The time in which the state's norm at least halves, s; None without a proof."""
        if self.proof is None:
            return None
        return -math.log(2.0) / math.log(self.proof.decay) * self.sample_time_s

    @property
    def statement(self) -> str:
        """What is shown, in a sentence."""
        if self.loop.controller.limits_rate:
            return f"stable with its output rate limit: not available: {self.reason}"
        low, high = self.loop.controller.limits
        if self.proof is None or self.half_life_s is None:
            return f"stable with its limits, {low:g} to {high:g}: not available: {self.reason}"
        return (
            f"stable with its limits, {low:g} to {high:g}: proved, for every plant, from every state, and on every "
            f"setpoint that a control between them holds; the state's norm shrinks by the factor "
            f"{self.proof.told_decay} or more per sample, by half in {self.half_life_s:.3g} s"
        )

    def to_dict(self) -> dict[str, Any]:
        """The entry of a result's JSON."""
        return {
            "verdict": "not_available" if self.proof is None else "proved",
            "output_limits": list(self.loop.controller.limits),
            **_change_entry(self.loop),
            "statement": self.statement,
            "reason": self.reason,
            "decay_per_sample": None if self.proof is None else self.proof.decay,
            "half_life_s": self.half_life_s,
        }


def prove_with_limits(spec: DesignSpec, implementation: Implementation | None) -> LimitedLoop | None:
    """Show that a spec's loop on samples settles with its limits; None where there are no limits, or no samples.

    With a limit of the output's rate nothing is shown, and the result says so.

    Args:
        spec: with its family and limits of the control.
        implementation: the digital controller; None in continuous time.
    """
    if implementation is None or spec.digital is None:
        return None
    # a setpoint's weight moves where the loop rests, not how it comes there: deviations obey the same equations
    unweighted = replace(spec, controller=replace(spec.controller, setpoint_weight=1.0))
    controller = runtime_of(implementation.sections.without_weight, unweighted)
    if spec.digital.output_limits is None and not controller.limits_rate:
        return None
    from fopi_tune.proof.switched.model import SwitchedLoop, plant_obstacle
    from fopi_tune.proof.switched.saturated_loop import prove_saturated_loop

    loop = SwitchedLoop(spec.name, controller, spec.plant, implementation.delay_samples)
    proof = None if plant_obstacle(loop) else prove_saturated_loop(loop, implementation.sample_time_s)
    return LimitedLoop(loop, implementation.sample_time_s, proof)


def limits_entry(limited: LimitedLoop) -> dict[str, Any]:
    """The entry of a certificate's JSON."""
    from fopi_tune.proof.switched.saturated_loop import decay_entry

    return {
        "output_limits": list(limited.loop.controller.limits),
        **_change_entry(limited.loop),
        "decays": None if limited.proof is None else decay_entry(limited.proof),
        "statement": limited.statement,
    }


def read_limits(
    entry: JsonObject, name: str, family: PlantFamily, implementation: Implementation | None, gains: FoPi
) -> LimitedLoop:  # fmt: skip
    """Read it; types and ranges alone are checked.

    Args:
        entry: of the certificate.
        name: of its spec.
        family: its plants.
        implementation: its digital controller.
        gains: which tell whether that has a derivative, or a measurement filter.

    Raises:
        CertificateError: an entry is missing or has the wrong type, or there is no digital controller.
    """
    from fopi_tune.proof.switched.model import SwitchedLoop
    from fopi_tune.proof.switched.saturated_loop import read_decay

    limits, change = entry.numbers("output_limits"), read_most_change(entry)
    if implementation is None or len(limits) != 2:
        raise CertificateError(f"{entry.place}: there are no two output_limits of a digital controller")
    try:
        used = gains.measurement_filter
        controller = Runtime.of(
            implementation.sections, Precision.FLOAT64, (limits[0], limits[1]), measurement_filter=used
        )
        if derivative_of(gains).kd != 0.0:
            # of which the sum of the sections does not tell
            controller = replace(controller, derivative=MeasuredDerivative())
        loop = SwitchedLoop(name, replace(controller, most_change=change), family, implementation.delay_samples)
    except DomainError as error:
        raise CertificateError(f"{entry.place}: {error}") from None
    proof = None if entry.get("decays") is None else read_decay(entry.child("decays"))
    return LimitedLoop(loop, implementation.sample_time_s, proof)


def limits_problems(limited: LimitedLoop | None) -> list[str]:
    """What does not hold of the entry."""
    if limited is None or limited.proof is None:
        return []
    from fopi_tune.proof.switched.model import plant_obstacle
    from fopi_tune.proof.switched.saturated_loop import verify_saturated_loop

    obstacle = plant_obstacle(limited.loop)
    if obstacle or not verify_saturated_loop(limited.loop, limited.sample_time_s, limited.proof):
        return ["with_limits: the loop is not shown to settle with its limits"]
    return []


def limits_mismatches(limited: LimitedLoop | None, spec: DesignSpec) -> list[str]:
    """Differences from the spec's limits; a certificate may say nothing of them."""
    if limited is None:
        return []
    digital, stated = spec.digital, limited.loop.controller
    if limited.proof is not None and spec.controller.has_derivative:
        return ["with_limits: nothing is shown for structure: pid"]
    if limited.proof is not None and spec.controller.measurement_filter is not None:
        return ["with_limits: nothing is shown with a measurement_filter"]
    if digital is not None and (digital.output_limits is not None or digital.output_rate_per_s is not None):
        # its filter is compared elsewhere
        sections = Sections(digital.sample_time_s, stated.direct, stated.poles, stated.residues)
        limits, rate = digital.output_limits, digital.output_rate_per_s
        asked = Runtime.of(sections, Precision.FLOAT64, limits, rate)
        if (asked.limits, asked.most_change) == (stated.limits, stated.most_change):
            return []
    return ["with_limits: the limits are not those of the spec"]


def _change_entry(loop: SwitchedLoop) -> dict[str, float]:
    """The most that the output changes from sample to sample; no entry where that is not limited."""
    return {"most_change": loop.controller.most_change} if loop.controller.limits_rate else {}
