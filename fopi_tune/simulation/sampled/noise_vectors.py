"""The normal deviates of `noise`, for the `WIDTH` plants of a block side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled import noise
from fopi_tune.simulation.sampled.layout import NOISE, TAILS, WIDTH
from fopi_tune.simulation.sampled.vectors import (
    absolute,
    bits,
    broadcast,
    compress_store,
    count_bits,
    expand_load,
    exponent_and_mantissa,
    half_product,
    load,
    square_root,
    store,
    upper_bits,
    upper_half,
    where,
    word_sequence,
)

_M0, _M1 = (np.uint64(word) for word in noise.MULTIPLIERS)
_W0, _W1 = (np.uint64(word) for word in noise.WEYL)
_ROUNDS, _CENTRAL, _FAR = noise.ROUNDS, noise.CENTRAL, noise.FAR
_CENTRE_TOP, _CENTRE_BOTTOM = noise.CENTRE
_MIDDLE_TOP, _MIDDLE_BOTTOM = noise.MIDDLE
_OUTER_TOP, _OUTER_BOTTOM = noise.OUTER

_LN2 = math.log(2.0)
#: of artanh(s)/s in ascending powers of s^2; 0.172^22/23 < 1e-18
_ARTANH = tuple(1.0 / (2 * i + 1) for i in range(11))

_inlined: Any = njit(forceinline=True, error_model="numpy")
_compiled: Any = njit(error_model="numpy")


@_inlined
def _philox(seed, plant, counter):
    """Philox4x32-10 of the plants plant, plant + 1, ...: four words in lower halves, with anything above."""
    zero = np.uint64(0)
    a, b, c = word_sequence(counter, zero), word_sequence(zero, zero), word_sequence(plant, np.uint64(1))
    d, k0, k1 = upper_half(c), seed, seed >> np.uint64(32)
    for _ in range(_ROUNDS):
        first, second = half_product(a, _M0), half_product(c, _M1)
        a, b = upper_half(second) ^ b ^ word_sequence(k0, zero), second
        c, d = upper_half(first) ^ d ^ word_sequence(k1, zero), first
        k0, k1 = k0 + _W0, k1 + _W1
    return a, b, c, d


@_inlined
def _quotient(top, bottom, x):
    a, b = broadcast(top[7]), broadcast(bottom[7])
    for i in range(1, 8):
        a, b = broadcast(top[7 - i]) + a * x, broadcast(bottom[7 - i]) + b * x
    return a / b


@_inlined
def _logarithm(x):
    """ln x = k ln 2 + 2 artanh((m - 1)/(m + 1)) of x = m 2^k."""
    k, m = exponent_and_mantissa(x)
    t = (m - broadcast(1.0)) / (m + broadcast(1.0))
    series = broadcast(_ARTANH[10])
    for i in range(1, 11):
        series = broadcast(_ARTANH[10 - i]) + series * (t * t)
    return k * broadcast(_LN2) + (t + t) * series


@_inlined
def _tails(s, found):
    """The deviates of the first `found` numbers q = u - 1/2 in TAILS, in place."""
    for place in range(0, found, WIDTH):
        q = load(s, TAILS + place)
        r = square_root(broadcast(0.0) - _logarithm(broadcast(0.5) - absolute(q)))
        value = _quotient(_MIDDLE_TOP, _MIDDLE_BOTTOM, r - broadcast(1.6))
        far = r > broadcast(_FAR)
        if bits(far) != 0:
            value = where(far, _quotient(_OUTER_TOP, _OUTER_BOTTOM, r - broadcast(5.0)), value)
        store(s, TAILS + place, where(q < broadcast(0.0), broadcast(0.0) - value, value))


@_compiled
def make_noise(s, seed, index, k):
    """Deviates of the samples k to k + 3 of plants index, index + 1, ..."""
    for i in range(2):
        a, b, c, d = _philox(seed, np.uint64(index), np.uint64(k // 2 + i))
        one, two = upper_bits(a, b) + broadcast(0.5), upper_bits(c, d) + broadcast(0.5)
        store(s, NOISE + 2 * i * WIDTH, one * broadcast(2.0**-52) - broadcast(0.5))
        store(s, NOISE + (2 * i + 1) * WIDTH, two * broadcast(2.0**-52) - broadcast(0.5))
    # the tails of all four samples at once: they are few
    found = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        outer = absolute(q) > broadcast(_CENTRAL)
        compress_store(s, TAILS + found, q, outer)
        found += count_bits(bits(outer))
    _tails(s, found)
    found = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        outer = absolute(q) > broadcast(_CENTRAL)
        central = q * _quotient(_CENTRE_TOP, _CENTRE_BOTTOM, broadcast(_CENTRAL**2) - q * q)
        store(s, NOISE + WIDTH * i, expand_load(s, TAILS + found, outer, central))
        found += count_bits(bits(outer))
