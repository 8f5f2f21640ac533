"""What a claim is, and the mean-value form most of them are tested with.

A claim says something about every point of its domain.  On a box X with centre c,

    h(x)  lies in  h(c) + sum_i h_i(X) (X_i - c_i) ,                                                               (1)

h_i the partial derivatives enclosed over the whole box: the excess is quadratic in the box's size, so that the number
of boxes grows with log(1/gap), not with 1/gap.  Where some h_i(X) has one sign, the worst point of the box lies on one
of its faces, and the axis falls away.

Source: the mean-value form of Moore, Kearfott and Cloud, Introduction to Interval Analysis, 2009.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from flint import arb

from fopi_tune.proof.balls.box import Box, ball_of, is_tail

#: how far out in u a tail is looked at to see whether its plants are what is in the way
_FAR = 60.0
#: the token of a box on which a claim holds by itself
PLAIN = "."


@dataclass(frozen=True)
class BoxVerdict:
    """What a claim says of one box.

    Args:
        leaf: the token with which it holds here; None when it was not shown.
        axis: otherwise the axis to cut; -1 when there is none left.
        pins: axes along which the worst point lies at an end: (axis, upper end).
        counterexample: whether the claim is false at the box's centre.
    """

    leaf: str | None
    axis: int = 0
    monotone_ends: tuple[tuple[int, bool], ...] = ()
    counterexample: bool = False


HOLDS = BoxVerdict(PLAIN)


class Claim(ABC):
    """A statement about all points of a domain.

    Attributes:
        domain: where it is made.
        origin: u at which an axis without ends is cut first.
    """

    domain: Box
    origin: float

    @abstractmethod
    def examine(self, box: Box) -> BoxVerdict:
        """Try to show the claim on a box, or say how to go on."""

    def holds(self, box: Box, leaf: str) -> bool:
        """Whether the claim holds on a box; `leaf` is what `examine` once said of it."""
        return leaf == PLAIN and self.examine(box).leaf == PLAIN

    def to_dict(self) -> dict[str, Any]:
        """What it says, for messages."""
        return {"kind": type(self).__name__}


def deviations(box: Box) -> list[arb]:
    """X_i - c_i; a tail's is not a number."""
    found = []
    for side in box:
        low, high = side
        if low == high:
            found.append(arb(0))
        elif is_tail(side):
            found.append(arb.nan())
        else:
            found.append(ball_of(side) - arb(low + 0.5 * (high - low)))
    return found


def magnitude(ball: arb) -> float:
    """The largest absolute value in a ball; inf when it has none."""
    return float(ball.abs_upper()) if ball.is_finite() else float("inf")


def max_smear_axis(box: Box, slopes: Sequence[arb]) -> int:
    """The axis along which h varies most; -1 when none has a width."""
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
    """The axis to cut when nothing is known: a tail, else the longest; -1 when none has a width.

    The width of an uncertain number counts as a part of the family's own, which is comparable with a width of u and
    does not care whether the number passes 0.
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
    """The same among the uncertain numbers alone: u is not for this claim to cut."""
    return longest_axis(((0.0, 0.0), *box[1:]), domain)


def tail_axis(box: Box, domain: Box, is_settled: Callable[[Box], bool]) -> int:
    """The axis along which to cut a tail that was not settled: its own end, if that settles it far out; else a plant's.

    Args:
        box: with a tail.
        domain: of the claim.
        is_settled: whether a box is settled as a whole.
    """
    low, high = box[0]
    far = (low, high - _FAR) if low == -math.inf else (low + _FAR, high)
    if all(a == b for a, b in box[1:]) or is_settled((far, *box[1:])):
        return 0
    return longest_parameter_axis(box, domain)
