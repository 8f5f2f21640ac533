"""The words after `limits:`:  what a simulation is judged by, and which outputs are velocities."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasureKind:
    """A number that a simulation is judged by.

    Args:
        name: the word in the spec, unit included where it has one of its own.
        unit: of the number.
        meaning: one sentence.
    """

    name: str
    unit: str
    meaning: str


#: the words after `limits:`
MEASURES: dict[str, MeasureKind] = {
    kind.name: kind
    for kind in (
        MeasureKind("acceleration_m_s2", "m/s^2", "peak_rate_per_s of a velocity: measurement_unit km/h, m/s or mph"),
        MeasureKind("peak_rate_per_s", "output unit per s", "largest |dy/dt| just before and after the samples"),
        MeasureKind("peak_jerk_per_s2", "output unit per s^2", "largest second difference of the samples over Ts^2"),
        MeasureKind(
            "overshoot", "output unit", "how far the output goes beyond a step's setpoint in its direction; the worst"
        ),
        MeasureKind(
            "undershoot", "output unit", "how far the output goes back beyond its value before a step; the worst"
        ),
        MeasureKind("settling_time_s", "s", "from a step until the output stays within the settling band; the worst"),
        MeasureKind(
            "rise_time_s", "s", "from a tenth to nine tenths of a step, interpolated between the samples; the worst"
        ),
        MeasureKind("iae", "output unit times s", "Ts times the sum of |r - y|"),
        MeasureKind("ise", "output unit squared times s", "Ts times the sum of (r - y)^2"),
        MeasureKind("saturation_time_s", "s", "time with the control at a limit"),
        MeasureKind("peak_control", "control unit", "largest |u|"),
        MeasureKind("final_error", "output unit", "|r - y| at the last sample before the next step, or the end"),
        MeasureKind("switch_count", "1", "jumps between the modes of a system, over the whole scenario"),
    )
}

#: of these, the ones that gains are designed for; counts of samples do not change with the gains but in jumps
DESIGNED_MEASURES = tuple(name for name in MEASURES if name not in ("saturation_time_s", "switch_count"))
#: of these, the ones that are never negative; the output may end short of a setpoint, a negative overshoot
NEVER_NEGATIVE = tuple(name for name in DESIGNED_MEASURES if name != "overshoot")
#: the measure that only a loop on samples has: where an input jumps, dy/dt jumps too, and its slope has no bound
JERK = "peak_jerk_per_s2"
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
