"""Closed-loop stability by Nyquist's criterion; the encirclements are counted from the gain crossovers alone.

F(s) = s^alpha D(s) (1 + L(s)) is analytic right of the imaginary axis, where s^alpha has its principal value and its
branch point at 0 is passed on the right.  Along the upper half of the contour (+0, around 0 to +j0, up the axis, back
to +inf) the argument of 1 + L turns by -pi (Z - P), Z and P the numbers of closed- and open-loop poles on the right
(the zeros of F and of s^alpha D).  Where |L| < 1, arg(1 + L) stays within (-pi/2, pi/2) of a whole turn; where |L| > 1
it follows arg L across the negative real axis.  With q(phi) the number of whole turns nearest to arg L = phi,

    Z = P - 2 sum (q(phi at the end) - q(phi at the start))    over the intervals of omega with |L| > 1.            (1)

The unwrapped phase is known in closed form, so no phase crossover has to be found, whatever the dead time.

Of a stable loop the error of a constant reference in the end is |S(0)| = 1/|1 + L(0)|.

Source: derived from the argument principle as Nyquist uses it (Bell System Technical Journal 11, 1932).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import Crossings, gain_crossovers
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily

#: its name in `Loops.computed`
_COUNT = "unstable closed-loop poles"
#: rad; a loop whose phase at |L| = 1 is this close to -180 deg passes through -1 and counts as unstable
_MARGINAL_RAD = 1e-9
#: plants, and parts of the box, of a search for the largest steady-state error inside
_SAMPLED, _FINEST = 2000, 1e-6


def _turns(phase: Array) -> Array:
    """q(phi): turns of arg(1 + L) when |L| > 1; half-way on the negative real axis itself."""
    x = (phase + np.pi) / (2.0 * np.pi)
    nearest = np.round(x)
    x = np.where(np.abs(x - nearest) < _MARGINAL_RAD / (2.0 * np.pi), nearest, x)
    return 0.5 * (np.floor(x) + np.ceil(x) - 1.0)


def unstable_closed_loop_poles(loops: Loops) -> NDArray[np.float64]:
    """Closed-loop poles in the closed right half-plane, shape (m,).

    inf: infinitely many (a direct path with |L(inf)| >= 1 around a dead time), or a pole on the axis itself, a loop
    through -1, the controller's integral cancelled by a zero of the plant at s = 0, or a pole of the plant there that a
    zero of the plant or of the controller hides.
    """
    if _COUNT not in loops.computed:
        loops.computed[_COUNT] = unstable_poles_from(loops, gain_crossovers(loops))
    return loops.computed[_COUNT]


def unstable_poles_from(loops: Loops, crossings: Crossings) -> NDArray[np.float64]:
    """`unstable_closed_loop_poles` from gain crossovers that are known: all of them, sorted by row and frequency."""
    m = len(loops)
    log = loops.log
    total = np.zeros(m)
    # The contour starts at s = +0 on the real axis, where arg L has not yet turned by slope0 * 90 deg.
    start_phase = log.phase0 - 0.5 * np.pi * log.slope0
    starts_large = (log.slope0 < 0) | ((log.slope0 == 0) & (log.scale > 0))
    total -= np.where(starts_large, _turns(start_phase), 0.0)
    # Downward crossings of |L| = 1 end an interval, upward ones start it.
    end_gain, end_phase = log.end()
    proper = log.slope_end() >= -1e-12
    ends_large = proper & (end_gain > 0)
    direction = _direction(loops, crossings, starts_large, ends_large)
    np.add.at(total, crossings.row, direction * _turns(crossings.phase_rad))
    total += np.where(ends_large, _turns(end_phase), 0.0)
    count = loops.plants.unstable_poles - 2.0 * total
    # On the line itself: through -1 at a crossover, or in the limits omega -> 0 and omega -> inf.
    off = np.abs(np.mod(crossings.phase_rad, 2.0 * np.pi) - np.pi)
    marginal = np.zeros(m, dtype=bool)
    np.logical_or.at(marginal, crossings.row, off < _MARGINAL_RAD)
    marginal |= (log.slope0 == 0) & _is_minus_one(log.scale, start_phase)
    marginal |= proper & _is_minus_one(end_gain, end_phase) & (loops.plants.dead_time_s == 0)
    infinite = proper & (loops.plants.dead_time_s > 0) & (end_gain > -_MARGINAL_RAD)
    cancelled = loops.integral_is_cancelled | loops.hidden_on_axis
    return np.where(marginal | infinite | cancelled, np.inf, count)


def is_stable(loops: Loops) -> NDArray[np.bool_]:
    """Whether each closed loop is stable, shape (m,); a pole on the imaginary axis is not."""
    return unstable_closed_loop_poles(loops) < 0.5


def steady_state_errors(loops: Loops) -> Array:
    """The error that stays after a step of the reference, as a part of the step.

    Args:
        loops: m stable loops, of the fractional controller or on samples.

    Returns:
        Shape (m,); 0 with an integral, of the controller or of the plant, and 1 where L(0) = 0.
    """
    log = loops.log
    finite = np.exp(np.clip(log.scale, -700.0, 700.0)) * np.exp(1j * log.phase0)
    with np.errstate(divide="ignore"):
        error = 1.0 / np.abs(1.0 + finite)
    return np.where(log.slope0 < 0, 0.0, np.where(log.slope0 > 0, 1.0, error))


def largest_steady_state_error(family: PlantFamily, gains: FoPi) -> float:
    """The largest steady-state error over a family whose loops are all stable, as a part of the step.

    1 + L(0) is D(0) + C(0) N(0) over D(0), where these are affine in each uncertain number a ratio of such functions,
    without a pole or a zero in the family's box: it is largest at a corner.  Elsewhere a compass search from the worst
    plant of a sample finds it.

    Args:
        family: the plants.
        gains: the controller.
    """

    if isinstance(family, PlantList):
        return max(largest_steady_state_error(member.family, gains) for member in family.members)

    def errors(points: Array) -> Array:
        return steady_state_errors(Loops.of(gains, Plants.members(family, points)))

    points = family.corners(most=1 << 16)
    if family.is_affine_in_each_number:
        return float(errors(points).max())
    low, width = family.low, family.high - family.low
    points = np.vstack([points, low + np.random.default_rng(0).random((_SAMPLED, len(low))) * width])
    found = errors(points)
    worst, best, step = points[found.argmax()], float(found.max()), 0.25
    while step > _FINEST:
        moves = worst + step * np.vstack([np.diag(width), -np.diag(width)])
        around = np.clip(moves, low, family.high)
        found = errors(around)
        if found.max() > best:
            worst, best = around[found.argmax()], float(found.max())
        else:
            step *= 0.5
    return best


def _direction(
    loops: Loops, crossings: Crossings, starts_large: NDArray[np.bool_], ends_large: NDArray[np.bool_]
) -> Array:
    """+1 where |L| falls below 1, -1 where it rises above, 0 where it only touches 1.

    Decided by |L| half-way to the neighbouring crossings: the sign of the slope at a touching point is rounding.
    """
    row, u = crossings.row, crossings.u
    same = row[1:] == row[:-1]
    between = loops.log_response(row[1:], 0.5 * (u[1:] + u[:-1])).real > 0
    before, after = starts_large[row], ends_large[row]
    before[1:] = np.where(same, between, before[1:])
    after[:-1] = np.where(same, between, after[:-1])
    return before.astype(float) - after.astype(float)


def _is_minus_one(log_gain: Array, phase: Array) -> NDArray[np.bool_]:
    return (np.abs(log_gain) < _MARGINAL_RAD) & (np.abs(np.mod(phase, 2.0 * np.pi) - np.pi) < _MARGINAL_RAD)
