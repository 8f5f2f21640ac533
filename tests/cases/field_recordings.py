"""Recordings of the kinds that people have, generated:  a known plant, an input of any shape, a sensor and a logger.

The plant is stepped on a grid twenty times as fine as the samples by SciPy's zero-order hold; dead times are whole
steps of that grid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

Array = NDArray[np.float64]
_FINER = 20


@dataclass(frozen=True)
class TruePlant:
    """N(s)/D(s) e^{-dead_time_s s}, and its numbers by their names in a spec."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dead_time_s: float
    model: str
    numbers: dict[str, float]


def lag(gain: float, tau: float, dead: float) -> TruePlant:
    numbers = {"static_gain": gain, "time_constant_s": tau, "dead_time_s": dead}
    return TruePlant((gain,), (tau, 1.0), dead, "lag", numbers)


def second_order(gain: float, square: float, linear: float, dead: float) -> TruePlant:
    numbers = {"numerator[0]": gain, "denominator[0]": square, "denominator[1]": linear, "dead_time_s": dead}
    return TruePlant((gain,), (square, linear, 1.0), dead, "second_order", numbers)


def integrator(gain: float, dead: float) -> TruePlant:
    return TruePlant((gain,), (1.0, 0.0), dead, "integrator", {"gain": gain, "dead_time_s": dead})


class _Stepper:
    """A plant on the fine grid, one sample of the input after another, from rest with the first input."""

    def __init__(self, plant: TruePlant, dt: float) -> None:
        held = cast("Any", cont2discrete((plant.numerator, plant.denominator), dt / _FINER, "zoh"))
        self._b, self._a = np.ravel(held[0]), np.asarray(held[1])
        self._waiting = [0.0] * round(plant.dead_time_s * _FINER / dt)
        self._state = np.zeros(len(self._a) - 1)
        self.output = 0.0

    def step(self, held: float) -> None:
        """Advance by one sample with this deviation of the input."""
        waiting = [*self._waiting, *[held] * _FINER]
        arriving, self._waiting = waiting[:_FINER], waiting[_FINER:]
        # the output belongs to the end of a fine step: one more input shifts it there
        found, self._state = lfilter(self._b, self._a, arriving, zi=self._state)
        del found
        self.output = float(self._state[0])


def simulated(plant: TruePlant, dt: float, moved: Array) -> Array:
    """The output at each sample, before the sample's input acts, of a plant at rest with the first input."""
    stepper, found = _Stepper(plant, dt), np.zeros(len(moved))
    for k in range(1, len(moved)):
        stepper.step(float(moved[k - 1] - moved[0]))
        found[k] = stepper.output
    at_rest = 0.0 if plant.denominator[-1] == 0 else plant.numerator[-1] / plant.denominator[-1] * moved[0]
    return found + at_rest


def closed_loop(
    plant: TruePlant, dt: float, reference: Array, noise: Array, kp: float, ki: float
) -> tuple[Array, Array]:
    """Input and measured output under a PI controller on the samples, which sees the noise."""
    stepper, sum_of_errors = _Stepper(plant, dt), 0.0
    moved, measured = np.zeros(len(reference)), np.zeros(len(reference))
    for k in range(len(reference)):
        measured[k] = stepper.output + noise[k]
        error = reference[k] - measured[k]
        sum_of_errors += ki * dt * error
        moved[k] = kp * error + sum_of_errors
        stepper.step(float(moved[k]))
    return moved, measured


def relay(plant: TruePlant, dt: float, n: int, at: float, noise: Array) -> tuple[Array, Array]:
    """Input 1 or 0 and measured output of a plant at rest with 0, from the line on at which a relay begins with 1."""
    stepper, held = _Stepper(plant, dt), 1.0
    moved, measured = np.zeros(n), np.zeros(n)
    for k in range(n):
        measured[k] = stepper.output + noise[k]
        held = 1.0 if measured[k] < 0.95 * at else 0.0 if measured[k] > 1.05 * at else held
        moved[k] = held
        stepper.step(held)
    return moved, measured


def levels(values: Sequence[float], samples: Sequence[int]) -> Array:
    """A piecewise constant input: each value for so many samples."""
    return np.concatenate([np.full(count, value) for value, count in zip(values, samples, strict=True)])


def chirp(n: int, dt: float, low_rad_s: float, high_rad_s: float) -> Array:
    """A sine whose frequency rises geometrically from the low one to the high one."""
    t, length, ratio = dt * np.arange(n), n * dt, np.log(high_rad_s / low_rad_s)
    return np.sin(low_rad_s * length / ratio * (np.exp(ratio * t / length) - 1.0))


# -- the logger's files ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FieldFile:
    """A file, the options of `fopi init` that a user would give, and the plant."""

    text: str
    options: tuple[str, ...]
    plant: TruePlant


def _lines(*columns: Array, formats: Sequence[str], separator: str = ",") -> str:
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return "".join(separator.join(f % x for f, x in zip(formats, row, strict=True)) + "\n" for row in rows)


def four_channels(seed: int) -> FieldFile:
    """A heater lab with two heaters and two sensors: units in the header, the first line twice, starts at ambient."""
    rng, plant = np.random.default_rng(seed), lag(0.68, 145.0, 19.0)
    moved = levels((0.0, 50.0), (20, 580))
    output = 21.0 + simulated(plant, 1.0, moved) + 0.05 * rng.standard_normal(600)
    other = 21.0 + 0.05 * rng.standard_normal(600)
    text = _lines(np.arange(600.0), moved, 0 * moved, output, other, formats=("%.1f", "%d", "%d", "%.2f", "%.2f"))
    head = "Time (sec),Heater 1 (%),Heater 2 (%),Temperature 1 (degC),Temperature 2 (degC)\n"
    text = head + text.partition("\n")[0] + "\n" + text
    return FieldFile(text, ("--input", "2", "--output", "Temperature 1"), plant)


def saved_by_numpy(seed: int) -> FieldFile:
    """`numpy.savetxt` with a header, which becomes comments; full precision."""
    rng, plant = np.random.default_rng(seed), lag(0.71, 105.0, 15.0)
    moved = levels((0.0, 100.0), (20, 500))
    output = 22.0 + simulated(plant, 1.0, moved) + 0.06 * rng.standard_normal(520)
    text = "# time heater temperature\n# logged by script, ambient 22 degC\n"
    return FieldFile(text + _lines(np.arange(520.0), moved, output, formats=("%.18e",) * 3), (), plant)


def square_wave_of_counts(seed: int) -> FieldFile:
    """Two columns of converter counts without times, 8 ms apart; every edge of the square wave settles."""
    rng, plant = np.random.default_rng(seed), lag(1.0, 0.05, 0.0124)
    moved = levels((1241.0, 2482.0) * 4, (50,) * 8)
    output = np.round(simulated(plant, 0.008, moved) + 11.0 * rng.standard_normal(400))
    return FieldFile(_lines(moved, output, formats=("%d", "%d")), ("--sample-time", "0.008"), plant)


def staircase_in_milliseconds(seed: int) -> FieldFile:
    """Semicolons, times in ms, names of a motor's signals, five plateaus."""
    rng, plant = np.random.default_rng(seed), lag(10.5, 0.18, 0.02)
    moved = levels((0.0, 60.0, 120.0, 180.0, 240.0), (50,) * 5)
    output = simulated(plant, 0.02, moved) + 4.0 * rng.standard_normal(250)
    text = _lines(20.0 * np.arange(250.0), moved, output, formats=("%d", "%d", "%.1f"), separator=";")
    return FieldFile("t_ms;pwm;rpm\n" + text, (), plant)


def spikes_and_a_cut_line(seed: int) -> FieldFile:
    """A speed with two overflows of a counter; the last line is cut where the logger stopped."""
    rng, plant = np.random.default_rng(seed), lag(1.26, 0.078, 0.0)
    moved = levels((0.0, 12.0), (20, 100))
    output = simulated(plant, 0.01, moved) + 0.05 * rng.standard_normal(120)
    output[[47, 81]] = 655.35
    text = _lines(0.01 * np.arange(120.0), moved, output, formats=("%.2f", "%d", "%.2f"))
    return FieldFile("tiempo,voltaje,velocidad\n" + text + "1.2,1", (), plant)


def not_at_rest(seed: int) -> FieldFile:
    """The plant still settles from a step at -1 s when the recorded one comes; no noise but four digits."""
    del seed
    plant = lag(1.0, 2.0, 0.0)
    moved = levels((0.0, 1.0, 2.0), (1, 5, 13))
    output = simulated(plant, 1.0, moved)[2:]
    return FieldFile(
        "time_s,input,output\n" + _lines(np.arange(17.0), moved[2:], output, formats=("%d", "%d", "%.4f")), (), plant
    )


def coarse_sensor(seed: int) -> FieldFile:
    """Steps up and down, none of them from rest but the first, read by a sensor with steps of 0.58."""
    rng, plant = np.random.default_rng(seed), lag(0.30, 125.0, 16.0)
    moved = levels((0.0, 100.0, 40.0, 150.0), (30, 220, 220, 230))
    output = 20.0 + simulated(plant, 1.0, moved) + 0.2 * rng.standard_normal(700)
    text = _lines(np.arange(700.0), moved, 0.58 * np.round(output / 0.58), formats=("%d", "%d", "%.4f"))
    return FieldFile("time_s,input,output\n" + text, (), plant)


#: name -> seed to file
FIELD_FILES: dict[str, Callable[[int], FieldFile]] = {
    kind.__name__: kind
    for kind in (
        four_channels,
        saved_by_numpy,
        square_wave_of_counts,
        staircase_in_milliseconds,
        spikes_and_a_cut_line,
        not_at_rest,
        coarse_sensor,
    )
}
