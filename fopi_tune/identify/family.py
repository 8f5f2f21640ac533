"""Recordings to a family of lags for a spec:  the smallest box that contains the intervals of all fits."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.identify.fit import Interval, LagFit, fit_lag
from fopi_tune.identify.recording import Recording


@dataclass(frozen=True)
class LagFamily:
    """A family of lags identified from recordings, and the fits.

    Args:
        fits: one a recording, in their order.
        static_gain: output unit per input unit; its range does not hold 0.
        time_constant_s: s, > 0.
        dead_time_s: s, >= 0.
    """

    fits: tuple[LagFit, ...]
    static_gain: Uncertain
    time_constant_s: Uncertain
    dead_time_s: Uncertain


def identify_lag(recordings: Sequence[Recording]) -> LagFamily:
    """The smallest box of lags that contains the intervals of all recordings' fits.

    Each number's range is the hull of the fits' intervals, and its nominal value is the median of the fitted values.  A
    joint fit would assume one plant for all recordings.  The median is robust against a single outlier.

    Args:
        recordings: at least one, of one plant or of several that one controller shall serve.

    Raises:
        DomainError: no recording, one that cannot be fitted, or static gains of both signs.
    """
    if not recordings:
        raise DomainError("there is no recording to fit; give at least one")
    fits = tuple(fit_lag(recording) for recording in recordings)
    gains = [fit.static_gain.value for fit in fits]
    if min(gains) < 0 < max(gains):
        up, down = fits[gains.index(max(gains))], fits[gains.index(min(gains))]
        raise DomainError(
            f"the static gain is {max(gains):.3g} in {up.name} and {min(gains):.3g} in {down.name}: no controller "
            "serves both signs; check the columns, or make a spec of each"
        )
    return LagFamily(
        fits,
        _hull([fit.static_gain for fit in fits]),
        _hull([fit.time_constant_s for fit in fits]),
        _hull([fit.dead_time_s for fit in fits]),
    )


def _hull(intervals: list[Interval]) -> Uncertain:
    nominal = statistics.median(each.value for each in intervals)
    return Uncertain(nominal, min(each.low for each in intervals), max(each.high for each in intervals))
