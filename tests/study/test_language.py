"""Study files: what they say, what is wrong with them, and the cells they make."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from cases.project import ROOT
from cases.study_files import mistakes, study
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.fractional_plants.family import FractionalFamily
from fopi_tune.errors import SpecError
from fopi_tune.spec import load_document, load_spec, parse_spec
from fopi_tune.study.load import TooManyCellsError, load_study, study_json_schema
from fopi_tune.study.model import Kind, Stage
from fopi_tune.study.overrides import (
    canonical_text,
    format_path,
    node_from_json,
    parse_path,
    plain_value,
    spec_from_text,
)

SPECS = sorted((ROOT / "specs").glob("*.yaml"))
STUDIES = sorted((ROOT / "studies").glob("*.yaml"))
SCHEMA = study_json_schema()
LAG = """\
schema: 1
name: lag
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 3}}
controller: {alpha: 1.0}
requirements:
  - phase_margin_deg: {at_least: 60}
  - {sensitivity_db: {at_most: -20}, to_rad_s: 0.02}
digital: {sample_time_s: 0.2}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("path", SPECS, ids=lambda p: p.stem)
def test_a_spec_survives_its_canonical_text(path: Path) -> None:
    place, _ = load_document(path)
    text = canonical_text(place.node)
    # the canonical text is YAML, and reading it as JSON gives the same spec
    assert spec_from_text(text) == parse_spec(text)
    assert canonical_text(node_from_json(json.loads(text))) == text
    loaded, again = load_spec(path), spec_from_text(text)
    assert again.plant == loaded.plant
    assert again.controller == loaded.controller
    assert again.digital == loaded.digital
    assert [(r.quantity, r.limits) for r in again.requirements] == [(r.quantity, r.limits) for r in loaded.requirements]


def test_the_canonical_text_does_not_depend_on_how_numbers_and_keys_are_written(folder: Path) -> None:
    other = LAG.replace("{min: 1, max: 3}", "{max: 3.0e+0, min: 1.}").replace("name: lag", "description: x\nname: lag")
    Path("other.yaml").write_text(other.replace("max: 3.0e+0, min: 1.", "max: 3, min: 1"), encoding="utf-8")
    one, same = (canonical_text(load_document(p)[0].node) for p in ("lag.yaml", "other.yaml"))
    assert one == same


@pytest.mark.parametrize("path", ["plant.time_constant_s.max", "requirements[2].on", "a[0][12].b", "name"])
def test_a_path_can_be_written_and_read(path: str) -> None:
    steps = parse_path(path)
    assert steps is not None
    assert format_path(steps) == path


@pytest.mark.parametrize("path", ["", ".", "a..b", "a.[0]", "[0]", "a[-1]", "a b", "a.", "a[0"])
def test_what_is_no_path_is_none(path: str) -> None:
    assert parse_path(path) is None


def test_a_grid_is_crossed_and_its_last_path_changes_fastest(folder: Path) -> None:
    grid = "grid: {plant.time_constant_s.max: [2, 3, 4], 'requirements[0].phase_margin_deg.at_least': [50, 60]}"
    cells = study(grid).cells
    wanted = list(itertools.product([2, 3, 4], [50, 60]))
    assert [tuple(cell.overrides.values()) for cell in cells] == wanted
    specs = [spec_from_text(cell.text) for cell in cells]
    assert [(s.plant.parameters["time_constant_s"].max, s.requirements[0].limits[0]) for s in specs] == wanted
    assert [cell.index for cell in cells] == list(range(6))


def test_coefficients_and_orders_of_a_fractional_plant_are_overridden_by_their_paths(folder: Path) -> None:
    terms = "[{coefficient: 3, order: 0.5}, {coefficient: {min: 1, max: 2}, order: 0}]"
    plant = f"{{model: fractional, numerator: [{{coefficient: 1, order: 0}}], denominator: {terms}}}"
    text = f"schema: 1\nname: a\nplant: {plant}\nobjective: {{maximize: ki}}\n"
    Path("lag.yaml").write_text(text, encoding="utf-8")
    grid = "{'plant.denominator[1].coefficient.max': [4, 5], 'plant.denominator[0].order': [0.5, 0.7]}"
    specs = [spec_from_text(cell.text) for cell in study(f"grid: {grid}").cells]
    families = [spec.plant for spec in specs if isinstance(spec.plant, FractionalFamily)]
    assert [each.parameters["denominator[1].coefficient"].max for each in families] == [4, 4, 5, 5]
    assert [each.denominator_orders for each in families] == [(0.5, 0.0), (0.7, 0.0)] * 2


def test_ranges_and_expressions_of_named_parameters_are_overridden_by_their_paths(folder: Path) -> None:
    plant = "{parameters: {k: {min: 1, max: 2}, T: 3}, model: transfer_function, numerator: [k], denominator: [T, 1]}"
    Path("lag.yaml").write_text(LAG.replace(LAG.splitlines()[2], f"plant: {plant}"), encoding="utf-8")
    cells = study("grid: {plant.parameters.k.max: [3, 4], 'plant.denominator[1]': [1, k * T]}").cells
    specs = [spec_from_text(cell.text) for cell in cells]
    assert [spec.plant.parameters["k"].max for spec in specs] == [3, 3, 4, 4]
    assert [spec.plant.member(np.array([1.5])).denominator for spec in specs] == [(3, 1), (3, 4.5)] * 2
    assert "'kk' is no parameter of this plant; it has T, k" in mistakes("grid: {'plant.numerator[0]': [k + kk]}")[0]


def test_zip_goes_in_step_and_is_crossed_with_the_grid_and_the_cells(folder: Path) -> None:
    text = (
        "zip: {plant.time_constant_s.min: [0.5, 0.6], plant.time_constant_s.max: [5, 6]}\n"
        "grid: {digital.poles: [5, 7]}\n"
        "cells: [{plant.static_gain: 2}, {plant.static_gain: {min: 2, max: 3}, digital.delay_samples: 1}]\n"
    )
    cells = study(text).cells
    assert len(cells) == 2 * 2 * 2
    specs = [spec_from_text(cell.text) for cell in cells]
    boxes = {(s.plant.parameters["time_constant_s"].min, s.plant.parameters["time_constant_s"].max) for s in specs}
    assert boxes == {(0.5, 5.0), (0.6, 6.0)}
    assert [s.digital.delay_samples for s in specs if s.digital] == [0] * 4 + [1] * 4
    # a number becomes a range, and a key that was not there is added
    assert specs[-1].plant.parameters["static_gain"].max == 3.0
    assert cells[-1].label == (
        'lag, plant.static_gain = {"min": 2, "max": 3}, digital.delay_samples = 1, plant.time_constant_s.min = 0.6, '
        "plant.time_constant_s.max = 6, digital.poles = 7"
    )


def test_check_overrides_are_for_the_spec_that_the_gains_are_checked_against(folder: Path) -> None:
    cells = study("grid: {plant.time_constant_s.max: [2], check.plant.time_constant_s.max: [2, 9]}").cells
    assert [spec_from_text(cell.text).plant.parameters["time_constant_s"].max for cell in cells] == [2, 2]
    assert [spec_from_text(cell.check).plant.parameters["time_constant_s"].max for cell in cells] == [2, 9]
    assert study("grid: {plant.time_constant_s.max: [2]}").cells[0].check == ""


def test_a_cells_key_depends_on_what_its_result_depends_on_and_on_nothing_else(folder: Path) -> None:
    versions = {"fopi-tune": "1"}

    def keys(text: str) -> list[str]:
        return [cell.key(versions) for cell in study(text).cells]

    one = keys("grid: {plant.time_constant_s.max: [2, 3]}")
    assert len(set(one)) == 2
    assert keys("description: other\ngrid: {plant.time_constant_s.max: [2, 3]}\ncollect: [tune.status]") == one
    assert keys("grid: {plant.time_constant_s.max: [3, 2]}") == one[::-1]
    assert not set(keys("grid: {plant.time_constant_s.max: [2, 3]}\nstages: [tune]")) & set(one)
    assert not set(keys("grid: {plant.time_constant_s.max: [2, 3]}\nstarts: base")) & set(one)
    cell = study("").cells[0]
    assert cell.key(versions) != cell.key({"fopi-tune": "2"})


def test_stages_are_run_in_their_order_whatever_the_file_says(folder: Path) -> None:
    assert study("stages: [validate, tune, tune]").cells[0].stages == (Stage.TUNE, Stage.VALIDATE)
    assert study("").cells[0].stages == (Stage.TUNE, Stage.PROVE)


def test_every_cell_that_the_spec_language_refuses_is_named_with_its_own_message(folder: Path) -> None:
    found = mistakes("grid:\n  plant.time_constant_s.max: [2, 0.5, three]\n  digital.poles: [5, 7]\n")
    assert found == [
        "s.yaml:5:3: plant.time_constant_s.max: cells 3, 4: plant.time_constant_s.min: min 1.0 is greater than "
        "max 0.5; swap them",
        "s.yaml:5:39: plant.time_constant_s.max: cells 5, 6: plant.time_constant_s.max: 'three' is not a number; "
        "write one such as 0.5 or 1e-3",
    ]


def test_a_misspelt_path_is_told_as_the_spec_language_tells_it(folder: Path) -> None:
    found = mistakes(
        "grid: {plant.time_constant.max: [2], controler.alpha: [1], 'requirements[0].phase_margin_deg.atleast': [3]}"
    )
    assert len(found) == 3
    assert "plant.time_constant: the key is not known here; did you mean 'time_constant_s'?" in found[0]
    assert "controler: the key is not known here; did you mean 'controller'?" in found[1]
    assert "did you mean 'at_least'?" in found[2]
    assert all(line.startswith("s.yaml:4:") and "cell 1 (lag, " in line for line in found)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("grid: {'requirements[7].on': [nominal]}", "requirements has 2 entries in the spec; they count from [0]"),
        ("grid: {plant.static_gain.max: [2]}", "plant.static_gain is '1' in the spec, not a mapping; override plant"),
        ("grid: {'plant[0]': [2]}", "plant is a mapping in the spec, not a list"),
        ("grid: {'scenarios[0].name': [a]}", "scenarios is not in the spec; give the whole list"),
        ("grid: {'plant..x': [2]}", "is no path into a spec"),
        ("grid: {check: [2]}", "is no path into a spec"),
        ("grid: {digital.poles: 5}", "'5' is written where a list of values belongs; write [5]"),
        ("grid: {digital.poles: []}", "the list is empty"),
        ("grid: [1]", "a list is written where a mapping belongs"),
        ("zip: {digital.poles: [5, 7], digital.delay_samples: [1]}", "has 1 value and digital.poles 2; they go in"),
        ("grid: {digital.poles: [5]}\nzip: {digital.poles: [5]}", "the path has values on line 4 already"),
        ("grid: {digital.poles: [5]}\ncells: [{digital.poles: 5}]", "the path has values on line 4 already"),
        ("stages: [tun]", "did you mean 'tune'?"),
        ("stages: [prove]", "there is no stage tune, and the spec does not fix kp, ki and alpha"),
        ("collect: [tune.x, prov.status]", "prov.status begins with no stage that is run; did you mean 'prove'?"),
        ("collect: {a: validate.status}", "validate.status begins with no stage that is run"),
        ("collect: {a: 'x y'}", "write one such as tune.gains.kp"),
        ("starts: bas", "did you mean 'base'?"),
        ("limit_cells: 0", "out of range"),
        ("gird: {}", "did you mean 'grid'?"),
        ("claims: sum", "'sum' is not known here"),
        ("grid: {plant.time_constant_s.max: [2], plant.time_constant_s: [{min: 1, max: 2}]}", "4:8: grid.plant.time_"
         "constant_s.max: plant.time_constant_s, which is put in later, replaces this; put it before, or into its"),
        ("cells: [{'requirements[0].on': family, requirements: []}]", "requirements, which is put in later, replaces"),
        ("cells: [{plant.time_constant_s.max: 2}]\ngrid: {plant: [{}]}", "4:10: cells[0].plant.time_constant_s"),
        ("grid: {check.controller.kp: [1]}", "4:8: grid.check.controller.kp: the gains that are checked are those"),
        ("collect: {outcome: tune.gains.kp}", "4:20: collect.outcome: every table of this study has a column outco"),
        ("collect: [outcome]", "4:11: collect[0]: every table of this study has a column outcome already"),
        ("collect: [tune.gains.kp, tune.gains.kp]", "4:26: collect[1]: is collected already; remove one of the two"),
        ("cells: []", "4:8: cells: the list has 0 entries; write a list of at least 1"),
        (f"grid: {{{'a.' * 40}a: [1]}}", "is no path into a spec; write one such as"),
        ("grid: {controller.kp: [{min: 0.5, max: 1}]}\nstages: [prove]", "s.yaml:4:8: controller.kp: cell 1 (lag, "
         'controller.kp = {"min": 0.5, "max": 1}): there is no stage tune'),
    ],
)  # fmt: skip
def test_mistakes_have_a_place_and_advice(folder: Path, text: str, part: str) -> None:
    found = mistakes(text)
    assert any(part in line for line in found), found
    assert all(line.startswith(("s.yaml:", "lag.yaml:1:1")) for line in found)


def test_claims_and_figures_are_entries_of_the_registry(folder: Path) -> None:
    Path("c.yaml").write_text("schema: 1\nname: c\nclaims: [slow_1, raises]\nfigures: all\n", encoding="utf-8")
    cells = load_study("c.yaml", registry="cases.study_claims").cells
    assert [(cell.kind, cell.name) for cell in cells] == [
        (Kind.CLAIM, "slow_1"),
        (Kind.CLAIM, "raises"),
        (Kind.FIGURE, "circle"),
        (Kind.FIGURE, "square"),
    ]
    assert len({cell.key({}) for cell in cells}) == 4
    Path("c.yaml").write_text("schema: 1\nname: c\nclaims:\n- slow_1\n- slwo_1\n", encoding="utf-8")
    with pytest.raises(SpecError, match=r"c\.yaml:5:3: claims\[1\]: 'slwo_1' is not known here; did you mean 'slow_1'"):
        load_study("c.yaml", registry="cases.study_claims")
    with pytest.raises(SpecError, match="this version of fopi-tune has no claims"):
        load_study("c.yaml", registry="no_such_module_anywhere")


def test_stages_on_samples_need_a_section_digital(folder: Path) -> None:
    Path("lag.yaml").write_text(LAG.replace("digital: {sample_time_s: 0.2}\n", ""), encoding="utf-8")
    assert "need a section digital" in mistakes("stages: [tune, validate]")[0]
    assert study("stages: [tune, validate]\ngrid: {digital.sample_time_s: [0.1]}").cells


def test_mistakes_of_the_spec_itself_are_told_once_and_in_its_own_file(folder: Path) -> None:
    Path("lag.yaml").write_text(LAG.replace("max: 3}", "max: 0.3}"), encoding="utf-8")
    found = mistakes("grid: {digital.poles: [5, 6, 7]}")
    assert found == ["lag.yaml:3:60: plant.time_constant_s.min: min 1.0 is greater than max 0.3; swap them"]


def test_a_spec_that_is_not_there_is_told_where_the_study_names_it(folder: Path) -> None:
    Path("s.yaml").write_text("schema: 1\nname: s\nspecs:\n- lag.yaml\n- lgg.yaml\n", encoding="utf-8")
    with pytest.raises(
        SpecError, match=r"s\.yaml:5:3: specs\[1\]: the spec cannot be used: lgg\.yaml:1:1: there is no"
    ):
        load_study("s.yaml")


def test_nothing_to_study_and_no_study_at_all_are_refused(folder: Path) -> None:
    Path("s.yaml").write_text("schema: 1\nname: s\n", encoding="utf-8")
    with pytest.raises(SpecError, match="there is nothing to study"):
        load_study("s.yaml")
    Path("s.yaml").write_text("- 1\n", encoding="utf-8")
    with pytest.raises(SpecError, match="the file is no study"):
        load_study("s.yaml")


def test_cells_are_counted_before_they_are_made(folder: Path) -> None:
    values = ", ".join(str(1 + i) for i in range(60))
    text = f"limit_cells: 100\ngrid: {{plant.time_constant_s.max: [{values}], digital.delay_samples: [{values}]}}"
    with pytest.raises(TooManyCellsError, match="3600 cells are more than 100; run them with --force"):
        study(text)
    told: list[int] = []
    with pytest.raises(TooManyCellsError):
        load_study("s.yaml", told=told.append)
    assert told == [3600]
    assert len(study("limit_cells: 1\ngrid: {digital.poles: [5, 6]}", force=True).cells) == 2


def test_the_schema_is_a_valid_schema_of_its_draft() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("path", STUDIES, ids=lambda p: p.stem)
def test_the_schema_takes_the_studies_that_are_shipped(path: Path) -> None:
    place, _ = load_document(path)
    jsonschema.Draft202012Validator(SCHEMA).validate(plain_value(place.node))


_VALUES: st.SearchStrategy[Any] = st.one_of(
    st.integers(-2, 9),
    st.sampled_from(["tune", "all", "a.b", "x y", "base"]),
    st.lists(st.sampled_from(["tune", "a.b", 3])),
    st.sampled_from(
        [
            {"from": 1, "to": 2},
            {"from": 1, "to": 2, "steps": 3, "scale": "log"},
            {"count": 3, "seed": 1},
            {"minimize": "a.b", "where": [{"column": "a.b", "at_most": 2}]},
            {"minimize": "a.b", "where": [{"column": "a.b"}]},
            {"heat_maps": [{"column": "a.b", "x": "tune", "y": "outcome"}]},
            "= 2 * a.b",
        ]
    ),
)


@settings(max_examples=150, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(
            ["stages", "starts", "collect", "limit_cells", "description", "grid", "zip", "odd", "draw", "sample"]
        )
        | st.sampled_from(["seed", "best", "report"]),
        st.one_of(_VALUES, st.dictionaries(st.sampled_from(["a.b", "a..b", "plant.x", "tune"]), _VALUES, max_size=2)),
        max_size=3,
    )
)
def test_what_the_schema_refuses_the_reader_refuses(document: dict[str, Any]) -> None:
    from fopi_tune.spec.yaml.composer import compose
    from fopi_tune.spec.yaml.nodes import Place
    from fopi_tune.spec.yaml.problems import ProblemCollector
    from fopi_tune.study.language import read_study

    document = {"schema": 1, "name": "s", "specs": ["lag.yaml"], **document}
    collector = ProblemCollector("s.yaml")
    taken = read_study(Place(compose(json.dumps(document), collector), "", collector)) is not None
    # the reader sees more: which sections fit together
    assert not taken or jsonschema.Draft202012Validator(SCHEMA).is_valid(document)
