"""What the design stage hands on."""

from __future__ import annotations

from dataclasses import dataclass

from fopi_tune.core.controller import FoPi
from fopi_tune.outcome import Give, Status


@dataclass(frozen=True)
class Candidate:
    """The design stage's answer, before anything is confirmed.

    Args:
        status: SOLVED here only means that the search ended well.
        gains: the best found; None when there is nothing to show.
        multipliers: a number a requirement: how much the objective (public unit) would gain if the limit were
            relaxed by one public unit; None where it is not known.
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


__all__ = ["Candidate", "Give", "Status"]
