"""Claims, and the mean-value form with which most of them are tested.

A claim is a statement about every point of its domain.  On a box X with centre c,

    h(x)  lies in  h(c) + sum_i h_i(X) (X_i - c_i) ,                                                               (1)

where h_i(X) encloses the partial derivative over the whole box.  The overestimation is quadratic in the box's size, so
the number of boxes grows with log(1/gap), not with 1/gap.  Where some h_i(X) has one sign (monotonicity test), the
worst point of the box lies on one of its faces, and the box is replaced by that face.

Source: the mean-value form of Moore, Kearfott and Cloud, Introduction to Interval Analysis, 2009.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from flint import arb, ctx

from fopi_tune.proof.balls.box import Box, Cuts, Interval, ball_of, is_tail
from fopi_tune.proof.balls.loop import BallLoop

#: distance in u at which a tail is tested: if the claim fails even there, the plants are the cause
_FAR = 60.0
#: the token of a box on which a claim holds by itself
PLAIN = "."
#: work of listing every crossing of one plant in floating point, in boxes of a bound: it takes about as long
LISTING_WORK = 40


@dataclass(frozen=True)
class BoxVerdict:
    """Result of testing a claim on one box.

    Args:
        leaf: the token with which the claim holds; None when it was not proved.
        axis: otherwise the axis to split; -1 when there is none left.
        monotone_ends: axes along which the box is monotone, with the worst end: (axis, whether the upper end).
        counterexample: whether the claim is false at the box's centre.
        work: counted effort of the test, in boxes of a bound: 1 for an enclosure of the loop over the box and one at
            its centre.
    """

    leaf: str | None
    axis: int = 0
    monotone_ends: tuple[tuple[int, bool], ...] = ()
    counterexample: bool = False
    work: int = 1


HOLDS = BoxVerdict(PLAIN)


class Claim(ABC):
    """A statement about all points of a domain.

    Attributes:
        domain: frequencies and plants of the statement.
        origin: u at which the whole frequency axis is split first.
    """

    domain: Box
    origin: float

    @property
    def cuts(self) -> Cuts:
        """Where an uncertain number is split first."""
        return {}

    @property
    def farthest_u(self) -> float:
        """How far out a tail is cut before a search gives up: farther out nothing changes any more."""
        return math.inf

    @abstractmethod
    def examine(self, box: Box) -> BoxVerdict:
        """Try to prove the claim on a box; otherwise say how to split it."""

    def holds(self, box: Box, leaf: str) -> bool:
        """Whether the claim holds on a box; `leaf` is the token that `examine` returned for it."""
        return leaf == PLAIN and self.examine(box).leaf == PLAIN

    def to_dict(self) -> dict[str, Any]:
        """The claim in words, for messages."""
        return {"kind": type(self).__name__}


class LoopClaim(Claim):
    """A claim about a loop's box of frequencies and plants.

    Attributes:
        loop: gains and family.
    """

    loop: BallLoop

    @property
    def cuts(self) -> Cuts:
        """Where the plants jump."""
        return self.loop.cuts

    @property
    def farthest_u(self) -> float:
        """How far out every term but the leading one is negligible."""
        return self.loop.farthest_u


def deviations(box: Box) -> list[arb]:
    """X_i - c_i; nan for a tail."""
    return [_deviation(side, ctx.prec) for side in box]


@lru_cache(maxsize=1 << 14)
def _deviation(side: Interval, precision: int) -> arb:
    """X - c of one axis at the current precision; the same sides come again and again."""
    low, high = side
    if low == high:
        return arb(0)
    return arb.nan() if is_tail(side) else ball_of(side) - arb(low + 0.5 * (high - low))


def variation(slopes: Sequence[arb | None], box: Box) -> arb:
    """sum_i h_i (X_i - c_i) of (1), over the axes that have a width and, as in a tail, a slope."""
    total = arb(0)
    for slope, deviation, (low, high) in zip(slopes, deviations(box), box, strict=True):
        if slope is not None and low < high:
            total = total + slope * deviation
    return total


def magnitude(ball: arb) -> float:
    """The largest absolute value in a ball; inf for an infinite ball."""
    return float(ball.abs_upper()) if ball.is_finite() else float("inf")


def max_smear_axis(box: Box, slopes: Sequence[arb]) -> int:
    """The axis with the largest smear |h_i| width(X_i); -1 when no axis has a width."""
    best, where = -1.0, -1
    for axis, (side, slope) in enumerate(zip(box, slopes, strict=True)):
        width = side[1] - side[0]
        if width == 0.0:
            continue
        variation = magnitude(slope) * width
        if variation != variation:
            variation = float("inf")
        if variation > best:
            best, where = variation, axis
    return where


def longest_axis(box: Box, domain: Box) -> int:
    """The axis to split without derivatives: a tail, else the longest; -1 when none has a width.

    The width of an uncertain number is measured relative to its range in the family, so that it is comparable with a
    width in u.
    """
    best, where = -1.0, -1
    for axis, ((low, high), (first, last)) in enumerate(zip(box, domain, strict=True)):
        if low == high:
            continue
        length = (high - low) / (last - first) if axis else high - low
        if length > best:
            best, where = length, axis
    return where


def longest_parameter_axis(box: Box, domain: Box) -> int:
    """The longest axis among the uncertain numbers; for claims that do not split u."""
    return longest_axis(((0.0, 0.0), *box[1:]), domain)


def tail_axis(box: Box, domain: Box, is_settled: Callable[[Box], bool]) -> int:
    """The axis along which to split an unproved tail: u, if the claim holds far out; else an uncertain number.

    Args:
        box: with a tail.
        domain: of the claim.
        is_settled: whether the claim is proved on a whole box.
    """
    low, high = box[0]
    far = (low, high - _FAR) if low == -math.inf else (low + _FAR, high)
    if all(a == b for a, b in box[1:]) or is_settled((far, *box[1:])):
        return 0
    return longest_parameter_axis(box, domain)
