"""Quantities that are functions of frequency: |S|, |T|, |C S|, |P S| and |L| in dB."""

from __future__ import annotations

from typing import Any

from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured
from fopi_tune.core.peaks import Response, Tilt, extremes
from fopi_tune.quantities.base import NEPER_PER_DB, EvaluatedAt, LoopSymbols, Quantity


class FrequencyFunction(Quantity):
    """A response's gain in dB over a band."""

    where = EvaluatedAt.BAND
    response: Response

    def to_natural(self, value: float) -> float:
        return value * NEPER_PER_DB

    def from_natural(self, value: float) -> float:
        return value / NEPER_PER_DB

    def measure(
        self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float, tilt: Tilt | None = None
    ) -> Measured:
        found = extremes(loops, self.response, from_rad_s, to_rad_s, largest, tilt)
        return Measured(found.value / NEPER_PER_DB, found.omega_rad_s, found.cells)


class Sensitivity(FrequencyFunction):
    name = "sensitivity_db"
    response = Response.SENSITIVITY
    meaning = "|S| = |1/(1 + L)|: from output disturbance to output"

    def natural(self, loop: LoopSymbols) -> Any:
        return -loop.log_return_difference


class ComplementarySensitivity(FrequencyFunction):
    name = "complementary_sensitivity_db"
    response = Response.COMPLEMENTARY_SENSITIVITY
    meaning = "|T| = |L/(1 + L)|: from reference to output"

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.log_gain - loop.log_return_difference


class ControlSensitivity(FrequencyFunction):
    name = "control_sensitivity_db"
    response = Response.CONTROL_SENSITIVITY
    meaning = "|C S| = |C/(1 + L)|: from measurement noise to control"

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.log_controller - loop.log_return_difference


class LoadSensitivity(FrequencyFunction):
    name = "load_sensitivity_db"
    response = Response.LOAD_SENSITIVITY
    meaning = "|P S| = |P/(1 + L)|: from a load on the input of the plant to output"

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.log_plant - loop.log_return_difference


class LoopGain(FrequencyFunction):
    name = "loop_gain_db"
    response = Response.LOOP_GAIN
    meaning = "|L| = |C P|"

    def natural(self, loop: LoopSymbols) -> Any:
        return loop.log_gain
