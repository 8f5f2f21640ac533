"""Draws that may leave the family:  which are plants, which lie inside, and counts that keep the two apart.

A draw that is no plant (a time constant of -1) has no loop: the nominal plant stands in for it while a chunk is
computed, and no count, quantile or worst plant knows of it.  What is left are draws from the distribution given that
they are plants, so that the exact intervals hold for them.
Of the draws inside the family's box misses are counted and the worst value is kept apart: only they can contradict a
proof.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.logform import Array
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.samples import impossible, outside_box
from fopi_tune.montecarlo.tally import IndexedValue, Tally, Worst, merge, tally

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ClassifiedDraws:
    """Draws first, first + 1, ...

    Args:
        first: index of the first.
        places: shape (m, p); the nominal plant where a draw is none.
        is_plant: shape (m,).
        inside: whether it lies in the family's box, shape (m,).
    """

    first: int
    places: Array
    is_plant: Flags
    inside: Flags

    @classmethod
    def of(cls, places: Array, family: PlantFamily, first: int, free: bool) -> ClassifiedDraws:
        """Draws with their marks.

        Args:
            places: shape (m, p).
            family: its box.
            first: index of the first.
            free: whether draws may leave the box; False saves looking.
        """
        everywhere = np.ones(len(places), dtype=bool)
        if not free:
            return cls(first, places, everywhere, everywhere)
        refused = impossible(places, family)
        inside = ~outside_box(places, family)
        return cls(first, np.where(refused[:, None], family.nominal_point, places), ~refused, inside & ~refused)


@dataclass(frozen=True)
class FamilyTally:
    """A tally, and what of it is about the family.

    Args:
        tally: of every draw that is a plant.
        missed_inside: draws inside the family's box that did not meet the requirement.
        worst_inside: the worst value inside; None when no draw lies there.
    """

    tally: Tally
    missed_inside: int
    worst_inside: IndexedValue | None


def count(drawn: ClassifiedDraws, values: Array, met: Flags, worst_are: Worst, keep: int) -> FamilyTally:
    """A chunk's counts.

    Args:
        drawn: the draws.
        values: shape (m,), infinities allowed; what stands at draws that are no plants is not looked at.
        met: shape (m,), whether each met the requirement.
        worst_are: which values are the worst.
        keep: how many of the worst to keep.
    """
    runs = list(_runs(drawn.is_plant)) or [(0, 0)]
    parts = [tally(values[a:b], met[a:b], drawn.first + a, worst_are, keep) for a, b in runs]
    inside = np.flatnonzero(drawn.inside)
    worst = None
    if len(inside):
        at = int(inside[np.argmin(worst_are.value * values[inside])])
        worst = IndexedValue(float(values[at]), drawn.first + at)
    return FamilyTally(merge(parts), int(np.count_nonzero(~met[inside])), worst)


def merge_family_tallies(parts: Iterable[FamilyTally]) -> FamilyTally:
    """One count of several, as `tally.merge`."""
    each = list(parts)
    whole = merge(part.tally for part in each)
    sign = whole.worst_are.value
    found = [part.worst_inside for part in each if part.worst_inside is not None]
    worst = min(found, key=lambda f: (sign * f.value, f.index), default=None)
    return FamilyTally(whole, sum(part.missed_inside for part in each), worst)


def _runs(marks: Flags) -> Iterator[tuple[int, int]]:
    """Where marks are set without a gap: (start, stop)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marks, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
