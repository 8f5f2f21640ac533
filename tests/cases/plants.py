"""The standard plants and families of the tests."""

from __future__ import annotations

from collections.abc import Sequence

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange, Objective, Requirement

#: a number that is known, a range (nominal: the midpoint), or (nominal, min, max)
Number = float | tuple[float, float] | tuple[float, float, float]

PUBLISHED_THROTTLE = FoPi(kp=0.09, ki=0.025, alpha=0.8)
PUBLISHED_BRAKE = FoPi(kp=0.07, ki=0.11, alpha=0.45)
#: the brake's own answer to specs/brake.yaml, to five digits
ROBUST_BRAKE = FoPi(kp=0.38512, ki=0.38776, alpha=0.82038)


def uncertain(number: Number) -> Uncertain:
    """A short way to write an `Uncertain`."""
    if not isinstance(number, tuple):
        return Uncertain.exactly(float(number))
    return Uncertain.between(*number) if len(number) == 2 else Uncertain(*number)


def lag(static_gain: Number = 1.0, time_constant_s: Number = 1.0, dead_time_s: Number = 0.0) -> PlantFamily:
    """static_gain e^{-Ls}/(time_constant_s s + 1)."""
    numbers = {"static_gain": static_gain, "time_constant_s": time_constant_s, "dead_time_s": dead_time_s}
    return PlantFamily("lag", {name: uncertain(number) for name, number in numbers.items()})


def pole(gain: Number, pole_rad_s: Number, dead_time_s: Number = 0.0) -> PlantFamily:
    """gain e^{-Ls}/(s + pole_rad_s)."""
    numbers = {"gain": gain, "pole_rad_s": pole_rad_s, "dead_time_s": dead_time_s}
    return PlantFamily("pole", {name: uncertain(number) for name, number in numbers.items()})


def transfer_function(
    numerator: Sequence[Number], denominator: Sequence[Number], dead_time_s: Number = 0.0
) -> PlantFamily:
    """Polynomials in descending powers of s."""
    numbers: dict[str, Number] = {f"numerator[{k}]": number for k, number in enumerate(numerator)}
    numbers |= {f"denominator[{k}]": number for k, number in enumerate(denominator)}
    numbers["dead_time_s"] = dead_time_s
    return PlantFamily("transfer_function", {name: uncertain(number) for name, number in numbers.items()})


def throttle() -> PlantFamily:
    """The car's throttle, km/h per full control."""
    return pole(4.39, 0.1746)


def brake(nominal_s: float = 2.25, dead_time_s: Number = 0.0) -> PlantFamily:
    """The car's brake with its uncertain time constant."""
    return lag(1.0, (nominal_s, 1.6, 3.1), dead_time_s)


def lag_gain_and_delay() -> PlantFamily:
    """Gain, time constant and dead time all uncertain."""
    return lag((1.0, 0.8, 1.2), (2.25, 1.6, 3.1), (0.3, 0.2, 0.4))


def spec_of(
    plant: PlantFamily, *requirements: Requirement, objective: Objective | None = None, name: str = "test"
) -> DesignSpec:
    """A spec with the usual box of gains."""
    controller = ControllerSpec(GainRange(0.0, 10.0), GainRange(0.0, 10.0), GainRange(0.3, 1.5))
    return DesignSpec(name, plant, controller, requirements, objective)
