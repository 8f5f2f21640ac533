"""What the paper prints:  gains, plants, specifications and filters.

The paper: HosseinNia, Tejado, Vinagre, Milanes, Villagra, "Low Speed Control of an Autonomous Vehicle
Using a Hybrid Fractional Order Controller".  Nothing here is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant

#: relative; so that a number exactly half a unit away agrees, despite binary rounding
_ROUNDING = 1e-9


@dataclass(frozen=True)
class PublishedNumber:
    """A number as the paper prints it: "0.70" is known to half a unit of its last digit, 0.005.

    Args:
        text: digits with a point, without an exponent.
    """

    text: str

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text)

    @property
    def tolerance(self) -> float:
        """Half a unit of the last digit."""
        return 0.5 * 10.0 ** -len(self.text.partition(".")[2])

    def agrees(self, value: float | None) -> bool:
        """Whether a number rounds to the printed one; None never does."""
        return value is not None and abs(value - self.value) <= self.tolerance * (1.0 + _ROUNDING)


@dataclass(frozen=True)
class PublishedGains:
    """The gains of a row in the paper's table of controllers."""

    kp: PublishedNumber
    ki: PublishedNumber
    alpha: PublishedNumber

    @property
    def gains(self) -> FoPi:
        """The gains as numbers."""
        return FoPi(self.kp.value, self.ki.value, self.alpha.value)

    def agree(self, gains: FoPi | None) -> bool:
        """Whether gains round to the published ones."""
        if gains is None:
            return False
        return self.kp.agrees(gains.kp) and self.ki.agrees(gains.ki) and self.alpha.agrees(gains.alpha)

    def __str__(self) -> str:
        return f"kp = {self.kp.text}, ki = {self.ki.text}, alpha = {self.alpha.text}"


@dataclass(frozen=True)
class PublishedFilter:
    """R_d(z) = sum b_k z^-k/(1 + sum a_k z^-k).

    Args:
        name: of the controller.
        of: its gains.
        b: b_0 ... b_7.
        a: 1, a_1 ... a_7.
    """

    name: str
    of: PublishedGains
    b: tuple[float, ...]
    a: tuple[float, ...]


THROTTLE = PublishedGains(PublishedNumber("0.09"), PublishedNumber("0.025"), PublishedNumber("0.8"))
BRAKE = PublishedGains(PublishedNumber("0.07"), PublishedNumber("0.11"), PublishedNumber("0.45"))

#: G1(s) = K/(s + p), km/h per full control
THROTTLE_GAIN, THROTTLE_POLE_RAD_S = 4.39, 0.1746
THROTTLE_PLANT = Plant((THROTTLE_GAIN,), (1.0, THROTTLE_POLE_RAD_S))
#: G2(s) = 1/(tau s + 1)
TAU_MIN_S, TAU_NOMINAL_S, TAU_MAX_S = 1.6, 2.25, 3.1
#: "a random noise with mean value of 0.85 is added"
TAU_NOISE_MEAN_S = 0.85

#: |S| <= -20 dB up to this frequency
REJECTION_DB, REJECTION_RAD_S = -20.0, 0.035
#: the brake's specifications: PM, crossover, gain margin (absolute)
SPECIFIED_PM_DEG, SPECIFIED_CROSSOVER_RAD_S, SPECIFIED_GAIN_MARGIN = 90.0, 0.3, PublishedNumber("4")
#: what the paper reads from Fig. 3
FIG3_CROSSOVER_RAD_S, FIG3_PM_DEG = PublishedNumber("0.7"), PublishedNumber("93")

COMFORT_M_S2 = 2.0
MANOEUVRE_KMH = 30.0
CONTROL_LIMIT = 1.0
SAMPLE_TIME_S = 0.2

FILTERS: Mapping[str, PublishedFilter] = {
    found.name: found
    for found in (
        PublishedFilter(
            "throttle",
            THROTTLE,
            (0.1573, 0.1325, -0.4389, -0.3658, 0.406, 0.3342, -0.1244, -0.1009),
            (1.0, -0.8662, -2.746, 2.339, 2.507, -2.095, -0.7602, 0.6211),
        ),
        PublishedFilter(
            "brake",
            BRAKE,
            (0.3529, 0.1878, -1.0274, -0.5381, 0.9959, 0.5128, -0.3215, -0.1625),
            (1.0, -0.5400, -2.88062, 1.5053, 2.7658, -1.3952, -0.8852, 0.4299),
        ),
    )
}
