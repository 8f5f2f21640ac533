"""Continuous to discrete, by Tustin's rule or matched poles and zeros:  C(z) = direct + sum_k r_k/(z - p_k).

Poles of these filters are real, simple, and so close to 1 that rounding spoils an expanded polynomial: the sections
(`core.parallel_form`) are computed from zeros, poles and gain without one.  The integrator's pole is exactly 1.

Tustin's rule with T = tan(w_p Ts/2)/w_p (T = Ts/2 without prewarping) maps a section of the continuous sum by itself,

    r/(s - p)  ->  g + g (1 + q)/(z - q),    q = (1 + pT)/(1 - pT),    g = r T/(1 - pT) .                          (1)

Matched poles and zeros, z = e^{s Ts}, keep the gain at one frequency; the zero at infinity goes to z = -1.

Source: derived; (1) is r/(s - p) with s = (z - 1)/(T (z + 1)).
"""

from __future__ import annotations

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital.oustaloup import ZeroPoleGain
from fopi_tune.errors import DomainError


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
        return Sections(sample_time_s, gains.kp, (), ())
    p, r = np.array(integral.poles), gains.ki * integral.residues
    q = (1.0 + p * half) / (1.0 - p * half)
    g = r * half / (1.0 - p * half)
    q[p == 0.0] = 1.0
    # 1 + q = 2/(1 - pT), which does not cancel near q = -1
    residues = g * 2.0 / (1.0 - p * half)
    return Sections(sample_time_s, float(gains.kp + g.sum()), tuple(q.tolist()), tuple(residues.tolist()))


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
        return Sections(sample_time_s, gains.kp, (), ())
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
    return Sections(sample_time_s, gains.kp + direct, tuple(poles.tolist()), tuple(residues.tolist()))
