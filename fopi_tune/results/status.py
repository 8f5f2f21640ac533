"""How a design ends:  its status, relaxations of clashing requirements, prices.  Importing it loads no solver."""

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
    """By how much the limit of a clashing requirement must be relaxed so that all requirements can hold.

    Args:
        requirement: index in the spec's list; those on measures of scenarios are counted after the others.
        amount: in the quantity's public unit, > 0; None if relaxing this limit alone does not help, or none was found.
        new_limit: the relaxed limit, public unit; in a `Design` the check has found the spec met with it.
    """

    requirement: int
    amount: float | None
    new_limit: float | None


@dataclass(frozen=True)
class Price:
    """A multiplier checked by solving again with the limit moved.

    Args:
        limit: the one that was moved, public unit; of a `between` the one with the larger multiplier.
        relaxed: by how much the objective improves for each unit the limit is relaxed; None where no gains were found.
        tightened: by how much it worsens for each unit the limit is tightened; None where it cannot be tightened.
        agrees: whether both equal the multiplier to 1 %, as far as they are known.
    """

    limit: float
    relaxed: float | None
    tightened: float | None
    agrees: bool

    @property
    def has_kink(self) -> bool:
        """Whether the slopes to both sides of the limit differ by more than 2 %."""
        if self.relaxed is None or self.tightened is None:
            return False
        return abs(self.relaxed - self.tightened) > 0.02 * max(abs(self.relaxed), abs(self.tightened))
