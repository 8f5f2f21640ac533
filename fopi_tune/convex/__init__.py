"""DesignSpec -> Candidate without Ipopt:  the convex-concave procedure for fixed alpha (CVXPY), and a search
over alpha."""

from fopi_tune.convex.search import convex_design

__all__ = ["convex_design"]
