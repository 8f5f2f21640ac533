"""Batches of derivative terms beside kp + ki s^-alpha, and the controllers that they are part of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows


@dataclass(frozen=True)
class Derivatives:
    """m derivative terms kd s^mu/(Tf s + 1).

    Args:
        kd: shape (m,).
        mu: shape (m,).
        filter_s: shape (m,), Tf > 0.
    """

    kd: Array
    mu: Array
    filter_s: Array

    def take(self, rows: Rows) -> Derivatives:
        """Select rows."""
        return Derivatives(self.kd[rows], self.mu[rows], self.filter_s[rows])

    def response(self, rows: Rows, omega: Array) -> Complex:
        """kd s^mu/(Tf s + 1) at s = j omega; rows and omega of shape (n,)."""
        # |s| may be inf: divided by s, nothing is inf/inf
        with np.errstate(divide="ignore"):
            found = np.asarray(self.kd[rows] / (self.filter_s[rows] - 1j / omega), dtype=complex)
            rest = self.mu[rows] - 1.0
            if not rest.any():
                return found
            return np.asarray(found * (omega**rest * np.exp(0.5j * np.pi * rest)), dtype=complex)

    def joined(self, kp: Array, ki: Array) -> tuple[Array, Array]:
        """(kp Tf + kd) s^2 + (kp + ki Tf) s + ki and s (Tf s + 1), the whole controller with alpha = mu = 1."""
        top = np.column_stack([kp * self.filter_s + self.kd, kp + ki * self.filter_s, ki])
        return top, np.column_stack([self.filter_s, np.ones(len(kp)), np.zeros(len(kp))])

    def log_sums(self, kp: Array, ki: Array, alpha: Array) -> BodeForm:
        """ln of the whole controller with any orders, whose numerator is a sum of powers of s:

        (ki + kp s^alpha + ki Tf s + kp Tf s^(1 + alpha) + kd s^(alpha + mu)) / (s^alpha (Tf s + 1)) .
        """
        every = zip(*(part.tolist() for part in (kp, ki, alpha, self.kd, self.mu, self.filter_s)), strict=True)
        found = [_power_sum(*numbers) for numbers in every]
        lead, exponent = np.array([each[0] for each in found]), np.array([each[1] for each in found])
        corner, one = -np.log(self.filter_s)[:, None], np.ones((len(kp), 1))
        phase = np.where(lead < 0.0, -np.pi, 0.0) + 0.5 * np.pi * exponent
        return BodeForm(
            np.log(np.abs(lead)), exponent, phase, -one, one, corner, 0.5 * np.pi * one, np.zeros(len(kp)),
            np.array([each[2] for each in found]),
        )  # fmt: skip


@lru_cache
def _power_sum(kp: float, ki: float, alpha: float, kd: float, mu: float, filter_s: float) -> tuple[float, float, Array]:
    """Coefficient and exponent of the first term of a controller, and its numerator's table of `power_sums.py`."""
    from fopi_tune.core.compiled.power_sums import table_of

    exponents = (0.0, alpha, 1.0, 1.0 + alpha, alpha + mu)
    lead, first, table = table_of(exponents, (ki, kp, ki * filter_s, kp * filter_s, kd))
    return lead, first - alpha, table
