"""Requirements on the loop's frequency response as rows:  the worst plants and frequencies of the search of the box.

A cut is a finding of `global_search.worst_case`: a row, a plant and a frequency that follows its peak or crossing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.global_search.compiled import CROSSOVER_SPREAD, GAIN_AT_REFERENCE, KI, MARGIN_SPREAD, entry
from fopi_tune.design.global_search.controllers import controller_of
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.rays import fill_ray
from fopi_tune.design.global_search.responses import settle, value_at
from fopi_tune.design.global_search.samples import plant_of
from fopi_tune.design.global_search.slots import merged
from fopi_tune.design.global_search.worst_case import (
    FIELDS,
    MODE,
    NEAR,
    ROW,
    TARGET,
    V,
    highest_crossover,
    inner_slack,
    smallest_margin,
)
from fopi_tune.design.time_domain.numbers import Numbers

#: relative steps of the differences
_STEP = 1e-4


@entry
def cut_slacks(x, cuts, rows, family, sampling, low_v, high_v, horizon, reference, out):
    """The slack of each cut at gains x, its frequency settled anew.

    Args:
        x: the first three scaled numbers, as `controller_of` takes them: kp', ki', and alpha or kd'.
        cuts: shape (n, 6 + p).
        rows: of the problem, those of the objective last.
        family: the plants' coefficients.
        sampling: the filter.
        low_v, high_v: ends of the frequency grid.
        horizon: ln(T omega_s).
        reference: v of the nominal crossover.
        out: shape (n,).
    """
    controller, plant = controller_of(x, sampling), np.empty(family.terms.shape[1])
    for n in range(len(cuts)):
        cut = cuts[n]
        q, mode = int(cut[ROW]), int(cut[MODE])
        kind, side, limit, scale = rows.kind[q], rows.side[q], rows.limit[q], rows.scale[q]
        plant_of(family, cut[FIELDS:], plant)
        if kind == GAIN_AT_REFERENCE:
            out[n] = -abs(value_at(kind, controller, plant, reference, cut[NEAR]))
            continue
        low, high = max(rows.low_v[q], low_v), min(rows.high_v[q], high_v)
        value, _ = settle(
            kind, side, mode, controller, plant, cut[V], cut[NEAR], cut[TARGET], low, high, horizon, rows.tilt[q]
        )
        # of an equality the signed distance: its slack has a kink where it is met
        out[n] = (limit - value) * scale if side == 0 else inner_slack(side, limit, scale, value)


@dataclass
class LoopCuts:
    """The frequency requirements of one problem.

    Args:
        problem: on samples.
        pool: the cuts that are known, shape (6 + p,) each.
    """

    problem: Problem
    pool: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.polish, self.numbers = Polish(self.problem), Numbers(self.problem)

    def scaled(self, gains: FoPi) -> Array:
        """Scaled numbers of the controller, shape (n,)."""
        return self.problem.scale.scaled(gains)

    def look(self, gains: FoPi) -> Array | None:
        """The worst cases over the family; None where a plant is unstable or a quantity has no value."""
        return self.polish.look(self.scaled(gains))

    def learn(self, found: Array) -> None:
        """Keep worst cases as cuts."""
        self.pool = merged(self.pool, found)

    def violation(self, found: Array) -> float:
        """The largest violation of what must hold, natural units."""
        return self.polish.violation(found)

    @property
    def rows_of_pool(self) -> np.ndarray:
        """The row of each cut, shape (n,)."""
        return np.array([int(cut[ROW]) for cut in self.pool], dtype=int)

    def is_aim(self, rows: np.ndarray) -> np.ndarray:
        """Which rows are the objective's, shape (n,)."""
        return self.polish.in_t[rows] != 0.0

    def is_equality(self, rows: np.ndarray) -> np.ndarray:
        """Which rows are equalities, shape (n,)."""
        return self.polish.rows.side[rows] == 0

    def slacks(self, gains: FoPi) -> tuple[Array, Array]:
        """The slack of each of m cuts in the pool, natural units, and its slopes by the controller's n numbers.

        Of an equality it is limit - value.  Shapes (m,) and (m, n).
        """
        x, count = self.scaled(gains), len(self.pool)
        if not count:
            return np.zeros(0), np.zeros((0, self.numbers.count))
        structure, cuts, size = self.problem.structure, np.array(self.pool), np.ones(len(x))
        names, linear = structure.names, structure.linear
        size[:linear] = 0.05 * structure.size(x) + np.abs(x[:linear])
        values, slopes = self._slacks(x, cuts), np.empty((count, len(x)))
        for j in range(len(x)):
            step = np.zeros(len(x))
            step[j] = _STEP * size[j]
            slopes[:, j] = (self._slacks(x + step, cuts) - self._slacks(x - step, cuts)) / (2.0 * step[j])
        # a scaled gain is the gain times g omega_s^-alpha or g omega_s^mu, and so changes with its order
        log_omega = np.log(self.problem.scale.omega_rad_s)
        for gain, order, sign in (("ki", "alpha", -1.0), ("kd", "mu", 1.0)):
            if order in names:
                place = names.index(gain)
                slopes[:, names.index(order)] += sign * log_omega * x[place] * slopes[:, place]
        # the loop does not depend on the setpoint's weight
        slopes = np.pad(slopes, ((0, 0), (0, self.numbers.count - len(x))))
        return values, slopes / self.numbers.units(x)

    def _slacks(self, x: Array, cuts: Array) -> Array:
        polish, out, reference = self.polish, np.empty(len(cuts)), 0.0
        rows, (x, table) = polish.rows, polish.at(x)
        if polish.code in (MARGIN_SPREAD, CROSSOVER_SPREAD):
            fill_ray(x[2], x[0], x[1], table, polish.work)
            if polish.code == MARGIN_SPREAD:
                nominal = smallest_margin(x, table, polish.work)[0]
                rows = rows._replace(limit=np.concatenate([rows.limit[: polish.real_rows], [nominal, nominal]]))
            else:
                reference = highest_crossover(x, table, polish.work)[0]
        cut_slacks(
            x, cuts, rows, self.problem.scaled.plants, table.sampling, table.v[1], table.v[-2],
            self.problem.box.log_horizon, reference, out,
        )  # fmt: skip
        return out

    @property
    def maximises_ki(self) -> bool:
        """Whether the objective is ki itself."""
        return self.polish.code == KI
