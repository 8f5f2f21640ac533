"""What a row of the paper's table is, and when a number agrees with a printed one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

#: relative; a number exactly half a unit away agrees, whatever its binary form
_ROUNDING = 1e-9


class Verdict(StrEnum):
    """What became of a claim."""

    HOLDS = "holds"
    #: true under a condition that the paper does not state; the row's `why` names it
    HOLDS_WITH = "holds with a condition"
    DOES_NOT_HOLD = "does not hold"
    #: the paper does not give what a judgement would need; the row says what follows from what it gives
    NOT_PRINTED = "not printed"


@dataclass(frozen=True)
class Row:
    """One claim and what became of it.

    Args:
        claim: one sentence.
        published: what the paper prints.
        recomputed: what this tool finds.
        verdict: computed from the two.
        why: the reason, and the tolerance where numbers are compared.
    """

    claim: str
    published: str
    recomputed: str
    verdict: Verdict
    why: str


@dataclass(frozen=True)
class Printed:
    """A number as it is printed: "0.70" is known to half a unit of its last digit, 0.005.

    Args:
        text: digits with a point, without an exponent.
    """

    text: str

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text)

    @property
    def tolerance(self) -> float:
        """Half a unit of the last digit."""
        return 0.5 * 10.0 ** -len(self.text.partition(".")[2])

    def agrees(self, value: float | None) -> bool:
        """Whether a number rounds to the printed one; None never does."""
        return value is not None and abs(value - self.value) <= self.tolerance * (1.0 + _ROUNDING)


def judged(holds: bool, *, on_condition: bool = False) -> Verdict:
    """The verdict of a comparison.

    Args:
        holds: whether the claim does.
        on_condition: whether only under a condition that is not printed.
    """
    if not holds:
        return Verdict.DOES_NOT_HOLD
    return Verdict.HOLDS_WITH if on_condition else Verdict.HOLDS


def about(count: float) -> str:
    """A count to two digits: how often modes chatter depends on the last bit of a number."""
    return f"{float(f'{count:.2g}'):.0f}"
