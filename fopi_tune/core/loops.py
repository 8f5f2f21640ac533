"""Batches of continuous loops:  gains and plants -> L = C P, unity negative feedback.

Rows are independent: row i has its own gains and its own plant.  All values are exact up to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.batches.plants import AXIS_TOLERANCE, Plants, share_a_root_on_the_axis
from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows, contiguous_rows
from fopi_tune.core.controller import FoPi, derivative_of
from fopi_tune.core.roots import polynomial_roots, times
from fopi_tune.core.terms.derivatives import Derivatives
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.core.compiled.loops import Direct


@dataclass(frozen=True)
class Loops:
    """m loops L = C P; gains of shape (m,), plants of m rows.

    Args:
        kp, ki, alpha: shape (m,).
        plants: m plants.
        derivatives: beside the integral; None: C = kp + ki s^-alpha.
        measurement_filter: F, a factor of every C; None is 1.
    """

    kp: Array
    ki: Array
    alpha: Array
    plants: Plants
    derivatives: Derivatives | None = field(default=None, kw_only=True)
    measurement_filter: MeasurementFilter | None = field(default=None, kw_only=True)

    @classmethod
    def of(cls, controller: FoPi, plants: Plants) -> Loops:
        """One controller with every one of the plants."""
        ones = np.ones(len(plants))
        kd, mu, filter_s = derivative_of(controller)
        derivatives = Derivatives(kd * ones, mu * ones, filter_s * ones) if kd != 0.0 else None
        return cls(
            controller.kp * ones, controller.ki * ones, controller.alpha * ones, plants, derivatives=derivatives,
            measurement_filter=controller.measurement_filter,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.kp)

    def take(self, rows: Rows) -> Loops:
        """Select rows."""
        derivatives = None if self.derivatives is None else self.derivatives.take(rows)
        return Loops(
            self.kp[rows], self.ki[rows], self.alpha[rows], self.plants.take(rows), derivatives=derivatives,
            measurement_filter=self.measurement_filter,
        )  # fmt: skip

    @cached_property
    def computed(self) -> dict[str, Any]:
        """What is known of these loops, by its name: one who asks again gets the same object."""
        return {}

    @property
    def highest_rad_s(self) -> float:
        """The highest frequency: infinite in continuous time, Nyquist's on samples."""
        return np.inf

    def omega_of(self, u: Array) -> Array:
        """The frequency in rad/s at the coordinate u of the Bode form."""
        return np.exp(u)

    def u_of(self, omega_rad_s: Array) -> Array:
        """The inverse of `omega_of`."""
        return np.log(omega_rad_s)

    @property
    def log_unit(self) -> float:
        """On samples ln(2/Ts), with which ln omega = ln atan e^u + ln(2/Ts); nan where ln omega = u."""
        return np.nan

    def stretch(self, u: Array) -> Array:
        """d ln omega/du."""
        return np.ones_like(u)

    @cached_property
    def integral_is_cancelled(self) -> NDArray[np.bool_]:
        """Whether the controller's integral meets a zero of the plant at s = 0, shape (m,)."""
        return np.asarray((self.ki != 0.0) & self.plants.vanishes_at_zero)

    @cached_property
    def hidden_on_axis(self) -> NDArray[np.bool_]:
        """Whether a pole of the plant on the imaginary axis is a mode that the loop does not move, shape (m,).

        A zero of the plant hides it, or one of the controller: without kp and ki the derivative has one at s = 0.
        """
        hidden = self.plants.hidden_on_axis
        if self.derivatives is None:
            return hidden
        if not self._is_rational:
            return hidden | self._controller_vanishes_at_a_pole
        top, _ = self.derivatives.joined(self.kp, self.ki)
        # without ki the numerator and the denominator of C share the root 0
        reduced = np.column_stack([np.zeros(len(self)), top[:, :2]])
        zeros = polynomial_roots(np.where((self.ki == 0.0)[:, None], reduced, top))
        return hidden | share_a_root_on_the_axis(zeros, self.plants.axis_poles)

    @property
    def _is_rational(self) -> bool:
        """Whether all orders are 1."""
        return self.derivatives is not None and bool(np.all(self.derivatives.mu == 1.0) and np.all(self.alpha == 1.0))

    @property
    def _controller_vanishes_at_a_pole(self) -> NDArray[np.bool_]:
        """Whether C is 0, but for rounding, at a pole of the plant on the imaginary axis, shape (m,)."""
        assert self.derivatives is not None
        poles = self.plants.axis_poles
        on_axis = np.isfinite(poles)
        row, column = np.nonzero(on_axis & (poles.imag > 0.0))
        omega = poles.imag[row, column]
        parts = self.kp[row], self.ki[row] * omega ** -self.alpha[row], self.derivatives.response(row, omega)
        size = sum((np.abs(part) for part in parts), np.zeros(len(row)))
        found = np.any(on_axis & (poles == 0.0), axis=1) & (self.kp == 0.0) & (self.ki == 0.0)
        found[row[np.abs(self._terms_response(row, omega)) <= AXIS_TOLERANCE * size]] = True
        return found

    @cached_property
    def log_controller(self) -> BodeForm:
        """ln C with its measurement filter.

        Raises:
            DomainError: all gains are 0: there is no loop.
        """
        found = self._log_terms
        return found if self.filter_of_nu is None else found + self.filter_of_nu.log(len(self))

    @property
    def filter_of_nu(self) -> MeasurementFilter | None:
        """F as a function of j e^u."""
        return self.measurement_filter

    @cached_property
    def _log_terms(self) -> BodeForm:
        """ln(C/F); the phase tends to -90 deg alpha as omega -> 0, where the integral dominates.

        Raises:
            DomainError: all gains are 0: there is no loop.
        """
        if self.derivatives is not None:
            if self._is_rational:
                return Plants(*self.derivatives.joined(self.kp, self.ki), np.zeros(len(self))).log
            return self.derivatives.log_sums(self.kp, self.ki, self.alpha)
        if np.any((self.kp == 0.0) & (self.ki == 0.0)):
            raise DomainError("kp = ki = 0: there is no controller, so there is no loop; give one of them a value")
        integral = self.ki != 0.0
        both = integral & (self.kp != 0.0)
        log_ratio = np.log(np.abs(np.where(both, self.kp, 1.0))) - np.log(np.abs(np.where(both, self.ki, 1.0)))
        lead = np.where(integral, self.ki, self.kp)
        # kp + ki s^-alpha = ki s^-alpha (1 + (kp/ki) s^alpha), where s^alpha = omega^alpha e^{j alpha pi/2}
        psi = 0.5 * np.pi * self.alpha - np.pi * (np.sign(self.kp) != np.sign(self.ki))
        return BodeForm(
            np.log(np.abs(lead)),
            np.where(integral, -self.alpha, 0.0),
            np.where(lead < 0, -np.pi, 0.0) - np.where(integral, 0.5 * np.pi * self.alpha, 0.0),
            np.ones((len(self), 1)),
            self.alpha[:, None],
            np.where(both, -log_ratio / self.alpha, np.inf)[:, None],
            np.where(both, psi, 0.0)[:, None],
            np.zeros(len(self)),
        )

    @cached_property
    def log(self) -> BodeForm:
        """ln L.  Two minus signs (a negative gain on a negative plant) cancel instead of adding -360 deg."""
        plant, controller = self.plants.log, self.log_controller
        product = plant + controller
        lead = self._first_term
        own_sign = plant.phase0 - 0.5 * np.pi * plant.slope0 + np.pi * self.plants.unstable_poles
        negative_plant = own_sign < -0.5 * np.pi
        both = (lead < 0) & negative_plant
        return BodeForm(
            product.scale, product.slope0, product.phase0 + 2.0 * np.pi * both,
            product.sign, product.nu, product.corner, product.psi, product.delay, product.sums,
        )  # fmt: skip

    @property
    def _first_term(self) -> Array:
        """The gain of the term that dominates as omega -> 0, shape (m,)."""
        lead = np.where(self.ki != 0.0, self.ki, self.kp)
        return lead if self.derivatives is None else np.where(lead != 0.0, lead, self.derivatives.kd)

    def controller_response(self, rows: Rows, omega: Array) -> Complex:
        """C(j omega), filter included, on the principal branch; rows and omega of shape (n,)."""
        terms = self._terms_response(rows, omega)
        return terms if self.measurement_filter is None else terms * self.measurement_filter(1j * omega)

    def _terms_response(self, rows: Rows, omega: Array) -> Complex:
        """C/F at j omega."""
        angle = 0.5 * np.pi * self.alpha[rows]
        pi = self.kp[rows] + self.ki[rows] * omega ** -self.alpha[rows] * (np.cos(angle) - 1j * np.sin(angle))
        return pi if self.derivatives is None else pi + self.derivatives.response(rows, omega)

    def response(self, rows: Rows, omega: Array) -> Complex:
        """L(j omega), dead time included; rows and omega of shape (n,)."""
        delay = np.exp(-1j * omega * self.plants.dead_time_s[rows])
        return self.controller_response(rows, omega) * self.plants.response(rows, omega) * delay

    def log_response(self, rows: Rows, u: Array) -> Complex:
        """ln L at u = ln omega, unwrapped.

        The value comes from the polynomials, the branch of the logarithm from the Bode form.  So multiple roots, which
        a root finder resolves to a few digits only, do not spoil the value.
        """
        return self.log_response_and_slope(rows, u)[0]

    def log_response_and_slope(self, rows: Rows, u: Array) -> tuple[Complex, Complex]:
        """ln L as above, and d ln L / du."""
        from fopi_tune.core.compiled.loops import loop_values

        return loop_values(self.log.terms, self.direct, contiguous_rows(rows), np.ascontiguousarray(u, dtype=float))

    @cached_property
    def direct(self) -> Direct:
        """For compiled functions: what the loops are computed from directly."""
        from fopi_tune.core.compiled.loops import Direct

        none, known = np.zeros(len(self)), self.derivatives
        derivative = (none, none, none) if known is None else (known.kd, known.filter_s, known.mu)
        gains = np.array([self.kp, self.ki, self.alpha, *derivative], dtype=float)
        return Direct(gains, np.zeros((2, 0)), 0.0, *self._polynomials, self.plants.dead_time_s + 0.0, False)

    @property
    def _polynomials(self) -> tuple[Array, Array]:
        """Of P F, whose zeros and poles all are on the left or are the plant's."""
        top, bottom = self._filter_polynomials
        plant_top, plant_bottom = self.plants.polynomials
        sides = (plant_top, top), (plant_bottom, bottom)
        numerator, denominator = (np.ascontiguousarray(times(rows, factor), dtype=float) for rows, factor in sides)
        return numerator, denominator

    @property
    def _filter_polynomials(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Numerator and denominator of F in the plants' variable, descending powers."""
        return (1.0,), (1.0,) if self.measurement_filter is None else self.measurement_filter.coefficients
