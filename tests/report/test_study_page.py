"""The page of a study: complete, well formed, without network, the same bytes twice; and the figures it chooses."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from cases.pages import HOSTILE, Page
from cases.study_files import LAG
from cases.study_tables import result_of
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.errors import SpecError
from fopi_tune.report.study_page import STUDY_REPORT, study_page_files
from fopi_tune.spec.model import Sense
from fopi_tune.study.load import load_study, study_json_schema
from fopi_tune.study.model import BestRule, HeatMap, ReportRule

CELLS = [
    ({"a.b": a, "c": c}, "met", {"iae": a * c, "kp": 1.0 + c, "word": "x"})
    for a in (1.0, 2.0, 4.0) for c in (1.0, 1.5, 3.0)
]  # fmt: skip
HEAD = "schema: 1\nname: s\nspecs: [lag.yaml]\nstages: [tune]\ncollect: {pm: tune.nominal.phase_margin_deg}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_page_has_its_figures_cells_and_best_needs_no_network_and_is_the_same_twice() -> None:
    result = result_of(CELLS, BestRule(Sense.MINIMIZE, "kp"))
    files = study_page_files(result)
    assert files == study_page_files(result_of(CELLS, BestRule(Sense.MINIMIZE, "kp")))
    text = str(files[STUDY_REPORT])
    page = Page(text)
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert page.tags["script"] == page.figures_scripts
    assert page.tags["img"] == page.tags["image"] == 0
    assert [value for name, value in page.attributes if name in ("src", "href") and not value.startswith("#")] == []
    assert "default-src 'none'" in text
    words = " ".join("".join(page.text).split())
    assert "9 cells: 9 met." in words
    assert "Best: cell 1 (s, a.b = 1.0, c = 1.0) has the least kp, 2, of 9 cells." in words
    assert "kp as colour over a.b (across) and c (up): from 2 in cell 1 to 4 in cell 3." in words
    # the best one's column first, and a column of words is no figure
    assert sorted(name for name in files if name.endswith(".svg")) == [
        "figures/heat_map_1.svg", "figures/heat_map_2.svg", "figures/parallel_coordinates.svg",
    ]  # fmt: skip
    assert page.tags["tr"] == 1 + len(CELLS)
    assert page.tags["figure"] == page.tags["figcaption"] == 3


def test_figures_that_are_asked_for_are_those_that_are_drawn(plain_figures: None) -> None:
    rule = ReportRule((HeatMap("iae", "c", "kp"), HeatMap("word", "c", "kp")), ("c", "iae"))
    files = study_page_files(result_of(CELLS, report=rule))
    words = " ".join("".join(Page(str(files[STUDY_REPORT])).text).split())
    assert "iae as colour over c (across) and kp (up)" in words
    assert "No heat map of word: no cell has a number there." in words
    assert "largest above: c 1 to 3; iae 1 to 12." in words


def test_a_study_of_one_cell_or_of_equal_ones_has_no_page() -> None:
    assert study_page_files(result_of(CELLS[:1])) == {}
    assert study_page_files(result_of([({}, "met", {"iae": 1.0})] * 2)) == {}


def test_one_axis_has_no_heat_map(plain_figures: None) -> None:
    rows = [({"a": a}, "met", {"iae": a * a}) for a in (1.0, 2.0)]
    assert [name for name in study_page_files(result_of(rows)) if name.endswith("svg")] == [
        "figures/parallel_coordinates.svg"
    ]


def test_names_that_are_no_html_stay_text() -> None:
    rows = [({f"{HOSTILE}a": a, "b$": a % 2}, "met", {HOSTILE: float(a)}) for a in (1, 2, 3)]
    files = study_page_files(result_of(rows, name=HOSTILE))
    page = Page(str(files[STUDY_REPORT]))
    assert page.open == []
    assert page.tags["script"] == page.figures_scripts
    assert HOSTILE in "".join(page.text)


def test_a_long_study_shows_its_first_cells_and_says_how_many_are_left_out(plain_figures: None) -> None:
    rows = [({"a": i}, "met", {"iae": float(i % 5)}) for i in range(520)]
    text = str(study_page_files(result_of(rows))[STUDY_REPORT])
    assert Page(text).tags["tr"] == 501
    assert "and 20 more rows" in text


def test_the_command_writes_the_page_and_tells_of_an_old_one(folder: Path, plain_figures: None) -> None:
    Path("s.yaml").write_text(f"{HEAD}grid: {{controller.kp: [0.38, 0.385, 0.39]}}\n", encoding="utf-8")
    told = CliRunner().invoke(app, ["study", "s.yaml", "--workers", "0"])
    assert told.exit_code == 0, told.stderr
    assert Path("results/s/report.html").is_file()
    assert [path.name for path in Path("results/s/figures").glob("*.svg")] == ["parallel_coordinates.svg"]
    Path("s.yaml").write_text(HEAD, encoding="utf-8")
    told = CliRunner().invoke(app, ["study", "s.yaml", "--workers", "0"])
    assert "report.html in results/s is of an earlier result, not of this one" in told.stderr


def test_a_page_that_cannot_be_made_loses_no_result(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("no page")

    monkeypatch.setattr("fopi_tune.report.study_page.render_template", fail)
    Path("s.yaml").write_text(f"{HEAD}grid: {{controller.kp: [0.38, 0.385]}}\n", encoding="utf-8")
    told = CliRunner().invoke(app, ["study", "s.yaml", "--workers", "0"])
    assert told.exit_code == 3
    assert "report" in told.stderr
    assert Path("results/s/table.csv").is_file()
    assert "s: 2 of 2 cells done." in told.stdout


@pytest.mark.parametrize(
    ("report", "problem"),
    [
        ("{heat_maps: [{column: pmm, x: controller.kp, y: outcome}]}", "s.yaml:7:31: report.heat_maps[0].column: 'pmm' "
         "is not known here; did you mean 'pm'?"),
        ("{heat_maps: [{column: pm, x: controller.kp, y: controller.kp}]}", "report.heat_maps[0].y: x and y are both"),
        ("{heat_maps: [{column: pm, x: controller.kp}]}", "report.heat_maps[0].y: the key is missing"),
        ("{parallel_coordinates: [pm]}", "report.parallel_coordinates: the list has 1 entry; write a list of 2"),
        ("{parallel_coordinates: [pm, q]}", "report.parallel_coordinates[1]: 'q' is not known here"),
        ("{heat_map: []}", "did you mean 'heat_maps'?"),
    ],
)  # fmt: skip
def test_mistakes_of_the_section_have_a_place_and_advice(folder: Path, report: str, problem: str) -> None:
    Path("s.yaml").write_text(f"{HEAD}grid: {{controller.kp: [0.38]}}\nreport: {report}\n", encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        load_study("s.yaml")
    assert any(problem in str(each) for each in caught.value.problems), caught.value.problems


def test_the_section_is_read_as_it_is_written(folder: Path) -> None:
    report = "{heat_maps: [{column: pm, x: controller.kp, y: outcome}], parallel_coordinates: [pm, controller.kp]}"
    Path("s.yaml").write_text(f"{HEAD}grid: {{controller.kp: [0.38]}}\nreport: {report}\n", encoding="utf-8")
    rule = load_study("s.yaml").report
    assert rule == ReportRule((HeatMap("pm", "controller.kp", "outcome"),), ("pm", "controller.kp"))
    document = {"schema": 1, "name": "s", "specs": ["a"], "report": {"parallel_coordinates": ["a", "b"]}}
    validator = jsonschema.Draft202012Validator(study_json_schema())
    assert validator.is_valid(json.loads(json.dumps(document)))
    assert not validator.is_valid({**document, "report": {"parallel_coordinates": ["a"]}})
