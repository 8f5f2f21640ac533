"""Proof of a time-domain requirement over a family, by branch and bound over its box of uncertain numbers."""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.box import Box, centre_of, point_box, split
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.enclosure import Enclosure
from fopi_tune.proof.time_domain.measures import PROVABLE, RATES, MeasureRange, measure_range
from fopi_tune.proof.time_domain.plants.hold import holding_problem, order_of
from fopi_tune.proof.time_domain.plants.lateness import cut_at_whole_samples
from fopi_tune.proof.time_domain.proof import FREE, LIMITED, Level, TimeDomainProof
from fopi_tune.spec.measures import ACCELERATION, acceleration_problem, velocity_unit

#: default budget, boxes and single plants
BUDGET = 10_000
#: share of the tolerance that is kept for a recheck
_MARGIN = 1e-3
#: samples; the memory of a box grows with their square
_MOST_SAMPLES = 2_000


def prove_limit(case: TimeDomainCase, tolerance: float = 1e-6, budget: int = BUDGET) -> TimeDomainProof:
    """Prove or refute a limit on a measure for every plant of the family.

    Args:
        case: loop, scenario and limit.
        tolerance: by how much the limit may be missed, relative to it, or to the step for an overshoot.
        budget: most boxes and single plants to examine.

    Returns:
        Undecided with a message where there is no method for the case, or the budget is spent.
    """
    if not (0.0 <= tolerance < math.inf and budget >= 1):
        raise DomainError(f"tolerance {tolerance!r} must be finite and >= 0, and the budget {budget!r} at least 1")
    reason = why_no_method(case)
    if reason:
        return TimeDomainProof(Verdict.UNDECIDED, "", tolerance, message=f"no method: {reason}")
    return _Search(case, Level.of(case, tolerance, _MARGIN), budget).run(tolerance)


def why_no_method(case: TimeDomainCase) -> str:
    """Why nothing can be proved of a case, whatever its numbers; empty where something may be."""
    measure, order = case.limit.measure, order_of(case.family)
    if measure not in PROVABLE:
        return f"of {measure}"
    if measure == ACCELERATION and velocity_unit(case.measurement_unit) is None:
        return acceleration_problem(case.measurement_unit)
    if case.scenario.quantum:
        return "a measurement with a quantum is not continuous in the plant"
    if case.scenario.noise_std:
        return "the measurement has noise"
    if case.samples > _MOST_SAMPLES:
        return f"{case.samples} samples are more than {_MOST_SAMPLES}"
    if order is None:
        return "plants of the family differ in their order, or have a direct path"
    if order != 1 and measure in RATES:
        return f"rates of plants of order {order}; only those of first order are largest at the samples"
    if reason := holding_problem(case.family, case.run.start.output, case.rests):
        return reason
    if measure == "undershoot" and not all(step.direction for step in case.horizon.steps_of(case.run)):
        return "undershoot needs a step of the reference"
    return ""


@dataclass(frozen=True)
class _Examined:
    """A box with the range of its measure; None where the box must be split before there is one."""

    box: Box
    found: MeasureRange | None
    axis: int
    limited: bool = False


class _Search:
    """Branch and bound: the worst box first."""

    def __init__(self, case: TimeDomainCase, level: Level, budget: int) -> None:
        self.case, self.level, self.budget = case, level, budget
        self.enclosure, self.examined, self.limited = Enclosure(case), 0, False
        family = case.family
        self.widths = family.high - family.low
        self.tested: set[tuple[float, ...]] = set()

    def run(self, tolerance: float) -> TimeDomainProof:
        """The proof."""
        order, heap, leaves, worst = itertools.count(), [], [], None
        for box in cut_at_whole_samples(self.case.family, self.case.sample_time_s, self.case.delays):
            heapq.heappush(heap, (-math.inf, next(order), _Examined(box, None, 0)))
        pending = [entry[2].box for entry in heap]
        heap.clear()
        message = ""
        while pending or heap:
            if not pending:
                examined = heapq.heappop(heap)[2]
                pieces = split(examined.box, examined.axis)
                if pieces is None:
                    message = f"a box cannot be split further: {self.enclosure.reason or 'the limit is met exactly'}"
                    heapq.heappush(heap, (-math.inf, next(order), examined))
                    break
                pending += pieces
            if self.examined >= self.budget:
                message = f"the budget of {self.budget} boxes is spent"
                if any(entry[2].found is None for entry in heap):
                    message += f"; {self.enclosure.reason}"
                break
            examined = self._examine(pending.pop())
            found = examined.found
            if found is not None and self.level.is_met(found):
                leaves.append(examined)
                continue
            witness = self._witness(examined)
            if witness is not None:
                return replace(witness, tolerance=tolerance, examined=self.examined)
            if not examined.box or examined.axis < 0:
                message = "the limit is met or missed by less than the rounding"
                heapq.heappush(heap, (0.0, next(order), examined))
                break
            priority = -math.inf if found is None else -self.level.excess(found)
            heapq.heappush(heap, (priority, next(order), examined))
        return self._ended(leaves, [entry[2] for entry in heap], bool(pending), message, tolerance)

    def _ended(
        self, leaves: list[_Examined], others: list[_Examined], unknown: bool, message: str, tolerance: float
    ) -> TimeDomainProof:
        every = [*leaves, *others]
        bounds = [self.level.bound(each.found) for each in every if each.found is not None]
        bound = None
        if not unknown and len(bounds) == len(every) and np.all(np.isfinite(bounds)):
            bound = max(bounds) if self.level.upper else min(bounds)
        boxes = () if others or unknown else tuple(each.box for each in leaves)
        verdict = Verdict.PROVED if boxes else Verdict.UNDECIDED
        method = LIMITED if self.limited else FREE
        return TimeDomainProof(
            verdict, method, tolerance, bound, boxes=boxes, message=message, examined=self.examined
        )

    def _examine(self, box: Box) -> _Examined:
        self.examined += 1
        found = self.enclosure.trajectory(box)
        radii = np.array([0.5 * (high - low) for low, high in box])
        shares = np.divide(radii, self.widths, out=np.zeros_like(radii), where=self.widths > 0.0)
        widest = int(np.argmax(shares)) if len(radii) and radii.max() > 0.0 else -1
        if found is None:
            return _Examined(box, None, widest)
        self.limited |= found.limited
        measured = measure_range(self.case, found)
        if not len(measured.slopes) or widest < 0:
            return _Examined(box, measured, widest)
        shares_bent = found.shares[:, measured.sample] if measured.sample is not None else found.shares.mean(axis=1)
        scores = np.abs(measured.slopes) * radii + min(measured.bent, 1e300) * shares_bent
        axis = int(np.argmax(scores)) if np.all(np.isfinite(scores)) and scores.max() > 0.0 else widest
        return _Examined(box, measured, axis)

    def _witness(self, examined: _Examined) -> TimeDomainProof | None:
        """A plant of a box that surely misses the limit: its centre, or the corner to which the slopes point."""
        found, centre = examined.found, centre_of(examined.box)
        if found is None:
            return None
        points = [centre]
        if len(found.slopes):
            toward = found.slopes if self.level.upper else -found.slopes
            points.append(
                tuple(high if s > 0.0 else low if s < 0.0 else c
                      for (low, high), s, c in zip(examined.box, toward, centre, strict=True))
            )  # fmt: skip
        for point in points:
            if point in self.tested or self.examined >= self.budget:
                continue
            self.tested.add(point)
            at_point = self._examine(point_box(point)).found
            if at_point is not None and self.level.is_missed(at_point):
                time_s = None if at_point.sample is None else at_point.sample * self.case.sample_time_s
                method = LIMITED if self.limited else FREE
                return TimeDomainProof(
                    Verdict.REFUTED, method, 0.0, None, point, time_s, self.level.witness(at_point)
                )  # fmt: skip
        return None
