"""Results about the best possible gains, as frozen data."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.core.controller import FoPi
from fopi_tune.core.text_tables.words import counted
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.tree import Cover
from fopi_tune.quantities.objectives import ObjectiveKind

#: an objective in dB, degrees or neper that is smaller than this counts as this in a relative gap
SMALLEST_OBJECTIVE = 1e-6
#: of those whose scale is the plant's a gap is relative, however small they are
_SCALED = (ObjectiveKind.KI, ObjectiveKind.IAE_DISTURBANCE)


class OptimumStatus(StrEnum):
    """Outcome of the search; `advice` says what it means."""

    CERTIFIED = "certified"
    INFEASIBLE = "infeasible"
    LIMIT_REACHED = "limit_reached"
    NO_BOUND = "no_bound"

    @property
    def advice(self) -> str:
        """One sentence."""
        return {
            OptimumStatus.CERTIFIED: "No gains in the box that meet every requirement are better by more than the gap.",
            OptimumStatus.INFEASIBLE: "No gains in the box meet every requirement: that is proved.",
            OptimumStatus.LIMIT_REACHED: "The gap that was asked for was not reached; what was proved is stated.",
            OptimumStatus.NO_BOUND: "Nothing is proved of the best gains; the reason says why.",
        }[self]


@dataclass(frozen=True)
class OptimumProof:
    """Boxes that together contain all gains, each with the reason why it contains no better ones.

    Args:
        beat: the proved bound of the objective, in its public unit; None when no gains meet the requirements at all.
        reference_rad_s: at which the boxes give the integral's gain; None where they are not of gains.
        covers: trees of boxes.
        reasons: to which the leaves refer by index.
    """

    beat: float | None
    reference_rad_s: float | None
    covers: tuple[Cover, ...]
    reasons: tuple[Reason, ...]

    @property
    def leaves(self) -> int:
        """Boxes that were discarded."""
        return sum(cover.leaves for cover in self.covers)


@dataclass(frozen=True, repr=False)
class Optimum:
    """Optimality gap of given gains, or infeasibility of the spec.

    Args:
        name: of the spec.
        spec_sha256: of its file.
        status: how it ended.
        gains: the incumbent; None without one.
        objective: its objective, in the public unit, as the verification found it.
        bound: no gains in the box that meet every requirement exactly have a better objective, in its public unit; None
            when not shown.
        gap: |objective - bound| relative to the objective; None when there is no bound.
        wanted_gap: the requested gap, relative.
        better: gains that meet the spec and have a better objective, checked in floating point; None when none were
            found.
        better_objective: their objective, in the public unit.
        boxes: number of examined boxes.
        seconds: run time, s.
        proof: of the bound or of infeasibility; None without one.
        left_out: requirements that were not used: the bound is valid but could be tighter.
        reason: why there is no bound, or what stopped the search; empty otherwise.
    """

    name: str
    spec_sha256: str
    status: OptimumStatus
    gains: FoPi | None
    objective: float | None
    bound: float | None
    gap: float | None
    wanted_gap: float
    better: FoPi | None
    better_objective: float | None
    boxes: int
    seconds: float
    proof: OptimumProof | None
    left_out: tuple[str, ...]
    reason: str

    def __repr__(self) -> str:
        return f"<Optimum of {self.name}: {self.status.value}, {counted(self.boxes, 'box', 'boxes')}. {self.statement}>"

    @property
    def statement(self) -> str:
        """What is proved, in one or two sentences."""
        if self.status is OptimumStatus.INFEASIBLE:
            return "No gains in the box meet every requirement."
        if self.bound is None or self.objective is None or self.gap is None:
            return f"Nothing is proved of the best gains: {self.reason}."
        return (
            "No gains in the box that meet every requirement (exactly) have an objective better than "
            f"{self.bound:.8g}; the design's is {self.objective:.8g}, a gap of {100.0 * self.gap:.3g} %."
        )


def objective_size(kind: ObjectiveKind, objective: float) -> float:
    """What a gap is relative to: the objective, in its public unit."""
    return max(abs(objective), sys.float_info.min if kind in _SCALED else SMALLEST_OBJECTIVE)


def relative_gap(kind: ObjectiveKind, objective: float, bound: float) -> float:
    """|objective - bound| relative to the objective."""
    return abs(objective - bound) / objective_size(kind, objective)
