"""DesignSpec -> Candidate without Ipopt:  for fixed alpha by convex-concave steps (CVXPY), over alpha by a search."""

from fopi_tune.convex.search import convex_design

__all__ = ["convex_design"]
