"""The oracle of the exchange:  gains -> the plants and frequencies where each constraint is violated most.

Every constraint is evaluated on a grid of plants times frequencies, and at the ends of the frequency axis.  The worst
plants are then refined by pattern search on shrinking stars, and the worst frequencies by Newton's method or on the
same stars.  The result is a set of cuts, not a proof: `fopi_tune.proof` checks the gains by other means, and the
violations it finds are added as cuts, and as places where the oracle looks from then on.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.box_grid import BoxGrid
from fopi_tune.design.constraints import Constraint, Scale
from fopi_tune.design.loop_grid import LoopGrid, Track, numbers_at, part_of, tracked
from fopi_tune.design.margin_sides import sides_of
from fopi_tune.design.polish import minimised
from fopi_tune.design.probes import Finding, Kind, Probe, objective_probes, probes_of
from fopi_tune.quantities.objectives import ObjectiveKind

#: how often a refinement star shrinks, by how much, and how many rounds there are
_MOST_SHRINKS = 8
_ZOOM_FACTOR = 0.35
_MOST_ROUNDS = 20
#: natural units; a star of full size that finds less is not moved again
_SAME_PLACE = 1e-6
#: natural units; a refined slack that differs more from the one of all crossovers was read at the wrong one
_SAME_SLACK = 1e-6
#: offsets in ln omega within a refinement star, as multiples of its radius
_U_STAR = np.array([0.0, -1.0, -0.5, 0.5, 1.0])

#: a probe and what it found at first
Task = tuple[Probe, Finding]


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
        self.family, self.omega_grid = family, scale.omega_grid
        self.box = BoxGrid.of(family)
        self.plants = Plants.members(family, self.box.points)
        self.of_constraints, self.of_objective = probes_of(constraints), objective_probes(objective, horizon_s)

    def with_constraints(self, constraints: tuple[Constraint, ...]) -> Oracle:
        """The same search with other limits of the same constraints."""
        other = copy.copy(self)
        other.of_constraints = probes_of(constraints)
        return other

    def with_places(self, points: Sequence[tuple[float, ...]], omega_rad_s: Sequence[float]) -> Oracle:
        """The same search, which looks at these plants and frequencies too."""
        other = copy.copy(self)
        other.box = self.box.with_points(np.array(points, dtype=float))
        other.plants = Plants.members(self.family, other.box.points)
        other.omega_grid = np.unique(np.concatenate([self.omega_grid, omega_rad_s]))
        return other

    def slack(self, constraint: int, theta: tuple[float, ...], omega_rad_s: float, gains: FoPi) -> float:
        """The slack of a function of frequency at one plant and frequency."""
        loops = Loops.of(gains, Plants.members(self.family, np.array([theta]).reshape(1, -1)))
        at_end = not 0.0 < omega_rad_s < math.inf
        for probe in self.of_constraints:
            if probe.constraint == constraint and (not at_end or probe.at_omega_rad_s == omega_rad_s):
                u = np.zeros(1) if at_end else np.log([omega_rad_s])
                return float(probe.slack_at(numbers_at(loops, np.zeros(1, dtype=np.intp), u), loops, math.nan)[0])
        return math.inf

    def worst(self, gains: FoPi, within: float = math.inf) -> list[Finding]:
        """The worst plants and frequencies of every constraint and of the objective.

        Args:
            gains: the controller.
            within: constraints whose slack on the grid is at least this are not refined.
        """
        table = LoopGrid(gains, self.plants, self.omega_grid)
        nominal_margin, nominal_u = table.nominal()
        rough: list[Task] = []
        for probe in (*self.of_constraints, *self.of_objective):
            worst = probe.on_grid(table, nominal_margin, nominal_u)
            for i in [0] if probe.nominal else self.box.worst_rows(worst.slack, few=probe.kind is Kind.END):
                found = worst.finding(probe.constraint, i, self.box.points[i])
                rough += [(probe, each) for each in probe.places(table, nominal_margin, i, found)]
        exact = [f for _, f in rough if f.slack > within and f.constraint is not None]
        near = [(probe, f) for probe, f in rough if not (f.slack > within and f.constraint is not None)]
        return exact + self._confirmed(gains, near, self._refined(gains, near, nominal_margin), nominal_margin)

    def _confirmed(
        self, gains: FoPi, tasks: list[Task], refined: list[Finding], nominal_margin: float
    ) -> list[Finding]:
        """The refined findings, those at gain crossovers compared with all crossovers of their plant.

        From one plant of a star to the next a crossover may be lost for another one, or a loop become unstable.
        """
        asked = [i for i, (probe, _) in enumerate(tasks) if probe.kind is Kind.GAIN_CROSSOVER]
        if not asked:
            return refined
        loops = Loops.of(gains, Plants.members(self.family, np.array([refined[i].theta for i in asked])))
        crossings = gain_crossovers(loops)
        sides = sides_of(loops, crossings)
        best = list(refined)
        for row, i in enumerate(asked):
            probe, rough = tasks[i]
            worst = probe.at_crossovers(loops, crossings, sides, nominal_margin)
            if abs(worst.slack[row] - refined[i].slack) > _SAME_SLACK:
                best[i] = min(rough, worst.finding(rough.constraint, row, refined[i].theta), key=lambda f: f.slack)
        return best

    def _refined(self, gains: FoPi, tasks: list[Task], nominal_margin: float) -> list[Finding]:
        """Pattern search on stars in plant and frequency, all of a round in one batch.

        A star shrinks unless it found something worse on its rim.
        """
        best, shrinks = [found for _, found in tasks], [0] * len(tasks)
        widest = float(np.diff(np.log(self.omega_grid)).max())
        u_radius = [self._u_radius(probe, found, widest) for probe, found in tasks]
        for _ in range(_MOST_ROUNDS):
            active = [i for i, count in enumerate(shrinks) if count < _MOST_SHRINKS]
            if not active:
                break
            sizes = [_ZOOM_FACTOR ** shrinks[i] for i in active]
            offers = [
                self._offer(tasks[i][0], best[i], size, size * u_radius[i])
                for i, size in zip(active, sizes, strict=True)
            ]
            found = self._best_of(gains, [(tasks[i][0], best[i]) for i in active], offers, nominal_margin)
            for i, size, (better, on_rim) in zip(active, sizes, found, strict=True):
                moved = better.slack < best[i].slack - _SAME_PLACE * size
                best[i], shrinks[i] = better, shrinks[i] + (not (moved and on_rim))
        return [
            self._polished(gains, probe, found, widest, nominal_margin)
            for (probe, _), found in zip(tasks, best, strict=True)
        ]

    def _polished(self, gains: FoPi, probe: Probe, found: Finding, widest: float, nominal_margin: float) -> Finding:
        """A plant inside of the box and its frequency, moved together to where the slack is smallest."""
        free = (found.theta > self.box.low) & (found.theta < self.box.high)
        if not probe.moves_u or probe.nominal or found.track is not Track.STAY or not free.any():
            return found

        def places(offsets: Array) -> tuple[Array, Array]:
            steps = np.zeros((len(offsets), len(free)))
            steps[:, free] = offsets[:, :-1]
            u = probe.clipped(math.log(found.omega_rad_s) + widest * offsets[:, -1])
            return self.box.around(found.theta, steps * self.box.spacing), u

        def slack(offsets: Array) -> Array:
            points, u = places(offsets)
            loops = Loops.of(gains, Plants.members(self.family, points))
            return probe.slack_at(numbers_at(loops, np.arange(len(u)), u), loops, nominal_margin)

        best = minimised(slack, int(free.sum()) + 1)[None, :]
        if not best.any():
            return found
        points, u = places(best)
        return replace(found, slack=float(slack(best)[0]), theta=points[0], omega_rad_s=float(np.exp(u[0])))

    def _best_of(
        self, gains: FoPi, tasks: list[Task], offers: list[tuple[Array, Array, Array]], nominal_margin: float
    ) -> list[tuple[Finding, bool]]:
        """The worst of each star with what was known, and whether that is on the star's rim."""
        loops = Loops.of(gains, Plants.members(self.family, np.concatenate([points for points, _, _ in offers])))
        counts = [len(points) for points, _, _ in offers]
        known = [found for _, found in tasks]
        track = np.repeat([f.track.value for f in known], counts)
        side, angle = np.repeat([f.side for f in known], counts), np.repeat([f.angle_rad for f in known], counts)
        u = np.repeat([_finite_u(f) for f in known], counts)
        u = tracked(loops, u, track, angle - np.pi) + np.concatenate([offsets for _, offsets, _ in offers])
        split = zip(tasks, np.split(u, np.cumsum(counts)[:-1]), strict=True)
        u = np.concatenate([probe.clipped(part) for (probe, _), part in split])
        numbers = numbers_at(loops, np.arange(len(loops)), u, side, angle)
        result, first = [], 0
        for (probe, best), (points, _, on_rim), count in zip(tasks, offers, counts, strict=True):
            part = slice(first, first + count)
            first += count
            mine = loops if probe.of_loops is None else loops.take(np.arange(part.start, part.stop))
            value = probe.slack_at(part_of(numbers, part), mine, nominal_margin)
            q = int(np.argmin(value))
            if not value[q] < best.slack:
                result.append((best, False))
                continue
            worse = replace(
                best,
                slack=float(value[q]),
                theta=points[q],
                omega_rad_s=best.omega_rad_s if probe.kind is Kind.END else float(np.exp(u[part][q])),
                angle_rad=best.side * float(numbers.phase_margin_rad[part][q]),
            )
            result.append((worse, bool(on_rim[q])))
        return result

    def _u_radius(self, probe: Probe, found: Finding, widest: float) -> float:
        """How far in ln omega the refinement of a finding goes at first."""
        if not probe.moves_u:
            return 0.0
        if found.track is Track.STAY:
            return widest
        dead_time_s = Plants.members(self.family, found.theta[None, :]).dead_time_s[0]
        return float(np.pi / (2.0 * found.omega_rad_s * dead_time_s))

    def _offer(self, probe: Probe, best: Finding, size: float, u_radius: float) -> tuple[Array, Array, Array]:
        """Plants, offsets in ln omega, and which are on the rim, of one star; shapes (n, p), (n,) and (n,)."""
        around = self.box.star[:1] if probe.nominal else self.box.star
        points = self.box.around(best.theta, around * (size * self.box.spacing))
        steps = _U_STAR if u_radius > 0.0 else np.zeros(1)
        on_rim = (np.abs(around).max(axis=1, initial=0.0) >= 1.0)[:, None] | (np.abs(steps) >= 1.0)
        return np.repeat(points, len(steps), axis=0), np.tile(u_radius * steps, len(points)), on_rim.ravel()


def _finite_u(found: Finding) -> float:
    """ln omega; 0 at the ends of the axis, whose slacks need none."""
    return math.log(found.omega_rad_s) if 0.0 < found.omega_rad_s < math.inf else 0.0
