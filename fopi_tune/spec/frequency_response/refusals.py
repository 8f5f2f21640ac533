"""What specs with a measured plant ask for and cannot have, because it needs the plant's transfer function."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.default_objective import asks_to_act
from fopi_tune.spec.requirements import PlacedRequirement
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Values

_FIT = "fit a transfer function to the data and write it as plant: for that"
#: relative; an end of a band that is this close to the measured one is inside
_SAME = 1e-9


def refuse_for_measured(values: Values, placed: Sequence[PlacedRequirement], place: Place) -> None:
    """Report what cannot be had of a measured plant; nothing of other plants.

    Args:
        values: of the sections.
        placed: the requirements of the loop's frequencies.
        place: of the whole spec.
    """
    family = values.get("plant")
    if not isinstance(family, MeasuredFamily):
        return
    for section, what in (
        ("scenarios", "simulations need the plant's transfer function, and a measured response has none"),
        (
            "validation",
            "plants are drawn from the ranges of a transfer function's numbers; a measured response has none",
        ),
    ):
        if values.get(section) is not None:
            place.child(section).refuse(f"{what}; remove {section}, or {_FIT}")
    digital = values.get("digital")
    if digital is not None and digital.designs_sampled:
        place.child("digital").child("design").refuse(
            "the loop on samples needs the plant behind its hold, which a measured response does not tell; write "
            "design: continuous, with the hold and the delay of the computer in dead_time_s (1.5 sample times are "
            f"usual), or {_FIT}"
        )
    _refuse_objective(values, placed, place)
    for each in placed:
        _refuse_outside(each, family)


def _refuse_objective(values: Values, placed: Sequence[PlacedRequirement], place: Place) -> None:
    objective, controller = values.get("objective"), values.get("controller")
    if objective is not None and objective.quantity == ObjectiveKind.IAE_DISTURBANCE.value:
        place.child("objective").child("minimize").refuse(
            "iae_disturbance needs the plant at a real s, and a measured response is known on the imaginary axis "
            "alone; write objective: {maximize: ki}, which is nearly the same with alpha = 1, or {minimize: "
            "load_sensitivity_peak_db}"
        )
    is_fixed = controller is not None and controller.fixed is not None
    asks = any(asks_to_act(each.requirement) for each in placed)
    if not place.has("objective") and placed and not asks and not is_fixed:
        place.child("requirements").refuse(
            "no requirement asks the loop to act and there is no objective, so that a controller that is off would be "
            "best; write objective: {maximize: ki}, or a requirement such as crossover_rad_s"
        )


def _refuse_outside(each: PlacedRequirement, family: MeasuredFamily) -> None:
    """A band without a frequency that was measured, or a crossover where nothing was."""
    requirement, (low, high) = each.requirement, family.band_rad_s
    where = f"the measured band, {low:.6g} to {high:.6g} rad/s"
    first, last = low * (1.0 - _SAME), high * (1.0 + _SAME)
    if requirement.from_rad_s > last or requirement.to_rad_s < first:
        key = (
            "at_rad_s" if each.place.has("at_rad_s") else "from_rad_s" if requirement.from_rad_s > last else "to_rad_s"
        )
        place = each.place.child(key) if each.place.has(key) else each.limit_place
        place.refuse(f"lies outside of {where}, where nothing is known of the plant; measure there, or move it inside")
    if requirement.quantity == "crossover_rad_s":
        for limit in (requirement.lower, requirement.upper):
            if math.isfinite(limit) and not first <= limit <= last:
                each.limit_place.refuse(f"{limit:g} rad/s lies outside of {where}; measure there, or move it inside")
                return
