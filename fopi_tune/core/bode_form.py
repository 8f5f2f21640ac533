"""Transfer functions in Bode form, as logarithms:  gain, slope, factors 1 + (s/corner)^nu and dead time.

With u = ln omega, the logarithm of every response f in this package is, exactly,

    ln f = scale + slope0 u + j phase0 + sum_k sign_k ln(1 + e^{nu_k (u - u_k)} e^{j psi_k}) - j delay e^u .      (1)

Each factor k has a sign (+1 in the numerator, -1 in the denominator), an exponent nu_k, a corner u_k and an angle
psi_k. A root r of a polynomial has nu = 1, u_k = ln|r| and psi = arg(-j/r); kp + ki s^-alpha has nu = alpha, u_k =
ln|ki/kp|/alpha and psi = alpha pi/2.  As omega grows, w = e^{nu (u - u_k)} e^{j psi} runs along a ray from 0, so the
principal value of ln(1 + w) is continuous: the imaginary part of (1) is the unwrapped phase from omega -> 0, in closed
form.  With

    d/du ln(1 + w) = nu w/(1 + w),        d2/du2 ln(1 + w) = nu^2 w/(1 + w)^2,                                     (2)

the second derivative is bounded on an interval of u by the ray's smallest distance from -1.  `fopi_tune.core.roots` and
`fopi_tune.core.peaks` use that bound: no root and no peak between two points is missed.

Source: derived; (1) is the sum of the logarithms of the factors of N, D and C.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Complex = NDArray[np.complex128]

#: exponents are clipped here so that a double, and in bounds its square, stays finite
_EXPONENT_CAP = 700.0
_BOUND_EXPONENT_CAP = 300.0
#: points evaluated together: an array of 30 factors of each point is 0.25 MB, which stays in the cache and is not given
#: back to the system after every operation
PORTION = 1_024


def portions(count: int) -> list[slice]:
    """Slices of at most `PORTION` points each that together are all of them; one when there are none."""
    return [slice(start, start + PORTION) for start in range(0, max(count, 1), PORTION)]


@dataclass(frozen=True)
class _Rays:
    """Factors 1 + w, w = e^x e^{j psi}, in real arithmetic, several times faster than with complex logarithms.

    With m = e^-|x| <= 1 and d = |1 + m e^{j psi}|^2 = 1 + m (m + 2 cos psi), nothing overflows:

        ln|1 + w| = max(x, 0) + ln(d)/2 ,
        w/(1 + w) = {m (m + cos psi)  if x <= 0,  1 + m cos psi  if x > 0}/d + j m sin psi/d .                      (3)

    Source: derived; for x > 0 with 1/w, whose absolute value is m.

    Args:
        exponent: shape (n, K), x.
        small: shape (n, K), m.
        cosine, sine: shape (n, K), of psi.
    """

    exponent: Array
    small: Array
    cosine: Array
    sine: Array

    @cached_property
    def squared_distance(self) -> Array:
        """Shape (n, K), d: as a sum of squares it is accurate near w = -1 too."""
        return (1.0 + self.small * self.cosine) ** 2 + (self.small * self.sine) ** 2

    def log_gain(self) -> Array:
        """Shape (n, K), ln|1 + w|."""
        excess = self.small * (self.small + 2.0 * self.cosine)
        log = np.log1p(excess)
        close = excess < -0.5
        if close.any():
            log[close] = np.log(self.squared_distance[close])
        return np.maximum(self.exponent, 0.0) + 0.5 * log

    def phase(self) -> Array:
        """Shape (n, K), arg(1 + w) in rad."""
        large = self.exponent > 0.0
        real = np.where(large, self.small + self.cosine, 1.0 + self.small * self.cosine)
        return np.arctan2(np.where(large, self.sine, self.small * self.sine), real)

    def real_part(self) -> Array:
        """Shape (n, K), d Re w/(1 + w)."""
        small, cosine = self.small, self.cosine
        return np.where(self.exponent > 0.0, 1.0 + small * cosine, small * (small + cosine))


@dataclass(frozen=True)
class BodeForm:
    """m functions of u = ln omega in the form (1).

    Args:
        scale: shape (m,), ln of the absolute gain of the low-frequency asymptote at omega = 1 rad/s.
        slope0: shape (m,), exponent of that asymptote (-1 per integrator).
        phase0: shape (m,), rad, phase as omega -> 0.
        sign: shape (m, K), multiplicity of a factor; positive in the numerator, negative in the denominator.
        nu: shape (m, K), exponent of a factor's ray.
        corner: shape (m, K), u_k; inf for a factor that is absent.
        psi: shape (m, K), rad, angle of a factor's ray, in (-pi, pi).
        delay: shape (m,), s; negative in the inverse of a delayed function.
    """

    scale: Array
    slope0: Array
    phase0: Array
    sign: Array
    nu: Array
    corner: Array
    psi: Array
    delay: Array

    def __add__(self, other: BodeForm) -> BodeForm:
        """The product of the functions."""
        return BodeForm(
            self.scale + other.scale,
            self.slope0 + other.slope0,
            self.phase0 + other.phase0,
            np.concatenate([self.sign, other.sign], axis=1),
            np.concatenate([self.nu, other.nu], axis=1),
            np.concatenate([self.corner, other.corner], axis=1),
            np.concatenate([self.psi, other.psi], axis=1),
            self.delay + other.delay,
        )

    def __neg__(self) -> BodeForm:
        """One over the functions."""
        return BodeForm(
            -self.scale, -self.slope0, -self.phase0, -self.sign, self.nu, self.corner, self.psi, -self.delay
        )

    def take(self, rows: Rows) -> BodeForm:
        """Select rows."""
        return BodeForm(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def undelayed(self) -> BodeForm:
        """The functions without their dead times: same gain, and a curvature bound of the gain alone."""
        return replace(self, delay=np.zeros_like(self.delay))

    def value(self, rows: Rows, u: Array) -> Complex:
        """ln f at u, unwrapped; rows and u of equal shape (n,)."""
        return self.value_and_derivative(rows, u)[0]

    def derivative(self, rows: Rows, u: Array) -> Complex:
        """d ln f / du at u: the slope of ln|f| and, imaginary, that of the phase in rad."""
        found = [self._derivative_at_once(rows[part], u[part]) for part in portions(len(u))]
        return found[0] if len(found) == 1 else np.concatenate(found)

    def value_and_derivative(self, rows: Rows, u: Array) -> tuple[Complex, Complex]:
        """ln f, unwrapped, and d ln f / du at u; rows and u of equal shape (n,)."""
        found = [self._at_once(rows[part], u[part]) for part in portions(len(u))]
        if len(found) == 1:
            return found[0]
        return np.concatenate([value for value, _ in found]), np.concatenate([slope for _, slope in found])

    def _derivative_at_once(self, rows: Rows, u: Array) -> Complex:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return self._derivative(rows, self._rays(rows, u), self.delay[rows] * np.exp(u))

    def _at_once(self, rows: Rows, u: Array) -> tuple[Complex, Complex]:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            rays, turn = self._rays(rows, u), self.delay[rows] * np.exp(u)
            sign = self.sign[rows]
            value = np.empty(len(u), dtype=complex)
            value.real = self.scale[rows] + self.slope0[rows] * u + (sign * rays.log_gain()).sum(axis=1)
            value.imag = self.phase0[rows] - turn + (sign * rays.phase()).sum(axis=1)
            return value, self._derivative(rows, rays, turn)

    def _rays(self, rows: Rows, u: Array) -> _Rays:
        exponent = np.clip(self.nu[rows] * (u[:, None] - self.corner[rows]), -_EXPONENT_CAP, _EXPONENT_CAP)
        return _Rays(exponent, np.exp(-np.abs(exponent)), self._direction.real[rows], self._direction.imag[rows])

    def _derivative(self, rows: Rows, rays: _Rays, turn: Array) -> Complex:
        """Formula (2)."""
        weight = self.sign[rows] * self.nu[rows] / rays.squared_distance
        slope = np.empty(len(turn), dtype=complex)
        slope.real = self.slope0[rows] + (weight * rays.real_part()).sum(axis=1)
        slope.imag = (weight * rays.small * rays.sine).sum(axis=1) - turn
        return slope

    def curvature_bound(self, rows: Rows, low: Array, high: Array) -> Array:
        """An upper bound of |d2 ln f / du2| on [low, high], by (2)."""
        return self.gain_curvature_bound(rows, low, high) + np.abs(self.delay[rows]) * np.exp(high)

    def gain_curvature_bound(self, rows: Rows, low: Array, high: Array) -> Array:
        """An upper bound of |d2 ln|f| / du2| on [low, high]; a dead time changes only the phase."""
        found = [self._gain_curvature_bound(rows[part], low[part], high[part]) for part in portions(len(rows))]
        return found[0] if len(found) == 1 else np.concatenate(found)

    def _gain_curvature_bound(self, rows: Rows, low: Array, high: Array) -> Array:
        nu, corner, cosine = self.nu[rows], self.corner[rows], self._direction[rows].real
        rho_low = np.exp(np.clip(nu * (low[:, None] - corner), -_BOUND_EXPONENT_CAP, _BOUND_EXPONENT_CAP))
        rho_high = np.exp(np.clip(nu * (high[:, None] - corner), -_BOUND_EXPONENT_CAP, _BOUND_EXPONENT_CAP))
        # The point of the ray's piece that lies closest to -1 has |w| = -cos psi, or is an end of the piece.
        closest = np.clip(-cosine, rho_low, rho_high)
        squared_distance = (closest + cosine) ** 2 + self._direction[rows].imag ** 2
        return (np.abs(self.sign[rows]) * nu**2 * rho_high / np.maximum(squared_distance, 1e-300)).sum(axis=1)

    def slope_end(self) -> Array:
        """Shape (m,), d ln|f| / du as omega -> inf."""
        present = np.isfinite(self.corner)
        return self.slope0 + (self.sign * self.nu * present).sum(axis=1)

    def end(self) -> tuple[Array, Array]:
        """High-frequency asymptote c omega^slope_end: ln|c| and its phase (rad, delay left out), shape (m,) each."""
        present = np.isfinite(self.corner)
        log_gain = -(np.where(present, self.sign * self.nu * np.where(present, self.corner, 0.0), 0.0)).sum(axis=1)
        phase = np.where(present, self.sign * self.psi, 0.0).sum(axis=1)
        return self.scale + log_gain, self.phase0 + phase

    def corners(self) -> tuple[Array, Array]:
        """Smallest and largest u, outside which the function is its asymptotes to 1e-9, shape (m,) each."""
        present = np.isfinite(self.corner)
        reach = np.where(present, np.log(1e9) / np.maximum(self.nu, 1e-6), 0.0)
        low = np.where(present, self.corner - reach, np.inf).min(axis=1, initial=np.inf)
        high = np.where(present, self.corner + reach, -np.inf).max(axis=1, initial=-np.inf)
        none = ~present.any(axis=1)
        return np.where(none, -1.0, low), np.where(none, 1.0, high)

    @cached_property
    def _direction(self) -> Complex:
        return np.exp(1j * self.psi)
