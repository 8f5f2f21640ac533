"""Closed-loop poles outside the unit circle of one sampled loop, by the argument principle, however long the delay.

F(w) = D(w) + C(w) N(w) z^-late; with the integrator's factor w (E = 1, else E = 0) w^E F is analytic for Re w >= 0 and
grows there as w^(E + k), k the degree of D.  Along w = j nu from 0 to j inf its argument changes by

    Delta = (E + k) pi/2 - pi Z ,                                                                                   (1)

Z the number of zeros on the right.  It is followed over pieces on each of which F stays in a rectangle without 0.

Source: derived from the argument principle.
"""

from __future__ import annotations

from flint import acb, arb

from fopi_tune.proof.balls.box import Interval, ball_of
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import PlantEnclosure

#: in u
_NARROWEST = 1e-9
#: pieces of the axis for one plant, about 5 s; a loop that turns once about the origin takes some ten
_MOST_PIECES = 25_000
_STEP = 1.0
_FARTHEST = 100.0


def count_right_half_plane_zeros(loop: BallLoop, plant: PlantEnclosure, has_integrator: bool) -> int | None:
    """Zeros of F with Re w > 0, by (1).

    Args:
        loop: on samples.
        plant: one plant behind the hold.
        has_integrator: whether the controller has a pole at w = 0.

    Returns:
        The number; None when F comes too close to 0 on the axis to be separated from it.
    """
    low, high = _end(loop, plant, has_integrator, -1.0), _end(loop, plant, has_integrator, 1.0)
    if low is None or high is None:
        return None
    (first, start), (last, end) = low, high
    along = argument_change(loop, plant, first, last)
    if along is None:
        return None
    degree = len(plant.denominator) - 1 + int(has_integrator)
    # start is arg(w^E F) at the first place against w = 0; end is arg(F/w^k) at w = inf against the last
    change = start + along - end
    count = ((degree - 2 * change / arb.pi()) / 2).unique_fmpz()
    return None if count is None or count < 0 else int(count)


def _end(loop: BallLoop, plant: PlantEnclosure, has_integrator: bool, direction: float) -> tuple[float, arb] | None:
    """A point u beyond which F over its power of w keeps away from the imaginary axis, and its argument there."""
    u = direction
    while abs(u) < _FARTHEST:
        tail: Interval = (-float("inf"), u) if direction < 0 else (u, float("inf"))
        over = loop.enclosure(tail, plant)
        value = over.d * over.x + over.c * over.n if over.x is not None else over.characteristic
        if value.is_finite() and not value.real.contains(0):
            at, w = loop.enclosure((u, u), plant), acb(0, arb(u).exp())
            # w^E F at the lower end, F/w^k at the upper one
            here = at.characteristic
            if direction > 0:
                here = here / w ** (len(plant.denominator) - 1)
            elif has_integrator:
                here = here * w
            return u, (here if value.real > 0 else -here).arg()
        u += direction * _STEP
    return None


def argument_change(loop: BallLoop, plant: PlantEnclosure, low: float, high: float) -> arb | None:
    """Change of arg F between two points of the axis, over pieces on each of which F stays in a rectangle without 0.

    Args:
        loop: in continuous time, F = D + C N e^{-Ls}, or on samples.
        plant: one plant.
        low: u to start from.
        high: u to end at.

    Returns:
        rad; None when F comes too close to 0 to be separated from it.
    """
    total, pieces = arb(0), 0
    before = loop.enclosure((low, low), plant).characteristic
    pending = [(low, high)]
    while pending:
        pieces += 1
        a, b = pending.pop()
        middle = 0.5 * (a + b)
        over = loop.enclosure((a, b), plant)
        centre = loop.enclosure((middle, middle), plant).characteristic
        values = centre + over.characteristic_slope * (ball_of((a, b)) - arb(middle))
        if values.is_finite() and not values.contains(0):
            after = loop.enclosure((b, b), plant).characteristic
            total += (after / before).arg()
            before = after
            continue
        if abs(over.c * over.numerator * plant.gain.value) < abs(over.d) and not over.d.contains(0):
            # |L| < 1: 1 + L stays in the right half-plane, however often the dead time turns it
            ends = loop.enclosure((a, a), plant), loop.enclosure((b, b), plant)
            total += (ends[1].d / ends[0].d).arg() + (1 + ends[1].gain).arg() - (1 + ends[0].gain).arg()
            before = ends[1].characteristic
            continue
        if b - a < _NARROWEST or pieces > _MOST_PIECES:
            return None
        pending += [(middle, b), (a, middle)]
    return total
