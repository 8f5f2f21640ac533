"""Closed-loop poles in the right half-plane:  counted for one plant, excluded near 0 and infinity for all plants.

The closed-loop poles are the roots of  F(s) = s^a D(s) + s^a C(s) N(s) e^{-Ls}, a the order of the pole of C at 0:

    C = kp + ki s^-alpha              a = alpha, without ki 0         s^a C -> ki, without ki kp        C -> kp
    C = kp + ki/s + kd s/(Tf s + 1)   a = 1, without ki 0             s^a C -> ki, without ki kp        C -> kp + kd/Tf

as s -> 0 and as s -> inf; N/D is the plant with its measurement filter.  F is analytic for Re s > 0, since the filters'
poles are on the left.  Along +0 -> j0 -> j inf -> +inf the argument of F changes by

    Delta arg F = -pi Z ,                                                                                          (1)

Z the number of poles on the right, since F takes conjugate values at conjugate s and is real at both ends.  Near 0,
F stays in a disc around F(0); near infinity F/(s^(n + a) d_n) stays in one around 1 + C(inf) n_n/d_n, or around 1
when a dead time turns the direct path.  Both bounds hold in the whole half-plane Re s >= 0, where |e^{-Ls}| <= 1.

Source: derived from the argument principle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flint import acb, arb

from fopi_tune.proof.balls.argument_principle import argument_change
from fopi_tune.proof.balls.box import Box, ball_of
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import PlantEnclosure, assemble
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.balls.sampled_roots import MOST_ROOTS, count_unstable_roots
from fopi_tune.proof.balls.whole_samples import rounded_down
from fopi_tune.proof.claims.claim import HOLDS, PLAIN, BoxVerdict, LoopClaim, longest_parameter_axis

#: work of counting the poles of one plant on samples by the roots of its polynomial; by the argument principle
_ROOTS_WORK, _CONTOUR_WORK = 100, 4000
_STEP = 1.0
_FARTHEST = 600.0


@dataclass(frozen=True)
class _Disc:
    """A disc in which F (or F over its leading term) stays beyond u."""

    u: float
    middle: arb


def count_unstable_poles(loop: BallLoop, theta: tuple[float, ...], origin: float) -> int | None:
    """Closed-loop poles with Re s > 0 of one plant, by (1); on samples those outside the unit circle.

    Args:
        loop: gains and family.
        theta: the plant's uncertain numbers.
        origin: a value of u near the crossover.

    Returns:
        The number; None when F comes too close to 0 on the imaginary axis to be separated from it.
    """
    if isinstance(loop, SampledBallLoop):
        return count_unstable_roots(loop, theta)
    plant = loop.plant([arb(value) for value in theta])
    low, high = _low_end(loop, plant, origin), _high_end(loop, plant, origin)
    if low is None or high is None:
        return None
    along = argument_change(loop, plant, low.u, high.u)
    if along is None:
        return None
    first, last = loop.enclosure((low.u, low.u), plant), loop.enclosure((high.u, high.u), plant)
    degree = plant.denominator_orders[0]
    order = loop.structure.order
    quarter = arb.pi() / 2
    # F(j e)/F(0), then along the axis, then back from (jR)^(n + a) d_n q to R^(n + a) d_n q
    start = (first.characteristic * _power(loop, low.u) / low.middle).arg()
    s = acb(0, arb(high.u).exp())
    end = (last.characteristic / (_raised(s, degree) * plant.denominator[0].value * high.middle)).arg()
    total = start + along - end - (degree + order) * quarter
    count = (-total / arb.pi()).unique_fmpz()
    return None if count is None or count < 0 else int(count)


def is_structurally_unstable(loop: BallLoop, theta: tuple[float, ...]) -> bool:
    """Whether a plant's loop is unstable without counting poles.

    Its integral is cancelled by a zero of the plant at s = 0, or its integrator by a zero of the controller there, or a
    dead time is inside a direct path with |C(inf) n_n/d_n| > 1, which has infinitely many poles on the right.
    """
    plant, structure = assemble(loop.family, [arb(value) for value in theta]), loop.structure
    on_samples = isinstance(loop, SampledBallLoop)
    integral = loop.has_integrator if on_samples else not structure.order.is_zero()
    n, d = plant.at_zero
    if integral and n.is_zero():
        return True
    if on_samples:
        return False
    if structure.at_zero.is_zero() and d.is_zero():
        return True
    if not plant.has_equal_degrees or not plant.dead_time.value > 0:
        return False
    if loop.gains.measurement_filter is not None:
        # it ends every direct path
        return False
    return bool(abs(structure.at_infinity * plant.numerator[0].value / plant.denominator[0].value) > 1)


def _power(loop: BallLoop, u: float) -> acb:
    """s^a on the axis; 1 without an integral."""
    order = loop.structure.order
    if order.is_zero():
        return acb(1)
    return (order * arb(u)).exp() * loop.turn


def _low_end(loop: BallLoop, plant: PlantEnclosure, origin: float) -> _Disc | None:
    """F stays in a disc without 0 around F(0) for |s| <= e^u."""
    d, n = _sizes(plant)
    structure = loop.structure
    order, at_zero = structure.order, structure.at_zero
    integral = not order.is_zero()
    n_at_zero, d_at_zero = plant.at_zero
    bottom = at_zero * n_at_zero
    middle = bottom if integral else d_at_zero + bottom
    if not middle.is_finite() or middle.contains(0):
        return None
    dead_time = arb(plant.dead_time.value.abs_upper())
    u = min(origin, 0.0)
    while u > -_FARTHEST:
        e = arb(u).exp()
        whole_d, whole_n = _sum(d, e), _sum(n, e)
        # |N e^{-Ls} - N(0)| <= |N - N(0)| + |N| |Ls|
        moved = whole_n - arb(n_at_zero.abs_upper()) + whole_n * dead_time * e
        radius = (order * u).exp() * whole_d if integral else whole_d - arb(d_at_zero.abs_upper())
        radius = radius + structure.change_near_zero(u) * whole_n + abs(at_zero) * moved
        if radius < middle.abs_lower():
            return _Disc(u, middle)
        u -= _STEP
    return None


def _high_end(loop: BallLoop, plant: PlantEnclosure, origin: float) -> _Disc | None:
    """F/(s^(n + a) d_n) stays in a disc without 0 for |s| >= e^u."""
    d, n = _sizes(plant)
    degree, structure = plant.denominator_orders[0], loop.structure
    leading = plant.denominator[0].value
    if leading.contains(0):
        return None
    at_infinity = structure.at_infinity
    direct = plant.numerator[0].value / leading if plant.has_equal_degrees else arb(0)
    delayed = not plant.dead_time.value.is_zero()
    # a dead time that may be 0 or not leaves the direct path anywhere on its circle
    middle = arb(1) if delayed else 1 + at_infinity * direct
    fixed = abs(at_infinity * direct) if delayed else arb(0)
    scale = leading.abs_lower()
    u = max(origin, 0.0)
    while u < _FARTHEST:
        e = (-arb(u)).exp()
        rest_d = sum((c * e ** (degree - k) for k, c in d[:-1]), arb(0)) / scale
        whole_n = sum((c * e ** (degree - k) for k, c in n), arb(0)) / scale
        rest_n = sum((c * e ** (degree - k) for k, c in n if k < degree), arb(0)) / scale
        changed = structure.change_near_infinity(u) * whole_n
        if rest_d + abs(at_infinity) * rest_n + changed + fixed < middle.abs_lower():
            return _Disc(u, middle)
        u += _STEP
    return None


def _sizes(plant: PlantEnclosure) -> tuple[list[tuple[Any, arb]], list[tuple[Any, arb]]]:
    """The powers of D and N with the largest absolute values of their coefficients, by rising power."""
    sides = (plant.denominator, plant.denominator_orders), (plant.numerator, plant.numerator_orders)
    d, n = ([(k, arb(c.value.abs_upper())) for c, k in zip(*side, strict=True)][::-1] for side in sides)
    return d, n


def _sum(sizes: list[tuple[Any, arb]], e: arb) -> arb:
    return sum((c * e**k for k, c in sizes), arb(0))


def _raised(s: acb, power: Any) -> acb:
    """s^power on the principal branch."""
    return s**power if isinstance(power, int) else (power * s.log()).exp()


@dataclass(frozen=True)
class NoPoleAtTheEnds(LoopClaim):
    """No plant has a closed-loop pole with Re s >= 0 near 0 or near infinity.

    Together with a bound of |S| on the axis this implies that no pole crosses the axis within the box.

    Args:
        loop: gains and family.
        domain: the plants; axis 0 is not cut.
        origin: a value of u near the crossover.
    """

    loop: BallLoop
    domain: Box
    origin: float

    def examine(self, box: Box) -> BoxVerdict:
        plant = self.loop.plant([ball_of(side) for side in box[1:]])
        ends = _low_end(self.loop, plant, self.origin), _high_end(self.loop, plant, self.origin)
        return HOLDS if None not in ends else BoxVerdict(None, longest_parameter_axis(box, self.domain))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "no_pole_at_the_ends"}


@dataclass(frozen=True)
class StableOnEveryPiece(LoopClaim):
    """On samples, one plant of every piece of the family has no closed-loop pole outside the unit circle.

    Together with a bound of |S| this implies that no plant has, where the plants jump between the pieces: the poles of
    a direct path are continuous only between two whole numbers of samples of delay.

    Args:
        loop: gains and family.
        domain: the plants; axis 0 is not cut.
        origin: not used.
        nominal: the uncertain numbers but for the dead time.
    """

    loop: SampledBallLoop  # pyright: ignore[reportIncompatibleVariableOverride]
    domain: Box
    origin: float
    nominal: tuple[float, ...]

    def examine(self, box: Box) -> BoxVerdict:
        pieces = self.loop.pieces
        assert pieces is not None, "this claim is about a family with pieces"
        (axis,) = self.loop.cuts
        whole = pieces.whole_samples(box[axis])
        if whole is None:
            return BoxVerdict(None, axis)
        dead_time_s = pieces.member(whole)
        plant = (*self.nominal[: axis - 1], dead_time_s, *self.nominal[axis:])
        work = _ROOTS_WORK if whole < MOST_ROOTS // 2 else _CONTOUR_WORK
        if rounded_down(pieces.samples_of(dead_time_s)) != whole or count_unstable_roots(self.loop, plant) != 0:
            return BoxVerdict(None, -1, work=work)
        return BoxVerdict(PLAIN, work=work)

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "stable_on_every_piece"}
