"""Overrides and columns of specs with lists of plants."""

from __future__ import annotations

import json

import pytest
from cases.plant_lists import MISMATCH, MISMATCH_GAINS

import fopi_tune as ft
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.spec.yaml.composer import compose, decode
from fopi_tune.spec.yaml.problems import Mark, ProblemCollector
from fopi_tune.study.overrides import NoSuchPathError, Override, apply_override, canonical_text, node_from_json
from fopi_tune.study.overrides import spec_from_text as spec_of
from fopi_tune.study.table import value_at


def overridden(path: str, value: object) -> str:
    collector = ProblemCollector("s.yaml")
    tree = compose(decode(MISMATCH.encode(), collector), collector)
    return canonical_text(apply_override(tree, Override(path, Mark(1, 1), node_from_json(value))))


def test_a_path_leads_into_a_plant_of_a_list() -> None:
    plants = spec_of(overridden("plants[0].dead_time_s", 1.2)).plant
    assert isinstance(plants, PlantList)
    assert [member.family.dead_time.nominal for member in plants.members] == [1.2, 1.0, 0.7]
    assert [member.name for member in plants.members] == ["slow", "plant 2", "plant 3"]
    with pytest.raises(NoSuchPathError, match=r"plants has 3 entries in the spec; they count from \[0\]"):
        overridden("plants[3].dead_time_s", 1.2)


def test_a_column_can_be_the_member_of_a_worst_plant() -> None:
    document = json.loads(
        json.dumps(ft.prove(spec_of(overridden("plants[0].dead_time_s", 1.2)), MISMATCH_GAINS).to_dict())
    )
    assert value_at(document, "requirements[0].worst.member") == "slow"
