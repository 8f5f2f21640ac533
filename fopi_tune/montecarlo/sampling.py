"""Points of the unit cube by index:  (seed, i) -> u_i in (0, 1)^p,  independent of all other draws.

random           the words of Philox4x64-10 at counter (i, column's block, 0, 0): independent draws.
latin hypercube  u_i = (pi_j(i) + v_i)/N with v_i random and pi_j a permutation of 0..N-1 per column j.
sobol            the scrambled Sobol sequence (SciPy), 32 bits, at the middle of its cells.

The permutation is a Feistel network on an a x a square with a = ceil(sqrt N), whose rounds are tables of random words,
so that pi(i) needs neither a list of N entries nor the other entries:

    (L, R) <- (R, L + table_r[R] mod a),  repeated from the start while a L + R >= N.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError

Words = NDArray[np.uint64]

#: words that one Philox block gives
_WORDS = 4
#: blocks generated at once; bounds the memory, not the result
_AT_ONCE = 1 << 18
_ROUNDS = 12
_SOBOL_BITS = 32
#: largest number of distinct draws; the cells of a Latin hypercube must stay wide compared with rounding
_MOST = {"random": 2**62, "latin_hypercube": 2**26, "sobol": 2**_SOBOL_BITS}


class SamplingDesign(Enum):
    """Sampling design; only the draws of RANDOM are independent, which confidence intervals need."""

    RANDOM = "random"
    LATIN_HYPERCUBE = "latin_hypercube"
    SOBOL = "sobol"

    @property
    def most(self) -> int:
        """The largest number of draws of this design."""
        return _MOST[self.value]


class _Stream(Enum):
    """The counter's third word, which keeps random words for different purposes apart."""

    POINTS = 0
    PERMUTATIONS = 1


def unit_cube_points(
    design: SamplingDesign, seed: int, columns: int, first: int, count: int, total: int | None = None
) -> Array:
    """Draws first .. first + count - 1 in the unit cube.

    Args:
        design: random, Latin hypercube or Sobol.
        seed: in [0, 2^64).
        columns: p >= 0, the cube's dimension.
        first: index of the first draw, >= 0.
        count: number of draws, >= 0.
        total: N, the number of draws of the whole design; the Latin hypercube needs it.

    Returns:
        Shape (count, p), every number in (0, 1).

    Raises:
        DomainError: an argument out of range, more draws than the design has, or N is missing.
    """
    _check(design, seed, columns, first, count, total)
    if columns == 0 or count == 0:
        return np.empty((count, columns))
    if design is SamplingDesign.SOBOL:
        return _sobol(seed, columns, first, count)
    u = _random(seed, columns, first, count)
    if design is SamplingDesign.LATIN_HYPERCUBE:
        assert total is not None
        # a cell's outermost 2^-25 is left out: (k + v)/N then never rounds across the cell's border while N <= 2^26
        np.clip(u, 2.0**-25, 1.0 - 2.0**-25, out=u)
        for column in range(columns):
            u[:, column] = (permutation(seed, column, total, first, count) + u[:, column]) / total
    return u


def permutation(seed: int, column: int, total: int, first: int, count: int) -> Array:
    """Entries first .. first + count - 1 of a permutation of 0 .. total - 1 fixed by the seed and the column."""
    side = math.isqrt(total - 1) + 1
    words = philox(seed, 0, -(-_ROUNDS * side // _WORDS), block=column, stream=_Stream.PERMUTATIONS.value)
    tables = (words.reshape(-1)[: _ROUNDS * side].reshape(_ROUNDS, side) % np.uint64(side)).astype(np.int64)
    place = _feistel(np.arange(first, first + count, dtype=np.int64), tables)
    while (beyond := np.flatnonzero(place >= total)).size:
        place[beyond] = _feistel(place[beyond], tables)
    return place.astype(float)


def philox(seed: int, first: int, count: int, block: int = 0, stream: int = 0) -> Words:
    """Random words by counter.

    Row i is the first output of `numpy.random.Philox(key=seed, counter=[first + i, block, stream, 0])`: the block of
    counter first + i + 1, as NumPy increments the counter before it generates.

    Returns:
        Shape (count, 4), 64 random bits each.
    """
    generator = np.random.Philox(key=seed, counter=np.array([first, block, stream, 0], dtype=np.uint64))
    return np.asarray(generator.random_raw(_WORDS * count), dtype=np.uint64).reshape(count, _WORDS)


def uniform_from_words(words: Words) -> Array:
    """Random words w to uniform numbers u in (0, 1).

    u = (floor(w/2^12) + 1/2)/2^52: the odd multiples of 2^-53, symmetric about 1/2, without 0 and 1.
    """
    return np.asarray((words >> np.uint64(12)) * 2.0**-52 + 2.0**-53, dtype=float)


def _random(seed: int, columns: int, first: int, count: int) -> Array:
    u = np.empty((count, columns))
    for block in range(-(-columns // _WORDS)):
        wanted = slice(_WORDS * block, min(_WORDS * (block + 1), columns))
        for start in range(0, count, _AT_ONCE):
            rows = slice(start, min(start + _AT_ONCE, count))
            words = philox(seed, first + start, rows.stop - start, block, _Stream.POINTS.value)
            u[rows, wanted] = uniform_from_words(words[:, : wanted.stop - wanted.start])
    return u


def _feistel(place: NDArray[np.int64], tables: NDArray[np.int64]) -> NDArray[np.int64]:
    side = tables.shape[1]
    left, right = np.divmod(place, side)
    for table in tables:
        # both summands are below `side`: one subtraction gives the remainder
        mixed = left + table[right]
        mixed[mixed >= side] -= side
        left, right = right, mixed
    return side * left + right


def _sobol(seed: int, columns: int, first: int, count: int) -> Array:
    from scipy.stats import qmc  # a second and 40 MB, which other designs need not have

    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed)))
    # `seed` became `rng` in SciPy 1.15, which knows both; its fast_forward needs bits <= 32
    options: dict[str, Any] = {"bits": _SOBOL_BITS, "seed": generator}
    sequence = qmc.Sobol(columns, scramble=True, **options)
    if first:
        sequence.fast_forward(first)
        u = sequence.random(count)
    else:
        # SciPy warns of a first request that is no power of 2; the first point alone is one
        u = np.concatenate([sequence.random(1), sequence.random(count - 1)])
    return u + 0.5 ** (_SOBOL_BITS + 1)


def _check(design: SamplingDesign, seed: int, columns: int, first: int, count: int, total: int | None) -> None:
    if not 0 <= seed < 2**64:
        raise DomainError(f"seed {seed!r} is not in [0, 2^64)")
    if columns < 0 or first < 0 or count < 0:
        raise DomainError(f"columns = {columns!r}, first = {first!r} and count = {count!r} must be at least 0")
    if design is SamplingDesign.LATIN_HYPERCUBE and total is None:
        raise DomainError("a Latin hypercube needs the total number of draws; give total")
    if total is not None and not 1 <= total <= design.most:
        raise DomainError(f"total = {total!r} is not in [1, {design.most}], what a {design.value} design can give")
    if first + count > (design.most if total is None else total):
        most = design.most if total is None else total
        raise DomainError(f"draws {first} to {first + count - 1} were asked for; the design has {most}")
