"""Bounds of a measure over a box of plants:  trajectory -> the measure's range.

The definitions are those of `simulation.scenario.Measures`.  Most measures are the largest of many numbers, one or two
a sample: over a box the measure is not above the largest of their upper bounds and not below the largest of their lower
ones.  A settling time grows with every sample outside the band: it is that of the samples which may be outside at most,
and that of those which are surely outside at least.

dy/dt of a stable plant of first order decays between two arrivals of an input, so that the largest rates are those just
before and after the samples, and just after an input arrives between samples: what is proved of these holds at all
times.  That of an unstable one grows, which is the same where inputs arrive at samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.models import Model, delayed
from fopi_tune.proof.time_domain.solution import Trajectory
from fopi_tune.spec.measures import ACCELERATION, JERK

#: measures that can be proved; `undershoot` is the largest distance to which a step first goes the wrong way
RATES = (ACCELERATION, "peak_rate_per_s")
PROVABLE = (*RATES, JERK, "overshoot", "undershoot", "peak_control", "final_error", "settling_time_s", "iae", "ise")
#: relative; above the rounding of a sum of two numbers
_ROUNDING = 2.0**-50


@dataclass(frozen=True, eq=False)
class MeasureRange:
    """A measure over a box, in the output's unit.

    Args:
        low: not above it for any plant.
        high: not below it for any plant.
        sample: the sample that makes `high`; None for a sum over all.
        slopes: of what makes it along each axis, with the sign that makes it large, shape (p,).
        bent: how far its terms beyond first order lead.
        linear: its value with its terms of first order alone at the corner to which they point.
    """

    low: float
    high: float
    sample: int | None
    slopes: Array
    bent: float
    linear: float


def measure_range(case: TimeDomainCase, found: Trajectory) -> MeasureRange:
    """The measure of the case's limit; which must be one of `PROVABLE`."""
    measure = case.limit.measure
    if measure in RATES:
        return _largest_size(_rates(case, found))
    if measure == JERK:
        return _largest_size(_second_differences(case, found))
    if measure in ("overshoot", "undershoot"):
        return _at_least_0(measure, _largest(_beyond_steps(case, found)))
    if measure == "peak_control":
        return _peak_control(case, found)
    if measure == "final_error":
        ends = np.array(_final_samples(case))
        return _largest_size([_Part(_error(case, found), ends, ends)])
    if measure == "settling_time_s":
        return _settling(case, found)
    error = _error(case, found)[case.horizon.first :]
    total = (_sizes(error) if measure == "iae" else error * error).total().times(np.array([case.sample_time_s]))
    whole = np.array([0])
    return _largest([_Part(total, whole, whole)], of_sample=False)


@dataclass(frozen=True, eq=False)
class _Part:
    """Numbers of a measure, one a sample.

    Args:
        model: of K numbers.
        surely: places in it that count for every plant.
        perhaps: those that count for some.
    """

    model: Model
    surely: NDArray[np.int_]
    perhaps: NDArray[np.int_]


def _largest_size(parts: Sequence[_Part]) -> MeasureRange:
    """Of the largest |number|."""
    both = [
        part for each in parts for part in (each, _Part(each.model.times(np.array([-1.0])), each.surely, each.perhaps))
    ]
    return _largest(both)


def _largest(parts: Sequence[_Part], of_sample: bool = True) -> MeasureRange:
    """Of the largest number."""
    low, high, worst = -math.inf, -math.inf, None
    for part in parts:
        if len(part.surely):
            low = max(low, float(part.model.low[part.surely].max()))
        if len(part.perhaps):
            values = part.model.high[part.perhaps]
            place = int(np.argmax(np.where(np.isnan(values), np.inf, values)))
            if worst is None or not values[place] <= high:
                high, worst = float(values[place]), (part.model, int(part.perhaps[place]))
    if worst is None or math.isnan(high):
        return MeasureRange(-math.inf, math.inf, None, np.zeros(0), math.inf, -math.inf)
    model, k = worst
    bent = float(model.quadratic[k] + model.rest[k])
    linear = float(model.values[k] + model.linear[k])
    return MeasureRange(low, high, k if of_sample else None, model.slopes[:, k], bent, linear)


def _samples(first: int, end: int) -> NDArray[np.int_]:
    return np.arange(first, max(end, first))


def _rates(case: TimeDomainCase, found: Trajectory) -> list[_Part]:
    """dy/dt just before the samples, and just after inputs arrive."""
    plants, first, count = found.plants, case.horizon.first, case.samples
    if plants.pole is None or plants.gain is None:
        # `prove.why_no_method` refuses plants of higher order
        return []
    late, load_late = plants.delay
    control = delayed(found.applied, late)
    load = Model.constant(np.zeros(count) if case.load is None else case.load, plants.radii)
    load = delayed(load, load_late)
    own = plants.pole * found.output
    inputs = control + load
    before = plants.gain * delayed(inputs, 1) - own
    counted = _samples(first, count)
    parts = [_Part(before, counted, counted)]
    if not plants.arrivals:
        after = _samples(first, count - 1)
        return [*parts, _Part(plants.gain * inputs - own, after, after)]
    for arrival in plants.arrivals:
        rate = arrival.state * found.output + arrival.control * control + arrival.control_before * delayed(control, 1)
        if case.load is not None:
            rate = rate + arrival.load * load + arrival.load_before * delayed(load, 1)
        # an arrival at the very end of a sample may count for the next one
        perhaps = _samples(max(first - int(arrival.may_end), 0), count - 1)
        parts.append(_Part(rate, _samples(first, count - 1 - int(arrival.may_end)), perhaps))
    return parts


def _second_differences(case: TimeDomainCase, found: Trajectory) -> list[_Part]:
    """(y_k - 2 y_(k-1) + y_(k-2))/Ts^2, which an offset of the output is not part of; none of fewer than 3 samples."""
    change = found.output - delayed(found.output, 1)
    # the rounding of the factor is within that of `times`
    second = (change - delayed(change, 1)).times(np.array([case.sample_time_s**-2]))
    counted = _samples(case.horizon.first + 2, case.samples)
    return [_Part(second, counted, counted)]


def _at_least_0(measure: str, found: MeasureRange) -> MeasureRange:
    """The range; an output that never goes back has no undershoot, not one below 0."""
    if measure != "undershoot":
        return found
    return replace(found, low=max(found.low, 0.0), high=max(found.high, 0.0), linear=max(found.linear, 0.0))


def _shifted(model: Model, sign: float, by: float, offset: float) -> Model:
    """sign (offset + f - by)."""
    found = model + Model.constant(np.array([offset]), model.radii) - Model.constant(np.array([by]), model.radii)
    return found if sign > 0 else found.times(np.array([-1.0]))


def _beyond_steps(case: TimeDomainCase, found: Trajectory) -> list[_Part]:
    """y - value in the direction of each step, or what it is before the step in the other direction."""
    steps, parts = case.horizon.steps_of(case.run), []
    over = case.limit.measure == "overshoot"
    for step, end in zip(steps, [*(step.first for step in steps[1:]), case.samples], strict=True):
        samples = _samples(step.first, end)
        reference = step.value if over else step.before
        for sign in (step.direction,) if step.direction else (1.0, -1.0):
            own = _shifted(found.output, sign if over else -sign, reference, found.plants.output)
            parts.append(_Part(own, samples, samples))
    return parts


def _peak_control(case: TimeDomainCase, found: Trajectory) -> MeasureRange:
    """The largest |u|; u is v within the limits, and rises with it."""
    counted = _samples(case.horizon.first, case.samples)
    part = _largest_size([_Part(found.demanded, counted, counted)])
    ends = [
        np.clip(each[case.horizon.first :], *case.output_limits) for each in (found.demanded.low, found.demanded.high)
    ]
    most = np.maximum(np.abs(ends[0]), np.abs(ends[1]))
    crosses = (ends[0] <= 0.0) & (ends[1] >= 0.0)
    least = np.where(crosses, 0.0, np.minimum(np.abs(ends[0]), np.abs(ends[1])))
    linear = min(part.linear, max(abs(limit) for limit in case.output_limits))
    return MeasureRange(float(least.max()), float(most.max()), part.sample, part.slopes, part.bent, linear)


def _error(case: TimeDomainCase, found: Trajectory) -> Model:
    """r - y."""
    reference = Model.constant(case.run.signals.reference, found.plants.radii)
    return reference - (found.output + Model.constant(np.array([found.plants.output]), found.plants.radii))


def _final_samples(case: TimeDomainCase) -> list[int]:
    """The last samples before the reference's next step, and the last one."""
    steps = case.horizon.steps_of(case.run)
    return [*(step.first - 1 for step in steps[1:] if not step.of_load), case.samples - 1]


def _sizes(error: Model) -> Model:
    """|e|; where the sign is not known, all that it can be."""
    low, high = error.low, error.high
    sign = np.where(low >= 0.0, 1.0, np.where(high <= 0.0, -1.0, 0.0))
    reach = np.maximum(np.abs(low), np.abs(high))
    either = 0.5 * np.where(sign == 0.0, reach, 0.0)
    return error.times(sign) + Model.constant(either, error.radii).wider(either * (1.0 + _ROUNDING))


def _settling(case: TimeDomainCase, found: Trajectory) -> MeasureRange:
    """The settling time; what decides it is the last sample that may be outside the band."""
    steps = case.horizon.steps_of(case.run)
    ends = [*(step.first for step in steps[1:]), case.samples]
    surely, perhaps, parts = [], [], []
    for step, end in zip(steps, ends, strict=True):
        off = _shifted(found.output, 1.0, step.value, found.plants.output)
        low, high = off.low[step.first : end], off.high[step.first : end]
        surely.append((low > step.band) | (high < -step.band))
        perhaps.append(~((low >= -step.band) & (high <= step.band)))
        parts.append(off)
    times = [_settled(case, outside) for outside in (surely, perhaps)]
    # the last sample that may, but need not be outside: it is decided next
    slopes, bent, sample = np.zeros(len(found.plants.radii)), 0.0, None
    for place in reversed(range(len(steps))):
        open_ones = np.flatnonzero(perhaps[place] & ~surely[place])
        if len(open_ones):
            sample = steps[place].first + int(open_ones[-1])
            model = parts[place]
            slopes, bent = model.slopes[:, sample], float(model.quadratic[sample] + model.rest[sample])
            break
    return MeasureRange(times[0], times[1], sample, slopes, bent, times[1])


def _settled(case: TimeDomainCase, outside: Sequence[NDArray[np.bool_]]) -> float:
    """The settling time where these samples of each step are outside the band; see `simulation.measures`."""
    steps, found, owner = case.horizon.steps_of(case.run), [math.nan] * len(outside), 0
    for i, (step, own) in enumerate(zip(steps, outside, strict=True)):
        if not (step.of_load and math.isinf(found[owner])):
            owner = i
        last = int(np.flatnonzero(own)[-1]) + 1 if own.any() else 0
        lasted = case.sample_time_s * (step.first + last - steps[owner].first)
        found[owner] = math.inf if last == len(own) else lasted
    return max(value for value in found if not math.isnan(value))
