"""What integral action costs as omega -> 0, and where a spec must do without it.

With ki != 0 on a plant with a finite P(0) != 0, whatever the gains,

    |C S| -> 1/|P(0)| ,     |T| -> 1 ,     |L| -> infinity ,     |S| -> 0      as omega -> 0 ,

while ki = 0 does not.  The jump at ki = 0 is invisible to a solver: the search looks at both sides of it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fopi_tune.core.loops import Plants
from fopi_tune.design.sides import Bound, Side, sides_of
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import DesignSpec, GainRange


def low_frequency_control_gain(plants: Plants) -> float:
    """The largest of ln 1/|P(0)|; -inf when a plant has a pole or a zero at s = 0."""
    ends = plants.numerator[:, -1], plants.denominator[:, -1]
    if np.any(ends[0] == 0.0) or np.any(ends[1] == 0.0):
        return -math.inf
    return float(np.log(np.abs(ends[1] / ends[0])).max())


def cancels_integral(plants: Plants) -> bool:
    """Whether a zero at s = 0 cancels the controller's integral, which then runs away unseen."""
    return bool(np.any(plants.numerator[:, -1] == 0.0))


def has_negative_gain(plants: Plants) -> bool:
    """Whether the first plant's low-frequency gain is negative."""
    log = plants.log
    turns = (log.phase0[0] - 0.5 * np.pi * log.slope0[0]) / np.pi + plants.unstable_poles[0]
    return bool(round(float(turns)) % 2)


def forbids_integral(side: Side, floor: float) -> bool:
    """Whether this side alone cannot hold with ki != 0."""
    if side.from_rad_s > 0.0:
        return False
    if side.bound is Bound.LOWER and math.isfinite(floor):
        return side.quantity.name == "sensitivity_db"
    if side.bound is not Bound.UPPER:
        return False
    limits = {"control_sensitivity_db": floor, "complementary_sensitivity_db": 0.0, "loop_gain_db": math.inf}
    smallest = limits.get(side.quantity.name, -math.inf)
    return math.isfinite(floor) and side.limit < smallest - 1e-9


def branches(spec: DesignSpec) -> tuple[DesignSpec, ...]:
    """The specs to search in place of this one: as it is, with ki = 0, or both."""
    ki = spec.controller.ki
    if ki.is_fixed or not ki.min <= 0.0 <= ki.max:
        return (spec,)
    plants = Plants.members(spec.plant, spec.plant.corners())
    floor = low_frequency_control_gain(plants)
    without = replace(spec, controller=replace(spec.controller, ki=GainRange(0.0, 0.0)))
    if cancels_integral(plants) or any(forbids_integral(side, floor) for side in sides_of(spec)):
        return (without,)
    if spec.objective and spec.objective.quantity == ObjectiveKind.CONTROL_SENSITIVITY_PEAK and math.isfinite(floor):
        return (spec, without)
    return (spec,)
