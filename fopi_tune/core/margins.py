"""Margins of loops:  distances to -1 of stable loops.

With the angle from -1 to L at a gain crossover, b = 180 deg + arg L (mod 360), and over all gain crossovers,

    phase margin    min |b| , b in (-180, 180 deg]:  the smallest rotation of L, by lag or by lead, that meets -1    (1)
    delay margin    min b/omega , b in [0, 360 deg):  the shortest additional dead time that meets -1                (2)
    gain margin     min 1/|L| over the frequencies where L < 0 is real and |L| < 1                                   (3)

Without a gain crossover the phase margin is infinite.  So is the delay margin where |L| < 1; where |L| does not fall
below 1 at the upper end of the axis, it is 0:  any dead time makes infinitely many closed-loop poles unstable there
(on samples: one more whole sample makes one unstable).  On samples (2) is about the rotation e^{-j omega t}; a plant
with this dead time behind its hold differs between the samples.

Stability decides the sign: an unstable loop has no margin.

Source: derived; the closed loop's poles move continuously and reach the axis, or z's unit circle, where L = -1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import Plant
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import DomainError

#: neper; |L| this close to 1 at the upper end of the axis does not fall below it
_AT_ONE = 1e-12


@dataclass(frozen=True)
class Measured:
    """The values of a quantity for m loops; shapes (m,).

    Args:
        value: nan where a loop has no such quantity: a margin of an unstable loop, a crossover where |L| never is 1;
            inf for a margin that does not end.
        omega_rad_s: the frequency at which that value occurs; 0, inf or nan where there is none.
        work: counted effort for all rows together, in cells of a search for peaks.
    """

    value: Array
    omega_rad_s: Array
    work: int = 0

    def where(self, rows: NDArray[np.bool_]) -> Measured:
        """The same, without a value in all other rows."""
        return Measured(np.where(rows, self.value, np.nan), np.where(rows, self.omega_rad_s, np.nan), self.work)


def smallest_by_row(crossings: Crossings, values: Array, rows: int) -> Measured:
    """The smallest value over the crossings of each loop."""
    return _first_by_row(crossings, values, rows, np.lexsort((values, crossings.row)))


def highest_by_row(crossings: Crossings, values: Array, rows: int) -> Measured:
    """The value at the highest crossing of each loop."""
    return _first_by_row(crossings, values, rows, np.lexsort((-crossings.omega_rad_s, crossings.row)))


def _first_by_row(crossings: Crossings, values: Array, rows: int, order: Rows) -> Measured:
    value, omega = np.full(rows, np.nan), np.full(rows, np.nan)
    found, first = np.unique(crossings.row[order], return_index=True)
    value[found], omega[found] = values[order][first], crossings.omega_rad_s[order][first]
    return Measured(value, omega)


def phase_margins(loops: Loops, crossovers: Crossings) -> Measured:
    """(1) in rad of every loop, were it stable; inf without a gain crossover.

    Args:
        loops: m loops.
        crossovers: their gain crossovers.
    """
    found = smallest_by_row(crossovers, crossovers.phase_margin_rad, len(loops))
    return Measured(np.where(np.isnan(found.value), np.inf, found.value), found.omega_rad_s)


def delay_margins(loops: Loops, crossovers: Crossings) -> Measured:
    """(2) in s of every loop, were it stable; inf where |L| < 1 everywhere, 0 where |L| stays at or above 1 at the end.

    Args:
        loops: m loops.
        crossovers: their gain crossovers.
    """
    found = smallest_by_row(crossovers, crossovers.delay_margin_s, len(loops))
    value = np.where(np.isnan(found.value), np.inf, found.value)
    large = stays_large(loops)
    return Measured(np.where(large, 0.0, value), np.where(large, loops.highest_rad_s, found.omega_rad_s))


def gain_margins(loops: Loops, phase: Crossings) -> Measured:
    """(3), ln of it, of every loop, were it stable; inf where there is none.

    Args:
        loops: m loops.
        phase: their phase crossovers.
    """
    with np.errstate(divide="ignore"):
        margin = np.where(phase.gain <= 1.0, -np.log(phase.gain), np.inf)
    found = smallest_by_row(phase, margin, len(loops))
    infinite = ~np.isfinite(found.value)
    return Measured(np.where(infinite, np.inf, found.value), np.where(infinite, np.nan, found.omega_rad_s))


def stays_large(loops: Loops) -> NDArray[np.bool_]:
    """Whether |L| does not fall below 1 at the upper end of the frequency axis, shape (m,)."""
    log = loops.log
    gain, _ = log.end()
    slope = log.slope_end()
    return (slope > _AT_ONE) | ((np.abs(slope) <= _AT_ONE) & (gain > -_AT_ONE))


@dataclass(frozen=True)
class Margins:
    """The margins of one loop.

    Args:
        stable: whether the loop is; without it there is no margin.
        crossover_rad_s: the highest gain crossover; None when |L| never is 1.
        phase_margin_deg: the smallest over all gain crossovers; inf without one; None when unstable.
        phase_margin_rad_s: the crossover where it is smallest; None without one.
        gain_margin_db: the smallest 1/|L| over the phase crossovers with |L| < 1; inf when there is none; None when
            unstable.
        gain_margin_rad_s: where; None when infinite.
        gain_reduction_margin_db: the smallest reduction, negative, that brings a phase crossover with |L| > 1 to 1;
            -inf when there is none; None when unstable.
        delay_margin_s: the smallest lag to -1 over omega; inf and 0 as in (2); None when unstable.
        delay_margin_rad_s: where; None when there is no such crossover.
        phase_slope_deg_per_decade: d arg L / d log10 omega at the highest gain crossover.
        gain_crossovers_rad_s: all of them.
        angles_from_minus_one_deg: 180 deg + arg L in (-180, 180] at each of them, also of an unstable loop: positive
            where a lag brings L to -1, negative where a lead does.
    """

    stable: bool
    crossover_rad_s: float | None
    phase_margin_deg: float | None
    phase_margin_rad_s: float | None
    gain_margin_db: float | None
    gain_margin_rad_s: float | None
    gain_reduction_margin_db: float | None
    delay_margin_s: float | None
    delay_margin_rad_s: float | None
    phase_slope_deg_per_decade: float | None
    gain_crossovers_rad_s: tuple[float, ...]
    angles_from_minus_one_deg: tuple[float, ...]


def margins(controller: FoPi, plant: Plant) -> Margins:
    """The margins of one controller with one plant.

    Raises:
        DomainError: kp = ki = 0, or one of the two is something else.
    """
    refuse_no_gains(controller)
    if not isinstance(plant, Plant):
        raise DomainError(f"{plant!r:.100} is no plant; give one, such as Plant([1], [2, 1])")
    return margins_of(Loops.of(controller, Plants.of(plant)))


def margins_of(loops: Loops) -> Margins:
    """The margins of one loop, the first row's alone."""
    if len(loops) > 1:
        loops = loops.take(np.zeros(1, dtype=np.intp))
    gain, phase = gain_crossovers(loops), phase_crossovers(loops)
    stable = is_stable(loops)
    angle, lag = phase_margins(loops, gain).where(stable), delay_margins(loops, gain).where(stable)
    room, last = gain_margins(loops, phase).where(stable), -1 if len(gain.row) else None
    reduction_db = -20.0 * np.log10(phase.gain[phase.gain > 1.0])
    return Margins(
        stable=bool(stable[0]),
        crossover_rad_s=None if last is None else float(gain.omega_rad_s[last]),
        phase_margin_deg=_number(np.degrees(angle.value)),
        phase_margin_rad_s=_number(angle.omega_rad_s),
        gain_margin_db=_number(room.value * (20.0 / math.log(10.0))),
        gain_margin_rad_s=_number(room.omega_rad_s),
        gain_reduction_margin_db=float(reduction_db.max(initial=-np.inf)) if stable[0] else None,
        delay_margin_s=_number(lag.value),
        delay_margin_rad_s=_number(lag.omega_rad_s),
        phase_slope_deg_per_decade=None if last is None else float(np.degrees(gain.slope_rad[last]) * math.log(10.0)),
        gain_crossovers_rad_s=tuple(gain.omega_rad_s.tolist()),
        angles_from_minus_one_deg=tuple(np.degrees(gain.angle_from_minus_one_rad).tolist()),
    )


def _number(value: Array) -> float | None:
    return None if np.isnan(value[0]) else float(value[0])
