"""Recordings of step responses to the numbers of a lag:  the uncertain plant that a spec starts from."""

from fopi_tune.identify.family import LagFamily, identify_lag
from fopi_tune.identify.fit import CONFIDENCE, Interval, LagFit, fit_lag
from fopi_tune.identify.recording import Recording, parse_recording

__all__ = [
    "CONFIDENCE",
    "Interval",
    "LagFamily",
    "LagFit",
    "Recording",
    "fit_lag",
    "identify_lag",
    "parse_recording",
]
