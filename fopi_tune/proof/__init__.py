"""The second opinion:  spec and gains -> Verification, never looking at how the gains were found."""

from fopi_tune.proof.results import Outcome, Place, RequirementResult, Stability, Verification
from fopi_tune.proof.verify import verify

__all__ = ["Outcome", "Place", "RequirementResult", "Stability", "Verification", "verify"]
