"""C over one interval of frequencies, in ball arithmetic, with its derivatives:  what boxes of plants share.

A search splits the plants far more often than the frequencies: of 60 boxes about one has a new interval of u.  The
factors c and x and the tails are those of `fopi_tune.proof.balls.responses`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.computed_once import computed_once

_ZERO = arb(0)


@dataclass(frozen=True)
class LoopParameters:
    """One controller and a family of plants.

    Args:
        gains: the controller.
        family: the plants.
    """

    gains: FoPi
    family: PlantFamily

    @cached_property
    def axes(self) -> int:
        """Axes of a box: u and the uncertain numbers."""
        return 1 + len(self.family.uncertain_names)

    @property
    def family_box(self) -> tuple[Interval, ...]:
        """The box of the uncertain numbers."""
        return tuple(zip(self.family.low.tolist(), self.family.high.tolist(), strict=True))

    @cached_property
    def kp(self) -> arb:
        """Proportional gain."""
        return arb(self.gains.kp)

    @cached_property
    def ki(self) -> arb:
        """Integral gain."""
        return arb(self.gains.ki)

    @cached_property
    def alpha(self) -> arb:
        """Order of the integral."""
        return arb(self.gains.alpha)

    @cached_property
    def turn(self) -> acb:
        """j^alpha."""
        angle = self.alpha * arb.pi() / 2
        return acb(angle.cos(), angle.sin())

    @cached_property
    def integral(self) -> acb:
        """ki j^-alpha."""
        return self.ki / self.turn


class ControllerOnInterval:
    """C and s over one interval of frequencies.

    Every value is computed on first use and kept.

    Args:
        loop: the controller.
        u: the interval of ln omega, possibly a tail.
    """

    def __init__(self, loop: LoopParameters, u: Interval) -> None:
        self.loop, self.u = loop, u
        self.low_tail, self.high_tail = math.isinf(u[0]), math.isinf(u[1])
        if self.low_tail and self.high_tail:
            raise ValueError("a box without any end in frequency has no enclosure; cut it first")
        self._powers: dict[int, acb] = {}

    @computed_once
    def omega(self) -> arb:
        """omega; in the high tail 1/omega."""
        if self.low_tail:
            return _ZERO.union(arb(self.u[1]).exp())
        if self.high_tail:
            return _ZERO.union((-arb(self.u[0])).exp())
        return ball_of(self.u).exp()

    @computed_once
    def s(self) -> acb:
        """j omega; in the high tail 1/(j omega)."""
        return acb(0, -self.omega if self.high_tail else self.omega)

    @computed_once
    def _power(self) -> arb:
        """omega^alpha; in the high tail omega^-alpha."""
        alpha = self.loop.alpha
        if self.low_tail:
            return _ZERO.union((alpha * arb(self.u[1])).exp())
        if self.high_tail:
            return _ZERO.union((-alpha * arb(self.u[0])).exp())
        return (alpha * ball_of(self.u)).exp()

    @computed_once
    def c(self) -> acb:
        """The factor c of the controller."""
        loop = self.loop
        if loop.gains.ki == 0.0:
            return acb(loop.kp)
        if self.low_tail:
            return (self._power * loop.turn) * loop.kp + loop.ki
        if self.high_tail:
            return loop.kp + self._power * loop.integral
        return loop.kp + loop.integral / self._power

    @computed_once
    def x(self) -> acb | None:
        """s^alpha in the low tail of a loop with an integral; None is 1."""
        return self._power * self.loop.turn if self.low_tail and self.loop.gains.ki != 0.0 else None

    @computed_once
    def controller_slope(self) -> acb:
        """d ln C/du."""
        loop = self.loop
        if loop.gains.ki == 0.0:
            return acb(0)
        if loop.gains.kp == 0.0:
            return acb(-loop.alpha)
        return -loop.alpha / (1 + (loop.kp / loop.ki) * (self._power * loop.turn))

    @computed_once
    def controller_curvature(self) -> acb:
        """d2 ln C/du2; not in a tail.

        q = d ln C/du = -alpha/(1 + w), w = (kp/ki) s^alpha:  dq/du = alpha^2 w/(1 + w)^2 = -q (alpha + q).
        """
        q = self.controller_slope
        return -q * (self.loop.alpha + q) if self.loop.gains.ki != 0.0 else acb(0)

    def power_of_s(self, exponent: int) -> acb:
        """s^exponent; in the high tail s^-exponent."""
        if exponent not in self._powers:
            self._powers[exponent] = self.s**exponent
        return self._powers[exponent]
