"""Margins and peaks of thousands of sampled loops at once:  found on a frequency grid, then refined.

`fopi_tune.core` finds every crossing and every peak, at any cost.  Here a crossing is a change of sign between
neighbouring points of a dense grid in u = ln tan(omega Ts/2), refined by Newton's method to rounding, and a peak is one
of the grid's highest points, refined by golden-section search.  Each draw has points of its own next to its resonances
that are narrower than the grid.  Two crossings between neighbouring points would be missed; that is acceptable for
statistics over sampled plants, not for a proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.core.crossings import Crossings, negative_ends
from fopi_tune.core.peaks import Response, Tilt
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_poles_from
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB, EvaluatedAt, QuantityAtCrossings
from fopi_tune.quantities.responses import FrequencyFunction
from fopi_tune.spec.model import Requirement

#: grid points, and the least number per sample of delay
_POINTS, _POINTS_A_DELAY = 400, 16
#: widths in u of the coarse ends of the grid, below the lowest and above the highest corner, and their points
_SPARSE_BELOW, _SPARSE_ABOVE, _TAIL = 6.0, 12.0, 12
_NEWTON, _BRACKETS = 12, 24
#: points on each side of a narrow resonance or anti-resonance, from a fraction of its half-width to the grid's spacing
_BESIDE, _NEAREST = 16, 0.1
#: local peaks of the grid that are refined
_PEAKS = 3
_ROUNDING = 4e-15
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class MarginScan:
    """m loops of one digital controller, evaluated on a frequency grid.

    Args:
        loops: the loops.
    """

    loops: SampledLoops

    @cached_property
    def u(self) -> Array:
        """The grid of every loop, ascending, shape (m, n)."""
        shared, narrow = self._shared, self._narrow
        every = np.broadcast_to(shared, (len(self.loops), len(shared)))
        return np.sort(np.concatenate([every, narrow], axis=1), axis=1) if narrow.size else every

    @cached_property
    def _narrow(self) -> Array:
        """Points next to each loop's factors that are narrower than the spacing of the common grid, shape (m, k).

        ln|1 + rho e^{j psi}| has its extreme at its corner, and there the half-width (pi - |psi|)/nu in u.
        """
        form, shared = self.loops.log, self._shared
        spacing = float(np.diff(shared[_TAIL - 1 : 1 - _TAIL]).max())
        width = (np.pi - np.abs(form.psi)) / form.nu
        narrow = np.isfinite(form.corner) & (form.corner > shared[0]) & (form.corner < shared[-1]) & (width < spacing)
        columns = np.flatnonzero(narrow.any(axis=0))
        # rows without such a factor repeat a point of the grid
        corner = np.where(narrow, form.corner, shared[0])[:, columns, None]
        width = np.where(narrow, np.maximum(width, 1e-12), 0.0)[:, columns, None]
        share = np.linspace(0.0, 1.0, _BESIDE)
        beside = _NEAREST * width * (spacing / np.maximum(_NEAREST * width, 1e-300)) ** share
        beside = np.where(narrow[:, columns, None], beside, 0.0)
        return np.concatenate([corner, corner - beside, corner + beside], axis=2).reshape(len(self.loops), -1)

    @cached_property
    def _shared(self) -> Array:
        """The points of all loops, shape (n,), from far below the lowest corner to far above the highest."""
        low, high = self.loops.log.corners()
        # corners() reaches as far as anything still changes by 1e-9: a few points are enough at those ends
        ends = max(float(low.min()), -60.0), min(float(high.max()), 40.0)
        first = min(ends[0] + _SPARSE_BELOW, ends[1] - 1.0)
        last = max(ends[1] - _SPARSE_ABOVE, first + 1.0)
        points = max(_POINTS, int(_POINTS_A_DELAY * float(self.loops.plants.late.max(initial=0.0))))
        tails = np.linspace(ends[0], first, _TAIL), np.linspace(last, max(ends[1], last + 1.0), _TAIL)
        return np.concatenate([tails[0][:-1], np.linspace(first, last, points), tails[1][1:]])

    @cached_property
    def log_gain(self) -> Complex:
        """ln L on the grid, unwrapped, shape (m, n)."""
        m, n = self.u.shape
        rows, u = np.repeat(np.arange(m), n), self.u.ravel()
        with np.errstate(all="ignore"):
            controller: Complex = self._log_controller(self.u)
            plant: Complex = np.log(self.loops.plants.at(rows, u)).reshape(m, n)
        log = controller + plant
        phase = np.unwrap(log.imag, axis=1)
        start = self.loops.log.value(np.arange(m), self.u[:, 0]).imag
        turns = np.round((start - phase[:, 0]) / (2.0 * np.pi))
        return log.real + 1j * (phase + 2.0 * np.pi * turns[:, None])

    @cached_property
    def gain_crossings(self) -> Crossings:
        """|L| = 1, sorted by row and frequency."""
        return self._crossings(self.log_gain.real, np.real, 0.0)

    @cached_property
    def phase_crossings(self) -> Crossings:
        """arg L = -180 deg (mod 360), the limits at both ends of the frequency axis included."""
        turns = (self.log_gain.imag + np.pi) / (2.0 * np.pi)
        found = self._crossings(turns - np.floor(turns[:, :1]), np.imag, 2.0 * np.pi)
        parts = (found, *negative_ends(self.loops))
        columns = [np.concatenate([getattr(part, name) for part in parts]) for name in Crossings.__dataclass_fields__]
        order = np.lexsort((columns[1], columns[0]))
        return Crossings(*(column[order] for column in columns))

    def _crossings(self, values: Array, part: Callable[[Complex], Array], period: float) -> Crossings:
        """Refined crossings: where `values` change sign (with a period: whole part) between neighbouring points."""
        level = np.floor(values) if period else (values > 0.0).astype(float)
        row, k = np.nonzero(np.isfinite(values[:, 1:] + values[:, :-1]) & (level[:, 1:] != level[:, :-1]))
        low, high = self.u[row, k], self.u[row, k + 1]
        # the level that is crossed: the multiple of the period nearest to the mean of the two values
        ends = part(self.log_gain[row, k]), part(self.log_gain[row, k + 1])
        offset = np.pi if period else 0.0
        line = (
            period * np.round((0.5 * (ends[0] + ends[1]) + offset) / period) - offset if period else np.zeros(len(row))
        )
        rising = ends[1] > ends[0]
        u = 0.5 * (low + high)
        for _ in range(_NEWTON):
            value, slope = self.loops.log_response_and_slope(row, u)
            distance = part(value) - line
            right = (distance >= 0.0) == rising
            high, low = np.where(right, u, high), np.where(right, low, u)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = u - distance / part(slope)
            # the root may be an end of the bracket itself
            room = _ROUNDING * np.maximum(1.0, np.abs(u))
            u = np.where((step >= low - room) & (step <= high + room), step, 0.5 * (low + high))
        value, slope = self.loops.log_response_and_slope(row, u)
        slope_rad = slope.imag / self.loops.stretch(u)
        return Crossings(row, u, self.loops.omega_of(u), np.exp(value.real), value.imag, slope_rad)

    @cached_property
    def unstable_poles(self) -> Array:
        """Closed-loop poles outside the unit circle, shape (m,); inf on it."""
        return unstable_poles_from(self.loops, self.gain_crossings)

    def measure(self, requirement: Requirement, largest: bool) -> Array:
        """A requirement's quantity of every loop, public unit, shape (m,); nan where it has none; see `Measured`.

        Args:
            requirement: gives quantity and band.
            largest: of a function of frequency, its largest value over the band, else its smallest.
        """
        quantity = QUANTITIES[requirement.quantity]
        if isinstance(quantity, FrequencyFunction):
            found = self.extreme(
                quantity.response, requirement.from_rad_s, requirement.to_rad_s, largest, requirement.tilt
            )
            return found / NEPER_PER_DB
        if not isinstance(quantity, QuantityAtCrossings):
            raise TypeError(f"{requirement.quantity} is neither a response nor read at a crossing")
        at_phase = quantity.where is EvaluatedAt.PHASE_CROSSOVERS
        found = quantity.at_crossings(self.loops, self.phase_crossings if at_phase else self.gain_crossings)
        return (found.where(self.unstable_poles < 0.5) if quantity.is_margin else found).value

    def extreme(
        self, response: Response, from_rad_s: float, to_rad_s: float, largest: bool, tilt: Tilt | None = None
    ) -> Array:
        """ln of the largest (or smallest) value of a response over a band, shape (m,)."""
        ends = float(self._shared[0]), float(self._shared[-1])
        first = float(self.loops.u_of(np.array(from_rad_s))) if from_rad_s > 0.0 else ends[0]
        last = float(self.loops.u_of(np.array(to_rad_s))) if to_rad_s < self.loops.highest_rad_s else ends[1]
        rows = np.arange(len(self.loops))
        # the grid's own values between the ends, which are computed; a point outside is worth nothing
        inside = np.pad((self.u > first) & (self.u < last), ((0, 0), (1, 1)), constant_values=True)
        u = np.clip(np.pad(self.u, ((0, 0), (1, 1)), constant_values=((0.0, 0.0), (first, last))), first, last)
        log = np.concatenate([self._at(rows, first), self.log_gain, self._at(rows, last)], axis=1)
        sign = 1.0 if largest else -1.0
        values = sign * _response(log, self._own_factor(u, response), response)
        values = values - sign * self._tilted(u, tilt)
        values = np.where(np.isnan(values) | ~inside, -np.inf, values)
        best = values.max(axis=1)
        for k in _highest(values):
            low, high = u[rows, np.maximum(k - 1, 0)], u[rows, np.minimum(k + 1, u.shape[1] - 1)]
            best = np.maximum(best, self._polished(rows, low, high, response, sign, tilt))
        return sign * best

    def _tilted(self, u: Array, tilt: Tilt | None) -> Array | float:
        """What a tilt takes from the ln of a response."""
        return 0.0 if tilt is None else tilt.log(self.loops.omega_of(u))

    def _own_factor(self, u: Array, response: Response) -> Complex:
        """What a response has beside S on a grid of shape (m, n):  ln P of |P S|, else ln C."""
        if response is not Response.LOAD_SENSITIVITY:
            return self._log_controller(u)
        rows = np.repeat(np.arange(len(u)), u.shape[1])
        with np.errstate(all="ignore"):
            return np.asarray(np.log(self.loops.plants.at(rows, u.ravel())).reshape(u.shape), dtype=complex)

    def _log_controller(self, u: Array) -> Complex:
        """ln C on a grid of shape (m, n)."""
        if not self._narrow.size:  # all rows are the same
            return np.asarray(np.log(self.loops.controller_at(u[0]))[None, :], dtype=complex)
        return np.asarray(np.log(self.loops.controller_at(u.ravel())).reshape(u.shape), dtype=complex)

    def _at(self, rows: Rows, u: float) -> Complex:
        return self.loops.log_response(rows, np.full(len(rows), u))[:, None]

    def _polished(
        self, rows: Rows, low: Array, high: Array, response: Response, sign: float, tilt: Tilt | None
    ) -> Array:
        """The maxima within brackets, by golden-section search."""

        def value(u: Array) -> Array:
            controller: Complex = np.log(self.loops.controller_at(u))
            with np.errstate(all="ignore"):
                plant: Complex = np.log(self.loops.plants.at(rows, u))
            own = plant if response is Response.LOAD_SENSITIVITY else controller
            return sign * (_response(controller + plant, own, response) - self._tilted(u, tilt))

        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_a, at_b = value(a), value(b)
        for _ in range(_BRACKETS):
            left = at_a > at_b
            low, high = np.where(left, low, a), np.where(left, b, high)
            new = np.where(left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
            at_new = value(new)
            a, b = np.where(left, new, b), np.where(left, a, new)
            at_a, at_b = np.where(left, at_new, at_b), np.where(left, at_a, at_new)
        return np.maximum(at_a, at_b)


def _highest(values: Array) -> list[Rows]:
    """Columns of each row's highest local maxima; where a row has fewer, its highest is repeated."""
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=-np.inf)
    peak = (values >= padded[:, :-2]) & (values >= padded[:, 2:])
    heights = np.where(peak, values, -np.inf)
    top = np.argmax(values, axis=1)
    found = []
    for _ in range(_PEAKS):
        k = np.argmax(heights, axis=1)
        there = heights[np.arange(len(values)), k] > -np.inf
        found.append(np.where(there, k, top))
        heights[np.arange(len(values)), k] = -np.inf
    return found


def _response(log: Complex, own: Complex, response: Response) -> Array:
    """ln of |S|, |T|, |C S|, |P S| or |L| from ln L and ln C, or ln P of |P S|."""
    if response is Response.LOOP_GAIN:
        return log.real
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        large = log.real > 0.0
        # ln|1 + L|, by 1/L where that is the smaller
        small: Complex = np.exp(np.where(large, -log, log))
        difference = np.where(large, log.real, 0.0) + np.log(np.abs(1.0 + small))
    if response is Response.SENSITIVITY:
        return -difference
    return log.real - difference if response is Response.COMPLEMENTARY_SENSITIVITY else own.real - difference
