"""How gains become a controller on a computer: the section `digital` of a spec, without its text."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DigitalSpec:
    """How the gains become a controller on a computer.

    Args:
        sample_time_s: Ts.
        method: how s^-alpha is approximated.
        poles: of the approximation.
        band_rad_s: where it holds; the default suits gain crossovers from 0.1 to 1000 rad/s.
        rule: from s to z.
        delay_samples: from the measurement to the new control, in samples.
        prewarp: where Tustin's rule is exact: "none" (omega -> 0) or "crossover" (the nominal gain crossover).
        design: which loop the requirements are about, the "continuous" one or the "sampled" one.
        output_limits: of the control, lower first; None without.
        output_rate_per_s: fastest change of the control, per s, inside the controller; None without.
        measurement_unit: of the output and the setpoint; a velocity (`spec.measures`) has an acceleration.
        output_unit: of the control, for people.
    """

    sample_time_s: float
    method: str = "oustaloup"
    poles: int = 7
    band_rad_s: tuple[float, float] = (1e-3, 1e3)
    rule: str = "tustin"
    delay_samples: float = 0.0
    prewarp: str = "none"
    design: str = "continuous"
    output_limits: tuple[float, float] | None = None
    output_rate_per_s: float | None = None
    measurement_unit: str = ""
    output_unit: str = ""

    @property
    def depends_on_crossover(self) -> bool:
        """Whether the filter changes with the loop's gain crossover."""
        return self.prewarp == "crossover" or self.rule == "matched"

    @property
    def designs_sampled(self) -> bool:
        """Whether the requirements are about the loop on samples."""
        return self.design == "sampled"
