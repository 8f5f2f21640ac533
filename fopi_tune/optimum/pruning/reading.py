"""What is read where |L| = 1 (the angle), or where L is negative (the gain), over a box of controllers.

Over the box and a bracket of u the value and lambda times what vanishes there are expanded around the centre with the
mean-value theorem; lambda is such that the derivative along u vanishes at the centre.  What is left is of second order
in the box and the bracket.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, arb

from fopi_tune.optimum.charts import Patch
from fopi_tune.optimum.problem import Problem, Sign
from fopi_tune.proof.balls.box import Interval, ball_of, centre_of, outward

_LARGEST_FACTOR = 1e6
_J = acb(0, 1)


@dataclass(frozen=True)
class Read:
    """A value over a box:  middle + sum slopes t + rest,  |t| <= half.

    Args:
        middle: at the centre.
        slopes: along the coordinates, enclosed over box and bracket.
        half: half-widths.
        rest: what the bracket adds.
    """

    middle: arb
    slopes: tuple[arb, ...]
    half: tuple[arb, ...]
    rest: arb

    @property
    def _reach(self) -> arb:
        return arb(sum((abs(slope) * h for slope, h in zip(self.slopes, self.half, strict=True)), arb(0)).upper())

    @property
    def upper(self) -> arb:
        """No value is larger."""
        return arb((self.middle + self.rest + self._reach).upper())

    @property
    def lower(self) -> arb:
        """No value is smaller."""
        return arb((self.middle + self.rest - self._reach).lower())

    def minus(self, other: Read) -> Read:
        """The difference, at the same controller."""
        slopes = tuple(a - b for a, b in zip(self.slopes, other.slopes, strict=True))
        return Read(self.middle - other.middle, slopes, self.half, self.rest - other.rest)


@dataclass(frozen=True)
class _Bracket:
    """ln L around the centre of a patch and a bracket: the value there, and derivatives over all of it."""

    u: float
    shift: arb
    controller: acb
    gain: acb
    slopes: tuple[acb, ...]
    along: acb
    along_controller: acb

    @classmethod
    def of(cls, problem: Problem, patch: Patch, point: tuple[float, ...], bracket: Interval) -> _Bracket | None:
        if not bracket[0] < bracket[1]:
            return None
        (u,) = centre_of((bracket,))
        at, over = problem.cell(point, (u, u)), problem.cell(point, bracket)
        controller = patch.plane(acb(arb(u), arb.pi() / 2)).middle
        sheet = patch.sheet(bracket)
        if not sheet.value.is_finite() or sheet.value.contains(0):
            return None
        slopes = tuple(slope / sheet.value for slope in sheet.slopes)
        own = sheet.along / sheet.value
        along = own + over.log_slope
        if not along.is_finite() or not at.gain.is_finite() or not all(slope.is_finite() for slope in slopes):
            return None
        return cls(u, ball_of(bracket) - arb(u), controller, controller * at.gain, slopes, along, own)


def log_gain(problem: Problem, patch: Patch, point: tuple[float, ...], bracket: Interval) -> Read | None:
    """ln|L| over the box and an interval of u; None where that is not enclosed."""
    at = _Bracket.of(problem, patch, point, bracket)
    if at is None:
        return None
    slopes = tuple(slope.real for slope in at.slopes)
    return Read(abs(at.gain).log(), slopes, patch.half, at.along.real * at.shift)


def _factor(value: arb, zero: arb) -> float:
    """lambda."""
    steep = float(zero.mid())
    factor = -float(value.mid()) / steep if steep != 0.0 else 0.0
    return factor if abs(factor) < _LARGEST_FACTOR else 0.0


def crossing_angle(
    problem: Problem, patch: Patch, point: tuple[float, ...], ends: tuple[float, float], rate: arb | None
) -> Read | None:
    """pi + arg L (less rate omega) wherever |L| = 1 in a bracket; None where that is not enclosed."""
    bracket = outward(*ends)
    at = _Bracket.of(problem, patch, point, bracket)
    if at is None:
        return None
    phase = _phase(problem, patch, point, at)
    if phase is None:
        return None
    value, along = phase + arb.pi(), at.along.imag
    if rate is not None:
        omega = ball_of(bracket).exp()
        value, along = value - rate * arb(at.u).exp(), along - rate * omega
    factor = _factor(along, at.along.real)
    return Read(
        value + factor * abs(at.gain).log(),
        tuple(slope.imag + factor * slope.real for slope in at.slopes),
        patch.half,
        (along + factor * at.along.real) * at.shift,
    )


def _phase(problem: Problem, patch: Patch, point: tuple[float, ...], at: _Bracket) -> arb | None:
    """arg L, unwrapped, at the centre; None where the box may hold controllers on different sheets.

    With ki > 0 (or ki = 0, kp < 0 as its limit) C stays in the lower half-plane at every frequency, whatever kp; its
    unwrapped argument is the principal one there.  With ki < 0 that is true of -C, and half a turn is taken off (added,
    when the plant's own sign is negative: two minus signs cancel).
    """
    negative = problem.is_negative(point)
    if negative is None:
        return None
    sign = problem.sign
    if sign is Sign.EITHER:
        sign = Sign.POSITIVE if patch.ki >= 0 else Sign.NEGATIVE
        if sign is Sign.NEGATIVE and not patch.ki < 0:
            return None
    if sign is Sign.POSITIVE and negative and not (patch.ki > 0 or patch.kp > 0 or problem.spec.controller.ki.min > 0):
        return None  # ki = 0 and kp < 0 on a negative plant: another sheet
    c = at.controller if sign is Sign.POSITIVE else -at.controller
    if c.contains(0):
        return None
    own = (_J * c).arg()
    # A box about the border of what is allowed may reach beyond it: the sheet is right for the controllers that are
    # allowed if none of the others is so far that the argument could have gone round.
    reach = sum((abs(s.imag) * h for s, h in zip(at.slopes, patch.half, strict=True)), arb(0))
    reach = reach + abs(at.along_controller.imag * at.shift)
    if not abs(own) + reach < 3 * arb.pi() / 2:
        return None
    half_turn = arb(0) if sign is Sign.POSITIVE else arb.pi() if negative else -arb.pi()
    plant = problem.reader.phase(problem.cell(point, (at.u, at.u)), point)
    phase = plant + own - arb.pi() / 2 + half_turn
    return phase if phase.is_finite() else None


def crossing_gain(problem: Problem, patch: Patch, point: tuple[float, ...], ends: tuple[float, float]) -> Read | None:
    """ln|L| wherever L is negative in a bracket over all of which Re L < 0; None where that is not so."""
    at = _Bracket.of(problem, patch, point, outward(*ends))
    if at is None:
        return None
    turn = (-at.gain).arg()
    reach = sum((abs(s.imag) * h for s, h in zip(at.slopes, patch.half, strict=True)), arb(0))
    if not abs(turn) + reach + abs(at.along.imag * at.shift) < arb.pi() / 2:
        return None
    factor = _factor(at.along.real, at.along.imag)
    return Read(
        abs(at.gain).log() + factor * turn,
        tuple(slope.real + factor * slope.imag for slope in at.slopes),
        patch.half,
        (at.along.real + factor * at.along.imag) * at.shift,
    )
