"""Messages about cells whose spec cannot be used."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases.study_files import LAG

from fopi_tune.errors import SpecError
from fopi_tune.study.load import load_study


def problems(folder: Path, text: str) -> list[tuple[int, int, str]]:
    (folder / "lag.yaml").write_text(LAG, encoding="utf-8")
    (folder / "s.yaml").write_text(f"schema: 1\nname: s\nspecs: [lag.yaml]\n{text}\n", encoding="utf-8")
    with pytest.raises(SpecError) as raised:
        load_study(folder / "s.yaml")
    return [(each.line, each.column, each.message) for each in raised.value.problems]


@pytest.mark.parametrize(
    ("text", "column", "value", "advice"),
    [
        ("draw: {validation.samples: {from: 10, to: 11}}\nsample: 1", 8, "",
         "drawn from a range; write whole numbers as a list, of which each is as likely: [10, 20, 50]"),
        ("draw: {validation.seed: {from: 10, to: 11}}\nsample: 1", 8, "", "drawn from a range; write whole numbers"),
        ("grid: {validation.samples: {from: 10, to: 11, steps: 3}}", 28, "10.5",
         "a step of a range; write steps with which every number is whole, or a list: [10, 20, 50]"),
        ('grid: {validation.samples: "= 100 / 8"}', 28, "12.5",
         "the value of '= 100 / 8'; write an expression whose value is whole in each cell, or whole numbers as a list"),
        ('grid: {validation: [{samples: "= 1/2"}]}', 31, "0.5", "the value of '= 1/2'; write an expression"),
    ],
)  # fmt: skip
def test_a_number_that_must_be_whole_says_its_cell_and_what_makes_it(
    tmp_path: Path, text: str, column: int, value: str, advice: str
) -> None:
    ((line, found, message),) = problems(tmp_path, f"{text}\nstages: [validate]")
    assert (line, found) == (4, column)
    cell = 2 if "steps" in text else 1
    assert message.startswith(f"cell {cell} (lag, validation")
    assert f"{value} is not a whole number, which is needed here; it is {advice}" in message


@pytest.mark.parametrize(
    ("value", "advice"),
    [("10.5", "write one, such as 10 or 11"), ("-1.2", "write one, such as -2 or -1")],
)
def test_a_number_that_is_written_and_not_whole_has_whole_ones_beside_it(
    tmp_path: Path, value: str, advice: str
) -> None:
    ((_, _, message),) = problems(tmp_path, f"grid: {{validation.samples: [20, {value}]}}\nstages: [validate]")
    assert message.endswith(f"{value} is not a whole number; {advice}")


def test_whole_steps_draws_from_a_list_and_whole_expressions_are_taken(tmp_path: Path) -> None:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    for axes in (
        "grid: {validation.samples: {from: 10, to: 12, steps: 3}}",
        "draw: {validation.samples: [10, 11, 12]}\nsample: 3",
        'grid: {validation.samples: ["= 100 / 5", "= 2 * 5.5"]}',
    ):
        (tmp_path / "s.yaml").write_text(
            f"schema: 1\nname: s\nspecs: [lag.yaml]\n{axes}\nstages: [validate]\n", encoding="utf-8"
        )
        found = [cell.overrides["validation.samples"] for cell in load_study(tmp_path / "s.yaml").cells]
        assert all(isinstance(each, int) for each in found), found


def test_a_list_of_one_has_one_entry(tmp_path: Path) -> None:
    ((_, _, message),) = problems(tmp_path, "grid: {'requirements[1].on': [nominal]}\nstages: [prove]")
    assert "requirements has 1 entry in the spec; they count from [0]" in message
