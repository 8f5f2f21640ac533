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
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import Crossings, gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import Bound, Constraint, Scale
from fopi_tune.design.loop_grid import LoopGrid, LoopNumbers, Track, discounted_error, numbers_at, part_of, tracked
from fopi_tune.design.margin_sides import Sides, sides_of
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

_ZOOM_ROUNDS = 8
_ZOOM_FACTOR = 0.35
_CANDIDATES = 2
#: neper; local minima of a plant's slack this close to the smallest on the grid may be smaller between the grid points;
#: the smallest few are refined
_NEAR_DIP = 0.1
_MOST_DIPS = 3
#: natural units; a refined slack that differs more from the one of all crossovers was read at the wrong one
_SAME_SLACK = 1e-6
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
        side, angle_rad: of a gain crossover, as in `fopi_tune.design.margin_sides`.
    """

    constraint: int | None
    slack: float
    theta: Array
    omega_rad_s: float
    side: float = 1.0
    angle_rad: float = 0.0


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
            worst = probe.on_grid(table, nominal_margin, nominal_u)
            rows = [0] if probe.nominal else _distinct_worst(worst.slack, self.points, self.low, self.high)
            for i in rows:
                found = worst.finding(probe.constraint, i, self.points[i])
                places = probe.frequencies(table, nominal_margin, i, found.omega_rad_s)
                rough += [replace(found, omega_rad_s=w) for w in places]
        exact = [f for f in rough if f.slack > within and f.constraint is not None]
        near = [f for f in rough if not (f.slack > within and f.constraint is not None)]
        return exact + self._confirmed(gains, near, self._refined(gains, near, nominal_margin), nominal_margin)

    def _confirmed(
        self, gains: FoPi, rough: list[Finding], refined: list[Finding], nominal_margin: float
    ) -> list[Finding]:
        """The refined findings, those at gain crossovers compared with all crossovers of their plant.

        From one plant of a star to the next a crossover may be lost for another one, or a loop become unstable.
        """
        by_constraint = {probe.constraint: probe for probe in self.probes}
        asked = [i for i, f in enumerate(refined) if by_constraint[f.constraint].kind is _Kind.GAIN_CROSSOVER]
        if not asked:
            return refined
        loops = Loops.of(gains, Plants.members(self.family, np.array([refined[i].theta for i in asked])))
        crossings = gain_crossovers(loops)
        sides = sides_of(loops, crossings)
        best = list(refined)
        for row, i in enumerate(asked):
            found = refined[i]
            worst = by_constraint[found.constraint].at_crossovers(loops, crossings, sides, nominal_margin)
            if abs(worst.slack[row] - found.slack) > _SAME_SLACK:
                again = worst.finding(found.constraint, row, found.theta)
                best[i] = min(rough[i], again, key=lambda f: f.slack)
        return best

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
            counts = [len(u) for _, _, u in offers]
            side = np.repeat([best[i].side for i, _, _ in offers], counts)
            angle = np.repeat([best[i].angle_rad for i, _, _ in offers], counts)
            numbers = numbers_at(loops, np.arange(len(loops)), u_all, side, angle)
            for i, points, u in offers:
                part = slice(first, first + len(u))
                first += len(u)
                value = tasks[i][0].slack_at(part_of(numbers, part), loops, part, nominal_margin)
                q = int(np.argmin(value))
                if value[q] < best[i].slack:
                    angle_rad = best[i].side * float(numbers.phase_margin_rad[part][q])
                    best[i] = replace(
                        best[i],
                        slack=float(value[q]),
                        theta=points[q],
                        omega_rad_s=float(np.exp(u_all[part][q])),
                        angle_rad=angle_rad,
                    )
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
class _Worst:
    """The smallest slack of each of m plants, its u, and of a gain crossover its side and angle; shapes (m,)."""

    slack: Array
    u: Array
    side: Array
    angle_rad: Array

    @classmethod
    def at(cls, slack: Array, u: Array) -> _Worst:
        """At frequencies that are no gain crossovers."""
        return cls(slack, u, np.ones(len(u)), np.zeros(len(u)))

    def finding(self, constraint: int | None, row: int, theta: Array) -> Finding:
        """That of one plant."""
        omega_rad_s = float(np.exp(self.u[row]))
        return Finding(
            constraint, float(self.slack[row]), theta, omega_rad_s, float(self.side[row]), float(self.angle_rad[row])
        )


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
    value: Callable[[LoopNumbers], Array] = lambda numbers: numbers.phase_margin_rad
    horizon_s: float = 0.0
    #: whether a stable loop without a gain crossover meets it where |L| < 1, and where |L| > 1
    met_below_one: bool = False
    met_above_one: bool = False

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

    def on_grid(self, table: LoopGrid, nominal_margin: float, nominal_u: float) -> _Worst:
        """The smallest slack of each of the table's plants."""
        m = len(table.loops)
        if self.kind is _Kind.BAND:
            grid, band = table.in_band(lambda n: self.slack(n, nominal_margin), self.low_u, self.high_u, np.arange(m))
            return _Worst.at(grid.min(axis=1), band[np.argmin(grid, axis=1)])
        if self.kind is _Kind.FIXED:
            u = np.full(m, -math.log(self.horizon_s) if self.horizon_s else nominal_u)
            numbers = numbers_at(table.loops, np.arange(m), u)
            return _Worst.at(self.slack_at(numbers, table.loops, slice(0, m), nominal_margin), u)
        if self.kind is _Kind.PHASE_CROSSOVER:
            rows, u = table.phase_crossings()
            numbers = numbers_at(table.loops, rows, u)
            order = np.lexsort((self.value(numbers), rows))
            value, where = np.full(m, np.inf), np.zeros(m)
            found, first = np.unique(rows[order], return_index=True)
            value[found], where[found] = self.slack(numbers, nominal_margin)[order][first], u[order][first]
            return _Worst.at(value, where)
        sides = table.sides()
        worst = self.at_crossovers(table.loops, table.gain_crossings(), sides, nominal_margin)
        # Without a gain crossover a constraint is violated the more, the farther |L| stays from 1; but there a margin
        # of a stable loop is infinite.
        away, where = table.nearest_to_crossover()
        met = sides.stable & np.where(away > 0.0, self.met_above_one, self.met_below_one)
        absent = np.setdiff1d(np.arange(m), table.gain_crossings().row)
        worst.slack[absent] = np.where(met, np.inf, -1.0 - np.abs(away))[absent]
        worst.u[absent] = where[absent]
        return worst

    def at_crossovers(self, loops: Loops, crossings: Crossings, sides: Sides, nominal_margin: float) -> _Worst:
        """The slack at the crossover that decides of each loop; inf where there is none."""
        m, rows, u = len(loops), crossings.row, crossings.u
        numbers = numbers_at(loops, rows, u, sides.side, sides.angle_rad)
        order = np.lexsort((-u if self.highest else self.value(numbers), rows))
        found, first = np.unique(rows[order], return_index=True)
        at = order[first]
        worst = _Worst(np.full(m, np.inf), np.zeros(m), np.ones(m), np.zeros(m))
        worst.slack[found], worst.u[found] = self.slack(numbers, nominal_margin)[at], u[at]
        worst.side[found], worst.angle_rad[found] = sides.side[at], sides.angle_rad[at]
        return worst


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
        quantity.natural, 0.0, *_met_without_crossover(constraint),
    )  # fmt: skip


def _met_without_crossover(constraint: Constraint) -> tuple[bool, bool]:
    """Whether a stable loop with |L| < 1 everywhere meets it, and one with |L| > 1 everywhere.

    The phase margin of both is infinite; the delay margin of the first is, that of the second is 0.
    """
    if not constraint.quantity.is_margin or constraint.bound is Bound.EQUAL:
        return False, False
    lower, of_delay = constraint.bound is Bound.LOWER, constraint.quantity.name == "delay_margin_s"
    return lower, lower is not of_delay


def _objective_probe(objective: ObjectiveKind, horizon_s: float) -> tuple[_Probe, ...]:
    """The objective as a probe whose slack is minus its value; none for those without a worst member."""
    ends = (-math.inf, math.inf)
    if objective is ObjectiveKind.SENSITIVITY_PEAK:
        return (_Probe(None, _Kind.BAND, False, False, *ends, lambda n, _: n.log_return_difference),)
    if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
        return (_Probe(None, _Kind.BAND, False, False, *ends, lambda n, _: n.log_return_difference - n.log_controller),)
    if objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
        return (_Probe(None, _Kind.GAIN_CROSSOVER, False, False, *ends, lambda n, m: -np.abs(n.phase_margin_rad - m)),)
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
