"""Stability of loops with a measured response, by Nyquist's criterion from the band alone:  count, or why not.

With the unstable poles N of the plant, which the user states, the unstable poles of the closed loop are

    Z = N - 2 (turns of 1 + L from s = +0 up the imaginary axis) ,                                                   (1)

`core/stability.py` with what is known: the turns come from the gain crossovers of the band.  What is not measured has
to be assumed:

    below the band      P(s) = c s^-n, as its lowest frequencies look, so that |L| stays on its side of 1 ;
    above the band      |L| stays below 1, as it is at the upper end .

Where the measurement does not show the first, or |L| is not below 1 at the upper end, nothing is decided.

Source: derived; the argument principle, as in `core/stability.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.measured.loops import MeasuredLoop

#: rad; a loop whose phase at |L| = 1 is this close to -180 deg passes through -1
_MARGINAL_RAD = 1e-9
#: poles; a count is whole, or half-way where the contour touches the axis
_HALF = 0.25


@dataclass(frozen=True)
class PoleCount:
    """What the band says of the closed loop.

    Args:
        unstable: poles in the right half-plane; inf on the axis; None where nothing is decided.
        reason: why nothing is; empty otherwise.
    """

    unstable: float | None
    reason: str = ""


def count_unstable_poles(loop: MeasuredLoop, unstable_poles: int | None) -> PoleCount:
    """(1), or why it cannot be said.

    Args:
        loop: of one member.
        unstable_poles: N; None where it is not known.
    """
    if unstable_poles is None:
        return PoleCount(
            None, "the number of the plant's unstable poles is not given; write unstable_poles: 0 for a stable plant"
        )
    reason = _what_the_ends_leave_open(loop)
    if reason:
        return PoleCount(None, reason)
    low = loop.curve.low_end
    assert low is not None
    points, crossovers = loop.on_grid, loop.gain_crossovers
    # the contour starts at s = +0, where L is real
    start = loop.start_phase_of_controller - math.pi * low.is_negative
    starts_large = bool(points.log_gain[0] > 0.0)
    total = -_turns(np.array([start]))[0] if starts_large else 0.0
    at = loop.at(crossovers)
    ends = np.concatenate([[loop.grid[0]], crossovers, [loop.grid[-1]]])
    large = (loop.at(0.5 * (ends[1:] + ends[:-1])).log_gain > 0.0).astype(float)
    total += float(np.sum((large[:-1] - large[1:]) * _turns(at.phase_rad)))
    if np.any(np.abs(np.remainder(at.phase_rad, 2.0 * np.pi) - np.pi) < _MARGINAL_RAD):
        return PoleCount(np.inf)
    count = unstable_poles - 2.0 * total
    if count < -_HALF:
        return PoleCount(
            None,
            f"unstable_poles: {unstable_poles} contradicts the measured phase, by which the plant has at least "
            f"{unstable_poles - round(count)}: correct the number, or the sign of the response",
        )
    return PoleCount(count)


def _what_the_ends_leave_open(loop: MeasuredLoop) -> str:
    low_rad_s, high_rad_s = loop.band_rad_s
    points, low = loop.on_grid, loop.curve.low_end
    if points.log_gain[-1] >= 0.0:
        return (
            f"|L| is {_db(points.log_gain[-1])} dB at {high_rad_s:.5g} rad/s, where the measurement ends, and not "
            "below 1: measure up to higher frequencies, or take smaller gains"
        )
    if low is None:
        return (
            f"the response at its lowest frequencies, from {loop.curve.band_rad_s[0]:.5g} rad/s, does not look like a "
            "constant, an integrator or a double one: measure from lower frequencies"
        )
    exponent = float(loop.log_controller.slope0[0]) + low.exponent
    if exponent < 0.0 and points.log_gain[0] <= 0.0:
        return (
            f"|L| is {_db(points.log_gain[0])} dB at {low_rad_s:.5g} rad/s, where the measurement begins: the gain "
            "crossover lies below; measure from lower frequencies, or take larger gains"
        )
    for first, second in loop.curve.ambiguous_steps:
        inside = (points.omega_rad_s >= first) & (points.omega_rad_s <= second)
        if np.any(points.log_gain[inside] > 0.0):
            return (
                f"the phase turns by more than 150 deg between {first:.5g} and {second:.5g} rad/s, where |L| exceeds "
                "1, and may do so either way: measure more frequencies there"
            )
    return ""


def _db(log_gain: float) -> str:
    return f"{20.0 * log_gain / math.log(10.0):.1f}"


def _turns(phase: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Turns of arg(1 + L) where |L| > 1; half-way on the negative real axis itself."""
    x = (phase + np.pi) / (2.0 * np.pi)
    nearest = np.round(x)
    x = np.where(np.abs(x - nearest) < _MARGINAL_RAD / (2.0 * np.pi), nearest, x)
    return 0.5 * (np.floor(x) + np.ceil(x) - 1.0)
