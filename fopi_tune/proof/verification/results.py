"""Results of a verification, as frozen data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import Margins
from fopi_tune.spec.model import Limit, Relation, Requirement


class Outcome(StrEnum):
    """Outcome of a requirement."""

    MET = "met"
    VIOLATED = "violated"
    #: the loop never crosses |L| = 1, so that the quantity does not exist; never met
    NO_CROSSOVER = "no_crossover"
    #: a margin of a loop that is not stable, so that it has none; never met
    UNSTABLE = "unstable"
    #: a margin that does not end: more than any at_least, and never equal to or below anything
    INFINITE = "infinite"
    #: a band of frequencies above Nyquist's, where a loop on samples has no response; never met
    BEYOND_NYQUIST = "beyond_nyquist"
    #: a margin of a loop of which a measured response does not tell whether it is stable
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Place:
    """Where something is worst.

    Args:
        omega_rad_s: the frequency; 0 and inf are limits, None when no frequency decides.
        plant: the member's uncertain numbers by name; empty when the plant is known.
        point: the same as a place of the family's box; in a list of plants behind the member's index.
        member: its name in a list of plants; empty without one.
    """

    omega_rad_s: float | None
    plant: Mapping[str, float]
    point: tuple[float, ...]
    member: str = ""


@dataclass(frozen=True)
class Extreme:
    """One end of a quantity's range over a scope and band.

    Args:
        largest: the largest value, else the smallest.
        achieved: in the quantity's public unit; None where a member has none: no gain crossover, or, of a margin, an
            unstable loop.
        worst: where.
    """

    largest: bool
    achieved: float | None
    worst: Place


@dataclass(frozen=True)
class RequirementResult:
    """Result of one requirement over its whole scope and band.

    Args:
        requirement: what the spec says.
        achieved: the worst value, in the quantity's public unit; inf for a margin that does not end; None where a
            member has none: no gain crossover, or of a margin, unstable.
        outcome: whether it is met, and why not.
        slack: how far inside the limit, negative outside, in neper or radian (for a delay margin: relative to the
            limit); for `equals` minus the distance; None where `achieved` is.
        score: dimensionless, at most 1 exactly when the requirement holds within the tolerance; None where `achieved`
            is.
        worst: the member and the frequency that decide.
        extremes: the ends that the requirement limits, smallest first.
    """

    requirement: Requirement
    achieved: float | None
    outcome: Outcome
    slack: float | None
    score: float | None
    worst: Place
    extremes: tuple[Extreme, ...] = ()

    @property
    def is_met(self) -> bool:
        """Whether the requirement holds within the tolerance."""
        endless = self.outcome is Outcome.INFINITE and self.requirement.relation is Relation.AT_LEAST
        return self.outcome is Outcome.MET or endless


@dataclass(frozen=True)
class MeasureResult:
    """Result of one requirement on a measure of scenarios, over the family, by simulation.

    Args:
        requirement: what the spec says.
        scenario: name of the one in which it is worst.
        achieved: the worst value, in the measure's unit; inf where an output does not stay finite or settle.
        score: dimensionless, at most 1 where the limit is met.
        worst: the plant that decides.
        time_s: when, s; None of a measure that no single sample decides.
        is_met: whether the limit holds within the tolerance.
        plants: how many were simulated.
    """

    requirement: Limit
    scenario: str
    achieved: float
    score: float
    worst: Place
    time_s: float | None
    is_met: bool
    plants: int


@dataclass(frozen=True)
class Stability:
    """Closed-loop stability of the whole family.

    Args:
        stable: every member is stable.
        peak_sensitivity_db: largest |S| over all members and frequencies; of the failing member alone when not stable.
        worst: where the loop comes closest to -1; a failing member when not stable.
        unstable_poles: closed-loop poles in the right half-plane of that member; None when they cannot be counted: on
            the axis, or infinitely many.
        reason: one sentence.
        undecided: whether a measured response leaves open whether the loop is stable; `stable` is then False.
    """

    stable: bool
    peak_sensitivity_db: float
    worst: Place
    unstable_poles: int | None
    reason: str
    undecided: bool = False


@dataclass(frozen=True)
class Verification:
    """Result of verifying gains against a spec.

    Args:
        gains: the controller.
        stability: of the whole family.
        requirements: in the order of the spec.
        objective: value of the spec's objective; without one the smallest slack of the inequalities, or -ln of the
            largest |S| when there are none.  None where a member without a crossover or a margin leaves it undefined.
        objective_worst: the member and frequency that decide the objective; None when none does.
        nominal: margins with the nominal plant.
        tolerance: allowed violation of a requirement, natural units.
        measures: the requirements on measures of scenarios, in the order of the spec.
        members: of a list of plants, the verification of each alone.
    """

    gains: FoPi
    stability: Stability
    requirements: tuple[RequirementResult, ...]
    objective: float | None
    objective_worst: Place | None
    nominal: Margins
    tolerance: float
    measures: tuple[MeasureResult, ...] = ()
    members: tuple[Verification, ...] = ()

    @property
    def all_met(self) -> bool:
        """The whole family is stable and every requirement holds."""
        return self.stability.stable and all(result.is_met for result in (*self.requirements, *self.measures))
