"""The problem at given gains, linearised:  rows that must not be positive, the objective, sums of absolute errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.measures import Points, ScenarioRun, errors_of, points_of
from fopi_tune.design.time_domain.problem import TIGHTENING, ScenarioProblem, ScenarioRow
from fopi_tune.design.time_domain.trajectories import Trajectories, trajectories
from fopi_tune.digital.implementation import implementation_of, runtime_of
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode, Traces


@dataclass(frozen=True, eq=False)
class Sum:
    """weight sum_k |error_k + slope_k d| + offset of one plant: a convex function of the step d.

    Args:
        errors: shape (K,).
        slopes: by the controller's n numbers, shape (K, n).
        weight: of the sum.
        offset: added.
        row: what the sum is about: a row, by its place in `ScenarioProblem.rows`, or -1 for the objective.
    """

    errors: Array
    slopes: Array
    weight: float
    offset: float
    row: int

    @property
    def value(self) -> float:
        """At d = 0."""
        return float(self.weight * np.abs(self.errors).sum() + self.offset)


@dataclass(frozen=True, eq=False)
class Model:
    """Everything that is asked, at some gains.

    Args:
        gains: there.
        values, slopes: of what must not be positive, shapes (r,) and (r, n), slopes by the controller's n numbers.
        owner: shape (r,): of a row of scenarios its place in `ScenarioProblem.rows`, of one of the loop -1 - its row.
        aims, aim_slopes: of which the largest is minimised, shapes (k,) and (k, n).
        sums: those of rows are among the values neither, nor those of the objective among the aims.
        loop_violation: of the loop's requirements over the family, natural units.
    """

    gains: FoPi
    values: Array
    slopes: Array
    owner: NDArray[np.int64]
    aims: Array
    aim_slopes: Array
    sums: tuple[Sum, ...]
    loop_violation: float

    @property
    def shape(self) -> tuple[int, ...]:
        """How many rows, aims and terms of each sum there are: those near the largest are, at other gains others."""
        return len(self.values), len(self.aims), *(len(each.errors) for each in self.sums)

    @property
    def objective(self) -> float:
        """What is minimised; -inf where nothing is."""
        of_sums = [each.value for each in self.sums if each.row < 0]
        return float(max([*self.aims.tolist(), *of_sums], default=-np.inf))

    @property
    def violation(self) -> float:
        """The largest one of what must hold."""
        of_sums = [each.value for each in self.sums if each.row >= 0]
        return float(max([self.loop_violation, *of_sums, float(self.values.max(initial=0.0)), 0.0]))


@dataclass
class Modeller:
    """Models of one problem for the plants that are known.

    Args:
        problem: the problem.
        cuts: of the loop.
        points: the plants that are simulated, shape (m, p).
    """

    problem: ScenarioProblem
    cuts: LoopCuts
    points: Array

    def __post_init__(self) -> None:
        self.set_points(self.points)
        self.simulated = 0

    def set_points(self, points: Array) -> None:
        """Other plants."""
        digital = self.problem.spec.digital
        assert digital is not None
        self.points, self.plants = points, self.problem.plants(points)
        self.held = discretize_plants(self.plants, digital.sample_time_s, digital.delay_samples)

    def at(self, gains: FoPi, learn: bool = True) -> Model | None:
        """The model at gains; None where a loop is unstable, has no controller or does not stay finite.

        Args:
            gains: the gains.
            learn: whether the loop's worst cases are looked for, and kept; else those that are known are used.
        """
        violation = 0.0
        if learn:
            found = self.cuts.look(gains)
            if found is None:
                return None
            violation = self.cuts.violation(found)
            self.cuts.learn(found)
        runs = self.trajectories_of(gains)
        if runs is None:
            return None
        parts = _Parts(self.problem.numbers.count)
        self._add_loop(parts, gains)
        for place, row in enumerate(self.problem.rows):
            self._add_row(parts, place, row, runs[row.run.spec.name])
        if self.problem.objective is not None:
            self._add_aim(parts, self.problem.objective, runs[self.problem.objective.run.spec.name])
        return parts.model(gains, violation)

    def trajectories_of(self, gains: FoPi) -> dict[str, Trajectories] | None:
        """Of each scenario by its name; None where one is not finite."""
        numbers, spec, found = self.problem.numbers, self.problem.spec, {}
        x = numbers.of(gains)

        @cache
        def runtime(there: bytes) -> Runtime:
            gains = numbers.controller(np.frombuffer(there))
            return runtime_of(implementation_of(spec, gains).sections, spec)

        for run in self.problem.runs:

            def simulated(there: Array, run: ScenarioRun = run) -> Traces:
                self.simulated += len(self.points)
                return simulate([Mode(runtime(there.tobytes()), self.plants)], run.run, held=self.held)

            try:
                one = trajectories(simulated, x, numbers.sizes(x), numbers.box)
            except DomainError:
                return None
            if one is None:
                return None
            found[run.spec.name] = one
        return found

    def _add_loop(self, parts: _Parts, gains: FoPi) -> None:
        slacks, slopes = self.cuts.slacks(gains)
        rows = self.cuts.rows_of_pool
        aims, equal = self.cuts.is_aim(rows), self.cuts.is_equality(rows)
        parts.add(-slacks[~aims], -slopes[~aims], -1 - rows[~aims])
        parts.add(slacks[equal & ~aims], slopes[equal & ~aims], -1 - rows[equal & ~aims])
        parts.aim(-slacks[aims], -slopes[aims])
        if self.cuts.maximises_ki:
            numbers = self.problem.numbers
            x = numbers.of(gains)
            ki = numbers.structure.names.index("ki")
            slope = -np.eye(numbers.count)[ki : ki + 1] / numbers.units(x)[ki]
            parts.aim(slope @ x, slope)

    def _add_row(self, parts: _Parts, place: int, row: ScenarioRow, found: Trajectories) -> None:
        limit, measure = row.limit.limit, row.limit.measure
        if measure == "iae" and row.side > 0.0 and not row.in_depth:
            parts.sums += _sums(row, found, place, 1.0 / row.unit, TIGHTENING - limit / row.unit)
            return
        points = points_of(measure, row.run, found, row.unsettled_samples)
        level = 1.0 if measure == "settling_time_s" else limit
        shifted = points.shifted(level, row.unit)
        if row.side < 0.0:
            largest = shifted.largest
            shifted = Points(-largest.values, -largest.slopes)
        values, slopes = _near(shifted)
        if row.in_depth:
            parts.aim(values, slopes)
        else:
            # what no gain moves, such as an undershoot of 0, is no tighter than it is
            tightened = values + np.where(slopes.any(axis=1), TIGHTENING, 0.0)
            parts.add(tightened, slopes, np.full(len(values), place))

    def _add_aim(self, parts: _Parts, row: ScenarioRow, found: Trajectories) -> None:
        if row.limit.measure == "iae":
            parts.sums += _sums(row, found, -1, 1.0, 0.0)
        else:
            parts.aim(*_near(points_of(row.limit.measure, row.run, found)))


class _Parts:
    """A model as it is put together."""

    def __init__(self, count: int) -> None:
        self.none = np.zeros((0, count))
        self.rows: list[tuple[Array, Array, Array]] = []
        self.aims: list[tuple[Array, Array]] = []
        self.sums: list[Sum] = []

    def add(self, values: Array, slopes: Array, owner: Array) -> None:
        self.rows.append((values, slopes, owner))

    def aim(self, values: Array, slopes: Array) -> None:
        self.aims.append((values, slopes))

    def model(self, gains: FoPi, violation: float) -> Model:
        values = np.concatenate([row[0] for row in self.rows])
        slopes = np.concatenate([row[1] for row in self.rows])
        owner = np.concatenate([row[2] for row in self.rows]).astype(np.int64)
        aims = np.concatenate([np.zeros(0), *(aim[0] for aim in self.aims)])
        aim_slopes = np.concatenate([self.none, *(aim[1] for aim in self.aims)])
        return Model(gains, values, slopes, owner, aims, aim_slopes, tuple(self.sums), violation)


def _near(points: Points) -> tuple[Array, Array]:
    """All points of all plants, flat."""
    return points.values.reshape(-1), points.slopes.reshape(-1, points.slopes.shape[-1])


def _sums(row: ScenarioRow, found: Trajectories, place: int, factor: float, offset: float) -> list[Sum]:
    errors = errors_of(row.run, found)
    weight = row.run.run.sample_time_s * factor
    return [Sum(e, s, weight, offset, place) for e, s in zip(errors.values, errors.slopes, strict=True)]
