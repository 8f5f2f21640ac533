"""Membership of draws in the family:  which draws are plants, which of them lie in its box, tallied separately.

A draw that is no plant (a time constant of -1) has no loop: the nominal plant replaces it while a chunk is computed,
and it enters no count, quantile or list of worst plants.  The other draws follow the distribution conditioned on being
a plant, so that the exact intervals hold for them.
For the draws inside the family's box the violations and the worst value are kept as well: only those draws can
contradict a proof.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parameter_table import impossible, outside_box
from fopi_tune.core.plant import PlantFamily
from fopi_tune.montecarlo.tally import IndexedValue, Tally, Worst, merge, tally

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ClassifiedDraws:
    """Draws first, first + 1, ..., classified by membership.

    Args:
        first: index of the first.
        points: shape (m, p); the nominal point where a draw is no plant.
        is_plant: shape (m,).
        inside: whether it lies in the family's box, shape (m,).
    """

    first: int
    points: Array
    is_plant: Flags
    inside: Flags

    @classmethod
    def of(cls, points: Array, family: PlantFamily, first: int, may_leave_box: bool) -> ClassifiedDraws:
        """Classify draws.

        Args:
            points: shape (m, p).
            family: its box.
            first: index of the first.
            may_leave_box: whether draws may lie outside the box; False skips the test.
        """
        everywhere = np.ones(len(points), dtype=bool)
        if not may_leave_box:
            return cls(first, points, everywhere, everywhere)
        refused = impossible(points, family)
        inside = ~outside_box(points, family)
        return cls(first, np.where(refused[:, None], family.nominal_point, points), ~refused, inside & ~refused)


@dataclass(frozen=True)
class FamilyTally:
    """A tally of all draws, and the violations and worst value within the family.

    Args:
        tally: of every draw that is a plant.
        missed_inside: draws inside the family's box that did not meet the requirement.
        worst_inside: the worst value inside; None when no draw lies there.
    """

    tally: Tally
    missed_inside: int
    worst_inside: IndexedValue | None


def family_tally(draws: ClassifiedDraws, values: Array, met: Flags, worst_are: Worst, keep: int) -> FamilyTally:
    """The tally of a chunk.

    Args:
        draws: the draws.
        values: shape (m,), infinities allowed; entries of draws that are no plants are ignored.
        met: shape (m,), whether each met the requirement.
        worst_are: which values are the worst.
        keep: how many of the worst to keep.
    """
    runs = list(_runs(draws.is_plant)) or [(0, 0)]
    parts = [tally(values[a:b], met[a:b], draws.first + a, worst_are, keep) for a, b in runs]
    inside = np.flatnonzero(draws.inside)
    worst = None
    if len(inside):
        at = int(inside[np.argmin(worst_are.value * values[inside])])
        worst = IndexedValue(float(values[at]), draws.first + at)
    return FamilyTally(merge(parts), int(np.count_nonzero(~met[inside])), worst)


def merge_family_tallies(parts: Iterable[FamilyTally]) -> FamilyTally:
    """One tally of several, as `tally.merge`."""
    each = list(parts)
    whole = merge(part.tally for part in each)
    sign = whole.worst_are.value
    found = [part.worst_inside for part in each if part.worst_inside is not None]
    worst = min(found, key=lambda f: (sign * f.value, f.index), default=None)
    return FamilyTally(whole, sum(part.missed_inside for part in each), worst)


def _runs(flags: Flags) -> Iterator[tuple[int, int]]:
    """The runs of consecutive flags that are set: (start, stop)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
