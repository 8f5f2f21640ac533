"""Whole samples of delay, at which a direct path jumps:  the pieces of a family on which its plants are continuous.

On samples a plant with a direct path is not continuous in its delay of l samples: at a whole number m the direct path
takes one sample more.  So the dead time is cut there first.  In floating point a delay is m from m - WHOLE on
(`fopi_tune.core.sampled_loops`), and the dead time of m samples is seldom a double.  So the pieces overlap a little:

    the piece below m ends at the double next to m + 1.5 WHOLE, and its delays are limited to m, with m samples,     (1)
    the piece above m begins at the one next to m - 1.5 WHOLE, its delays are at least m, with m + 1 samples.        (2)

So each piece is continuous on its whole box, and together they hold every delay, and those next to m in both readings.
Where the family ends at m, up to WHOLE, the piece below ends at the double before.

Source: derived.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from flint import arb

from fopi_tune.core.sampled_loops import WHOLE
from fopi_tune.proof.balls.box import Cut, Interval

#: distance of a piece's end from m, in samples
_BEYOND = 1.5 * WHOLE


@dataclass(frozen=True)
class Pieces:
    """The pieces of a family by its dead time.

    Args:
        first: whole samples of delay of the first piece, rounded down; each further piece has one more.
        sides: ranges of the dead time, ascending.
        samples_of: l at a dead time.
    """

    first: int
    sides: tuple[Interval, ...]
    samples_of: Callable[[float], arb]

    @property
    def cuts(self) -> tuple[Cut, ...]:
        """The upper end of each piece but the last, and the lower end of the next."""
        return tuple((a[1], b[0]) for a, b in zip(self.sides, self.sides[1:], strict=False))

    def whole_samples(self, side: Interval) -> int | None:
        """The delay of a box's piece in samples, rounded down; None for a box that is in none, or inside of two."""
        held = [k for k, (low, high) in enumerate(self.sides) if low <= side[0] and side[1] <= high]
        if len(held) == 1:
            return self.first + held[0]
        if len(held) != 2 or side[0] != side[1]:
            return None
        below, above = held
        # the worst face of a box may be a piece's end
        if side[0] == self.sides[below][1]:
            return self.first + below
        if side[0] == self.sides[above][0]:
            return self.first + above
        return rounded_down(self.samples_of(side[0]))

    def member(self, whole_samples: int) -> float:
        """A dead time of a piece."""
        k = whole_samples - self.first
        low, high = self.sides[k]
        # the last piece may be hardly more than the end of the family
        return high if k == len(self.sides) - 1 else low + 0.5 * (high - low)


def pieces_of(
    dead_time_s: Interval, samples_of: Callable[[float], arb], dead_time_of: Callable[[int], float]
) -> Pieces | None:
    """The pieces of a range of dead times; None for so many samples that doubles do not tell m - WHOLE from m.

    Args:
        dead_time_s: the range.
        samples_of: l at a dead time.
        dead_time_of: the double next to l = m.
    """
    low, high = dead_time_s
    first, last = rounded_down(samples_of(low)), rounded_down(samples_of(high))
    if first is None or last is None:
        return None
    starts, ends = [low], []
    for m in range(first + 1, last + 1):
        beyond = _BEYOND * (dead_time_of(m + 1) - dead_time_of(m))
        above, below = dead_time_of(m) - beyond, dead_time_of(m) + beyond
        if not (_is_between(samples_of(above), m, -2.0, -1.0) and _is_between(samples_of(below), m, 1.0, 2.0)):
            return None
        if above <= starts[-1]:
            return None
        starts.append(above)
        ends.append(below if below < high else math.nextafter(high, -math.inf))
    return Pieces(first, tuple(zip(starts, [*ends, high], strict=True)), samples_of)


def rounded_down(samples: arb) -> int | None:
    """l rounded down, as in floating point: to m from m - WHOLE on; None when that is not known."""
    whole = (samples + arb(WHOLE)).floor().unique_fmpz()
    return None if whole is None else int(whole)


def _is_between(samples: arb, m: int, low: float, high: float) -> bool:
    """Whether (l - m)/WHOLE is within (low, high)."""
    apart = (samples - m) / arb(WHOLE)
    return bool(apart > low and apart < high)
