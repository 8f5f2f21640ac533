"""Terms of the closed forms of the lag:  G, and the summands of 1 + jx + G, over an interval of u.

Symbols and formula (1a), which is used on samples, are those of `fopi_tune.proof.claims.lag`.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.sampled import SampledBallLoop

#: a value and its derivative in u
ValueAndSlope = tuple[arb, arb]


def scaled_time_constant(loop: BallLoop, time_constant: arb) -> arb:
    """tau in x = omega tau; on samples coth(Ts/(2 tau)) in x = nu tau:  m/(z - 1 + m), m = 1 - e^{-Ts/tau}, is
    (1 - w)/(1 + w (2/m - 1))."""
    if not isinstance(loop, SampledBallLoop):
        return time_constant
    return (loop.sample_time / (2 * time_constant)).coth()


def _delay_factor(loop: BallLoop, omega: arb, dead_time: arb) -> tuple[acb, acb]:
    """h = e^{-j omega L} and d ln h/du; on samples (1 - w) z^-l."""
    if not isinstance(loop, SampledBallLoop):
        if dead_time.is_zero():
            return acb(1), acb(0)
        turn = omega * dead_time
        sine, cosine = turn.sin_cos()
        return acb(cosine, -sine), acb(0, -turn)
    late = loop.whole_samples or 0
    sine, cosine = (2 * late * omega.atan()).sin_cos()
    # d ln(1 - w)/du = -w/(1 - w),  d ln z^-1/du = -2j nu/(1 + nu^2)
    slope = -1 / acb(-1, -1 / omega) - acb(0, 2 * late / (omega + 1 / omega))
    return acb(1, -omega) * acb(cosine, -sine), slope


@dataclass(frozen=True)
class ScaledTerms:
    """The summands of 1 + jx + G, or of the same by (1a).

    Args:
        one: 1 or k, with its derivative.
        rate: d ln x/du.
        g: G.
        slope: dG/du.
        ends: x1 and x2.
    """

    one: ValueAndSlope
    rate: arb
    g: acb
    slope: acb
    ends: tuple[arb, arb]

    @property
    def one_squared(self) -> ValueAndSlope:
        """1, or k^2."""
        value, slope = self.one
        return value * value, 2 * value * slope

    @property
    def g_squared(self) -> ValueAndSlope:
        """|G|^2."""
        real, imag = self.g.real, self.g.imag
        return real * real + imag * imag, 2 * (real * self.slope.real + imag * self.slope.imag)


class LagResponse:
    """G and its derivative over an interval of u."""

    def __init__(self, loop: BallLoop, u: arb, plant: tuple[arb, arb], tau: tuple[arb, arb]) -> None:
        self._loop, self._tau = loop, tau
        self.gain, self.dead_time = plant
        self.omega = u.exp()
        c, slope = loop.controller(u)
        # G = K C h,  d ln G/du = d ln C/du + d ln h/du
        hold, hold_slope = _delay_factor(loop, self.omega, self.dead_time)
        self.c, self.c_slope = c, slope
        self.g, self.log_slope = self.gain * c * hold, slope + hold_slope

    @property
    def g_slope(self) -> acb:
        """dG/du."""
        return self.g * self.log_slope

    @property
    def g_squared(self) -> ValueAndSlope:
        """|G|^2."""
        real, imag = self.g.real, self.g.imag
        size = real * real + imag * imag
        return size, 2 * size * self.log_slope.real

    @property
    def c_squared(self) -> ValueAndSlope:
        """|C|^2."""
        real, imag = self.c.real, self.c.imag
        size = real * real + imag * imag
        return size, 2 * size * self.c_slope.real

    def x(self, upper: bool) -> arb:
        """x1 or x2; its own derivative in u."""
        return self.omega * self._tau[upper]

    @computed_once
    def scaled(self) -> ScaledTerms:
        """The summands of the bounds; by (1a) on samples."""
        if not isinstance(self._loop, SampledBallLoop):
            return ScaledTerms((arb(1), arb(0)), arb(1), self.g, self.g_slope, (self.x(False), self.x(True)))
        theta = self.omega.atan()
        sine, cosine = theta.sin_cos()
        turns = 2 * (self._loop.whole_samples or 0) + 1
        turn_sine, turn_cosine = (turns * theta).sin_cos()
        g = self.gain * self.c * acb(turn_cosine, -turn_sine)
        # d theta/du = sin theta cos theta
        slope = g * (self.c_slope - acb(0, turns * sine * cosine))
        ends = self._tau[0] * sine, self._tau[1] * sine
        return ScaledTerms((cosine, -sine * sine * cosine), cosine * cosine, g, slope, ends)

    @property
    def frequency(self) -> arb:
        """rad/s."""
        return self._loop.frequency(self.omega)

    @property
    def stretch(self) -> arb:
        """d ln frequency/du."""
        return self._loop.stretch(self.omega)


class LagNyquistTail:
    """Terms of a bound over all frequencies from u to Nyquist's, z = -1 included; without derivatives."""

    def __init__(self, loop: SampledBallLoop, from_u: float, gain: arb, tau: tuple[arb, arb]) -> None:
        inverse = arb(0).union((-arb(from_u)).exp())
        theta, zero = arb.pi() / 2 - inverse.atan(), arb(0)
        # 1/w = -j/nu
        self._c = loop.controller_far_up(acb(0, -inverse))
        turn = theta * (2 * (loop.whole_samples or 0) + 1)
        g = gain * self._c * acb(turn.cos(), -turn.sin())
        sine = theta.sin()
        self.scaled = ScaledTerms((theta.cos(), zero), zero, g, acb(0), (tau[0] * sine, tau[1] * sine))

    @property
    def c_squared(self) -> ValueAndSlope:
        """|C|^2."""
        real, imag = self._c.real, self._c.imag
        return real * real + imag * imag, arb(0)
