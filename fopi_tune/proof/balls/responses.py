"""L, S, T, C S over one box of frequencies and plants, in ball arithmetic, with the derivatives of ln L.

On every piece of the frequency axis, with s = j omega, the loop is written with finite factors,

    L = c n/(x d),    S = x d/F,    T = c n/F,    C S = c d/F,    F = x d + c n,

between            c = kp + ki s^-alpha    x = 1          n = N(s) e^{-Ls}          d = D(s)
omega -> 0         c = kp s^alpha + ki     x = s^alpha    n = N(s) e^{-Ls}          d = D(s)
omega -> inf       c = kp + ki s^-alpha    x = 1          n = N(s)/s^k e^{-Ls}      d = D(s)/s^k ,

k the degree of D.  In the tails s (or 1/s) is enclosed by a ball that holds 0, and e^{-j omega L} by the unit disc, so
no frequency is left out.  In u = ln omega the derivatives of ln L are

    d ln C/du = -alpha/(1 + (kp/ki) s^alpha),    d ln N/du = s N'/N,    d(-j omega L)/du = -j omega L.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.plant import Dual, PlantEnclosure, own_derivative, polynomial


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


#: below this size S (or T) is computed as a product, since 1 - T (1 - S) would cancel
_TINY = arb(1e-3)
_ZERO = arb(0)
_UNIT_DISC = acb(arb(0, 1), arb(0, 1))


class LoopEnclosure:
    """The loop over one box:  L, S, T, C S and the derivatives of ln L.

    Every value is computed on first use and cached.

    Args:
        loop: the controller and the family.
        u: the interval of ln omega, possibly a tail.
        plant: coefficients over the box.
    """

    def __init__(self, loop: LoopParameters, u: Interval, plant: PlantEnclosure) -> None:
        self.loop, self.u, self.plant = loop, u, plant
        self.low_tail, self.high_tail = math.isinf(u[0]), math.isinf(u[1])
        if self.low_tail and self.high_tail:
            raise ValueError("a box without any end in frequency has no enclosure; cut it first")

    @cached_property
    def omega(self) -> arb:
        """omega; in the high tail 1/omega."""
        if self.low_tail:
            return _ZERO.union(arb(self.u[1]).exp())
        if self.high_tail:
            return _ZERO.union((-arb(self.u[0])).exp())
        return ball_of(self.u).exp()

    @cached_property
    def s(self) -> acb:
        """j omega; in the high tail 1/(j omega)."""
        return acb(0, -self.omega if self.high_tail else self.omega)

    @cached_property
    def _power(self) -> arb:
        """omega^alpha; in the high tail omega^-alpha."""
        alpha = self.loop.alpha
        if self.low_tail:
            return _ZERO.union((alpha * arb(self.u[1])).exp())
        if self.high_tail:
            return _ZERO.union((-alpha * arb(self.u[0])).exp())
        return (alpha * ball_of(self.u)).exp()

    @cached_property
    def c(self) -> acb:
        """The factor c of the controller."""
        loop = self.loop
        if loop.gains.ki == 0.0:
            return acb(loop.kp)
        if self.low_tail:
            return loop.kp * (self._power * loop.turn) + loop.ki
        if self.high_tail:
            return loop.kp + self._power * loop.integral
        return loop.kp + loop.integral / self._power

    @cached_property
    def x(self) -> acb | None:
        """s^alpha in the low tail of a loop with an integral; None is 1."""
        return self._power * self.loop.turn if self.low_tail and self.loop.gains.ki != 0.0 else None

    def _scaled(self, coefficients: Sequence[arb], degree: int) -> acb:
        """X(s); in the high tail X(s)/s^degree as a polynomial in 1/s."""
        if not self.high_tail:
            return polynomial(coefficients, self.s)
        missing = degree + 1 - len(coefficients)
        return polynomial([*reversed(coefficients), *(_ZERO,) * missing], self.s)

    @property
    def degree(self) -> int:
        """Coefficients of D less one."""
        return len(self.plant.denominator) - 1

    @cached_property
    def delay(self) -> acb | None:
        """e^{-j omega L}; None is 1."""
        dead_time = self.plant.dead_time.value
        if dead_time.is_zero():
            return None
        return _UNIT_DISC if self.high_tail else acb(0, -(self.omega * dead_time)).exp()

    @cached_property
    def numerator(self) -> acb:
        """N, without the dead time."""
        return self._scaled([c.value for c in self.plant.numerator], self.degree)

    @cached_property
    def n(self) -> acb:
        """N e^{-Ls}."""
        return self.numerator if self.delay is None else self.numerator * self.delay

    @cached_property
    def d(self) -> acb:
        """D."""
        return self._scaled([c.value for c in self.plant.denominator], self.degree)

    @cached_property
    def gain(self) -> acb:
        """L; not finite where it is unbounded."""
        top = self.c * self.n
        return top / self.d if self.x is None else top / (self.x * self.d)

    @cached_property
    def size(self) -> arb:
        """An upper bound of |L|; sharp in the high tail of a dead time, where L turns through a whole disc."""
        if self.high_tail and self.delay is not None:
            top, bottom = self.c.abs_upper() * self.numerator.abs_upper(), self.d.abs_lower()
            return top / bottom if bottom > 0 else arb.pos_inf()
        return self.gain.abs_upper()

    @cached_property
    def inverse_gain(self) -> acb:
        """1/L; not finite where L may be 0."""
        bottom = self.c * self.n
        return self.d / bottom if self.x is None else self.x * self.d / bottom

    @cached_property
    def _closed(self) -> tuple[acb, acb]:
        """S and T from the smaller of L and 1/L; a tiny one is computed as a product to avoid cancellation."""
        gain = self.gain
        if gain.is_finite() and not gain.abs_lower() > 1:
            s = 1 / (1 + gain)
            return s, gain * s if gain.abs_upper() < _TINY else 1 - s
        inverse = self.inverse_gain
        t = 1 / (1 + inverse)
        return inverse * t if inverse.abs_upper() < _TINY else 1 - t, t

    @property
    def sensitivity(self) -> acb:
        """S."""
        return self._closed[0]

    @property
    def complementary(self) -> acb:
        """T."""
        return self._closed[1]

    @cached_property
    def control_sensitivity(self) -> acb:
        """C S = T/P; the second form where L is large and C may be unbounded."""
        if self.x is None and not self.gain.abs_lower() > 1:
            return self.c * self.sensitivity
        return self.d / self.n * self.complementary

    # -- derivatives ------------------------------------------------------------------------------------------------

    @cached_property
    def controller_slope(self) -> acb:
        """d ln C/du."""
        loop = self.loop
        if loop.gains.ki == 0.0:
            return acb(0)
        if loop.gains.kp == 0.0:
            return acb(-loop.alpha)
        return -loop.alpha / (1 + (loop.kp / loop.ki) * (self._power * loop.turn))

    def _own_slope(self, coefficients: Sequence[Dual], value: acb) -> acb:
        """s X'(s)/X(s)."""
        degree = len(coefficients) - 1
        if degree == 0:
            return acb(0)
        if degree == 1:
            return 1 - coefficients[1].value / value
        return own_derivative([c.value for c in coefficients], self.s) / value

    @cached_property
    def characteristic(self) -> acb:
        """D + C N e^{-Ls}, whose roots are the closed-loop poles; not in a tail."""
        return self.d + self.c * self.n

    @cached_property
    def characteristic_slope(self) -> acb:
        """Its derivative in u; not in a tail."""
        plant = self.plant
        top = own_derivative([c.value for c in plant.numerator], self.s)
        inner = self.controller_slope * self.numerator + top
        if self.delay is not None:
            inner = (inner - acb(0, self.omega * plant.dead_time.value) * self.numerator) * self.delay
        return own_derivative([c.value for c in plant.denominator], self.s) + self.c * inner

    @cached_property
    def log_slope(self) -> acb:
        """d ln L/du; not in a tail."""
        plant = self.plant
        slope = self.controller_slope + self._own_slope(plant.numerator, self.numerator)
        slope = slope - self._own_slope(plant.denominator, self.d)
        dead_time = plant.dead_time.value
        return slope if dead_time.is_zero() else slope - acb(0, self.omega * dead_time)

    @cached_property
    def log_gradient(self) -> list[acb]:
        """d ln L/dtheta_k, k = 1 ... p."""
        gradient = [acb(0) for _ in range(self.loop.axes - 1)]
        for coefficients, value, sign in (
            (self.plant.numerator, self.numerator, 1),
            (self.plant.denominator, self.d, -1),
        ):
            degree = len(coefficients) - 1
            for k, coefficient in enumerate(coefficients):
                for axis, slope in coefficient.gradient.items():
                    term = self._monomial(degree - k) * slope / value
                    gradient[axis - 1] = gradient[axis - 1] + sign * term
        for axis, slope in self.plant.dead_time.gradient.items():
            # in the high tail omega has no end, and neither has this derivative
            turn = acb(0, self.omega * slope) if not self.high_tail else acb(arb.nan(), arb.nan())
            gradient[axis - 1] = gradient[axis - 1] - turn
        return gradient

    def _monomial(self, power: int) -> acb:
        return acb(self.s) ** (self.degree - power) if self.high_tail else acb(self.s) ** power

    # -- second derivatives, for the slope of the phase -------------------------------------------------------------

    def _own_curvature(self, coefficients: Sequence[Dual], value: acb) -> acb:
        """d/du of s X'/X:  s (s X')'/X - (s X'/X)^2."""
        degree = len(coefficients) - 1
        if degree == 0:
            return acb(0)
        slope = self._own_slope(coefficients, value)
        if degree == 1:
            return slope * (1 - slope)
        weighted = [(degree - k) ** 2 * c.value for k, c in enumerate(coefficients[:-1])]
        return polynomial([*weighted, _ZERO], self.s) / value - slope * slope

    @cached_property
    def log_curvature(self) -> acb:
        """d2 ln L/du2; not in a tail."""
        plant = self.plant
        # q = -alpha/(1 + w), w = (kp/ki) s^alpha:  dq/du = alpha^2 w/(1 + w)^2 = -q (alpha + q)
        q = self.controller_slope
        integral = self.loop.gains.ki != 0.0
        curvature = -q * (self.loop.alpha + q) if integral else acb(0)
        curvature = curvature + self._own_curvature(plant.numerator, self.numerator)
        curvature = curvature - self._own_curvature(plant.denominator, self.d)
        dead_time = plant.dead_time.value
        return curvature if dead_time.is_zero() else curvature - acb(0, self.omega * dead_time)

    @cached_property
    def log_slope_gradient(self) -> list[acb]:
        """d2 ln L/du dtheta_k, k = 1 ... p; not in a tail."""
        gradient = [acb(0) for _ in range(self.loop.axes - 1)]
        for coefficients, value, sign in (
            (self.plant.numerator, self.numerator, 1),
            (self.plant.denominator, self.d, -1),
        ):
            degree = len(coefficients) - 1
            own = self._own_slope(coefficients, value)
            for k, coefficient in enumerate(coefficients):
                for axis, slope in coefficient.gradient.items():
                    term = self._monomial(degree - k) * slope / value * (degree - k - own)
                    gradient[axis - 1] = gradient[axis - 1] + sign * term
        for axis, slope in self.plant.dead_time.gradient.items():
            gradient[axis - 1] = gradient[axis - 1] - acb(0, self.omega * slope)
        return gradient

    @cached_property
    def phase_slope(self) -> arb:
        """d arg L/d ln omega, rad; not in a tail."""
        return self.log_slope.imag

    @cached_property
    def phase_slope_derivatives(self) -> list[arb]:
        """Derivatives of `phase_slope` with respect to u and theta_k, k = 1 ... p; not in a tail."""
        return [self.log_curvature.imag, *(g.imag for g in self.log_slope_gradient)]
