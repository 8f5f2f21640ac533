"""The best cell: which one it is, how it is told, and what is kept of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from cases.study_files import LAG
from cases.two_modes import write
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.errors import SpecError
from fopi_tune.pipeline.tune import tune
from fopi_tune.spec import load_spec, load_system
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.model import Sense
from fopi_tune.study import Machines, StudyResult, run
from fopi_tune.study.best import Best, find_best
from fopi_tune.study.load import load_study, study_json_schema
from fopi_tune.study.model import BestRule, Comparison, Condition, Study, Value
from fopi_tune.study.overrides import spec_from_text

HEAD = "schema: 1\nname: s\nspecs: [lag.yaml]\n"
GRID = "grid: {controller.kp: [0.38, 0.385, 0.39]}\nstages: [tune]\ncollect: {pm: tune.nominal.phase_margin_deg}\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lag.yaml").write_text(LAG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def study(text: str, head: str = HEAD) -> Study:
    Path("s.yaml").write_text(head + text, encoding="utf-8")
    return load_study("s.yaml")


def ran(text: str) -> StudyResult:
    return run(study(text), Path("out"), Machines(0))


def best_of(result: StudyResult) -> dict[str, Any]:
    return json.loads(result.table.files["best.json"])


def conditions(**limits: Any) -> tuple[Condition, ...]:
    found = []
    for name, limit in limits.items():
        column, _, comparison = name.partition("__")
        found.append(Condition(column, Comparison(comparison), limit))
    return tuple(found)


RECORDS = st.lists(
    st.fixed_dictionaries(
        {
            "a": st.one_of(st.none(), st.integers(-3, 3), st.floats(-3, 3), st.just("x")),
            "b": st.integers(0, 4),
            "outcome": st.sampled_from(["solved", "met", "infeasible", "failed"]),
        }
    ),
    max_size=8,
)


@given(RECORDS, st.sampled_from(list(Sense)), st.integers(0, 4))
def test_it_is_the_first_of_those_that_meet_the_conditions_and_have_the_least(
    rows: list[dict[str, Value]], sense: Sense, limit: int
) -> None:
    records = [{"cell": index + 1, **row} for index, row in enumerate(rows)]
    found = find_best(BestRule(sense, "a", conditions(b__at_least=float(limit))), records)
    side = 1 if sense is Sense.MINIMIZE else -1
    good: list[tuple[float, int]] = []
    for index, row in enumerate(rows):
        a, b = row["a"], row["b"]
        if isinstance(a, int | float) and isinstance(b, int) and b >= limit and row["outcome"] in ("solved", "met"):
            good.append((side * a, index))
    assert found.index == (min(good)[1] if good else None)
    assert found.value == (rows[min(good)[1]]["a"] if good else None)


def told(rule: BestRule, *rows: dict[str, Value]) -> Best:
    return find_best(rule, [{"cell": i + 1, "outcome": "met", **row} for i, row in enumerate(rows)])


def test_why_there_is_none_is_told_by_the_conditions_names() -> None:
    rows: tuple[dict[str, Value], ...] = ({"a": 1, "b": 3}, {"a": 2, "b": 5.5}, {"a": None, "b": None})
    least = lambda **limits: told(BestRule(Sense.MINIMIZE, "a", conditions(**limits)), *rows).message  # noqa: E731
    assert least(b__at_least=9.0) == "none of 3 cells has b at least 9 (the most is 5.5)"
    assert least(b__at_most=2.0) == "none of 3 cells has b at most 2 (the least is 3)"
    assert least(b__equals="x") == "none of 3 cells has b equals x"
    assert least(b__at_least=4.0, a__at_most=1.0) == (
        "none of 3 cells meets all of b at least 4 (1 does), a at most 1 (1 does)"
    )
    assert told(BestRule(Sense.MINIMIZE, "c"), *rows).message == "no cell has a number in the column c"
    assert find_best(BestRule(Sense.MINIMIZE, "a"), [{"cell": 1, "outcome": "failed", "a": 1}]).message == (
        "none of 1 cell ends well"
    )


def test_a_condition_on_the_outcome_lets_other_outcomes_in() -> None:
    rows: list[dict[str, Value]] = [
        {"cell": 1, "outcome": "infeasible", "a": 1, "c": True},
        {"cell": 2, "outcome": "met", "a": 2, "c": False},
    ]
    assert find_best(BestRule(Sense.MINIMIZE, "a"), rows).index == 1
    assert find_best(BestRule(Sense.MINIMIZE, "a", conditions(outcome__equals="infeasible")), rows).index == 0
    assert find_best(BestRule(Sense.MINIMIZE, "a", conditions(c__equals="false")), rows).index == 1
    assert find_best(BestRule(Sense.MINIMIZE, "a", conditions(a__equals=2.0)), rows).index == 1


def test_it_is_marked_named_and_kept_in_full_with_a_spec_that_gives_the_same_design() -> None:
    result = ran(GRID + "best: {maximize: pm, where: [{column: controller.kp, at_most: 0.388}]}\n")
    table = result.table
    assert table.columns[:5] == ("cell", "spec", "controller.kp", "outcome", "best")
    pms = [row[table.columns.index("pm")] for row in table.rows]
    assert [row[4] for row in table.rows] == [False, True, False]
    kept = best_of(result)
    assert (kept["cell"], kept["value"], kept["overrides"]) == (2, pms[1], {"controller.kp": 0.385})
    assert kept["message"] == "of 2 cells that meet the conditions"
    assert kept["results"]["tune"]["nominal"]["phase_margin_deg"] == pms[1]
    Path("best.yaml").write_text(str(table.files["best.yaml"]), encoding="utf-8")
    spec = load_spec("best.yaml")
    assert digests_of(spec) == digests_of(spec_from_text(result.study.cells[1].text))
    again = tune(spec, proof=False).to_dict()
    assert again["gains"] == kept["results"]["tune"]["gains"]


def test_the_command_names_it_and_writes_its_files() -> None:
    study(GRID + "best: {maximize: pm}\n")
    command = ["study", "s.yaml", "--workers", "0"]
    told = CliRunner().invoke(app, command)
    assert told.exit_code == 0
    words = " ".join(told.stdout.split())
    assert "Best: cell 3 (lag, controller.kp = 0.39) has the largest pm, " in words
    assert max(len(line) for line in told.stdout.splitlines()) <= 80
    assert json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)["best"]["cell"] == 3
    assert {"best.json", "best.yaml"} <= {path.name for path in Path("results/s").iterdir()}
    study(GRID + "best: {maximize: pm, where: [{column: pm, at_least: 170}]}\n")
    told = CliRunner().invoke(app, command)
    assert told.exit_code == 0
    assert "Best: no cell; none of 3 cells has pm at least 170 (the most is " in " ".join(told.stdout.split())
    assert "best.yaml in results/s is of an earlier result, not of this one" in told.stderr
    assert json.loads(Path("results/s/best.json").read_text(encoding="utf-8"))["cell"] is None


def test_a_system_is_kept_with_the_specs_of_its_modes(tmp_path: Path) -> None:
    write(tmp_path, ("z", "a"), more="validation: {samples: 20}")
    text = "grid: {system.hysteresis: [0.2, 0.4], system.a.spec.plant.static_gain: [11]}\nstages: [simulate]\n"
    text += "collect: {iae: 'simulate.scenarios[0].measures.iae'}\nbest: {minimize: iae}\n"
    result = run(study(text, HEAD.replace("lag", "rig")), Path("out"), Machines(0))
    assert {name for name in result.table.files if name.startswith("best")} == {
        "best.json", "best.yaml", "best_a.yaml", "best_z.yaml",
    }  # fmt: skip
    for name, content in result.table.files.items():
        Path(name).write_text(str(content), encoding="utf-8")
    system, kept = load_system("best.yaml"), best_of(result)
    assert [mode.name for mode in system.modes] == ["z", "a"]
    assert system.modes[1].spec.plant.parameters["static_gain"].nominal == 11.0
    assert system.hysteresis == kept["overrides"]["system.hysteresis"]


def test_data_that_the_spec_names_are_kept_beside_it() -> None:
    Path("data").mkdir()
    Path("data/drawn.csv").write_text("time_constant_s\n2\n3\n", encoding="utf-8")
    Path("lag.yaml").write_text(LAG.replace("samples: 50", "samples_file: data/drawn.csv"), encoding="utf-8")
    files = ran(GRID + "best: {maximize: pm}\n").table.files
    assert files["best_drawn.csv"] == b"time_constant_s\n2\n3\n"
    assert "best_drawn.csv" in str(files["best.yaml"])


@pytest.mark.parametrize(
    ("best", "problem"),
    [
        ("{minimize: pmm}", "s.yaml:7:18: best.minimize: 'pmm' is not known here; did you mean 'pm'?; collect: makes"),
        ("{minimize: pm, where: [{column: q, at_most: 1}]}", "s.yaml:7:39: best.where[0].column: 'q' is not known"),
        ("{minimize: pm, where: [{column: pm}]}", "s.yaml:7:30: best.where[0]: the condition has no limit; add"),
        ("{minimize: pm, where: [{column: pm, at_most: x}]}", "best.where[0].at_most: 'x' is not a number"),
        ("{minimize: pm, where: []}", "best.where: the list has 0 entries"),
        ("{minimise: pm}", "best.minimise: the key is not known here; did you mean 'minimize'?"),
        ("{where: [{column: pm, at_most: 1}]}", "best: a direction is missing; write one of minimize, maximize"),
        ("{minimize: pm, maximize: pm}", "best.maximize: a second direction beside minimize"),
    ],
)  # fmt: skip
def test_mistakes_have_a_place_and_advice(best: str, problem: str) -> None:
    with pytest.raises(SpecError) as caught:
        study(f"{GRID}best: {best}\n")
    assert any(problem in str(each) for each in caught.value.problems), caught.value.problems


def test_best_is_about_specs_and_is_then_no_name_of_another_column() -> None:
    with pytest.raises(SpecError, match="this is about specs, and there are none"):
        study("claims: all\nbest: {minimize: x}\n", "schema: 1\nname: c\n")
    with pytest.raises(SpecError, match="every table of this study has a column best already"):
        study("stages: [tune]\ncollect: {best: tune.objective}\nbest: {minimize: best}\n")
    assert study("stages: [tune]\ncollect: {best: tune.objective}\n").best is None


def test_the_schema_takes_it() -> None:
    validator = jsonschema.Draft202012Validator(study_json_schema())
    document = {"schema": 1, "name": "s", "specs": ["a"]}
    where = [{"column": "a", "at_least": 1}, {"column": "outcome", "equals": "met"}]
    assert validator.is_valid(document | {"best": {"minimize": "a", "where": where}})
    assert not validator.is_valid(document | {"best": {"minimize": "a", "where": [{"column": "a"}]}})
    assert not validator.is_valid(document | {"best": {"where": where}})
