"""Loops on a frequency grid:  their gain and phase crossovers, and the values from which quantities are computed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import Crossings, gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.design.margin_sides import Sides, sides_of


class Track(Enum):
    """To where a frequency is moved before it is evaluated: |L| = 1, or a phase of L."""

    STAY = 0
    GAIN_CROSSOVER = 1
    PHASE = 2


@dataclass(frozen=True)
class LoopNumbers:
    """`LoopSymbols` in NumPy arrays."""

    log_gain: Array
    phase_rad: Array
    phase_margin_rad: Array
    lag_to_minus_one_rad: Array
    phase_slope_rad: Array
    log_return_difference: Array
    log_controller: Array
    log_omega: Array
    omega_rad_s: Array


class LoopGrid:
    """ln L of some plants, the nominal one first, on the frequency grid."""

    def __init__(self, gains: FoPi, plants: Plants, omega: Array) -> None:
        self.loops = Loops.of(gains, plants)
        self.u = np.log(omega)
        m, n = len(plants), len(omega)
        rows = np.repeat(np.arange(m), n)
        self.log_l: Complex = self.loops.log_response(rows, np.tile(self.u, m)).reshape(m, n)
        with np.errstate(divide="ignore"):
            controller = self.loops.controller_response(np.zeros(n, dtype=np.intp), omega)
            self.log_controller = np.log(np.abs(controller))
        self._gain_crossings: Crossings | None = None
        self._sides: Sides | None = None

    def nominal(self) -> tuple[float, float]:
        """Phase margin (rad) and ln of the highest gain crossover of the first plant; nan and mid-grid without one."""
        found, sides = self.gain_crossings(), self.sides()
        mine = found.row == 0
        if not mine.any():
            return math.nan, float(0.5 * (self.u[0] + self.u[-1]))
        return float((sides.side * sides.angle_rad)[mine].min()), float(found.u[mine].max())

    def in_band(
        self, slack: Callable[[LoopNumbers], Array], low_u: float, high_u: float, rows: Rows, ripples: bool = False
    ) -> tuple[Array, Array]:
        """Slacks of some plants over the grid's part in a band, shape (rows, n), and that part's u, shape (n,).

        With `ripples`, where the grid is too coarse for the turns of a dead time and |L| < 1, L is taken for -|L|: what
        the slack comes to within the next turn.
        """
        inside = np.flatnonzero((self.u >= low_u - 1e-12) & (self.u <= high_u + 1e-12))
        z: Complex = self.log_l[rows][:, inside].ravel()
        u = np.tile(self.u[inside], len(rows))
        controller = np.tile(self.log_controller[inside], len(rows))
        no = np.zeros(len(z))
        if ripples:
            turned = (self.is_coarse[rows][:, inside].ravel()) & (z.real < 0.0)
            z = np.where(turned, z.real - 1j * np.pi, z)
        numbers = LoopNumbers(z.real, z.imag, no, no, no, _log_one_plus(z), controller, u, np.exp(u))
        return slack(numbers).reshape(len(rows), -1), self.u[inside]

    @cached_property
    def is_coarse(self) -> NDArray[np.bool_]:
        """Where the dead time of a plant turns L by more than a radian from one frequency to the next, shape (m, n)."""
        step = np.gradient(np.exp(self.u)) if len(self.u) > 1 else np.zeros(1)
        return np.asarray(self.loops.plants.dead_time_s[:, None] * step > 1.0)

    def next_ripple(self, row: int, u: float) -> float | None:
        """The nearest u where L of a plant is negative, where the grid is too coarse to show it; else None."""
        i = int(np.argmin(np.abs(self.u - u)))
        if not self.is_coarse[row, i] or self.log_l[row, i].real >= 0.0:
            return None
        found = tracked(self.loops.take(np.array([row])), np.array([u]), np.array([Track.PHASE.value]))
        return float(found[0])

    def gain_crossings(self) -> Crossings:
        """The gain crossovers that are visible on the grid."""
        if self._gain_crossings is None:
            rows, u = self._crossings(self.log_l.real >= 0, Track.GAIN_CROSSOVER)
            dip_rows, dip_u = self._dips()
            rows, u = np.concatenate([rows, dip_rows]), np.concatenate([u, dip_u])
            # Small gains have their crossover below the grid, large ones above: find those by the exact search.
            missing = np.setdiff1d(np.arange(len(self.loops)), rows)
            if len(missing):
                beyond = gain_crossovers(self.loops.take(missing))
                rows = np.concatenate([rows, missing[beyond.row]])
                u = np.concatenate([u, np.log(beyond.omega_rad_s)])
            order = np.lexsort((u, rows))
            rows, u = rows[order], u[order]
            z, slope = self.loops.log_response_and_slope(rows, u)
            self._gain_crossings = Crossings(rows, u, np.exp(u), np.exp(z.real), z.imag, slope.imag)
        return self._gain_crossings

    def sides(self) -> Sides:
        """On which side of -1 each of these gain crossovers must stay, and which loops are stable."""
        if self._sides is None:
            self._sides = sides_of(self.loops, self.gain_crossings())
        return self._sides

    def _dips(self) -> tuple[Rows, Array]:
        """Pairs of crossovers between grid points, where ln|L| has a minimum or maximum close to 0."""
        gain = self.log_l.real
        before, at, after = np.abs(gain[:, :-2]), np.abs(gain[:, 1:-1]), np.abs(gain[:, 2:])
        same = (gain[:, :-2] * gain[:, 1:-1] > 0) & (gain[:, 1:-1] * gain[:, 2:] > 0)
        rows, i = np.nonzero(same & (at < before) & (at < after) & (at < 0.5 * np.maximum(before, after) + 0.01))
        low, high = self.u[i].copy(), self.u[i + 2].copy()
        left, right = low.copy(), high.copy()
        loops = self.loops.take(rows)
        every = np.arange(len(rows))
        sign = np.sign(gain[rows, i + 1])
        # The slope of ln|L| changes sign at the extremum: find it by bisection.
        for _ in range(30):
            middle = 0.5 * (left + right)
            falling = sign * loops.log.derivative(every, middle).real < 0
            left, right = np.where(falling, middle, left), np.where(falling, right, middle)
        turn = 0.5 * (left + right)
        passes = sign * loops.log_response(every, turn).real < 0
        ends = []
        for outer in (low, high):
            inside, outside = turn[passes], outer[passes]
            for _ in range(50):
                middle = 0.5 * (inside + outside)
                beyond = sign[passes] * loops.log_response(every[passes], middle).real < 0
                inside, outside = np.where(beyond, middle, inside), np.where(beyond, outside, middle)
            ends.append(0.5 * (inside + outside))
        return np.concatenate([rows[passes]] * 2), np.concatenate(ends)

    def phase_crossings(self) -> tuple[Rows, Array]:
        """(row, u) of the phase crossovers with |L| < 1 that are visible on the grid."""
        rows, u = self._crossings(np.floor((self.log_l.imag + np.pi) / (2.0 * np.pi)), Track.PHASE)
        small = self.loops.log_response(rows, u).real < 0
        return rows[small], u[small]

    def nearest_to_crossover(self) -> tuple[Array, Array]:
        """ln|L| of each plant where it is nearest to 0, and the u of that."""
        rows, best = np.arange(len(self.log_l)), np.argmin(np.abs(self.log_l.real), axis=1)
        return self.log_l.real[rows, best], self.u[best]

    def _crossings(self, cell: NDArray[Any], track: Track) -> tuple[Rows, Array]:
        """Where `cell` changes along the grid, refined by Newton's method."""
        rows, i = np.nonzero(cell[:, 1:] != cell[:, :-1])
        u = 0.5 * (self.u[i] + self.u[i + 1])
        polished = tracked(self.loops.take(rows), u, np.full(len(u), track.value))
        return rows, np.clip(polished, self.u[i], self.u[i + 1])


def tracked(loops: Loops, u: Array, track: Rows, phase_rad: Array | None = None) -> Array:
    """Newton's method to what `track` (values of `Track`) names; u itself where it says to stay.

    Args:
        loops: m loops.
        u: ln omega at first, shape (m,).
        track: shape (m,).
        phase_rad: the phase that is tracked, modulo a turn, shape (m,); -180 deg when left out.
    """
    rows = np.flatnonzero(track)
    if not len(rows):
        return u
    u = u.copy()
    gain = track[rows] == Track.GAIN_CROSSOVER.value
    wanted = -np.pi if phase_rad is None else phase_rad[rows]
    for _ in range(6):
        z, slope = loops.log_response(rows, u[rows]), loops.log.derivative(rows, u[rows])
        turned = z.imag - wanted
        error = np.where(gain, z.real, turned - 2 * np.pi * np.round(turned / (2 * np.pi)))
        rate = np.where(gain, slope.real, slope.imag)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.nan_to_num(error / rate, nan=0.0, posinf=0.0, neginf=0.0)
        u[rows] -= np.clip(step, -0.5, 0.5)
    return u


def numbers_at(
    loops: Loops, rows: Rows, u: Array, side: Array | None = None, angle_near_rad: Array | None = None
) -> LoopNumbers:
    """The values from which quantities are computed.

    Args:
        loops: m loops.
        rows: which of them, shape (n,).
        u: ln omega, shape (n,).
        side: on which side of -1 a gain crossover must stay, shape (n,); without it, where it is.
        angle_near_rad: the angle from -1 is within half a turn of it, shape (n,); 0 when left out.
    """
    z, slope = loops.log_response_and_slope(rows, u)
    omega = np.exp(u)
    with np.errstate(divide="ignore"):
        log_controller = np.log(np.abs(loops.controller_response(rows, omega)))
    near = 0.0 if angle_near_rad is None else angle_near_rad
    angle = near + np.pi - np.mod(near - z.imag, 2.0 * np.pi)
    side = np.where(angle < 0.0, -1.0, 1.0) if side is None else side
    return LoopNumbers(
        log_gain=z.real,
        phase_rad=z.imag,
        phase_margin_rad=side * angle,
        lag_to_minus_one_rad=angle + np.pi * (1.0 - side),
        phase_slope_rad=slope.imag,
        log_return_difference=_log_one_plus(z),
        log_controller=log_controller,
        log_omega=u,
        omega_rad_s=omega,
    )


def part_of(numbers: LoopNumbers, part: slice) -> LoopNumbers:
    """Select rows."""
    return LoopNumbers(*(getattr(numbers, name)[part] for name in LoopNumbers.__dataclass_fields__))


def discounted_error(loops: Loops, horizon_s: float) -> Array:
    """T |P/(1 + C P)| at s = 1/T, shape (m,)."""
    s = 1.0 / horizon_s
    numerator, denominator = (np.polyval(c.T, s) for c in (loops.plants.numerator, loops.plants.denominator))
    p = numerator / denominator * np.exp(-s * loops.plants.dead_time_s)
    return horizon_s * np.abs(p / (1.0 + (loops.kp + loops.ki * s**-loops.alpha) * p))


def _log_one_plus(z: Complex) -> Array:
    """ln|1 + e^z| without overflow."""
    small = np.exp(np.where(z.real > 0, -z, z))
    with np.errstate(divide="ignore"):
        return np.maximum(z.real, 0.0) + np.log(np.abs(1.0 + small))
