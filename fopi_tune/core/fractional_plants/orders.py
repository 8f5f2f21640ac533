"""The powers of s in a fractional plant's terms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from fopi_tune.errors import DomainError

#: the largest order, and terms of a numerator or denominator at most
MOST_ORDER, MOST_TERMS = 8.0, 9
#: orders of two terms differ by at least this
LEAST_DIFFERENCE = 1e-3


@dataclass(frozen=True)
class Orders:
    """The powers of s in a plant's terms, each side by falling order.

    Args:
        numerator: of the numerator's terms, the leading one first.
        denominator: of the denominator's terms, the leading one first.

    Raises:
        DomainError: no term, an order out of range, orders that are too close, or not proper.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def __post_init__(self) -> None:
        for side in (self.numerator, self.denominator):
            if not 1 <= len(side) <= MOST_TERMS:
                raise DomainError(f"a side of a fractional plant has {len(side)} terms; write 1 to {MOST_TERMS}")
            if not all(math.isfinite(order) and 0.0 <= order <= MOST_ORDER for order in side):
                raise DomainError(f"an order of a fractional plant lies outside [0, {MOST_ORDER:g}]")
            if any(high - low < LEAST_DIFFERENCE for high, low in pairwise(side)):
                raise DomainError(f"orders must fall, each by at least {LEAST_DIFFERENCE:g}")
        if self.numerator[0] > self.denominator[0]:
            raise DomainError("the numerator's highest order exceeds the denominator's; a plant must be proper")

    @property
    def are_whole(self) -> bool:
        """Whether all orders are whole numbers."""
        return all(order == int(order) for order in (*self.numerator, *self.denominator))


def refuse_fractional(what: str, why: str) -> None:
    """Say that something is not available.

    Raises:
        DomainError: always.
    """
    raise DomainError(not_for_fractional(what, why))


def not_for_fractional(what: str, why: str) -> str:
    """What is said where fractional plants are not known."""
    return f"{what} of a fractional plant is not available in this version: {why}"
