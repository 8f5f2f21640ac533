"""What every search for gains returns, and what the checks add to it.  Importing it loads no solver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.results.status import Relaxation, Status

if TYPE_CHECKING:
    from fopi_tune.montecarlo.statistics import Fraction
    from fopi_tune.proof import Certificate, Verification


class Solver(StrEnum):
    """Which search finds the gains; the value is the word after `--solver`."""

    #: all three gains at once by nonlinear programming
    IPOPT = "ipopt"
    #: convex problems in kp and ki, and a search over alpha: a second opinion that shares no code with the first
    CONVEX = "convex"


@dataclass(frozen=True)
class Candidate:
    """A search's answer, before it is checked.

    Args:
        status: SOLVED only means that the search converged.
        gains: the best found; None when there is nothing to show.
        multipliers: one for each requirement: by how much the objective (public unit) would improve if the limit were
            relaxed by one public unit; None where it is not known.
        clash: the smallest set of requirements found that cannot hold together, with estimated relaxations.
        message: why, in words.
        solves: runs of the solver.
        rounds: exchange rounds of the winning start.
        cuts: plants and frequencies in the last problem.
        gap: no gains of the box beat the objective by more than this part (of peaks, spreads and depths below 0.1 neper
            or radian: of that), by branch and bound in floating point; None where that was not shown.
        scenario_multipliers: of each requirement on a scenario, as `multipliers`.
        objective: in its public unit, as the search sees it; without one the smallest slack; None where not known.
    """

    status: Status
    gains: FoPi | None
    multipliers: tuple[float | None, ...]
    clash: tuple[Relaxation, ...] = ()
    message: str = ""
    solves: int = 0
    rounds: int = 0
    cuts: int = 0
    gap: float | None = None
    scenario_multipliers: tuple[float | None, ...] = ()
    objective: float | None = None


@dataclass(frozen=True)
class Violation:
    """A plant and frequency at which a check refuted an earlier candidate: a cut for the next design.

    Args:
        requirement: index in the spec's list of requirements, or of those of scenarios; None for stability.
        theta: the plant's point in the box of uncertain numbers, shape (p,).
        omega_rad_s: the frequency; 0 and inf are limits, nan where no single one decides.
        scenario: where it was refuted; None for the loop's frequency response.
    """

    requirement: int | None
    theta: tuple[float, ...]
    omega_rad_s: float
    scenario: str | None = None


@dataclass(frozen=True)
class CheckedCandidate:
    """A candidate with its verification and its certificate.

    Args:
        candidate: the search's answer.
        verification: of its gains in floating point; None where there are none, or kp = ki = 0.
        certificate: None without a verification that is met, and where no proof was wanted.
        drawn: of each requirement on a scenario, how many drawn plants meet it; none where no plants were drawn.
    """

    candidate: Candidate
    verification: Verification | None = None
    certificate: Certificate | None = None
    drawn: tuple[Fraction, ...] = ()
