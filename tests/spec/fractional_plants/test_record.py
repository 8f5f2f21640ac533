"""`model: fractional` in a spec: what it reads to, its mistakes with their places, and its schema."""

from __future__ import annotations

import json

import jsonschema
import pytest

from fopi_tune.core.fractional_plants.family import FractionalFamily
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.language import json_schema

HEAD = "schema: 1\nname: a\nobjective: {maximize: ki}\nplant:\n  model: fractional\n"
TOP = "  numerator: [{coefficient: {min: 60, max: 70}, order: 0}]\n"
BOTTOM = "  denominator: [{coefficient: 1, order: 0}, {coefficient: 12.72, order: 0.5}]\n"


def problems(text: str) -> list[str]:
    with pytest.raises(SpecError) as refused:
        parse_spec(text, "s.yaml")
    return [line for line in str(refused.value).splitlines() if line.startswith("s.yaml")]


def test_terms_are_read_in_any_order() -> None:
    plant = parse_spec(HEAD + TOP + BOTTOM + "  dead_time_s: 1.93\n").plant
    assert isinstance(plant, FractionalFamily)
    assert plant.numerator_orders == (0.0,)
    assert plant.denominator_orders == (0.0, 0.5)
    assert plant.parameters == {
        "numerator[0].coefficient": Uncertain.between(60.0, 70.0),
        "denominator[0].coefficient": Uncertain.exactly(1.0),
        "denominator[1].coefficient": Uncertain.exactly(12.72),
        "dead_time_s": Uncertain.exactly(1.93),
    }


def test_another_order_is_another_plant() -> None:
    one, other = (parse_spec(HEAD + TOP + BOTTOM.replace("0.5", order)) for order in ("0.5", "0.6"))
    assert digests_of(one)["plant"] != digests_of(other)["plant"]
    assert digests_of(one)["requirements"] == digests_of(other)["requirements"]


def test_every_mistake_is_told_with_its_place() -> None:
    text = HEAD + (
        "  numerator: [{coefficient: {min: -1, max: 1}, order: 1.5}]\n"
        "  denominator:\n"
        "    - {coefficient: 12.72, order: 0.5}\n"
        "    - {coefficient: 3, order: 0.5}\n"
        "    - {coefficient: {min: -1, max: 1}, order: 1}\n"
        "  dead_time_s: -1\n"
    )
    assert problems(text) == [
        "s.yaml:6:14: plant.numerator: every term of numerator and denominator has the factor s^0.5; leave it out of "
        "all of them",
        "s.yaml:6:14: plant.numerator: can be 0 altogether, and no plant is left; keep one coefficient away from 0",
        "s.yaml:6:55: plant.numerator[0].order: order 1.5 exceeds the denominator's highest, 1; a plant must be proper",
        "s.yaml:9:31: plant.denominator[1].order: order 0.5 is that of the term on line 8; write one term for the two",
        "s.yaml:10:21: plant.denominator[2].coefficient: must not be or contain 0: it is that of the highest order; "
        "the family's sign must be known",
        "s.yaml:11:16: plant.dead_time_s: must be at least 0; a plant cannot answer before it is asked",
    ]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("order: 0.5", "order: -0.5", "denominator[1].order: -0.5 is out of range; it must be at least"),
        ("order: 0.5", "order: {min: 0.4, max: 0.6}", "denominator[1].order: a mapping"),
        ("order: 0.5", "order: 9", "denominator[1].order: 9 is out of range"),
        (", order: 0.5", "", "denominator[1].order: the key is missing"),
        ("order: 0.5", "order: 0.0001", "is within 0.001 of that of the term on line"),
        ("model: fractional", "parameters: {k: 1}\n  model: fractional", "are numbers or ranges of their own"),
        ("order: 0.5", "oder: 0.5", "oder"),
    ],
)
def test_a_mistake_is_named(old: str, new: str, expected: str) -> None:
    text = (HEAD + TOP + BOTTOM).replace(old, new)
    assert any(expected in line for line in problems(text))


@pytest.mark.parametrize(
    ("section", "place", "expected"),
    [
        (
            "digital: {sample_time_s: 0.1, design: sampled}\n",
            "digital.design",
            "the loop on samples of a fractional plant is not available",
        ),
        (
            "digital: {sample_time_s: 0.1}\nscenarios: [{name: s, duration_s: 9, reference: [{at_s: 0, value: 1}]}]\n",
            "scenarios",
            "a scenario of a fractional plant is not available",
        ),
        (
            "digital: {sample_time_s: 0.1}\nvalidation: {samples: 10}\n",
            "validation",
            "Monte Carlo of a fractional plant is not available",
        ),
    ],
)
def test_what_runs_on_samples_is_refused_where_it_is_asked_for(section: str, place: str, expected: str) -> None:
    text = HEAD + TOP + BOTTOM + section
    assert any(f": {place}: " in line and expected in line for line in problems(text))
    # whole orders are a transfer function, of which all this is known
    parse_spec(text.replace("0.5", "1"))


def test_a_fractional_plant_in_a_list_is_refused() -> None:
    one = "{model: fractional, numerator: [{coefficient: 1, order: 0}], denominator: [{coefficient: 1, order: 0.5}]}"
    lag = "{model: lag, static_gain: 1, time_constant_s: 2}"
    found = problems(f"schema: 1\nname: a\nobjective: {{maximize: ki}}\nplants:\n  - {lag}\n  - {one}\n")
    assert found == [
        "s.yaml:6:13: plants[1].model: fractional plants in a list of plants are not available in this version: they "
        "have no common polynomials with the other plants; write plant: with one of them"
    ]


def test_the_schema_knows_the_model() -> None:
    validator = jsonschema.Draft202012Validator(json_schema())

    def valid(terms: list[dict[str, object]]) -> bool:
        plant = {"model": "fractional", "numerator": [{"coefficient": 2, "order": 0}], "denominator": terms}
        document = {"schema": 1, "name": "a", "objective": {"maximize": "ki"}, "plant": plant}
        parsed = True
        try:
            parse_spec(json.dumps(document))
        except SpecError:
            parsed = False
        assert validator.is_valid(document) == parsed
        return parsed

    assert valid([{"coefficient": {"min": 1, "max": 2}, "order": 0.5}, {"coefficient": 1, "order": 0}])
    assert not valid([{"coefficient": 1}])
    assert not valid([{"coefficient": 1, "order": "0.5"}])
    assert not valid([])
    assert not valid([{"coefficient": 1, "order": 0.5 + k} for k in range(10)])
