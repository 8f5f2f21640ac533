"""Sums of powers of omega, as controllers with a derivative of any order and fractional plants have them (compiled).

With u = ln omega such a factor of a function in Bode form is

    G(u) = sum_j e^{b_j + q_j u + j psi_j} ,    q_0 = b_0 = psi_0 = 0 ,    q_j > 0 ,                                (1)

which tends to 1 as u -> -inf.  Im G is a sum of real exponentials, which has no more zeros than sign changes among its
coefficients: between two of them G stays in one half-plane, so that its phase lies within (h pi, (h + 1) pi), with h
known.  That is the branch of ln G.  With the term k that is largest at u, and G e^{-q_k u} in the place of G, the
derivatives are m_i = sum_j (q_j - k)^i g_j/G,

    d ln G/du = q_k + m_1,    d2 = m_2 - m_1^2,    d3 = m_3 - 3 m_1 m_2 + 2 m_1^3 ,                                 (2)

bounded on an interval by the sizes of the terms and the smallest |G e^{-q_k u}| there.

Source: derived; the number of zeros is Descartes' rule of signs for real exponents (Laguerre).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.compiled.loops import entry, power_sum_at

Array = NDArray[np.float64]
#: terms of (1) of a controller at most, and rows of a table: q, b, cos psi, sin psi, zeros of Im G (inf where there are
#: fewer; the last is the sign of the factor), h up to each zero and beyond
TERMS, ROWS = 5, 6
#: exponents that differ by less are equal but for rounding
_SAME = 1e-14
_BISECTIONS = 200
_FARTHEST = 1e4


def table_of(
    exponents: Sequence[float], coefficients: Sequence[float], width: int = TERMS
) -> tuple[float, float, Array]:
    """sum_j c_j s^{e_j} as its first term and (1).

    Args:
        exponents: e_j.
        coefficients: c_j, at least one of them not 0.
        width: room for so many terms; of a controller `TERMS`.

    Returns:
        Coefficient and exponent of the first term, and the table, shape (ROWS, width).
    """
    joined: list[list[float]] = []
    for e, c in sorted(zip(exponents, coefficients, strict=True)):
        if joined and abs(e - joined[-1][0]) <= _SAME:
            joined[-1][1] += c
        else:
            joined.append([e, c])
    terms = [(e, c) for e, c in joined if c != 0.0]
    (first, lead), table = terms[0], np.zeros((ROWS, width))
    table[1], table[4] = -np.inf, np.inf
    for j, (e, c) in enumerate(terms):
        q = e - first
        # the sine of whole turns by a quarter is 0 without rounding
        angle = 0.5 * math.pi * q
        sign = math.copysign(1.0, c) * math.copysign(1.0, lead)
        cosine, sine = (math.cos(angle), math.sin(angle)) if q % 1.0 else ((1, 0), (0, 1), (-1, 0), (0, -1))[int(q) % 4]
        table[:4, j] = q, math.log(abs(c)) - math.log(abs(lead)), sign * cosine, sign * sine
    count = len(terms)
    q, b, cosine, sine = (table[k, :count] for k in range(4))
    imaginary = [(q[j], b[j], float(sine[j])) for j in range(count) if sine[j] != 0.0]
    h = 0 if not imaginary or imaginary[0][2] > 0.0 else -1
    table[5] = h
    for k, u in enumerate(sign_changes(imaginary)):
        size = b + q * u
        is_even = float((cosine * np.exp(size - size.max())).sum()) > 0.0
        # the multiple of pi that is passed: of h and h + 1 the one that is even where Re G > 0
        h += 1 if (h + 1) % 2 == (0 if is_even else 1) else -1
        table[4, k], table[5, k + 1 :] = u, h
    table[4, -1] = 1.0
    return lead, first, table


def sign_changes(terms: Sequence[tuple[float, float, float]]) -> list[float]:
    """Where sum_j w_j e^{b_j + q_j u} changes its sign; terms (q_j, b_j, w_j) by rising q.

    Between its extremes, which are the zeros of a sum with one term less, there is at most one.
    """
    if len(terms) < 2:
        return []
    q_first = terms[0][0]
    # without the first term's exponential the first term is constant
    inner = sign_changes([(q, b, w * (q - q_first)) for q, b, w in terms[1:]])

    def value(u: float) -> float:
        sizes = [b + q * u for q, b, _ in terms]
        most = max(sizes)
        return math.fsum(w * math.exp(size - most) for (_, _, w), size in zip(terms, sizes, strict=True))

    found = []
    places = [-_FARTHEST, *inner, _FARTHEST]
    for low, high in pairwise(places):
        a, b = low, high
        rising = value(b) > 0.0
        if (value(a) > 0.0) == rising:
            continue
        for _ in range(_BISECTIONS):
            middle = 0.5 * (a + b)
            if not a < middle < b:
                break
            if (value(middle) > 0.0) == rising:
                b = middle
            else:
                a = middle
        found.append(0.5 * (a + b))
    return found


def corners(tables: Array, nearly: float) -> tuple[Array, Array]:
    """The u below and above which (1) is its first and its last term but for a part `nearly`, shape (m,) each."""
    q, b = tables[:, 0], tables[:, 1]
    last = last_terms(tables)[:, None]
    present = np.isfinite(b)
    q_last, b_last = np.take_along_axis(q, last, 1), np.take_along_axis(b, last, 1)
    reach = -math.log(nearly)
    with np.errstate(all="ignore"):
        low = np.where(present & (q > 0.0), -(reach + b) / q, np.inf).min(axis=1)
        high = np.where(present & (q < q_last), (reach + b - b_last) / (q_last - q), -np.inf).max(axis=1)
    return low, high


def last_terms(tables: Array) -> Any:
    """The index of the term with the largest exponent, shape (m,)."""
    return np.argmax(np.where(np.isfinite(tables[:, 1]), tables[:, 0], -1.0), axis=1)


def ends(tables: Array) -> tuple[Array, Array, Array]:
    """Of the last term the exponent, ln of the size and the phase on its branch, shape (m,) each."""
    rows, last = np.arange(len(tables)), last_terms(tables)
    q, b, cosine, sine = (tables[rows, k, last] for k in range(4))
    angle, middle = np.arctan2(sine, cosine), (tables[:, 5, -1] + 0.5) * np.pi
    return q, b, angle + 2.0 * np.pi * np.round((middle - angle) / (2.0 * np.pi))


@entry
def curvature_bounds(tables, rows, u, h):
    """A bound of |d2 ln G/du2| on [u - h, u + h]; rows, u and h of shape (n,)."""
    found = np.empty(len(u))
    for i in range(len(u)):
        found[i] = power_sum_at(tables, rows[i], u[i], h[i])[6]
    return found
