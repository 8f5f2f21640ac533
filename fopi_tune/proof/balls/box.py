"""Boxes of the frequency axis and the uncertain numbers, and their bisection.

Axis 0 is u = ln omega.  Its ends may be infinite; an interval with an infinite end is called a tail.  The other axes
are the family's uncertain numbers.  Ends are doubles and are shared by neighbours, so the pieces cover the whole box.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from flint import arb

#: both ends, finite or not
Interval = tuple[float, float]
#: axis 0 is u = ln omega
Box = tuple[Interval, ...]
#: the upper end of the piece below and the lower end of the piece above
Cut = tuple[float, float]
#: axis -> where it is cut first, because the plants jump there
Cuts = Mapping[int, Sequence[Cut]]

#: by how much a tail's end moves outwards when the tail is cut
_TAIL_STEP = 3.0


def split_point(interval: Interval, origin: float = 0.0) -> float:
    """Where an interval is split: its midpoint; a step from the end of a tail; the origin if both ends are infinite."""
    low, high = interval
    if math.isinf(low):
        return origin if math.isinf(high) else high - _TAIL_STEP
    return low + _TAIL_STEP if math.isinf(high) else low + 0.5 * (high - low)


def split(box: Box, axis: int, origin: float = 0.0, cuts: Cuts | None = None) -> tuple[Box, Box] | None:
    """The two halves of a box; None when there is no double between the ends of the axis.

    Where an axis has cuts, the middle one of those inside comes first; the pieces overlap there.
    """
    low, high = box[axis]
    inside = [cut for cut in (cuts or {}).get(axis, ()) if low < cut[1] and cut[0] < high]
    if inside:
        below, above = inside[len(inside) // 2]
        return with_interval(box, axis, (low, below)), with_interval(box, axis, (above, high))
    middle = split_point(box[axis], origin)
    if not low < middle < high:
        return None
    return with_interval(box, axis, (low, middle)), with_interval(box, axis, (middle, high))


def with_interval(box: Box, axis: int, interval: Interval) -> Box:
    """The box with one axis replaced."""
    return (*box[:axis], interval, *box[axis + 1 :])


def ball_of(interval: Interval) -> arb:
    """The smallest ball that holds a finite interval."""
    low, high = interval
    return arb(low) if low == high else arb(low).union(arb(high))


def is_tail(interval: Interval) -> bool:
    """Whether an end is infinite."""
    return math.isinf(interval[0]) or math.isinf(interval[1])


def centre_of(box: Box) -> tuple[float, ...]:
    """The centre of a box without tails."""
    return tuple(low if low == high else low + 0.5 * (high - low) for low, high in box)


def log_interval(low: float, high: float) -> Interval:
    """[ln low, ln high] rounded outwards by a few units in the last place."""
    ends = math.log(low) if low > 0.0 else -math.inf, math.log(high) if math.isfinite(high) else math.inf
    steps = [max(abs(end), 1.0) * 1e-15 if math.isfinite(end) else 0.0 for end in ends]
    first, last = ends[0] - steps[0], ends[1] + steps[1]
    inside = math.isinf(first) or bool(arb(first).exp() <= arb(low))
    inside = inside and (math.isinf(last) or bool(arb(last).exp() >= arb(high)))
    if not inside:
        raise ArithmeticError(f"the logarithms of {low!r} and {high!r} are not enclosed")
    return first, last


def point_box(values: Sequence[float]) -> Box:
    """The degenerate box of a single point."""
    return tuple((value, value) for value in values)


def axes_without_width(plants: Box) -> frozenset[int]:
    """Axes of the uncertain numbers, counted from 1, along which a box of plants is a point."""
    return frozenset(axis for axis, (low, high) in enumerate(plants, 1) if low == high)
