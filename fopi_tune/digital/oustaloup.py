"""Rational approximations of s^-alpha in continuous time, with the true integrator kept.

    s^-alpha = s^-1 s^beta,   beta = 1 - alpha in (-1, 1),   and only s^beta is approximated:

Oustaloup (Oustaloup, Levron, Mathieu, Nanot, 2000), N poles and zeros spread geometrically over the band [wb, wh],
exact in gain in its middle,

    s^beta ~ K prod_k (s + wz_k)/(s + wp_k),
    wz_k = wb (wh/wb)^((k - 1/2 - beta/2)/N),   wp_k = wb (wh/wb)^((k - 1/2 + beta/2)/N),   k = 1 ... N.             (1)

The modified filter (Xue, Zhao, Chen, 2006, as the paper codes it with b = 10, d = 9) multiplies (1) by

    (d/b)^beta (d s^2 + b wh s)/(d (1 - beta) s^2 + b wh s + d beta) .                                               (2)

(2) has three defects in a controller.  Its gain in the middle of the band is (d/b)^beta, not 1: here the gain is set in
the middle of the band, as in (1).  Its zero at s = 0 cancels the integrator, and its slow pole, near
-d beta/(b wh), is unstable for beta < 0: here that zero and that pole, which nearly cancel each other, are left out,
and the fast pair, which is what improves the upper end of the band, is kept:

    (d s + b wh)/(d (1 - beta) s + b wh) .                                                                           (3)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError

#: the modified filter's constants
_B, _D = 10.0, 9.0


@dataclass(frozen=True)
class ZeroPoleGain:
    """gain prod(s - zeros)/prod(s - poles), all real.

    Args:
        zeros: rad/s, < 0.
        poles: rad/s, <= 0; exactly one is 0.
        gain: the leading factor.
    """

    zeros: tuple[float, ...]
    poles: tuple[float, ...]
    gain: float

    def response(self, omega: Array) -> NDArray[np.complex128]:
        """The value at s = j omega, shape (n,)."""
        s = 1j * omega[:, None]
        # by logarithms: products of fifty factors over a wide band overflow, their quotient does not
        factors = np.log(s - np.array(self.zeros)).sum(axis=1) - np.log(s - np.array(self.poles)).sum(axis=1)
        return np.asarray(self.gain * np.exp(factors), dtype=complex)

    @property
    def residues(self) -> Array:
        """r_k of sum r_k/(s - p_k), from zeros, poles and gain; shape of the poles.  All poles must be different."""
        poles, zeros = np.array(self.poles), np.array(self.zeros)
        apart = poles[:, None] - poles[None, :]
        np.fill_diagonal(apart, 1.0)
        over = poles[:, None] - zeros[None, :]
        size = np.log(np.abs(over)).sum(axis=1) - np.log(np.abs(apart)).sum(axis=1)
        sign = np.prod(np.sign(over), axis=1) * np.prod(np.sign(apart), axis=1)
        return self.gain * sign * np.exp(size)

    def without_integrator(self, s: float) -> float:
        """s times the value at a real s that is no pole."""
        poles, zeros = np.array(self.poles[1:]), np.array(self.zeros)
        size = np.log(np.abs(s - zeros)).sum() - np.log(np.abs(s - poles)).sum()
        return float(self.gain * np.prod(np.sign(s - zeros)) * np.prod(np.sign(s - poles)) * np.exp(size))


def oustaloup(alpha: float, poles: int, band_rad_s: tuple[float, float]) -> ZeroPoleGain:
    """s^-alpha by (1) with a true integrator.

    Args:
        alpha: order of the integral, in (0, 2).
        poles: N, without the integrator.
        band_rad_s: wb and wh.
    """
    beta = 1.0 - alpha
    if beta == 0.0:
        return ZeroPoleGain((), (0.0,), 1.0)
    return _with_gain(*spread_roots(beta, poles, band_rad_s), beta, band_rad_s)


def modified_oustaloup(alpha: float, poles: int, band_rad_s: tuple[float, float]) -> ZeroPoleGain:
    """s^-alpha by (1) times (3) with a true integrator.

    Args:
        alpha: order of the integral, in (0, 2).
        poles: of the whole filter but for the integrator; one is the fast one of (3).
        band_rad_s: wb and wh.
    """
    beta = 1.0 - alpha
    if beta == 0.0:
        return ZeroPoleGain((), (0.0,), 1.0)
    if poles < 2:
        raise DomainError("modified_oustaloup needs at least 2 poles: one is its extra fast pole")
    zeros, spread = spread_roots(beta, poles - 1, band_rad_s)
    fast_zero, fast_pole = fast_pair(beta, band_rad_s[1])
    return _with_gain((*zeros, fast_zero), (*spread, fast_pole), beta, band_rad_s)


def fast_pair(beta: float, high_rad_s: float) -> tuple[float, float]:
    """Zero and pole of (3), rad/s; the pole is the zero over 1 - beta = alpha."""
    return -_B * high_rad_s / _D, -_B * high_rad_s / (_D * (1.0 - beta))


def spread_roots(
    beta: float, count: int, band_rad_s: tuple[float, float]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Zeros and poles of (1), rad/s; at beta = 0 they are equal."""
    low, high = band_rad_s
    k = np.arange(count) + 0.5
    zeros = -low * (high / low) ** ((k - 0.5 * beta) / count)
    poles = -low * (high / low) ** ((k + 0.5 * beta) / count)
    return tuple(zeros.tolist()), tuple(poles.tolist())


def _with_gain(
    zeros: tuple[float, ...], poles: tuple[float, ...], beta: float, band_rad_s: tuple[float, float]
) -> ZeroPoleGain:
    """Add the integrator and set the gain to be exact in the middle of the band: |F(j w)| = w^(beta - 1)."""
    middle = float(np.sqrt(band_rad_s[0] * band_rad_s[1]))
    unscaled = ZeroPoleGain(zeros, (0.0, *poles), 1.0)
    size = float(np.abs(unscaled.response(np.array([middle])))[0])
    return ZeroPoleGain(zeros, (0.0, *poles), middle ** (beta - 1.0) / size)
