"""Which measurements are velocities:  the word after `measurement_unit:` -> how many of it are 1 m/s."""

from __future__ import annotations

#: the measure that only a velocity has
ACCELERATION = "acceleration_m_s2"
#: unit of a velocity -> how many of it are 1 m/s; a mile is 1609.344 m
PER_M_S = {"km/h": 3.6, "m/s": 1.0, "mph": 3600.0 / 1609.344}
#: other ways to write them
_MEANT = {"kmh": "km/h", "kph": "km/h", "km/hr": "km/h", "kmph": "km/h", "mps": "m/s", "m s-1": "m/s", "m s^-1": "m/s"}
_MEANT |= {"mi/h": "mph", "miles/h": "mph"}


def velocity_unit(measurement_unit: str) -> str | None:
    """The velocity's unit, a key of `PER_M_S`; None where the measurement is none, or does not say so."""
    unit = measurement_unit.strip().casefold()
    return unit if unit in PER_M_S else None


def acceleration_problem(measurement_unit: str) -> str:
    """Why there is no acceleration, and what to write instead."""
    unit = measurement_unit.strip()
    if meant := _MEANT.get(unit.casefold()):
        return f"{ACCELERATION} needs a measured velocity; under digital write measurement_unit: {meant}, not {unit}"
    if unit:
        return f"{ACCELERATION} needs a measured velocity, measurement_unit is {unit}; limit peak_rate_per_s instead"
    return (
        f"{ACCELERATION} needs a measured velocity; under digital add measurement_unit: km/h (or m/s, mph), or limit "
        "peak_rate_per_s instead"
    )
