"""A recording in scaled units:  time over its length, output over its range, input over its range."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.identification.models import Signals
from fopi_tune.identification.recording import Recording

#: samples of a running median; it takes out spikes of at most two of them
_MEDIAN_OF = 5
#: changes of the input below this share of its range are noise of a measured one, where messages speak of a step
INPUT_NOISE = 0.02
#: more outputs are thinned out
_MOST_OUTPUTS = 20_000
#: fewest outputs after the first step of the input
_MIN_AFTER = 6


@dataclass(frozen=True, eq=False)
class Scaled:
    """A recording in scaled units.

    Args:
        signals: the outputs that are used, and the changes of the input.
        rows: shape (n,), the outputs' rows in the recording.
        smoothed: shape (n,), the outputs' running median, which spikes do not reach; scaled.
        length_s: s, from the first line to the last.
        height: range of the smoothed output, in its unit.
        level: the output that is 0, in its unit.
        input_height: range of the input, in its unit.
        first_change: time of the first step of the input, scaled.
        gap: time between the lines around a change of the input, scaled: the mean, weighted by the squared changes.
    """

    signals: Signals
    rows: NDArray[np.int64]
    smoothed: Array
    length_s: float
    height: float
    level: float
    input_height: float
    first_change: float
    gap: float

    @property
    def n(self) -> int:
        """How many outputs are used."""
        return len(self.rows)

    def keep(self, kept: NDArray[np.bool_]) -> Scaled:
        """The same with some of the outputs, a mark for each, shape (n,)."""
        signals = dataclasses.replace(self.signals, time=self.signals.time[kept], output=self.signals.output[kept])
        return dataclasses.replace(self, signals=signals, rows=self.rows[kept], smoothed=self.smoothed[kept])


def scaled(recording: Recording) -> Scaled:
    """A recording in scaled units.

    Raises:
        DomainError: the input or the output does not move, or too little of the output comes after the input moves.
    """
    from scipy.ndimage import median_filter

    time, moved = recording.time_s - recording.time_s[0], recording.input
    length_s, input_height = float(time[-1]), float(np.ptp(moved))
    if input_height == 0.0:
        raise DomainError(
            f"column 'input': there is no step, it is {moved[0]:g} on every line; record from before the step on"
        )
    rows = np.flatnonzero(recording.used)
    # every so many-th output tells as much as can be told; the input is kept whole
    rows = rows[:: 1 + (len(rows) - 1) // _MOST_OUTPUTS]
    output = recording.output[rows]
    smoothed = median_filter(output, _MEDIAN_OF, mode="nearest")
    height = float(np.ptp(smoothed)) or float(np.ptp(output))
    if height == 0.0:
        raise DomainError(
            f"column 'output' does not move, it is {output[0]:g} on every line; record a larger step, or "
            "until the output follows"
        )
    steps = np.diff(moved)
    changed = np.flatnonzero(steps) + 1
    first = int(np.flatnonzero(np.abs(moved - moved[0]) > INPUT_NOISE * input_height)[0])
    after = int(np.count_nonzero(rows >= first))
    if after < _MIN_AFTER:
        raise DomainError(
            f"has {counted(after, 'sample')} from the step on; record at least {_MIN_AFTER}, and until the output "
            "settles"
        )
    gaps, weights = np.diff(time)[changed - 1], (steps[changed - 1] / input_height) ** 2
    level = float(smoothed[0])
    signals = Signals(
        time[rows] / length_s,
        (output - level) / height,
        time[changed] / length_s,
        steps[changed - 1] / input_height,
        float(np.diff(time).min()) / length_s,
    )
    return Scaled(
        signals,
        rows,
        (smoothed - level) / height,
        length_s,
        height,
        level,
        input_height,
        float(time[first]) / length_s,
        float(gaps @ weights / weights.sum()) / length_s,
    )
