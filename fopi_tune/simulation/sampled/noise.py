"""Counter-based normal deviates:  (seed, plant, sample) -> deviate, independent of the order of evaluation.

Philox4x32-10 (Salmon et al., Parallel random numbers: as easy as 1, 2, 3, 2011) with the seed as key and the counter
(k//2, 0, plant), the plant as two words, lower one first, gives four words of 32 bits: two for the sample 2j, the upper
one first, two for 2j + 1.  The upper 52 of these 64 bits make u = (bits + 1/2)/2^52, and the deviate is the normal
quantile of u by AS 241's PPND16 (Wichura, Applied Statistics 37, 1988), which is right to about 1e-15.
"""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array

MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
WEYL = (0x9E3779B9, 0xBB67AE85)
ROUNDS = 10
#: AS 241 uses `CENTRE` for |u - 1/2| up to CENTRAL, `MIDDLE` for r = sqrt(-ln(min(u, 1 - u))) up to FAR, then `OUTER`
CENTRAL, FAR = 0.425, 5.0
#: numerators and denominators in ascending powers of CENTRAL^2 - q^2, r - 1.6 and r - 5
CENTRE = (
    (3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
     4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3),
    (1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
     2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3),
)  # fmt: skip
MIDDLE = (
    (1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
     1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4),
    (1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
     1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9),
)  # fmt: skip
OUTER = (
    (6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
     2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7),
    (1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
     7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15),
)  # fmt: skip

_WORD = 2**32 - 1


def philox(counter: tuple[int, int, int, int], key: tuple[int, int]) -> tuple[int, int, int, int]:
    """Four words of 32 bits at a counter of four and a key of two words."""
    a, b, c, d = counter
    k0, k1 = key
    for _ in range(ROUNDS):
        one, two = MULTIPLIERS[0] * a, MULTIPLIERS[1] * c
        a, b, c, d = (two >> 32) ^ b ^ k0, two & _WORD, (one >> 32) ^ d ^ k1, one & _WORD
        k0, k1 = (k0 + WEYL[0]) & _WORD, (k1 + WEYL[1]) & _WORD
    return a, b, c, d


def normal_quantile(u: Array) -> Array:
    """The normal distribution's quantile of u, shape (n,), 0 < u < 1."""
    q = u - 0.5
    r = np.sqrt(-np.log(np.minimum(u, 1.0 - u)))
    tail = np.where(r <= FAR, _quotient(MIDDLE, r - 1.6), _quotient(OUTER, r - 5.0))
    return np.where(np.abs(q) <= CENTRAL, q * _quotient(CENTRE, CENTRAL**2 - q * q), np.copysign(tail, q))


def normal_deviates(seed: int, plant: int, steps: int) -> Array:
    """The noise of one plant, standard deviation 1, shape (steps,)."""
    key = seed & _WORD, seed >> 32
    words = [word for j in range(-(-steps // 2)) for word in philox((j, 0, plant & _WORD, plant >> 32), key)]
    bits = [(upper << 20) | (lower >> 12) for upper, lower in zip(words[::2], words[1::2], strict=True)]
    return normal_quantile((np.array(bits[:steps], dtype=float) + 0.5) * 2.0**-52)


def _quotient(coefficients: tuple[tuple[float, ...], tuple[float, ...]], at: Array) -> Array:
    top, bottom = (np.polynomial.polynomial.polyval(at, np.array(row)) for row in coefficients)
    return np.asarray(top / bottom, dtype=float)
