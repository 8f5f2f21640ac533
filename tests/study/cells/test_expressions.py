"""Values of overrides that are computed from the cell's spec."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cases.study_files import mistakes, study
from hypothesis import given
from hypothesis import strategies as st

from fopi_tune.spec.yaml.nodes import ScalarNode
from fopi_tune.spec.yaml.problems import Mark
from fopi_tune.study.cells.expressions import with_values
from fopi_tune.study.overrides import Override, apply_override, node_from_json, plain_value, spec_from_text

LAG = """\
schema: 1
name: lag
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 3}, dead_time_s: 0.2}
controller: {alpha: 1.0}
requirements:
  - phase_margin_deg: {at_least: 60}
digital: {sample_time_s: 0.2}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def value_of(expression: str, **numbers: float) -> Any:
    """The value of an expression beside some numbers."""
    tree = node_from_json({**numbers, "x": 0})
    override = Override("x", Mark(1, 1), ScalarNode(Mark(1, 1), f"={expression}", plain=False))
    tree, _, problems = with_values(apply_override(tree, override), [override])
    return problems[0].message if problems else plain_value(tree)["x"]


_ATOMS = st.sampled_from(["a", "b", "2", "0.5", "3"])
_EXPRESSIONS = st.recursive(
    _ATOMS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/"]), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        inner.map(lambda t: f"-{t}"),
        inner.map(lambda t: f"{t}**2"),
    ),
    max_leaves=8,
)


@given(_EXPRESSIONS, st.integers(-5, 5), st.integers(1, 9))
def test_an_expression_has_the_value_that_python_gives_it(text: str, a: int, b: int) -> None:
    found = value_of(text, a=a, b=b)
    try:
        wanted = eval(text, {"a": a, "b": b})
    except ZeroDivisionError:
        assert found == "this divides by 0"
        return
    if isinstance(found, str):  # what floats give by rounding alone
        assert found == "this divides by 0" or "too small" in found
        return
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.1 + 0.2", "0.3"),
        ("3 * 0.1", "0.3"),
        ("1 / 3 * 3", "1"),
        ("2 ** -1", "0.5"),
        ("-2 ** 2", "-4"),
        ("2 ** 0.5", repr(2**0.5)),
        ("4 / 2", "2"),
        ("2 ** 3 ** 2", "512"),
        ("+a - -b", "8"),
        ("1e3 * a", "5000"),
    ],
)
def test_decimals_are_exact_and_whole_values_whole(text: str, value: str) -> None:
    assert repr(value_of(text, a=5, b=3)) == value


def test_values_are_those_of_the_cell_with_all_its_other_values(folder: Path) -> None:
    text = (
        "cells:\n- plant.dead_time_s: '= 0.5 * plant.time_constant_s.min'\n"
        "grid:\n  plant.time_constant_s.min: [1, 2]\n  digital.sample_time_s: ['= plant.dead_time_s / 10', 0.1]\n"
        "  plant.time_constant_s.max: '= 1.5 * plant.time_constant_s.min'\n"
    )
    cells = study(text).cells
    assert [tuple(cell.overrides.values()) for cell in cells] == [
        (0.5, 1, 0.05, 1.5), (0.5, 1, 0.1, 1.5), (1, 2, 0.1, 3), (1, 2, 0.1, 3),
    ]  # fmt: skip
    assert cells[2].key({}) == cells[3].key({}) != cells[0].key({})
    specs = [spec_from_text(cell.text) for cell in cells]
    assert [spec.plant.dead_time.nominal for spec in specs] == [0.5, 0.5, 1.0, 1.0]
    assert [spec.digital.sample_time_s for spec in specs if spec.digital] == [0.05, 0.1, 0.1, 0.1]
    assert cells[0].label.startswith("lag, plant.dead_time_s = 0.5, ")


def test_a_number_in_place_of_a_range_is_its_ends(folder: Path) -> None:
    cells = study("grid: {plant.static_gain: ['= 2 * plant.dead_time_s.max + plant.dead_time_s.nominal']}").cells
    assert cells[0].overrides == {"plant.static_gain": 0.6}


def test_parts_of_a_mapping_are_computed(folder: Path) -> None:
    text = "grid: {plant.static_gain: [{min: '= 1 - plant.dead_time_s', max: '= 2 * plant.static_gain.min'}]}"
    assert study(text).cells[0].overrides == {"plant.static_gain": {"min": 0.8, "max": 1.6}}


def test_a_check_is_computed_from_the_design_and_from_itself(folder: Path) -> None:
    text = (
        "grid:\n  plant.time_constant_s.max: [2, 4]\n"
        "  check.plant.time_constant_s.max: ['= 1.5 * plant.time_constant_s.max']\n"
        "  check.plant.time_constant_s.nominal: ['= check.plant.time_constant_s.max - 0.5']\n"
    )
    cells = study(text).cells
    assert [list(cell.overrides.values()) for cell in cells] == [[2, 3, 2.5], [4, 6, 5.5]]
    assert spec_from_text(cells[1].check).plant.parameters["time_constant_s"].max == 6.0


@pytest.mark.parametrize(
    ("expression", "column", "problem"),
    [
        ("2 * plant.dead_time.max", 35, "plant.dead_time is not in the spec; did you mean 'dead_time_s'?"),
        ("digital.poles", 31, "digital.poles is not in the spec; an expression knows what is written there, and no"),
        ("plant.model", 31, "plant.model is 'lag' in the spec, no number"),
        ("plant.time_constant_s", 31, "plant.time_constant_s is a mapping in the spec, no number"),
        ("requirements[1].x", 31, "requirements[1] is not in the spec; an expression knows"),
        ("1 / (plant.dead_time_s - 0.2)", 33, "this divides by 0"),
        ("0 ** -1", 33, "this divides by 0"),
        ("2 * plant.static_gain", 35, "the values need each other in a circle: plant.static_gain needs plant"),
        ("2 ^ 3", 33, "'^' is no sign of an expression; write **"),
        ("max(1)", 31, "'max' is no function; an expression has numbers, paths such as plant.time_constant_s.max"),
        ("__import__(1)", 31, "'__import__' is no function"),
        ("", 29, "nothing follows =; an expression has numbers"),
        ("2 *", 34, "a number or a path is missing at the end"),
        ("2 plant.dead_time_s", 33, "a sign is missing before 'plant.dead_time_s'; write * between factors"),
        ("10 ** 200", 29, "the value is too large to compute with; at most 1e+100 can be written in a spec"),
        ("10 ** -200", 29, "the value is too small to compute with"),
        ("10 ** 10 ** 10", 34, "the power is too large to compute with"),
        ("(0 - 2) ** 0.5", 39, "a power of -2 with an exponent that is not whole is no number"),
        ("check.plant.dead_time_s", 31, "check.plant.dead_time_s is of the check; a value of the design cannot depend"),
        ("x" * 500, 29, "the expression has 502 characters; write at most 400"),
    ],
)  # fmt: skip
def test_what_cannot_be_computed_is_told_with_its_place(
    folder: Path, expression: str, column: int, problem: str
) -> None:
    (found,) = mistakes(f"grid: {{plant.static_gain: ['= {expression}']}}")
    assert found.startswith(f"s.yaml:4:{column}: plant.static_gain: cell 1 (lag, plant.static_gain = ")
    assert problem in found


def test_values_that_need_each_other_are_refused(folder: Path) -> None:
    (found,) = mistakes(
        "grid: {plant.static_gain: ['= plant.dead_time_s'], plant.dead_time_s: ['= plant.static_gain']}"
    )
    assert "a circle: plant.static_gain needs plant.dead_time_s needs plant.static_gain; write a number in one" in found


def test_a_number_that_the_spec_refuses_is_told_at_its_expression(folder: Path) -> None:
    (found,) = mistakes("grid: {plant.time_constant_s.max: ['= 0.5 * plant.time_constant_s.min']}")
    assert found.startswith("s.yaml:4:8: plant.time_constant_s.max: cell 1")
    assert "min 1.0 is greater than max 0.5" in found


def test_every_expression_that_is_wrong_is_told_in_one_run_and_once(folder: Path) -> None:
    text = "grid: {plant.static_gain: ['= 1/0'], plant.dead_time_s: ['= plant.static_gain'], digital.poles: ['= (']}"
    found = mistakes(text)
    assert len(found) == 2
    assert "this divides by 0" in found[0]
    assert "digital.poles" in found[1]
