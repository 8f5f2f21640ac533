"""`plants:`: what it reads to, every mistake in it with line and column, and what it changes in digests."""

from __future__ import annotations

import jsonschema
import pytest
from cases.plant_lists import MISMATCH, mismatch, problems

from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import content_digest, digests_of
from fopi_tune.spec.language import json_schema

HEAD = "schema: 1\nname: a\n"
LAG = "{model: lag, static_gain: 1, time_constant_s: 2}"
REST = "objective: {minimize: iae_disturbance}\n"


def test_every_entry_is_a_plant_with_a_name_and_a_weight() -> None:
    plants = mismatch().plant
    assert isinstance(plants, PlantList)
    assert [(each.name, each.weight, each.family.model) for each in plants.members] == [
        ("slow", 1.0, "transfer_function"), ("plant 2", 1.0, "lag"), ("plant 3", 2.0, "lag"),
    ]  # fmt: skip
    assert [each.family.dead_time.nominal for each in plants.members] == [1.4, 1.0, 0.7]


def test_entries_read_to_what_plant_reads_to() -> None:
    for plant in (
        LAG,
        "{model: zeros_poles, gain: 2, poles: [-1, {damping: 0.2, natural_frequency_rad_s: 5}]}",
        "{parameters: {a: {min: 1, max: 2}}, model: transfer_function, numerator: [a], denominator: [1, a]}",
    ):
        alone = parse_spec(f"{HEAD}plant: {plant}\n{REST}").plant
        listed = parse_spec(f"{HEAD}plants: [{plant}]\n{REST}").plant
        assert isinstance(listed, PlantList)
        assert [each.family for each in listed.members] == [alone]


def test_all_mistakes_of_a_list_are_reported_at_once_with_their_places() -> None:
    text = """schema: 1
name: a
plants:
  - {name: one, model: lag, static_gain: 0, time_constant_s: 2}
  - {name: one, model: lag, static_gain: 1, time_constant_s: 2, wieght: 3}
  - {model: lag, static_gain: 1, time_constant_s: 2, weight: 0}
  - {name: " x", model: pole, gain: 1}
  - {name: two, model: lag, static_gain: 1, time_constant_s: 2}
  - {name: two, model: lag, static_gain: 1, time_constant_s: 2}
requirements:
  - phase_margin_deg: {equals: 60}
validation: {distributions: {static_gain: uniform}}
"""
    assert problems(text) == [
        "s.yaml:4:42: plants[0].static_gain: must not be or contain 0; the family's sign must be known",
        "s.yaml:5:65: plants[1].wieght: the key is not known here; did you mean 'weight'?",
        "s.yaml:6:62: plants[2].weight: 0 is out of range; it must be greater than 0",
        "s.yaml:7:5: plants[3].pole_rad_s: the key is missing; add it",
        "s.yaml:7:12: plants[3].name: ' x' cannot be used; write 1 to 40 letters, digits, spaces, '.', '_' or '-', the "
        "first a letter or digit, no space at the end",
        "s.yaml:9:12: plants[5].name: 'two' is the name of the plant on line 8 too; give this one another",
        "s.yaml:12:29: validation.distributions: is for one plant: in this version, not for a list; remove it: each is "
        "drawn uniformly over its ranges, the plants as often as `weight:` says",
    ]


def test_a_name_may_not_be_that_of_an_entry_without_one() -> None:
    text = f"{HEAD}plants: [{LAG}, {{name: plant 1, {LAG[1:]}]\n{REST}"
    assert [said.split(": ", 1)[1] for said in problems(text)] == [
        "plants[1].name: 'plant 1' is the name of the plant on line 3 too; give this one another"
    ]


def test_both_words_together_are_one_mistake() -> None:
    text = f"{HEAD}plant: {LAG}\nplants: [{LAG}]\n{REST}"
    assert problems(text) == [
        "s.yaml:4:1: plants: plant is written on line 3; write plant for one family or plants for a list of them, "
        "not both"
    ]


@pytest.mark.parametrize(
    ("plants", "said"),
    [
        (f"plants: {LAG}\n", "s.yaml:3:9: plants: a mapping is written where a list belongs; write a list of 1 to 8 "
         "entries, each after '- '"),
        (f"plant: [{LAG}]\n", "s.yaml:3:8: plant: a list is written where one plant belongs; write plants: in place of "
         "plant: for a list of plants"),
        ("plants: []\n", "s.yaml:3:9: plants: the list has 0 entries; write a list of 1 to 8 entries"),
        (f"plants: [{', '.join([LAG] * 9)}]\n", "s.yaml:3:9: plants: the list has 9 entries; write a list of 1 to 8 "
         "entries"),
        ("", "s.yaml:1:1: plant: the key is missing; add it"),
        (f"palnts: [{LAG}]\n", "s.yaml:3:1: palnts: the key is not known here; did you mean 'plants'?"),
    ],
)  # fmt: skip
def test_what_is_no_list_of_plants_is_told(plants: str, said: str) -> None:
    assert problems(HEAD + plants + REST) == [said]


def test_not_every_plant_of_a_list_can_have_the_same_value() -> None:
    equal = "requirements: [{phase_margin_deg: {equals: 60}}]\n"
    (said,) = problems(f"{HEAD}plants: [{LAG}, {LAG}]\n{equal}")
    assert said.endswith("not every plant of a list can have the same value; write between, or on: nominal")
    assert parse_spec(f"{HEAD}plants: [{LAG}]\n{equal}").requirements


def test_gains_are_not_yet_designed_for_scenarios_over_a_list() -> None:
    more = "digital: {sample_time_s: 0.1}\nscenarios: [{name: step, duration_s: 9, reference: [{at_s: 0, value: 1}]}]\n"
    asked = "requirements: [{overshoot: {at_most: 0.2}, scenario: step}]\n"
    (said,) = problems(f"{HEAD}plants: [{LAG}]\n{asked}{more}")
    assert "s.yaml:3:9: plants: gains are designed for requirements" in said
    assert "limits:" in said
    judged = f"{HEAD}plants: [{LAG}]\n{REST}{more}limits: [{{overshoot: {{at_most: 0.2}}}}]\n"
    assert parse_spec(judged).limits


def test_the_schema_takes_one_of_the_two_words() -> None:
    validator = jsonschema.Draft202012Validator(json_schema())
    plant = {"model": "lag", "static_gain": 1.0, "time_constant_s": 2.0}
    base = {"schema": 1, "name": "a", "objective": {"minimize": "iae_disturbance"}}
    good = [{**plant, "name": "car", "weight": 2}, {"model": "pole", "gain": 1, "pole_rad_s": 0}]
    assert validator.is_valid({**base, "plants": good})
    assert validator.is_valid({**base, "plant": plant})
    for wrong in (
        {}, {"plant": plant, "plants": good}, {"plants": []}, {"plants": plant}, {"plants": [{**plant, "weight": 0}]},
        {"plants": [{**plant, "name": " a"}]}, {"plants": good * 5}, {"plant": good[0]},
    ):  # fmt: skip
        assert not validator.is_valid({**base, **wrong}), wrong


def test_a_plant_alone_keeps_its_digest() -> None:
    spec = parse_spec(f"{HEAD}plant: {LAG}\n{REST}")
    # what the digest of this plant is without lists
    assert digests_of(spec)["plant"] == "b7153cfed7305d876a39d201b307df57f4a89b01e6c119fa0b42549804bbf846"


def test_names_and_numbers_of_a_list_are_in_its_digest_and_weights_are_not() -> None:
    spec = mismatch()
    renamed = mismatch(MISMATCH.replace("slow", "late"))
    weighed = mismatch(MISMATCH.replace("weight: 2", "weight: 3"))
    assert digests_of(renamed)["plant"] != digests_of(spec)["plant"]
    assert digests_of(weighed) == digests_of(spec)
    assert content_digest(weighed) != content_digest(spec)
