"""Inverse Laplace transforms on contours bent to the left, with an error estimate.

For F with F(conj s) = conj F(s), and a contour s(u), u in R, symmetric about the real axis, right of all singularities,

    f(t) = 1/(2 pi j) int e^{st} F(s) ds = h/pi Im sum_{k >= 0} e^{s_k t} F(s_k) s'(u_k),   u_k = (k + 1/2) h,       (1)

whose error falls exponentially with 1/h (Trefethen and Weideman, SIAM Review 56 (2014), section 15).  Two contours:

    hyperbola   s = (mu/t) (1 + sin(ju - phi))                    (Weideman and Trefethen, Math. Comp. 76 (2007))    (2)
    bent line   s = sigma + m/T - depth(omega) + j omega,   psi(v) = (1 + v^8)^(1/8) - 1,
                depth = w psi(omega/w)                          or, where e^{-Ls} forbids going further left,
                depth = a/L ln(1 + (L w/a) psi(omega/w)),  or even never further left than a/L,
                depth = w psi/(1 + (L w/a) psi)                                                                      (3)

The hyperbola needs F free of singularities except for given poles, whose terms r/(s - p) are subtracted and added again
as r e^{pt}; its cost does not depend on t.  The bent line passes to the right of all singularities below omega = w; its
cost grows with w t.  The error estimate is the difference between two settings of one contour.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.errors import DomainError

Transform = Callable[[Complex], Complex]

#: half-angle of the sector in which the hyperbola needs F analytic, rad; its inner strip ends at 3/4 pi
SECTOR_RAD = 0.76 * math.pi
#: mu, phi and h in (2), twice: strip of half-width 0.38 = 2 pi 0.38/0.07 = 34 nepers
_HYPERBOLAS = ((4.5, 0.40, 0.070), (5.3, 0.385, 0.064))
#: m, w's factor and h T in (3), twice: a pole m/(2T) to the left costs e^{-pi m/(h T)} = e^{-30}
_LINES = ((6.0, 1.0, 0.62), (7.3, 1.3, 0.73))
#: contours end where e^{st} has fallen to e^{-38}
_NEPERS = 38.0
#: poles with |p| t below it lie within the hyperbola, whatever their direction
_ENCLOSED = 0.5
#: w T in (3): the singularity of psi itself lies 0.38 w away
_CORNER = 20.0
_MOST_NODES = 1_000_000
_CHUNK = 2_000_000


@dataclass(frozen=True)
class InversionResult:
    """f at the requested times, and the difference between two contours.

    Args:
        value: shape (n,), f(t), in F's unit per second.
        error: shape (n,), absolute, same unit; inf where a contour would need too many nodes.
    """

    value: Array
    error: Array


@dataclass(frozen=True)
class LineBounds:
    """The region in which the bent line (3) has to stay.

    Args:
        sigma_rad_s: no singularity of F has a larger real part; 0 for a stable loop.
        omega_rad_s: F is analytic left of the axis above it, up to the curve (3).
        dead_time_s: L; 0 for the plain law, which ends at 45 deg.
        power: a; |e^{-Ls}| grows as omega^a on the curve, or up to e^a where it is bounded.
        bounded: the last law of (3), which keeps to the right of -a/L.
    """

    sigma_rad_s: float
    omega_rad_s: float
    dead_time_s: float = 0.0
    power: float = 1.0
    bounded: bool = False


def checked_times(times_s: object) -> Array:
    """Times as an array of shape (n,), in any order.

    Raises:
        DomainError: not one-dimensional, or a time that is negative or not finite.
    """
    times = np.asarray(times_s, dtype=float)
    if times.ndim != 1:
        raise DomainError(f"times_s has shape {times.shape}; give a list of times")
    if not np.all(np.isfinite(times) & (times >= 0.0)):
        raise DomainError("times_s holds a time that is negative or not finite; the loop is at rest before 0")
    return times


def invert_on_hyperbola(
    transform: Transform, times_s: object, poles_rad_s: Complex | None = None, residues: Complex | None = None,
    order: int = 0,
) -> InversionResult:  # fmt: skip
    """Invert F on the hyperbola (2).

    Args:
        transform: F, from complex s of any shape to F(s) of that shape; F(conj s) = conj F(s), F -> 0 as |s| -> inf,
            and analytic for |arg s| < SECTOR_RAD but for the poles named here.  No e^{-Ls}.
        times_s: shape (n,), s, > 0, any order.
        poles_rad_s: shape (m,), simple poles, conjugates included.
        residues: shape (m,), F's residues there.
        order: about the power with which F falls, if it is large; the contour is widened in proportion.

    Returns:
        f and its error estimate, which sees rounding and the contour, not a pole that was left out.

    Raises:
        DomainError: a time that is not finite or not positive.
    """
    times = checked_times(times_s)
    if np.any(times == 0.0):
        raise DomainError("times_s holds 0; a transform says nothing about t = 0 itself")
    poles = np.zeros(0, dtype=complex) if poles_rad_s is None else np.asarray(poles_rad_s, dtype=complex)
    parts = np.zeros(0, dtype=complex) if residues is None else np.asarray(residues, dtype=complex)
    with np.errstate(all="ignore"):
        first, second = (_on_hyperbola(transform, times, poles, parts, order, *setting) for setting in _HYPERBOLAS)
        return _compared(first, second)


def invert_on_bent_line(transform: Transform, times_s: object, bounds: LineBounds) -> InversionResult:
    """Invert F on the bent line (3), right of singularities that need not be known.

    Args:
        transform: F as in `invert_on_hyperbola`, but analytic as `bounds` says; e^{-Ls} may be in it.
        times_s: shape (n,), s, > 0, any order.
        bounds: the region in which the line has to stay.

    Returns:
        f and its error estimate; inf where more than a million nodes would be needed.

    Raises:
        DomainError: a time that is not finite or not positive.
    """
    times = checked_times(times_s)
    if np.any(times == 0.0):
        raise DomainError("times_s holds 0; a transform says nothing about t = 0 itself")
    value, error = np.zeros_like(times), np.full_like(times, np.inf)
    octave = np.floor(np.log2(times)) if len(times) else times
    for exponent in np.unique(octave):
        group = np.flatnonzero(octave == exponent)
        with np.errstate(all="ignore"):
            first, second = (_on_line(transform, times[group], bounds, *setting) for setting in _LINES)
            both = _compared(first, second)
        value[group], error[group] = both.value, both.error
    return InversionResult(value, error)


def bent_line(omega: Array, horizon_s: float, bounds: LineBounds, margin: float = 6.0) -> tuple[Complex, Complex]:
    """Points of (3) and ds/domega there.

    Args:
        omega: shape (n,), rad/s, > 0.
        horizon_s: T, the longest time it serves.
        bounds: as in `invert_on_bent_line`.
        margin: m.

    Returns:
        s and ds/domega, shape (n,) each.
    """
    w = corner_frequency(horizon_s, bounds)
    log_base = np.log1p((omega / w) ** 8)
    psi, slope = np.expm1(log_base / 8.0), np.exp(7.0 * np.log(omega / w) - 7.0 / 8.0 * log_base)
    stretch = bounds.dead_time_s * w / bounds.power
    falling = 1.0 / (1.0 + stretch * psi)
    if bounds.bounded:
        depth, slope = w * psi * falling, slope * falling**2
    else:
        depth = w * psi if stretch == 0.0 else w / stretch * np.log1p(stretch * psi)
        slope = slope * falling
    s = bounds.sigma_rad_s + margin / horizon_s - depth + 1j * omega
    return np.asarray(s, dtype=complex), np.asarray(1j - slope, dtype=complex)


def corner_frequency(horizon_s: float, bounds: LineBounds) -> float:
    """w of (3), rad/s: large enough that the line is still m/(2T) right of sigma at omega = bounds.omega_rad_s.

    From w psi(omega/w) <= omega^8/(8 w^7) <= m/(2T).
    """
    cycles = bounds.omega_rad_s * horizon_s
    return max(bounds.omega_rad_s * max(1.2, (cycles / 24.0) ** (1.0 / 7.0)), _CORNER / horizon_s)


def _compared(first: Array, second: Array) -> InversionResult:
    error = np.abs(first - second)
    return InversionResult(np.where(np.isfinite(second), second, 0.0), np.where(np.isfinite(error), error, np.inf))


def _on_hyperbola(
    transform: Transform, times: Array, poles: Complex, residues: Complex, order: int, mu: float, phi: float, h: float
) -> Array:
    mu, h = mu + 1.5 * order, h / (1.0 + order / 6.0)
    # Re(s t) = mu (1 - sin phi cosh u) reaches -38 below what it was at the vertex
    count = math.ceil(math.acosh((_NEPERS + mu) / (mu * math.sin(phi))) / h)
    u = (np.arange(count) + 0.5) * h
    z = mu * (1.0 + np.sin(1j * u - phi))
    weight = h / math.pi * np.exp(z) * (1j * mu * np.cos(1j * u - phi))
    value = np.zeros_like(times)
    for start in range(0, len(times), 1 + _CHUNK // count):
        part = slice(start, start + 1 + _CHUNK // count)
        t = times[part, None]
        s = np.asarray(z / t, dtype=complex)
        regular = transform(s)
        for pole, residue in zip(poles, residues, strict=True):
            regular = regular - np.where(np.abs(pole) * t > _ENCLOSED, residue, 0.0) / (s - pole)
        value[part] = (regular * weight).sum(axis=1).imag / t[:, 0]
        taken = np.where(np.abs(poles) * t > _ENCLOSED, residues * np.exp(poles * t), 0.0)
        value[part] += taken.sum(axis=1).real
    return value


def _on_line(transform: Transform, times: Array, bounds: LineBounds, margin: float, widen: float, step: float) -> Array:
    horizon = float(times.max())
    wide = replace(bounds, omega_rad_s=bounds.omega_rad_s * widen)
    h = step / horizon
    end = _end(transform, float(times.min()), horizon, wide, margin)
    if not end < _MOST_NODES * h:
        return np.full_like(times, np.nan)
    value = np.zeros_like(times)
    count = math.ceil(end / h)
    width = max(1, _CHUNK // len(times))
    for start in range(0, count, width):
        omega = (np.arange(start, min(start + width, count)) + 0.5) * h
        s, slope = bent_line(np.asarray(omega, dtype=float), horizon, wide, margin)
        value += (np.exp(times[:, None] * s) * (transform(s) * slope)).sum(axis=1).imag
    return value * h / math.pi


def _end(transform: Transform, shortest: float, horizon: float, bounds: LineBounds, margin: float) -> float:
    """omega from which the terms of (1) are below e^{-38} of the largest; inf if there is none within reach."""
    omega = np.asarray(corner_frequency(horizon, bounds) * np.geomspace(1e-3, 1e8, 400), dtype=float)
    s, slope = bent_line(omega, horizon, bounds, margin)
    log_size = np.log(np.abs(transform(s) * slope) * omega) + s.real * shortest
    loud = np.flatnonzero(~(log_size < np.nanmax(log_size) - _NEPERS + 6.0))
    return float(omega[loud[-1] + 1]) if len(loud) and loud[-1] + 1 < len(omega) else math.inf
