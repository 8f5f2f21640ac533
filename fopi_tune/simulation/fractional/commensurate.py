"""The loop as a commensurate pseudo-state model, alpha = p/q:  D^{1/q} x = A x + B r, y = C x.

For P = K/(s + p0), with a = K kp and b = K ki,

    Y/R = (a s^alpha + b)/(s^{alpha+1} + (p0 + a) s^alpha + b) = (a w^p + b)/(w^{p+q} + (p0 + a) w^p + b),  w = s^{1/q},

in controllable form with p + q states: 9 for 0.8 = 4/5, 29 for 0.45 = 9/20.  Its response to a reference is

    y(t) = inverse of C (s^{1/q} I - A)^{-1} B R(s),

whose poles are s = lambda^q for the eigenvalues lambda of A with |arg lambda| < pi/q, a method that shares nothing with
`linear` but the inversion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.inversion import SECTOR_RAD, InversionResult, checked_times, invert_on_hyperbola

#: largest number of states; alpha = 0.999 would need too many to be of use
MOST_STATES = 200


@dataclass(frozen=True)
class CommensurateModel:
    """D^{1/q} x = A x + B r, y = C x.

    Args:
        a: shape (n, n), n = p + q; in (rad/s)^{1/q}.
        b: shape (n,).
        c: shape (n,).
        q: the common denominator of the orders.
    """

    a: Array
    b: Array
    c: Array
    q: int


def commensurate_model(kp: float, ki: float, alpha: Fraction, gain: float, pole_rad_s: float) -> CommensurateModel:
    """The closed loop of C = kp + ki s^-alpha and gain/(s + pole_rad_s).

    Args:
        kp, ki: as in `FoPi`.
        alpha: p/q, in (0, 2).
        gain: K, rad/s times the static gain.
        pole_rad_s: p0, rad/s, any sign.

    Returns:
        The model with p + q states.

    Raises:
        DomainError: alpha outside (0, 2), no integral, a number that is not finite, or more than 200 states.
    """
    p, q = alpha.numerator, alpha.denominator
    if not 0 < alpha < 2:
        raise DomainError(f"alpha = {alpha} lies outside (0, 2)")
    if not all(math.isfinite(number) for number in (kp, ki, gain, pole_rad_s)):
        raise DomainError("the gains and the plant's numbers must be finite")
    if gain * ki == 0.0:
        raise DomainError("ki = 0 or gain = 0: the loop has no integral and needs no fraction of alpha")
    if p + q > MOST_STATES:
        raise DomainError(f"alpha = {alpha} needs {p + q} states; take a fraction with a smaller denominator")
    n = p + q
    a = np.eye(n, k=1)
    a[-1, 0], c = -gain * ki, np.zeros(n)
    a[-1, p] -= pole_rad_s + gain * kp
    c[0] = gain * ki
    c[p] += gain * kp
    return CommensurateModel(a, np.eye(n)[-1], c, q)


def step_response(model: CommensurateModel, times_s: object) -> InversionResult:
    """The output after a unit reference step, from rest.

    Args:
        model: the pseudo-state model.
        times_s: shape (n,), s, > 0, any order.

    Returns:
        Values and error estimates, shape (n,) each.

    Raises:
        DomainError: times that are none, or 0.
    """
    times = checked_times(times_s)

    def transform(s: Complex) -> Complex:
        w = s ** (1.0 / model.q)
        resolvent = w[..., None, None] * np.eye(len(model.a)) - model.a
        return np.linalg.solve(resolvent, model.b[:, None] + 0j)[..., 0] @ model.c / s

    # near w = lambda, s = w^q:  1/(w - lambda) ~ q lambda^{q-1}/(s - lambda^q), and 1/s is lambda^-q
    values = np.linalg.eigvals(model.a)
    seen = np.asarray(values[model.q * np.abs(np.angle(values)) < SECTOR_RAD], dtype=complex)
    characteristic = np.concatenate([[1.0], -model.a[-1, ::-1]])
    parts = np.polyval(model.c[::-1], seen) / np.polyval(np.polyder(characteristic), seen)
    return invert_on_hyperbola(
        transform, times, np.asarray(seen**model.q, dtype=complex), np.asarray(parts * model.q / seen, dtype=complex)
    )
