"""Bounds of |L| on intervals of frequency, for every controller of a box and one plant:  where no crossover can be.

With z = |ki s^-alpha| and kp, ki >= 0, whatever they are,

    |kp + z e^{-ja}| >= max(kp, z) sin a  (a > 90 deg),  sqrt(kp^2 + z^2) (else) ,     a = alpha pi/2 ,            (1)
    d ln|C|/du <= 0  (a <= 90 deg),   alpha (1 - sin a)/(2 sin a)  (else) ,                                        (2)

also where ki may be 0 and z is unbounded.  (2): -d ln C/du/alpha = 1 - 1/(1 + z e^{-ja}/kp), and 1/(1 + .) runs along a
circle through 0 whose real part is at most (1 + sin a)/(2 sin a).

Source: derived; (1) from the angle a between the two terms, (2) as said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.mean_value_forms import LoopBracket
from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.plant import polynomial
from fopi_tune.spec.model import GainRange

_ZERO, _ONE = arb(0), arb(1)
_MOST_CELLS, _MOST_OF_AXIS, _MOST_OF_RATIO, _MOST_STEPS = 150, 300, 3000, 40
_NARROWEST, _COARSE = 1e-4, 1e-2
_STEP, _FARTHEST = 3.0, 100.0
_SHORT = 0.1
#: in u; more than logarithms are rounded
_ROUNDING = 1e-12


@dataclass(frozen=True)
class LoopGainBounds:
    """Controllers of a box, with one plant.

    Args:
        problem: gives the plants' responses and the ranges.
        controllers: the box.
        kp: their gains.
        integral: the same, at the reference frequency of the box.
        alpha: the same.
        point: the plant.
        is_positive: whether there is no derivative and no gain is negative, after a change of sign.
        sign: -1 where the signs of both gains were changed.
        derivative: kd, 0 without a derivative.
    """

    problem: Problem
    controllers: ControllerBox
    kp: arb
    integral: arb
    alpha: arb
    point: tuple[float, ...]
    is_positive: bool
    sign: int = 1
    derivative: arb = _ZERO

    @classmethod
    def of(
        cls, problem: Problem, controllers: ControllerBox, point: tuple[float, ...], whole: bool = False
    ) -> LoopGainBounds:
        """Those of the box that the spec's ranges allow; with `whole`, all of them.

        Where no gain is positive both signs are changed; |L| is the same, and the rays of a margin are changed too.
        """
        box, alpha = problem.spec.controller, controllers.alpha
        kp, integral = controllers.ends
        if not whole:
            kp = _allowed(kp, box.kp)
            integral = _allowed(integral, box.ki, controllers.integral_unit)
        if controllers.pid is not None:
            low, high = controllers.derivative.lower(), controllers.derivative.upper()
            kd = (arb(low), arb(high)) if whole else _allowed((arb(low), arb(high)), box.kd)
            balls = kp[0].union(kp[1]), integral[0].union(integral[1])
            return cls(problem, controllers, *balls, alpha, point, False, 1, kd[0].union(kd[1]))
        if kp[1] <= 0 and integral[1] <= 0:
            balls = (-kp[1]).union(-kp[0]), (-integral[1]).union(-integral[0])
            return cls(problem, controllers, *balls, alpha, point, True, -1)
        positive = bool(kp[0] >= 0 and integral[0] >= 0)
        return cls(problem, controllers, kp[0].union(kp[1]), integral[0].union(integral[1]), alpha, point, positive)

    def _integral_size(self, u: Interval) -> tuple[arb, arb]:
        """The smallest and the largest z."""
        low, high = _ZERO, arb.pos_inf()
        if self.integral.is_zero():
            return low, _ZERO
        if not math.isinf(u[1]):
            low = self.controllers.least_integral_size(self.integral, u[1])
        if not math.isinf(u[0]):
            high = self.controllers.largest_integral_size(self.integral, u[0])
        return low if low > 0 else _ZERO, high

    def _integral_response(self, u: Interval) -> acb:
        """The integral's part of C, over an interval that is not a tail."""
        return self.controllers.integral_response(self.integral, u)

    def _derivative_response(self, u: Interval) -> acb:
        """The derivative's part of C, over an interval that is not a tail."""
        if self.derivative.is_zero():
            return acb(0)
        return self.derivative / (self.controllers.filter_time + 1 / acb(0, ball_of(u).exp()))

    def _response(self, u: Interval) -> acb:
        """C over an interval that is not a tail."""
        return self.kp + self._integral_response(u) + self._derivative_response(u)

    def _derivative_size(self, u: Interval) -> arb:
        """The largest |kd D|:  |D| is at most omega and at most 1/Tf."""
        if self.derivative.is_zero():
            return _ZERO
        size, most = abs(self.derivative).upper(), 1 / self.controllers.filter_time
        if math.isinf(u[1]):
            return arb((size * most).upper())
        omega = arb(u[1]).exp()
        return arb((size * (omega if omega < most else most)).upper())

    def controller_size(self, u: Interval) -> tuple[arb, arb]:
        """Bounds of |C| over an interval."""
        low, high = self._integral_size(u)
        kp, more = abs(self.kp), self._derivative_size(u)
        kp_low, kp_high = arb(kp.lower()), arb((kp.upper() + more).upper())
        if more > 0:
            kp_low = arb((kp.lower() - more).lower()) if kp.lower() > more else _ZERO
        found = kp_low - high if kp_low > high else low - kp_high if low > kp_high else _ZERO
        if self.is_positive:
            if self.alpha <= 1:
                found = (kp_low**2 + low**2).sqrt()
            else:
                sine = self.controllers.integral_lag(u).sin()
                if sine > 0:
                    found = _larger(found, _larger(kp_low, low) * arb(sine.lower()))
        if not math.isinf(u[0]) and not math.isinf(u[1]):
            value = self._response(u)
            if value.is_finite():
                found = _larger(found, value.abs_lower())
                most = arb(value.abs_upper())
                return arb(found.lower()), most if most < kp_high + high else kp_high + high
        return arb(found.lower()), kp_high + high

    def plant_size(self, u: Interval) -> tuple[arb, arb]:
        """Bounds of |P| over an interval; the dead time has no effect."""
        known = self.problem.plant_gain_bounds
        key = (self.point, u)
        if key not in known:
            over = self.problem.plant_enclosure(self.point, u)
            low, high = over.filtered_plant_size
            known[key] = arb(low.lower()), arb(high.upper())
        return known[key]

    def misses_unity(self, u: Interval, only_below: bool) -> bool:
        """Whether |L| is not 1 (or less than 1) over an interval."""
        c, p = self.controller_size(u), self.plant_size(u)
        if p[1].is_finite() and c[1].is_finite() and c[1] * p[1] < 1:
            return True
        return not only_below and bool(c[0] * p[0] > 1)

    def is_decreasing(self, u: Interval) -> bool:
        """Whether |L| decreases with the frequency all over an interval that is not a tail."""
        slope = self.problem.plant_enclosure(self.point, u).log_slope.real
        own = self.controllers.integral_slope(u) if self.kp.is_zero() else acb(0)
        if not self.derivative.is_zero():
            # d(kd D)/du = kd D/(1 + j omega Tf)
            lag = 1 / (1 + acb(0, ball_of(u).exp() * self.controllers.filter_time))
            own = (self._derivative_response(u) * lag - self._integral_response(u)) / self._response(u)
        elif not self.kp.is_zero() and not self.integral.is_zero():
            z = self._integral_response(u)
            own = self.controllers.integral_slope(u) * (z / (self.kp + z))
        if slope + own.real < 0:
            return True
        if not self.is_positive:
            return False
        most = _ZERO if self.alpha <= 1 else self.controllers.steepest_rise(u)
        return bool(slope + most < 0)

    def has_no_crossover(self, low: float, high: float, only_below: bool = False) -> bool:
        """Whether |L| != 1 (with `only_below`: |L| < 1) all over an interval of u, which may be a tail or the axis."""

        def settled(u: Interval) -> bool:
            return self.misses_unity(u, only_below) or self._misses_unity_centred(u, only_below)

        return _covered(settled, low, high)

    def _misses_unity_centred(self, u: Interval, only_below: bool) -> bool:
        """The same by the mean-value form, which is tighter on short intervals next to a crossing."""
        if not u[1] - u[0] < _SHORT:
            return False
        at = LoopBracket.of(self.problem, self.controllers, self.point, u)
        return at is not None and bool(at.log_gain.upper < 0 or (not only_below and at.log_gain.lower > 0))

    def is_never_minus_one(self, delay_s: arb) -> bool:
        """Whether L != -1 at every frequency from 0 to infinity, behind more dead time."""

        def settled(u: Interval) -> bool:
            return self.misses_unity(u, False) or self._misses_negative_axis(u, delay_s)

        return _covered(settled, -math.inf, math.inf, most=_MOST_OF_AXIS)

    def _misses_negative_axis(self, u: Interval, delay_s: arb) -> bool:
        """Whether L is not negative over an interval, or not -1."""
        low_tail, high_tail = math.isinf(u[0]), math.isinf(u[1])
        over = self.problem.plant_enclosure(self.point, u)
        p = over.gain * self.sign
        if not delay_s.is_zero() or (high_tail and over.delay is not None):
            if high_tail:
                return False
            omega = _ZERO.union(arb(u[1]).exp()) if low_tail else ball_of(u).exp()
            p = p * acb(0, -delay_s * omega).exp()
        if not p.is_finite() or p.contains(0):
            return False
        if not low_tail and not high_tail:
            value = self._response(u) * p
            if value.is_finite() and not (1 + value).contains(0):
                return True
        return self.is_positive and self._cone_misses_negative_axis(u, p)

    def _cone_misses_negative_axis(self, u: Interval, p: acb) -> bool:
        """C lags P by an angle of at most a, that of kp + z e^{ja}, which rises with z/kp."""
        low, high = self._integral_size(u)
        kp = arb(self.kp.lower()), arb(self.kp.upper())
        angle = self.controllers.integral_lag(u)
        turn = acb(angle.cos(), angle.sin())
        least = (kp[1] + low * turn).arg() if low > 0 else _ZERO
        most = (kp[0] + high * turn).arg() if high.is_finite() and kp[0] > 0 else angle
        start = p.arg() if p.real > 0 or not p.imag.contains(0) else arb.pi() + (-p).arg()
        first, last = start - most, start - least
        if not first.is_finite() or not last.is_finite():
            return False
        return any(bool(first > (2 * n - 1) * arb.pi()) and bool(last < (2 * n + 1) * arb.pi()) for n in (-1, 0, 1))

    def has_no_margin_below(self, u: float, margin: arb) -> bool:
        """Whether L is this angle from -1, by lag or by lead, at no gain crossover below the crossover u.

        On consecutive intervals downwards from u, |L| decreases strictly with frequency and is therefore larger than 1.
        On each of the other intervals |L| differs from 1, or L meets neither ray from 0 at that angle from -1.
        """
        rays = [-acb(margin.cos(), side * margin.sin()) for side in (1, -1)]

        def settled(cell: Interval) -> bool:
            return self.misses_unity(cell, False) or self._misses_rays(cell, rays)

        first, width = u, 0.25
        for _ in range(_MOST_STEPS):
            if not self.is_decreasing((first - width, first)):
                width /= 4.0
                if width < _NARROWEST:
                    break
                continue
            first, width = first - width, 2.0 * width
            if settled((first - width, first)):
                break
        return _covered(settled, -math.inf, first, _COARSE)

    def _misses_rays(self, u: Interval, rays: list[acb]) -> bool:
        """Whether L keeps away from the rays from 0 through some points, over an interval."""
        if math.isinf(u[0]) or math.isinf(u[1]):
            return False
        over = self.problem.plant_enclosure(self.point, u)
        c = self._response(u)
        turned = [self.sign * c * over.gain / ray for ray in rays]
        return all(t.is_finite() and (t.real < 0 or not t.imag.contains(0)) for t in turned)


def gain_ratio_stays_beyond(problem: Problem, point: tuple[float, ...], omega: float, level: arb) -> bool:
    """Whether |ln|P/P0|| is at least a level at every frequency from one on."""
    key = (point, omega, float(level.upper()))
    if key not in problem.gain_ratios:
        most = arb(level.upper())

        def settled(u: Interval) -> bool:
            own, nominal = problem.plant_enclosure(point, u), problem.plant_enclosure(problem.nominal, u)
            # in the high tail both numerators over the leading power of s
            top = [polynomial(x.plant.top.reversed.values, x.s) if x.high_tail else x.numerator for x in (own, nominal)]
            ratio = abs(top[0] / top[1] * (nominal.d / own.d))
            return ratio > 0 and ratio.is_finite() and bool(abs(ratio.log()) >= most)

        first = problem.u_interval((omega, omega))[0] - _ROUNDING
        problem.gain_ratios[key] = _covered(settled, first, math.inf, _ROUNDING, _MOST_OF_RATIO)
    return problem.gain_ratios[key]


def _covered(
    settled: Callable[[Interval], bool], low: float, high: float, narrowest: float = _NARROWEST, most: int = _MOST_CELLS
) -> bool:
    """Whether an interval can be split into cells, none too narrow, each of which is settled."""
    pending: list[Interval] = [(low, high)]
    cells = 0
    while pending:
        cells += 1
        first, last = pending.pop()
        endless = math.isinf(first) and math.isinf(last)
        if not endless and settled((first, last)):
            continue
        near = 0.0 if endless else last if math.isinf(first) else first
        if cells > most or last - first < narrowest or abs(near) > _FARTHEST:
            return False
        if math.isinf(first):
            middle = 0.0 if endless else last - _STEP
        else:
            middle = first + _STEP if math.isinf(last) else 0.5 * (first + last)
        pending += [(first, middle), (middle, last)]
    return True


def _allowed(ends: tuple[arb, arb], side: GainRange, unit: arb = _ONE) -> tuple[arb, arb]:
    """The part of an interval inside a range, times a unit; the interval itself where there is none."""
    low, high = ends
    if math.isfinite(side.min):
        low = _larger(low, arb((side.min * unit).lower()))
    if math.isfinite(side.max):
        most = arb((side.max * unit).upper())
        high = most if high > most else high
    return (low, high) if low <= high else ends


def _larger(a: arb, b: arb) -> arb:
    return a if a > b else b
