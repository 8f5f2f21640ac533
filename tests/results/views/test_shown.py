"""Results in a session: few lines, a table, a data frame, and copies that say the same."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from typing import Any

import pytest

import fopi_tune as ft
from fopi_tune.results.views.shown import summary_lines

GAINS = ft.FoPi(0.44651475946456753, 0.37032589727989074, 0.8319673847369714)
SPEC, SYSTEM = "specs/brake.yaml", "systems/car_held.yaml"
#: a result of every kind that has JSON
RESULTS: dict[str, Callable[[], Any]] = {
    "design": lambda: ft.tune(SPEC),
    "check": lambda: ft.prove(SPEC, GAINS),
    "discretized": lambda: ft.discretize(SPEC, GAINS),
    "validated": lambda: ft.validate(SPEC, GAINS, samples=40),
    "simulated": lambda: ft.simulate(SPEC, GAINS),
    "run": lambda: ft.run(SPEC),
    "simulated system": lambda: ft.simulate_system(SYSTEM, scenario="experiment_1"),
    "validated system": lambda: ft.validate_system(SYSTEM, samples=5),
    "discretized system": lambda: ft.discretize_system(SYSTEM),
    "proved system": lambda: ft.prove_system(SYSTEM),
}


@pytest.mark.parametrize("kind", RESULTS)
def test_every_result_is_short_in_a_session_and_its_copies_say_the_same(kind: str) -> None:
    result = RESULTS[kind]()
    said = repr(result)
    assert len(said) <= 800
    assert len(said.splitlines()) <= 10
    assert (
        said.splitlines()[0] == f"{type(result).__name__} of {result.to_dict()['name']}: {result.to_dict()['status']}"
    )
    text = json.dumps(result.to_dict())
    for other in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        assert json.dumps(other.to_dict()) == text
        assert repr(other) == said
    assert result._repr_html_().startswith(f"<p><b>{said.splitlines()[0]}</b>")


def test_objects_without_json_are_short_too() -> None:
    design = ft.tune(SPEC)
    bound = ft.certify_optimum("specs/throttle.yaml")
    sweep = ft.tradeoff(SPEC, "sensitivity_db", start=-20.0, stop=-19.9, points=2)
    margins = ft.margins(GAINS, ft.Plant((1.0,), (2.25, 1.0)))
    for each in (design.spec, design.certificate, bound, sweep, ft.load_system(SYSTEM), margins):
        assert len(repr(each)) <= 800
        assert repr(pickle.loads(pickle.dumps(each))) == repr(each)
    assert repr(design.certificate).startswith("<Certificate of brake: proved, 5 of 5 requirements of the loop proved,")
    assert repr(design.spec) == "<DesignSpec brake: plant lag, 5 requirements, on samples of 0.2 s>"


def test_a_violated_result_names_what_is_missed() -> None:
    said = repr(ft.prove(SPEC, ft.FoPi(2.0, 0.4, 1.0)))
    assert "Check of brake: violated" in said
    assert "violated: crossover_rad_s = 0.3" in said
    counted = repr(ft.validate(SPEC, ft.FoPi(2.0, 0.4, 1.0), samples=30))
    assert "of 30 plants meet everything at once" in counted


def test_rows_are_those_of_the_json_and_of_the_table() -> None:
    design = ft.tune(SPEC)
    rows = design.rows()
    assert [row["requirement"] for row in rows] == [
        "crossover_rad_s = 0.3",
        "phase_margin_deg = 90",
        "phase_margin_deg >= 80",
        "gain_margin_db >= 12.04",
        "sensitivity_db <= -20",
    ]
    assert {row["verdict"] for row in rows} == {"proved"}
    assert [row["achieved"] for row in rows] == [each["achieved"] for each in design.to_dict()["requirements"]]
    table = design._repr_html_()
    assert table.count("<tr>") == 1 + len(rows)
    assert "phase_margin_deg &gt;= 80" in table


def test_a_data_frame_has_the_rows() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    evidence = ft.validate(SPEC, GAINS, samples=25)
    frame = evidence.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    for name in ("requirement", "met", "low"):
        assert list(frame[name]) == [row[name] for row in evidence.rows()]
    assert list(frame["total"]) == [25] * len(frame)


def test_a_long_story_is_cut() -> None:
    document = {"name": "x" * 90, "status": "violated", "notes": [f"note {i}" for i in range(20)]}
    lines = summary_lines("Check", document)
    assert len(lines) == 10
    assert lines[-1] == "… and 12 more lines"
    assert max(map(len, lines)) == 78
