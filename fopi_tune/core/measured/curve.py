"""A measured frequency response between its points:  ln|P| and the unwrapped phase, monotone cubics in ln omega.

With u = ln omega and the points (u_k, y_k), y is on each interval the cubic with the values y_k, y_k+1 and the slopes
d_k, d_k+1, where

    d_k = 0                                                     at an extreme of the points ,
    d_k = (w1 + w2)/(w1/s_k-1 + w2/s_k) ,
          w1 = 2 h_k + h_k-1 ,  w2 = h_k + 2 h_k-1              elsewhere,                                         (1)

h_k the distances of the points and s_k the slopes of the straight lines between them.  So the curve never leaves the
range of two neighbours: no peak is invented between points.  How wrong it may be is estimated by leaving points out:
the rule on every second point against the points in between, the largest difference over the band.

Source: F. N. Fritsch and J. Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM J.
Sci. Stat. Comput. 5 (1984).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError

#: points of a response
FEWEST_POINTS = 5
#: of the lowest frequencies that show the exponent of omega there: ln of their span, and at least so many points
_LOW_SPAN, _LOW_POINTS = 0.5, 3
#: how far the lowest frequencies may be from c s^n: exponent, and phase in rad
_LOW_SLOPE, _LOW_PHASE = 0.4, math.radians(50.0)
#: more than a double integrator is no plant that is measured in open loop
_MOST_INTEGRATORS = 2
#: rad; a larger step of the phase between neighbours may as well be a step the other way round
AMBIGUOUS_STEP = math.radians(150.0)


@dataclass(frozen=True)
class InterpolationError:
    """The estimate of what the rule is wrong by between the points.

    Args:
        gain_db: the largest difference in gain, dB.
        phase_deg: the largest difference in phase, deg.
        gain_rad_s, phase_rad_s: where.
    """

    gain_db: float
    phase_deg: float
    gain_rad_s: float
    phase_rad_s: float


@dataclass(frozen=True)
class LowEnd:
    """What the lowest frequencies look like:  c s^exponent.

    Args:
        exponent: of omega, 0 or minus the number of integrators.
        is_negative: whether c < 0.
    """

    exponent: int
    is_negative: bool


@dataclass(frozen=True, eq=False)
class Curve:
    """One response.

    Args:
        omega_rad_s: rad/s, increasing, greater than 0, shape (n,) with n >= 5.
        log_gain: ln|P|, shape (n,).
        phase_rad: arg P, shape (n,); whole turns do not matter.
        dead_time_s: further dead time, not in the points.

    Raises:
        DomainError: too few points, not increasing, or not finite.
    """

    omega_rad_s: Array
    log_gain: Array
    phase_rad: Array
    dead_time_s: float = 0.0

    def __post_init__(self) -> None:
        omega, gain, phase = (np.array(part, dtype=float) for part in (self.omega_rad_s, self.log_gain, self.phase_rad))
        if not omega.ndim == gain.ndim == phase.ndim == 1 or not len(omega) == len(gain) == len(phase):
            raise DomainError("frequencies, gains and phases must be one-dimensional and of one length")
        if len(omega) < FEWEST_POINTS:
            raise DomainError(f"has {counted(len(omega), 'point')}; a response needs at least {FEWEST_POINTS}")
        if not all(np.isfinite(part).all() for part in (omega, gain, phase)):
            raise DomainError("has a value that is not finite")
        if omega[0] <= 0.0 or (np.diff(omega) <= 0.0).any():
            raise DomainError("its frequencies must be greater than 0 and increase")
        if not math.isfinite(self.dead_time_s) or self.dead_time_s < 0.0:
            raise DomainError(f"dead_time_s = {self.dead_time_s!r} must be a finite number of at least 0")
        phase = np.unwrap(phase)
        low = _low_end(np.log(omega), gain, phase)
        if low is not None:
            # the branch that belongs to c s^n
            wanted = 0.5 * np.pi * low.exponent - np.pi * low.is_negative
            phase += 2.0 * np.pi * np.round((wanted - phase[0]) / (2.0 * np.pi))
        for name, part in (("omega_rad_s", omega), ("log_gain", gain), ("phase_rad", phase)):
            part.flags.writeable = False
            object.__setattr__(self, name, part)

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """The lowest and the highest frequency."""
        return float(self.omega_rad_s[0]), float(self.omega_rad_s[-1])

    @cached_property
    def u(self) -> Array:
        """ln omega of the points."""
        return np.log(self.omega_rad_s)

    @cached_property
    def low_end(self) -> LowEnd | None:
        """The asymptote that the lowest frequencies show; None where they show none."""
        return _low_end(self.u, self.log_gain, self.phase_rad)

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """(1) of ln|P| and of the phase, a unit of ln omega."""
        return monotone_slopes(self.u, self.log_gain), monotone_slopes(self.u, self.phase_rad)

    def log_at(self, u: Array) -> Complex:
        """ln P at u = ln omega inside of the band, unwrapped, shape of u; outside the nearest end's."""
        return self.log_and_slope_at(u)[0]

    def log_and_slope_at(self, u: Array) -> tuple[Complex, Complex]:
        """ln P, dead time included, and d ln P/du; shape of u."""
        inside = np.clip(u, self.u[0], self.u[-1])
        (gain, phase), (rise, turn) = hermite(self.u, *self._stacked, inside)
        lag = np.exp(inside) * self.dead_time_s
        return gain + 1j * (phase - lag), rise + 1j * (turn - lag)

    @cached_property
    def _stacked(self) -> tuple[Array, Array]:
        """ln|P| and the phase as one table, and their slopes; shape (2, n)."""
        return np.array([self.log_gain, self.phase_rad]), np.array(self.slopes)

    @property
    def interpolation_error(self) -> InterpolationError:
        """How far the points are from the rule on every second one; the larger one of both halves."""
        return self.interpolation_error_up_to(self.band_rad_s[1])

    def interpolation_error_up_to(self, last_rad_s: float) -> InterpolationError:
        """The same of the points up to a frequency, but at least of those next to the lowest."""
        omega, gain, phase = self._left_out
        count = max(int(np.searchsorted(omega, last_rad_s, side="right")), 2)
        at_gain, at_phase = int(gain[:count].argmax()), int(phase[:count].argmax())
        return InterpolationError(
            float(gain[at_gain]) * 20.0 / math.log(10.0), math.degrees(float(phase[at_phase])),
            float(omega[at_gain]), float(omega[at_phase]),
        )  # fmt: skip

    @cached_property
    def _left_out(self) -> tuple[Array, Array, Array]:
        """Frequencies that one of both halves leaves out, and how far that is off there, neper and rad."""
        places, gaps = [], []
        for first in (0, 1):
            kept, left = self.u[first::2], self.u[1 - first :: 2]
            out = (left > kept[0]) & (left < kept[-1])
            places.append(left[out])
            each = [
                hermite(kept, y[first::2], monotone_slopes(kept, y[first::2]), left[out])[0] - y[1 - first :: 2][out]
                for y in (self.log_gain, self.phase_rad)
            ]
            gaps.append(np.abs(each))
        u, (gain, phase) = np.concatenate(places), np.concatenate(gaps, axis=1)
        order = np.argsort(u)
        return np.exp(u[order]), gain[order], phase[order]

    @cached_property
    def ambiguous_steps(self) -> tuple[tuple[float, float], ...]:
        """Neighbours between which the phase turns so far that it may turn the other way round, rad/s."""
        rows = np.flatnonzero(np.abs(np.diff(self.phase_rad)) > AMBIGUOUS_STEP)
        return tuple((float(self.omega_rad_s[k]), float(self.omega_rad_s[k + 1])) for k in rows)


def monotone_slopes(u: Array, y: Array) -> Array:
    """(1) at points, shape (n,), n >= 2; at the ends a one-sided rule of three points that keeps the shape."""
    h, s = np.diff(u), np.diff(y) / np.diff(u)
    if len(u) == 2:
        return np.array([s[0], s[0]])
    w1, w2 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inner = np.where(s[1:] * s[:-1] > 0.0, (w1 + w2) / (w1 / s[:-1] + w2 / s[1:]), 0.0)
    return np.concatenate([[_end_slope(h[0], h[1], s[0], s[1])], inner, [_end_slope(h[-1], h[-2], s[-1], s[-2])]])


def _end_slope(h0: float, h1: float, s0: float, s1: float) -> float:
    slope = ((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1)
    if slope * s0 <= 0.0:
        return 0.0
    return 3.0 * s0 if s0 * s1 < 0.0 and abs(slope) > 3.0 * abs(s0) else slope


def hermite(u: Array, y: Array, slopes: Array, at: Array) -> tuple[Array, Array]:
    """Value and slope of the cubics with these values and slopes at points u, at places inside.

    Args:
        u: points, shape (n,).
        y: values, shape (..., n), and their `slopes`.
        at: places, shape (k,).

    Returns:
        Shapes (..., k).
    """
    k = np.clip(np.searchsorted(u, at, side="right") - 1, 0, len(u) - 2)
    h = u[k + 1] - u[k]
    t = (at - u[k]) / h
    first, a, b = y[..., k], slopes[..., k] * h, slopes[..., k + 1] * h
    rise = y[..., k + 1] - first
    # y_k + a t + (3 rise - 2 a - b) t^2 + (a + b - 2 rise) t^3
    second, third = 3.0 * rise - 2.0 * a - b, a + b - 2.0 * rise
    return first + t * (a + t * (second + t * third)), (a + t * (2.0 * second + 3.0 * t * third)) / h


def _low_end(u: Array, gain: Array, phase: Array) -> LowEnd | None:
    count = max(_LOW_POINTS, int(np.searchsorted(u, u[0] + _LOW_SPAN)))
    near = u[:count] - u[:count].mean()
    slope = float(near @ gain[:count] / (near @ near))
    exponent = round(slope)
    if abs(slope - exponent) > _LOW_SLOPE or not -_MOST_INTEGRATORS <= exponent <= 0:
        return None
    angle = float(np.median(phase[:count])) - 0.5 * math.pi * exponent
    for is_negative in (False, True):
        off = math.remainder(angle + math.pi * is_negative, 2.0 * math.pi)
        if abs(off) <= _LOW_PHASE:
            return LowEnd(exponent, is_negative)
    return None
