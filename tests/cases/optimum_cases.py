"""Specs that given gains just meet:  whatever they are made of, no box that holds the gains may be discarded."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from cases.plants import lag, pole, spec_of, transfer_function

from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.optimum.certify import verified
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange, Objective, Relation, Requirement, Scope, Sense

#: relative distance at which a limit is met; far above rounding, far below what a box's size matters
ROOM = 1e-7

FAMILIES: dict[str, PlantFamily] = {
    "lag": lag(1.0, (2.25, 1.6, 3.1)),
    "lag with dead time": lag(1.0, (2.25, 1.6, 3.1), 0.3),
    "three uncertain numbers": lag((1.0, 0.8, 1.25), (2.25, 1.6, 3.1), (0.3, 0.2, 0.4)),
    "integrator with dead time": pole((1.0, 0.8, 1.2), 0.0, 0.3),
    "second order": transfer_function([1.0], [1.0, (1.2, 0.9, 1.5), (1.0, 0.8, 1.2)], 0.05),
    "resonant": transfer_function([1.0], [1.0, 0.15, 1.0]),
    "right zero": transfer_function([-0.4, 1.0], [1.0, (2.0, 1.6, 2.4), 1.0]),
    "unstable": pole((2.0, 1.8, 2.2), -0.3, 0.05),
    "negative gain": transfer_function([-1.0], [(2.0, 1.5, 2.5), 1.0], 0.1),
    "direct path": transfer_function([0.1, 1.0], [(2.0, 1.5, 2.5), 1.0]),
}

OBJECTIVES = (
    None,
    Objective(Sense.MAXIMIZE, "ki"),
    Objective(Sense.MINIMIZE, "iae_disturbance", 50.0),
    Objective(Sense.MINIMIZE, "phase_margin_spread_deg"),
    Objective(Sense.MINIMIZE, "crossover_spread_db"),
    Objective(Sense.MINIMIZE, "sensitivity_peak_db"),
    Objective(Sense.MINIMIZE, "control_sensitivity_peak_db"),
)


def just_met(
    family: PlantFamily,
    gains: FoPi,
    objective: Objective | None,
    equalities: int,
    pick: np.random.Generator,
    digital: DigitalSpec | None = None,
) -> tuple[DesignSpec, float] | None:
    """A spec that the gains meet with next to nothing to spare, and a level that their objective just beats.

    Args:
        family: the plants.
        gains: a stable design of it.
        objective: what is optimised.
        equalities: of the nominal crossover, and of the nominal phase margin.
        pick: chooses requirements.
        digital: of the loop on samples; None of the one in continuous time.

    Returns:
        None where the loop is unstable, or a number of it does not exist.
    """
    wanted = [
        Requirement("phase_margin_deg", Relation.AT_LEAST, (1.0,)),
        Requirement("phase_margin_deg", Relation.AT_MOST, (500.0,)),
        Requirement("gain_margin_db", Relation.AT_LEAST, (0.1,)),
        Requirement("delay_margin_s", Relation.AT_LEAST, (1e-3,)),
        Requirement("crossover_rad_s", Relation.AT_LEAST, (1e-3,)),
        Requirement("crossover_rad_s", Relation.AT_MOST, (1e3,)),
        Requirement("sensitivity_db", Relation.AT_MOST, (60.0,)),
        Requirement("sensitivity_db", Relation.AT_MOST, (60.0,), to_rad_s=0.05),
        Requirement("complementary_sensitivity_db", Relation.AT_MOST, (60.0,)),
        Requirement("control_sensitivity_db", Relation.AT_MOST, (90.0,)),
        Requirement("loop_gain_db", Relation.AT_MOST, (60.0,), from_rad_s=5.0),
        Requirement("loop_gain_db", Relation.AT_LEAST, (-90.0,), to_rad_s=0.05),
    ]
    chosen = [requirement for requirement in wanted if pick.random() < 0.6]
    found = verified(replace(spec_of(family, *chosen, objective=objective), digital=digital), gains)
    if not found.stability.stable or found.objective is None or found.nominal.phase_margin_deg is None:
        return None
    if equalities and found.nominal.crossover_rad_s is None:
        return None  # no margin at a crossover to be equal to
    limits: list[Requirement] = []
    for result in found.requirements:
        if result.achieved is None:
            return None
        if math.isfinite(result.achieved):
            room = ROOM * max(1.0, abs(result.achieved))
            sign = 1.0 if result.requirement.relation is Relation.AT_MOST else -1.0
            limits.append(replace(result.requirement, limits=(result.achieved + sign * room,)))
    fixed = [
        Requirement("crossover_rad_s", Relation.EQUALS, (found.nominal.crossover_rad_s or 0.0,), Scope.NOMINAL),
        Requirement("phase_margin_deg", Relation.EQUALS, (found.nominal.phase_margin_deg,), Scope.NOMINAL),
    ]
    sides = [GainRange(value - 1.0, value + 1.0) for value in (gains.kp, gains.ki)]
    if gains.ki > 0.0 and pick.random() < 0.7:
        sides[1] = GainRange(0.0, gains.ki + 1.0)
    box = ControllerSpec(sides[0], sides[1], GainRange(0.2, 1.8))
    if isinstance(gains, Pid):
        filter_time_s, one = gains.derivative_filter_time_constant_s, GainRange(1.0, 1.0)
        kd = GainRange(gains.kd - 1.0, gains.kd + 1.0)
        box = ControllerSpec(sides[0], sides[1], one, kd, filter_time_s)
    box = replace(box, measurement_filter=gains.measurement_filter)
    spec = spec_of(family, *fixed[:equalities], *limits, objective=objective)
    spec = replace(spec, controller=box, digital=digital)
    # the objective may read the requirements: it is of the spec as it is now
    value = verified(spec, gains).objective
    if value is None or not math.isfinite(value):
        return None
    room = ROOM * max(1.0, abs(value))
    maximized = objective is None or objective.sense is Sense.MAXIMIZE
    return spec, value - room if maximized else value + room
