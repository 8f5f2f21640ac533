"""Dropouts in recordings:  left out and named, whatever the sensor says meanwhile; pulses of the input are none."""

from __future__ import annotations

import numpy as np
import pytest
from cases.field_recordings import Array, lag, simulated

import fopi_tune as ft
from fopi_tune.identification.dropouts import without_dropouts
from fopi_tune.identification.recording import recording_from_arrays

N = 400
PLANT = lag(1.3, 12.0, 2.0)
STEP = np.where(np.arange(N) >= 40, 10.0, 0.0)
SQUARE = np.where((np.arange(N) // 80) % 2 == 1, 10.0, 0.0)
PLACES = {"end": (STEP, 250), "rise": (STEP, 60), "square": (SQUARE, 250)}
LENGTHS, SEEDS = (3, 8, 12, 25), 5
#: of 20 recordings an interval of 95 % misses 5 or more with a probability of 0.3 %
LEAST_HELD = 16


def noisy(moved: Array, seed: int) -> Array:
    return simulated(PLANT, 1.0, moved) + 0.05 * np.random.default_rng(seed).standard_normal(N)


@pytest.mark.parametrize("value", [0.0, 655.35, -5.0])
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize(("moved", "first"), PLACES.values(), ids=PLACES)
def test_a_dropout_is_left_out_and_named(moved: Array, first: int, length: int, value: float) -> None:
    output = noisy(moved, length)
    output[first : first + length] = value
    found = without_dropouts(recording_from_arrays(np.arange(N), moved, output))
    assert np.flatnonzero(~found.used).tolist() == list(range(first, first + length))
    assert found.notes[-1].startswith(f"samples {first} to {first + length - 1}: a dropout of {length}")


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("moved", "first"), PLACES.values(), ids=PLACES)
def test_the_intervals_hold_the_plant_whose_recording_has_a_dropout(moved: Array, first: int) -> None:
    counts = dict.fromkeys(PLANT.numbers, 0)
    for length in LENGTHS:
        for seed in range(SEEDS):
            output = noisy(moved, 100 * length + seed)
            output[first : first + length] = -5.0
            fit = ft.identify(np.arange(N), moved, output)
            assert any("a dropout of" in note for note in fit.notes)
            for name, true in PLANT.numbers.items():
                counts[name] += fit[name].min <= true <= fit[name].max
    assert min(counts.values()) >= LEAST_HELD, counts


@pytest.mark.parametrize("length", [6, 15, 40])
@pytest.mark.parametrize("tau", [0.3, 2.0, 12.0])
def test_a_pulse_of_the_input_is_no_dropout(tau: float, length: int) -> None:
    moved = np.zeros(N)
    moved[100 : 100 + length] = 10.0
    output = simulated(lag(1.3, tau, 5.0), 1.0, moved) + 0.01 * np.random.default_rng(1).standard_normal(N)
    recording = recording_from_arrays(np.arange(N), moved, output)
    assert without_dropouts(recording) is recording


def test_more_than_a_fifth_of_the_outputs_is_kept() -> None:
    output = noisy(STEP, 2)
    output[250:340] = -5.0
    recording = recording_from_arrays(np.arange(N), STEP, output)
    assert without_dropouts(recording) is recording
