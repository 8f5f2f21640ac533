"""Recordings of a plant's input and output to its numbers:  the uncertain plant that a spec starts from."""

from fopi_tune.identification.columns import ReadOptions
from fopi_tune.identification.covariance import CONFIDENCE
from fopi_tune.identification.family import Identified, identify, identify_recordings
from fopi_tune.identification.fit import Fit, Interval, fit_plant
from fopi_tune.identification.models import FitModel
from fopi_tune.identification.recording import Recording, parse_recording, recording_from_arrays
from fopi_tune.identification.times import TimeUnit

__all__ = [
    "CONFIDENCE",
    "Fit",
    "FitModel",
    "Identified",
    "Interval",
    "ReadOptions",
    "Recording",
    "TimeUnit",
    "fit_plant",
    "identify",
    "identify_recordings",
    "parse_recording",
    "recording_from_arrays",
]
