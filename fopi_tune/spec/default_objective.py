"""What is optimised where a spec names no objective.

The deepest point inside bounds of robustness alone is a controller that is switched off: every margin grows as the
gains fall.  Where no requirement asks the loop to act, the objective is therefore the best rejection of disturbances
that the bounds allow, `iae_disturbance`.  That needs something which bounds the peak of |S|; where nothing does, a
usual limit is added.
"""

from __future__ import annotations

import math
from dataclasses import replace

from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import DesignSpec, Objective, Relation, Requirement, Scope, Sense

#: dB; the limit of |S| that is added: the modulus margin is 0.5
ADDED_SENSITIVITY_DB = 6.0
#: quantities that a lower limit of makes the loop act
_ACTING = ("crossover_rad_s", "complementary_sensitivity_db", "loop_gain_db")
#: measures whose upper limit makes it act
_ACTING_MEASURES = ("settling_time_s", "rise_time_s", "final_error", "iae", "ise")
#: quantities that keep L away from -1
_ROBUST = ("sensitivity_db", "phase_margin_deg")


def asks_to_act(requirement: Requirement) -> bool:
    """Whether a requirement bounds the loop's speed from below, so that a controller that is off misses it."""
    if requirement.quantity in _ACTING:
        return math.isfinite(requirement.lower)
    if requirement.quantity == "load_sensitivity_db":
        # without a controller |P S| is |P|
        return math.isfinite(requirement.upper)
    least = requirement.upper if requirement.end_limit is None else min(requirement.upper, requirement.end_limit)
    return requirement.quantity == "sensitivity_db" and least < 0.0


def with_default_objective(spec: DesignSpec) -> DesignSpec:
    """The spec that is designed for; itself where it names an objective, or where a requirement asks the loop to act.

    Args:
        spec: as written.

    Returns:
        With `minimize: iae_disturbance`, and with |S| <= 6 dB where neither |S| nor the phase margin is bounded.  Gains
        that the spec fixes are checked as they are: itself.
    """
    if spec.controller.fixed is not None:
        return spec
    if spec.objective is not None or any(asks_to_act(requirement) for requirement in spec.requirements):
        return spec
    if any(limit.measure in _ACTING_MEASURES for limit in spec.scenario_requirements):
        return spec
    added: tuple[Requirement, ...] = ()
    if not any(_keeps_away(requirement, spec) for requirement in spec.requirements):
        added = (Requirement("sensitivity_db", Relation.AT_MOST, (ADDED_SENSITIVITY_DB,)),)
    objective = Objective(Sense.MINIMIZE, ObjectiveKind.IAE_DISTURBANCE.value)
    return replace(spec, objective=objective, requirements=(*spec.requirements, *added))


def default_notes(spec: DesignSpec) -> tuple[str, ...]:
    """What `with_default_objective` decides for a spec, in words."""
    used = with_default_objective(spec)
    if used is spec:
        return ()
    notes = [
        "the spec names no objective and asks for no least speed: the gains are those of the best disturbance "
        "rejection that its bounds allow (objective: {minimize: iae_disturbance})"
    ]
    if len(used.requirements) > len(spec.requirements):
        notes.append(
            "nothing bounds |S| or the phase margin of every plant: "
            f"sensitivity_db: {{at_most: {ADDED_SENSITIVITY_DB:g}}} was added"
        )
    return tuple(notes)


def _keeps_away(requirement: Requirement, spec: DesignSpec) -> bool:
    """Whether a requirement over all frequencies and plants keeps L away from -1."""
    is_of_all = requirement.scope is Scope.FAMILY or spec.plant.has_one_plant
    if requirement.quantity not in _ROBUST or not is_of_all:
        return False
    if requirement.quantity == "phase_margin_deg":
        return math.isfinite(requirement.lower)
    everywhere = requirement.from_rad_s == 0.0 and math.isinf(requirement.to_rad_s)
    return everywhere and math.isfinite(requirement.upper)
