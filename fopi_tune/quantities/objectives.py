"""The objectives: the words after `objective:` in a spec, and the horizon of `iae_disturbance`.

Each stage has the objective's formula on its own, on purpose: `proof/verification/objectives.py` its value,
`design/global_search/` and `design/search.py` its cost, `convex/cone_constraints.py` its rows, and
`optimum/pruning/conditions.py` what beats it.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import PlantFamily


class ObjectiveKind(StrEnum):
    """The quantity that is optimised subject to the requirements; the value is the word in the spec."""

    KI = "ki"
    PHASE_MARGIN_SPREAD = "phase_margin_spread_deg"
    CROSSOVER_SPREAD = "crossover_spread_db"
    SENSITIVITY_PEAK = "sensitivity_peak_db"
    CONTROL_SENSITIVITY_PEAK = "control_sensitivity_peak_db"
    LOAD_SENSITIVITY_PEAK = "load_sensitivity_peak_db"
    IAE_DISTURBANCE = "iae_disturbance"
    #: no objective in the spec: the smallest slack is maximised
    DEPTH = "depth"


#: what `maximize:` and `minimize:` take
OBJECTIVES: dict[str, tuple[str, ...]] = {
    "maximize": (ObjectiveKind.KI.value,),
    "minimize": tuple(kind.value for kind in ObjectiveKind if kind not in (ObjectiveKind.KI, ObjectiveKind.DEPTH)),
}


def default_horizon_s(family: PlantFamily) -> float:
    """The time T of `iae_disturbance` when the spec gives none, in s.

    iae_disturbance is the discounted integral of the error after a unit step at the plant's input,

        int_0^inf e(t) e^{-t/T} dt = T P(s)/(1 + C(s) P(s))   at s = 1/T ,

    and the objective is its largest absolute value over the family; with alpha = 1 it tends to 1/ki as T grows.  T is
    ten times the nominal plant's slowest time constant (1/|p| over its poles other than 0, else its zeros; of a
    fractional plant 1/omega, omega where neighbouring terms are equal) plus its dead time.  A plant K s^n without any
    has as its time the one where |P(j/T)| = 1, and a mere static gain 1 s.
    """
    plants = Plants.of(family.member(family.nominal_point))
    slowest = plants.slowest_s
    time_s = slowest + float(plants.dead_time_s[0])
    if time_s == 0.0:
        slope, scale = float(plants.log.slope0[0]), float(plants.log.scale[0])
        time_s = float(np.exp(scale / slope)) if slope else 1.0
    return 10.0 * time_s
