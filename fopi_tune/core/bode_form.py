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
    def _is_large(self) -> NDArray[np.bool_]:
        return self.exponent > 0.0

    @cached_property
    def _along(self) -> Array:
        """Shape (n, K), m cos psi."""
        return self.small * self.cosine

    @cached_property
    def _across(self) -> Array:
        """Shape (n, K), m sin psi."""
        return self.small * self.sine

    @cached_property
    def squared_distance(self) -> Array:
        """Shape (n, K), d: as a sum of squares it is accurate near w = -1 too."""
        return (1.0 + self._along) ** 2 + self._across**2

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
        real = np.where(self._is_large, self.small + self.cosine, 1.0 + self._along)
        return np.arctan2(np.where(self._is_large, self.sine, self._across), real)

    def real_part(self) -> Array:
        """Shape (n, K), d Re w/(1 + w)."""
        return np.where(self._is_large, 1.0 + self._along, self.small * (self.small + self.cosine))


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
        if len(u) <= PORTION:
            return self._derivative_at_once(rows, u)
        return np.concatenate([self._derivative_at_once(rows[part], u[part]) for part in portions(len(u))])

    def value_and_derivative(self, rows: Rows, u: Array) -> tuple[Complex, Complex]:
        """ln f, unwrapped, and d ln f / du at u; rows and u of equal shape (n,)."""
        if len(u) <= PORTION:
            return self._at_once(rows, u)
        found = [self._at_once(rows[part], u[part]) for part in portions(len(u))]
        return np.concatenate([value for value, _ in found]), np.concatenate([slope for _, slope in found])

    def _derivative_at_once(self, rows: Rows, u: Array) -> Complex:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            (_, slope0, _, delay), (nu, corner, cosine, sine, _, weight) = self._selected(rows)
            rays = _rays(nu, corner, cosine, sine, u)
            return _derivative(slope0, weight, rays, delay * np.exp(u))

    def _at_once(self, rows: Rows, u: Array) -> tuple[Complex, Complex]:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            (scale, slope0, phase0, delay), (nu, corner, cosine, sine, sign, weight) = self._selected(rows)
            rays, turn = _rays(nu, corner, cosine, sine, u), delay * np.exp(u)
            value = np.empty(len(u), dtype=complex)
            value.real = scale + slope0 * u + np.add.reduce(sign * rays.log_gain(), axis=1)
            value.imag = phase0 - turn + np.add.reduce(sign * rays.phase(), axis=1)
            return value, _derivative(slope0, weight, rays, turn)

    def _selected(self, rows: Rows) -> tuple[Array, Array]:
        """Rows of the numbers of functions, shape (4, n), and of factors, shape (6, n, K): two selections, not ten."""
        terms, factors = self._tables
        return terms.take(rows, axis=1), factors.take(rows, axis=1)

    def curvature_bound(self, rows: Rows, low: Array, high: Array) -> Array:
        """An upper bound of |d2 ln f / du2| on [low, high], by (2)."""
        return self.gain_curvature_bound(rows, low, high) + np.abs(self.delay[rows]) * np.exp(high)

    def gain_curvature_bound(self, rows: Rows, low: Array, high: Array) -> Array:
        """An upper bound of |d2 ln|f| / du2| on [low, high]; a dead time changes only the phase."""
        if len(rows) <= PORTION:
            return self._gain_curvature_bound(rows, low, high)
        return np.concatenate(
            [self._gain_curvature_bound(rows[part], low[part], high[part]) for part in portions(len(rows))]
        )

    def _gain_curvature_bound(self, rows: Rows, low: Array, high: Array) -> Array:
        nu, corner, cosine, sine, sign, _ = self._selected(rows)[1]
        rho_low = np.exp(_clipped(nu * (low[:, None] - corner), _BOUND_EXPONENT_CAP))
        rho_high = np.exp(_clipped(nu * (high[:, None] - corner), _BOUND_EXPONENT_CAP))
        # The point of the ray's piece that lies closest to -1 has |w| = -cos psi, or is an end of the piece.
        closest = np.minimum(np.maximum(-cosine, rho_low), rho_high)
        squared_distance = (closest + cosine) ** 2 + sine**2
        return np.add.reduce(np.abs(sign) * nu**2 * rho_high / np.maximum(squared_distance, 1e-300), axis=1)

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
    def _tables(self) -> tuple[Array, Array]:
        """What `_selected` selects of: scale, slope0, phase0, delay; nu, corner, cos psi, sin psi, sign, sign nu."""
        direction: Complex = np.exp(1j * self.psi)
        factors = self.nu, self.corner, direction.real, direction.imag, self.sign, self.sign * self.nu
        return np.array([self.scale, self.slope0, self.phase0, self.delay]), np.array(factors)


def _clipped(exponent: Array, cap: float) -> Array:
    """As `np.clip`, which takes longer than what it is for where arrays are short."""
    return np.minimum(np.maximum(exponent, -cap), cap)


def _rays(nu: Array, corner: Array, cosine: Array, sine: Array, u: Array) -> _Rays:
    exponent = _clipped(nu * (u[:, None] - corner), _EXPONENT_CAP)
    return _Rays(exponent, np.exp(-np.abs(exponent)), cosine, sine)


def _derivative(slope0: Array, weight: Array, rays: _Rays, turn: Array) -> Complex:
    """Formula (2); the weight of a factor is its sign times its exponent."""
    weight = weight / rays.squared_distance
    slope = np.empty(len(turn), dtype=complex)
    slope.real = slope0 + np.add.reduce(weight * rays.real_part(), axis=1)
    slope.imag = np.add.reduce(weight * rays.small * rays.sine, axis=1) - turn
    return slope
