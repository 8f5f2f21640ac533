"""The oracle of the exchange:  gains -> the plants and frequencies where each constraint is violated most.

Every constraint is evaluated on a grid of plants times frequencies.  The worst plants are then refined by pattern
search on shrinking stars, and the worst frequencies by Newton's method or on the same stars.  The result is a set of
cuts, not a proof: `fopi_tune.proof` checks the gains by other means, and the violations it finds are added as cuts.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import STABILITY_GUARD, Bound, Constraint, Scale
from fopi_tune.design.loop_grid import LoopGrid, LoopNumbers, Track, discounted_error, numbers_at, part_of, tracked
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

_ZOOM_ROUNDS = 8
_ZOOM_FACTOR = 0.35
_CANDIDATES = 2
#: neper; local minima of a plant's slack this close to the smallest on the grid may be smaller between the grid points;
#: the smallest few are refined
_NEAR_DIP = 0.1
_MOST_DIPS = 3
#: offsets in ln omega within a refinement star, as multiples of its radius
_U_STAR = np.array([0.0, -1.0, -0.5, 0.5, 1.0])


@dataclass(frozen=True)
class Finding:
    """A plant and a frequency where a constraint (or the objective) is worst.

    Args:
        constraint: its index; None for the objective.
        slack: of the constraint in natural units, negative where violated; of the objective, minus its value.
        theta: the plant, a point of the box, shape (p,).
        omega_rad_s: the frequency.
    """

    constraint: int | None
    slack: float
    theta: Array
    omega_rad_s: float


class Oracle:
    """Search for the worst plants and frequencies of a spec's constraints and objective."""

    def __init__(
        self,
        family: PlantFamily,
        scale: Scale,
        constraints: tuple[Constraint, ...],
        objective: ObjectiveKind,
        horizon_s: float,
    ) -> None:
        self.family, self.scale = family, scale
        self.low, self.high = family.low, family.high
        self.points, self.spacing = _box_points(family)
        self.plants = Plants.members(family, self.points)
        self.probes = tuple(_probe(k, constraint) for k, constraint in enumerate(constraints)) + _objective_probe(
            objective, horizon_s
        )

    def with_constraints(self, constraints: tuple[Constraint, ...]) -> Oracle:
        """The same search with other limits of the same constraints."""
        other = copy.copy(self)
        other.probes = (
            tuple(_probe(k, constraint) for k, constraint in enumerate(constraints)) + self.probes[len(constraints) :]
        )
        return other

    def worst(self, gains: FoPi, within: float = math.inf) -> list[Finding]:
        """The worst plants and frequencies of every constraint and of the objective.

        Args:
            gains: the controller.
            within: constraints whose slack on the grid is at least this are not refined.
        """
        table = LoopGrid(gains, self.plants, self.scale.omega_grid)
        nominal_margin, nominal_u = table.nominal()
        rough: list[Finding] = []
        for probe in self.probes:
            value, u = probe.on_grid(table, nominal_margin, nominal_u)
            rows = [0] if probe.nominal else _distinct_worst(value, self.points, self.low, self.high)
            places = [(i, w) for i in rows for w in probe.frequencies(table, nominal_margin, i, float(np.exp(u[i])))]
            rough += [Finding(probe.constraint, float(value[i]), self.points[i], w) for i, w in places]
        exact = [f for f in rough if f.slack > within and f.constraint is not None]
        return exact + self._refined(
            gains, [f for f in rough if not (f.slack > within and f.constraint is not None)], nominal_margin
        )

    def _refined(self, gains: FoPi, rough: list[Finding], nominal_margin: float) -> list[Finding]:
        """Pattern search on shrinking stars in plant and frequency; all findings are one batch a round."""
        by_constraint = {probe.constraint: probe for probe in self.probes}
        tasks = [(by_constraint[f.constraint], f) for f in rough]
        if not tasks:
            return []
        p = len(self.low)
        star, u_radius = _star(p), float(np.diff(np.log(self.scale.omega_grid)).max())
        radius = self.spacing.copy()
        best = [f for _, f in tasks]
        for _ in range(_ZOOM_ROUNDS):
            offers: list[tuple[int, Array, Array]] = []
            for i, (probe, _) in enumerate(tasks):
                around = star[:1] if probe.nominal else star
                points = np.clip(best[i].theta + around * radius, self.low, self.high)
                u = probe.clipped(
                    math.log(best[i].omega_rad_s) + (_U_STAR * u_radius if probe.moves_u else np.zeros(1))
                )
                offers.append((i, np.repeat(points, len(u), axis=0), np.tile(u, len(points))))
            plants = Plants.members(self.family, np.concatenate([points for _, points, _ in offers]))
            loops = Loops.of(gains, plants)
            first = 0
            u_all = np.concatenate([u for _, _, u in offers])
            u_all = tracked(
                loops, u_all, np.concatenate([np.full(len(u), _TRACK[tasks[i][0].kind].value) for i, _, u in offers])
            )
            numbers = numbers_at(loops, np.arange(len(loops)), u_all)
            for i, points, u in offers:
                part = slice(first, first + len(u))
                first += len(u)
                value = tasks[i][0].slack_at(part_of(numbers, part), loops, part, nominal_margin)
                q = int(np.argmin(value))
                if value[q] < best[i].slack:
                    best[i] = Finding(best[i].constraint, float(value[q]), points[q], float(np.exp(u_all[part][q])))
            radius, u_radius = radius * _ZOOM_FACTOR, u_radius * _ZOOM_FACTOR
        return best


class _Kind(Enum):
    """How the frequency of a probe is found."""

    BAND = "the worst of a band"
    GAIN_CROSSOVER = "|L| = 1"
    PHASE_CROSSOVER = "arg L = -180 deg"
    FIXED = "given"


_TRACK = {
    _Kind.BAND: Track.STAY,
    _Kind.GAIN_CROSSOVER: Track.GAIN_CROSSOVER,
    _Kind.PHASE_CROSSOVER: Track.PHASE_CROSSOVER,
    _Kind.FIXED: Track.STAY,
}


@dataclass(frozen=True)
class _Probe:
    """One constraint or the objective, as functions that the oracle evaluates; slacks are negative where violated."""

    constraint: int | None
    kind: _Kind
    nominal: bool
    highest: bool
    low_u: float
    high_u: float
    slack: Callable[[LoopNumbers, float], Array]
    #: the quantity itself; of several crossings the one with the smallest value counts
    value: Callable[[LoopNumbers], Array] = lambda numbers: numbers.phase_rad
    horizon_s: float = 0.0
    guard: bool = False

    @property
    def moves_u(self) -> bool:
        """Whether the refinement moves the frequency freely."""
        return self.kind is _Kind.BAND and self.low_u < self.high_u

    def clipped(self, u: Array) -> Array:
        """Clip to the band."""
        return np.clip(u, self.low_u, self.high_u) if self.kind is _Kind.BAND else u

    def slack_at(self, numbers: LoopNumbers, loops: Loops, rows: slice, nominal_margin: float) -> Array:
        """Slacks at given plants and frequencies."""
        if self.horizon_s:
            return -np.log(discounted_error(loops, self.horizon_s)[rows])
        return self.slack(numbers, nominal_margin)

    def frequencies(self, table: LoopGrid, nominal_margin: float, row: int, worst_rad_s: float) -> list[float]:
        """Frequencies to refine: in a band, every local minimum of the slack that is close to the smallest."""
        if not self.moves_u:
            return [worst_rad_s]
        one = np.array([row])
        grid, band = table.in_band(lambda n: self.slack(n, nominal_margin), self.low_u, self.high_u, one)
        padded = np.concatenate([[np.inf], grid[0], [np.inf]])
        dips = np.flatnonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] < padded[2:]))
        near = dips[grid[0][dips] < grid[0].min() + _NEAR_DIP]
        deepest = near[np.argsort(grid[0][near])][:_MOST_DIPS]
        return [float(np.exp(band[i])) for i in deepest] or [worst_rad_s]

    def on_grid(self, table: LoopGrid, nominal_margin: float, nominal_u: float) -> tuple[Array, Array]:
        """The smallest slack of each of the table's plants, and its u."""
        if self.kind is _Kind.BAND:
            every = np.arange(len(table.loops))
            grid, band = table.in_band(lambda n: self.slack(n, nominal_margin), self.low_u, self.high_u, every)
            return grid.min(axis=1), band[np.argmin(grid, axis=1)]
        m = len(table.loops)
        if self.kind is _Kind.FIXED:
            u = np.full(m, -math.log(self.horizon_s) if self.horizon_s else nominal_u)
            numbers = numbers_at(table.loops, np.arange(m), u)
            return self.slack_at(numbers, table.loops, slice(0, m), nominal_margin), u
        rows, u = table.gain_crossings() if self.kind is _Kind.GAIN_CROSSOVER else table.phase_crossings()
        numbers = numbers_at(table.loops, rows, u)
        slack = self.slack(numbers, nominal_margin)
        order = np.lexsort((-u if self.highest else self.value(numbers), rows))
        value, where = np.full(m, np.inf), np.zeros(m)
        if self.kind is _Kind.GAIN_CROSSOVER and (not self.guard or np.any(table.loops.plants.unstable_poles > 0)):
            # Without a gain crossover the constraint is violated, the more the farther |L| stays from 1.  A guard is
            # violated by that only if the plant is unstable in open loop.
            away, where = table.nearest_to_crossover()
            value = -1.0 - away
        found, first = np.unique(rows[order], return_index=True)
        value[found], where[found] = slack[order][first], u[order][first]
        return value, where


def _probe(k: int, constraint: Constraint) -> _Probe:
    quantity = constraint.quantity

    def slack(numbers: LoopNumbers, _: float) -> Array:
        distance = (constraint.limit - quantity.natural(numbers)) * constraint.scale
        return -np.abs(distance) if constraint.bound is Bound.EQUAL else constraint.bound.value * distance

    kind = {
        EvaluatedAt.BAND: _Kind.BAND,
        EvaluatedAt.GAIN_CROSSOVERS: _Kind.GAIN_CROSSOVER,
        EvaluatedAt.HIGHEST_GAIN_CROSSOVER: _Kind.GAIN_CROSSOVER,
        EvaluatedAt.PHASE_CROSSOVERS: _Kind.PHASE_CROSSOVER,
    }[constraint.where]
    low = math.log(constraint.from_rad_s) if constraint.from_rad_s > 0 else -math.inf
    high = math.log(constraint.to_rad_s) if constraint.to_rad_s < math.inf else math.inf
    return _Probe(
        k, kind, constraint.nominal, constraint.where is EvaluatedAt.HIGHEST_GAIN_CROSSOVER, low, high, slack,
        quantity.natural, guard=constraint.requirement == STABILITY_GUARD,
    )  # fmt: skip


def _objective_probe(objective: ObjectiveKind, horizon_s: float) -> tuple[_Probe, ...]:
    """The objective as a probe whose slack is minus its value; none for those without a worst member."""
    ends = (-math.inf, math.inf)
    if objective is ObjectiveKind.SENSITIVITY_PEAK:
        return (_Probe(None, _Kind.BAND, False, False, *ends, lambda n, _: n.log_return_difference),)
    if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
        return (_Probe(None, _Kind.BAND, False, False, *ends, lambda n, _: n.log_return_difference - n.log_controller),)
    if objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
        return (_Probe(None, _Kind.GAIN_CROSSOVER, False, False, *ends, lambda n, m: -np.abs(n.phase_rad + np.pi - m)),)
    if objective is ObjectiveKind.CROSSOVER_SPREAD:
        return (_Probe(None, _Kind.FIXED, False, False, *ends, lambda n, _: -np.abs(n.log_gain)),)
    if objective is ObjectiveKind.IAE_DISTURBANCE:
        return (_Probe(None, _Kind.FIXED, False, False, *ends, lambda n, _: -n.log_gain, horizon_s=horizon_s),)
    return ()


def _star(p: int) -> Array:
    """Offsets of a refinement star in p dimensions, the centre first; shape (k, p)."""
    if p <= 2:
        steps = (-1.0, -0.5, 0.0, 0.5, 1.0) if p == 1 else (-1.0, 0.0, 1.0)
        return np.array(sorted(itertools.product(steps, repeat=p), key=lambda x: sum(abs(v) for v in x)))
    axes = np.concatenate([np.eye(p), -np.eye(p)])
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=p))) if p <= 4 else np.zeros((0, p))
    return np.concatenate([np.zeros((1, p)), axes, corners])


def _box_points(family: PlantFamily) -> tuple[Array, Array]:
    """Grid points of the box, the nominal one first, and the grid's spacing; shapes (m, p) and (p,)."""
    low, high, p = family.low, family.high, len(family.low)
    if p == 0:
        return np.zeros((1, 0)), np.zeros(0)
    per_axis = {1: 17, 2: 7, 3: 5, 4: 3}.get(p, 2)
    axes = [np.linspace(a, b, per_axis) for a, b in zip(low, high, strict=True)]
    if p <= 8:
        grid = np.array(list(itertools.product(*axes))).reshape(-1, p)
    else:
        generator = np.random.default_rng(0)
        grid = low + generator.integers(0, 2, (256, p)) * (high - low)
    inner = np.zeros((0, p))
    if p >= 4:
        inner = low + np.random.default_rng(1).random((64, p)) * (high - low)
    points = np.concatenate([family.nominal_point[None, :], grid, inner])
    return points, (high - low) / max(per_axis - 1, 1)


def _distinct_worst(slack: Array, points: Array, low: Array, high: Array) -> list[int]:
    """The worst row, and the worst of the rows far from it in the box."""
    order = np.argsort(slack)
    chosen: list[int] = []
    width = np.where(high > low, high - low, 1.0)
    for row in order:
        far = all(np.max(np.abs(points[row] - points[c]) / width, initial=0.0) > 0.3 for c in chosen)
        if far:
            chosen.append(int(row))
        if len(chosen) == _CANDIDATES:
            break
    return chosen
