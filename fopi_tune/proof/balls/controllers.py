"""C over one interval of frequencies, in ball arithmetic, with its derivatives:  what boxes of plants share.

A search splits the plants far more often than the frequencies: of 60 boxes about one has a new interval of u.  The
factors c and x and the tails are those of `fopi_tune.proof.balls.responses`.

A measurement filter F is counted to the plant, C P = (C/F) (F P): C is here without it, and |C S| alone asks for F.

What the proofs ask of a structure of controllers is a `Structure` and its `ControllerOnInterval`.  Here are those of
C = kp + ki s^-alpha; those of a PID are in `fopi_tune.proof.balls.pid`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.plant import Polynomial

_ZERO = arb(0)
#: |ln| of a quotient of two coefficients, which are doubles, and as much again for the terms to differ
FARTHEST = 3000.0


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
    def filter_time(self) -> arb:
        """T of the measurement filter F in the plants' variable."""
        assert self.gains.measurement_filter is not None
        return arb(self.gains.measurement_filter.time_constant_s)

    @cached_property
    def filter_bottom(self) -> Polynomial | None:
        """1/F; None is 1."""
        filtered = self.gains.measurement_filter
        if filtered is None:
            return None
        time = self.filter_time
        return Polynomial([time, arb(1)] if filtered.order == 1 else [time * time / 2, time, arb(1)])

    @cached_property
    def integral(self) -> acb:
        """ki j^-alpha."""
        return self.ki / self.turn


class ControllerOnInterval(ABC):
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
        self._real_powers: dict[float, acb] = {}

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
    @abstractmethod
    def c(self) -> acb:
        """The factor c of the controller."""

    @computed_once
    @abstractmethod
    def x(self) -> acb | None:
        """s^order in the low tail of a loop with an integral; None is 1."""

    @computed_once
    @abstractmethod
    def controller_slope(self) -> acb:
        """d ln C/du; not in a tail."""

    @computed_once
    @abstractmethod
    def controller_curvature(self) -> acb:
        """d2 ln C/du2; not in a tail."""

    @computed_once
    def filter(self) -> acb:
        """F, which |C S| has beside c; in the high tail s^-n over s^-n/F, n its order."""
        bottom = self.loop.filter_bottom
        if bottom is None:
            return acb(1)
        if not self.high_tail:
            return 1 / bottom.at(self.s)
        return self.s**bottom.degree / bottom.reversed.at(self.s)

    @computed_once
    def filter_slope(self) -> acb:
        """d ln F/du; not in a tail."""
        bottom = self.loop.filter_bottom
        return acb(0) if bottom is None else -bottom.own_derivative(self.s) * self.filter

    def power_of_s(self, exponent: int) -> acb:
        """s^exponent; in the high tail s^-exponent."""
        if exponent not in self._powers:
            self._powers[exponent] = self.s**exponent
        return self._powers[exponent]

    def real_power_of_s(self, exponent: arb) -> acb:
        """The same of an exact real exponent >= 0, with omega^exponent = e^(exponent u)."""
        key = float(exponent.mid()) if exponent.is_exact() else None
        known = self._real_powers.get(key) if key is not None and arb(key) == exponent else None
        if known is not None:
            return known
        size = arb(1)
        if self.low_tail and not exponent.is_zero():
            size = _ZERO.union((exponent * arb(self.u[1])).exp())
        elif self.high_tail and not exponent.is_zero():
            size = _ZERO.union((-exponent * arb(self.u[0])).exp())
        elif not exponent.is_zero():
            size = (exponent * ball_of(self.u)).exp()
        angle = exponent / 2
        turn = acb(angle.cos_pi(), angle.sin_pi())
        found = size * (1 / turn if self.high_tail else turn)
        if key is not None and arb(key) == exponent:
            self._real_powers[key] = found
        return found


class Structure(ABC):
    """A structure of controllers C(s), as the proofs ask of it.

    s^order C is bounded and analytic for Re s > 0 next to s = 0, and so is C next to s = inf.

    Args:
        loop: the gains.
    """

    #: |u| beyond which only the leading terms matter
    farthest_u: float
    #: order of the pole of C at s = 0; 0 without one
    order: arb
    #: s^order C at s = 0
    at_zero: arb
    #: C at s = inf
    at_infinity: arb

    @abstractmethod
    def on_interval(self, u: Interval) -> ControllerOnInterval:
        """C over an interval of u, possibly a tail."""

    @abstractmethod
    def value_and_slope(self, u: arb) -> tuple[acb, acb]:
        """C and d ln C/du over a ball of u."""

    @abstractmethod
    def change_near_zero(self, u: float) -> arb:
        """A bound of |s^order C - at_zero| for |s| <= e^u, Re s >= 0."""

    @abstractmethod
    def change_near_infinity(self, u: float) -> arb:
        """A bound of |C - at_infinity| for |s| >= e^u, Re s >= 0."""


class FoPiOnInterval(ControllerOnInterval):
    """kp + ki s^-alpha over one interval of frequencies."""

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


class FoPiStructure(Structure):
    """kp + ki s^-alpha; of a box of gains the balls are the loop's own."""

    def __init__(self, loop: LoopParameters) -> None:
        self.loop, self.has_integral = loop, loop.gains.ki != 0.0
        self.order = loop.alpha if self.has_integral else _ZERO
        self.at_zero = loop.ki if self.has_integral else loop.kp
        self.at_infinity = loop.kp
        self.farthest_u = FARTHEST / min(loop.gains.alpha, 1.0)

    def on_interval(self, u: Interval) -> ControllerOnInterval:
        return FoPiOnInterval(self.loop, u)

    def value_and_slope(self, u: arb) -> tuple[acb, acb]:
        loop = self.loop
        if not self.has_integral:
            return acb(loop.kp), acb(0)
        integral = (-loop.alpha * u).exp() * loop.integral
        if loop.gains.kp == 0.0:
            return integral, acb(-loop.alpha)
        # d ln C/du = -alpha ki s^-alpha/C = -alpha (1 - kp/C)
        c = loop.kp + integral
        return c, loop.alpha * (loop.kp / c - 1)

    def change_near_zero(self, u: float) -> arb:
        return (self.loop.alpha * u).exp() * abs(self.loop.kp) if self.has_integral else _ZERO

    def change_near_infinity(self, u: float) -> arb:
        return abs(self.loop.ki) * (-self.loop.alpha * u).exp()
