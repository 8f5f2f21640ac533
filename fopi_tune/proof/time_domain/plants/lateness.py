"""How many samples an input is late, over a box of plants, and where a family is cut because of it.

A delay of d + f samples, d whole and 0 <= f <= 1, is differentiable in the dead time between two whole numbers.  So the
family is cut there, and boxes lie between.  A delay within 1e-12 of a whole number of samples counts as whole, as in
the simulation, where it does not depend on the plant; both readings are enclosed.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from flint import arb, ctx

from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, with_interval
from fopi_tune.proof.time_domain.jets import Jet

#: a delay this close to a whole number of samples counts as whole; as in `simulation.sampled.plants`
WHOLE = 1e-12
#: a box may reach beyond a whole number of samples by so much; above the rounding of a dead time
MOST_BEYOND = 1e-9
_U, _PRECISION = 2.0**-53, 128


def _dead_time_cuts(family: PlantFamily, sample_time_s: float, more: set[float]) -> tuple[float, ...]:
    """Dead times inside their range, s, that are whole numbers of samples or just above, with one of more samples."""
    number, found = family.dead_time, set()
    for extra in more:
        ends = (math.floor(number.min / sample_time_s + extra), math.ceil(number.max / sample_time_s + extra))
        for whole in range(*ends):
            cut = (whole + 1 - extra) * sample_time_s * (1.0 - 4 * _U)
            with ctx.workprec(_PRECISION):
                while not arb(cut) / arb(sample_time_s) + arb(extra) >= whole + 1:
                    cut = math.nextafter(cut, math.inf)
            if number.min < cut < number.max:
                found.add(cut)
    return tuple(sorted(found))


def cut_at_whole_samples(family: PlantFamily, sample_time_s: float, more: set[float]) -> list[Box]:
    """The family's box, cut where the dead time with one of these delays, in samples, is a whole number of samples."""
    box: Box = tuple((float(low), float(high)) for low, high in zip(family.low, family.high, strict=True))
    axis = family.dead_time_axis
    if axis is None:
        return [box]
    edges = [box[axis][0], *_dead_time_cuts(family, sample_time_s, more), box[axis][1]]
    return [with_interval(box, axis, ends) for ends in itertools.pairwise(edges)]


@dataclass(frozen=True, eq=False)
class Lateness:
    """A delay of whole + part samples over a box and at its centre; `beyond` is by how much it may be off 0 or 1."""

    whole: int
    part: Jet
    centre: Jet
    beyond: float

    @property
    def is_whole(self) -> bool:
        """Whether no part of a sample is left."""
        return self.part.is_zero


def lateness_of(
    dead_time: Jet, centre: Jet, ends: tuple[float, float], sample_time_s: float, more: float
) -> Lateness | None:
    """The delay in samples; None when a box reaches across a whole number.

    Args:
        dead_time: over the box.
        centre: at its centre.
        ends: the smallest and the largest, s.
        sample_time_s: Ts.
        more: samples of delay beside the dead time.
    """
    low, high, middle = (arb(end) / arb(sample_time_s) + arb(more) for end in (*ends, centre.value))
    nearest = round(float(middle.mid()))
    if ends[0] == ends[1] and abs(middle - nearest) < WHOLE:
        nothing = Jet.constant(0, len(dead_time.slopes))
        return Lateness(nearest, nothing, nothing, float(abs(middle - nearest).upper()))
    whole = math.floor(float(low.mid()) + 0.5 * WHOLE)
    beyond = max(float((high - (whole + 1)).upper()), float((whole - low).upper()), 0.0)
    if beyond > MOST_BEYOND:
        return None
    within = arb(0).union(arb(1))
    part = low.union(high) - whole
    part = part.intersection(within) if part.overlaps(within) else arb(0)
    at_centre = arb(0).max(middle - whole).min(arb(1))
    slopes, pairs = ((dead_time / arb(sample_time_s)).slopes, dead_time.pairs)
    # a ball's rounding is beyond a whole number as well
    beyond = beyond + 1e-14 if beyond > 1e-30 else 0.0
    return Lateness(whole, Jet(part, slopes, pairs), Jet(at_centre, slopes, pairs), beyond)
