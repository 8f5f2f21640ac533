"""Plants as objects: their ranges, and what is no number of theirs."""

from __future__ import annotations

import numpy as np
import pytest

import fopi_tune as ft


def test_numbers_become_ranges_about_their_nominal_value() -> None:
    lag = ft.Lag(1.0, 2.25, 0.1).uncertain(time_constant_s=(1.6, 3.1), dead_time_s=(0.05, 0.12, 0.2))
    assert lag.time_constant_s == ft.Uncertain(2.25, 1.6, 3.1)
    assert lag.dead_time_s == ft.Uncertain(0.12, 0.05, 0.2)
    assert lag.as_mapping()["model"] == "lag"
    again = lag.uncertain(time_constant_s=(2.0, 2.5))
    assert again.time_constant_s == ft.Uncertain(2.25, 2.0, 2.5)


def test_coefficients_are_named_as_in_results() -> None:
    plant = ft.TransferFunction([1.0], [1.0, 1.4, 1.0]).uncertain({"denominator[1]": (0.6, 2.0)})
    spec = ft.spec(plant=plant, controller=ft.FoPi(0.2, 0.1, 1.0), requirements=[ft.phase_margin_deg >= 30])
    assert spec.plant.uncertain_names == ("denominator[1]",)
    assert spec.plant.low.tolist() == [0.6]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("tau", "'tau' is no number of a Lag; it has dead_time_s, static_gain, time_constant_s"),
        ("static_gain[0]", "is no number of this Lag"),
        ("static gain", "is no number of a Lag"),
    ],
)
def test_a_number_that_a_plant_has_not_is_refused(name: str, words: str) -> None:
    with pytest.raises(ft.DomainError) as caught:
        ft.Lag(1.0, 2.0).uncertain({name: (0.0, 1.0)})
    assert words in str(caught.value)


def test_ranges_enclose_the_nominal_value() -> None:
    with pytest.raises(ft.DomainError, match=r"does not enclose the nominal value 2\.0"):
        ft.Lag(1.0, 2.0).uncertain(time_constant_s=(2.5, 3.0))
    with pytest.raises(ft.DomainError, match=r"name one of its numbers, such as numerator\[0\]"):
        ft.TransferFunction([1.0], [1.0, 1.0]).uncertain(numerator=(0.0, 1.0))
    with pytest.raises(ft.DomainError, match="is no number of this TransferFunction"):
        ft.TransferFunction([1.0], [1.0, 1.0]).uncertain({"numerator[3]": (0.0, 1.0)})


def test_whole_coefficients_of_numpy_become_ranges() -> None:
    plant = ft.TransferFunction(np.array([1]), np.array([1, 2])).uncertain({"denominator[1]": (1, 3)})
    assert tuple(plant.denominator) == (1, ft.Uncertain(2.0, 1.0, 3.0))


def test_ends_that_are_no_range_are_refused() -> None:
    with pytest.raises(ft.DomainError, match="time_constant_s = 3 is not a list of numbers"):
        ft.Lag(1.0, 2.0).uncertain(time_constant_s=3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ft.DomainError, match="time_constant_s has 1 end"):
        ft.Lag(1.0, 2.0).uncertain(time_constant_s=(3,))  # pyright: ignore[reportArgumentType]
