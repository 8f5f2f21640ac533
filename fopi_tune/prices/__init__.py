"""The price of a requirement:  its multiplier checked by solving again, and the trade-off of objective against limit.

The stages `price.py` and `sweep.py` import the solver; their results, exported here, do not.
"""

from fopi_tune.prices.limit import MovableLimit, movable_limit, movable_limits
from fopi_tune.prices.result import FeasibleEnd, PointStatus, Tradeoff, TradeoffPoint

__all__ = ["FeasibleEnd", "MovableLimit", "PointStatus", "Tradeoff", "TradeoffPoint", "movable_limit", "movable_limits"]
