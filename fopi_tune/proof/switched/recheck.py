"""Test a certificate of a system without searches:  SystemCertificate -> what is wrong with it, in seconds.

Only balls are used: no optimisation, no simulation, no eigenvalues in floating point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fopi_tune.core.controller import FoPi
from fopi_tune.proof.switched.bounded import verify_bounded
from fopi_tune.proof.switched.certificate import SystemCertificate
from fopi_tune.proof.switched.cycles import CycleProof, verify_cycle
from fopi_tune.proof.switched.entries import why_no_entries
from fopi_tune.proof.switched.model import SwitchedModel, loop_obstacle
from fopi_tune.proof.switched.saturated_loop import verify_saturated_loop
from fopi_tune.proof.switched.settling import SettlingProof, verify_settling
from fopi_tune.spec.model import SystemSpec

#: relative; numbers that are only stated may differ by this from those found again
_ROUNDING = 1e-9
_OTHER_TEXT = (
    "it was made of another text of this system (`system_sha256`); what it is about was compared with this text entry "
    "by entry"
)

#: the reason of certificates that were made before relative lines were modelled; nothing rests on it
ONCE_NOT_MODELLED = (
    "lines other than those of a hysteresis around the setpoint are not modelled in this proof; write hysteresis in "
    "their place"
)


@dataclass(frozen=True)
class SystemRecheck:
    """The result of a recheck.

    Args:
        problems: what does not hold, a sentence each; none for a certificate that is accepted.
        notes: what else there is to say.
    """

    problems: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether every statement holds."""
        return not self.problems


def recheck_system(
    certificate: SystemCertificate, system: SystemSpec | None = None, gains: Mapping[str, FoPi] | None = None
) -> SystemRecheck:
    """Test every statement of a certificate.

    Args:
        certificate: to test.
        system: it must be about this one; None leaves this open.
        gains: of both modes of `system`, by name.

    Raises:
        DomainError: `system` is given and no model can be made of it with `gains`.
    """
    model, problems = certificate.model, _reason_problems(certificate)
    if system is not None and SwitchedModel.of(system, gains or {}) != model:
        problems.append("the certificate is about other controllers, plants or switching than this system's")
    if system is not None and system.name != certificate.name:
        problems.append("the certificate is about a system of another name")
    for loop, proof in zip(model.loops, certificate.loops, strict=True):
        if proof is not None and (loop_obstacle(loop) or not verify_saturated_loop(loop, model.sample_time_s, proof)):
            problems.append(f"{loop.name}: the loop is not shown to decay with its limits")
    if certificate.bounded is not None and not verify_bounded(model, certificate.bounded):
        problems.append("output and memories are not shown to stay within what is stated")
    if certificate.settling is not None and not _settles(model, certificate.settling):
        problems.append("settling is not shown as stated")
    known = list[tuple[object, ...]]()
    for number, cycle in enumerate(certificate.cycles, 1):
        about = cycle.setpoint, cycle.plants
        if about in known:
            problems.append(f"orbit {number} is stated twice")
        elif not _cycles(model, cycle):
            problems.append(f"orbit {number} is not shown as stated")
        known.append(about)
    other_text = system is not None and certificate.system_sha256 != system.sha256
    return SystemRecheck(tuple(problems), (_OTHER_TEXT,) if other_text else ())


def _reason_problems(certificate: SystemCertificate) -> list[str]:
    """What is wrong with the reason of a model in which settling is not proved this way."""
    reason, model = certificate.reason, certificate.model
    if reason == ONCE_NOT_MODELLED and model.lines.half_width is None:
        return []
    known = "" if certificate.settles else model.obstacle or why_no_entries(model)
    return ["the reason stated is not the one that follows from the model"] if known and reason != known else []


def _settles(model: SwitchedModel, proof: SettlingProof) -> bool:
    if model.obstacle:
        return False
    found = verify_settling(model, proof)
    return found is not None and _same(
        (proof.undershoot, proof.overshoot), (found.undershoot, found.overshoot), below=True
    )


def _cycles(model: SwitchedModel, proof: CycleProof) -> bool:
    if model.obstacle:
        return False
    found = verify_cycle(model, proof)
    return found is not None and _same((proof.lowest, proof.highest), (found.lowest, found.highest), below=False)


def _same(stated: tuple[float, float], found: tuple[float, float], below: bool) -> bool:
    """Whether stated numbers are those found again; bounds must not be below them."""
    close = all(math.isclose(a, b, rel_tol=_ROUNDING, abs_tol=_ROUNDING) for a, b in zip(stated, found, strict=True))
    return close and (not below or all(a >= b for a, b in zip(stated, found, strict=True)))
