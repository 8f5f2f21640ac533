"""What a requirement costs:  its multiplier checked by solving again, and the objective against its limit."""

from fopi_tune.tradeoff.knob import Knob, knob_of, knobs_of
from fopi_tune.tradeoff.price import price_of
from fopi_tune.tradeoff.result import End, PointStatus, Tradeoff, TradeoffPoint
from fopi_tune.tradeoff.sweep import Range, sweep

__all__ = [
    "End",
    "Knob",
    "PointStatus",
    "Range",
    "Tradeoff",
    "TradeoffPoint",
    "knob_of",
    "knobs_of",
    "price_of",
    "sweep",
]
