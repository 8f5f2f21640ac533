"""Global optimality:  a proved bound of the objective over all gains, or a proof that a spec is infeasible.

`certify_optimum` searches by branch and bound; `recheck_optimum` tests its document without searching.
"""

from fopi_tune.optimum.certify import certify_optimum
from fopi_tune.optimum.documents import to_dict, to_document
from fopi_tune.optimum.recheck import OptimumRecheck, recheck_optimum
from fopi_tune.optimum.results import Optimum, OptimumProof, OptimumStatus

__all__ = [
    "Optimum",
    "OptimumProof",
    "OptimumRecheck",
    "OptimumStatus",
    "certify_optimum",
    "recheck_optimum",
    "to_dict",
    "to_document",
]
