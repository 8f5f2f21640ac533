"""Plants of certificates: what is written is read again, and what is no family is refused."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from cases.parametric_plants import RANGES, family_of
from cases.plants import brake
from cases.random_fractional import published

from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.plant_entries import plant_entry, read_family, same_plants
from fopi_tune.proof.strict_json import JsonObject


def linked(denominator: Any = (1, "a/3 + b", "a * b")) -> PlantFamily:
    return family_of(RANGES, ["k / 3", "k"], list(denominator), dead_time_s="a")


def read(entry: Any) -> PlantFamily:
    return read_family(JsonObject(json.loads(json.dumps(entry)), "plant"))


@pytest.mark.parametrize("family", [linked(), brake(), published()], ids=["linked", "plain", "fractional"])
def test_a_family_is_read_as_it_was_written(family: PlantFamily) -> None:
    assert same_plants(read(plant_entry(family)), family)


def test_families_that_differ_in_a_coefficient_alone_are_not_the_same() -> None:
    assert not same_plants(linked(), linked((1, "a/3 + b", "a * b + 1e-9")))
    assert not same_plants(linked(), brake())
    assert same_plants(linked(), linked((1, "b + a/3", "b * a")))


def changed(path: tuple[str | int, ...], value: Any) -> Any:
    entry = copy.deepcopy(plant_entry(linked()))
    holder: Any = entry
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return entry


TERM = ("denominator", 1, "terms", 0)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("model",), "expression"),
        ((*TERM, "coefficient"), "0.5"),
        ((*TERM, "coefficient"), "1/0"),
        ((*TERM, "coefficient"), "9" * 3000),
        ((*TERM, "coefficient"), 1),
        ((*TERM, "powers"), [1, 0]),
        ((*TERM, "powers"), [1, 0, -1]),
        ((*TERM, "powers"), [1, 0, 0.5]),
        ((*TERM, "powers"), [1, 0, 99]),
        (("denominator", 1, "terms"), [{"coefficient": "1", "powers": [1, 0, 0]}] * 2),
        (("denominator", 0, "terms"), []),
        (("denominator", 0, "terms", 0), {"coefficient": "-1", "powers": [0, 0, 0], "more": 1}),
        (("numerator",), []),
        (("dead_time_s", "terms", 0, "coefficient"), "2"),
        (("parameters", 1, "name"), "a"),
        (("parameters", 0, "min"), -1.0),
    ],
    ids=str,
)
def test_what_is_no_family_is_refused(path: tuple[str | int, ...], value: Any) -> None:
    entry = changed(path, value)
    if path[:2] == ("denominator", 0) and path[-1] == 0:
        # another sign of the leading coefficient is another family, and one all the same
        assert not same_plants(read(entry), linked())
        return
    with pytest.raises((CertificateError, DomainError)):
        read(entry)


def test_a_leading_coefficient_that_may_vanish_is_refused() -> None:
    entry = changed(
        ("denominator", 0, "terms"),
        [{"coefficient": "1", "powers": [1, 0, 0]}, {"coefficient": "-2", "powers": [0, 0, 0]}],
    )
    with pytest.raises(CertificateError, match="is not one family"):
        read(entry)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("denominator_orders", [0.5]),
        ("denominator_orders", [0.5, 0.5]),
        ("denominator_orders", [-0.5, 0.0]),
        ("denominator_orders", "0.5"),
        ("numerator_orders", [1.0]),
        ("parameters", []),
    ],
)
def test_orders_that_are_those_of_no_fractional_family_are_refused(key: str, value: Any) -> None:
    with pytest.raises(CertificateError):
        read(plant_entry(published()) | {key: value})


def test_families_with_another_order_are_not_the_same() -> None:
    entry = plant_entry(published())
    assert not same_plants(read(entry | {"denominator_orders": [0.6, 0.0]}), published())
