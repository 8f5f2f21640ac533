"""Verification and certification:  spec and gains -> Verification and Certificate, whatever method found the gains."""

from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.certify import certify
from fopi_tune.proof.recheck import Recheck, recheck
from fopi_tune.proof.verification.results import Outcome, Place, RequirementResult, Stability, Verification
from fopi_tune.proof.verification.verify import reassess, verify

__all__ = [
    "Certificate",
    "Outcome",
    "Place",
    "Recheck",
    "RequirementResult",
    "Stability",
    "Verdict",
    "Verification",
    "certify",
    "reassess",
    "recheck",
    "verify",
]
