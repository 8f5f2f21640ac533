"""Margins and peaks of thousands of sampled loops at once:  found on a frequency grid, then refined.

`fopi_tune.core` finds every crossing and every peak, at any cost.  Here a crossing is a change of sign between
neighbouring points of a dense grid in u = ln tan(omega Ts/2), refined by Newton's method to rounding, and a peak is one
of the grid's highest points, refined by golden-section search.  Each draw has points of its own next to its resonances
that are narrower than the grid.  Two crossings between neighbouring points would be missed; that is acceptable for
statistics over sampled plants, not for a proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import Crossings, negative_ends
from fopi_tune.core.peaks import Response, Tilt
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_poles_from
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB, EvaluatedAt, QuantityAtCrossings
from fopi_tune.quantities.responses import FrequencyFunction
from fopi_tune.spec.model import Requirement

if TYPE_CHECKING:
    from fopi_tune.montecarlo.scan_kernel import Grid, Scanned

#: grid points, and the least number per sample of delay
_POINTS, _POINTS_A_DELAY = 400, 16
#: widths in u of the coarse ends of the grid, below the lowest and above the highest corner, and their points
_SPARSE_BELOW, _SPARSE_ABOVE, _TAIL = 6.0, 12.0, 12
_NEWTON = 12
#: points on each side of a narrow resonance or anti-resonance, from a fraction of its half-width to the grid's spacing
_BESIDE, _NEAREST = 16, 0.1
_ROUNDING = 4e-15
#: by their numbers in `scan_kernel`
_RESPONSES = (
    Response.SENSITIVITY,
    Response.COMPLEMENTARY_SENSITIVITY,
    Response.CONTROL_SENSITIVITY,
    Response.LOAD_SENSITIVITY,
    Response.LOOP_GAIN,
)


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
    def grid(self) -> Grid:
        """L on the grid."""
        from fopi_tune.montecarlo.scan_kernel import grid_of

        shared = not self._narrow.size
        u = np.ascontiguousarray(self.u[:1] if shared else self.u)
        rows = np.zeros(len(self.loops), dtype=np.int64) if shared else np.arange(len(self.loops))
        return grid_of(self._scanned, u, rows)

    @cached_property
    def _scanned(self) -> Scanned:
        """The loops, for compiled functions."""
        from fopi_tune.montecarlo.scan_kernel import Scanned

        filtered = self.loops.filter_of_nu
        bottom = np.array([(1.0,) if filtered is None else filtered.coefficients], dtype=float)
        top, below = (np.ascontiguousarray(side, dtype=float) for side in self.loops.plants.polynomials)
        return Scanned(self.loops.direct, bottom, top, below, 0.5 * self.loops.sections.sample_time_s)

    @cached_property
    def gain_crossings(self) -> Crossings:
        """|L| = 1, sorted by row and frequency."""
        return self._crossings(of_phase=False)

    @cached_property
    def phase_crossings(self) -> Crossings:
        """arg L = -180 deg (mod 360), the limits at both ends of the frequency axis included."""
        parts = (self._crossings(of_phase=True), *negative_ends(self.loops))
        columns = [np.concatenate([getattr(part, name) for part in parts]) for name in Crossings.__dataclass_fields__]
        order = np.lexsort((columns[1], columns[0]))
        return Crossings(*(column[order] for column in columns))

    def _crossings(self, of_phase: bool) -> Crossings:
        """Refined crossings, of a phase or of a gain, between neighbouring points of the grid."""
        from fopi_tune.montecarlo.scan_kernel import crossings_of

        row, k, rising = crossings_of(self.grid, of_phase)
        low, high = self.u[row, k], self.u[row, k + 1]
        u = 0.5 * (low + high)
        value, slope = self.loops.log_response_and_slope(row, u)
        # the phase that is crossed: the odd multiple of pi nearest to that between the two points
        line = 2.0 * np.pi * np.round((value.imag + np.pi) / (2.0 * np.pi)) - np.pi if of_phase else np.zeros(len(row))
        for _ in range(_NEWTON):
            distance, steepness = (value.imag - line, slope.imag) if of_phase else (value.real, slope.real)
            right = (distance >= 0.0) == rising
            high, low = np.where(right, u, high), np.where(right, low, u)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = u - distance / steepness
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
        from fopi_tune.montecarlo.scan_kernel import extremes_of

        ends = float(self._shared[0]), float(self._shared[-1])
        first = float(self.loops.u_of(np.array(from_rad_s))) if from_rad_s > 0.0 else ends[0]
        last = float(self.loops.u_of(np.array(to_rad_s))) if to_rad_s < self.loops.highest_rad_s else ends[1]
        sign = 1.0 if largest else -1.0
        tilted = (0.0, 0.0) if tilt is None else (float(tilt.power), float(np.log(tilt.omega_rad_s)))
        return sign * extremes_of(self._scanned, self.grid, first, last, _RESPONSES.index(response), sign, tilted)
