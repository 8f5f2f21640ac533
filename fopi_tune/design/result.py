"""What the design stage hands on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.core.controller import FoPi


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
class Give:
    """By how much one of the clashing requirements would have to give for all the others to hold.

    Args:
        requirement: index in the spec's list.
        amount: in the quantity's public unit, > 0; None when no amount alone is enough, or none was found.
        new_limit: the limit that would be met, public unit.
    """

    requirement: int
    amount: float | None
    new_limit: float | None


@dataclass(frozen=True)
class Candidate:
    """The design stage's answer, before anything is confirmed.

    Args:
        status: SOLVED here only means that the search ended well.
        gains: the best found; None when there is nothing to show.
        multipliers: a number a requirement: how much the objective (public unit) would gain if the limit were
        relaxed by
            one public unit; None where it is not known.
        clash: the smallest set of requirements found that cannot hold together.
        message: why, in words.
        solves: Ipopt runs.
        rounds: exchange rounds of the winning start.
        cuts: plants and points in play at the end.
    """

    status: Status
    gains: FoPi | None
    multipliers: tuple[float | None, ...]
    clash: tuple[Give, ...] = ()
    message: str = ""
    solves: int = 0
    rounds: int = 0
    cuts: int = 0
