"""The unwrapped phase of a loop at one frequency and one plant, in ball arithmetic.

With phases counted from omega -> 0 as `fopi_tune.core.loops` does,

    arg L = arg C + phase0 + Delta arg N - Delta arg D - omega L ,                                                 (1)

where Delta arg X is the continuous change of arg X(j omega) from 0 on.  phase0 is -180 deg for a negative sign and for
every pole in the right half-plane, and +90 deg (-90 deg) for every zero (pole) at the origin.  Up to degree 2 the
change is an arc tangent, since one part of X(j omega)/X(0) keeps its sign.  For higher degrees the phase is followed
over pieces of the axis; on each of them X stays in a ball without 0.  The total change gives the number of right
half-plane roots,

    Delta arg X (0 -> inf) = (n - 2 right) pi/2 .                                                                  (2)

Source: derived from the argument principle; (2) counts each root's quarter turns.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from flint import acb, arb

from fopi_tune.proof.balls.box import ball_of, point_box
from fopi_tune.proof.balls.loop import BallLoop, LoopEnclosure
from fopi_tune.proof.balls.plant import own_derivative, polynomial

_NARROWEST = 1e-7
#: pieces of the axis for one polynomial; one of degree 4 takes some 50
_MOST_PIECES = 5_000
_TAIL_STEP = 1.0
_FARTHEST = 700.0


def unwrapped_phase(loop: BallLoop, at: LoopEnclosure, phases: tuple[PolynomialPhase, PolynomialPhase]) -> arb:
    """arg L by (1), rad; nan where a root on the imaginary axis makes it ambiguous.

    Args:
        loop: the loop.
        at: the loop at one frequency, omega > 0, and one plant.
        phases: of the plant's numerator and denominator.
    """
    numerator, denominator = phases
    omega = at.omega
    if numerator.right_half_plane_roots is None or denominator.right_half_plane_roots is None:
        return arb.nan()
    phase = loop.controller_phase(ball_of(at.u)) + numerator.change(at.u[0], omega) - denominator.change(at.u[0], omega)
    negative = (numerator.leading_is_positive != denominator.leading_is_positive) ^ (
        numerator.right_half_plane_roots % 2 == 1
    )
    # two minus signs cancel
    half_turns = -int(negative != loop.controller_is_negative) - denominator.right_half_plane_roots
    quarter_turns = 2 * half_turns + numerator.roots_at_origin - denominator.roots_at_origin
    return phase + quarter_turns * arb.pi() / 2 + loop.delay_phase(at)


def plant_phases(loop: BallLoop, theta: Sequence[float]) -> tuple[PolynomialPhase, PolynomialPhase]:
    """Phases of the numerator and denominator of one plant."""
    plant = loop.plants(point_box(theta))
    return PolynomialPhase.of([plant.gain.value * c.value for c in plant.numerator]), PolynomialPhase.of(
        [c.value for c in plant.denominator]
    )


@dataclass(frozen=True)
class PolynomialPhase:
    """arg X(j omega) of one real polynomial along the axis.

    Args:
        coefficients: descending powers, first and last not 0.
        roots_at_origin: number of roots at s = 0; they are not in the coefficients.
    """

    coefficients: tuple[arb, ...]
    roots_at_origin: int

    @classmethod
    def of(cls, coefficients: Sequence[arb]) -> PolynomialPhase:
        """Remove coefficients that are exactly 0 at both ends."""
        inner = list(coefficients)
        while inner and inner[0].is_zero():
            inner.pop(0)
        roots_at_origin = 0
        while inner and inner[-1].is_zero():
            inner.pop()
            roots_at_origin += 1
        return cls(tuple(inner), roots_at_origin)

    @property
    def leading_is_positive(self) -> bool:
        """Whether the first coefficient is positive."""
        return bool(self.coefficients[0] > 0)

    @cached_property
    def right_half_plane_roots(self) -> int | None:
        """Roots in the open right half-plane; None when that could not be settled (roots on the axis)."""
        c = self.coefficients
        if not c or not all(end.is_finite() and not end.contains(0) for end in (c[0], c[-1])):
            return None
        if len(c) == 1:
            return 0
        if len(c) == 2:
            return int(c[0] / c[1] < 0)
        if len(c) == 3:
            first, second = c[0] / c[2], c[1] / c[2]
            if first < 0:
                return 1
            if c[1].is_zero():  # undamped: counted as left, like everywhere in this package
                return 0
            return None if second.contains(0) else 0 if second > 0 else 2
        return self._path.right_half_plane_roots if self._path is not None else None

    def change(self, u: float, omega: arb) -> arb:
        """Delta arg X up to omega = e^u, rad."""
        c = self.coefficients
        if len(c) == 1:
            return arb(0)
        if len(c) == 2:
            return (omega * c[0] / c[1]).atan()
        if len(c) == 3:
            # X(j omega)/X(0) = 1 - omega^2 c2/c0 + j omega c1/c0: one of its parts never changes its sign
            return acb(1 - omega * omega * c[0] / c[2], omega * c[1] / c[2]).arg()
        return self._path.change(u) if self._path is not None else arb.nan()

    @cached_property
    def _path(self) -> _Path | None:
        return _Path.along(self.coefficients)


@dataclass(frozen=True)
class _Path:
    """Arguments at points along the axis; between neighbouring points X stays in a ball without 0."""

    coefficients: tuple[arb, ...]
    places: tuple[float, ...]
    changes: tuple[arb, ...]

    @classmethod
    def along(cls, coefficients: tuple[arb, ...]) -> _Path | None:
        """Follow X over the whole axis; None when it comes too close to 0."""
        first, last = _reach(coefficients, -1), _reach(coefficients, 1)
        if first is None or last is None:
            return None
        places = [first]
        pending = [(first, last)]
        while pending:
            a, b = pending.pop()
            if not _range(coefficients, a, b).contains(0):
                places.append(b)
                continue
            middle = 0.5 * (a + b)
            if b - a < _NARROWEST or len(places) + len(pending) > _MOST_PIECES:
                return None
            pending += [(middle, b), (a, middle)]
        values = [_value(coefficients, place) for place in places]
        changes = [(values[0] / coefficients[-1]).arg()]
        for before, after in pairwise(values):
            changes.append(changes[-1] + (after / before).arg())
        return cls(coefficients, tuple(places), tuple(changes))

    def change(self, u: float) -> arb:
        """From 0 to e^u."""
        value = _value(self.coefficients, u)
        k = bisect_right(self.places, u) - 1
        if k < 0:
            return (value / self.coefficients[-1]).arg()
        return self.changes[k] + (value / _value(self.coefficients, self.places[k])).arg()

    @property
    def right_half_plane_roots(self) -> int | None:
        """By (2)."""
        degree = len(self.coefficients) - 1
        end = self.places[-1]
        s = acb(0, arb(end).exp())
        rest = (_value(self.coefficients, end) / (self.coefficients[0] * s**degree)).arg()
        count = (degree - 2 * (self.changes[-1] - rest) / arb.pi()) / 2
        whole = count.unique_fmpz()
        return None if whole is None else int(whole)


def _value(coefficients: Sequence[arb], u: float) -> acb:
    return polynomial(coefficients, acb(0, arb(u).exp()))


def _range(coefficients: Sequence[arb], a: float, b: float) -> acb:
    """X over [a, b] by the mean value theorem."""
    s = acb(0, ball_of((a, b)).exp())
    slope = own_derivative(coefficients, s)
    middle = 0.5 * (a + b)
    return _value(coefficients, middle) + slope * (ball_of((a, b)) - arb(middle))


def _reach(coefficients: Sequence[arb], direction: int) -> float | None:
    """u beyond which, in this direction, the dominant term is more than twice the sum of all others."""
    ordered = list(coefficients) if direction > 0 else list(reversed(coefficients))
    leading, others = ordered[0].abs_lower(), [c.abs_upper() for c in ordered[1:]]
    largest = max((float(c / leading) for c in others), default=1.0)
    u = math.log(max(largest, 1e-300)) if direction > 0 else -math.log(max(largest, 1e-300))
    while abs(u) < _FARTHEST:
        shrink = (-direction * arb(u)).exp()
        total = sum((c * shrink ** (k + 1) for k, c in enumerate(others)), arb(0))
        if 2 * total < leading:
            return u
        u += direction * _TAIL_STEP
    return None
