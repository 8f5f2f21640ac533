"""The worst plants of the box for each limit and for the objective, by simulation:  gains -> values and plants.

Every plant of a dense sample of the box is simulated; around the worst one of each row a pattern that shrinks is
searched, because worst plants lie inside the box too.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.measures import ScenarioRun, settling_samples
from fopi_tune.design.time_domain.problem import ScenarioProblem, ScenarioRow
from fopi_tune.digital.implementation import implementation_of, runtime_of
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.measures import MEASURE_VALUES
from fopi_tune.simulation.sampled.simulate import measure, simulate
from fopi_tune.simulation.scenario import Measures, Mode
from fopi_tune.spec.measures import ACCELERATION

#: share of the box to either side at which the pattern begins, by the number of uncertain numbers; how it shrinks
_REACH, _SHRINK, _ROUNDS = {1: 0.004, 2: 0.08, 3: 0.12}, 0.4, 9
#: a pattern in more numbers than this moves one of them at a time
_FULL_PATTERN = 3
#: plants whose signals are kept at a time
_KEPT = 256


@dataclass(frozen=True)
class Worst:
    """The worst plant of one row.

    Args:
        value: of a limit by how much it is missed, in the row's units, negative inside; of the objective its value.
        point: the plant, shape (p,).
    """

    value: float
    point: tuple[float, ...]


@dataclass
class Family:
    """The plants of a problem.

    Args:
        problem: the problem.
    """

    problem: ScenarioProblem

    def __post_init__(self) -> None:
        self.simulated = 0

    def worst(self, gains: FoPi, refine: bool = True) -> dict[tuple[int, str], Worst]:
        """The worst plant of each row by its key, the objective's too.

        Args:
            gains: the gains.
            refine: whether to search between the plants of the sample.

        Raises:
            DomainError: there is no digital controller with these gains.
        """
        controller, points = self.controller(gains), self.problem.family
        values = self.values(controller, points)
        if not values:
            return {}
        best = {key: Worst(float(found.max()), tuple(points[int(found.argmax())])) for key, found in values.items()}
        low, high = self.problem.spec.plant.low, self.problem.spec.plant.high
        p = len(low)
        if not p or not refine:
            return best
        pattern, reach = _pattern(p), _REACH.get(p, 0.15) * (high - low)
        for _ in range(_ROUNDS):
            near = {key: np.clip(np.array(worst.point) + pattern * reach, low, high) for key, worst in best.items()}
            together = np.unique(np.concatenate(list(near.values())), axis=0)
            found = self.values(controller, together)
            for key, worst in best.items():
                place = int(found[key].argmax())
                if found[key][place] > worst.value:
                    best[key] = Worst(float(found[key][place]), tuple(together[place]))
            reach = _SHRINK * reach
        return best

    def controller(self, gains: FoPi) -> Runtime:
        """As it runs.

        Raises:
            DomainError: there is none.
        """
        spec = self.problem.spec
        return runtime_of(implementation_of(spec, gains).sections, spec)

    def values(self, controller: Runtime, points: Array) -> dict[tuple[int, str], Array]:
        """By how much each row is missed by plants at points of the box, shape (m,) each; inf where nothing ends."""
        plants, found = self.problem.plants(points), {}
        rows = [*self.problem.rows, *([] if self.problem.objective is None else [self.problem.objective])]
        for run in self.problem.runs:
            own = [row for row in rows if row.run is run]
            self.simulated += len(points)
            numbers = measure([Mode(controller, plants)], run.run, run.horizon, threads=1)
            for row in own:
                if row.limit.measure == "settling_time_s" and row is not self.problem.objective:
                    found[row.key] = self._settling(controller, points, row)
                else:
                    found[row.key] = _missed(row, numbers)
        return found

    def _settling(self, controller: Runtime, points: Array, row: ScenarioRow) -> Array:
        """How far outside of its settling band an output is at most from the limit on, in bands; shape (m,)."""
        parts = []
        for first in range(0, len(points), _KEPT):
            plants = self.problem.plants(points[first : first + _KEPT])
            traces = simulate([Mode(controller, plants)], row.run.run)
            parts.append(_outside(row.run, traces.output, row.unsettled_samples))
        missed = row.side * (np.concatenate(parts) - 1.0)
        return np.where(np.isfinite(missed), missed, np.inf)


def _missed(row: ScenarioRow, numbers: Measures) -> Array:
    values = MEASURE_VALUES[row.limit.measure](numbers)
    if row.limit.measure == ACCELERATION:
        values = values / row.run.per_m_s
    if row.index >= 0:
        values = row.side * (values - row.limit.limit) / row.unit
    return np.where(np.isfinite(values), values, np.inf)


def _outside(run: ScenarioRun, output: Array, unsettled: int) -> Array:
    """max |y - value|/band after the samples that do not count, as `measures.points_of` has it; shape (m,)."""
    worst = np.zeros(len(output))
    for index, (step, counts) in enumerate(zip(run.steps, settling_samples(run, output, unsettled), strict=True)):
        away = np.where(counts, np.abs(output[:, run.samples_of(index)] - step.value), 0.0).max(axis=1)
        worst = np.maximum(worst, away / (step.band or np.finfo(float).tiny))
    return worst


def _pattern(p: int) -> Array:
    """Points of [-1, 1]^p, shape (k, p)."""
    if p <= _FULL_PATTERN:
        sides = np.linspace(-1.0, 1.0, 9) if p == 1 else np.linspace(-1.0, 1.0, 5)
        return np.array(list(itertools.product(sides, repeat=p)))
    axes = np.concatenate([np.eye(p), -np.eye(p), 0.4 * np.eye(p), -0.4 * np.eye(p)])
    return np.vstack([axes, np.array(list(itertools.product((-0.5, 0.5), repeat=p)))])
