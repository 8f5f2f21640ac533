"""Cells that are drawn: which values they have, that a seed gives them again, and what is refused."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import numpy as np
import pytest
from cases.study_files import study
from scipy import stats

from fopi_tune.errors import SpecError
from fopi_tune.montecarlo.sampling import SamplingDesign, unit_cube_points
from fopi_tune.study.load import TooManyCellsError, study_json_schema

LAG = """\
schema: 1
name: lag
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 3}}
controller: {alpha: 1.0}
requirements:
  - phase_margin_deg: {at_least: 60}
digital: {sample_time_s: 0.2}
"""
DRAW = (
    "draw:\n  plant.time_constant_s.max: {from: 3, to: 5}\n  controller.kp: {from: 10, to: 0.1, scale: log}\n"
    "  digital.method: [oustaloup, fit, modified_oustaloup]\n"
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def keys(text: str) -> list[str]:
    return [cell.key({}) for cell in study(text).cells]


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_values_are_those_of_the_points_of_monte_carlo(method: str) -> None:
    cells = study(f"{DRAW}sample: {{count: 30, seed: 7, method: {method}}}\n").cells
    points = unit_cube_points(SamplingDesign(method), 7, 3, 0, 30)
    assert len(cells) == 30
    for cell, (a, b, c) in zip(cells, points, strict=True):
        values = cell.overrides
        assert values["plant.time_constant_s.max"] == pytest.approx(3.0 + 2.0 * a, rel=1e-14)
        assert values["controller.kp"] == pytest.approx(10.0 ** (1.0 - 2.0 * b), rel=1e-12)
        assert values["digital.method"] == ["oustaloup", "fit", "modified_oustaloup"][int(3 * c)]


def test_a_log_scale_is_uniform_in_the_logarithm_and_a_list_in_its_entries() -> None:
    cells = study(f"{DRAW}sample: {{count: 400, seed: 3, method: random}}\n").cells
    logs = [np.log10(float(str(cell.overrides["controller.kp"]))) for cell in cells]
    # a level at which a right distribution is refused once in a thousand seeds; this seed is fixed
    assert stats.kstest(logs, stats.uniform(-1.0, 2.0).cdf).pvalue > 1e-3
    counts = [sum(cell.overrides["digital.method"] == word for cell in cells) for word in ("oustaloup", "fit")]
    assert all(abs(count - 400 / 3) < 4 * np.sqrt(400 * 2 / 9) for count in counts)


def test_the_same_seed_gives_the_same_cells_and_a_larger_count_goes_on() -> None:
    one = keys(f"{DRAW}sample: 10\nseed: 5\n")
    assert keys(f"{DRAW}sample: {{count: 10, seed: 5, method: sobol}}\n") == one
    assert keys(f"{DRAW}sample: 25\nseed: 5\n")[:10] == one
    assert not set(keys(f"{DRAW}sample: 10\nseed: 6\n")) & set(one)
    # without a seed it is 1
    assert keys(f"{DRAW}sample: 10\n") == keys(f"{DRAW}sample: 10\nseed: 1\n")


def test_drawn_cells_are_crossed_with_the_grid_at_the_same_points() -> None:
    cells = study(f"{DRAW}sample: 4\ngrid: {{controller.alpha: [0.9, 1]}}\ncells: [{{}}, {{digital.poles: 7}}]\n").cells
    drawn = [tuple(cell.overrides[path] for path in ("plant.time_constant_s.max", "controller.kp")) for cell in cells]
    assert len(cells) == 16
    assert drawn[0] == drawn[1] == drawn[8]
    assert len(set(drawn)) == 4
    assert [cell.overrides["controller.alpha"] for cell in cells[:4]] == [0.9, 1, 0.9, 1]


def test_values_may_be_computed_from_drawn_ones() -> None:
    text = f"{DRAW}sample: 3\ngrid: {{plant.time_constant_s.min: '= plant.time_constant_s.max / 2'}}\n"
    for cell in study(text).cells:
        values = cell.overrides
        assert values["plant.time_constant_s.min"] == float(str(values["plant.time_constant_s.max"])) / 2


def test_drawn_cells_are_counted_before_they_are_made() -> None:
    with pytest.raises(TooManyCellsError, match="2000000 cells are more than 10000"):
        study(f"{DRAW}sample: 1000000\ngrid: {{controller.alpha: [0.9, 1]}}\n")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (DRAW, "s.yaml:5:3: draw: how many cells are to be drawn? add sample: 200"),
        ("sample: 200\n", "s.yaml:4:9: sample: there is nothing to draw; add draw: {plant.time_constant_s"),
        ("seed: 2\n", "s.yaml:4:7: seed: how many cells are to be drawn? add sample: 200"),
        (f"{DRAW}sample: {{count: 2, seed: 1}}\nseed: 2\n", "s.yaml:9:7: seed: sample has a seed already; keep one"),
        (f"{DRAW}sample: 0\n", "s.yaml:8:9: sample: 0 is out of range; it must be at least 1"),
        (f"{DRAW}sample: {{count: 5, method: halton}}\n", "sample.method: 'halton' is not known here; write sobol or"),
        (f"{DRAW}sample: {{seed: 5}}\n", "sample.count: the key is missing; add it"),
        ("draw: {controller.kp: {from: 1, to: 2, steps: 3}}\nsample: 2\n", "s.yaml:4:40: draw.controller.kp.steps: is "
         "for grid and zip; in draw a range has no steps: sample says how many cells are drawn"),
        ("draw: {controller.kp: {from: -1, to: 2, scale: log}}\nsample: 2\n", "a log scale has no way through 0"),
        ("draw: {controller.kp: 3}\nsample: 2\n", "'3' is written where a list of values belongs"),
        ("draw: {controller.kp: [3]}\nsample: 2\ngrid: {controller.kp: [1]}\n", "path has values on line 6 already"),
        ("draw: {controller.kp: [3]}\nsample: 2\ngrid: {controller: [{kp: 2}]}\n", "controller, which is put in later"),
        ("draw: {digital.poles: {from: 3, to: 9}}\nsample: 2\n", "s.yaml:4:8: digital.poles: cell 1 (lag, digital."),
    ],
)  # fmt: skip
def test_mistakes_have_a_place_and_advice(text: str, problem: str) -> None:
    with pytest.raises(SpecError) as caught:
        study(text)
    found = [str(each) for each in caught.value.problems]
    assert any(problem in each for each in found), found


def test_many_cells_that_are_refused_for_other_values_are_named_together() -> None:
    with pytest.raises(SpecError) as caught:
        study("draw: {plant.time_constant_s.max: {from: 0.1, to: 0.9}}\nsample: 40\n")
    found = [str(each) for each in caught.value.problems]
    assert len(found) == 13
    assert "min 1.0 is greater than max " in found[0]
    assert "and 16 more: refused with other values in the same way" in found[-1]


def test_the_schema_takes_both_forms() -> None:
    validator = jsonschema.Draft202012Validator(study_json_schema())
    document = {"schema": 1, "name": "s", "specs": ["a"], "draw": {"a.b": {"from": 1, "to": 2, "scale": "log"}}}
    assert validator.is_valid(document | {"sample": 200, "seed": 1})
    assert validator.is_valid(document | {"sample": {"count": 200, "method": "random"}})
    assert not validator.is_valid(document | {"sample": {"count": 200, "method": "halton"}})
    assert not validator.is_valid(document | {"draw": {"a.b": {"from": 1, "to": 2, "steps": 3}}})
