"""How a design ends, in words that files, scripts and every stage share.  Importing it loads no solver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Status(StrEnum):
    """How a design ended; `advice` tells the user what to do."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    FAILED = "failed"

    @property
    def advice(self) -> str:
        """One sentence."""
        return {
            Status.SOLVED: "All requirements hold for the whole family.",
            Status.INFEASIBLE: "No gains meet all requirements; relax one of those that clash.",
            Status.UNBOUNDED: "The objective improves without end; bound the gains or add a requirement.",
            Status.FAILED: "No answer that could be confirmed; the message says why.",
        }[self]


@dataclass(frozen=True)
class Relaxation:
    """By how much one of the clashing requirements would have to give for all the others to hold.

    Args:
        requirement: index in the spec's list.
        amount: in the quantity's public unit, > 0; None when no amount alone is enough, or none was found.
        new_limit: the limit that would be met, public unit; of a design one with which the check found the spec met.
    """

    requirement: int
    amount: float | None
    new_limit: float | None


@dataclass(frozen=True)
class Price:
    """A multiplier checked by solving again with the limit moved.

    Args:
        limit: the one that was moved, public unit; of a `between` the dearer one.
        relaxed: what the objective gains for each unit the limit gives; None where the solver found nothing.
        tightened: what it loses for each unit the limit takes; None where the limit cannot be tightened.
        agrees: both are the multiplier to 1 %, as far as they are known.
    """

    limit: float
    relaxed: float | None
    tightened: float | None
    agrees: bool

    @property
    def has_kink(self) -> bool:
        """Whether relaxing gains something else than tightening loses."""
        if self.relaxed is None or self.tightened is None:
            return False
        return abs(self.relaxed - self.tightened) > 0.02 * max(abs(self.relaxed), abs(self.tightened))
