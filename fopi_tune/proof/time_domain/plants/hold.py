"""The plants of a box behind a zero-order hold, of whatever order:  family, box -> `HeldPlants`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from flint import arb

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, ball_of, centre_of
from fopi_tune.proof.time_domain.jets import Jet, assemble_jets
from fopi_tune.proof.time_domain.models import Model, number_model
from fopi_tune.proof.time_domain.plants.any_order import any_order
from fopi_tune.proof.time_domain.plants.first_order import FirstOrder, Numbers, first_order
from fopi_tune.proof.time_domain.plants.held import HeldPlants, Start
from fopi_tune.proof.time_domain.plants.lateness import lateness_of

_U = 2.0**-53


def family_problem(family: PlantFamily, rates: bool) -> str:
    """Why there is no form of a family's plants; empty where there is one.

    Args:
        family: of the plants.
        rates: whether dy/dt is asked for.
    """
    numerator, denominator, _ = assemble_jets(family, _whole(family))
    order, direct = len(denominator) - 1, len(numerator) == len(denominator)
    if denominator[0].value.contains(0) or len(numerator) > len(denominator):
        return "plants of the family differ in their order"
    if direct and not family.dead_time.is_exact:
        return "plants with a direct path are not continuous in an uncertain dead time"
    if rates and (order != 1 or direct):
        return (
            f"rates of plants of order {order}{' with a direct path' if direct else ''}; they may be largest anywhere"
        )
    return ""


def holding_problem(family: PlantFamily, output: float, rests: bool) -> str:
    """Why the loop cannot start at an output; empty where it can.

    Args:
        family: of the plants.
        output: before the first sample.
        rests: whether an input holds it there.
    """
    numerator, denominator, _ = assemble_jets(family, _whole(family))
    if output == 0.0:
        return ""
    if not rests:
        strict = len(denominator) == 2 and len(numerator) < 2
        return "" if strict else "an initial output without input needs plants of first order without a direct path"
    # an integrator is held anywhere, but only if all plants of the family are integrators
    if denominator[-1].is_zero:
        return ""
    if denominator[-1].value.contains(0) and len(denominator) > 2:
        return "some plants of the family have an integrator and others have none"
    return "no input holds a plant there, because P(0) may be 0" if numerator[-1].value.contains(0) else ""


def _whole(family: PlantFamily) -> list[arb]:
    return [ball_of((number.min, number.max)) for number in family.parameters.values() if not number.is_exact]


def radii_of(box: Box) -> Array:
    """The largest distance from the centre along each axis, rounded up; shape (p,)."""
    centre = centre_of(box)
    return np.array([max(high - c, c - low) * (1.0 + 4 * _U) for (low, high), c in zip(box, centre, strict=True)])


def hold_plants(
    family: PlantFamily, box: Box, sample_time_s: float, delay_samples: float, start: tuple[float, bool], loaded: bool
) -> HeldPlants | None:
    """The plants of a box.

    Args:
        family: whose numbers the box is about.
        box: of the uncertain numbers.
        sample_time_s: Ts.
        delay_samples: computing delay.
        start: output before the first sample, and whether an input held it there.
        loaded: whether there is a load.

    Returns:
        None when the box must be split: it reaches across a whole number of samples of delay.
    """
    radii = radii_of(box)
    top, bottom, dead_time = assemble_jets(family, [ball_of(interval) for interval in box])
    top_0, bottom_0, dead_time_0 = assemble_jets(family, [arb(value) for value in centre_of(box)])
    number, axis = family.dead_time, family.dead_time_axis
    ends = (number.min, number.max) if axis is None else box[axis]
    more = (delay_samples, 0.0 if loaded else delay_samples)
    late = [lateness_of(dead_time, dead_time_0, ends, sample_time_s, each) for each in more]
    if late[0] is None or late[1] is None:
        return None
    output, rests = start
    past = Model.constant(np.zeros(1), radii)
    if rests and output and not bottom[-1].is_zero:
        past = number_model(bottom[-1] / top[-1] * output, bottom_0[-1] / top_0[-1] * output, radii)
    begin, lates = Start(past, output, rests), (late[0], late[1])
    if len(bottom) != 2 or len(top) == 2:
        return any_order((top, bottom), (top_0, bottom_0), radii, arb(sample_time_s), lates, begin, loaded)
    integrates = bottom[1].value.contains(0)

    def numbers(n: Sequence[Jet], d: Sequence[Jet]) -> Numbers:
        return d[1] / d[0], n[0] / d[0], None if integrates else n[0] / d[1], Jet.constant(0, len(radii))

    one = FirstOrder(numbers(top, bottom), numbers(top_0, bottom_0), radii)
    return first_order(one, arb(sample_time_s), lates, begin, (delay_samples, loaded))
