"""Time-domain requirements, proved for every plant of a family:  the sampled loop with its stored filter, in scenarios.

`case` says what is proved of what, `prove` searches, `recheck` tests a proof without a search, `documents` is its JSON.
Trajectories over a box of plants are Taylor models of second order (`loop`), with output limits and anti-windup
(`patterns`), of floating-point numbers whose rounding is enclosed (`bounded`); plants and centres are balls.
"""

from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.proof import TimeDomainProof
from fopi_tune.proof.time_domain.prove import prove_limit, why_no_method
from fopi_tune.proof.time_domain.recheck import recheck_limit

__all__ = ["TimeDomainCase", "TimeDomainProof", "prove_limit", "recheck_limit", "why_no_method"]
