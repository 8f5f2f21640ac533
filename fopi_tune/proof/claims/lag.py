"""The lag with an uncertain time constant in closed form:  claims in omega alone.

P = K h/(1 + jx) with x = omega tau, h = e^{-j omega L}, and G = K C h = A - 1 + jb.  For every omega the plants are
the interval x1 <= x <= x2, x1 = omega tau_min, x2 = omega tau_max.

Responses.  |S|^2 = (1 + x^2)/(A^2 + (x + b)^2), |T|^2 = |G|^2/(...), |C S|^2 = |C|^2 (1 + x^2)/(...), |P S|^2 =
K^2 |h|^2/(...), |L|^2 = |G|^2/(1 + x^2).  Each bound M is a quadratic that must not be negative on the interval,

    q(x) = qa x^2 + 2 qb x + qc >= 0 ,                                                                             (1)

        |S| <= M :    M^2 - 1,      M^2 b,    M^2 (A^2 + b^2) - 1
        |T| <= M :    M^2,          M^2 b,    M^2 (A^2 + b^2) - |G|^2
        |C S| <= M :  M^2 - |C|^2,  M^2 b,    M^2 (A^2 + b^2) - |C|^2
        |P S| <= M :  M^2,          M^2 b,    M^2 (A^2 + b^2) - K^2
        |L| <= M :    M^2,          0,        M^2 - |G|^2 ,

and all signs change for >=.  Its least value is at x1 or x2, or at the vertex -qb/qa, where it is (qa qc - qb^2)/qa.

On samples x = nu t and |h| = |1 - w| grow without bound towards z = -1, where the responses hardly change.  All terms
are divided by |1 - w|: with theta = omega Ts/2, k = cos theta and y = t sin theta,

    k + jy in the place of 1 + jx,    G/|1 - w| = K C e^{-j (2l + 1) theta} in that of G .                          (1a)

Gain crossovers.  |L| = 1 iff x = sqrt(|G|^2 - 1), hence  b = pi + arg G - atan x  at that omega alone.              (2)

Phase crossovers.  L = -m < 0 iff G = -m (1 + jx), hence  m = -Re G,  x = Im G/Re G.                                 (3)

Source: derived; the squares of the responses with P = K h/(1 + jx) written out.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from flint import arb

from fopi_tune.core.peaks import Response
from fopi_tune.proof.balls.box import Box, Interval, ball_of, is_tail, with_interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import assemble
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.claim import HOLDS, BoxVerdict, Claim
from fopi_tune.proof.claims.crossing_quantities import (
    CrossingQuantity,
    ValueOnUnitCircle,
    angle_from_minus_one,
    lag_to_minus_one,
)
from fopi_tune.proof.claims.crossings import EveryCrossover, EveryPhaseCrossover
from fopi_tune.proof.claims.lag_response import (
    LagNyquistTail,
    LagResponse,
    ScaledTerms,
    ValueAndSlope,
    scaled_time_constant,
)

_CUT = BoxVerdict(None, 0)
_FLAT_AT_LARGE_GAIN = (
    Response.COMPLEMENTARY_SENSITIVITY,
    Response.CONTROL_SENSITIVITY,
    Response.LOAD_SENSITIVITY,
)
_LARGE_GAIN = 4.0
#: rad; where the dead time changes the phase of L by more over a box, |L| alone may prove the claim
_MUCH_OF_A_TURN = 0.3
#: in u; a box that is still not proved at this width may lack digits
_NARROW = 1e-5


def has_lag_form(loop: BallLoop) -> bool:
    """Whether only the time constant of a lag is uncertain; on samples, late by whole samples."""
    lag = loop.family.model == "lag" and loop.family.uncertain_names == ("time_constant_s",)
    # with a measurement filter the plant of the loop is no lag
    lag = lag and loop.gains.measurement_filter is None
    return lag and not (isinstance(loop, SampledBallLoop) and loop.whole_samples is None)


@dataclass(frozen=True)
class _LagClaim(Claim):
    """Base of the closed forms; their boxes have only the axis u.

    Args:
        general: the same claim for any plant; it is used in the tails.
    """

    general: Any

    @property
    def domain(self) -> Box:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The frequencies of the general claim."""
        return self.general.domain[:1]

    @property
    def origin(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """u at which the whole frequency axis is split first."""
        return self.general.origin

    @property
    def farthest_u(self) -> float:
        """That of the general claim."""
        return self.general.farthest_u

    @cached_property
    def _tau(self) -> tuple[arb, arb]:
        low, high = self.general.domain[1]
        return scaled_time_constant(self.general.loop, arb(low)), scaled_time_constant(self.general.loop, arb(high))

    @cached_property
    def _plant(self) -> tuple[arb, arb]:
        """K and the dead time."""
        plant = assemble(self.general.loop.family, [arb(self.general.domain[1][0])])
        return plant.numerator[0].value, plant.dead_time.value

    def examine(self, box: Box) -> BoxVerdict:
        u = box[0]
        loop = self.general.loop
        if math.isinf(u[1]) and isinstance(loop, SampledBallLoop) and self._holds_at_the_end(loop, u[0]):
            return HOLDS
        if is_tail(u):
            return self._by_the_general_claim(u)
        ball = ball_of(u)
        middle = arb(u[0] + 0.5 * (u[1] - u[0]) if u[0] < u[1] else u[0])
        plant, tau = self._plant, self._tau
        found = self._examine(
            u, LagResponse(loop, ball, plant, tau), LagResponse(loop, middle, plant, tau), ball - middle
        )
        # the closed forms lose digits where omega tau is far from 1; the general claim does not
        if found.leaf is None and not found.counterexample and u[1] - u[0] < _NARROW:
            return self._by_the_general_claim(u)
        return found

    def _holds_at_the_end(self, loop: SampledBallLoop, from_u: float) -> bool:
        """Whether the closed form settles the tail up to z = -1."""
        return False

    def _by_the_general_claim(self, u: Interval) -> BoxVerdict:
        box: Box = (u, *self.general.domain[1:])
        found = self.general.examine(box)
        if found.leaf is None and any(axis == 1 for axis, _ in found.monotone_ends):
            # the worst time constant is an end of its interval
            upper = next(upper for axis, upper in found.monotone_ends if axis == 1)
            found = self.general.examine(with_interval(box, 1, (box[1][upper],) * 2))
        return HOLDS if found.leaf is not None else _CUT

    @abstractmethod
    def _examine(self, u: Interval, over: LagResponse, centre: LagResponse, shift: arb) -> BoxVerdict:
        """By the closed form: over a box, with its centre and its distance from it."""

    def to_dict(self) -> dict[str, Any]:
        return {**self.general.to_dict(), "form": "lag"}


@dataclass(frozen=True)
class LagBound(_LagClaim):
    """A bound of a response, by (1)."""

    general: Bound

    @cached_property
    def _square(self) -> arb:
        return (2 * arb(self.general.level)).exp()

    def _holds_at_the_end(self, loop: SampledBallLoop, from_u: float) -> bool:
        """Up to z = -1, by the range of the quadratic."""
        at = LagNyquistTail(loop, from_u, self._plant[0], self._tau)
        q = self._quadratic(at)
        if not all(_end(q, x) >= 0 for x in at.scaled.ends):
            return False
        return self._least_at_an_end(q, at.scaled) or bool(q[0][0] > 0 and _discriminant(q) >= 0)

    @staticmethod
    def _least_at_an_end(q: tuple[ValueAndSlope, ValueAndSlope, ValueAndSlope], scaled: ScaledTerms) -> bool:
        """Whether the least value is at an end: q is concave, or increasing at x1, or decreasing at x2."""
        (qa, _), (qb, _), _ = q
        return bool(qa <= 0 or qb + qa * scaled.ends[0] >= 0 or qb + qa * scaled.ends[1] <= 0)

    def _quadratic(self, at: LagResponse | LagNyquistTail) -> tuple[ValueAndSlope, ValueAndSlope, ValueAndSlope]:
        """qa, qb and qc with their derivatives."""
        m2, zero, scaled = self._square, arb(0), at.scaled
        response = self.general.response
        (one, d_one), (square, d_square) = scaled.one, scaled.one_squared
        if response is Response.LOOP_GAIN:
            size, slope = scaled.g_squared
            found = (m2, zero), (zero, zero), (m2 * square - size, m2 * d_square - slope)
        else:
            g, slope = scaled.g, scaled.slope
            a, da, b, db = one + g.real, d_one + slope.real, g.imag, slope.imag
            distance, d_distance = m2 * (a * a + b * b), 2 * m2 * (a * da + b * db)
            linear = m2 * b, m2 * db
            if response is Response.SENSITIVITY:
                found = (m2 - 1, zero), linear, (distance - square, d_distance - d_square)
            elif response is Response.COMPLEMENTARY_SENSITIVITY:
                size, slope = scaled.g_squared
                found = (m2, zero), linear, (distance - size, d_distance - slope)
            elif response is Response.LOAD_SENSITIVITY:
                # by (1a) |h| is 1 on samples too
                found = (m2, zero), linear, (distance - self._plant[0] ** 2, d_distance)
            else:
                size, slope = at.c_squared
                constant = distance - square * size, d_distance - d_square * size - square * slope
                found = (m2 - size, -slope), linear, constant
        if self.general.upper:
            return found
        return tuple((-value, -slope) for value, slope in found)  # pyright: ignore[reportReturnType]

    def _examine(self, u: Interval, over: LagResponse, centre: LagResponse, shift: arb) -> BoxVerdict:
        # Where |L| is large, |T|, |C S| and |P S| = |T/C| hardly depend on it, while (1) is a difference of large ones.
        large = self.general.response in _FLAT_AT_LARGE_GAIN and over.g.abs_lower() > _LARGE_GAIN
        if large and self._by_the_general_claim(u).leaf is not None:
            return HOLDS
        around, at = over.scaled, centre.scaled
        wide, middle = self._quadratic(over), self._quadratic(centre)
        for upper in (False, True):
            value = _end(middle, at.ends[upper])
            if value < 0:
                return BoxVerdict(None, 0, (), counterexample=True)
            if not value + _end_slope(wide, around.ends[upper], around.rate) * shift >= 0:
                return self._where_the_phase_does_not_matter(u, over)
        if self._least_at_an_end(wide, around):
            return HOLDS
        qa = wide[0][0]
        discriminant = _discriminant(middle) + _discriminant_slope(wide) * shift
        return HOLDS if qa > 0 and discriminant >= 0 else _CUT

    def _where_the_phase_does_not_matter(self, u: Interval, over: LagResponse) -> BoxVerdict:
        """With a long dead time the phase of L varies much where |L| is small: there |L| alone proves the claim."""
        turns = over.omega.rad() * over.dead_time > _MUCH_OF_A_TURN
        return self._by_the_general_claim(u) if turns and over.g.abs_upper() < over.x(False).abs_lower() else _CUT


def _end(q: tuple[ValueAndSlope, ValueAndSlope, ValueAndSlope], x: arb) -> arb:
    """q(x)."""
    (a, _), (b, _), (c, _) = q
    return (a * x + 2 * b) * x + c


def _end_slope(q: tuple[ValueAndSlope, ValueAndSlope, ValueAndSlope], x: arb, rate: arb | int = 1) -> arb:
    """dq(x)/du where dx/du = rate x."""
    (a, da), (b, db), (_, dc) = q
    return (da + 2 * rate * a) * x * x + 2 * (db + rate * b) * x + dc


def _discriminant(q: tuple[ValueAndSlope, ValueAndSlope, ValueAndSlope]) -> arb:
    """qa qc - qb^2, of the sign of q at its vertex when qa > 0."""
    (a, _), (b, _), (c, _) = q
    return a * c - b * b


def _discriminant_slope(q: tuple[ValueAndSlope, ValueAndSlope, ValueAndSlope]) -> arb:
    (a, da), (b, db), (c, dc) = q
    return da * c + a * dc - 2 * b * db


@dataclass(frozen=True)
class LagCrossover(_LagClaim):
    """Phase or delay margin at every gain crossover, by (2)."""

    general: EveryCrossover

    def _examine(self, u: Interval, over: LagResponse, centre: LagResponse, shift: arb) -> BoxVerdict:
        square, square_slope = over.g_squared
        y = centre.g_squared[0] - 1
        for upper in (False, True):
            x, wide = centre.x(upper), over.x(upper)
            # y - x^2 has one sign on the box: no plant crosses |L| = 1 here
            apart = y - x * x + (square_slope - 2 * wide * wide) * shift
            if apart > 0 if upper else apart < 0:
                return HOLDS
        root = (square - 1).sqrt()
        if not (root.is_finite() and root > 0 and y > 0):
            return _CUT
        at_centre = lag_to_minus_one(angle_from_minus_one(centre.g) - y.sqrt().atan())
        # d atan(sqrt y)/du = (dy/du)/(2 sqrt y (1 + y)), and dy/du = 2 (1 + y) Re d ln G/du
        slope = over.log_slope.imag - over.log_slope.real / root
        value = lag = at_centre + slope * shift
        if self.general.quantity is CrossingQuantity.DELAY_MARGIN:
            slope = (slope - lag * over.stretch) / over.frequency
            value = at_centre / centre.frequency + slope * shift
        found = ValueOnUnitCircle(self.general.quantity, value, lag, [slope])
        return HOLDS if found.is_within(self.general.level, self.general.upper) else _CUT


@dataclass(frozen=True)
class LagPhaseCrossover(_LagClaim):
    """No phase crossover with |L| from e^-level to 1, by (3)."""

    general: EveryPhaseCrossover

    def _examine(self, u: Interval, over: LagResponse, centre: LagResponse, shift: arb) -> BoxVerdict:
        slope, at = over.g_slope, centre.g
        smallest = (-arb(self.general.level)).exp()
        # |L|^2 = |G|^2/(1 + x^2)
        size, x1, x2 = over.g_squared[0], over.x(False), over.x(True)
        if size < smallest * smallest * (1 + x1 * x1) or size > 1 + x2 * x2:
            return HOLDS
        real = at.real + slope.real * shift
        if real > -smallest or real < -1:
            return HOLDS
        # Im G - x Re G > 0 is x < Im G/Re G turned round by Re G < 0, and its derivative has dx/du = x
        for upper, sign in ((False, 1), (True, -1)):
            value = at.imag - centre.x(upper) * at.real
            change = slope.imag - over.x(upper) * (slope.real + over.g.real)
            if sign * (value + change * shift) > 0:
                return HOLDS
        return _CUT


#: the general claim's class -> the closed form
CLOSED_FORMS: dict[type[Claim], Callable[[Any], Claim]] = {
    Bound: LagBound,
    EveryCrossover: LagCrossover,
    EveryPhaseCrossover: LagPhaseCrossover,
}


def closed_form(claim: Claim) -> Claim:
    """The claim in omega alone where the family is a lag with one uncertain time constant; else itself."""
    form = CLOSED_FORMS.get(type(claim))
    loop = getattr(claim, "loop", None)
    if form is None or loop is None or not has_lag_form(loop) or len(claim.domain) != 2:
        return claim
    if isinstance(claim, Bound) and claim.line is not None:
        return claim
    low, high = claim.domain[1]
    if not 0.0 < low < high < math.inf:
        return claim
    if isinstance(claim, EveryPhaseCrossover) and isinstance(loop, SampledBallLoop):
        return claim  # next to z = -1, x has no end and (3) is a small difference of large numbers
    if isinstance(claim, EveryCrossover) and claim.quantity not in (
        CrossingQuantity.PHASE_MARGIN,
        CrossingQuantity.DELAY_MARGIN,
    ):
        return claim
    return form(claim)
