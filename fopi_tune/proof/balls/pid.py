"""C = kp + ki/s + kd s/(Tf s + 1) in ball arithmetic.

Over its denominator C is a sum of powers,

    C = M/(s (Tf s + 1)),    M = sum_j a_j s^j,    a_0 = ki,   a_1 = kp + ki Tf,   a_2 = kp Tf + kd .               (1)

In u = ln omega s^j has the derivative j s^j.  With m_i = sum_j (j - k)^i a_j s^j/M for any k, and q = 1/(Tf s + 1),

    d ln C/du = k - 2 + m_1 + q,    d2 ln C/du2 = m_2 - m_1^2 - q (1 - q) .                                         (2)

k is the power that dominates M, whose own term is then missing in m_1 and m_2: they are small where C is one of its
asymptotes.  (2) holds for any real powers, with the degree of the denominator in the place of 2.  For Re s >= 0,
|Tf s + 1|^2 >= 1 + Tf^2 |s|^2, and

    C - (kp + kd/Tf) = ki/s - (kd/Tf)/(Tf s + 1) .                                                                  (3)

Source: derived.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.core.controller import derivative_of
from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.controllers import FARTHEST, ControllerOnInterval, LoopParameters, Structure

_ZERO, _ONE = arb(0), arb(1)


@dataclass(frozen=True)
class Power:
    """A term of M of (1).

    Args:
        exponent: j.
        size: a_j.
        log: ln of its size, about.
        turn: j^exponent on the imaginary axis; of whole exponents None.
    """

    exponent: int | arb
    size: arb
    log: float
    turn: acb | None = None

    def on_axis(self, size: arb) -> acb:
        """j^exponent times a size."""
        power = self.exponent
        if isinstance(power, arb):
            assert self.turn is not None, "a power that is no whole number has a turn"
            return self.turn * size
        signed = size if power % 4 < 2 else -size
        return acb(0, signed) if power % 2 else acb(signed)


class PidStructure(Structure):
    """kp + ki/s + kd s/(Tf s + 1) with kd other than 0."""

    #: degree of the denominator of (1)
    degree: int | arb = 2

    def __init__(self, loop: LoopParameters) -> None:
        kd, _, filter_s = derivative_of(loop.gains)
        self.kp, self.ki, self.kd, self.filter = loop.kp, loop.ki, arb(kd), arb(filter_s)
        self.loop, self.has_integral = loop, loop.gains.ki != 0.0
        self.order = _ONE if self.has_integral else _ZERO
        self.at_zero = self.ki if self.has_integral else self.kp
        self.at_infinity = self.kp + self.kd / self.filter
        # a_2 and a_1 are products: their logarithms reach twice as far
        self.farthest_u = 2.0 * FARTHEST
        powers = (self.ki, self.kp + self.ki * self.filter, self.kp * self.filter + self.kd)
        self.powers: list[Power] = [Power(j, a, log_size(a)) for j, a in enumerate(powers) if not a.is_zero()]

    def on_interval(self, u: Interval) -> ControllerOnInterval:
        return PidOnInterval(self, u)

    def value(self, s: acb, u: arb) -> acb:
        """C at s = j e^u."""
        inverse = 1 / s
        return self.kp + inverse * self.ki + self.kd / (inverse + self.filter)

    def value_and_slope(self, u: arb) -> tuple[acb, acb]:
        s = acb(0, u.exp())
        return self.value(s, u), self.slope(s, u)

    def slope(self, s: acb, u: arb) -> acb:
        """d ln C/du by (2), at s = j e^u."""
        k, (first,) = self._moments(u, 1)
        return first + 1 / (s * self.filter + 1) + (k - self.degree)

    def curvature(self, s: acb, u: arb) -> acb:
        """d2 ln C/du2 by (2), at s = j e^u."""
        _, (first, second) = self._moments(u, 2)
        q = 1 / (s * self.filter + 1)
        return second - first * first - q * (1 - q)

    def _moments(self, u: arb, count: int) -> tuple[int | arb, list[acb]]:
        """k, and m_1, m_2, ... of (2)."""
        middle = float(u.mid())
        largest = max(self.powers, key=lambda power: power.log + float(power.exponent) * middle)
        k = largest.exponent
        # e^(j u) is sharp over a wide interval, where the square of a ball would hold 0
        terms = [(p.exponent - k, p.on_axis(p.size * (p.exponent * u).exp()), p is largest) for p in self.powers]
        total = sum((term for _, term, _ in terms), acb(0))
        others = [(d, term) for d, term, is_largest in terms if not is_largest]
        return k, [sum((term * d**i for d, term in others), acb(0)) / total for i in range(1, count + 1)]

    def change_near_zero(self, u: float) -> arb:
        """With a pole s C - ki = kp s + kd s^2/(Tf s + 1), else C - kp = kd s/(Tf s + 1)."""
        radius = arb(u).exp()
        derivative = abs(self.kd) * radius * self.largest_filter(radius)
        return radius * (abs(self.kp) + derivative) if self.has_integral else derivative

    def change_near_infinity(self, u: float) -> arb:
        """By (3)."""
        radius = arb(u).exp()
        return abs(self.ki) / radius + abs(self.kd) / self.filter * self.largest_filter(radius)

    def largest_filter(self, radius: arb) -> arb:
        """The largest 1/|Tf s + 1| for |s| = radius, Re s >= 0; |s| times it grows with |s|, and itself it falls."""
        return 1 / (1 + (self.filter * radius) ** 2).sqrt()


class PidOnInterval(ControllerOnInterval):
    """kp + ki/s + kd s/(Tf s + 1) over one interval of frequencies.

    Args:
        pid: the controller.
        u: the interval of ln omega, possibly a tail.
    """

    def __init__(self, pid: PidStructure, u: Interval) -> None:
        super().__init__(pid.loop, u)
        self._pid = pid

    @computed_once
    def c(self) -> acb:
        """C; in the low tail of a loop with an integral s C; in the high tail with 1/s in the place of s."""
        pid, s = self._pid, self.s
        if self.high_tail:
            return pid.kp + s * pid.ki + pid.kd / (s + pid.filter)
        if not self.low_tail:
            return pid.value(s, ball_of(self.u))
        rest = pid.kp + s * pid.kd / (s * pid.filter + 1)
        return pid.ki + s * rest if pid.has_integral else rest

    @computed_once
    def x(self) -> acb | None:
        """s in the low tail of a loop with an integral; None is 1."""
        return self.s if self.low_tail and self._pid.has_integral else None

    @computed_once
    def controller_slope(self) -> acb:
        """d ln C/du; not in a tail."""
        return self._pid.slope(self.s, ball_of(self.u))

    @computed_once
    def controller_curvature(self) -> acb:
        """d2 ln C/du2; not in a tail."""
        return self._pid.curvature(self.s, ball_of(self.u))


def log_size(ball: arb) -> float:
    """ln of the size of a ball, about."""
    size = float(abs(arb(ball.mid())).log())
    return size if math.isfinite(size) else -math.inf
