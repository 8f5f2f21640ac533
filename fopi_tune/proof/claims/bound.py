"""The claim that |S|, |T|, |C S|, |P S| or |L| stays below (or above) a level over a band, for every plant.

d ln|S| = -Re(T d ln L),   d ln|T| = Re(S d ln L),   d ln|C S| = Re(d ln C - T d ln L),   d ln|L| = Re(d ln L),
d ln|P S| = Re(S d ln L - d ln C)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flint import acb, arb

from fopi_tune.core.peaks import Response
from fopi_tune.proof.balls.box import Box, is_tail
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.loop import BallLoop, LoopEnclosure
from fopi_tune.proof.claims.claim import (
    HOLDS,
    BoxVerdict,
    LoopClaim,
    longest_axis,
    max_smear_axis,
    tail_axis,
    variation,
)
from fopi_tune.spec.model import Requirement


@dataclass(frozen=True)
class Line:
    """What a limit that is straight over ln omega has above that at its lower end.

    Args:
        from_rad_s, to_rad_s: its ends.
        from_db, to_db: the limit there.
    """

    from_rad_s: float
    to_rad_s: float
    from_db: float
    to_db: float

    @classmethod
    def of(cls, requirement: Requirement) -> Line | None:
        """That of a requirement; None where its limit is one number."""
        if requirement.end_limit is None:
            return None
        return cls(requirement.from_rad_s, requirement.to_rad_s, requirement.limits[0], requirement.end_limit)

    @computed_once
    def slope(self) -> arb:
        """Neper a unit of ln omega."""
        rise = (arb(self.to_db) - arb(self.from_db)) * arb(10).log() / 20
        return rise / (arb(self.to_rad_s) / arb(self.from_rad_s)).log()

    def to_dict(self) -> dict[str, float]:
        """As in a certificate."""
        return {name: getattr(self, name) for name in ("from_rad_s", "to_rad_s", "from_db", "to_db")}

    def at(self, frequency: arb) -> arb:
        """At a frequency in rad/s, neper."""
        return self.slope * (frequency / arb(self.from_rad_s)).log()


@dataclass(frozen=True)
class Bound(LoopClaim):
    """sign * ln|R(j omega)| <= sign * (level + line) at every point of the domain.

    Args:
        loop: gains and family.
        response: R.
        level: in neper.
        upper: True for at most (sign = 1), False for at least (sign = -1).
        domain: frequencies and plants.
        origin: u at which the whole frequency axis is split first.
        line: added to the level, of a domain without tails; None is 0.
    """

    loop: BallLoop
    response: Response
    level: float
    upper: bool
    domain: Box
    origin: float
    line: Line | None = None

    def examine(self, box: Box) -> BoxVerdict:
        if box[0][0] == -float("inf") and box[0][1] == float("inf"):
            return BoxVerdict(None, 0)
        over = self.loop.over(box)
        if self._holds_by_values(over):
            return HOLDS
        tail = is_tail(box[0])
        slopes = self._slopes(over, tail)
        known = [slope for slope in slopes if slope is not None]
        if not all(slope.is_finite() for slope in known):
            if tail:
                far = tail_axis(box, self.domain, lambda far: self._holds_by_values(self.loop.over(far)))
                return BoxVerdict(None, far)
            return BoxVerdict(None, self._axis_of_gain(box, over))
        centre = self.loop.at_centre(box)
        middle = abs(response_of(centre, self.response)).log()
        if self.line is not None:
            middle = middle - self._line_over(self.line, centre)
        if not tail and (middle > self.level if self.upper else middle < self.level):
            return BoxVerdict(None, 0, (), counterexample=True)
        spread = variation(slopes, box)
        if middle + spread <= self.level if self.upper else middle + spread >= self.level:
            return HOLDS
        monotone_ends = tuple(
            (axis, bool(slope > 0) == self.upper)
            for axis, slope in enumerate(slopes)
            if slope is not None and box[axis][0] < box[axis][1] and (slope > 0 or slope < 0)
        )
        if tail:
            return BoxVerdict(None, self._tail_axis(box, slopes, middle), monotone_ends)
        return BoxVerdict(None, max_smear_axis(box, known), monotone_ends)

    def _holds_by_values(self, over: LoopEnclosure) -> bool:
        """Whether the range of R over the box satisfies the bound, without derivatives."""
        value, limit = response_of(over, self.response), self._limit(over)
        if value.is_finite() and (value.abs_upper() <= limit if self.upper else value.abs_lower() >= limit):
            return True
        if self.response is Response.LOOP_GAIN and not self.upper and not value.is_finite():
            inverse = over.inverse_gain
            return bool(inverse.is_finite() and inverse.abs_upper() * limit <= 1)
        return over.high_tail and over.delay is not None and self._holds_by_size(over, limit)

    def _line_over(self, line: Line, over: LoopEnclosure) -> arb:
        return line.at(self.loop.frequency(over.omega))

    def _limit(self, over: LoopEnclosure) -> arb:
        """The limit of |R| over a box."""
        level = arb(self.level)
        return (level if self.line is None else level + self._line_over(self.line, over)).exp()

    def _holds_by_size(self, over: LoopEnclosure, limit: arb) -> bool:
        """By 1 - |L| <= |1 + L| <= 1 + |L|, where the phase of L is unknown because of a dead time."""
        size = over.size
        if not size < 1:
            return False
        if self.upper:
            top = {
                Response.SENSITIVITY: arb(1),
                Response.COMPLEMENTARY_SENSITIVITY: size,
                Response.CONTROL_SENSITIVITY: over.noise_gain.abs_upper(),
                Response.LOAD_SENSITIVITY: over.plant_size[1],
                Response.LOOP_GAIN: size * (1 - size),
            }[self.response]
            return bool(top / (1 - size) <= limit)
        if self.response is Response.SENSITIVITY:
            return bool(1 / (1 + size) >= limit)
        if self.response is Response.LOAD_SENSITIVITY:
            return bool(over.plant_size[0] / (1 + size) >= limit)
        return self.response is Response.CONTROL_SENSITIVITY and bool(over.noise_gain.abs_lower() / (1 + size) >= limit)

    def _slopes(self, over: LoopEnclosure, tail: bool) -> list[arb | None]:
        """d (ln|R| - line) along every axis; None along a tail."""
        found = self._own_slopes(over, tail)
        if self.line is not None and found[0] is not None:
            found[0] = found[0] - self.line.slope * self.loop.stretch(over.omega)
        return found

    def _own_slopes(self, over: LoopEnclosure, tail: bool) -> list[arb | None]:
        """d ln|R| along every axis; None along a tail."""
        gradient = [] if tail else [over.log_slope]
        gradient += over.log_gradient
        slopes: list[arb | None] = [None] if tail else []
        if self.response is Response.LOOP_GAIN:
            return slopes + [g.real for g in gradient]
        if self.response in (Response.COMPLEMENTARY_SENSITIVITY, Response.LOAD_SENSITIVITY):
            factor = over.sensitivity
            found = [(factor * g).real for g in gradient]
            if self.response is Response.LOAD_SENSITIVITY and not tail:
                found[0] = found[0] - (over.controller_slope + over.at.filter_slope).real
            return slopes + found
        factor = over.complementary
        found = [-(factor * g).real for g in gradient]
        if self.response is Response.CONTROL_SENSITIVITY and not tail:
            found[0] = found[0] + (over.controller_slope + over.at.filter_slope).real
        return slopes + found

    def _axis_of_gain(self, box: Box, over: LoopEnclosure) -> int:
        """The axis along which L varies most."""
        gradient = [over.log_slope, *over.log_gradient]
        if not all(g.is_finite() for g in gradient):
            return longest_axis(box, self.domain)
        return max_smear_axis(box, [abs(g) for g in gradient])

    def _tail_axis(self, box: Box, slopes: list[arb | None], middle: arb) -> int:
        """Split the tail along u, unless the spread of the plants prevents the proof."""
        plants = variation(slopes, box)
        if not plants.is_finite() or not middle.is_finite() or plants.rad() <= middle.rad():
            return 0
        return max_smear_axis(box, [arb(0) if s is None else s for s in slopes])

    def to_dict(self) -> dict[str, Any]:
        return {
            "kind": "bound",
            "response": self.response.value,
            "level_neper": self.level,
            "relation": "at_most" if self.upper else "at_least",
            **({} if self.line is None else {"line": self.line.to_dict()}),
        }


def response_of(at: LoopEnclosure, response: Response) -> acb:
    """The response over a box."""
    if response is Response.SENSITIVITY:
        return at.sensitivity
    if response is Response.COMPLEMENTARY_SENSITIVITY:
        return at.complementary
    if response is Response.LOAD_SENSITIVITY:
        return at.load_sensitivity
    return at.control_sensitivity if response is Response.CONTROL_SENSITIVITY else at.gain
