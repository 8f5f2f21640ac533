"""A filter's sections with their derivatives:  the filter of s^-alpha alone -> d/d alpha, d/d omega of its numbers.

omega is the frequency at which `rule: matched` keeps the gain and a prewarped `tustin` is exact.  With zeros z_l and
poles p_i of the approximation, p_0 = 0 the integrator's, the residues' products are taken as

    rho_i = prod_{l >= 1} m_il,    m_il = (p_i - z_l)/(p_i - p_l),    m_ii = (p_i - z_i)/(p_i - p_0) .               (1)

Zero and pole of a pair are neighbours, so that every m_il but m_ii is of size 1, and nothing overflows.  m_ii vanishes
at alpha = 1, where each zero meets its pole and the section leaves the filter; its derivative does not, and products of
all factors but one give the derivative of (1) without a division by m_ii.  The rules are those of `digital.transforms`:
with s_i = 1/(1 - p_i T), gain K and f_i = K rho_i, Tustin's is

    q_i = 2 s_i - 1,    g_i = f_i T s_i,    r_i = 2 g_i s_i,    direct = sum g_i .                                   (2)

Source: derived; (1) is the partial fraction of `digital.oustaloup`, (1), and (2) is `digital.transforms`, (1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.digital.discretize import Method, Rule, exact_at, sections_of
from fopi_tune.digital.oustaloup import fast_pair, spread_roots
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec


@dataclass(frozen=True, eq=False)
class UnitFilter:
    """The filter of kp = 0 and ki = 1; the last axis holds the value, d/d alpha and d/d omega.

    Args:
        direct: shape (3,).
        poles: shape (n, 3), the integrator's first.
        residues: shape (n, 3); 0 of a section that is not in the filter, as at alpha = 1.
    """

    direct: Array
    poles: Array
    residues: Array


@dataclass(frozen=True, eq=False)
class _Roots:
    """Zeros and poles of the approximation without the integrator, shape (n,), rad/s, and their d/d alpha."""

    zeros: Array
    poles: Array
    zeros_rate: Array
    poles_rate: Array


def unit_filter(
    alpha: float, digital: DigitalSpec, crossover_rad_s: float | None, *, alone: bool = False
) -> UnitFilter:  # fmt: skip
    """The filter with its derivatives.

    Args:
        alpha: order of the integral, in (0, 2); fixed for `method: fit`, whose derivatives are left at 0.
        digital: the spec's section.
        crossover_rad_s: omega; None, or above the Nyquist frequency: the band's middle.
        alone: only the integrator of alpha = 1, whose d/d alpha is then left at 0.

    Raises:
        DomainError: the filter cannot be made, or has poles that fall together.
    """
    if Method(digital.method) is Method.FIT:
        return _constant(alpha, digital)
    none = np.zeros(0)
    roots = _Roots(none, none, none, none) if alone else _roots(alpha, digital)
    omega = exact_at(digital, crossover_rad_s)
    with np.errstate(all="ignore"):
        if Rule(digital.rule) is Rule.TUSTIN:
            prewarp = omega if digital.prewarp == "crossover" else None
            found = _tustin(alpha, roots, digital, prewarp)
        else:
            found = _matched(alpha, roots, digital, omega)
    if not all(np.all(np.isfinite(part)) for part in (found.direct, found.poles, found.residues)):
        raise DomainError(
            "derivatives of the filter are beyond what a double holds: poles fall together at this sample time; use "
            "fewer poles or a narrower band"
        )
    if alone:
        for part in (found.direct, found.residues):
            part[..., 1] = 0.0
    return found


def _constant(alpha: float, digital: DigitalSpec) -> UnitFilter:
    sections = sections_of(FoPi(0.0, 1.0, alpha), digital)
    none = np.zeros(2)
    rows = [np.array([[value, 0.0, 0.0] for value in part]) for part in (sections.poles, sections.residues)]
    return UnitFilter(np.append(sections.direct, none), rows[0], rows[1])


def _roots(alpha: float, digital: DigitalSpec) -> _Roots:
    """d ln z/d alpha = ln(wh/wb)/(2 N) = -d ln p/d alpha of the spread roots; the fast pole goes as 1/alpha."""
    (low, high), beta = digital.band_rad_s, 1.0 - alpha
    modified = Method(digital.method) is Method.MODIFIED_OUSTALOUP
    count = digital.poles - modified
    if count < 1:
        # at alpha = 1 the filter has no need of them, but its neighbours cannot be made
        raise DomainError("modified_oustaloup needs at least 2 poles: one is its extra fast pole")
    zeros, poles = (np.array(roots) for roots in spread_roots(beta, count, digital.band_rad_s))
    rate = 0.5 * np.log(high / low) / count
    found = _Roots(zeros, poles, zeros * rate, -poles * rate)
    if not modified:
        return found
    zero, pole = fast_pair(beta, high)
    return _Roots(
        np.append(found.zeros, zero),
        np.append(found.poles, pole),
        np.append(found.zeros_rate, 0.0),
        np.append(found.poles_rate, -pole / alpha),
    )


def _gain(alpha: float, roots: _Roots, band_rad_s: tuple[float, float]) -> tuple[float, float]:
    """K and d ln K/d alpha:  K = m^(1 - alpha) prod |j m - p|/prod |j m - z|, m the band's middle."""
    middle = np.sqrt(band_rad_s[0] * band_rad_s[1])
    zeros, poles = middle**2 + roots.zeros**2, middle**2 + roots.poles**2
    log = (1.0 - alpha) * np.log(middle) + 0.5 * (np.log(poles) - np.log(zeros)).sum()
    rate = (roots.poles * roots.poles_rate / poles - roots.zeros * roots.zeros_rate / zeros).sum() - np.log(middle)
    return float(np.exp(log)), float(rate)


def _tustin(alpha: float, roots: _Roots, digital: DigitalSpec, prewarp_rad_s: float | None) -> UnitFilter:
    """(2)."""
    half, stretch = 0.5 * digital.sample_time_s, 0.0
    if prewarp_rad_s is not None:
        tangent = np.tan(prewarp_rad_s * half)
        # T = tan(omega h)/omega
        half, stretch = tangent / prewarp_rad_s, (half * (1.0 + tangent**2) - tangent / prewarp_rad_s) / prewarp_rad_s
    gain, gain_rate = _gain(alpha, roots, digital.band_rad_s)
    rho, rho_rate = _fractions(roots, None)
    p, p_rate = np.append(0.0, roots.poles), np.append(0.0, roots.poles_rate)
    none = np.zeros(len(p))
    f = _with_rates(gain * rho, gain * (rho_rate + gain_rate * rho), none)
    T = np.array([half, 0.0, stretch])
    s = 1.0 / (1.0 - p * half)
    s = _with_rates(s, s**2 * p_rate * half, s**2 * p * stretch)
    g = _product(_product(f, T), s)
    residues = 2.0 * _product(g, s)
    return UnitFilter(g.sum(axis=0), 2.0 * s - np.array([1.0, 0.0, 0.0]), residues)


def _matched(alpha: float, roots: _Roots, digital: DigitalSpec, omega: float) -> UnitFilter:
    """Roots e^{root Ts} and a zero at -1; the gain at omega is the approximation's."""
    Ts = digital.sample_time_s
    p, p_rate = np.append(0.0, roots.poles), np.append(0.0, roots.poles_rate)
    poles, zeros = np.exp(p * Ts), np.exp(roots.zeros * Ts)
    poles_rate, zeros_rate = Ts * poles * p_rate, Ts * zeros * roots.zeros_rate
    s, z = 1j * omega, complex(np.exp(1j * omega * Ts))
    over, under, over_z, under_z = s - roots.zeros, s - p, z - zeros, z - poles
    gain, gain_rate = _gain(alpha, roots, digital.band_rad_s)
    # logarithms: products of fifty factors over a wide band overflow
    log = _log_size(over) - _log_size(under) + _log_size(under_z) - _log_size(over_z) - np.log(np.abs(z + 1.0))
    by_alpha = (p_rate / under).sum() - (roots.zeros_rate / over).sum()
    by_alpha += (zeros_rate / over_z).sum() - (poles_rate / under_z).sum()
    by_omega = (1j / over).sum() - (1j / under).sum()
    by_omega += 1j * Ts * z * ((1.0 / under_z).sum() - (1.0 / over_z).sum() - 1.0 / (z + 1.0))
    size = gain * np.exp(log)
    direct = size * np.array([1.0, gain_rate + by_alpha.real, by_omega.real])
    rho, rho_rate = _fractions(roots, Ts)
    none = np.zeros(len(p))
    shares = _with_rates(rho * (poles + 1.0), rho_rate * (poles + 1.0) + rho * poles_rate, none)
    return UnitFilter(direct, _with_rates(poles, poles_rate, none), _product(shares, direct))


def _fractions(roots: _Roots, sample_time_s: float | None) -> tuple[Array, Array]:
    """(1) and d/d alpha, shape (n + 1,): of the roots themselves, or of e^{root Ts}."""
    p, p_rate = np.append(0.0, roots.poles), np.append(0.0, roots.poles_rate)
    n, rows = len(roots.poles), np.arange(len(roots.poles))
    other, other_rate = np.tile(roots.poles, (n + 1, 1)), np.tile(roots.poles_rate, (n + 1, 1))
    other[rows + 1, rows], other_rate[rows + 1, rows] = 0.0, 0.0
    top, top_rate = _difference(p[:, None], p_rate[:, None], roots.zeros, roots.zeros_rate, sample_time_s)
    bottom, bottom_rate = _difference(p[:, None], p_rate[:, None], other, other_rate, sample_time_s)
    factors = top / bottom
    rates = (top_rate - factors * bottom_rate) / bottom
    # the product of all factors but one: of those before it, and of those after it
    ones = np.ones((n + 1, 1))
    before = np.cumprod(np.hstack([ones, factors]), axis=1)
    after = np.cumprod(np.hstack([ones, factors[:, ::-1]]), axis=1)[:, ::-1]
    rate = (before[:, :-1] * rates * after[:, 1:]).sum(axis=1)
    return np.asarray(before[:, -1], dtype=float), np.asarray(rate, dtype=float)


def _difference(a: Array, a_rate: Array, b: Array, b_rate: Array, sample_time_s: float | None) -> tuple[Array, Array]:
    """a - b, or e^{a Ts} - e^{b Ts} without cancellation, and its derivative."""
    if sample_time_s is None:
        return a - b, a_rate - b_rate
    a, b = a * sample_time_s, b * sample_time_s
    size, apart = np.exp(np.maximum(a, b)), -np.expm1(-np.abs(a - b))
    return np.sign(a - b) * size * apart, sample_time_s * (np.exp(a) * a_rate - np.exp(b) * b_rate)


def _log_size(factors: NDArray[np.complexfloating]) -> float:
    return float(np.log(np.abs(factors)).sum())


def _with_rates(value: Array, by_alpha: Array, by_omega: Array) -> Array:
    return np.stack([value, by_alpha, by_omega], axis=-1)


def _product(a: Array, b: Array) -> Array:
    """The product of two numbers with their derivatives."""
    found = a[..., :1] * b + b[..., :1] * a
    found[..., 0] = a[..., 0] * b[..., 0]
    return np.asarray(found, dtype=float)
