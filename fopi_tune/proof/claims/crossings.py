"""Claims about every gain crossover and about every phase crossover of every plant.

Wherever |L| = 1 a value psi stays on its side of a level, by `crossing_quantities.ValueOnUnitCircle`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from flint import arb

from fopi_tune.proof.balls.box import Box, Interval, is_tail
from fopi_tune.proof.balls.loop import BallLoop, LoopEnclosure
from fopi_tune.proof.claims.claim import (
    HOLDS,
    LISTING_WORK,
    BoxVerdict,
    LoopClaim,
    deviations,
    longest_axis,
    max_smear_axis,
    tail_axis,
)
from fopi_tune.proof.claims.crossing_quantities import (
    CrossingEvaluator,
    CrossingQuantity,
    ValueOnUnitCircle,
    angle_from_minus_one,
    lag_to_minus_one,
    with_multiplier,
)


@dataclass(frozen=True)
class EveryCrossover(LoopClaim):
    """At every gain crossover (or the highest) of every plant, psi <= level, or >= level.

    Args:
        loop: gains and family.
        quantity: psi.
        level: in psi's unit.
        upper: True for <=.
        domain: frequencies and plants.
        origin: u at which the whole frequency axis is split first.
    """

    loop: BallLoop
    quantity: CrossingQuantity
    level: float
    upper: bool
    domain: Box
    origin: float
    evaluator: CrossingEvaluator = field(compare=False, repr=False)

    def examine(self, box: Box) -> BoxVerdict:
        if math.isinf(box[0][0]) and math.isinf(box[0][1]):
            return BoxVerdict(None, 0)
        over = self.loop.over(box)
        if self._is_settled(over):
            return HOLDS
        if is_tail(box[0]):
            return BoxVerdict(None, tail_axis(box, self.domain, lambda far: self._is_settled(self.loop.over(far))))
        shifts = deviations(box)
        gradient = [over.log_slope, *over.log_gradient]
        if not all(g.is_finite() for g in gradient):
            return BoxVerdict(None, longest_axis(box, self.domain))
        centre = self.loop.at_centre(box)
        log_gain = abs(centre.gain).log()
        variation = sum((g.real * d for g, d in zip(gradient, shifts, strict=True)), arb(0))
        if log_gain + variation < 0 or log_gain + variation > 0:
            return HOLDS
        if self.quantity is CrossingQuantity.CROSSOVER:  # nothing but |L| = 1 itself is in question
            beyond = box[0][1] <= self.level if self.upper else box[0][0] >= self.level
            return HOLDS if beyond else BoxVerdict(None, max_smear_axis(box, [g.real for g in gradient]))
        found = ValueOnUnitCircle.of(self.loop, self.quantity, over, centre, shifts)
        if found.is_within(self.level, self.upper):
            return HOLDS
        work = 1
        if self.quantity is CrossingQuantity.PHASE_SLOPE and self.evaluator.may_cross_often:
            plant = self.evaluator.listed_within(box[1:])
            work = 1 if self.evaluator.knows_crossings(plant) else LISTING_WORK
            if (leaf := self._not_the_highest(box, plant)) is not None:
                return BoxVerdict(leaf, work=work)
        if not all(c.is_finite() for c in found.slopes):
            return BoxVerdict(None, max_smear_axis(box, [abs(g) for g in gradient]), work=work)
        return BoxVerdict(None, max_smear_axis(box, found.slopes), work=work)

    def _is_settled(self, over: LoopEnclosure) -> bool:
        """Whether the claim holds by the range of L: |L| = 1 nowhere in the box, or towards an end of the axis far
        from -1; of a delay margin, at the axis' upper end, |L| < 1: else it is 0.
        """
        if over.high_tail and self.quantity is CrossingQuantity.DELAY_MARGIN:
            return bool(over.size < 1)
        return has_no_gain_crossover(over) or ((over.low_tail or over.high_tail) and self._is_far_from_minus_one(over))

    def _is_far_from_minus_one(self, over: LoopEnclosure) -> bool:
        """Whether the angle between -1 and L meets the level in all of a tail.

        As omega -> 0 or inf |L| may tend to 1, so that plants with a crossover there and without one are neighbours.
        """
        lag = lag_to_minus_one(angle_from_minus_one(over.gain))
        if self.quantity is CrossingQuantity.PHASE_MARGIN:
            return ValueOnUnitCircle(self.quantity, lag, lag, []).is_within(self.level, self.upper)
        if self.quantity is not CrossingQuantity.DELAY_MARGIN or self.upper:
            return False
        # b/omega >= level for every omega of the low tail, 0 included
        return bool(lag < 2 * arb.pi() and lag >= self.level * self.loop.frequency(over.omega))

    def holds(self, box: Box, leaf: str) -> bool:
        if leaf[:1] != "h":
            return super().holds(box, leaf)
        bracket = parse_bracket(leaf[1:])
        if self.quantity is not CrossingQuantity.PHASE_SLOPE or bracket is None or not box[0][1] < bracket[0]:
            return False
        return changes_sign(self.loop, bracket, box[1:])

    def _not_the_highest(self, box: Box, plant: tuple[float, ...]) -> str | None:
        """A leaf with a change of sign of ln|L| at higher frequencies for every plant of the box; None if not found.

        `plant` is one of the box, by whose crossovers the bracket is chosen.
        """
        higher = [u for u in self.evaluator.all_crossings(plant) if u > box[0][1]]
        if not higher:
            return None
        below = max(box[0][1], higher[-2]) if len(higher) > 1 else box[0][1]
        leaf = f"h{0.5 * (below + higher[-1])!r}:{higher[-1] + 1.0!r}"
        return leaf if self.holds(box, leaf) else None

    def to_dict(self) -> dict[str, Any]:
        return {
            "kind": "every_crossover",
            "reading": self.quantity.value,
            "level": self.level,
            "relation": "at_most" if self.upper else "at_least",
        }


def has_no_gain_crossover(over: LoopEnclosure) -> bool:
    """Whether |L| = 1 nowhere in the box."""
    gain = over.gain
    if gain.is_finite():
        return bool(over.size < 1 or gain.abs_lower() > 1)
    inverse = over.inverse_gain
    return bool(inverse.is_finite() and inverse.abs_upper() < 1)


def parse_bracket(ends: str) -> Interval | None:
    """The interval of u in `-1.25:-1.2`; None when it is none."""
    low, _, high = ends.partition(":")
    try:
        bracket = float(low), float(high)
    except ValueError:
        return None
    return bracket if -math.inf < bracket[0] < bracket[1] < math.inf else None


def changes_sign(loop: BallLoop, ends: tuple[float, float], plants: Box) -> bool:
    """Whether |L| - 1 has opposite signs at both ends, and each the same for every plant."""
    signs = [_sign(loop, end, plants) for end in ends]
    return signs[0] * signs[1] < 0


def _sign(loop: BallLoop, u: float, plants: Box) -> int:
    box = ((u, u), *plants)
    over = loop.over(box)
    gain = over.gain
    if gain.is_finite():
        if gain.abs_lower() > 1:
            return 1
        if gain.abs_upper() < 1:
            return -1
    gradient = over.log_gradient
    middle = abs(loop.at_centre(box).gain).log()
    value = middle + sum((g.real * d for g, d in zip(gradient, deviations(plants), strict=True)), arb(0))
    return 1 if value > 0 else -1 if value < 0 else 0


@dataclass(frozen=True)
class EveryPhaseCrossover(LoopClaim):
    """No plant has arg L = -180 deg (mod 360) with  -level < ln|L| <= 0 : the gain margin is at least `level`.

    With b = arg(-L), here ln|L| + lambda b is bounded where b = 0.

    Args:
        loop: gains and family.
        level: in neper, >= 0.
        domain: frequencies and plants.
        origin: u at which the whole frequency axis is split first.
    """

    loop: BallLoop
    level: float
    domain: Box
    origin: float

    def examine(self, box: Box) -> BoxVerdict:
        if math.isinf(box[0][0]) and math.isinf(box[0][1]):
            return BoxVerdict(None, 0)
        over = self.loop.over(box)
        if self._is_apart(over):
            return HOLDS
        if is_tail(box[0]):
            if self._is_small(box, over):
                return HOLDS
            return BoxVerdict(None, tail_axis(box, self.domain, self._settles))
        shifts = deviations(box)
        gradient = [over.log_slope, *over.log_gradient]
        if not all(g.is_finite() for g in gradient):
            return BoxVerdict(None, longest_axis(box, self.domain))
        centre = self.loop.at_centre(box).gain
        log_gain = abs(centre).log()
        larger = log_gain + sum((g.real * d for g, d in zip(gradient, shifts, strict=True)), arb(0))
        if larger > 0 or larger < -arb(self.level):
            return HOLDS
        turn = (-centre).arg()
        turned = turn + sum((g.imag * d for g, d in zip(gradient, shifts, strict=True)), arb(0))
        if not turned.abs_upper() < 2 * arb.pi():
            return BoxVerdict(None, max_smear_axis(box, [abs(g) for g in gradient]))
        if turned > 0 or turned < 0:
            return HOLDS
        combined, multiplier = with_multiplier([g.real for g in gradient], [g.imag for g in gradient])
        total = log_gain + multiplier * turn + sum((c * d for c, d in zip(combined, shifts, strict=True)), arb(0))
        if total < -arb(self.level):
            return HOLDS
        return BoxVerdict(None, max_smear_axis(box, combined))

    def _settles(self, far: Box) -> bool:
        over = self.loop.over(far)
        return self._is_apart(over) or self._is_small(far, over)

    def _is_small(self, box: Box, over: LoopEnclosure) -> bool:
        """Whether |L| < e^-level over a tail, by its mean-value form in the plants, at their worse ends."""
        gradient = [g.real for g in over.log_gradient]
        if not gradient or not all(g.is_finite() for g in gradient):
            return False
        ends = ((b, b) if g > 0 else (a, a) if g < 0 else (a, b) for g, (a, b) in zip(gradient, box[1:], strict=True))
        face = (box[0], *ends)
        variation = sum((g * d for g, d in zip(gradient, deviations(face)[1:], strict=True)), arb(0))
        return bool(self.loop.at_centre(face).size.log() + variation < -arb(self.level))

    def _is_apart(self, over: LoopEnclosure) -> bool:
        """Whether L does not meet [-1, -e^-level]."""
        gain = over.gain
        if not gain.is_finite():
            inverse = over.inverse_gain
            return bool(inverse.is_finite() and inverse.abs_upper() < 1)
        small, large = over.size < (-arb(self.level)).exp(), gain.abs_lower() > 1
        return bool(small or large or gain.real > 0 or not gain.imag.contains(0))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "every_phase_crossover", "level_neper": self.level}
