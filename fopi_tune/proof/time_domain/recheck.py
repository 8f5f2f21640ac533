"""The check of a proof without a search:  every box of it again, whether they cover the family, and the witness."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fopi_tune.proof.balls.box import Box, point_box, with_interval
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.enclosure import Enclosure
from fopi_tune.proof.time_domain.measures import MeasureRange, measure_range
from fopi_tune.proof.time_domain.plants.lateness import cut_at_whole_samples
from fopi_tune.proof.time_domain.proof import Level, TimeDomainProof
from fopi_tune.proof.time_domain.prove import why_no_method
from fopi_tune.proof.verdict import LARGEST_TOLERANCE, Verdict

#: relative; by how much a stated number may differ from the one found again, which another machine rounds otherwise
_ROUNDING = 1e-9


def recheck_limit(case: TimeDomainCase, proof: TimeDomainProof) -> tuple[str, ...]:
    """Test what a proof says of a case.

    Args:
        case: rebuilt from the spec and the filter.
        proof: as it was read.

    Returns:
        Every problem; empty where all of the proof holds.  A proof that decided nothing has nothing to test.
    """
    if proof.verdict is Verdict.UNDECIDED:
        return ()
    if not 0.0 <= proof.tolerance <= LARGEST_TOLERANCE:
        return (f"the tolerance {proof.tolerance!r} is not between 0 and {LARGEST_TOLERANCE}",)
    if reason := why_no_method(case):
        return (f"nothing can be proved: {reason}",)
    level = Level.of(case, proof.tolerance)
    if proof.verdict is Verdict.REFUTED:
        return _witness_problems(case, proof, level)
    return _cover_problems(case, proof, level)


def _range(case: TimeDomainCase, enclosure: Enclosure, box: Box) -> MeasureRange | None:
    found = enclosure.trajectory(box)
    return None if found is None else measure_range(case, found)


def _witness_problems(case: TimeDomainCase, proof: TimeDomainProof, level: Level) -> tuple[str, ...]:
    if proof.theta is None or proof.value is None or len(proof.theta) != len(case.family.low):
        return ("there is no plant that refutes it",)
    for name, value in zip(case.family.uncertain_names, proof.theta, strict=True):
        number = case.family.parameters[name]
        if not number.min <= value <= number.max:
            return (f"the plant that refutes it is none of the family: {name} = {value!r}",)
    found = _range(case, Enclosure(case), point_box(proof.theta))
    if found is None or not level.is_missed(found):
        return ("the plant that is said to refute it does not surely miss the limit",)
    reached = level.witness(found)
    if (proof.value - reached) * (1.0 if level.upper else -1.0) > _ROUNDING * max(abs(reached), abs(proof.value)):
        return (f"the measure of the plant that refutes it is {reached!r}, not {proof.value!r}",)
    if not (proof.value - case.limit.limit) * (1.0 if level.upper else -1.0) > 0.0:
        return (f"the measure of the plant that refutes it, {proof.value!r}, does not miss the limit",)
    time_s = None if found.sample is None else found.sample * case.sample_time_s
    if proof.time_s != time_s:
        return (f"the plant that refutes it does so at {time_s!r} s, not at {proof.time_s!r} s",)
    return ()


def _cover_problems(case: TimeDomainCase, proof: TimeDomainProof, level: Level) -> tuple[str, ...]:
    problems = []
    axes = len(case.family.low)
    if proof.bound is None or not math.isfinite(proof.bound):
        problems.append("there is no bound")
    elif (proof.bound * level.per_unit - level.within) * (1.0 if level.upper else -1.0) > _ROUNDING * abs(level.within):
        problems.append(f"the bound {proof.bound!r} does not meet the limit")
    if any(len(box) != axes or not all(low <= high for low, high in box) for box in proof.boxes):
        return (*problems, f"a box is none of {axes} uncertain numbers")
    for whole in cut_at_whole_samples(case.family, case.sample_time_s, case.delays):
        if (gap := uncovered(whole, proof.boxes)) is not None:
            problems.append(f"no box holds the plant {gap}")
    enclosure = Enclosure(case)
    for number, box in enumerate(proof.boxes):
        found = _range(case, enclosure, box)
        if found is None or not level.is_met(found):
            problems.append(f"box {number} is not shown to meet the limit")
        elif proof.bound is not None:
            reached, sign = level.bound(found), 1.0 if level.upper else -1.0
            if (reached - proof.bound) * sign > _ROUNDING * max(abs(reached), abs(proof.bound)):
                problems.append(f"the measure is shown to be within {reached!r} in box {number}, not {proof.bound!r}")
    return tuple(problems)


def uncovered(whole: Box, boxes: Sequence[Box]) -> tuple[float, ...] | None:
    """A point that no box holds; None where they cover the whole one.  Ends of boxes are compared exactly."""
    pending = [(whole, list(boxes))]
    while pending:
        box, near = pending.pop()
        near = [other for other in near if _overlap(box, other)]
        if any(all(a <= low and high <= b for (low, high), (a, b) in zip(box, other, strict=True)) for other in near):
            continue
        cut = _cut(box, near)
        if cut is None:
            return tuple(low + 0.5 * (high - low) for low, high in box)
        axis, end = cut
        low, high = box[axis]
        pending += [(with_interval(box, axis, (low, end)), near), (with_interval(box, axis, (end, high)), near)]
    return None


def _overlap(box: Box, other: Box) -> bool:
    """Whether they share a point, and more than their faces along an axis along which both have a width."""
    return all(
        a < high and low < b if low < high and a < b else a <= high and low <= b
        for (low, high), (a, b) in zip(box, other, strict=True)
    )


def _cut(box: Box, near: Sequence[Box]) -> tuple[int, float] | None:
    """An end of a box inside another one, next to its middle; None where there is none."""
    best, found = math.inf, None
    for axis, (low, high) in enumerate(box):
        for other in near:
            for end in other[axis]:
                if low < end < high and (off := abs(end - 0.5 * (low + high)) / (high - low)) < best:
                    best, found = off, (axis, end)
    return found
