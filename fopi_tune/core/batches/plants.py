"""Batches of continuous plants:  polynomials in s, rows independent of each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows
from fopi_tune.core.plant import Plant, PlantFamily
from fopi_tune.core.roots import leading_coefficients, polynomial_at, polynomial_roots

#: relative; a root this close to the imaginary axis is treated as one just inside the left half-plane
AXIS_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Plants:
    """m plants with polynomials of equal length.

    Args:
        numerator: shape (m, a), descending powers of s.
        denominator: shape (m, b).
        dead_time_s: shape (m,).
    """

    numerator: Array
    denominator: Array
    dead_time_s: Array

    @classmethod
    def of(cls, plant: Plant) -> Plants:
        """One plant as a batch of one row."""
        return plant.batch(cls)

    @classmethod
    def members(cls, family: PlantFamily, points: Array) -> Plants:
        """The members of a family at these points of its box, shape (m, p)."""
        return family.batch(points, cls)

    def take(self, rows: Rows) -> Plants:
        """Select rows, with repetition."""
        return Plants(self.numerator[rows], self.denominator[rows], self.dead_time_s[rows])

    def __len__(self) -> int:
        return len(self.dead_time_s)

    @cached_property
    def zeros(self) -> Complex:
        """Roots of the numerators, shape (m, a - 1)."""
        return polynomial_roots(self.numerator)

    @cached_property
    def poles(self) -> Complex:
        """Roots of the denominators, shape (m, b - 1)."""
        return polynomial_roots(self.denominator)

    @cached_property
    def unstable_poles(self) -> NDArray[np.int_]:
        """Number of poles in the open right half-plane, shape (m,)."""
        return (np.isfinite(self.poles) & (nudged(self.poles).real > 0)).sum(axis=1)

    @property
    def axis_poles(self) -> Complex:
        """The poles on the imaginary axis, shape (m, b - 1); inf in place of the others."""
        on_axis = np.isfinite(self.poles) & (np.abs(self.poles.real) <= AXIS_TOLERANCE * np.abs(self.poles.imag))
        return np.where(on_axis, self.poles, np.inf)

    @property
    def corner_roots(self) -> Complex:
        """Where ln|P| bends, by absolute values, with the damping of resonances: all zeros and poles, but for 0."""
        roots = np.concatenate([self.zeros.ravel(), self.poles.ravel()])
        return roots[np.isfinite(roots) & (roots != 0.0)]

    @property
    def pole_sizes_rad_s(self) -> Array:
        """|p| over all poles, inf in place of those that leading zero coefficients remove."""
        return np.abs(self.poles).ravel()

    @property
    def slowest_s(self) -> float:
        """The slowest time constant of any plant, 1/|p| over its poles other than 0, else its zeros; 0 without, s."""
        corners = [np.abs(roots[np.isfinite(roots) & (roots != 0)]) for roots in (self.poles, self.zeros)]
        return next((1.0 / float(found.min()) for found in corners if len(found)), 0.0)

    def at_real(self, s: float) -> tuple[Array, Array]:
        """N and D at a real s > 0, shape (m,) each."""
        powers = [s ** np.arange(side.shape[1] - 1, -1, -1.0) for side in (self.numerator, self.denominator)]
        return self.numerator @ powers[0], self.denominator @ powers[1]

    @property
    def ends_at_zero(self) -> tuple[Array, Array]:
        """N(0) and D(0), shape (m,) each."""
        return self.numerator[:, -1], self.denominator[:, -1]

    @property
    def has_falling_phase(self) -> bool:
        """Whether the phase is known to fall or rise all the way: all plants are of first order, without a zero."""
        return self.denominator.shape[1] <= 2 and self.numerator.shape[1] <= 1

    @property
    def has_falling_gain(self) -> bool:
        """Whether |P| is known to fall all the way: no plant has a zero or a resonance."""
        poles = self.poles
        return not np.isfinite(self.zeros).any() and bool(np.all(np.abs(poles.real) >= np.abs(poles.imag)))

    @property
    def vanishes_at_zero(self) -> NDArray[np.bool_]:
        """Whether N(0) = 0, shape (m,)."""
        return np.asarray(self.ends_at_zero[0] == 0.0)

    @property
    def polynomials(self) -> tuple[Array, Array]:
        """N and D for compiled functions, which compute L from them where that is finite."""
        return self.numerator, self.denominator

    @cached_property
    def hidden_on_axis(self) -> NDArray[np.bool_]:
        """Whether N and D share a root on the imaginary axis, shape (m,): a hidden mode that no controller moves."""
        return share_a_root_on_the_axis(self.zeros, self.poles)

    def response(self, rows: Rows, omega: Array) -> Complex:
        """P(j omega) without its dead time; rows and omega of shape (n,)."""
        s = np.asarray(1j * omega, dtype=complex)
        # Grids contain the frequencies of undamped poles on purpose: P is infinite there.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return polynomial_at(self.numerator[rows], s) / polynomial_at(self.denominator[rows], s)

    @cached_property
    def log(self) -> BodeForm:
        """ln P.  A pole in the right half-plane contributes -180 deg at omega -> 0, as Nyquist's criterion needs."""
        zeros, poles = nudged(self.zeros), nudged(self.poles)
        roots = np.concatenate([zeros, poles], axis=1)
        sign = np.concatenate([np.ones_like(zeros, dtype=float), -np.ones_like(poles, dtype=float)], axis=1)
        origin = roots == 0.0
        inner = np.isfinite(roots) & ~origin
        safe = np.where(inner, roots, 1.0)
        leading = leading_coefficients(self.numerator) / leading_coefficients(self.denominator)
        # k prod (s - z)/prod (s - p) = k prod(-z)/prod(-p) s^n prod(1 - s/z)/prod(1 - s/p); -r is positive for r < 0.
        constant = np.log(np.abs(leading)) + (sign * np.where(inner, np.log(np.abs(safe)), 0.0)).sum(axis=1)
        slope0 = (sign * origin).sum(axis=1)
        right_zeros = (inner & (sign > 0) & (roots.real > 0)).sum(axis=1)
        negative = (leading < 0) ^ (right_zeros % 2 == 1)
        phase0 = np.asarray(-np.pi * negative - np.pi * self.unstable_poles + 0.5 * np.pi * slope0, dtype=float)
        return BodeForm(
            constant,
            slope0,
            phase0,
            sign,
            np.ones_like(sign),
            np.where(inner, np.log(np.abs(safe)), np.inf),
            np.where(inner, np.angle(-1j / safe), 0.0),
            self.dead_time_s,
        )


def share_a_root_on_the_axis(zeros: Complex, poles: Complex, tolerance: float = AXIS_TOLERANCE) -> NDArray[np.bool_]:
    """Whether a zero is a pole on the imaginary axis, shape (m,).

    Args:
        zeros, poles: shapes (m, a) and (m, b); inf where there is none.
        tolerance: relative, of both being the same.
    """
    pole, zero = poles[:, :, None], zeros[:, None, :]
    on_axis = np.isfinite(pole) & (np.abs(pole.real) <= AXIS_TOLERANCE * np.abs(pole.imag))
    both = on_axis & np.isfinite(zero)
    pole, zero = np.where(both, pole, 0.0), np.where(both, zero, 0.0)
    common = both & (np.abs(zero - pole) <= tolerance * np.abs(pole))
    return np.asarray(common.any(axis=(1, 2)))


def nudged(roots: Complex) -> Complex:
    """The roots, with those on the imaginary axis (except the origin) moved just inside the left half-plane."""
    on_axis = np.isfinite(roots) & (roots != 0.0) & (np.abs(roots.real) <= AXIS_TOLERANCE * np.abs(roots.imag))
    return np.where(on_axis, -AXIS_TOLERANCE * np.abs(roots.imag) + 1j * roots.imag, roots)
