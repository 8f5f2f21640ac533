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


def noisy(moved: Array, seed: int) -> Array:
    return simulated(PLANT, 1.0, moved) + 0.05 * np.random.default_rng(seed).standard_normal(N)


@pytest.mark.parametrize("value", [0.0, 655.35, -5.0])
@pytest.mark.parametrize("length", [3, 8, 12, 25])
@pytest.mark.parametrize(("moved", "first"), [(STEP, 250), (STEP, 60), (SQUARE, 250)], ids=["end", "rise", "square"])
def test_a_dropout_is_left_out_and_named(moved: Array, first: int, length: int, value: float) -> None:
    output = noisy(moved, length)
    output[first : first + length] = value
    fit = ft.identify(np.arange(N), moved, output)
    assert any(note.startswith(f"samples {first} to {first + length - 1}: a dropout of {length}") for note in fit.notes)
    for name, true in PLANT.numbers.items():
        # an interval holds the true value in some 95 of 100 recordings, twice its width in nearly all
        found = fit[name]
        assert 2.0 * found.min - found.nominal <= true <= 2.0 * found.max - found.nominal, name


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
