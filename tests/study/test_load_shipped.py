"""The studies that are shipped: every cell can be run, and a few of them say what the study is about."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from cases.markdown_pages import blocks_of
from cases.project import ROOT

from fopi_tune.study.load import load_study
from fopi_tune.study.model import Kind, Study
from fopi_tune.study.table import value_at
from fopi_tune.study.worker import run_cell

STUDIES = {path.stem: path for path in sorted((ROOT / "studies").glob("*.yaml"))}


def shipped(name: str) -> Study:
    return load_study(STUDIES[name])


def row_of(study: Study, **wanted: Any) -> dict[str, Any]:
    """The collected columns of the one cell whose overrides end and are as wanted."""
    for cell in study.cells:
        values = {path.replace(".", "_"): value for path, value in cell.overrides.items()}
        if all(values[key] == value for key, value in wanted.items()):
            result = run_cell("key", cell)
            assert not result.reason, result.reason
            document = json.loads(result.document)
            return {"outcome": document["outcome"], **{c.name: value_at(document, c.path) for c in study.collect}}
    raise AssertionError(f"{study.name} has no cell with {wanted}")


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_has_its_own_name_and_cells_that_can_be_run(name: str) -> None:
    study = shipped(name)
    assert study.name == name
    assert study.description
    # a few minutes on two cores: none is a batch of thousands
    assert 1 <= len(study.cells) <= 100
    assert len({cell.key({}) for cell in study.cells}) == len(study.cells)
    assert all(cell.text for cell in study.cells)


def test_a_design_keeps_what_it_was_made_for_and_not_what_it_was_not() -> None:
    study = shipped("brake_robustness")
    quick = tuple(dataclasses.replace(c, check=c.check.replace('"samples":2000', '"samples":200')) for c in study.cells)
    study = dataclasses.replace(study, cells=quick)
    wide, all_of_it = {"nominal": 2.25, "min": 1.6, "max": 3.1}, {"nominal": 2.25, "min": 0.8, "max": 6.0}
    own = row_of(study, plant_time_constant_s=wide, check_plant_time_constant_s=wide)
    beyond = row_of(study, plant_time_constant_s=wide, check_plant_time_constant_s=all_of_it)
    assert (own["outcome"], beyond["outcome"]) == ("met", "violated")
    assert own["margin_met"] == 200 > beyond["margin_met"]
    assert own["phase_margin_deg"] >= 80.0 > beyond["phase_margin_deg"]


def test_more_delay_than_the_requirements_bear_is_infeasible() -> None:
    row = row_of(shipped("sample_time"), digital_sample_time_s=2.0, digital_delay_samples=2)
    assert row["outcome"] == "infeasible"


def test_a_filter_fitted_on_the_circle_is_nearer_than_oustaloups_of_as_many_poles() -> None:
    study = shipped("filters")
    fit, oustaloup = (row_of(study, digital_method=method, digital_poles=7) for method in ("fit", "oustaloup"))
    assert fit["error"] < 0.1 * oustaloup["error"]
    # parallel sections of first order lose nothing in single precision, those of second order thousandfold
    assert fit["parallel_float32"] < 1e-5
    assert oustaloup["sections_float32"] > 100 * oustaloup["parallel_float32"]


def test_a_free_order_is_never_worse_than_a_plain_pi() -> None:
    study = shipped("fopi_vs_pi")
    wanted = {"plant_dead_time_s": 0.3, "objective": {"minimize": "phase_margin_spread_deg"}}
    fopi = row_of(study, controller_alpha={"min": 0.3, "max": 1.5}, **wanted)
    pi = row_of(study, controller_alpha=1, **wanted)
    assert fopi["value"] < pi["value"]
    assert pi["alpha"] == 1.0


def test_the_study_of_two_stages_on_the_page_of_studies_can_be_run(tmp_path: Path) -> None:
    root = ROOT
    page = (root / "docs" / "howto" / "batch_study.md").read_text(encoding="utf-8")
    (text,) = (block.text for block in blocks_of(page) if "check." in block.text and block.language == "yaml")
    (tmp_path / "studies").mkdir()
    (tmp_path / "specs").mkdir()
    (tmp_path / "specs" / "brake.yaml").write_bytes((root / "specs" / "brake.yaml").read_bytes())
    (tmp_path / "studies" / "s.yaml").write_text(text, encoding="utf-8")
    study = load_study(tmp_path / "studies" / "s.yaml")
    assert len(study.cells) == 3 * 2 * 2
    assert [column.name for column in study.collect] == ["tune.gains.kp", "prove.requirements[2].achieved"]


def test_held_memories_chatter_where_reset_ones_do_not() -> None:
    study = shipped("hysteresis")
    held, reset = (row_of(study, system_inactive=word, system_hysteresis=0.125) for word in ("held", "reset"))
    assert (held["outcome"], reset["outcome"]) == ("chattering", "violated")
    assert held["switches"] > 100 > 9 >= reset["switches"]
    assert (held["calm"], reset["calm"]) == (0, 500)


def test_only_the_paper_has_claims() -> None:
    for name in STUDIES:
        kinds = {cell.kind for cell in shipped(name).cells}
        assert kinds in ({Kind.SPEC}, {Kind.SYSTEM}) or name == "paper"


@pytest.mark.parametrize(
    "structures", [("pi", "pid"), pytest.param(("pi", "fopi", "pid", "fopid"), marks=pytest.mark.long)]
)
def test_more_of_a_structure_is_never_worse_on_a_plant_that_oscillates(structures: tuple[str, ...]) -> None:
    study = shipped("structures")
    errors, costs = {}, {}
    every = zip(("pi", "fopi", "pid", "fopid"), study.cells[-4:], strict=True)
    for cell in (cell for structure, cell in every if structure in structures):
        result = run_cell("key", cell)
        document = json.loads(result.document)
        assert document["outcome"] == "met", result.reason
        controller = cell.overrides["controller"]
        assert isinstance(controller, dict)
        errors[controller["structure"]] = value_at(document, "tune.objective")
        costs[controller["structure"]] = value_at(document, "discretize.cost_of_step.multiplications")
    assert tuple(errors) == structures
    assert errors["pid"] < errors["pi"]
    assert costs["pi"] < costs["pid"]
    if len(structures) == 4:
        # an order of the integral pays little, one of the derivative beside it a lot
        assert errors["fopid"] < 0.7 * errors["pid"] < 0.2 * errors["fopi"]
        assert 0.8 * errors["pi"] < errors["fopi"] < errors["pi"]
        assert costs["pid"] < costs["fopi"] < costs["fopid"]
