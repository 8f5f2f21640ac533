"""A second opinion on loops:  spec and gains -> requirement values on dense grids, by NumPy alone.

Written from DESIGN.md's definitions and sharing no code with the package but the spec's own types: responses by
polynomials, phases by `np.unwrap` from very low frequency, crossings by scan and bracketing, stability by following the
argument of 1 + L along the whole contour.  Values are in natural units: neper, radian, a delay margin relative to it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

NEPER_PER_DB = np.log(10.0) / 20.0
#: stands for "not even defined" (no crossover) and for infinite margins, in neper or radian
FAR = 10.0
#: ln omega; a loop has at most one peak in so narrow a part of a band
PART = 0.7


@dataclass(frozen=True)
class Gains:
    kp: float
    ki: float
    alpha: float

    def response(self, s):
        return self.kp + self.ki * s**-self.alpha


@dataclass(frozen=True)
class Evaluation:
    """What a controller achieves: `objective` rows are to be minimised in their maximum, `excess` rows must be <= 0."""

    objective: np.ndarray
    excess: np.ndarray
    equalities: np.ndarray
    unstable: int

    @property
    def violation(self) -> float:
        if self.unstable:
            return FAR * (1 + self.unstable)
        return float(max(0.0, *self.excess, *np.abs(self.equalities), 0.0))


def coefficients(spec: DesignSpec, per_axis: int):
    """Members of the family, the nominal one first: numerators (m, a), denominators (m, b), dead times (m,)."""
    numbers = spec.plant.parameters
    uncertain = [name for name, number in numbers.items() if number.min < number.max]
    axes = [np.linspace(numbers[n].min, numbers[n].max, per_axis) for n in uncertain]
    points = [[numbers[n].nominal for n in uncertain], *map(list, itertools.product(*axes))] if uncertain else [[]]
    return member_coefficients(spec, np.array(points, dtype=float).reshape(len(points), len(uncertain)))


def member_coefficients(spec: DesignSpec, points: np.ndarray):
    """Coefficients of the members at these places of the box; columns in the order of the uncertain numbers."""
    numbers = spec.plant.parameters
    uncertain = [name for name, number in numbers.items() if number.min < number.max]
    rows = []
    for point in points:
        p = {name: number.nominal for name, number in numbers.items()} | dict(zip(uncertain, point, strict=True))
        if spec.plant.model == "lag":
            top, bottom = [p["static_gain"]], [p["time_constant_s"], 1.0]
        elif spec.plant.model == "pole":
            top, bottom = [p["gain"]], [1.0, p["pole_rad_s"]]
        else:
            top = [v for k, v in p.items() if k.startswith("numerator")]
            bottom = [v for k, v in p.items() if k.startswith("denominator")]
        rows.append((top, bottom, p["dead_time_s"]))
    tops, bottoms, delays = zip(*rows, strict=True)
    return np.array(tops, float), np.array(bottoms, float), np.array(delays, float)


class Loops:
    """The loops of a spec's family on dense grids.

    Args:
        spec: the problem.
        per_axis: members along each axis of the box (the nominal one comes first, besides).
        density: frequencies a decade around the plant's own.
        exact: whether crossings and extremes are polished between the grid's points.
    """

    def __init__(
        self, spec: DesignSpec, per_axis: int | None = None, density: int = 120, exact: bool = True, points=None
    ):
        axes = sum(number.min < number.max for number in spec.plant.parameters.values())
        per_axis = per_axis or {0: 1, 1: 21, 2: 9}.get(axes, 5)
        self.spec, self.exact = spec, exact
        self.top, self.bottom, self.delay = (
            coefficients(spec, per_axis) if points is None else member_coefficients(spec, points)
        )
        self.poles = [np.roots(b) for b in self.bottom]
        self.zeros = [np.roots(t) for t in self.top]
        self.right = np.array([int(np.sum(p.real > 1e-9 * np.abs(p).max(initial=0.0))) for p in self.poles])
        self.integrators = np.array(
            [np.sum(p == 0) - np.sum(z == 0) for p, z in zip(self.poles, self.zeros, strict=True)]
        )
        self.omega = self._grid(density)
        rows = np.arange(len(self.top))[:, None]
        p = self._plant(rows, 1j * self.omega[None, :])
        self.p_gain, self.p_phase = np.log(np.abs(p)), np.unwrap(np.angle(p), axis=1)
        self.arc = self.omega[0] * np.exp(1j * np.linspace(0.0, np.pi / 2, 60))
        self.p_arc = self._plant(rows, self.arc[None, :]) * np.exp(-self.arc[None, :] * self.delay[:, None])

    def _grid(self, density: int) -> np.ndarray:
        roots = np.concatenate([*self.poles, *self.zeros])
        corners = [*np.abs(roots[np.abs(roots) > 0]), *(1 / d for d in self.delay if d > 0)]
        asked = [w for r in self.spec.requirements for w in (r.from_rad_s, r.to_rad_s) if 0 < w < np.inf]
        asked += [w for r in self.spec.requirements if r.quantity == "crossover_rad_s" for w in r.limits]
        own = np.array(corners + asked or [1.0])
        self.own = float(np.exp(np.log(own).mean()))
        low, high = np.log10(own.min()) - 3, np.log10(own.max()) + 3
        self.middle = np.log(own.min()) - 3.0, np.log(own.max()) + 3.0
        parts = [
            10 ** np.arange(low, high, 1 / density),
            10 ** np.arange(low - 12, low, 0.1),
            10 ** np.arange(high, high + 12, 0.1),
            np.array(asked),
        ]
        for root in roots[(np.abs(roots.real) < 0.3 * np.abs(roots)) & (roots.imag > 0)]:  # resonances are narrow
            parts.append(np.abs(root.imag) + np.abs(root.real) * np.tan(np.linspace(-1.5, 1.5, density // 3)))
        grid = np.unique(np.concatenate(parts))
        # A band's ends stay; others that all but coincide with a neighbour would only magnify rounding.
        crowded = np.append(False, np.diff(grid) < 1e-4 * grid[1:]) & ~np.isin(grid, asked)
        late = np.append(np.isin(grid[1:], asked) & (np.diff(grid) < 1e-4 * grid[1:]), False) & ~np.isin(grid, asked)
        return grid[~crowded & ~late & (grid > 0)]

    def _plant(self, rows, s):
        """P(s) without its dead time; rows and s broadcast."""

        def polynomial(table):
            value = np.zeros(np.broadcast_shapes(np.shape(rows), np.shape(s)), dtype=complex)
            for column in table.T:
                value = value * s + column[rows]
            return value

        return polynomial(self.top) / polynomial(self.bottom)

    def _start_phase(self, gains: Gains) -> np.ndarray:
        """arg L as omega -> 0: -90 deg alpha, -90 deg an integrator, -180 deg a right pole and for a negative sign."""
        at_low = self._plant(np.arange(len(self.top)), self.omega[0])  # on the positive real axis
        sign = np.sign(at_low.real) * (-1.0) ** self.right * np.sign(gains.ki or gains.kp)
        order = gains.alpha if gains.ki else 0.0
        return -np.pi * (0.5 * order + 0.5 * self.integrators + self.right + (sign < 0))

    def _loop(self, gains: Gains, rows, omega):
        s = 1j * omega
        return gains.response(s) * self._plant(rows, s) * np.exp(-s * self.delay[rows])

    def on_grid(self, gains: Gains):
        """ln|L| and unwrapped arg L, dead time left out of the second, shape (m, w)."""
        c = gains.response(1j * self.omega)
        phase = self.p_phase + np.unwrap(np.angle(c))
        phase += 2 * np.pi * np.round((self._start_phase(gains) - phase[:, 0]) / (2 * np.pi))[:, None]
        return self.p_gain + np.log(np.abs(c)), phase

    def unstable_poles(self, gains: Gains) -> np.ndarray:
        """Closed-loop poles on the right of every member: Z = P - (turn of arg(1 + L) over the upper contour)/pi."""
        gain, phase = self.on_grid(gains)
        f = 1 + np.exp(gain + 1j * (phase - self.omega * self.delay[:, None]))
        angle = np.angle(np.concatenate([1 + self.p_arc * gains.response(self.arc), f], axis=1))
        steps = (np.diff(angle, axis=1) + np.pi) % (2 * np.pi) - np.pi
        for row, k in np.argwhere(np.abs(steps) > 0.7):  # look closer where the grid may have lost a turn
            if k >= len(self.arc):
                fine = np.geomspace(self.omega[k - len(self.arc)], self.omega[k - len(self.arc) + 1], 200)
                turn = np.unwrap(np.angle(1 + self._loop(gains, np.full(200, row), fine)))
                steps[row, k] = turn[-1] - turn[0]
        start = np.where(np.abs(angle[:, 0]) > 1, np.pi, 0.0)
        end = np.round((start + steps.sum(axis=1)) / np.pi) * np.pi
        return self.right - np.round((end - start) / np.pi).astype(int)

    def _crossings(self, gains: Gains, values, function):
        """(row, omega) where `values` on the grid change sign, polished by bisection on `function(row, omega)`."""
        above = values > 0  # a grid point may lie on the crossing itself
        row, k = np.nonzero(above[:, 1:] != above[:, :-1])
        low, high = np.log(self.omega[k]), np.log(self.omega[k + 1])
        f_low, f_high = values[row, k], values[row, k + 1]
        middle = low - f_low * (high - low) / (f_high - f_low)
        side = np.zeros(len(row))
        for _ in range(12 if self.exact and len(row) else 1):  # Illinois: an end that sticks counts half
            f = function(row, np.exp(middle))
            same = np.sign(f) == np.sign(f_low)
            f_high = np.where(same, np.where(side > 0, 0.5 * f_high, f_high), f)
            f_low = np.where(same, f, np.where(side < 0, 0.5 * f_low, f_low))
            low, high = np.where(same, middle, low), np.where(same, high, middle)
            side = np.where(same, 1.0, -1.0)
            middle = np.where(
                f == 0, middle, low - f_low * (high - low) / np.where(f_high == f_low, 1.0, f_high - f_low)
            )
        return row, k, np.exp(middle)

    def gain_crossovers(self, gains: Gains, grid):
        """(row, omega, unwrapped arg L) of every gain crossover."""
        gain, phase = grid
        row, k, omega = self._crossings(gains, gain, lambda r, w: np.log(np.abs(self._loop(gains, r, w))))
        s = 1j * omega
        angle = np.angle(gains.response(s) * self._plant(row, s))
        angle += 2 * np.pi * np.round((0.5 * (phase[row, k] + phase[row, k + 1]) - angle) / (2 * np.pi))
        return row, omega, angle - omega * self.delay[row]

    def gain_margins(self, gains: Gains, grid):
        """ln of the smallest 1/|L| > 1 at phase crossovers; FAR where there is none."""
        gain, phase = grid
        x = (phase - self.omega * self.delay[:, None] + np.pi) / (2 * np.pi)
        margin = np.full(len(x), FAR)
        turns = np.floor(x)
        near = (np.minimum(gain[:, 1:], gain[:, :-1]) < 0) & (np.maximum(gain[:, 1:], gain[:, :-1]) > -FAR)
        row, k = np.nonzero((turns[:, 1:] != turns[:, :-1]) & near)
        if not len(row):
            return margin
        low, high = np.log(self.omega[k]), np.log(self.omega[k + 1])
        sign = np.sign(self._loop(gains, row, np.exp(low)).imag)
        for _ in range(45 if self.exact else 6):
            middle = 0.5 * (low + high)
            f = self._loop(gains, row, np.exp(middle))
            same = np.sign(f.imag) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        at = -np.log(np.abs(self._loop(gains, row, np.exp(low))))
        np.minimum.at(margin, row[at > 0], at[at > 0])
        return margin

    def phase_margins(self, crossings):
        """The smallest angle between L and -1 over the gain crossovers of every member; inf without one."""
        row, _, phase = crossings
        return np.nan_to_num(smallest(row, np.abs(np.angle(-np.exp(1j * phase))), len(self.top)), nan=np.inf)

    def slope(self, gains: Gains, row, omega):
        """d arg L / d log10 omega by a central difference."""
        h = 1e-5
        up, down = omega * np.exp(h), omega * np.exp(-h)
        ratio = self._loop(gains, row, up) / self._loop(gains, row, down)
        return np.angle(ratio) / (2 * h) * np.log(10.0)

    def log_function(self, name: str, gains: Gains, loop, omega):
        """ln of one of the frequency functions, given L."""
        if name == "loop_gain_db":
            return np.log(np.abs(loop))
        top = {
            "sensitivity_db": 1.0,
            "complementary_sensitivity_db": loop,
            "control_sensitivity_db": gains.response(1j * omega),
            "load_sensitivity_db": loop / gains.response(1j * omega),
        }[name]
        return np.log(np.abs(top / (1 + loop)))

    def extreme(self, name: str, gains: Gains, loop, band, largest: bool) -> np.ndarray:
        """Largest or smallest ln of a frequency function in each part of a band, one row a member and part.

        Parts, so that an optimiser sees every peak; between the grid's points a parabola finds the peak.
        """
        inside = np.flatnonzero((self.omega >= band[0]) & (self.omega <= band[1]))
        sign, u = (1.0 if largest else -1.0), np.log(self.omega[inside])
        value = sign * self.log_function(name, gains, loop[:, inside], self.omega[inside])
        peak = value.copy()
        if self.exact and len(inside) > 2:
            h, k = np.diff(u), np.diff(value, axis=1) / np.diff(u)
            row, at = np.nonzero((k[:, :-1] > 0) & (k[:, 1:] < 0))
            left, right, h_left, h_right = k[row, at], k[row, at + 1], h[at], h[at + 1]
            # The vertex of the parabola through three points; the function itself is taken there.
            move = 0.5 * (left * h_right + right * h_left) / (left - right)
            omega = np.exp(u[at + 1] + np.clip(move, -h_left, h_right))
            there = sign * self.log_function(name, gains, self._loop(gains, row, omega), omega)
            peak[row, at + 1] = np.maximum(peak[row, at + 1], there)
        part = np.floor((np.clip(u, *self.middle) - self.middle[0]) / PART)
        starts = np.flatnonzero(np.diff(part, prepend=-1.0))
        return sign * np.maximum.reduceat(peak, starts, axis=1).ravel()

    def evaluate(self, gains: Gains) -> Evaluation:
        """Every requirement and the objective of these gains."""
        grid = self.on_grid(gains)
        crossings = self.gain_crossovers(gains, grid)
        loop = np.exp(grid[0] + 1j * (grid[1] - self.omega * self.delay[:, None]))
        excess, equal = self._box(gains), [np.zeros(0)]
        depth = []
        for r in self.spec.requirements:
            scale = 1.0 / r.limits[0] if r.quantity == "delay_margin_s" else 1.0
            for limit, sign in ((r.lower, -1.0), (r.upper, 1.0)):
                if not np.isfinite(limit):
                    continue
                value = self.value(r, gains, grid, crossings, loop, largest=sign > 0)
                distance = sign * scale * (value - natural(r.quantity, limit))
                distance = np.nan_to_num(distance, nan=FAR, posinf=FAR, neginf=-FAR)
                (equal if r.relation is Relation.EQUALS else depth).append(distance)
        rows = [*depth] or [np.array([-FAR])]
        objective = self._objective(gains, crossings, loop, np.concatenate(rows))
        return Evaluation(
            objective, np.concatenate([excess, *rows]), np.concatenate(equal), int(self.unstable_poles(gains).max())
        )

    def _box(self, gains: Gains) -> np.ndarray:
        """How far the gains stick out of their ranges, in parts of |C| at the plant's own frequency."""
        size = abs(gains.kp) + abs(gains.ki) * self.own**-gains.alpha
        rows = []
        for name, unit in (("kp", size), ("ki", size * self.own**gains.alpha), ("alpha", 1.0)):
            limits, value = getattr(self.spec.controller, name), getattr(gains, name)
            ends = ((limits.min, -1.0), (limits.max, 1.0))
            rows += [sign * (value - end) / unit for end, sign in ends if np.isfinite(end)]
        return np.array(rows)

    def value(self, r: Requirement, gains: Gains, grid, crossings, loop, largest: bool) -> np.ndarray:
        """A quantity of every member the requirement is about, in natural units; margins as of a stable loop.

        nan for a crossover that does not exist, inf for a margin that does not end.
        """
        row, omega, phase = crossings
        m = len(self.top)
        if r.quantity == "gain_margin_db":
            value = self.gain_margins(gains, grid)
        elif r.quantity == "phase_margin_deg":
            value = self.phase_margins(crossings)
        elif r.quantity == "delay_margin_s":
            value = smallest(row, np.mod(np.pi + phase, 2 * np.pi) / omega, m)
            value = np.where(grid[0][:, -1] >= 0, 0.0, np.nan_to_num(value, nan=np.inf))
        elif r.quantity in ("crossover_rad_s", "phase_slope_deg_per_decade"):
            highest = -smallest(row, -omega, m)
            some = np.flatnonzero(np.isfinite(highest))
            value = np.log(highest)
            if r.quantity != "crossover_rad_s":
                value = highest.copy()
                value[some] = self.slope(gains, some, highest[some])
        else:
            value = self.extreme(r.quantity, gains, loop, (r.from_rad_s, r.to_rad_s), largest)
        return value[: len(value) // m] if r.scope is Scope.NOMINAL else value

    def _objective(self, gains: Gains, crossings, loop, excess) -> np.ndarray:
        spec, rows = self.spec, np.arange(len(self.top))
        if spec.objective is None:
            return excess
        quantity = spec.objective.quantity
        if quantity == "ki":
            return np.array([-gains.ki])
        if quantity == "iae_disturbance":
            s = 1.0 / (spec.objective.horizon_s or self.default_horizon_s())
            p = self._plant(rows, s).real * np.exp(-s * self.delay)
            return np.abs(p / (1 + gains.response(s) * p)) / s
        if quantity.endswith("peak_db"):
            name = quantity.replace("_peak", "")
            return self.extreme(name, gains, loop, (0.0, np.inf), True) / NEPER_PER_DB
        row, omega, _ = crossings
        if quantity == "phase_margin_spread_deg":
            margin = np.degrees(self.phase_margins(crossings))
            with np.errstate(invalid="ignore"):
                return np.nan_to_num(np.abs(margin - margin[0]), nan=1e3, posinf=1e3)
        at = omega[row == 0].max(initial=self.omega[0])
        return np.abs(np.log(np.abs(self._loop(gains, rows, np.full(len(rows), at))))) / NEPER_PER_DB

    def default_horizon_s(self) -> float:
        for roots in (self.poles[0], self.zeros[0]):
            slow = np.abs(roots[np.abs(roots) > 0])
            if len(slow):
                return 10 * (1 / slow.min() + self.delay[0])
        if self.delay[0] > 0:
            return 10 * self.delay[0]
        at_one = self._plant(np.array([0]), 1.0).real[0]  # K s^-n is 1 where omega = K^(1/n)
        order = len(self.poles[0]) - len(self.zeros[0])
        return 10 * abs(at_one) ** (-1 / order) if order else 10.0


def smallest(row, value, m):
    """Of every member the smallest of its crossings' values; nan without one."""
    found = np.full(m, np.inf)
    np.minimum.at(found, row, value)
    return np.where(np.isinf(found), np.nan, found)


def natural(quantity: str, limit: float) -> float:
    """A limit in natural units."""
    if quantity.endswith("_db"):
        return limit * NEPER_PER_DB
    if quantity == "crossover_rad_s":
        return float(np.log(limit))
    return limit if quantity == "delay_margin_s" else float(np.radians(limit))
