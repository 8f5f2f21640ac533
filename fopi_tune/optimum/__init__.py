"""The best gains there can be:  a bound that none can beat, or the proof that a spec has none.

One public entry, `certify_optimum`; `recheck_optimum` tests what it wrote without searching.
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
