"""L, S, T, C S, P S over one box of frequencies and plants, in ball arithmetic, with the derivatives of ln L.

On every piece of the frequency axis, with s = j omega, the loop is written with finite factors,

    L = c n/(x d),    S = x d/F,    T = c n/F,    C S = c d/F,    P S = x n/F,    F = x d + c n,

between            c = C(s)                x = 1          n = N(s) e^{-Ls}          d = D(s)
omega -> 0         c = s^a C(s)            x = s^a        n = N(s) e^{-Ls}          d = D(s)
omega -> inf       c = C(s)                x = 1          n = N(s)/s^k e^{-Ls}      d = D(s)/s^k ,

a the order of the integral, 0 without one, and k the degree of D; with a measurement filter F, N/D is that of F P, C
the controller without it, C S has F once more, and P S 1/F.  With sigma = 1/s these c are

between            kp + ki s^-alpha              kp + ki/s + kd s/(Tf s + 1)
omega -> 0         kp s^alpha + ki               kp s + ki + kd s^2/(Tf s + 1)
omega -> inf       kp + ki sigma^alpha           kp + ki sigma + kd/(sigma + Tf) ,

so that a PID tends to kp + kd/Tf.  In the tails s (or sigma) is enclosed by a ball that holds 0, and e^{-j omega L} by
the unit disc, so no frequency is left out.  In u = ln omega the derivatives of ln L are

    d ln C/du = -alpha/(1 + (kp/ki) s^alpha),    d ln N/du = s N'/N,    d(-j omega L)/du = -j omega L,

d ln C/du of a PID in `fopi_tune.proof.balls.pid`.
"""

from __future__ import annotations

from flint import acb, arb

from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.controllers import ControllerOnInterval, LoopParameters
from fopi_tune.proof.balls.plant import PlantEnclosure, Polynomial, polynomial

#: below this size S (or T) is computed as a product, since 1 - T (1 - S) would cancel
_TINY = arb(1e-3)
_ZERO = arb(0)
_UNIT_DISC = acb(arb(0, 1), arb(0, 1))


class LoopEnclosure:
    """The loop over one box:  L, S, T, C S, P S and the derivatives of ln L.

    Every value is computed on first use and cached.

    Args:
        loop: the controller and the family.
        at: the controller over the interval of frequencies, possibly a tail.
        plant: coefficients over the box.
    """

    def __init__(self, loop: LoopParameters, at: ControllerOnInterval, plant: PlantEnclosure) -> None:
        self.loop, self.at, self.plant = loop, at, plant
        self.low_tail, self.high_tail = at.low_tail, at.high_tail

    @property
    def u(self) -> Interval:
        """The interval of ln omega."""
        return self.at.u

    @property
    def omega(self) -> arb:
        """omega; in the high tail 1/omega."""
        return self.at.omega

    @property
    def s(self) -> acb:
        """j omega; in the high tail 1/(j omega)."""
        return self.at.s

    @property
    def c(self) -> acb:
        """The factor c of the controller."""
        return self.at.c

    @property
    def x(self) -> acb | None:
        """s^a in the low tail of a loop with an integral; None is 1."""
        return self.at.x

    @property
    def controller_slope(self) -> acb:
        """d ln C/du; not in a tail."""
        return self.at.controller_slope

    def _scaled(self, coefficients: Polynomial, degree: int) -> acb:
        """X(s); in the high tail X(s)/s^degree as a polynomial in 1/s."""
        if not self.high_tail:
            return coefficients.at(self.at.s)
        missing = degree - coefficients.degree
        return polynomial([*coefficients.reversed.values, *(_ZERO,) * missing], self.at.s)

    @property
    def degree(self) -> int:
        """Coefficients of D less one."""
        return len(self.plant.denominator) - 1

    @computed_once
    def delay(self) -> acb | None:
        """e^{-j omega L}; None is 1."""
        dead_time = self.plant.dead_time.value
        if dead_time.is_zero():
            return None
        return _UNIT_DISC if self.high_tail else acb(0, -(self.omega * dead_time)).exp()

    @computed_once
    def numerator(self) -> acb:
        """N, without the dead time."""
        return self._scaled(self.plant.top, self.degree)

    @computed_once
    def n(self) -> acb:
        """N e^{-Ls}."""
        return self.numerator if self.delay is None else self.numerator * self.delay

    @computed_once
    def d(self) -> acb:
        """D."""
        return self._scaled(self.plant.bottom, self.degree)

    @property
    def sides(self) -> tuple[acb, acb]:
        """N e^{-Ls} and D, but for a common factor."""
        return self.n, self.d

    @computed_once
    def gain(self) -> acb:
        """L; not finite where it is unbounded."""
        n, d = self.sides
        top = self.c * n
        return top / d if self.x is None else top / (self.x * d)

    @computed_once
    def size(self) -> arb:
        """An upper bound of |L|; sharp in the high tail of a dead time, where L turns through a whole disc."""
        if self.high_tail and self.delay is not None:
            top, bottom = self.c.abs_upper() * self.numerator.abs_upper(), self.d.abs_lower()
            return top / bottom if bottom > 0 else arb.pos_inf()
        return self.gain.abs_upper()

    @computed_once
    def inverse_gain(self) -> acb:
        """1/L; not finite where L may be 0."""
        n, d = self.sides
        bottom = self.c * n
        return d / bottom if self.x is None else self.x * d / bottom

    @computed_once
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

    @computed_once
    def control_sensitivity(self) -> acb:
        """C S = T/P; the second form where L is large and C may be unbounded.  With a filter N/D is F P."""
        if self.x is None and not self.gain.abs_lower() > 1:
            return self.noise_gain * self.sensitivity
        n, d = self.sides
        found = d / n * self.complementary
        return found if self.loop.filter_bottom is None else found * self.at.filter

    @property
    def noise_gain(self) -> acb:
        """c with the measurement filter: what |C S| has where |S| = 1."""
        return self.c if self.loop.filter_bottom is None else self.c * self.at.filter

    @computed_once
    def load_sensitivity(self) -> acb:
        """P S = T/C; the second form where L is large and P may be unbounded."""
        if self.gain.is_finite() and not self.gain.abs_lower() > 1:
            top, bottom = self.plant_sides
            return (top if self.delay is None else top * self.delay) / bottom * self.sensitivity
        top = self.complementary if self.x is None else self.x * self.complementary
        return top / self.noise_gain

    @property
    def plant_size(self) -> tuple[arb, arb]:
        """Bounds of |P|, sharp behind a dead time: what |P S| has where |S| = 1."""
        return self._size_of(*self.plant_sides)

    @property
    def filtered_plant_size(self) -> tuple[arb, arb]:
        """The same of F P, F the measurement filter."""
        return self._size_of(*self._filtered_sides)

    def _size_of(self, top: acb, bottom: acb) -> tuple[arb, arb]:
        gain = abs(self.plant.gain.value)
        most = gain * top.abs_upper() / bottom.abs_lower() if bottom.abs_lower() > 0 else arb.pos_inf()
        least = gain * top.abs_lower() / bottom.abs_upper() if bottom.abs_upper() > 0 else _ZERO
        return least, most

    @property
    def _filtered_sides(self) -> tuple[acb, acb]:
        """F P without delay and `gain` as a quotient."""
        return self.numerator, self.d

    @computed_once
    def plant_sides(self) -> tuple[acb, acb]:
        """P without delay, `gain` and measurement filter as a quotient:  N/D is F P, and 1/F a polynomial."""
        bottom = self.loop.filter_bottom
        if bottom is None:
            return self.numerator, self.d
        if not self.high_tail:
            return self.numerator * bottom.at(self.s), self.d
        return self._scaled(self.plant.top, self.degree - bottom.degree) * bottom.reversed.at(self.s), self.d

    # -- derivatives ------------------------------------------------------------------------------------------------

    def _own_slope(self, coefficients: Polynomial, value: acb) -> acb:
        """s X'(s)/X(s)."""
        if coefficients.degree == 0:
            return acb(0)
        if coefficients.degree == 1:
            return 1 - acb(coefficients.values[1]) / value
        return coefficients.own_derivative(self.s) / value

    @computed_once
    def characteristic(self) -> acb:
        """D + C N e^{-Ls}, whose roots are the closed-loop poles; not in a tail."""
        return self.d + self.c * self.n

    @computed_once
    def characteristic_slope(self) -> acb:
        """Its derivative in u; not in a tail."""
        plant = self.plant
        top = plant.top.own_derivative(self.s)
        inner = self.controller_slope * self.numerator + top
        if self.delay is not None:
            inner = (inner - acb(0, self.omega * plant.dead_time.value) * self.numerator) * self.delay
        return plant.bottom.own_derivative(self.s) + self.c * inner

    @computed_once
    def log_slope(self) -> acb:
        """d ln L/du; not in a tail."""
        plant = self.plant
        slope = self.controller_slope + self._own_slope(plant.top, self.numerator)
        slope = slope - self._own_slope(plant.bottom, self.d)
        dead_time = plant.dead_time.value
        return slope if dead_time.is_zero() else slope - acb(0, self.omega * dead_time)

    @computed_once
    def log_gradient(self) -> list[acb]:
        """d ln L/dtheta_k, k = 1 ... p."""
        gradient = [acb(0) for _ in range(self.loop.axes - 1)]
        for coefficients, above in ((self.plant.numerator, True), (self.plant.denominator, False)):
            degree = len(coefficients) - 1
            for k, coefficient in enumerate(coefficients):
                for axis, slope in coefficient.gradient.items():
                    term, before = self.term_share(degree - k, slope, above), gradient[axis - 1]
                    gradient[axis - 1] = before + term if above else before - term
        return self._with_dead_time(gradient)

    def _with_dead_time(self, gradient: list[acb]) -> list[acb]:
        """The derivatives of ln N/D by the numbers with those of the dead time."""
        for axis, slope in self.plant.dead_time.gradient.items():
            # in the high tail omega has no end, and neither has this derivative
            turn = acb(0, self.omega * slope) if not self.high_tail else acb(arb.nan(), arb.nan())
            gradient[axis - 1] = gradient[axis - 1] - turn
        return gradient

    def term_share(self, power: int, coefficient: arb, above: bool) -> acb:
        """coefficient s^power over N, or over D."""
        return self._monomial(power) * coefficient / (self.numerator if above else self.d)

    def _monomial(self, power: int) -> acb:
        return self.at.power_of_s(self.degree - power if self.high_tail else power)

    # -- second derivatives, for the slope of the phase -------------------------------------------------------------

    def _own_curvature(self, coefficients: Polynomial, value: acb) -> acb:
        """d/du of s X'/X:  s (s X')'/X - (s X'/X)^2."""
        if coefficients.degree == 0:
            return acb(0)
        slope = self._own_slope(coefficients, value)
        if coefficients.degree == 1:
            return slope * (1 - slope)
        return coefficients.own_curvature(self.s) / value - slope * slope

    @computed_once
    def log_curvature(self) -> acb:
        """d2 ln L/du2; not in a tail."""
        plant = self.plant
        curvature = self.at.controller_curvature + self._own_curvature(plant.top, self.numerator)
        curvature = curvature - self._own_curvature(plant.bottom, self.d)
        dead_time = plant.dead_time.value
        return curvature if dead_time.is_zero() else curvature - acb(0, self.omega * dead_time)

    @computed_once
    def log_slope_gradient(self) -> list[acb]:
        """d2 ln L/du dtheta_k, k = 1 ... p; not in a tail."""
        gradient = [acb(0) for _ in range(self.loop.axes - 1)]
        for coefficients, value, sign in (
            (self.plant.numerator, self.numerator, 1),
            (self.plant.denominator, self.d, -1),
        ):
            degree = len(coefficients) - 1
            own = self._own_slope(Polynomial([c.value for c in coefficients]), value)
            for k, coefficient in enumerate(coefficients):
                for axis, slope in coefficient.gradient.items():
                    term = self._monomial(degree - k) * slope / value * (degree - k - own)
                    gradient[axis - 1] = gradient[axis - 1] + sign * term
        for axis, slope in self.plant.dead_time.gradient.items():
            gradient[axis - 1] = gradient[axis - 1] - acb(0, self.omega * slope)
        return gradient

    @computed_once
    def phase_slope(self) -> arb:
        """d arg L/d ln omega, rad; not in a tail."""
        return self.log_slope.imag

    @computed_once
    def phase_slope_derivatives(self) -> list[arb]:
        """Derivatives of `phase_slope` with respect to u and theta_k, k = 1 ... p; not in a tail."""
        return [self.log_curvature.imag, *(g.imag for g in self.log_slope_gradient)]
