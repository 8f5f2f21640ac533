"""Measures of scenarios as functions of the gains:  trajectories -> numbers and their derivatives.

A measure is the largest of many points (rates, overshoot, errors), each differentiable, or a sum over the samples.  The
limits' rows and the objective are linear models of these; `simulation.measures` defines the measures themselves.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.design.time_domain.trajectories import Trajectories
from fopi_tune.simulation.scenario import Horizon, Scenario, Step
from fopi_tune.spec.measures import ACCELERATION, JERK
from fopi_tune.spec.model import ScenarioSpec

#: share of a step's time at which a rise that does not end is counted, for each share of the step that is missing
_MISSING_RISE = 10.0


@dataclass(frozen=True, eq=False)
class ScenarioRun:
    """A scenario on the samples of the loop.

    Args:
        spec: as the spec states it.
        run: its signals, without noise.
        horizon: which samples count.
        per_m_s: output units of 1 m/s; 1 where the output is no velocity.
    """

    spec: ScenarioSpec
    run: Scenario
    horizon: Horizon
    per_m_s: float = 1.0

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps that are judged."""
        return self.horizon.steps_of(self.run)

    @property
    def largest_step(self) -> float:
        """The size of the largest step of the reference; 0 without one."""
        return max(abs(step.value - step.before) for step in self.steps)

    def samples_of(self, index: int) -> slice:
        """The samples of a step: from its own first to the one before the next step's."""
        steps = self.steps
        end = steps[index + 1].first if index + 1 < len(steps) else len(self.run.signals)
        return slice(steps[index].first, end)


@dataclass(frozen=True, eq=False)
class Points:
    """Numbers whose largest one, plant by plant, is a measure.

    Args:
        values: shape (m, n).
        slopes: by the controller's numbers, shape (m, n, numbers).
    """

    values: Array
    slopes: Array

    @classmethod
    def of(cls, numbers: Array) -> Points:
        """From numbers with their derivatives, shape (m, n, 1 + numbers)."""
        return cls(numbers[..., 0], numbers[..., 1:])

    @classmethod
    def joined(cls, parts: list[Points]) -> Points:
        """All of them."""
        values = np.concatenate([part.values for part in parts], axis=1)
        return cls(values, np.concatenate([part.slopes for part in parts], axis=1))

    def shifted(self, offset: float, scale: float) -> Points:
        """(values - offset)/scale."""
        return Points((self.values - offset) / scale, self.slopes / scale)

    @property
    def largest(self) -> Points:
        """The largest of each plant alone, n = 1."""
        at = np.argmax(self.values, axis=1)[:, None]
        slopes = np.take_along_axis(self.slopes, at[:, :, None], axis=1)
        return Points(np.take_along_axis(self.values, at, axis=1), slopes)


def errors_of(run: ScenarioRun, found: Trajectories) -> Points:
    """r - y at the samples that count, shape (m, K)."""
    first = run.horizon.first
    numbers = -found.output[:, first:]
    return Points(run.run.signals.reference[None, first:] + numbers[..., 0], numbers[..., 1:])


def points_of(measure: str, run: ScenarioRun, found: Trajectories, unsettled: int = 0) -> Points:
    """The points of a measure in its public unit.

    Args:
        measure: a word of `DESIGNED_MEASURES`.
        run: the scenario.
        found: its trajectories.
        unsettled: of a settling time, samples after a step that do not count: its points are then the distances from
            the reference of the others, in settling bands, and the limit is met where none is above 1.
    """
    return _POINTS[measure](run, found, unsettled)


def _both(numbers: Array) -> Points:
    """|numbers|."""
    return Points.of(np.concatenate([numbers, -numbers], axis=1))


def _nothing(found: Trajectories) -> Points:
    """One 0 a plant that no number moves."""
    return Points.of(np.zeros_like(found.output[:, :1]))


def _rates(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    first = run.horizon.first
    # the rate after the last sample lies beyond the end
    return _both(np.concatenate([found.rate[:, first:], found.rate_after[:, first:-1]], axis=1))


def _jerks(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    second = np.diff(found.output[:, run.horizon.first :], 2, axis=1) / run.run.sample_time_s**2
    # of fewer than three samples there is none
    return _both(second) if second.shape[1] else _nothing(found)


def _accelerations(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    return _rates(run, found, 0).shifted(0.0, run.per_m_s)


def _controls(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    return _both(found.applied[:, run.horizon.first :])


def _beyond(run: ScenarioRun, found: Trajectories, index: int) -> Array:
    """y - value over a step's samples, shape (m, n, 1 + numbers)."""
    numbers = found.output[:, run.samples_of(index)].copy()
    numbers[..., 0] -= run.steps[index].value
    return numbers


def _overshoots(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    parts = []
    for index, step in enumerate(run.steps):
        numbers = _beyond(run, found, index)
        parts.append(Points.of(step.direction * numbers) if step.direction else _both(numbers))
    return Points.joined(parts)


def _undershoots(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    # without a step there is none
    parts = [_nothing(found)]
    for index, step in enumerate(run.steps):
        if step.direction:
            numbers = -step.direction * found.output[:, run.samples_of(index)]
            parts.append(Points.of(numbers).shifted(-step.direction * step.before, 1.0))
    return Points.joined(parts)


def _settling_points(run: ScenarioRun, found: Trajectories, unsettled: int) -> Points:
    parts = [_nothing(found)]
    for index, (step, counts) in enumerate(
        zip(run.steps, settling_samples(run, found.output[..., 0], unsettled), strict=True)
    ):
        numbers = _beyond(run, found, index)
        # what need not be settled yet lies at the value
        numbers[~counts] = 0.0
        parts.append(_both(numbers).shifted(0.0, step.band or np.finfo(float).tiny))
    return Points.joined(parts)


def settling_samples(run: ScenarioRun, output: Array, late: int) -> list[NDArray[np.bool_]]:
    """Which samples of each step have to be settled, shape (m, samples) each.

    Args:
        run: the scenario.
        output: shape (m, steps).
        late: samples from the step on that need not be; a step of the load before which a plant has not settled goes on
            with the time of the step before.
    """
    begun, found = np.zeros(len(output), dtype=int), []
    for index, step in enumerate(run.steps):
        samples = run.samples_of(index)
        last = np.abs(output[:, samples.start - 1] - step.value) if index else np.zeros(len(output))
        # a step of the load has the value and the band of the step before
        begun = np.where(step.of_load & ~(last <= step.band), begun, samples.start)
        counts = np.arange(samples.start, samples.stop) >= (begun + late)[:, None]
        # what is outside at the end of a step has not settled, however long that may take
        counts[:, -1] |= index + 1 == len(run.steps) or not run.steps[index + 1].of_load
        found.append(counts)
    return found


def _final_errors(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    steps = run.steps
    last = [run.samples_of(i).stop - 1 for i in range(len(steps)) if i + 1 == len(steps) or not steps[i + 1].of_load]
    numbers = -found.output[:, last]
    numbers[..., 0] += run.run.signals.reference[last]
    return _both(numbers)


def _squares(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    errors, Ts = errors_of(run, found), run.run.sample_time_s
    values = Ts * (errors.values**2).sum(axis=1, keepdims=True)
    return Points(values, 2.0 * Ts * np.einsum("mk,mkj->mj", errors.values, errors.slopes)[:, None, :])


def _absolutes(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    errors, Ts = errors_of(run, found), run.run.sample_time_s
    signs = np.sign(errors.values)
    return Points(
        Ts * np.abs(errors.values).sum(axis=1, keepdims=True),
        Ts * np.einsum("mk,mkj->mj", signs, errors.slopes)[:, None, :],
    )


def _rise_times(run: ScenarioRun, found: Trajectories, _: int) -> Points:
    parts = [_nothing(found)]
    # a step of the load ends no rise
    own = [step for step in run.steps if not step.of_load]
    for step, after in itertools.zip_longest(own, own[1:]):
        if step.direction:
            numbers = found.output[:, step.first : None if after is None else after.first].copy()
            numbers[..., 0] -= step.before
            numbers = numbers / (step.value - step.before)
            both = [_rise(row, run.run.sample_time_s) for row in numbers]
            parts.append(Points.of(np.array(both)[:, None, :]))
    return Points.joined(parts)


def _rise(progress: Array, sample_time_s: float) -> Array:
    """From 10 % to 90 % of a step, s, with derivatives, shape (1 + numbers,); beyond its end without 90 %."""
    ends = []
    for level in (0.9, 0.1):
        above = np.flatnonzero(progress[:, 0] >= level)
        if not len(above):
            most = progress[np.argmax(progress[:, 0])]
            late = -_MISSING_RISE * len(progress) * most
            late[0] += len(progress) * (1.0 + _MISSING_RISE * level)
            # when the rise began counts no more: a later beginning would be worth more than a higher end
            return sample_time_s * late
        k = int(above[0])
        if k == 0:
            ends.append(np.zeros_like(progress[0]))
            continue
        before, after = progress[k - 1], progress[k]
        rise = after - before
        share = (level - before[0]) / rise[0]
        # d share = -(d before + share d rise)/rise
        slope = -(before[1:] + share * rise[1:]) / rise[0]
        ends.append(np.array([k - 1 + share, *slope]))
    return np.asarray(sample_time_s * (ends[0] - ends[1]))


_POINTS: dict[str, Callable[[ScenarioRun, Trajectories, int], Points]] = {
    ACCELERATION: _accelerations,
    "peak_rate_per_s": _rates,
    JERK: _jerks,
    "overshoot": _overshoots,
    "undershoot": _undershoots,
    "settling_time_s": _settling_points,
    "rise_time_s": _rise_times,
    "iae": _absolutes,
    "ise": _squares,
    "peak_control": _controls,
    "final_error": _final_errors,
}


def unit_of(measure: str, run: ScenarioRun, limit: float) -> float:
    """What a limit's slack is counted in, public unit: the step's size of overshoots, else the limit itself."""
    if measure == "settling_time_s":
        return 1.0
    if measure in ("overshoot", "undershoot") and run.largest_step > 0.0:
        return run.largest_step
    return abs(limit) or 1.0
