"""Exact zero-order-hold discretisation of many plants at once.

The results are the polynomials Q and R of `fopi_tune.core.sampled_loops`, formula (1).
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.core.bode_form import Array

#: terms of the exponential series: 0.5^16/16! = 1e-18
_TERMS = 17


def matrix_expm1(matrices: Array) -> Array:
    """e^A - I of m small matrices, shape (m, n, n), each to rounding of its largest entry.

    Scaling and squaring: k is chosen so that A/2^k has a norm below 1/2; e^{A/2^k} - I comes from its series, and
    e^{2A} - I = 2 (e^A - I) + (e^A - I)^2 is applied k times.  scipy's expm is not used: a thousand calls of a threaded
    library for 2 x 2 matrices can take seconds.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    halvings = max(0, math.ceil(math.log2(max(norm, 1e-300))) + 1)
    small = np.asarray(matrices * 0.5**halvings, dtype=float)
    less = power = small
    for k in range(2, _TERMS):
        power = power @ small / k
        less = less + power
    for _ in range(halvings):
        less = 2.0 * less + less @ less
    return less


def behind_hold(numerator: Array, denominator: Array, sample_time_s: float, part: Array) -> tuple[Array, Array]:
    """Q and R in powers of delta = z - 1 of m plants behind a hold, without the whole samples of their delay.

    Args:
        numerator: shape (m, a), descending powers of s.
        denominator: shape (m, n + 1); where the first coefficients are 0 the plant is of a lower degree.
        sample_time_s: Ts.
        part: f, shape (m,), the fractional part of their delay in samples, 0 <= f < 1.

    Returns:
        Shape (m, n + 1) each; R's first coefficient other than 0 is 1.
    """
    first = np.argmax(denominator != 0.0, axis=1)
    if first.any():
        q, r = np.zeros(denominator.shape), np.zeros(denominator.shape)
        for start in np.unique(first).tolist():
            rows, width = np.flatnonzero(first == start), denominator.shape[1] - start
            top = numerator[rows][:, max(numerator.shape[1] - width, 0) :]
            q[rows, start:], r[rows, start:] = behind_hold(top, denominator[rows, start:], sample_time_s, part[rows])
        return q, r
    a, c, direct = companion(numerator, denominator, sample_time_s)
    m, n = c.shape
    if n == 0:
        return direct[:, None], np.ones((m, 1))
    whole, first, second = _integrals(a, np.ones(m)), _integrals(a, 1.0 - part), _integrals(a, part)
    g0 = first[:, :, 0]
    # int_{1-f}^1 = e^{A(1-f)} int_0^f, and e^{At} = I + A int_0^t
    g1 = second[:, :, 0] + np.einsum("mij,mjk,mk->mi", a, first, second[:, :, 0])
    q, r = _polynomials(a @ whole, c, g0, g1)
    # an integrator's pole must be exactly z = 1, and the static gain exactly the plant's
    for k in range(1, n + 1):
        r[:, k] = np.where((denominator[:, k:] == 0.0).all(axis=1), 0.0, r[:, k])
    q = q + direct[:, None] * r
    end = denominator[:, -1]
    steady = end != 0.0
    q[:, -1] = np.where(steady, numerator[:, -1] / np.where(steady, end, 1.0) * r[:, -1], q[:, -1])
    return q, r


def companion(numerator: Array, denominator: Array, sample_time_s: float) -> tuple[Array, Array, Array]:
    """m plants without their dead time as x' = A x + e_1 u, y = c x + direct u, time counted in samples.

    Args:
        numerator: shape (m, a), descending powers of s.
        denominator: shape (m, n + 1); no first coefficient is 0.
        sample_time_s: Ts.

    Returns:
        A, shape (m, n, n); c, shape (m, n); the direct path, shape (m,).
    """
    m, width = denominator.shape
    n = width - 1
    # s Ts = sigma: coefficients of falling powers take Ts^0, Ts^1, ...; the plants are the last axis
    scale = (sample_time_s ** np.arange(width))[:, None]
    bottom, top = np.ascontiguousarray(denominator.T) * scale, np.zeros((width, m))
    top[width - numerator.shape[1] :] = numerator.T
    top, bottom = top * scale / bottom[0], bottom / bottom[0]
    direct = top[0]
    a = np.zeros((m, n, n))
    if n:
        a[:, 1:, :-1] = np.eye(n - 1)
        a[:, 0, :] = -bottom[1:].T
    return a, np.ascontiguousarray((top[1:] - direct * bottom[1:]).T), direct


def constant_input_step(a: Array, part: Array) -> tuple[Array, Array]:
    """State transition over part of a sample with a constant input u:  x <- e^{At} x + int_0^t e^{As} e_1 ds u.

    Args:
        a: the companion matrices, shape (m, n, n).
        part: t, shape (m,), in samples.

    Returns:
        e^{At}, shape (m, n, n), and the input vector int_0^t e^{As} e_1 ds, shape (m, n).
    """
    if a.shape[1] == 1:
        exponent = a[:, 0, 0] * part
        return np.exp(exponent)[:, None, None], (part * _mean_growth(exponent))[:, None]
    integral = _integrals(a, part)
    return np.eye(a.shape[1]) + a @ integral, integral[:, :, :1].sum(axis=2)


def _mean_growth(x: Array) -> Array:
    """(e^x - 1)/x, and 1 at 0."""
    still = x == 0.0
    return np.where(still, 1.0, np.expm1(x) / np.where(still, 1.0, x))


def _integrals(a: Array, t: Array) -> Array:
    """int_0^t e^{As} ds of m matrices, shape (m, n, n)."""
    m, n, _ = a.shape
    if n == 1:
        return (t * _mean_growth(a[:, 0, 0] * t))[:, None, None]
    block = np.zeros((m, 2 * n, 2 * n))
    block[:, :n, :n] = a
    block[:, :n, n:] = np.eye(n)
    return matrix_expm1(block * t[:, None, None])[:, :n, n:]


def _polynomials(e: Array, c: Array, g0: Array, g1: Array) -> tuple[Array, Array]:
    """Q and R by the Faddeev-LeVerrier recursion for adj(delta I - E) = sum_k B_k delta^(n-1-k), E = Phi - I."""
    m, n = c.shape
    r = np.zeros((m, n + 1))
    r[:, 0] = 1.0
    q = np.zeros((m, n + 1))
    b = np.broadcast_to(np.eye(n), (m, n, n))
    for k in range(n):
        # c B_k ((g_0 + g_1) + g_0 delta)
        q[:, k] += np.einsum("mi,mij,mj->m", c, b, g0)
        q[:, k + 1] += np.einsum("mi,mij,mj->m", c, b, g0 + g1)
        eb = e @ b
        r[:, k + 1] = -np.trace(eb, axis1=1, axis2=2) / (k + 1)
        b = eb + r[:, k + 1, None, None] * np.eye(n)
    return q, r
