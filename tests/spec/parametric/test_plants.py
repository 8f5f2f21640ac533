"""`plant:` with `parameters:`: factors, ranges without a name, and what is refused of a whole plant."""

from __future__ import annotations

import json
from typing import Any

import jsonschema
import numpy as np
import pytest
from cases.parametric_plants import RANGES, document, family_of, ranges_of
from cases.plants import transfer_function

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.language import json_schema


def problems(plant: dict[str, Any]) -> list[str]:
    with pytest.raises(SpecError) as caught:
        parse_spec(document(plant))
    return [f"{each.path}: {each.message}" for each in caught.value.problems]


def test_factors_are_multiplied_out() -> None:
    factors = family_of(RANGES, [["k"], [2, 1]], [[1, "a"], [1, "b"]])
    expanded = family_of(RANGES, ["2 * k", "k"], [1, "a + b", "a * b"])
    assert (factors.numerator, factors.denominator) == (expanded.numerator, expanded.denominator)


def test_a_range_without_a_name_is_a_parameter_called_by_its_place() -> None:
    family = family_of({"k": (1.0, 2.0)}, ["k"], [1, {"min": 3, "max": 4}], dead_time_s={"min": 0.1, "max": 0.2})
    assert family.uncertain_names == ("k", "denominator[1]", "dead_time_s")
    assert family.member(np.array([1.0, 3.5, 0.15])).denominator == (1.0, 3.5)
    assert family.dead_time_axis == 2


def test_an_exact_parameter_is_a_number_of_the_expressions() -> None:
    plant = {"parameters": {"m": 4, "k": {"min": 1, "max": 2, "nominal": 1.25}}, "model": "transfer_function"}
    spec = parse_spec(document({**plant, "numerator": ["k / m"], "denominator": [1, "m"]}))
    assert spec.plant.uncertain_names == ("k",)
    assert spec.plant.member(spec.plant.nominal_point).numerator == (0.3125,)


def test_parameters_used_once_make_the_plants_of_plain_ranges() -> None:
    named = family_of({"k": (1.0, 2.0), "c": (3.0, 5.0)}, ["k"], [1, "c", 2])
    plain = transfer_function([(1.0, 2.0)], [1.0, (3.0, 5.0), 2.0])
    points = np.random.default_rng(2).uniform(named.low, named.high, (5, 2))
    for one, other in zip(named.coefficients(points), plain.coefficients(points[:, ::-1]), strict=True):
        assert np.array_equal(one, other)


def test_the_digest_of_a_plant_depends_on_its_expressions() -> None:
    def digest(denominator: list[Any]) -> str:
        plant = {"model": "transfer_function", "numerator": ["k"], "denominator": denominator}
        return digests_of(parse_spec(document({"parameters": ranges_of(RANGES), **plant})))["plant"]

    assert digest([[1, "a"], [1, "b"]]) == digest([1, "b + a", "(b) * a"])
    assert digest([1, "a + b", "a * b"]) != digest([1, "a + b", "a * b + 0.1"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"denominator": ["a - 2", 1, "b"]},
            "first coefficient is 0, or changes its sign, with a = 1, b = 20, k = 1",
        ),
        ({"denominator": ["a - a", 1, "b"]}, "the denominator's first coefficient is 0"),
        ({"numerator": ["0 * k"]}, "plant: the whole numerator is 0"),
        ({"numerator": ["k", "k", "k", "k"]}, "a plant must be proper"),
        ({"numerator": [["k"], 2]}, "plant.numerator[1]: '2' is written where a factor belongs; write [2]"),
        ({"numerator": "k"}, "is written where a list belongs"),
        ({"dead_time_s": "a - 2"}, "plant.dead_time_s: must be a number, a range or one parameter"),
        ({"dead_time_s": -1}, "plant.dead_time_s: must be at least 0"),
        ({"parameters": {}}, "plant.parameters: 0 parameters are written"),
        ({"parameters": None}, "plant.parameters: nothing is written here"),
        ({"model": "transfer_functoin"}, "did you mean 'transfer_function'?"),
    ],
)
def test_what_is_no_plant_is_refused(changes: dict[str, Any], message: str) -> None:
    plant: dict[str, Any] = {"parameters": ranges_of(RANGES), "model": "transfer_function", "numerator": ["k"]}
    found = problems({**plant, "denominator": [1, "a", "b"], **changes})
    assert any(message in each for each in found), found


def test_a_range_named_as_a_parameter_is_refused() -> None:
    late = {"min": 0, "max": 1}
    plant = {"parameters": {"dead_time_s": late}, "model": "transfer_function", "numerator": ["dead_time_s"]}
    found = problems({**plant, "denominator": [1, 1], "dead_time_s": late})
    assert any("is the name of a parameter" in each for each in found)


@pytest.mark.parametrize(
    "plant",
    [
        {"parameters": {"k": 1}, "model": "transfer_function", "numerator": ["k"], "denominator": [[1, "k"], [1, 2]]},
        {"parameters": {"T": {"min": 1, "max": 2}}, "model": "lag", "static_gain": "2*T", "time_constant_s": "T"},
        {"parameters": {"p": 2}, "model": "pole", "gain": 1, "pole_rad_s": "p", "dead_time_s": {"min": 0, "max": 1}},
        {"model": "zeros_poles", "gain": 1, "poles": [-1, {"damping": 0.1, "natural_frequency_rad_s": 3}]},
    ],
)
def test_the_schema_knows_plants_by_parameters(plant: dict[str, Any]) -> None:
    text = document(plant)
    parse_spec(text)
    validator = jsonschema.Draft202012Validator(json_schema())
    assert validator.is_valid(json.loads(text))
    assert not validator.is_valid(json.loads(document({**plant, "gian": 1})))


def test_the_order_of_the_parameters_in_a_file_changes_nothing() -> None:
    plant = {"model": "transfer_function", "numerator": ["k"], "denominator": [[1, "a"], [1, "b"]]}
    ranges = ranges_of(RANGES)
    one, other = (
        parse_spec(document({"parameters": dict(order), **plant}))
        for order in (ranges.items(), reversed(ranges.items()))
    )
    assert one.plant.uncertain_names == other.plant.uncertain_names == ("a", "b", "k")
    assert digests_of(one)["plant"] == digests_of(other)["plant"]


def test_drawn_plants_have_distributions_of_parameters_and_of_places() -> None:
    plant = {"parameters": ranges_of({"k": (1.0, 2.0)}), "model": "transfer_function", "numerator": ["k"]}
    plant["denominator"] = [[1, {"min": 1, "max": 2}], [1, 9]]
    noisy = {"normal": {"mean": 1.5, "std": 0.1}}
    drawn = {"k": noisy, "denominator[0][1]": noisy}
    text = document(plant, validation={"samples": 10, "distributions": drawn})
    found = parse_spec(text).validation
    assert found is not None
    assert set(found.distributions) == set(drawn)
    assert jsonschema.Draft202012Validator(json_schema()).is_valid(json.loads(text))
    with pytest.raises(SpecError, match="its uncertain numbers are k, denominator"):
        parse_spec(document(plant, validation={"distributions": {"denominator[1]": noisy}}))


def test_decimals_are_added_as_they_are_written() -> None:
    # in floating point the first factor is 5.6e-17, and the middle coefficient was taken for 1 + 5.5 a
    family = family_of({"a": (1.0, 2.0)}, [1], [1, "(0.1 + 0.2 - 0.3) * 1e17 * a - a / 10 + 1", 1])
    assert family.member(np.array([2.0])).denominator == (1.0, 0.8, 1.0)


@pytest.mark.parametrize("text", ["(a - 1.5)**32 + 0.1", "(a - 1.5)**24 + 1e-3"])
def test_differences_that_floating_point_loses_are_refused(text: str) -> None:
    plant = {"parameters": ranges_of({"a": (1.0, 2.0)}), "model": "transfer_function", "numerator": [1]}
    (only,) = problems({**plant, "denominator": [1, text, 1]}) or [""]
    assert "floating point loses it" in only


def test_differences_that_it_keeps_are_taken() -> None:
    family = family_of({"a": (1.0, 2.0)}, [1], [1, "(a - 1.5)**4 + 0.1", 1])
    assert family.member(np.array([2.0])).denominator[1] == pytest.approx(0.1625, rel=1e-12)
