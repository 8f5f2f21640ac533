"""Loops L = C P with a measured response P:  everything about them at frequencies of the band, and where it is extreme.

C is exact (`core/loops.py`), P the curve of `curve.py`.  Values are looked at on a grid of u = ln omega that divides
every interval between points, and extremes and crossings are refined on the curve itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fopi_tune.core.bode_form import Array, BodeForm, Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.measured.curve import Curve
from fopi_tune.errors import DomainError

#: of the grid: distances in u, parts of an interval between points, turn of a dead time between columns in rad
_STEP, _PARTS, _TURN = 0.02, 4, 0.3
#: columns of a grid
_MOST_COLUMNS = 400_000
#: golden sections before a parabola, and steps to a crossing
_SECTIONS, _CROSSING_STEPS = 14, 24
#: a refined extreme is beyond that of the columns by at most this part of the differences to their neighbours, of which
#: a parabola has an eighth
_BEYOND = 0.5
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True)
class LoopPoints:
    """A loop at frequencies; every field of shape (n,).

    Args:
        u: ln omega.
        log_controller: ln|C|, with its measurement filter.
        log_plant: ln|P|.
        phase_rad: arg L, unwrapped.
        slope_rad: d arg L/d ln omega.
    """

    u: Array
    log_controller: Array
    log_plant: Array
    phase_rad: Array
    slope_rad: Array

    @property
    def log_gain(self) -> Array:
        """ln|L|."""
        return self.log_controller + self.log_plant

    @property
    def log_omega(self) -> Array:
        """ln(omega / (rad/s))."""
        return self.u

    @property
    def omega_rad_s(self) -> Array:
        """omega."""
        return np.exp(self.u)

    @property
    def phase_slope_rad(self) -> Array:
        """d arg L/d ln omega."""
        return self.slope_rad

    @property
    def log_return_difference(self) -> Array:
        """ln|1 + L|."""
        gain = np.exp(self.log_gain)
        size = np.hypot(1.0 + gain * np.cos(self.phase_rad), gain * np.sin(self.phase_rad))
        return np.log(np.maximum(size, 1e-300))

    @property
    def lag_to_minus_one_rad(self) -> Array:
        """The lag that brings L to -1, in [0, 360 deg)."""
        return np.mod(np.pi + self.phase_rad, 2.0 * np.pi)

    @property
    def phase_margin_rad(self) -> Array:
        """The smallest angle between L and -1, in [0, 180 deg]."""
        lag = self.lag_to_minus_one_rad
        return np.minimum(lag, 2.0 * np.pi - lag)


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """The loop of a controller with one measured response.

    Args:
        gains: the controller.
        curve: the response.
        band_rad_s: where it is looked at, inside of the curve's band.
        step: of the grid in u; None for the default.
    """

    gains: FoPi
    curve: Curve
    band_rad_s: tuple[float, float]
    step: float | None = None

    @cached_property
    def grid(self) -> Array:
        """u from the lower end of the band to the upper one, the points of the curve among them.

        Raises:
            DomainError: the dead time turns too often in the band.
        """
        return self._plant_on_grid[0]

    @property
    def _plant_on_grid(self) -> tuple[Array, Complex, Complex]:
        return curve_on_grid(self.curve, self.band_rad_s, _STEP if self.step is None else self.step)

    @cached_property
    def log_controller(self) -> BodeForm:
        """ln C.

        Raises:
            DomainError: all gains are 0.
        """
        one = np.ones((1, 1))
        return Loops.of(self.gains, Plants(one, one, np.zeros(1))).log_controller

    @property
    def start_phase_of_controller(self) -> float:
        """arg C at s = +0 on the real axis: 0 or -180 deg."""
        form = self.log_controller
        return float(form.phase0[0] - 0.5 * np.pi * form.slope0[0])

    def at(self, u: Array) -> LoopPoints:
        """The loop at u, shape (n,)."""
        return self._points(u, *self.curve.log_and_slope_at(u))

    def _points(self, u: Array, plant: Complex, slope: Complex) -> LoopPoints:
        controller, rise = self.log_controller.value_and_derivative(np.zeros(len(u), dtype=np.intp), u)
        return LoopPoints(u, controller.real, plant.real, controller.imag + plant.imag, rise.imag + slope.imag)

    @cached_property
    def on_grid(self) -> LoopPoints:
        """The loop on the grid."""
        u, plant, slope = self._plant_on_grid
        return self._points(u, plant, slope)

    def extreme(
        self, value: Callable[[LoopPoints], Array], largest: bool, from_rad_s: float, to_rad_s: float
    ) -> tuple[float, float]:
        """The largest or smallest value of a function over a part of the band: value, u; nan outside of the band."""
        places = self.extremes(value, largest, from_rad_s, to_rad_s, within=0.0)
        if not len(places):
            return np.nan, np.nan
        values = value(self.at(places))
        k = int(values.argmax() if largest else values.argmin())
        return float(values[k]), float(places[k])

    def extremes(
        self,
        value: Callable[[LoopPoints], Array],
        largest: bool,
        from_rad_s: float,
        to_rad_s: float,
        within: float = np.inf,
    ) -> Array:
        """u of the local extremes of a function over a part of the band, ends included; refined; shape (k,).

        Args:
            value: the function, of a loop's points.
            largest: whether they are maxima.
            from_rad_s: lower end.
            to_rad_s: upper end.
            within: those that are further than this from the most extreme one may be left out.
        """
        u = _part_of(self.grid, from_rad_s, to_rad_s)
        if len(u) < 2:
            return u
        sign = 1.0 if largest else -1.0
        y = sign * value(self.at(u))
        y = np.where(np.isnan(y), -np.inf, y)
        inner = np.flatnonzero((y[1:-1] >= y[:-2]) & (y[1:-1] > y[2:])) + 1
        more = _BEYOND * (2.0 * y[inner] - y[inner - 1] - y[inner + 1])
        inner = inner[~(y[inner] + more < y.max() - within)]
        refined = _refined(lambda at: sign * value(self.at(at)), u[inner - 1], u[inner + 1])
        ends = [u[:1]] if y[0] > y[1] else []
        ends += [u[-1:]] if y[-1] >= y[-2] else []
        return np.concatenate([refined, *ends]) if len(inner) or ends else u[:1]

    @cached_property
    def gain_crossovers(self) -> Array:
        """u of every |L| = 1 in the band, ascending."""
        return self._crossings(lambda points: points.log_gain)

    @cached_property
    def phase_crossovers(self) -> Array:
        """u of every arg L = -180 deg (mod 360) in the band, ascending."""
        return self._crossings(lambda points: np.remainder(points.phase_rad, 2.0 * np.pi) - np.pi, _HALF_TURN)

    def _crossings(self, value: Callable[[LoopPoints], Array], most_jump: float = np.inf) -> Array:
        """u where a function is 0, also twice between two columns; a jump over `most_jump` is none."""
        turning = _turning(self, value)
        u = np.union1d(self.grid, turning) if len(turning) else self.grid
        y = value(self.at(u) if len(turning) else self.on_grid)
        change = (y[1:] > 0.0) != (y[:-1] > 0.0)
        rows = np.flatnonzero(change & (np.abs(np.diff(y)) < most_jump))
        return _zeros(lambda at: value(self.at(at)), u[rows], u[rows + 1], y[rows], y[rows + 1])


#: of a function and of u: what is smaller is rounding
_ZERO = 1e-13
#: rad; larger jumps of the angle from -1 are its own
_HALF_TURN = np.pi


def band_grid(curve: Curve, band_rad_s: tuple[float, float], step: float) -> Array:
    """u over a band, the points of the curve among them, so fine as its points, a step and its dead time ask for.

    Raises:
        DomainError: the dead time turns too often in the band.
    """
    low, high = np.log(band_rad_s)
    inner = curve.u[(curve.u > low) & (curve.u < high)]
    knots = np.concatenate([[low], inner, [high]])
    widths = np.diff(knots)
    turn = curve.dead_time_s * np.diff(np.exp(knots)) / _TURN
    parts = np.maximum(np.maximum(np.ceil(widths / step), np.ceil(turn)), _PARTS)
    if parts.sum() > _MOST_COLUMNS:
        raise DomainError(
            f"the dead time of {curve.dead_time_s:g} s turns the phase too often up to {band_rad_s[1]:g} rad/s; leave "
            "out the frequencies beyond those that the loop needs"
        )
    return np.concatenate([*(np.linspace(a, b, int(n), endpoint=False)
                             for a, b, n in zip(knots[:-1], knots[1:], parts, strict=True)), [high]])  # fmt: skip


@lru_cache(64)
def curve_on_grid(curve: Curve, band_rad_s: tuple[float, float], step: float) -> tuple[Array, Complex, Complex]:
    """`band_grid` and there ln P and its slope; kept, as every controller asks for them."""
    u = band_grid(curve, band_rad_s, step)
    return u, *curve.log_and_slope_at(u)


def _part_of(grid: Array, from_rad_s: float, to_rad_s: float) -> Array:
    """The columns inside a band, and its own ends where they lie inside the grid."""
    low = grid[0] if from_rad_s <= 0.0 else np.log(from_rad_s)
    high = grid[-1] if to_rad_s == np.inf else np.log(to_rad_s)
    # an end that equals one of the grid's but for rounding is that
    low, high = (end if abs(end - near) > 1e-12 else near for end, near in ((low, grid[0]), (high, grid[-1])))
    low, high = max(low, grid[0]), min(high, grid[-1])
    if low > high:
        return np.zeros(0)
    return np.unique(np.concatenate([[low], grid[(grid > low) & (grid < high)], [high]]))


def _turning(loop: MeasuredLoop, value: Callable[[LoopPoints], Array]) -> Array:
    """u of the local extremes next to 0 between columns on whose columns there is no change of sign."""
    u, y = loop.grid, value(loop.on_grid)
    size = np.abs(y)
    inner = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])) + 1
    around = np.abs(y[inner + 1] - y[inner]) + np.abs(y[inner] - y[inner - 1])
    same = (y[inner - 1] > 0.0) == (y[inner] > 0.0)
    near = inner[(size[inner] < _BEYOND * around) & same & ((y[inner + 1] > 0.0) == (y[inner] > 0.0))]
    sign = np.where(y[near] > 0.0, -1.0, 1.0)
    return _refined(lambda at: sign * value(loop.at(at)), u[near - 1], u[near + 1])


def _zeros(value: Callable[[Array], Array], low: Array, high: Array, at_low: Array, at_high: Array) -> Array:
    """A zero between each `low` and `high`, where the function has different signs, shape (k,); false position.

    An end that stays twice counts half (the Illinois rule).
    """
    if not len(low):
        return low
    middle, kept = low, np.zeros(len(low))
    for _ in range(_CROSSING_STEPS):
        middle = np.clip((low * at_high - high * at_low) / (at_high - at_low), low, high)
        here = value(middle)
        if np.all((np.abs(here) < _ZERO) | (high - low < _ZERO)):
            break
        same = (here > 0.0) == (at_low > 0.0)
        at_high = np.where(same, np.where(kept > 0.0, 0.5 * at_high, at_high), here)
        at_low = np.where(same, here, np.where(kept < 0.0, 0.5 * at_low, at_low))
        low, high = np.where(same, middle, low), np.where(same, high, middle)
        kept = np.where(same, 1.0, -1.0)
        # a value that became 0 keeps a sign
        at_low = np.where(at_low == 0.0, -1e-300 * np.sign(at_high), at_low)
        at_high = np.where(at_high == 0.0, -1e-300 * np.sign(at_low), at_high)
    return middle


def _refined(value: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """The largest value between each `low` and `high`, by golden sections and a parabola, shape (k,)."""
    if not len(low):
        return low
    a, b = low.copy(), high.copy()
    x, y = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_x, at_y = value(x), value(y)
    for _ in range(_SECTIONS):
        left = at_x > at_y
        a, b = np.where(left, a, x), np.where(left, y, b)
        new = np.where(left, b - _GOLDEN * (b - a), a + _GOLDEN * (b - a))
        at_new = value(new)
        x, y = np.where(left, new, y), np.where(left, x, new)
        at_x, at_y = np.where(left, at_new, at_y), np.where(left, at_x, at_new)
    best, other = np.where(at_x > at_y, x, y), np.where(at_x > at_y, y, x)
    at_best, at_other = np.maximum(at_x, at_y), np.minimum(at_x, at_y)
    third = np.where(best > other, b, a)
    p, q = best - other, best - third
    # the vertex of the parabola through three points
    top = p * p * (at_best - value(third)) - q * q * (at_best - at_other)
    bottom = p * (at_best - value(third)) - q * (at_best - at_other)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = best - 0.5 * top / bottom
    vertex = np.where(np.isfinite(vertex), np.clip(vertex, a, b), best)
    return np.where(value(vertex) > at_best, vertex, best)
