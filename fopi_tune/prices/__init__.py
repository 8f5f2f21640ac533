"""What a requirement costs:  its multiplier checked by solving again, and the objective against its limit.

The stages are `price.py` and `sweep.py`, which load the solver; what they hand on is here, and loads none.
"""

from fopi_tune.prices.limit import MovableLimit, movable_limit, movable_limits
from fopi_tune.prices.result import FeasibleEnd, PointStatus, Tradeoff, TradeoffPoint

__all__ = ["FeasibleEnd", "MovableLimit", "PointStatus", "Tradeoff", "TradeoffPoint", "movable_limit", "movable_limits"]
