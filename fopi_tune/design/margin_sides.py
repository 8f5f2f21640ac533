"""On which side of -1 a gain crossover must stay, and how far it is from there.

With b = 180 deg + arg L in (-180, 180 deg] a crossover of a stable loop stays where it is:  sigma = sign(b).  The
encirclements of an unstable loop are too few (`fopi_tune.core.stability`): the end of an interval with |L| > 1 has to
lead past -1, or the start of one to lag past it.  The crossover with the shortest way has to go it,

    an end:    b - 360 deg < b' <= 0 ,  sigma = +1        a start:    0 <= b' < b + 360 deg ,  sigma = -1            (1)

where b' is b or one turn from it.  The phase margin is sigma b' and the lag to -1 is b' + 180 deg (1 - sigma): both are
continuous as long as no crossover meets -1, and the margin of (1) is negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.core.stability import unstable_poles_from


@dataclass(frozen=True)
class Sides:
    """The sides of n gain crossovers of m loops.

    Args:
        angle_rad: b', shape (n,).
        side: sigma, shape (n,).
        stable: whether each loop is, shape (m,).
    """

    angle_rad: Array
    side: Array
    stable: NDArray[np.bool_]


def sides_of(loops: Loops, crossings: Crossings) -> Sides:
    """The sides of the gain crossovers of loops.

    Args:
        loops: m loops.
        crossings: all of their gain crossovers, sorted by row and frequency.
    """
    angle = crossings.angle_from_minus_one_rad
    side = np.where(angle < 0.0, -1.0, 1.0)
    stable = unstable_poles_from(loops, crossings) < 0.5
    if stable.all() or not len(angle):
        return Sides(angle, side, stable)
    ends = loops.log.derivative(crossings.row, crossings.u).real <= 0.0
    turn = 2.0 * np.pi
    over = np.where(ends, angle - turn * (angle > 0.0), angle + turn * (angle < 0.0))
    order = np.lexsort((np.abs(over), crossings.row))
    rows, first = np.unique(crossings.row[order], return_index=True)
    shortest = order[first][~stable[rows]]
    angle[shortest], side[shortest] = over[shortest], np.where(ends[shortest], 1.0, -1.0)
    return Sides(angle, side, stable)
