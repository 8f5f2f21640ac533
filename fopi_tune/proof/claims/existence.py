"""Claims that every plant has a crossing:  each box comes with a bracket of two frequencies with a change of sign.

A leaf `x-1.25:-1.2` states: every plant of the box has a crossing between these values of u, and at every crossing
there the value meets the level.  A leaf `e+` is about the limit at the axis' upper end, `e-` about that at 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import acb, arb

from fopi_tune.core.crossings import phase_crossovers
from fopi_tune.proof.balls.box import Box, Interval, centre_of
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.claim import (
    LISTING_WORK,
    BoxVerdict,
    LoopClaim,
    deviations,
    longest_parameter_axis,
    magnitude,
    max_smear_axis,
)
from fopi_tune.proof.claims.crossing_quantities import (
    CrossingEvaluator,
    CrossingQuantity,
    ValueOnUnitCircle,
    with_multiplier,
)
from fopi_tune.proof.claims.crossings import changes_sign, parse_bracket

#: widths in u of the brackets tried for a crossing whose value does not matter
_WIDTHS = (1.0, 4.0, 16.0)
_LEAST_HALF_WIDTH = 1e-10
#: added to a bracket in turn: close to a flat crossing the sign cannot be determined
_MORE = (0.0, 1e-7, 1e-4)
_FARTHEST = 16.0
#: tokens of the ends of the frequency axis, and u beyond which only the limit remains
LOW_END, HIGH_END = "e-", "e+"
_FAR_OUT = 1e12
#: work of following a crossing by Newton's method, in boxes of a bound
_FOLLOWING_WORK = 2
#: relative error that a value at a crossing found in floating point stays far below
_DOUBT = 1e-9
#: crossings in a list for which the work of listing one more time counts
_LISTED_TOGETHER = 50


@dataclass(frozen=True)
class SomeCrossover(LoopClaim):
    """Every plant has a gain crossover with psi <= level (or >= level); without a level, any.

    Of a delay margin, which is 0 where |L| does not fall below 1 at the axis' upper end: that, or such a crossover.

    Args:
        loop: gains and family.
        quantity: psi.
        level: in psi's unit; None for a crossover anywhere.
        upper: True for <=.
        domain: the plants; axis 0 is not cut.
        origin: not used.
    """

    loop: BallLoop
    quantity: CrossingQuantity
    level: float | None
    upper: bool
    domain: Box
    origin: float
    evaluator: CrossingEvaluator = field(compare=False, repr=False)

    def examine(self, box: Box) -> BoxVerdict:
        if self.quantity is CrossingQuantity.DELAY_MARGIN and self.holds(box, HIGH_END):
            return BoxVerdict(HIGH_END)
        theta = centre_of(box[1:])
        followed = self.evaluator.followed_crossing(theta)
        leaf, axis, tried = self._first_leaf(followed, box)
        work = _FOLLOWING_WORK + tried
        if leaf is not None:
            return BoxVerdict(leaf, work=work)
        if followed and not self.evaluator.may_cross_often:
            return BoxVerdict(None, axis, work=work)
        listed = self._most_favourable(theta)
        leaf, axis, tried = self._first_leaf(listed, box)
        work += LISTING_WORK + tried
        if leaf is not None:
            return BoxVerdict(leaf, work=work)
        # without a crossing that meets the level the claim is false at the centre, and no split can help
        return BoxVerdict(None, axis if listed else -1, work=work)

    def _first_leaf(self, candidates: Sequence[float], box: Box) -> tuple[str | None, int, int]:
        """A leaf for one of these crossings of the central plant, or None; the axis to split; brackets tried."""
        axis, tried = -1, 0
        for u in candidates:
            over = self.loop.over(((u, u), *box[1:]))
            reach = crossing_reach(over.log_slope.real, [g.real for g in over.log_gradient], box)
            gradient = [g.real for g in over.log_gradient] if self._only_its_place else over.log_gradient
            if u == candidates[0]:
                axis = axis_of(gradient, box, self.domain)
            for bracket in self._brackets(u, reach):
                leaf = f"x{bracket[0]!r}:{bracket[1]!r}"
                tried += 1
                if self.holds(box, leaf):
                    return leaf, axis, tried
        return None, axis, tried

    @property
    def _only_its_place(self) -> bool:
        """Whether only the crossing's frequency matters, so that |L| alone decides."""
        return self.level is None or self.quantity is CrossingQuantity.CROSSOVER

    def _brackets(self, u: float, reach: float) -> list[Interval]:
        """Brackets to try for the crossing at u: narrow where its value matters, else up to wide ones."""
        near = [(u - reach - more, u + reach + more) for more in _MORE]
        if self.level is None:
            return [near[0], *((u - width, u + width) for width in _WIDTHS)]
        if self.quantity is not CrossingQuantity.CROSSOVER:
            return near
        return [near[0], *((self.level, max(u, self.level) + width) for width in _WIDTHS)]

    def _most_favourable(self, theta: tuple[float, ...]) -> list[float]:
        """Gain crossovers of one plant, the most favourable first: at most two, and only those that meet the level."""
        found = self.evaluator.all_crossings(theta)
        if self._only_its_place:
            return found[-1:]
        values: list[tuple[float, float]] = []
        for u in found:
            at = self.loop.at_centre(((u, u), *((value, value) for value in theta)))
            value = float(self.evaluator.value(self.quantity, at).mid())
            if not self._misses_level(value):
                values.append((value, u))
        return [u for _, u in sorted(values, reverse=not self.upper)][:2]

    def _misses_level(self, value: float) -> bool:
        """Whether a value in floating point violates the level, beyond doubt."""
        if self.level is None:
            return False
        beyond = value - self.level if self.upper else self.level - value
        return beyond > _DOUBT * max(1.0, abs(self.level))

    def holds(self, box: Box, leaf: str) -> bool:
        if leaf == HIGH_END:
            return self._stays_large(box)
        bracket = parse_bracket(leaf[1:]) if leaf[:1] == "x" else None
        if bracket is None:
            return False
        low, high = bracket
        if self.level is None:
            return changes_sign(self.loop, bracket, box[1:])
        if self.quantity is CrossingQuantity.CROSSOVER:
            # a crossing in the part of the bracket beyond the level
            low, high = (low, min(high, self.level)) if self.upper else (max(low, self.level), high)
            return low < high and changes_sign(self.loop, (low, high), box[1:])
        return changes_sign(self.loop, bracket, box[1:]) and self._meets_level(self.level, (bracket, *box[1:]))

    def _meets_level(self, level: float, box: Box) -> bool:
        over, centre = self.loop.over(box), self.loop.at_centre(box)
        return ValueOnUnitCircle.of(self.loop, self.quantity, over, centre, deviations(box)).is_within(
            level, self.upper
        )

    def _stays_large(self, box: Box) -> bool:
        """Whether the delay margin of every plant is 0, because |L| > 1 at the axis' upper end."""
        if self.quantity is not CrossingQuantity.DELAY_MARGIN or self.level is None or not self.upper or self.level < 0:
            return False
        over = self.loop.over(((_FAR_OUT, math.inf), *box[1:]))
        gain, inverse = over.gain, over.inverse_gain
        return bool(gain.abs_lower() > 1 if gain.is_finite() else inverse.is_finite() and inverse.abs_upper() < 1)

    def to_dict(self) -> dict[str, Any]:
        return {
            "kind": "some_crossover",
            "reading": self.quantity.value,
            "level": self.level,
            "relation": "at_most" if self.upper else "at_least",
        }


@dataclass(frozen=True)
class SomePhaseCrossover(LoopClaim):
    """Every plant has arg L = -180 deg (mod 360) with  -level <= ln|L| < 0 : the gain margin is at most `level`.

    Args:
        loop: gains and family.
        level: in neper, > 0.
        domain: the plants; axis 0 is not cut.
        origin: not used.
        hint: u of a crossing, where it is known already; infinite at the ends of the axis.
    """

    loop: BallLoop
    level: float
    domain: Box
    origin: float
    hint: float | None = field(default=None, compare=False)

    def examine(self, box: Box) -> BoxVerdict:
        if self.hint is not None and (leaf := self._leaf(self.hint, box)) is not None:
            return BoxVerdict(leaf)
        theta = centre_of(box[1:])
        crossings = phase_crossovers(self.loop.loops_at(np.array([theta], dtype=float)))
        work = LISTING_WORK * (2 + len(crossings.row) // _LISTED_TOGETHER)
        useful = (crossings.gain < 1.0) & (np.log(crossings.gain) > -self.level - _DOUBT)
        if not useful.any():
            return BoxVerdict(None, -1, work=work)  # false at the centre
        k = int(np.argmax(np.where(useful, crossings.gain, -1.0)))
        u = float(crossings.u[k])
        leaf = self._leaf(u, box)
        if leaf is not None:
            return BoxVerdict(leaf, work=work)
        if math.isinf(u):
            return BoxVerdict(None, longest_parameter_axis(box, self.domain), work=work)
        gradient = self.loop.over(((u, u), *box[1:])).log_gradient
        return BoxVerdict(None, axis_of(gradient, box, self.domain), work=work)

    def _leaf(self, u: float, box: Box) -> str | None:
        """The leaf for a crossing of the central plant or an end of the axis; None if the claim does not hold."""
        if math.isinf(u):
            end = LOW_END if u < 0.0 else HIGH_END
            return end if self.holds(box, end) else None
        over = self.loop.over(((u, u), *box[1:]))
        reach = crossing_reach(over.log_slope.imag, [g.imag for g in over.log_gradient], box)
        leaves = (f"x{u - reach - more!r}:{u + reach + more!r}" for more in _MORE)
        return next((leaf for leaf in leaves if self.holds(box, leaf)), None)

    def holds(self, box: Box, leaf: str) -> bool:
        if leaf in (LOW_END, HIGH_END):
            return self._is_negative_at_the_end(box, leaf == HIGH_END)
        bracket = parse_bracket(leaf[1:]) if leaf[:1] == "x" else None
        if bracket is None:
            return False
        signs = [self._turn(((end, end), *box[1:]))[0] for end in bracket]
        if not ((signs[0] > 0 and signs[1] < 0) or (signs[0] < 0 and signs[1] > 0)):
            return False
        turn, combined = self._turn((bracket, *box[1:]))
        # -L keeps away from the negative real axis, so that its argument is continuous and passes 0
        return bool(turn.abs_upper() < arb.pi() and combined <= 0 and combined >= -arb(self.level))

    def _is_negative_at_the_end(self, box: Box, high: bool) -> bool:
        """Whether L tends to a number from -1 to -e^-level as omega -> 0, or at the axis' upper end."""
        u = (_FAR_OUT, math.inf) if high else (-math.inf, -_FAR_OUT)
        over = self.loop.over((u, *box[1:]))
        smallest = (-arb(self.level)).exp()
        if high and not self.loop.has_upper_limit(over):
            # a dead time turns L without end, through -180 deg again and again while |C N/D| hardly changes
            size = over.c * over.numerator / over.d
            late = bool(over.plant.dead_time.value > 0)
            return late and size.is_finite() and bool(size.abs_upper() < 1 and size.abs_lower() >= smallest)
        # else the limit is real
        gain = over.gain.real
        return bool(gain < 0 and gain > -1 and -gain >= smallest)

    def _turn(self, box: Box) -> tuple[arb, arb]:
        """b = arg(-L) over a box, and ln|L| + lambda b."""
        over, shifts = self.loop.over(box), deviations(box)
        gradient = [over.log_slope, *over.log_gradient]
        centre = self.loop.at_centre(box).gain
        turn, log_gain = (-centre).arg(), abs(centre).log()
        combined, multiplier = with_multiplier([g.real for g in gradient], [g.imag for g in gradient])
        turned = turn + sum((g.imag * d for g, d in zip(gradient, shifts, strict=True)), arb(0))
        total = log_gain + multiplier * turn + sum((c * d for c, d in zip(combined, shifts, strict=True)), arb(0))
        return turned, total

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "some_phase_crossover", "level_neper": self.level}


def crossing_reach(slope: arb, gradient: list[arb], box: Box) -> float:
    """How far a crossing moves from that of the central plant over the box, with a safety factor."""
    moved = [abs(g / slope) for g in gradient]
    reach = sum(magnitude(m) * 0.5 * (b - a) for m, (a, b) in zip(moved, box[1:], strict=True) if a < b)
    return 1.25 * reach + _LEAST_HALF_WIDTH if reach < _FARTHEST else _FARTHEST


def axis_of(gradient: Sequence[arb | acb], box: Box, domain: Box) -> int:
    """The uncertain number along which the function with this gradient varies most."""
    sizes = [abs(g) for g in gradient]
    if not sizes or not all(size.is_finite() for size in sizes):
        return longest_parameter_axis(box, domain)
    return max_smear_axis(((0.0, 0.0), *box[1:]), [arb(0), *sizes])
