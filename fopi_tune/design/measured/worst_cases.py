"""The worst frequencies of every row and member at given gains, on the curves themselves:  findings of the exchange.

A finding is a row of numbers as in `global_search/worst_case.py`: row, slack, v, the phase that tells the branch, how
its frequency is determined, a target, and the member's place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.measured.loops import LoopPoints, MeasuredLoop
from fopi_tune.core.measured.stability import count_unstable_poles
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import (
    CROSSOVER,
    CS,
    DELAY_MARGIN,
    GAIN_AT_REFERENCE,
    GAIN_MARGIN,
    LOOP_GAIN,
    PHASE_MARGIN,
    PHASE_SLOPE,
    PS,
    Rows,
    S,
    T,
)
from fopi_tune.design.global_search.responses import AT_FIXED, AT_GAIN, AT_PEAK, AT_PHASE, AT_REFERENCE

#: natural units: findings of a row this much less deep than its worst are left out
_LESS_DEEP = 0.25
#: natural units: a row whose slack between columns may be so much smaller than on them
_MUCH_DEEPER = 1.0
#: findings of a row and member
_MOST_OF_A_ROW = 4
#: v within which a place is an end of a band
_AT_END = 1e-9
#: neper; a phase crossover with a larger |L| has no gain margin but a reduction margin
_ABOVE_ONE = 1e-9


def value_of(kind: int, points: LoopPoints, scale: Scale) -> Array:
    """A quantity's natural value in the search's numbers at the points of a loop; margins are angles and lags to -1."""
    log_gain = math.log(scale.gain)
    if kind == S:
        return -points.log_return_difference
    if kind == T:
        return points.log_gain - points.log_return_difference
    if kind == CS:
        return points.log_controller + log_gain - points.log_return_difference
    if kind == PS:
        return points.log_plant - log_gain - points.log_return_difference
    if kind in (LOOP_GAIN, GAIN_AT_REFERENCE):
        return points.log_gain
    if kind == PHASE_MARGIN:
        return points.phase_margin_rad
    if kind == DELAY_MARGIN:
        return points.lag_to_minus_one_rad / points.omega_rad_s * scale.omega_rad_s
    if kind == GAIN_MARGIN:
        return -points.log_gain
    if kind == CROSSOVER:
        return points.u - math.log(scale.omega_rad_s)
    assert kind == PHASE_SLOPE
    return points.phase_slope_rad * math.log(10.0)


@dataclass(frozen=True)
class WorstCases:
    """The search at one set of gains.

    Args:
        loops: of every member.
        rows: what is asked, requirements first.
        real_rows: how many of them are requirements'.
        scale: of the search's numbers.
        within: findings of requirements with a larger slack are left out, natural units.
    """

    loops: list[MeasuredLoop]
    rows: Rows
    real_rows: int
    scale: Scale
    within: float

    def find(self, unstable_poles: int | None) -> Array | None:
        """Findings, shape (k, 7); None where a loop is not shown to be stable, or a quantity has no value.

        Args:
            unstable_poles: of the plant.
        """
        if any(count_unstable_poles(loop, unstable_poles).unstable != 0.0 for loop in self.loops):
            return None
        found: list[Array] = []
        for q in range(len(self.rows.kind)):
            for member in range(1 if self.rows.nominal[q] else len(self.loops)):
                places = self._places(q, member)
                if places is None:
                    return None
                found += self._findings(q, member, *places)
        return np.array(found).reshape(len(found), 7)

    def slack(self, q: int, points: LoopPoints) -> Array:
        """Of an inequality how far inside, of an equality minus the distance; natural units, at the points of a loop.

        Args:
            q: the row.
            points: of a loop.
        """
        rows, v = self.rows, points.u - math.log(self.scale.omega_rad_s)
        value = value_of(int(rows.kind[q]), points, self.scale)
        off = (rows.limit[q] + rows.tilt[q] * v - value) * rows.scale[q]
        return -np.abs(off) if rows.side[q] == 0 or rows.kind[q] == GAIN_AT_REFERENCE else rows.side[q] * off

    def _places(self, q: int, member: int) -> tuple[Array, Array] | None:
        """u where a row may be worst, and how each is determined; None where the quantity has no value."""
        kind, side, loop = int(self.rows.kind[q]), float(self.rows.side[q]), self.loops[member]
        if kind <= LOOP_GAIN:
            return self._dips(q, loop)
        if kind == GAIN_AT_REFERENCE:
            u = self.loops[0].gain_crossovers[-1:]
            return (u, np.full(len(u), AT_REFERENCE)) if len(u) else None
        if kind == GAIN_MARGIN:
            u = loop.phase_crossovers
            gain = loop.at(u).log_gain
            u, gain = u[gain <= _ABOVE_ONE], gain[gain <= _ABOVE_ONE]
            u = u if side < 0 else u[gain == gain.max()][:1] if len(u) else u
            return (u, np.full(len(u), AT_PHASE)) if len(u) or side < 0 else None
        u = loop.gain_crossovers
        if kind in (CROSSOVER, PHASE_SLOPE):
            u = u[-1:]
        elif side >= 0 and len(u):
            u = u[[int(value_of(kind, loop.at(u), self.scale).argmin())]]
        is_optional = kind in (PHASE_MARGIN, DELAY_MARGIN) and side < 0
        return (u, np.full(len(u), AT_GAIN)) if len(u) or is_optional else None

    def _dips(self, q: int, loop: MeasuredLoop) -> tuple[Array, Array]:
        """Local minima of the slack over a row's band."""
        unit = math.log(self.scale.omega_rad_s)
        low, high = (max(min(float(end) + unit, loop.grid[-1]), loop.grid[0])
                     for end in (self.rows.low_v[q], self.rows.high_v[q]))  # fmt: skip
        if q < self.real_rows:
            inside = (loop.grid >= low) & (loop.grid <= high)
            slack = self.slack(q, loop.on_grid)[inside]
            if len(slack) and slack.min() > self.within + _MUCH_DEEPER:
                return np.zeros(0), np.zeros(0)
        u = loop.extremes(lambda points: -self.slack(q, points), True, math.exp(low), math.exp(high), _LESS_DEEP)
        ends = (u < low + _AT_END) | (u > high - _AT_END)
        return u, np.where(ends, AT_FIXED, AT_PEAK)

    def _findings(self, q: int, member: int, u: Array, modes: Array) -> list[Array]:
        if not len(u):
            return []
        loop = self.loops[member]
        points = loop.at(u)
        slack = self.slack(q, points)
        # the dead time has a place of its own
        near = points.phase_rad + np.exp(u) * loop.curve.dead_time_s
        turns = np.round((points.phase_rad - math.pi) / (2.0 * math.pi))
        deepest = slack.min()
        found = []
        for k in np.argsort(slack, kind="stable")[:_MOST_OF_A_ROW]:
            if slack[k] > deepest + _LESS_DEEP or (slack[k] > self.within and q < self.real_rows):
                break
            target = 2.0 * math.pi * turns[k] + math.pi
            v = u[k] - math.log(self.scale.omega_rad_s)
            found.append(np.array([q, slack[k], v, near[k], modes[k], target, member]))
        return found
