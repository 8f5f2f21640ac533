"""Quantities at a gain crossover:  a value psi(u, theta) with its derivatives, in ball arithmetic.

With b the angle from -1 to L, modulo a turn,

    phase margin    |b|, b in (-180, 180 deg]       rad
    delay margin    b/omega, b in [0, 360 deg)      s
    phase slope     d arg L/d ln omega              rad
    crossover       u = ln omega                    neper

On |L| = 1 a value equals its Lagrangian psi + lambda ln|L|.  The multiplier lambda is chosen so that the derivative
along u vanishes at the box's centre: the rest varies as psi does along the curve |L| = 1, to second order in the size
of the box.  Over a box on which ln L is bounded L has neither zeros nor poles, so that b is continuous there: one
sheet, chosen at the centre, serves the whole box, and where b stays within [phi, 360 deg - phi] the phase margin is at
least phi.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
from flint import acb, arb

from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.proof.balls.box import Box, ball_of, centre_of, point_box
from fopi_tune.proof.balls.loop import BallLoop, LoopEnclosure

_MOST_STEPS = 25
#: plants whose crossovers are kept
_MOST_LISTED = 4096
#: plants among which one of a box is looked for
_LATELY = 32
_LONGEST_STEP, _SHORTEST_STEP = 3.0, 1e-13
_FLAT = 1e-6
#: a larger multiplier of ln|L| would amplify rounding; the box is split instead
_LARGEST_MULTIPLIER = 1e6


class CrossingQuantity(StrEnum):
    """Quantity at a crossing; the value is its name in a certificate."""

    PHASE_MARGIN = "phase_margin_rad"
    DELAY_MARGIN = "delay_margin_s"
    PHASE_SLOPE = "phase_slope_rad"
    CROSSOVER = "log_crossover_neper"


class CrossingEvaluator:
    """Evaluates quantities at crossings of one loop; the crossings of plants are cached.

    Args:
        loop: gains and family.
        nominal_crossings: u of the nominal plant's gain crossovers, where they are known already.
    """

    def __init__(self, loop: BallLoop, nominal_crossings: Sequence[float] | None = None) -> None:
        self.loop = loop
        self._listed: dict[tuple[float, ...], list[float]] = {}
        self._lately: deque[tuple[float, ...]] = deque(maxlen=_LATELY)
        self._known = None if nominal_crossings is None else list(nominal_crossings)

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
            self._lately.append(theta)
        return self._listed[theta]

    def knows_crossings(self, theta: tuple[float, ...]) -> bool:
        """Whether this plant's crossovers were listed before: splits along u do not change it."""
        return theta in self._listed

    def listed_within(self, plants: Box) -> tuple[float, ...]:
        """A plant of a box whose crossovers were listed lately: they are near those of any other; else the centre."""
        for theta in reversed(self._lately):
            if all(low <= value <= high for value, (low, high) in zip(theta, plants, strict=True)):
                return theta
        return centre_of(plants)

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

    def value(self, quantity: CrossingQuantity, at: LoopEnclosure) -> arb:
        """psi at one frequency of one plant."""
        if quantity is CrossingQuantity.CROSSOVER:
            return ball_of(at.u)
        if quantity is CrossingQuantity.PHASE_SLOPE:
            return at.phase_slope
        lag = lag_to_minus_one(angle_from_minus_one(at.gain))
        if quantity is CrossingQuantity.DELAY_MARGIN:
            return lag / self.loop.frequency(at.omega)
        return arb.pi() - abs(arb.pi() - lag)


def angle_from_minus_one(gain: acb) -> arb:
    """b, rad, on any sheet: by arg L where that of -L is close to its branch cut."""
    return (-gain).arg() if gain.real < 0 else gain.arg() + arb.pi()


def lag_to_minus_one(angle: arb) -> arb:
    """b, rad, on the sheet on which its middle is in [0, 2 pi)."""
    return angle - 2 * arb.pi() * math.floor(float(angle.mid()) / (2.0 * math.pi)) if angle.is_finite() else angle


@dataclass(frozen=True)
class ValueOnUnitCircle:
    """Enclosures of what holds wherever |L| = 1 in a box.

    Args:
        quantity: psi.
        value: psi; of a phase margin, b.
        lag: of a margin, b, with its middle in [0, 2 pi).
        slopes: derivatives of the Lagrangian of psi, which tell how to split the box.
    """

    quantity: CrossingQuantity
    value: arb
    lag: arb
    slopes: list[arb]

    @classmethod
    def of(
        cls, loop: BallLoop, quantity: CrossingQuantity, over: LoopEnclosure, centre: LoopEnclosure, shifts: list[arb]
    ) -> ValueOnUnitCircle:
        """From the loop over a box, at its centre, and X_i - c_i; not for the crossover's frequency."""
        gains = [over.log_slope.real, *(g.real for g in over.log_gradient)]
        log_gain = abs(centre.gain).log()

        def enclosed(value: arb, slopes: list[arb]) -> tuple[arb, list[arb]]:
            combined, multiplier = with_multiplier(slopes, gains)
            variation = sum((c * d for c, d in zip(combined, shifts, strict=True)), arb(0))
            return value + multiplier * log_gain + variation, combined

        if quantity is CrossingQuantity.PHASE_SLOPE:
            value, slopes = enclosed(centre.phase_slope, over.phase_slope_derivatives)
            return cls(quantity, value, arb.nan(), slopes)
        at_centre = lag_to_minus_one(angle_from_minus_one(centre.gain))
        phase = [over.log_slope.imag, *(g.imag for g in over.log_gradient)]
        lag, slopes = enclosed(at_centre, phase)
        if quantity is CrossingQuantity.PHASE_MARGIN:
            return cls(quantity, lag, lag, slopes)
        # d/du (b/omega) = (b_u - b d ln omega/du)/omega, b by its own mean-value form
        frequency = loop.frequency(over.omega)
        around = at_centre + sum((p * d for p, d in zip(phase, shifts, strict=True)), arb(0))
        first = (phase[0] - around * loop.stretch(over.omega)) / frequency
        value, slopes = enclosed(at_centre / loop.frequency(centre.omega), [first, *(p / frequency for p in phase[1:])])
        return cls(quantity, value, lag, slopes)

    def is_within(self, level: float, upper: bool) -> bool:
        """Whether psi <= level (upper), or psi >= level, wherever |L| = 1."""
        if self.quantity is CrossingQuantity.PHASE_SLOPE:
            return bool(self.value <= level if upper else self.value >= level)
        if self.quantity is CrossingQuantity.PHASE_MARGIN:
            # pi - |pi - b|: the margin for b in [0, 2 pi], and minus the margin up to half a turn beyond
            opposite = arb.pi() - self.lag
            least, most = arb.pi() - opposite.abs_upper(), arb.pi() - opposite.abs_lower()
            return bool(most <= level and -least <= level if upper else least >= level)
        # on the next sheet b/omega would jump by 2 pi/omega
        if upper:
            return bool(self.lag >= 0 and self.value <= level)
        return bool(self.lag < 2 * arb.pi() and self.value >= level)


def with_multiplier(slopes: Sequence[arb], gains: Sequence[arb]) -> tuple[list[arb], float]:
    """Derivatives of psi + lambda ln|L|, and the multiplier lambda for which the first vanishes at the centre."""
    steep = float(gains[0].mid())
    multiplier = -float(slopes[0].mid()) / steep if steep != 0.0 else 0.0
    if not abs(multiplier) < _LARGEST_MULTIPLIER:
        multiplier = 0.0
    return [s + multiplier * g for s, g in zip(slopes, gains, strict=True)], multiplier
