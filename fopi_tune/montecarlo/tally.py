"""Results of many draws, chunk by chunk:  values, met -> Tally;  merged in any order to the same bits.

A tally keeps counts, the worst values with the indices of their draws, both extremes, and every value as a float: 8
bytes a draw (80 MB for 1e7), twice that while quantiles are taken.  Equal values rank by index, so that the list of the
worst is unique.  No sums are kept: they would depend on the order of merging.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.statistics import Fraction, Quantile, checked_values, fraction, quantiles


class Worst(Enum):
    """Which values are the worst."""

    SMALLEST = 1.0
    LARGEST = -1.0


@dataclass(frozen=True, order=True)
class IndexedValue:
    """A value and the index of its draw."""

    value: float
    index: int


@dataclass(frozen=True, eq=False)
class Chunk:
    """Values of the draws first, first + 1, ...; shape (n,), n >= 1, read-only."""

    first: int
    values: Array

    @property
    def stop(self) -> int:
        """The index after the last."""
        return self.first + len(self.values)


@dataclass(frozen=True, eq=False)
class Tally:
    """Counts and extremes of the draws so far; made by `tally` and `merge`.

    Args:
        worst_are: which values are the worst.
        keep: how many of the worst are kept.
        met: number of draws that met the requirement.
        worst: the worst values, the worst first.
        best: the best value, None without draws.
        chunks: all values, by index.
    """

    worst_are: Worst
    keep: int
    met: int
    worst: tuple[IndexedValue, ...]
    best: IndexedValue | None
    chunks: tuple[Chunk, ...]

    @property
    def total(self) -> int:
        """Number of draws."""
        return sum(len(chunk.values) for chunk in self.chunks)

    def values(self) -> Array:
        """All values in the order of their indices, shape (total,)."""
        return np.concatenate([chunk.values for chunk in self.chunks]) if self.chunks else np.empty(0)

    def fraction(self, confidence: float = 0.95) -> Fraction:
        """The fraction that met, with its exact interval; needs at least one draw."""
        return fraction(self.met, self.total, confidence)

    def quantiles(self, probabilities: Sequence[float], confidence: float = 0.95) -> tuple[Quantile, ...]:
        """Quantiles of the values; needs at least one draw."""
        return quantiles(self.values(), probabilities, confidence)


def tally(values: Array, met: NDArray[np.bool_], first: int, worst_are: Worst, keep: int = 10) -> Tally:
    """The tally of a chunk.

    Args:
        values: shape (n,), infinities allowed; copied.
        met: shape (n,), whether each draw met the requirement.
        first: index of the first draw, >= 0.
        worst_are: which values are the worst.
        keep: how many of the worst to keep, >= 1.

    Raises:
        DomainError: a value that is not a number, shapes that differ, or first or keep out of range.
    """
    values, met = checked_values(values).copy(), np.asarray(met)
    if met.shape != values.shape or met.dtype != bool:
        raise DomainError(f"met must be {values.shape} truth values, not {met.shape} of {met.dtype}")
    if first < 0 or keep < 1:
        raise DomainError(f"first = {first!r} must be at least 0 and keep = {keep!r} at least 1")
    values.flags.writeable = False
    if not len(values):
        return Tally(worst_are, keep, 0, (), None, ())
    signed = worst_are.value * values
    at = int(np.argmax(signed))
    worst = tuple(IndexedValue(float(values[i]), first + int(i)) for i in _least(signed, keep))
    best = IndexedValue(float(values[at]), first + at)
    return Tally(worst_are, keep, int(np.count_nonzero(met)), worst, best, (Chunk(first, values),))


def merge(tallies: Iterable[Tally]) -> Tally:
    """One tally of several; grouping and order do not matter.

    Raises:
        DomainError: none given, tallies that differ in `worst_are` or `keep`, or draws that were counted twice.
    """
    parts = list(tallies)
    if not parts:
        raise DomainError("nothing to merge")
    like = parts[0]
    if any((part.worst_are, part.keep) != (like.worst_are, like.keep) for part in parts):
        raise DomainError("tallies that differ in what is the worst, or in how many to keep, cannot be merged")
    sign = like.worst_are.value
    chunks = sorted((chunk for part in parts for chunk in part.chunks), key=lambda chunk: chunk.first)
    for one, other in itertools.pairwise(chunks):
        if other.first < one.stop:
            raise DomainError(f"draw {other.first} was counted twice; give every chunk its own indices")
    worst = sorted((f for part in parts for f in part.worst), key=lambda f: (sign * f.value, f.index))
    best = min((p.best for p in parts if p.best is not None), key=lambda f: (-sign * f.value, f.index), default=None)
    met = sum(part.met for part in parts)
    return Tally(like.worst_are, like.keep, met, tuple(worst[: like.keep]), best, tuple(chunks))


def _least(values: Array, keep: int) -> NDArray[np.int64]:
    """Indices of the smallest values in order, equal ones by index."""
    if keep < len(values):
        border = np.partition(values, keep - 1)[keep - 1]
        below = np.flatnonzero(values < border)
        # of the values equal to the border only the first are taken
        candidates = np.concatenate([below, np.flatnonzero(values == border)[: keep - len(below)]])
    else:
        candidates = np.arange(len(values))
    return candidates[np.lexsort((candidates, values[candidates]))]
