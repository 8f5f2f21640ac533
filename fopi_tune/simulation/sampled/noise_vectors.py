"""The deviates of `noise`, for the plants of a block side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled import noise
from fopi_tune.simulation.sampled.layout import LOGARITHMS, NOISE, TAILS, WIDTH
from fopi_tune.simulation.sampled.vectors import (
    bits,
    count,
    load,
    products,
    root,
    size,
    spread,
    squeeze,
    store,
    stretch,
    upper_bits,
    where,
    words,
)

_M0, _M1 = (np.uint64(word) for word in noise.MULTIPLIERS)
_W0, _W1 = (np.uint64(word) for word in noise.WEYL)
_ROUNDS, _CENTRAL, _FAR = noise.ROUNDS, noise.CENTRAL, noise.FAR
_CENTRE_TOP, _CENTRE_BOTTOM = noise.CENTRE
_MIDDLE_TOP, _MIDDLE_BOTTOM = noise.MIDDLE
_OUTER_TOP, _OUTER_BOTTOM = noise.OUTER

_inlined: Any = njit(forceinline=True, error_model="numpy")
_apart: Any = njit(error_model="numpy")


@_inlined
def _philox(seed, plant, counter):
    """Philox4x64-10 for the plants plant, plant + 1, ..."""
    a, b = words(counter, np.uint64(0)), words(np.uint64(0), np.uint64(0))
    c, d = b, b
    k0, k1, step = seed, words(plant, np.uint64(1)), words(_W1, np.uint64(0))
    for _ in range(_ROUNDS):
        upper, lower = products(a, _M0)
        other, least = products(c, _M1)
        a, b, c, d = other ^ b ^ words(k0, np.uint64(0)), least, upper ^ d ^ k1, lower
        k0, k1 = k0 + _W0, k1 + step
    return a, b, c, d


@_inlined
def _quotient(top, bottom, x):
    a, b = spread(top[7]), spread(bottom[7])
    for i in range(1, 8):
        a, b = spread(top[7 - i]) + a * x, spread(bottom[7 - i]) + b * x
    return a / b


@_inlined
def _tails(s, found):
    """The deviates of the numbers q in the first places of TAILS."""
    for place in range(found):
        s[LOGARITHMS + place] = math.log(0.5 - abs(s[TAILS + place]))
    for place in range(0, found, WIDTH):
        q, r = load(s, TAILS + place), root(spread(0.0) - load(s, LOGARITHMS + place))
        value = _quotient(_MIDDLE_TOP, _MIDDLE_BOTTOM, r - spread(1.6))
        far = r > spread(_FAR)
        if bits(far) != 0:
            value = where(far, _quotient(_OUTER_TOP, _OUTER_BOTTOM, r - spread(5.0)), value)
        store(s, TAILS + place, where(q < spread(0.0), spread(0.0) - value, value))


@_apart
def make_noise(s, seed, index, k):
    """Deviates of the samples k to k + 3 of plants index, index + 1, ..."""
    four = _philox(seed, np.uint64(index), np.uint64(1 + k // 4))
    for i in range(4):
        store(s, NOISE + WIDTH * i, (upper_bits(four[i]) + spread(0.5)) * spread(2.0**-52) - spread(0.5))
    # the tails of all four samples at once: they are few
    found = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        outer = size(q) > spread(_CENTRAL)
        squeeze(s, TAILS + found, q, outer)
        found += count(bits(outer))
    _tails(s, found)
    found = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        outer = size(q) > spread(_CENTRAL)
        central = q * _quotient(_CENTRE_TOP, _CENTRE_BOTTOM, spread(_CENTRAL**2) - q * q)
        store(s, NOISE + WIDTH * i, stretch(s, TAILS + found, outer, central))
        found += count(bits(outer))
