"""Points -> second-order cone constraints on a small step d of the scaled gains x = (kp, ki).

For fixed alpha C = kp + ki F, F = s^-alpha or its filter, and L = C P are affine in x.  Every frequency function is
|N|/|D| of two affine functions of x, and with e = D(x0)/|D(x0)|

    |N| <= M |D|      is implied by      |N(x0 + d)| <= M Re(conj(e) D(x0 + d)) ,                                    (1)

a second-order cone: convex on the left, linearised on the right, exact at d = 0.  A quantity at a crossing u_c changes
with the crossing, too: with l = ln L,  dl/dx = (1, F)/C,  and

    gain crossover    du_c/dx = -Re(dl/dx)/Re(dl/du) ,        phase crossover    du_c/dx = -Im(dl/dx)/Im(dl/du) ,    (2)

which gives a half-plane of d.  Rows are scaled so that a row's slack at d = 0 is in neper or radian.

Source: derived; (1) since Re(conj(e) z) <= |z| for |e| = 1, (2) by the implicit function theorem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fopi_tune.convex.evaluate import (
    OBJECTIVE,
    PEAKS,
    ConstraintPoints,
    Evaluation,
    at_inverse_horizon,
    counts_in_depth,
)
from fopi_tune.convex.limits import Bound, Limit, Task
from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

#: step of u for the second derivative of ln L
_STEP = 1e-5
#: slopes of gain (or phase) at a crossing are kept at least this large, so that (2) stays finite
_FLAT = 1e-9


@dataclass(frozen=True)
class ConeConstraints:
    """n rows  |cone d + cone0| <= slope d + slack0 + share t ,  and k equalities  equal_slope d = distance.

    Args:
        cone: complex, shape (n, 2).
        cone0: complex, shape (n,).
        slope: shape (n, 2).
        slack0: shape (n,).
        share: shape (n,), coefficient of t, the change of the objective's largest member.
        elastic: shape (n,), 1 for a requirement's row, which may be violated in `restore`; 0 for the objective's.
        group: shape (n,), index of a row's limit, or OBJECTIVE.
        equal_slope: shape (k, 2).
        distance: shape (k,).
    """

    cone: Complex
    cone0: Complex
    slope: Array
    slack0: Array
    share: Array
    elastic: Array
    group: Rows
    equal_slope: Array
    distance: Array

    @property
    def slack(self) -> Array:
        """The slack at d = 0 and t = 0, shape (n,)."""
        return self.slack0 - np.abs(self.cone0)

    def tightest(self, most: int, of_each: int) -> ConeConstraints:
        """At most `most` rows: the `of_each` with the smallest slack of every limit, then the smallest of all."""
        order = np.lexsort((self.slack, self.group))
        _, first, count = np.unique(self.group[order], return_index=True, return_counts=True)
        place = np.zeros(len(order), dtype=np.intp)
        place[order] = np.arange(len(order)) - np.repeat(first, count)
        chosen = np.lexsort((self.slack, place >= of_each))[:most]
        return self.take(chosen)

    def take(self, rows: Rows) -> ConeConstraints:
        """Select rows; all equalities are kept."""
        names = ("cone", "cone0", "slope", "slack0", "share", "elastic", "group")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def constraints_at(task: Task, found: Evaluation, plants: Plants, points: ConstraintPoints) -> ConeConstraints:
    """The constraints at these points, linearised at the gains of `found`.

    Args:
        task: limits and objective.
        found: the gains and their cost.
        plants: the points' plants.
        points: of limits and of the objective, not necessarily those of `found`.
    """
    responses = _Responses.at(task, found, plants, points)
    table = _Builder(task, found, responses, points)
    for k, limit in enumerate(task.limits):
        mine = np.flatnonzero(points.limit == k)
        if len(mine):
            table.limit(k, limit, mine)
    mine = np.flatnonzero((points.limit == OBJECTIVE) & np.isfinite(points.slack))
    if len(mine):
        table.objective(mine)
    return table.built()


@dataclass(frozen=True)
class _Responses:
    """Responses and their derivatives with respect to x at n points."""

    plant: Complex
    controller: Complex
    d_controller: Complex
    log_loop: Complex
    d_log_loop: Complex
    slope: Complex
    loops: Loops
    rows: Rows
    u: Array
    d_integral: Complex
    unit: Array
    ki: float
    side: Array

    @classmethod
    def at(cls, task: Task, found: Evaluation, plants: Plants, points: ConstraintPoints) -> _Responses:
        gains, u, rows = found.gains, points.u, points.plant
        loops = task.kind.loops(gains, plants)
        unit = task.unit(gains.alpha)
        integral, d_integral = task.kind.integral(gains.alpha, u)
        controller: Complex = gains.kp + gains.ki * integral
        d_controller: Complex = np.stack([np.full(len(u), unit[0] + 0j), unit[1] * integral], axis=1)
        log_loop, slope = loops.log_response_and_slope(rows, u)
        with np.errstate(all="ignore"):
            plant = task.kind.plant_response(plants, rows, u)
            d_log_loop: Complex = d_controller / controller[:, None]
        return cls(
            plant, controller, d_controller, log_loop, d_log_loop, slope, loops, rows, u,
            d_integral, unit, gains.ki, points.side,
        )  # fmt: skip

    def parts(self, response: Response, at: Rows) -> tuple[Complex, Complex, Complex, Complex]:
        """N, dN/dx, D, dD/dx of a response."""
        c, dc, p = self.controller[at], self.d_controller[at], self.plant[at]
        loop, d_loop = c * p, dc * p[:, None]
        one, none = np.ones(len(at), dtype=complex), np.zeros((len(at), 2), dtype=complex)
        if response is Response.LOOP_GAIN:
            return loop, d_loop, one, none
        top = {
            Response.SENSITIVITY: (one, none),
            Response.COMPLEMENTARY_SENSITIVITY: (loop, d_loop),
            Response.LOAD_SENSITIVITY: (p, none),
        }
        return *top.get(response, (c, dc)), 1.0 + loop, d_loop

    def crossover_moves(self, at: Rows) -> Array:
        """du_c/dx of gain crossovers, by (2)."""
        return -self.d_log_loop[at].real / _steep(self.slope[at].real)[:, None]

    def read(self, quantity: str, at: Rows) -> tuple[Array, Array]:
        """A quantity at its crossing and its total derivative with respect to x, by (2)."""
        d_loop, slope = self.d_log_loop[at], self.slope[at]
        if quantity == "gain_margin_db":
            moves = -d_loop.imag / _steep(slope.imag)[:, None]
            moves = np.where(np.abs(self.u[at])[:, None] < 99.0, moves, 0.0)
            return -self.log_loop[at].real, -(d_loop.real + slope.real[:, None] * moves)
        moves = self.crossover_moves(at)
        omega, stretch = self.loops.omega_of(self.u[at]), self.loops.stretch(self.u[at])
        if quantity == "crossover_rad_s":
            return np.log(omega), stretch[:, None] * moves
        if quantity == "phase_slope_deg_per_decade":
            return self._phase_slope(at, moves)
        # the angle from -1 to L, in (-pi, pi]
        angle = np.pi - np.mod(-self.log_loop[at].imag, 2.0 * np.pi)
        d_angle = d_loop.imag + slope.imag[:, None] * moves
        side = self.side[at]
        if quantity == "phase_margin_deg":
            return side * angle, side[:, None] * d_angle
        lag = angle + np.pi * (1.0 - side)
        return lag / omega, (d_angle - (lag * stretch)[:, None] * moves) / omega[:, None]

    def _phase_slope(self, at: Rows, moves: Array) -> tuple[Array, Array]:
        """d arg L/d ln omega = Im (d ln L/du)/h, with h = d ln omega/du."""
        c, dc, rows, u = self.controller[at], self.d_controller[at], self.rows[at], self.u[at]
        # d ln C/du = ki F'/C; by the product rule, ki and 1/C are differentiated in turn
        own = self.ki * self.d_integral[at] / c
        d_own = -own[:, None] * dc / c[:, None]
        d_own[:, 1] += self.unit[1] * self.d_integral[at] / c
        loops = self.loops
        ends = [loops.log.derivative(rows, u + step).imag / loops.stretch(u + step) for step in (_STEP, -_STEP)]
        bend = (ends[0] - ends[1]) / (2.0 * _STEP)
        decade, stretch = np.log(10.0), loops.stretch(u)
        value = decade * self.slope[at].imag / stretch
        return value, decade * (d_own.imag / stretch[:, None] + bend[:, None] * moves)


class _Builder:
    """Collects the rows of all limits and of the objective."""

    def __init__(self, task: Task, found: Evaluation, responses: _Responses, points: ConstraintPoints) -> None:
        self.task, self.found, self.responses, self.points = task, found, responses, points
        self.parts: list[tuple[Complex, Complex, Array, Array, Array, Array, Rows]] = []
        self.group = OBJECTIVE
        self.hard = True
        self.equal: list[tuple[Array, Array]] = []

    def built(self) -> ConeConstraints:
        empty = [np.zeros(0) for _ in range(3)]
        none = (np.zeros((0, 2), complex), np.zeros(0, complex), np.zeros((0, 2)), *empty, np.zeros(0, dtype=np.intp))
        columns: list[Any] = [np.concatenate(column) for column in zip(none, *self.parts, strict=True)]
        slopes = np.concatenate([np.zeros((0, 2)), *(slope for slope, _ in self.equal)])
        distances = np.concatenate([np.zeros(0), *(distance for _, distance in self.equal)])
        table = ConeConstraints(*columns, equal_slope=slopes, distance=distances)
        usable = np.isfinite(table.slack) & np.isfinite(table.slope).all(axis=1) & np.isfinite(table.cone).all(axis=1)
        return table.take(np.flatnonzero(usable))

    def limit(self, k: int, limit: Limit, mine: Rows) -> None:
        """Add the rows of one limit; where the depth is the objective, its slack must be at least depth - t."""
        self.group, self.hard = k, True
        deep = self.task.objective is ObjectiveKind.DEPTH and counts_in_depth(limit)
        depth = -self.found.cost if deep and np.isfinite(self.found.cost) else 0.0
        share = 1.0 if deep else 0.0
        missing = self.points.missing[mine]
        self._approach_crossover(mine[missing & np.isfinite(self.points.slack[mine])])
        mine = mine[~missing]
        if limit.bound is Bound.EQUAL:
            self._equality(limit, mine)
        elif limit.where is EvaluatedAt.BAND:
            level = limit.limit - limit.bound.value * depth / limit.scale
            self._cones(limit.response, limit.bound, level, mine, share)
        else:
            value, slope = self.responses.read(limit.quantity, mine)
            slack = limit.bound.value * (limit.limit - value) * limit.scale - depth
            self._planes(-limit.bound.value * limit.scale * slope, slack, share)

    def _equality(self, limit: Limit, mine: Rows) -> None:
        if not len(mine):
            return
        if limit.where is EvaluatedAt.BAND:
            assert limit.response is not None
            top, d_top, bottom, d_bottom = self.responses.parts(limit.response, mine)
            value = np.log(np.abs(top)) - np.log(np.abs(bottom))
            slope = (d_top / top[:, None] - d_bottom / bottom[:, None]).real
        else:
            value, slope = self.responses.read(limit.quantity, mine)
        self.equal.append((limit.scale * slope[:1], limit.scale * (limit.limit - value[:1])))

    def _cones(self, response: Response | None, bound: Bound, level: float, mine: Rows, share: float) -> None:
        """Add rows (1); a lower limit exchanges N and D."""
        assert response is not None
        top, d_top, bottom, d_bottom = self.responses.parts(response, mine)
        most = np.exp(level)
        if bound is Bound.LOWER:
            top, d_top, bottom, d_bottom, most = bottom, d_bottom, top, d_top, 1.0 / most
        with np.errstate(all="ignore"):
            size = np.abs(bottom)
            ratio = np.abs(top) / (most * size)
            off = ratio - 1.0
            # scale the row so that its slack 1 - ratio becomes -ln ratio, in neper
            unit = np.where(np.abs(off) > 1e-9, np.log(ratio) / np.where(off == 0.0, 1.0, off), 1.0)
            unit = np.where(ratio > 1e-12, unit, 1.0)
            slope = unit[:, None] * (d_bottom * np.conj(bottom)[:, None]).real / size[:, None] ** 2
            cone = (unit / (most * size))[:, None] * d_top
            self._add(cone, unit * top / (most * size), slope, unit, share)

    def _planes(self, slope: Array, slack: Array, share: float) -> None:
        self._add(np.zeros(slope.shape, complex), np.zeros(len(slack), complex), slope, slack, share)

    def _approach_crossover(self, mine: Rows) -> None:
        """Require |L| = 1 to be reached where |L| is closest to 1, for a plant without a gain crossover."""
        gain = self.responses.log_loop[mine].real
        sign = np.where(gain < 0.0, 1.0, -1.0)
        self._planes(sign[:, None] * self.responses.d_log_loop[mine].real, sign * gain, 0.0)

    def _add(self, cone: Complex, cone0: Complex, slope: Array, slack0: Array, share: float) -> None:
        n = len(slack0)
        elastic, group = np.full(n, 1.0 if self.hard else 0.0), np.full(n, self.group, dtype=np.intp)
        self.parts.append((cone, cone0, slope, slack0, np.full(n, share), elastic, group))

    def objective(self, mine: Rows) -> None:
        """Add rows of the objective: its value in natural units is at most cost + t at each point."""
        self.group, self.hard = OBJECTIVE, False
        kind, cost = self.task.objective, self.found.cost
        if kind in PEAKS:
            self._cones(PEAKS[kind], Bound.UPPER, cost, mine, 1.0)
        elif kind is ObjectiveKind.IAE_DISTURBANCE:
            self._iae_disturbance(mine)
        elif kind is ObjectiveKind.CROSSOVER_SPREAD:
            value, slope = self._at_nominal_crossover(mine)
            self._two_sided(value, slope)
        elif kind is ObjectiveKind.PHASE_MARGIN_SPREAD:
            value, slope = self.responses.read("phase_margin_deg", mine)
            nominal = int(np.flatnonzero(self.points.plant[mine] == 0)[0])
            self._two_sided(value - value[nominal], slope - slope[nominal])
        elif kind not in (ObjectiveKind.KI, ObjectiveKind.DEPTH):
            # those two are in the program itself
            raise DomainError(f"the convex path has no rows for the objective {kind.value}")

    def _two_sided(self, value: Array, slope: Array) -> None:
        for sign in (1.0, -1.0):
            empty = np.zeros(slope.shape, complex), np.zeros(len(value), complex)
            self._add(*empty, -sign * slope, self.found.cost - sign * value, 1.0)

    def _at_nominal_crossover(self, mine: Rows) -> tuple[Array, Array]:
        nominal = mine[self.points.plant[mine] == 0][:1]
        moves = self.responses.crossover_moves(nominal)
        slope = self.responses.d_log_loop[mine].real + self.responses.slope[mine].real[:, None] * moves
        return self.responses.log_loop[mine].real, slope

    def _iae_disturbance(self, mine: Rows) -> None:
        """iae_disturbance: (1 + C P)/(T P) at s = 1/T is affine in x; only the bound's e^-t is linearised, as 1 - t."""
        loops = self.responses.loops.take(self.points.plant[mine])
        gain, loop, d_loop = at_inverse_horizon(self.task, loops)
        with np.errstate(divide="ignore", invalid="ignore"):
            least = np.abs(gain) * np.exp(-self.found.cost)  # |1 + C P| where this plant would be the worst
            slope = np.sign(1.0 + loop)[:, None] * d_loop * self.responses.unit / least[:, None]
            slack = np.abs(1.0 + loop) / least - 1.0
        empty = np.zeros(slope.shape, complex), np.zeros(len(slack), complex)
        self._add(*empty, slope, slack, 1.0)


def _steep(slope: Array) -> Array:
    return np.where(np.abs(slope) > _FLAT, slope, np.where(slope < 0.0, -_FLAT, _FLAT))
