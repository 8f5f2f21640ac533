"""A second opinion on a PID's loops:  every quantity of a requirement, of one plant and over a family, by NumPy alone.

C P is one rational function (times a dead time), so that margins and stability are those of `oracles.dense_margins`.
Responses are read on its grid, denser where a dead time ripples, and polished between the points; over a family by a
grid of members and a pattern search.  Natural units: neper, rad, s, rad a decade.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from oracles.dense_margins import Continuous, UncertainError, gain_crossovers, value
from scipy.optimize import minimize_scalar

from fopi_tune.core.controller import FoPid
from fopi_tune.core.plant import Plant, PlantFamily

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
RESPONSES = ("sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db", "loop_gain_db")
MARGINS = ("phase_margin_deg", "gain_margin_db", "delay_margin_s")
#: |L| below which S and T ripple by less than any limit that is asked for; the same of C S, which ripples about C
_SMALL, _TINY = 0.02, 1e-7
_MOST_POINTS = 120_000
#: the last step of the pattern search, as a share of the box
_LAST_STEP = 3e-6


@dataclass(frozen=True)
class PidLoop:
    """One loop in continuous time."""

    plant: Plant
    pid: FoPid

    @cached_property
    def joined(self) -> Continuous:
        """C P as a plant behind the gain 1."""
        pid, filter_s = self.pid, self.pid.derivative_filter_time_constant_s
        top, bottom = [pid.kp * filter_s + pid.kd, pid.kp + pid.ki * filter_s, pid.ki], [filter_s, 1.0, 0.0]
        if pid.ki == 0.0:
            top, bottom = top[:-1], bottom[:-1]
        numerator = np.trim_zeros(np.polymul(top, self.plant.numerator), "f")
        denominator = np.polymul(np.polymul(bottom, self.filtering), self.plant.denominator)
        return Continuous(Plant(tuple(numerator), tuple(denominator), self.plant.dead_time_s), 1.0, 0.0, 1.0)

    @property
    def filtering(self) -> list[float]:
        """The polynomial that a measurement filter divides by."""
        used = self.pid.measurement_filter
        if used is None:
            return [1.0]
        time = used.time_constant_s
        return {1: [time, 1.0], 2: [time**2 / 2, time, 1.0]}[used.order]

    def controller(self, omega: Array) -> Complex:
        """C(j omega)."""
        s, pid = 1j * omega, self.pid
        terms = pid.kp + pid.ki / s + pid.kd / (pid.derivative_filter_time_constant_s + 1.0 / s)
        return np.asarray(terms / np.polyval(self.filtering, s))

    @property
    def is_stable(self) -> bool:
        """By the contour, and by the roots of a polynomial where it is one."""
        return self.joined.is_stable

    def read(self, quantity: str, low: float, high: float, largest: bool) -> float:
        """The worst value of one plant; nan where it has none."""
        if quantity in (*RESPONSES, "load_sensitivity_db"):
            return self.extreme(quantity, low, high, largest)
        if quantity in MARGINS:
            return value(self.joined, quantity)
        crossovers = gain_crossovers(self.joined)
        if not len(crossovers):
            return math.nan
        omega = float(crossovers[-1])
        if quantity == "crossover_rad_s":
            return math.log(omega)
        step = 1e-3
        gain = self.joined.gain(omega * np.exp(step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])))
        turns = np.angle(gain / gain[2])
        slope = (turns[0] - 8.0 * turns[1] + 8.0 * turns[3] - turns[4]) / (12.0 * step)
        return float(slope) * math.log(10.0)

    def log_response(self, quantity: str, omega: Array) -> Array:
        """ln|S|, ln|T|, ln|C S|, ln|P S| or ln|L|."""
        gain = self.joined.gain(omega)
        top = {
            "sensitivity_db": np.ones_like(gain),
            "complementary_sensitivity_db": gain,
            "control_sensitivity_db": self.controller(omega),
            "loop_gain_db": gain * (1.0 + gain),
            "load_sensitivity_db": gain / self.controller(omega),
        }[quantity]
        return np.log(np.abs(top)) - np.log(np.abs(1.0 + gain))

    def extreme(self, quantity: str, low: float, high: float, largest: bool) -> float:
        """The largest or smallest ln|R| over a band; its limits at both ends of the axis are on the grid."""
        sign = 1.0 if largest else -1.0
        omega = self._grid(quantity, low, high)
        values = sign * self.log_response(quantity, omega)
        best = float(values.max())
        peaks = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])) + 1
        for k in peaks[np.argsort(values[peaks])[::-1]][:4]:
            found = minimize_scalar(
                lambda x: -sign * float(self.log_response(quantity, np.array([math.exp(x)]))[0]),
                bounds=(math.log(omega[k - 1]), math.log(omega[k + 1])),
                method="bounded",
                options={"xatol": 1e-9},
            )
            best = max(best, -float(found.fun))  # pyright: ignore[reportAttributeAccessIssue]
        late = self.plant.dead_time_s > 0.0 and not math.isfinite(high)
        if late and self.joined.direct != 0.0 and quantity != "loop_gain_db":
            raise UncertainError("the ripple behind a direct path has no end")
        return sign * best

    def _grid(self, quantity: str, low: float, high: float) -> Array:
        late, omega = self.plant.dead_time_s, self.joined.plain_grid
        if late and quantity != "loop_gain_db":
            floor = _TINY if quantity == "control_sensitivity_db" else _SMALL
            last = float(omega[np.abs(self.joined.gain(omega)) >= floor].max(initial=0.0))
            last = min(last + 8.0 / late, high)
            if last * late > 0.1 * _MOST_POINTS:
                raise UncertainError("too many turns of the dead time")
            omega = np.unique(np.concatenate([omega, np.arange(0.1 / late, last, 0.1 / late)]))
        ends = [end for end in (low, high) if 0.0 < end < math.inf]
        return np.unique(np.concatenate([omega[(omega > low) & (omega < high)], ends]))


@dataclass(frozen=True)
class PidFamily:
    """The members of a family with one PID."""

    plants: PlantFamily
    pid: FoPid

    def loop(self, point: Array) -> PidLoop:
        """The loop with the plant at a place of the box."""
        return PidLoop(self.plants.member(point), self.pid)

    @cached_property
    def points(self) -> Array:
        """Places of the box, shape (m, p); its ends are among them."""
        axes = len(self.plants.low)
        shares = list(itertools.product(np.linspace(0.0, 1.0, {0: 1, 1: 11, 2: 5}[axes]), repeat=axes))
        return np.asarray(self.plants.low + np.array(shares, dtype=float) * self._width, dtype=float)

    @property
    def _width(self) -> Array:
        return self.plants.high - self.plants.low

    def is_stable(self) -> bool:
        """Whether the nominal plant and those of the grid are."""
        return all(self.loop(point).is_stable for point in [self.plants.nominal_point, *self.points])

    def worst(self, read: Callable[[PidLoop], float], largest: bool) -> float:
        """The largest or smallest value over the box; nan where a plant of the grid has none."""
        sign = 1.0 if largest else -1.0
        values = np.array([sign * read(self.loop(point)) for point in self.points])
        if np.isnan(values).any():
            return math.nan
        best, axes = float(values.max()), len(self.plants.low)
        if not axes or math.isinf(best):
            return sign * best
        moves = [way * axis for axis in np.eye(axes) for way in (1.0, -1.0)]
        for k in np.argsort(values)[::-1][:2]:
            here, height, step = self.points[k], float(values[k]), 0.125
            while step > _LAST_STEP:
                tried = [np.clip(here + step * self._width * m, self.plants.low, self.plants.high) for m in moves]
                reached = [sign * read(self.loop(point)) for point in tried]
                j = int(np.argmax(reached))
                here, height, step = (tried[j], reached[j], step) if reached[j] > height else (here, height, 0.4 * step)
            best = max(best, height)
        return sign * best
