"""What a requirement costs:  its multiplier checked by solving again, and the objective against its limit.

The stages are `price.py` and `sweep.py`, which load the solver; what they hand on is here, and loads none.
"""

from fopi_tune.prices.limit import Knob, knob_of, knobs_of
from fopi_tune.prices.result import End, PointStatus, Tradeoff, TradeoffPoint

__all__ = ["End", "Knob", "PointStatus", "Tradeoff", "TradeoffPoint", "knob_of", "knobs_of"]
