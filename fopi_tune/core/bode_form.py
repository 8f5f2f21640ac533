"""Transfer functions in Bode form, as logarithms:  gain, slope, factors 1 + (s/corner)^nu and dead time.

With u = ln omega, the logarithm of every response f in this package is, exactly,

    ln f = scale + slope0 u + j phase0 + sum_k sign_k ln(1 + e^{nu_k (u - u_k)} e^{j psi_k}) - j delay e^u .      (1)

Each factor k has a sign (+1 in the numerator, -1 in the denominator), an exponent nu_k, a corner u_k and an angle
psi_k. A root r of a polynomial has nu = 1, u_k = ln|r| and psi = arg(-j/r); kp + ki s^-alpha has nu = alpha, u_k =
ln|ki/kp|/alpha and psi = alpha pi/2.  As omega grows, w = e^{nu (u - u_k)} e^{j psi} runs along a ray from 0, so the
principal value of ln(1 + w) is continuous: the imaginary part of (1) is the unwrapped phase from omega -> 0, in closed
form.  A derivative of another order than 1 beside the integral and a fractional plant are no products of such factors:
sums of powers join them (`core/compiled/power_sums.py`), whose branches are known as well.  With

    d/du ln(1 + w) = nu w/(1 + w),        d2/du2 ln(1 + w) = nu^2 w/(1 + w)^2,                                     (2)

the second derivative is bounded on an interval of u by the ray's smallest distance from -1.  `fopi_tune.core.roots` and
`fopi_tune.core.peaks` use that bound: no root and no peak between two points is missed.

Source: derived; (1) is the sum of the logarithms of the factors of N, D and C.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fopi_tune.core.compiled.loops import Terms

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Complex = NDArray[np.complex128]

#: exponents are clipped here so that a double, and in bounds its square, stays finite
_BOUND_EXPONENT_CAP = 300.0
#: points evaluated together: an array of 30 factors of each point is 0.25 MB, which stays in the cache and is not given
#: back to the system after every operation
PORTION = 1_024
#: of functions without a sum of powers
NO_SUMS = np.zeros((0, 6, 5))


def portions(count: int) -> list[slice]:
    """Slices of at most `PORTION` points each that together are all of them; one when there are none."""
    return [slice(start, start + PORTION) for start in range(0, max(count, 1), PORTION)]


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
        sums: shape (F m, 6, n), F factors that are sums of powers, those of all rows in turn; shape (0, 6, 5) without.
    """

    scale: Array
    slope0: Array
    phase0: Array
    sign: Array
    nu: Array
    corner: Array
    psi: Array
    delay: Array
    sums: Array = field(default_factory=lambda: NO_SUMS)

    @classmethod
    def constant(cls, rows: int) -> BodeForm:
        """The function 1, `rows` times."""
        none, zeros = np.zeros((rows, 0)), np.zeros(rows)
        return cls(zeros, zeros, zeros, none, none, none, none, zeros)

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
            joined_sums(self.sums, other.sums),
        )

    def __neg__(self) -> BodeForm:
        """One over the functions."""
        sums = self.sums.copy()
        sums[:, 4, -1] *= -1.0
        return BodeForm(
            -self.scale, -self.slope0, -self.phase0, -self.sign, self.nu, self.corner, self.psi, -self.delay, sums
        )

    def take(self, rows: Rows) -> BodeForm:
        """Select rows."""
        every = {name: getattr(self, name) for name in self.__dataclass_fields__}
        none = np.zeros((0, *self.sums.shape[1:]))
        sums = np.concatenate([none, *(table[rows] for table in self._factors)])
        return BodeForm(**{name: sums if name == "sums" else part[rows] for name, part in every.items()})

    @property
    def _factors(self) -> list[Array]:
        """The tables of each factor that is a sum of powers, shape (m, 6, n)."""
        m = len(self.scale)
        return [self.sums[start : start + m] for start in range(0, len(self.sums), max(m, 1))]

    def undelayed(self) -> BodeForm:
        """The functions without their dead times: same gain, and a curvature bound of the gain alone."""
        return replace(self, delay=np.zeros_like(self.delay))

    def value(self, rows: Rows, u: Array) -> Complex:
        """ln f at u, unwrapped; rows and u of equal shape (n,)."""
        return self.value_and_derivative(rows, u)[0]

    def derivative(self, rows: Rows, u: Array) -> Complex:
        """d ln f / du at u: the slope of ln|f| and, imaginary, that of the phase in rad."""
        from fopi_tune.core.compiled.loops import slopes

        return slopes(self.terms, contiguous_rows(rows), np.ascontiguousarray(u, dtype=float))

    def value_and_derivative(self, rows: Rows, u: Array) -> tuple[Complex, Complex]:
        """ln f, unwrapped, and d ln f / du at u; rows and u of equal shape (n,)."""
        from fopi_tune.core.compiled.loops import values

        return values(self.terms, contiguous_rows(rows), np.ascontiguousarray(u, dtype=float))

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
        nu, corner, cosine, sine, sign = self.terms.factors[:5].take(rows, axis=1)
        rho_low = np.exp(_clipped(nu * (low[:, None] - corner), _BOUND_EXPONENT_CAP))
        rho_high = np.exp(_clipped(nu * (high[:, None] - corner), _BOUND_EXPONENT_CAP))
        # The point of the ray's piece that lies closest to -1 has |w| = -cos psi, or is an end of the piece.
        closest = np.minimum(np.maximum(-cosine, rho_low), rho_high)
        squared_distance = (closest + cosine) ** 2 + sine**2
        bound = np.add.reduce(np.abs(sign) * nu**2 * rho_high / np.maximum(squared_distance, 1e-300), axis=1)
        if not len(self.sums):
            return bound
        from fopi_tune.core.compiled.power_sums import curvature_bounds

        for table in self._factors:
            bound = bound + curvature_bounds(table, contiguous_rows(rows), 0.5 * (low + high), 0.5 * (high - low))
        return bound

    def slope_end(self) -> Array:
        """Shape (m,), d ln|f| / du as omega -> inf."""
        return self._slope_end

    @cached_property
    def _slope_end(self) -> Array:
        slope = self.slope0 + (self.sign * self.nu * self._present).sum(axis=1)
        return slope if self._end_of_sum is None else slope + self._end_of_sum[0]

    @cached_property
    def _present(self) -> NDArray[np.bool_]:
        """Which factors are there."""
        return np.isfinite(self.corner)

    @cached_property
    def _end_of_sum(self) -> tuple[Array, Array, Array] | None:
        """Of the sums of powers as omega -> inf: exponent, ln of the size, phase."""
        if not len(self.sums):
            return None
        from fopi_tune.core.compiled.power_sums import ends

        found = np.array([[table[:, 4, -1] * part for part in ends(table)] for table in self._factors])
        exponent, size, phase = np.sum(found, axis=0)
        return exponent, size, phase

    def end(self) -> tuple[Array, Array]:
        """High-frequency asymptote c omega^slope_end: ln|c| and its phase (rad, delay left out), shape (m,) each."""
        return self._end

    @cached_property
    def _end(self) -> tuple[Array, Array]:
        present = self._present
        log_gain = -(np.where(present, self.sign * self.nu * np.where(present, self.corner, 0.0), 0.0)).sum(axis=1)
        phase = np.where(present, self.sign * self.psi, 0.0).sum(axis=1)
        if self._end_of_sum is not None:
            log_gain, phase = log_gain + self._end_of_sum[1], phase + self._end_of_sum[2]
        return self.scale + log_gain, self.phase0 + phase

    def corners(self) -> tuple[Array, Array]:
        """Smallest and largest u, outside which the function is its asymptotes to 1e-9, shape (m,) each."""
        return self._corners

    @cached_property
    def _corners(self) -> tuple[Array, Array]:
        present = self._present
        reach = np.where(present, np.log(1e9) / np.maximum(self.nu, 1e-6), 0.0)
        low = np.where(present, self.corner - reach, np.inf).min(axis=1, initial=np.inf)
        high = np.where(present, self.corner + reach, -np.inf).max(axis=1, initial=-np.inf)
        none = ~present.any(axis=1)
        if len(self.sums):
            from fopi_tune.core.compiled.power_sums import corners

            for table in self._factors:
                first, last = corners(table, 1e-9)
                low, high = np.minimum(low, first), np.maximum(high, last)
            none = np.isinf(low)
        return np.where(none, -1.0, low), np.where(none, 1.0, high)

    @cached_property
    def terms(self) -> Terms:
        """For compiled functions: scale, slope0, phase0, delay; nu, corner, cos psi, sin psi, sign, sign nu, e^-corner.

        The last one is 0 where nu is not 1 or the corner lies so far away that products with it might overflow.
        """
        from fopi_tune.core.compiled.loops import NEAR_ONE, Terms

        direction: Complex = np.exp(1j * self.psi)
        plain = (self.nu == 1.0) & (np.abs(self.corner) < NEAR_ONE)
        inverse = np.where(plain, np.exp(-np.where(plain, self.corner, 0.0)), 0.0)
        factors = self.nu, self.corner, direction.real, direction.imag, self.sign, self.sign * self.nu, inverse
        whole = np.array([self.scale, self.slope0, self.phase0, self.delay], dtype=float)
        return Terms(whole, np.array(factors), self.sums)


def joined_sums(one: Array, other: Array) -> Array:
    """The sums of powers of two functions, of equal numbers of rows, as those of their product."""
    if not len(one) or not len(other):
        return one if len(one) else other
    width = max(one.shape[2], other.shape[2])
    return np.concatenate([_widened(one, width), _widened(other, width)])


def _widened(tables: Array, width: int) -> Array:
    """Tables of `power_sums.py` with room for more terms."""
    more = width - tables.shape[2]
    if not more:
        return tables
    found = np.concatenate([tables, np.zeros((len(tables), tables.shape[1], more))], axis=2)
    # a term that is not there, a zero that is not there, and the branch beyond the last one
    found[:, 1, -more:], found[:, 4, -more - 1 :], found[:, 5, -more:] = -np.inf, np.inf, tables[:, 5, -1:]
    found[:, 4, -1] = tables[:, 4, -1]
    return found


def contiguous_rows(rows: Rows) -> Rows:
    """As compiled functions take them."""
    return np.ascontiguousarray(rows, dtype=np.int64)


def _clipped(exponent: Array, cap: float) -> Array:
    """As `np.clip`, which takes longer than what it is for where arrays are short."""
    return np.minimum(np.maximum(exponent, -cap), cap)
