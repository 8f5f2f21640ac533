"""Continuous to discrete, by Tustin's rule or matched poles and zeros:  C(z) = direct + sum_k r_k/(z - p_k).

Poles of these filters are real, simple, and so close to 1 that rounding spoils an expanded polynomial: the sections
(`core.parallel_form`) are computed from zeros, poles and gain without one.  The integrator's pole is exactly 1.

Tustin's rule with T = tan(w_p Ts/2)/w_p (T = Ts/2 without prewarping) maps a section of the continuous sum by itself,

    r/(s - p)  ->  g + g (1 + q)/(z - q),    q = (1 + pT)/(1 - pT),    g = r T/(1 - pT) .                          (1)

Matched poles and zeros, z = e^{s Ts}, keep the gain at one frequency; the zero at infinity goes to z = -1.

The derivative is always sampled by Tustin's rule without prewarping, as a sum of filtered differences,

    c s/(t s + 1)  ->  d + d (p - 1)/(z - p),    p = (2 t - Ts)/(2 t + Ts),    d = 2 c/(2 t + Ts) .                 (2)

Of order 1 it is one of them, c = kd and t = Tf.  Below Tf = Ts/2, p is negative: the derivative of a step would
alternate.  Of another order, s^mu = s s^(mu - 1), and s^(mu - 1) ~ G(s) = s F(s) is what approximates s^-alpha at
alpha = 2 - mu without its integrator, by the same method, poles and band.  With F's poles p_k and residues r_k in s,

    kd s^mu/(Tf s + 1) ~ kd (G(-1/Tf) s/(Tf s + 1) + sum_k c_k s/(t_k s + 1)),
    t_k = -1/p_k,    c_k = -r_k/(1 + Tf p_k) .                                                                      (3)

So its gain at frequency 0 is exactly 0, a measurement at rest is left to the integral, and at mu = 1 the sum has one
term.  Oustaloup's filter of the order mu itself has the gain wb^mu at 0, and errs by more for mu > 1/2: it approximates
the larger part of the order.  Below the band (3) goes as s, above it as s^0.

Source: derived; (1) is r/(s - p) with s = (z - 1)/(T (z + 1)), (2) c/t (1 - 1/(t s + 1)) with T = Ts/2, and (3) are the
partial fractions of G/(Tf s + 1).
"""

from __future__ import annotations

import numpy as np

from fopi_tune.core.controller import FoPi, derivative_of
from fopi_tune.core.parallel_form import DirectParts, Sections
from fopi_tune.digital.oustaloup import ZeroPoleGain
from fopi_tune.errors import DomainError

#: relative; a lag closer to a pole of the approximation would make terms that cancel in float32
_APART = 1e-6


def tustin(gains: FoPi, integral: ZeroPoleGain, sample_time_s: float, prewarp_rad_s: float | None = None) -> Sections:
    """kp + ki F(s) by Tustin's rule.

    Args:
        gains: kp and ki.
        integral: F, the approximation of s^-alpha.
        sample_time_s: Ts.
        prewarp_rad_s: a frequency at which the filter is exact; below the Nyquist frequency.
    """
    half = 0.5 * sample_time_s
    if prewarp_rad_s is not None:
        if not 0.0 < prewarp_rad_s < np.pi / sample_time_s:
            raise DomainError(f"prewarp frequency {prewarp_rad_s:g} rad/s is not below the Nyquist frequency")
        half = float(np.tan(prewarp_rad_s * half) / prewarp_rad_s)
    if gains.ki == 0.0:
        return Sections(sample_time_s, gains.kp, (), (), DirectParts(gains.kp))
    p, r = np.array(integral.poles), gains.ki * integral.residues
    q = (1.0 + p * half) / (1.0 - p * half)
    g = r * half / (1.0 - p * half)
    q[p == 0.0] = 1.0
    # 1 + q = 2/(1 - pT), which does not cancel near q = -1
    residues = g * 2.0 / (1.0 - p * half)
    parts = DirectParts(gains.kp, float(g.sum()))
    return Sections(sample_time_s, parts.on_error, tuple(q.tolist()), tuple(residues.tolist()), parts)


def matched(gains: FoPi, integral: ZeroPoleGain, sample_time_s: float, exact_at_rad_s: float) -> Sections:
    """kp + ki F(s) with F's poles and zeros mapped by z = e^{s Ts}.

    Args:
        gains: kp and ki.
        integral: F, the approximation of s^-alpha.
        sample_time_s: Ts.
        exact_at_rad_s: where the gain of F is kept; below the Nyquist frequency.
    """
    if not 0.0 < exact_at_rad_s < np.pi / sample_time_s:
        raise DomainError(f"matching frequency {exact_at_rad_s:g} rad/s is not below the Nyquist frequency")
    if gains.ki == 0.0:
        return Sections(sample_time_s, gains.kp, (), (), DirectParts(gains.kp))
    poles = np.exp(np.array(integral.poles) * sample_time_s)
    zeros = np.append(np.exp(np.array(integral.zeros) * sample_time_s), -1.0)
    # zeros far above the Nyquist frequency underflow to 0, which does no harm
    z = np.exp(1j * exact_at_rad_s * sample_time_s)
    size = np.abs(np.prod(z - zeros) / np.prod(z - poles))
    wanted = np.abs(integral.response(np.array([exact_at_rad_s])))[0]
    gain = gains.ki * float(wanted / size)
    apart = poles[:, None] - poles[None, :]
    np.fill_diagonal(apart, 1.0)
    if np.any(apart == 0.0):
        raise DomainError("matched poles fall together; use tustin, fewer poles or a narrower band")
    residues = gain * np.prod(poles[:, None] - zeros[None, :], axis=1) / np.prod(apart, axis=1)
    direct = gain if len(zeros) == len(poles) else 0.0
    parts = DirectParts(gains.kp, direct)
    return Sections(sample_time_s, parts.on_error, tuple(poles.tolist()), tuple(residues.tolist()), parts)


def with_derivative(integral: Sections, gains: FoPi, rest: ZeroPoleGain) -> Sections:
    """kp + ki F(z) and the derivative kd s^mu/(Tf s + 1) as more sections, (3).

    Args:
        integral: kp + ki F(z), with its parts.
        gains: kd, mu and Tf.
        rest: the approximation of s^(mu - 2), of which the sections are made.

    Raises:
        DomainError: Tf < Ts/2, or 1/Tf is next to a pole of `rest`.
    """
    (kd, mu, filter_s), Ts, parts = derivative_of(gains), integral.sample_time_s, integral.parts
    if kd == 0.0 or parts is None:
        return integral
    if 2.0 * filter_s < Ts:
        what = f"derivative_filter_time_constant_s {filter_s:g} is below half the sample time, {0.5 * Ts:g} s"
        raise DomainError(
            f"{what}: sampled, the derivative would change its sign from sample to sample; write {0.5 * Ts:g} or more, "
            f"or a sample_time_s of {2.0 * filter_s:g} or less"
        )
    poles = np.array(rest.poles[1:])
    if np.any(np.abs(1.0 + filter_s * poles) < _APART):
        raise DomainError(
            f"derivative_filter_time_constant_s {filter_s:g} makes 1/Tf a pole of the filter of s^(mu - 1); change it, "
            "or the number of poles or the band, a little"
        )
    times = np.array([*(-1.0 / poles), filter_s])
    factors = np.array([*(-rest.residues[1:] / (1.0 + filter_s * poles)), rest.without_integrator(-1.0 / filter_s)])
    direct = 2.0 * (kd * factors) / (2.0 * times + Ts)
    residues = -direct * 2.0 * Ts / (2.0 * times + Ts)
    alpha_mu, ratio = gains.alpha + mu, gains.ki / kd
    # |ki omega^-alpha| = |kd omega^mu|; of a PID the sections say it
    equal_at = ratio ** (1.0 / alpha_mu) if ratio > 0.0 and (gains.alpha, mu) != (1.0, 1.0) else None
    return Sections(
        Ts,
        integral.direct + float(direct.sum()),
        (*integral.poles, *((2.0 * times - Ts) / (2.0 * times + Ts)).tolist()),
        (*integral.residues, *residues.tolist()),
        DirectParts(parts.proportional, parts.integral, tuple(direct.tolist()), equal_at),
    )
