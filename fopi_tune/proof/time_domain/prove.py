"""Proof of a time-domain requirement over a family, by branch and bound over its box of uncertain numbers."""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.text_tables.words import counted
from fopi_tune.digital.realise import Precision
from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.box import Box, Interval, centre_of, point_box, split
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.enclosure import Enclosure
from fopi_tune.proof.time_domain.measures import PROVABLE, RATES, MeasureRange, measure_range
from fopi_tune.proof.time_domain.plants.hold import family_problem, holding_problem
from fopi_tune.proof.time_domain.plants.lateness import cut_at_whole_samples
from fopi_tune.proof.time_domain.proof import FREE, LIMITED, Level, TimeDomainProof
from fopi_tune.proof.verdict import RATE_NOT_MODELLED, Verdict
from fopi_tune.spec.measures import ACCELERATION, acceleration_problem, velocity_unit
from fopi_tune.spec.model import Relation

#: default budget, boxes and single plants
BUDGET = 4_000
#: share of the tolerance that is kept for a recheck
_MARGIN = 1e-3
#: in place of an infinite remainder
_LARGE = 1e300
#: samples; with output limits the memory of a box grows with their square
_MOST_SAMPLES, _MOST_LIMITED = 10_000, 2_000


def prove_limit(case: TimeDomainCase, tolerance: float = 1e-6, budget: int = BUDGET) -> TimeDomainProof:
    """Prove or refute a limit on a measure for every plant of the family; noise of the measurement is left out.

    Args:
        case: loop, scenario and limit.
        tolerance: by how much the limit may be missed, relative to it, or to the step for an overshoot.
        budget: most boxes and single plants to examine.

    Returns:
        Undecided with a message where there is no method for the case, or the budget is spent.

    Raises:
        DomainError: a tolerance that is negative or not finite, or a budget below 1.
    """
    if not (0.0 <= tolerance < math.inf and budget >= 1):
        raise DomainError(f"tolerance {tolerance!r} must be finite and >= 0, and the budget {budget!r} at least 1")
    reason = why_no_method(case)
    if reason:
        return TimeDomainProof(Verdict.UNDECIDED, "", tolerance, message=f"no method: {reason}")
    return _Search(case, tolerance, budget).run()


def why_no_method(case: TimeDomainCase) -> str:
    """Why nothing can be proved of a case, whatever its numbers; empty where something may be."""
    measure = case.limit.measure
    if case.controller.limits_rate:
        return RATE_NOT_MODELLED
    if not case.acts_on_error:
        return "a derivative, a setpoint_weight or a measurement_filter is not modelled in this proof"
    if measure not in PROVABLE:
        return f"{measure} has none"
    if measure == ACCELERATION and velocity_unit(case.measurement_unit) is None:
        return acceleration_problem(case.measurement_unit)
    if case.scenario.quantum:
        return "a measurement with a quantum is not continuous in the plant"
    limited = any(map(math.isfinite, case.output_limits))
    most = _MOST_LIMITED if limited else _MOST_SAMPLES
    if case.samples > most:
        return f"{case.samples} samples are more than {most}{' with output limits' if limited else ''}"
    if case.limit.relation not in (Relation.AT_MOST, Relation.AT_LEAST):
        return f"a limit of {measure} that is {case.limit.relation.value} has none"
    if case.family.dead_time.max / case.sample_time_s + case.delay_samples > _MOST_SAMPLES:
        return f"a delay of more than {_MOST_SAMPLES} samples"
    if case.controller.precision is not Precision.FLOAT64:
        return "the filter is not in float64"
    if reason := family_problem(case.family, measure in RATES):
        return reason
    if reason := holding_problem(case.family, case.run.start.output, case.rests):
        return reason
    if measure == "undershoot" and not all(step.direction for step in case.horizon.steps_of(case.run)):
        return "undershoot needs a step of the reference"
    return ""


@dataclass(frozen=True)
class _Examined:
    """A box after a look at it.

    Args:
        box: of plants.
        found: the range of its measure; None where it must be split before there is one.
        axis: along which it is split; -1 for a single plant.
        reason: why there is no range.
    """

    box: Box
    found: MeasureRange | None
    axis: int
    reason: str = ""


class _Search:
    """Branch and bound: the worst box first."""

    def __init__(self, case: TimeDomainCase, tolerance: float, budget: int) -> None:
        self.case, self.tolerance, self.budget = case, tolerance, budget
        self.level = Level.of(case, tolerance, _MARGIN)
        self.enclosure, self.examined, self.method = Enclosure(case), 0, FREE
        self.widths = case.family.high - case.family.low
        self.tested: set[tuple[float, ...]] = set()
        #: boxes without a trajectory
        self.unknown = 0

    def run(self) -> TimeDomainProof:
        """The proof."""
        order = itertools.count()
        waiting: list[tuple[float, int, _Examined]] = []
        leaves: list[_Examined] = []
        case, message = self.case, ""
        pending = cut_at_whole_samples(case.family, case.sample_time_s, case.delays)
        while pending or waiting:
            if not pending:
                worst = heapq.heappop(waiting)[2]
                pieces = split(worst.box, worst.axis) if worst.axis >= 0 else None
                if pieces is None:
                    message = worst.reason or "the limit is met or missed by less than the rounding"
                    message = f"a box cannot be split further: {message}"
                    leaves.append(worst)
                    break
                pending += pieces
            if self.examined >= self.budget:
                reasons = [entry[2].reason for entry in waiting if entry[2].reason]
                spent = f"the budget of {counted(self.budget, 'box', 'boxes')} is spent"
                message = "; of a box ".join([spent, *reasons[:1]])
                break
            examined = self._examine(pending.pop())
            found = examined.found
            if found is not None and self.level.is_met(found):
                leaves.append(examined)
                continue
            if (witness := self._witness(examined)) is not None:
                return witness
            if found is None and (reason := self._hopeless(examined.box)):
                message = f"nothing can be shown of a single plant: {reason}"
                leaves.append(examined)
                break
            excess = math.inf if found is None else self.level.excess(found)
            heapq.heappush(waiting, (-excess, next(order), examined))
        return self._ended([*leaves, *(entry[2] for entry in waiting)], not pending, message)

    def _ended(self, boxes: list[_Examined], whole: bool, message: str) -> TimeDomainProof:
        """What the boxes prove; `whole`: they cover the family."""
        known = [self.level.bound(each.found) for each in boxes if each.found is not None]
        bound = None
        if whole and len(known) == len(boxes) and np.all(np.isfinite(known)):
            bound = max(known) if self.level.upper else min(known)
        proved = Verdict.UNDECIDED if message else Verdict.PROVED
        leaves = () if message else tuple(each.box for each in boxes)
        return TimeDomainProof(
            proved, self.method, self.tolerance, bound, boxes=leaves, message=message, examined=self.examined
        )

    def _hopeless(self, box: Box) -> str:
        """Why not even the centre of a box has a trajectory, so that no box with it has one; empty if it has one.

        Asked of a few boxes only: of the first, second, fourth, eighth without a trajectory and so on.
        """
        self.unknown += 1
        if self.unknown & (self.unknown - 1) or self.examined >= self.budget:
            return ""
        alone = self._examine(point_box(centre_of(box)))
        return alone.reason if alone.found is None else ""

    def _examine(self, box: Box) -> _Examined:
        self.examined += 1
        radii = np.array([0.5 * (high - low) for low, high in box])
        shares = np.divide(radii, self.widths, out=np.zeros_like(radii), where=self.widths > 0.0)
        widest = int(np.argmax(shares)) if len(radii) and radii.max() > 0.0 else -1
        with np.errstate(all="ignore"):
            found = self.enclosure.trajectory(box)
            if found is None:
                return _Examined(box, None, widest, self.enclosure.reason)
            self.method = LIMITED if found.limited else self.method
            measured = measure_range(self.case, found)
            if not len(measured.slopes) or widest < 0:
                return _Examined(box, measured, widest)
            # what the slopes lead to is split as well as what is beyond them
            bent = found.shares.mean(axis=1) if measured.sample is None else found.shares[:, measured.sample]
            scores = np.abs(measured.slopes) * radii + min(measured.bent, _LARGE) * bent
        usable = np.all(np.isfinite(scores)) and scores.max() > 0.0
        axis = int(np.argmax(np.where(radii > 0.0, scores, -1.0))) if usable else widest
        return _Examined(box, measured, axis)

    def _witness(self, examined: _Examined) -> TimeDomainProof | None:
        """A plant of a box that surely misses the limit: its centre, or the corner to which the slopes point."""
        found, centre = examined.found, centre_of(examined.box)
        if found is None or (self.level.upper and not found.linear > self.level.beyond):
            return None
        points = [centre]
        if len(found.slopes):
            toward = found.slopes if self.level.upper else -found.slopes
            points.append(tuple(map(_end, examined.box, toward.tolist(), centre)))
        for point in points:
            if point in self.tested or self.examined >= self.budget:
                continue
            self.tested.add(point)
            there = self._examine(point_box(point)).found
            if there is not None and self.level.is_missed(there):
                return TimeDomainProof(
                    Verdict.REFUTED,
                    self.method,
                    self.tolerance,
                    theta=point,
                    time_s=None if there.sample is None else there.sample * self.case.sample_time_s,
                    value=self.level.witness(there),
                    examined=self.examined,
                )
        return None


def _end(interval: Interval, slope: float, centre: float) -> float:
    """The end to which a slope leads."""
    if slope == 0.0:
        return centre
    return interval[1] if slope > 0.0 else interval[0]
