"""C = kp + ki s^-alpha + kd s^mu/(Tf s + 1) in ball arithmetic.

Over its denominator C is a sum of powers, as that of a PID,

    C = M/(s^alpha (Tf s + 1)),    M = ki + kp s^alpha + ki Tf s + kp Tf s^(1 + alpha) + kd s^(alpha + mu) ,         (1)

so that d ln C/du and its derivative are those of `pid.py`, (2), with the degree 1 + alpha.  Next to the ends of the
axis C is a function of s^alpha and s^mu, or of sigma = 1/s:

    s^alpha C = ki + s^alpha (kp + kd s^mu/(Tf s + 1)) ,
            C = kp + ki sigma^alpha + kd sigma^(1 - mu)/(sigma + Tf) .                                              (2)

For Re s >= 0,  |Tf s + 1| >= max(1, Tf |s|):  |s|^p/|Tf s + 1| is at most r^p for |s| <= r, and at most r^(p - 1)/Tf
for |s| >= r where p <= 1.

Source: derived.
"""

from __future__ import annotations

from flint import acb, arb

from fopi_tune.core.controller import derivative_of
from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.controllers import FARTHEST, ControllerOnInterval, LoopParameters
from fopi_tune.proof.balls.pid import PidOnInterval, PidStructure, Power, log_size

_ZERO, _ONE = arb(0), arb(1)
#: exponents that are closer count as equal where a search decides when to give up
_CLOSE = 1e-6


def turn_of(exponent: arb) -> acb:
    """j^exponent."""
    angle = exponent * arb.pi() / 2
    return acb(angle.cos(), angle.sin())


class FoPidStructure(PidStructure):
    """kp + ki s^-alpha + kd s^mu/(Tf s + 1) with kd other than 0."""

    def __init__(self, loop: LoopParameters) -> None:
        super().__init__(loop)
        mu = derivative_of(loop.gains).mu
        self.alpha, self.mu, self.has_limit = loop.alpha, arb(mu), mu == 1.0
        self.order = self.alpha if self.has_integral else _ZERO
        self.at_infinity = self.kp + self.kd / self.filter if self.has_limit else self.kp
        self.degree = self.alpha + 1
        #: kd j^(mu - 1)
        self.turned_derivative = self.kd * turn_of(self.mu - 1)
        sizes = (self.ki, self.kp, self.ki * self.filter, self.kp * self.filter, self.kd)
        exponents = (_ZERO, self.alpha, _ONE, self.degree, self.alpha + self.mu)
        terms = [(e, a) for e, a in zip(exponents, sizes, strict=True) if not a.is_zero()]
        self.powers = [Power(e, a, log_size(a), turn_of(e)) for e, a in terms]
        apart = [abs(float(one - other)) for one, _ in terms for other, _ in terms]
        self.farthest_u = 2.0 * FARTHEST / min((gap for gap in apart if gap > _CLOSE), default=1.0)

    def on_interval(self, u: Interval) -> ControllerOnInterval:
        return FoPidOnInterval(self, u)

    def value(self, s: acb, u: arb) -> acb:
        """C at s = j e^u."""
        derivative = self.turned_derivative if self.has_limit else self.turned_derivative * ((self.mu - 1) * u).exp()
        found = self.kp + derivative / (1 / s + self.filter)
        return found + self.loop.integral * (-self.alpha * u).exp() if self.has_integral else found

    def change_near_zero(self, u: float) -> arb:
        """By (2)."""
        radius = arb(u)
        derivative = abs(self.kd) * (self.mu * radius).exp()
        return (self.alpha * radius).exp() * (abs(self.kp) + derivative) if self.has_integral else derivative

    def change_near_infinity(self, u: float) -> arb:
        """By (2); with mu = 1 the derivative less its limit is -(kd/Tf)/(Tf s + 1)."""
        radius = arb(u)
        derivative = abs(self.kd) / self.filter * ((self.mu - 1) * radius).exp()
        if self.has_limit:
            derivative = abs(self.kd) / self.filter * self.largest_filter(radius.exp())
        return abs(self.ki) * (-self.alpha * radius).exp() + derivative


class FoPidOnInterval(PidOnInterval):
    """kp + ki s^-alpha + kd s^mu/(Tf s + 1) over one interval of frequencies.

    Args:
        fopid: the controller.
        u: the interval of ln omega, possibly a tail.
    """

    def __init__(self, fopid: FoPidStructure, u: Interval) -> None:
        super().__init__(fopid, u)
        self._fopid = fopid

    def _power(self, exponent: arb) -> acb:
        """s^exponent in the low tail, s^-exponent in the high one; exponent > 0."""
        end = -arb(self.u[0]) if self.high_tail else arb(self.u[1])
        return turn_of(-exponent if self.high_tail else exponent) * _ZERO.union((exponent * end).exp())

    @computed_once
    def c(self) -> acb:
        """C; in the low tail of a loop with an integral s^alpha C; in the high tail with 1/s in the place of s."""
        fopid, s = self._fopid, self.s
        if self.high_tail:
            derivative = acb(fopid.kd) if fopid.has_limit else fopid.kd * self._power(1 - fopid.mu)
            found = fopid.kp + derivative / (s + fopid.filter)
            return found + fopid.ki * self._power(fopid.alpha) if fopid.has_integral else found
        if not self.low_tail:
            return fopid.value(s, ball_of(self.u))
        rest = fopid.kp + fopid.kd * self._power(fopid.mu) / (s * fopid.filter + 1)
        return fopid.ki + self._power(fopid.alpha) * rest if fopid.has_integral else rest

    @computed_once
    def x(self) -> acb | None:
        """s^alpha in the low tail of a loop with an integral; None is 1."""
        return self._power(self._fopid.alpha) if self.low_tail and self._fopid.has_integral else None
