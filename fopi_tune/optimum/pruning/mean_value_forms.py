"""Mean-value forms over a box of controllers:  the angle from -1 to L where |L| = 1, and ln|L| where L is negative.

Lambda times a function that is 0 at the crossing (ln|L|, or arg(-L)) is added to the value.  The sum is expanded around
the centre of the box and of a bracket of u by the mean-value theorem.  The multiplier lambda is chosen so that the
derivative along u vanishes at the centre.  The contribution of the bracket is then of second order.

The angle b = 180 deg + arg L is known modulo a turn.  Its branch is chosen at the centre, where it is arg(-L), or
180 deg + arg L where L is nearer to the positive real axis, so that no cut is near.  L has neither zeros nor poles over
the box and the bracket, hence this branch of ln L is analytic there, and the mean-value theorem holds for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flint import acb, arb

from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import Problem
from fopi_tune.proof.balls.box import Interval, ball_of, centre_of

_LARGEST_MULTIPLIER = 1e6
_ZERO = arb(0)


@dataclass(frozen=True)
class MeanValueForm:
    """A value over a box:  middle + sum_i slopes_i t_i + remainder,  |t_i| <= half_i.

    Args:
        middle: at the centre.
        slopes: along the coordinates, enclosed over box and bracket.
        half: half-widths.
        remainder: contribution of the bracket.
    """

    middle: arb
    slopes: tuple[arb, ...]
    half: tuple[arb, ...]
    remainder: arb

    @property
    def _reach(self) -> arb:
        return arb(sum((abs(slope) * h for slope, h in zip(self.slopes, self.half, strict=True)), arb(0)).upper())

    @property
    def upper(self) -> arb:
        """No value is larger."""
        return arb((self.middle + self.remainder + self._reach).upper())

    @property
    def lower(self) -> arb:
        """No value is smaller."""
        return arb((self.middle + self.remainder - self._reach).lower())

    @property
    def at_centre(self) -> arb:
        """The value of the controller at the centre."""
        return self.middle + self.remainder

    def __neg__(self) -> MeanValueForm:
        return MeanValueForm(-self.middle, tuple(-slope for slope in self.slopes), self.half, -self.remainder)

    def minus(self, other: MeanValueForm) -> MeanValueForm:
        """The difference, at the same controller."""
        slopes = tuple(a - b for a, b in zip(self.slopes, other.slopes, strict=True))
        return MeanValueForm(self.middle - other.middle, slopes, self.half, self.remainder - other.remainder)

    @property
    def distances(self) -> tuple[MeanValueForm, MeanValueForm]:
        """Of an angle b, x and 360 deg - x, x = b or -b:  |b|, taken modulo a turn, is at least the smaller one."""
        x = self if self.middle.mid() >= 0 else -self
        return x, replace(-x, middle=2 * arb.pi() - x.middle)


@dataclass(frozen=True)
class LoopBracket:
    """ln L over a box of controllers and a bracket of u.

    Args:
        u: the bracket's centre.
        shift: from there to any u of the bracket.
        omega: frequencies of the bracket, rad/s.
        gain: L at the centre.
        slopes: d ln L along the coordinates, over box and bracket.
        along: d ln L/du, over box and bracket.
        half: half-widths of the box.
    """

    u: float
    shift: arb
    omega: arb
    gain: acb
    slopes: tuple[acb, ...]
    along: acb
    half: tuple[arb, ...]

    @classmethod
    def of(
        cls, problem: Problem, controllers: ControllerBox, point: tuple[float, ...], bracket: Interval
    ) -> LoopBracket | None:
        """One plant's; None where L is not enclosed, or may be 0 or infinite."""
        if not bracket[0] < bracket[1]:
            return None
        (u,) = centre_of((bracket,))
        at, over = problem.plant_enclosure(point, (u, u)), problem.plant_enclosure(point, bracket)
        enclosure = controllers.enclosure(bracket)
        if not enclosure.value.is_finite() or enclosure.value.contains(0):
            return None
        slopes = tuple(slope / enclosure.value for slope in enclosure.slopes)
        along = enclosure.along / enclosure.value + over.log_slope
        gain = controllers.taylor_model(acb(arb(u), arb.pi() / 2)).middle * at.gain
        # the slope of ln P over the bracket is finite only where neither N nor D vanishes
        if not along.is_finite() or not gain.is_finite() or not all(slope.is_finite() for slope in slopes):
            return None
        return cls(u, ball_of(bracket) - arb(u), ball_of(bracket).exp(), gain, slopes, along, controllers.half)

    @property
    def log_gain(self) -> MeanValueForm:
        """ln|L|."""
        slopes = tuple(slope.real for slope in self.slopes)
        return MeanValueForm(abs(self.gain).log(), slopes, self.half, self.along.real * self.shift)

    @property
    def angle(self) -> MeanValueForm:
        """b where |L| = 1, modulo a turn; at the centre in (-180 deg, 180 deg] but for rounding."""
        return self._where_gain_is_one(self._angle, self.along.imag)

    def lag(self, rate: arb = _ZERO) -> MeanValueForm:
        """The lag to -1 less rate omega where |L| = 1; the lag is b modulo a turn, at the centre in [0, 360 deg)."""
        b = self._angle
        lag = b if b.mid() >= 0 else b + 2 * arb.pi()
        return self._where_gain_is_one(lag - rate * arb(self.u).exp(), self.along.imag - rate * self.omega)

    @property
    def gain_where_negative(self) -> MeanValueForm | None:
        """ln|L| where L is negative, if Re L < 0 all over the bracket; None where that is not so."""
        turn = (-self.gain).arg()
        reach = sum((abs(s.imag) * h for s, h in zip(self.slopes, self.half, strict=True)), arb(0))
        if not abs(turn) + reach + abs(self.along.imag * self.shift) < arb.pi() / 2:
            return None
        multiplier = _multiplier(self.along.real, self.along.imag)
        return MeanValueForm(
            abs(self.gain).log() + multiplier * turn,
            tuple(slope.real + multiplier * slope.imag for slope in self.slopes),
            self.half,
            (self.along.real + multiplier * self.along.imag) * self.shift,
        )

    @property
    def _angle(self) -> arb:
        """b at the centre of box and bracket."""
        b = (-self.gain).arg() if self.gain.real.mid() <= 0 else arb.pi() + self.gain.arg()
        return b - 2 * arb.pi() if b.mid() > arb.pi().mid() else b

    def along_crossovers(self, value: arb, along: arb) -> MeanValueForm:
        """A function of u alone where |L| = 1, from its value at the centre and its derivative over the bracket."""
        multiplier = _multiplier(along, self.along.real)
        return MeanValueForm(
            value + multiplier * abs(self.gain).log(),
            tuple(multiplier * slope.real for slope in self.slopes),
            self.half,
            (along + multiplier * self.along.real) * self.shift,
        )

    def _where_gain_is_one(self, value: arb, along: arb) -> MeanValueForm:
        """A value that varies along the coordinates as arg L does."""
        multiplier = _multiplier(along, self.along.real)
        return MeanValueForm(
            value + multiplier * abs(self.gain).log(),
            tuple(slope.imag + multiplier * slope.real for slope in self.slopes),
            self.half,
            (along + multiplier * self.along.real) * self.shift,
        )


def _multiplier(value: arb, zero: arb) -> float:
    """lambda."""
    steep = float(zero.mid())
    multiplier = -float(value.mid()) / steep if steep != 0.0 else 0.0
    return multiplier if abs(multiplier) < _LARGEST_MULTIPLIER else 0.0
