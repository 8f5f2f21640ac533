"""Mean-value forms of the angle of L where |L| = 1, and of ln|L| where L is negative, over a box of controllers.

Lambda times a function that is 0 at the crossing (ln|L|, or arg(-L)) is added to the value.  The sum is expanded around
the centre of the box and of a bracket of u by the mean-value theorem.  The multiplier lambda is chosen so that the
derivative along u vanishes at the centre.  The contribution of the bracket is then of second order.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import IntegralSign, Problem
from fopi_tune.proof.balls.box import Interval, ball_of, centre_of, log_interval

_LARGEST_MULTIPLIER = 1e6
_J = acb(0, 1)


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

    def minus(self, other: MeanValueForm) -> MeanValueForm:
        """The difference, at the same controller."""
        slopes = tuple(a - b for a, b in zip(self.slopes, other.slopes, strict=True))
        return MeanValueForm(self.middle - other.middle, slopes, self.half, self.remainder - other.remainder)


@dataclass(frozen=True)
class _Bracket:
    """ln L on a box of controllers and a bracket of u: the value at the centre, and derivatives over the whole box."""

    u: float
    shift: arb
    controller: acb
    gain: acb
    slopes: tuple[acb, ...]
    along: acb
    along_controller: acb

    @classmethod
    def of(
        cls, problem: Problem, controllers: ControllerBox, point: tuple[float, ...], bracket: Interval
    ) -> _Bracket | None:
        if not bracket[0] < bracket[1]:
            return None
        (u,) = centre_of((bracket,))
        at, over = problem.plant_enclosure(point, (u, u)), problem.plant_enclosure(point, bracket)
        controller = controllers.taylor_model(acb(arb(u), arb.pi() / 2)).middle
        enclosure = controllers.enclosure(bracket)
        if not enclosure.value.is_finite() or enclosure.value.contains(0):
            return None
        slopes = tuple(slope / enclosure.value for slope in enclosure.slopes)
        own = enclosure.along / enclosure.value
        along = own + over.log_slope
        if not along.is_finite() or not at.gain.is_finite() or not all(slope.is_finite() for slope in slopes):
            return None
        return cls(u, ball_of(bracket) - arb(u), controller, controller * at.gain, slopes, along, own)


def log_gain(
    problem: Problem, controllers: ControllerBox, point: tuple[float, ...], bracket: Interval
) -> MeanValueForm | None:
    """ln|L| over the box and an interval of u; None where that is not enclosed."""
    at = _Bracket.of(problem, controllers, point, bracket)
    if at is None:
        return None
    slopes = tuple(slope.real for slope in at.slopes)
    return MeanValueForm(abs(at.gain).log(), slopes, controllers.half, at.along.real * at.shift)


def _multiplier(value: arb, zero: arb) -> float:
    """lambda."""
    steep = float(zero.mid())
    multiplier = -float(value.mid()) / steep if steep != 0.0 else 0.0
    return multiplier if abs(multiplier) < _LARGEST_MULTIPLIER else 0.0


def crossing_angle(
    problem: Problem, controllers: ControllerBox, point: tuple[float, ...], ends: tuple[float, float], rate: arb | None
) -> MeanValueForm | None:
    """pi + arg L (less rate omega) wherever |L| = 1 in a bracket; None where that is not enclosed."""
    bracket = log_interval(*ends)
    at = _Bracket.of(problem, controllers, point, bracket)
    if at is None:
        return None
    phase = _phase(problem, controllers, point, at)
    if phase is None:
        return None
    value, along = phase + arb.pi(), at.along.imag
    if rate is not None:
        omega = ball_of(bracket).exp()
        value, along = value - rate * arb(at.u).exp(), along - rate * omega
    multiplier = _multiplier(along, at.along.real)
    return MeanValueForm(
        value + multiplier * abs(at.gain).log(),
        tuple(slope.imag + multiplier * slope.real for slope in at.slopes),
        controllers.half,
        (along + multiplier * at.along.real) * at.shift,
    )


def _phase(problem: Problem, controllers: ControllerBox, point: tuple[float, ...], at: _Bracket) -> arb | None:
    """arg L, unwrapped, at the centre; None where it may differ by 360 deg between controllers of the box.

    With ki > 0 (or ki = 0, kp < 0 as its limit) C stays in the lower half-plane at every frequency, whatever kp; its
    unwrapped argument is the principal one there.  With ki < 0 that is true of -C, and 180 deg are subtracted (added,
    when the plant's own sign is negative: two minus signs cancel).
    """
    negative = problem.is_negative(point)
    if negative is None:
        return None
    sign = problem.sign
    if sign is IntegralSign.EITHER:
        sign = IntegralSign.POSITIVE if controllers.ki >= 0 else IntegralSign.NEGATIVE
        if sign is IntegralSign.NEGATIVE and not controllers.ki < 0:
            return None
    if (
        sign is IntegralSign.POSITIVE
        and negative
        and not (controllers.ki > 0 or controllers.kp > 0 or problem.spec.controller.ki.min > 0)
    ):
        return None  # ki = 0 and kp < 0 with a negative plant: the unwrapped phase differs by 360 deg
    c = at.controller if sign is IntegralSign.POSITIVE else -at.controller
    if c.contains(0):
        return None
    own = (_J * c).arg()
    # A box at the border of the allowed range may reach beyond it: the phase is right for the allowed controllers
    # if the argument cannot have gone round for any of the others.
    reach = sum((abs(s.imag) * h for s, h in zip(at.slopes, controllers.half, strict=True)), arb(0))
    reach = reach + abs(at.along_controller.imag * at.shift)
    if not abs(own) + reach < 3 * arb.pi() / 2:
        return None
    half_turn = arb(0) if sign is IntegralSign.POSITIVE else arb.pi() if negative else -arb.pi()
    plant = problem.evaluator.phase(problem.plant_enclosure(point, (at.u, at.u)), point)
    phase = plant + own - arb.pi() / 2 + half_turn
    return phase if phase.is_finite() else None


def crossing_gain(
    problem: Problem, controllers: ControllerBox, point: tuple[float, ...], ends: tuple[float, float]
) -> MeanValueForm | None:
    """ln|L| wherever L is negative in a bracket over all of which Re L < 0; None where that is not so."""
    at = _Bracket.of(problem, controllers, point, log_interval(*ends))
    if at is None:
        return None
    turn = (-at.gain).arg()
    reach = sum((abs(s.imag) * h for s, h in zip(at.slopes, controllers.half, strict=True)), arb(0))
    if not abs(turn) + reach + abs(at.along.imag * at.shift) < arb.pi() / 2:
        return None
    multiplier = _multiplier(at.along.real, at.along.imag)
    return MeanValueForm(
        abs(at.gain).log() + multiplier * turn,
        tuple(slope.real + multiplier * slope.imag for slope in at.slopes),
        controllers.half,
        (at.along.real + multiplier * at.along.imag) * at.shift,
    )
