"""Models whose numbers are expressions: the lag, the pole, and plants by zeros and poles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cases.parametric_plants import document, ranges_of

from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec


def family(plant: dict[str, Any]) -> PlantFamily:
    return parse_spec(document(plant)).plant


def test_a_lag_whose_gain_grows_with_its_time_constant() -> None:
    found = family(
        {"parameters": ranges_of({"T": (1.0, 2.0)}), "model": "lag", "static_gain": "3 * T", "time_constant_s": "T"}
    )
    plant = found.member(np.array([1.5]))
    assert (plant.numerator, plant.denominator) == ((4.5,), (1.5, 1.0))


def test_a_pole_by_a_time_constant() -> None:
    found = family({"parameters": ranges_of({"T": (1.0, 2.0)}), "model": "pole", "gain": 1, "pole_rad_s": "1 / T"})
    plant = found.member(np.array([2.0]))
    assert np.allclose(np.array([*plant.numerator, *plant.denominator]) / plant.denominator[0], [1.0, 1.0, 0.5])


def test_zeros_poles_and_pairs_make_the_transfer_function() -> None:
    plant = {
        "parameters": ranges_of({"zeta": (0.01, 0.2), "w": (9.0, 11.0)}),
        "model": "zeros_poles",
        "gain": 5,
        "zeros": [-3],
        "poles": [0, "-w/2", {"damping": "zeta", "natural_frequency_rad_s": "w"}],
        "dead_time_s": 0.1,
    }
    found = family(plant).member(np.array([10.0, 0.1]))
    wanted = np.polymul(np.poly([0.0, -5.0]), [1.0, 2.0, 100.0])
    assert found.numerator == (5.0, 15.0)
    assert np.allclose(found.denominator, wanted)
    assert found.dead_time_s == 0.1


def test_zeros_and_poles_have_ranges_of_their_own_without_parameters() -> None:
    found = family(
        {
            "model": "zeros_poles",
            "gain": {"min": 1, "max": 2},
            "poles": [{"min": -2, "max": -1}, {"damping": {"min": 0.1, "max": 0.2}, "natural_frequency_rad_s": 3}],
        }
    )
    assert found.uncertain_names == ("gain", "poles[0]", "poles[1].damping")
    assert np.allclose(found.member(np.array([1.5, -1.5, 0.15])).denominator, np.polymul([1.0, 1.5], [1.0, 0.9, 9.0]))


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        ({"model": "zeros_poles", "gain": 1, "zeros": [1, 2], "poles": [-1]}, "proper"),
        ({"model": "zeros_poles", "gain": 1, "poles": []}, "write a list of 1 to 31 entries"),
        ({"model": "zeros_poles", "gain": 1, "poles": [{"damping": 1}]}, "natural_frequency_rad_s: the key is missing"),
        ({"model": "zeros_poles", "gain": {"min": -1, "max": 1}, "poles": [1]}, "the whole numerator is 0"),
        ({"model": "zeros_poles", "gain": "k", "poles": [1]}, "'k' is no parameter of this plant; it has none"),
        (
            {
                "model": "zeros_poles",
                "gain": 1,
                "poles": [{"damping": 1, "natural_frequency_rad_s": {"min": -1, "max": 1}}],
            },
            "natural_frequency_rad_s: must be greater than 0",
        ),
        (
            {"parameters": {"T": {"min": -2, "max": -1}}, "model": "lag", "static_gain": 1, "time_constant_s": "T"},
            "time_constant_s: must be greater than 0",
        ),
    ],
)
def test_what_is_no_plant_is_refused(plant: dict[str, Any], words: str) -> None:
    with pytest.raises(SpecError) as caught:
        parse_spec(document(plant))
    assert words in str(caught.value)
