"""What a search for gains hands on, whichever it is.  Importing it loads no solver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.results.status import Give, Status

if TYPE_CHECKING:
    from fopi_tune.proof import Certificate, Verification


class Solver(StrEnum):
    """Which search finds the gains; the value is the word after `--solver`."""

    #: all three gains at once by nonlinear programming
    IPOPT = "ipopt"
    #: convex problems in kp and ki, and a search over alpha: a second opinion that shares no code with the first
    CONVEX = "convex"


@dataclass(frozen=True)
class Candidate:
    """A search's answer, before anything is confirmed.

    Args:
        status: SOLVED here only means that the search ended well.
        gains: the best found; None when there is nothing to show.
        multipliers: a number a requirement: how much the objective (public unit) would gain if the limit were
            relaxed by one public unit; None where it is not known.
        clash: the smallest set of requirements found that cannot hold together.
        message: why, in words.
        solves: runs of the solver.
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


@dataclass(frozen=True)
class Violation:
    """A plant and frequency at which a check refuted an earlier candidate: a cut for the next design.

    Args:
        requirement: index in the spec's list.
        theta: the plant's place in the box, shape (p,).
        omega_rad_s: the frequency; nan where none decides.
    """

    requirement: int
    theta: tuple[float, ...]
    omega_rad_s: float


@dataclass(frozen=True)
class Attempt:
    """A candidate and what was found out about it.

    Args:
        candidate: a search's answer.
        found: what the verification says of its gains; None where there are none, or kp = ki = 0.
        certificate: what is proved of them; None where nothing was to be proved.
    """

    candidate: Candidate
    found: Verification | None = None
    certificate: Certificate | None = None
