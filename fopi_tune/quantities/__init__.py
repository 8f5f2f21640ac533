"""The quantities a requirement can limit, one module a kind.

To add one: write its class in a module here and list it below; the spec language, its schema, the verification and,
for a function of frequency, design, proof, convex path and Monte Carlo read it from `QUANTITIES`.  What is read at a
crossing also has its entry in the tables that CONTRIBUTING.md names; until then these stages refuse it or leave it
undecided.
"""

from fopi_tune.quantities.base import Quantity
from fopi_tune.quantities.crossover import Crossover
from fopi_tune.quantities.delay_margin import DelayMargin
from fopi_tune.quantities.gain_margin import GainMargin
from fopi_tune.quantities.phase_margin import PhaseMargin
from fopi_tune.quantities.phase_slope import PhaseSlope
from fopi_tune.quantities.responses import (
    ComplementarySensitivity,
    ControlSensitivity,
    LoadSensitivity,
    LoopGain,
    Sensitivity,
)

QUANTITIES: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Crossover(),
        PhaseMargin(),
        GainMargin(),
        DelayMargin(),
        Sensitivity(),
        ComplementarySensitivity(),
        ControlSensitivity(),
        LoadSensitivity(),
        LoopGain(),
        PhaseSlope(),
    )
}

__all__ = ["QUANTITIES", "Quantity"]
