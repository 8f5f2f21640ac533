"""Quantities at a gain crossover:  a value psi(u, theta) with its derivatives, in ball arithmetic.

phase margin    pi + arg L                  rad
delay margin    (pi + arg L)/omega          s
phase slope     d arg L/d ln omega          rad
crossover       u = ln omega                neper
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from functools import cached_property

import numpy as np
from flint import arb

from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.proof.balls.box import ball_of, point_box
from fopi_tune.proof.balls.loop import BallLoop, LoopEnclosure
from fopi_tune.proof.balls.unwrapped_phase import PolynomialPhase, plant_phases, unwrapped_phase

_MOST_STEPS = 25
#: plants whose crossovers are kept
_MOST_LISTED = 4096
_LONGEST_STEP, _SHORTEST_STEP = 3.0, 1e-13
_FLAT = 1e-6


class CrossingQuantity(StrEnum):
    """Quantity at a crossing; the value is its name in a certificate."""

    PHASE_MARGIN = "phase_margin_rad"
    DELAY_MARGIN = "delay_margin_s"
    PHASE_SLOPE = "phase_slope_rad"
    CROSSOVER = "log_crossover_neper"


class CrossingEvaluator:
    """Evaluates quantities at crossings of one loop; the phases of plants along the axis are cached.

    Args:
        loop: gains and family.
        nominal_crossings: u of the nominal plant's gain crossovers, where they are known already.
    """

    def __init__(self, loop: BallLoop, nominal_crossings: Sequence[float] | None = None) -> None:
        self.loop = loop
        self._phases: dict[tuple[float, ...], tuple[PolynomialPhase, PolynomialPhase]] = {}
        self._listed: dict[tuple[float, ...], list[float]] = {}
        self._known = None if nominal_crossings is None else list(nominal_crossings)

    def phase(self, at: LoopEnclosure, theta: tuple[float, ...]) -> arb:
        """arg L, unwrapped, at one frequency of one plant."""
        if theta not in self._phases:
            if len(self._phases) > 4096:
                self._phases.clear()
            self._phases[theta] = plant_phases(self.loop, theta)
        return unwrapped_phase(self.loop, at, self._phases[theta])

    @cached_property
    def _nominal_crossings(self) -> list[float]:
        if self._known is not None:
            return self._known
        return self.all_crossings(tuple(self.loop.family.nominal_point.tolist()))

    def all_crossings(self, theta: tuple[float, ...]) -> list[float]:
        """u of one plant's gain crossovers, ascending, in floating point; used only to choose brackets."""
        if theta not in self._listed:
            if len(self._listed) > _MOST_LISTED:
                self._listed.clear()
            self._listed[theta] = gain_crossovers(self.loop.loops_at(np.array([theta], dtype=float))).u.tolist()
        return self._listed[theta]

    def knows_crossings(self, theta: tuple[float, ...]) -> bool:
        """Whether this plant's crossovers were listed before: splits along u do not change it."""
        return theta in self._listed

    @cached_property
    def may_cross_often(self) -> bool:
        """Whether the nominal plant or one of the box's corners has more than one gain crossover."""
        if len(self._nominal_crossings) > 1:
            return True
        loops = self.loop.loops_at(self.loop.family.corners())
        return bool(np.bincount(gain_crossovers(loops).row, minlength=1).max() > 1)

    def followed_crossing(self, theta: tuple[float, ...]) -> list[float]:
        """The continuation of the nominal plant's only crossover; empty if it has several or Newton's method fails."""
        if len(self._nominal_crossings) != 1:
            return []
        found = self._follow(self._nominal_crossings[0], theta)
        return [] if found is None else [found]

    def _follow(self, u: float, theta: tuple[float, ...]) -> float | None:
        """Newton's method from the nominal plant's crossover."""
        plant = self.loop.plants(point_box(theta))
        for _ in range(_MOST_STEPS):
            at = self.loop.enclosure((u, u), plant)
            value, slope = float(abs(at.gain).log().mid()), float(at.log_slope.real.mid())
            if not abs(slope) > _FLAT or not abs(value / slope) < _LONGEST_STEP:
                return None
            u -= value / slope
            if abs(value / slope) < _SHORTEST_STEP:
                return u
        return None

    def value(self, quantity: CrossingQuantity, at: LoopEnclosure, theta: tuple[float, ...]) -> arb:
        """psi at one frequency of one plant."""
        if quantity is CrossingQuantity.CROSSOVER:
            return ball_of(at.u)
        if quantity is CrossingQuantity.PHASE_SLOPE:
            return at.phase_slope
        margin = self.phase(at, theta) + arb.pi()
        return margin if quantity is CrossingQuantity.PHASE_MARGIN else margin / self.loop.frequency(at.omega)


def derivatives_of(
    loop: BallLoop, quantity: CrossingQuantity, over: LoopEnclosure, centre: arb, shifts: Sequence[arb], omega: arb
) -> list[arb]:
    """The derivatives of psi over a box.

    Args:
        loop: the loop.
        quantity: psi.
        over: the loop over the box.
        centre: psi at the centre.
        shifts: X_i - c_i.
        omega: e^u at the centre.
    """
    if quantity is CrossingQuantity.CROSSOVER:
        return [arb(1), *(arb(0) for _ in over.log_gradient)]
    if quantity is CrossingQuantity.PHASE_SLOPE:
        return over.phase_slope_derivatives
    phase = [over.log_slope.imag, *(g.imag for g in over.log_gradient)]
    if quantity is CrossingQuantity.PHASE_MARGIN:
        return phase
    # d/du (phi/omega) = (phi_u - phi d ln omega/du)/omega, phi by its own mean-value form
    frequency = loop.frequency(over.omega)
    margin = centre * loop.frequency(omega) + sum((p * d for p, d in zip(phase, shifts, strict=True)), arb(0))
    first = (phase[0] - margin * loop.stretch(over.omega)) / frequency
    return [first, *(p / frequency for p in phase[1:])]
